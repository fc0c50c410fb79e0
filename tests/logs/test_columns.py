"""Errors of columns are said with what mends them, or why they cannot be told."""

import math
import re

import numpy as np
import pytest
from fuzzing import marked, slow
from log_columns import ERRORS, RIGHT, STEP, G, axes_of, outer_loop, sampled
from log_files import heavy_cessna
from made_up import made_up_run
from scipy import constants

import flighttune as ft
from flighttune.logs import checks, relations

FEW = ("p sign", "n_z without gravity", "V_a in kn", "V_err sign")
MORE = "phi and theta", "theta as 1/57", "commands 1 s late", "V_a of the ground", "clock times 1.1"
REST = (
    *("phi and phi_cmd", "n_z and n_z_cmd", "p is another", "psi rests", "chi magnetic"),
    "psi by 90",
)
UNLIKE = 0.005
"""Less correlation of columns that are apart by a sample of 0.1 s."""
FLIGHTS = {
    "still air": RIGHT["turns and climbs"],
    "wind": RIGHT["wind of 0.4 of the airspeed"],
    "Cessna": lambda: of_run(heavy_cessna(150.0)),
}


def of_run(run):
    """Columns of a simulated flight; its velocity over ground is the slope of its path."""
    names = "phi theta psi p q r n_z V_a north east phi_cmd n_z_cmd h"
    columns = {name: run.signals[name].to_numpy() for name in names.split()}
    over = {"v_north": run.signals["north"], "v_east": run.signals["east"], "v_down": -columns["h"]}
    return {"t_s": run.t, **columns, **{x: np.gradient(y, run.t) for x, y in over.items()}}


@pytest.fixture(scope="session")
def log_of(tmp_path_factory):
    """What is said of a table of a flight at a rate, with a change."""
    flown, path = {}, tmp_path_factory.mktemp("columns") / "flight.csv"

    def said(make, rate, change=lambda _: {}):
        if make not in flown:
            flown[make] = make()
        log = sampled(flown[make], rate)
        log.assign(**change(log)).to_csv(path, index=False)
        return ft.load_log(path).provenance.log

    return said


def check_error(log_of, flight, rate, name):
    change, says = ERRORS[name]

    log = log_of(FLIGHTS[flight], rate, change)

    assert any(re.search(says, line) for line in log["checks"]), log["checks"]


@pytest.mark.parametrize(
    "name",
    [*marked([*FEW, *MORE], pytest.mark.soak, but=FEW), *marked(REST, pytest.mark.counts, but=())],
)
@pytest.mark.slow
def test_an_error_of_a_column_is_said_with_its_cure(log_of, name):
    check_error(log_of, "still air", 10, name)


@pytest.mark.soak
@pytest.mark.parametrize("name", [*ERRORS][::6])  # all of them in `make counts`
def test_errors_are_said_in_wind_too(log_of, name):
    check_error(log_of, "wind", 10, name)


NOT_THERE = ("V_err sign", "V_err is another", "phi and psi")
"""On the Cessna: it has no error of speed, and its heading read as roll lies where degrees do."""


@pytest.mark.counts
@pytest.mark.parametrize("rate", [10, 25, 50])
@pytest.mark.parametrize("name", [name for name in ERRORS if name not in NOT_THERE])
@pytest.mark.parametrize("flight", [*FLIGHTS])
def test_every_error_is_said_of_every_flight_at_every_rate(log_of, flight, name, rate):
    check_error(log_of, flight, rate, name)


@pytest.mark.parametrize("flight", ["turns and climbs", *slow("long inverted", "loops in wind")])
def test_a_right_log_is_not_accused(log_of, flight):
    log = log_of(RIGHT[flight], 25)

    assert log["wrong"] == []
    assert any(line.startswith("These agree: ") for line in log["checks"])


@pytest.mark.parametrize("rate", "pqr")
@pytest.mark.parametrize("at", [0.0, 60.0, 110.0])
def test_a_right_rate_is_not_accused_for_a_few_bad_seconds(log_of, rate, at):
    """As between two kinds of flight: attitude is coarse, and the rate is large and unlike it."""

    def shaken(log):
        bad = (log["t_s"] >= at) & (log["t_s"] < at + 6.0)
        noise = np.random.default_rng(7).standard_normal(len(log))
        return {rate: np.where(bad, log[rate] + 0.5 * noise.cumsum() * 0.2, log[rate])}

    log = log_of(FLIGHTS["still air"], 25, shaken)

    assert not log["wrong"]


@pytest.mark.slow
@pytest.mark.parametrize("name", [None, "p sign", "V_a in kn"])
def test_a_part_of_a_log_has_the_verdict_of_the_whole(tmp_path, name):
    """A part may hardly vary, or be too short to tell anything."""
    log = sampled(FLIGHTS["still air"](), 25)
    log.assign(**(ERRORS[name][0](log) if name else {})).to_csv(tmp_path / "f.csv", index=False)
    whole = ft.load_log(tmp_path / "f.csv").provenance.log["wrong"]
    last = float(log["t_s"].iloc[-1])

    assert bool(whole) == (name is not None)
    for start, end in ((0.0, 8.0), (0.4 * last, 0.6 * last), (last - 15.0, last)):
        part = ft.load_log(tmp_path / "f.csv", start=start, end=end)
        assert part.provenance.log["wrong"] == whole


@pytest.mark.counts
@pytest.mark.parametrize("rate", [10, 25, 50])
@pytest.mark.parametrize("make", [*RIGHT.values(), FLIGHTS["Cessna"]], ids=[*RIGHT, "Cessna"])
def test_no_right_log_is_accused_at_any_rate(log_of, make, rate):
    assert log_of(make, rate)["wrong"] == []


@pytest.mark.parametrize("course", [0.4, 2.0, -1.0])
def test_a_velocity_that_is_rotated_keeps_its_size_and_turns_clockwise(course):
    given = {"v_north": 20.0 * np.cos([course]), "v_east": 20.0 * np.sin([course])}

    found = checks._rotated(0.7)(given)

    velocity = complex(found["v_north"][0], found["v_east"][0])
    assert velocity == pytest.approx(20.0 * np.exp(1j * (course + 0.7)), rel=1e-12)


@pytest.mark.parametrize("nose", [False, True])
@pytest.mark.parametrize("wind", [(6.0, -3.0), (-2.0, 7.0)])
def test_a_circle_shows_wind_and_unit_of_the_airspeed_with_and_without_a_nose(nose, wind):
    dt, factor, V_a = 0.1, 1.2, 20.0
    psi = 0.1 * dt * np.arange(1200)
    north, east = (
        factor * V_a * part + air
        for part, air in zip((np.cos(psi), np.sin(psi)), wind, strict=True)
    )
    given = {"phi": 0.2 + 0.0 * psi, "V_a": V_a + 0.0 * psi, "v_north": north, "v_east": east}
    given |= {"psi": np.angle(np.exp(1j * psi))} if nose else {}

    found = relations.wind_triangle(relations.Motion(given, dt))

    assert not isinstance(found, str)
    # A mean over 1.1 s shortens an arc of 0.1 rad/s by 0.05 %.
    assert found[0] == pytest.approx(factor, rel=1e-3)
    assert found[1] == pytest.approx(wind, abs=0.01)


@pytest.mark.parametrize(("share", "told"), [(0.85, False), (1.15, True)])
def test_wind_and_unit_are_told_apart_where_headings_are_wide_enough_for_a_fifth(share, told):
    """The error of a slope is that of the values over the spread of the headings and the time.

    Values err by at least `UNSTEADY` for 5 s, and a swing has half the square of its size.
    """
    dt, V_a, lasting = 0.1, 20.0, 240.0
    least = math.sqrt(2.0 * 5.0 / lasting) * relations.UNSTEADY / (0.2 * V_a)
    psi = share * least * np.sin(0.1 * math.pi * dt * np.arange(round(lasting / dt)))
    given = {"phi": 0.0 * psi, "V_a": V_a + 0.0 * psi, "psi": psi}
    given |= {"v_north": V_a * np.cos(psi) + 3.0, "v_east": V_a * np.sin(psi)}

    found = relations.wind_triangle(relations.Motion(given, dt))

    assert isinstance(found, str) != told
    if not told:
        assert found.startswith("the log is of one heading")


@pytest.mark.parametrize(
    ("factor", "told"), [(0.51, False), (0.9, True), (1.2, True), (1.94, False)]
)
def test_a_wind_is_compared_only_where_airspeeds_are_nearly_those_over_ground(factor, told):
    dt, V_a, wind = 0.1, 20.0, (6.0, -3.0)
    psi = 0.1 * dt * np.arange(1200)
    given = {"phi": 0.2 + 0.0 * psi, "V_a": V_a + 0.0 * psi, "psi": np.angle(np.exp(1j * psi))}
    for name, part, air in zip(("north", "east"), (np.cos(psi), np.sin(psi)), wind, strict=True):
        given |= {f"v_{name}": factor * V_a * part + air, f"wind_{name}": air + 0.0 * psi}

    found = relations._wind(relations.Motion(given, dt))

    assert isinstance(found, str) != told
    if told:
        assert found[1] == pytest.approx(np.tile(wind, (1200, 1)), abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["phi and phi_cmd", "n_z and n_z_cmd"])
def test_a_command_in_the_place_of_its_response_is_not_identified(tmp_path, log_of, name):
    log = sampled(FLIGHTS["still air"](), 25)
    log.assign(**ERRORS[name][0](log)).to_csv(tmp_path / "flight.csv", index=False)

    with pytest.raises(ft.InputError, match="exchanged would do"):
        ft.identify(tmp_path / "flight.csv")


@pytest.mark.slow
def test_a_flight_that_is_inverted_for_most_of_its_time_is_identified_or_said_why(tmp_path):
    """It has no commands, which is the reason, and no other."""
    sampled(RIGHT["long inverted"](), 25).to_csv(tmp_path / "flight.csv", index=False)

    found = ft.identify(tmp_path / "flight.csv")

    assert "no roll commands" in str(found.answer().failure)


def test_any_columns_are_judged_whatever_they_hold():
    """Subsets of columns at random sizes, with gaps, zeros, drifts and nothing at all."""
    random = np.random.default_rng(1)
    for _ in range(40):
        t = random.choice([0.02, 0.1, 0.2]) * np.arange(random.integers(200, 800))
        columns = {"phi": random.standard_normal(len(t))}
        for name in (name for name in relations.KIND if name != "phi" and random.random() < 0.5):
            column = 10.0 ** random.integers(-3, 8) * random.standard_normal(len(t))
            gaps = np.where(random.random(len(t)) < 0.3, np.nan, column)
            kinds = [column, gaps, 0.0 * column, np.nan * column, np.cumsum(column)]
            columns[name] = kinds[random.integers(len(kinds))]

        values, _ = checks.signals_of(columns, t)

        assert set(columns) <= set(values)
        checks.verdicts(columns, t, {})


@pytest.mark.parametrize(
    ("V_a", "V_g", "same"),
    [
        (20.0, 20.0, True),
        (20.0, 21.0, False),
        (21.0, 20.0, False),
        (0.5, 0.5, False),  # it stands on the ground all the time
    ],
)
def test_an_airspeed_is_copied_where_it_is_the_ground_speed_in_flight(V_a, V_g, same):
    t = np.arange(400.0)
    on_ground = t < 100.0
    columns = {"phi": 0.0 * t, "chi": 0.0 * t, "V_g": np.where(on_ground, 0.4, V_g)}
    columns["V_a"] = np.where(on_ground, 0.9, V_a)

    assert relations.copied(relations.Motion(columns, 0.1)) == same
    alone = {name: columns[name] for name in ("phi", "V_a")}
    assert not relations.copied(relations.Motion(alone, 0.1))


@pytest.mark.parametrize("heading", [True, False])
def test_pitch_rates_of_a_steep_climb_are_judged_by_a_heading_alone(heading):
    """A pull-up at 0.1 rad/s without a turn; a course says nothing of a path steeper than STEEP."""
    dt, theta = 0.1, 0.01 * np.arange(150)
    columns = {
        "phi": 0.0 * theta,
        "theta": theta,
        "p": 0.0 * theta,
        "q": 0.1 + 0.0 * theta,
        "r": 0.0 * theta,
        "v_north": 25.0 * np.cos(theta),
        "v_east": 0.0 * theta,
        "v_down": -25.0 * np.sin(theta),
    } | ({"psi": 0.0 * theta} if heading else {})

    given, expected = relations._body_rate(1)(relations.Motion(columns, dt))

    judged = np.ones(len(theta), bool) if heading else np.cos(theta) > relations.STEEP + 0.01
    judged[[0, -1]] = False
    assert expected[judged] == pytest.approx(given[judged], rel=1e-3)
    assert np.isnan(expected[np.cos(theta) < relations.STEEP - 0.01]).all() == (not heading)


def test_units_that_are_mistaken_have_the_factors_of_their_definitions():
    units = {"kn": constants.knot, "km/h": constants.kmh, "ft/s": constants.foot}
    units |= {"cm/s": constants.centi, "mph": constants.mph}
    lengths = {"ft": constants.foot, "cm": constants.centi, "mm": constants.milli, "km": 1000.0}

    speeds = {f"{unit} read as m/s": pytest.approx(size) for unit, size in units.items()}
    assert speeds == checks.MISTAKEN["speed"] == checks.MISTAKEN["wind"]
    read = {f"{unit} read as m": pytest.approx(size) for unit, size in lengths.items()}
    assert checks.MISTAKEN["length"] == read
    for kind in ("angle", "rate"):
        assert checks.MISTAKEN[kind] == {"deg read as rad": pytest.approx(constants.degree)}


@pytest.mark.parametrize(
    ("columns", "by", "as_alike"),
    [("pqr", 1, False), (("v_north", "v_east", "v_down"), 1, False), (("phi_cmd",), -3, True)],
)
def test_columns_of_motion_are_alike_at_their_time_and_commands_at_their_delay(
    columns, by, as_alike
):
    given = {name: column[::10].copy() for name, column in outer_loop(60.0, seed=1).items()}
    del given["t_s"]

    right, moved = (
        checks._Judgement(x, 0.1).likeness for x in (given, checks._moved(columns, by)(given))
    )

    assert (abs(moved - right) < UNLIKE) == as_alike
    assert moved < right + UNLIKE


@pytest.mark.parametrize(("theta", "load"), [({}, 2.0), ({"theta": 30.0}, 4.0 / 3.0**0.5)])
def test_without_a_velocity_the_load_factor_is_that_which_carries_the_weight(theta, load):
    """At 60 deg of roll the lift is twice the weight, and more where its axis is pitched."""
    angles = {"phi": 60.0, **theta}
    given = {name: np.full(50, np.radians(angle)) for name, angle in angles.items()}

    lift = relations._lift(relations.Motion({**given, "V_a": np.full(50, 25.0)}, 0.1))

    assert lift == pytest.approx(np.full(50, load))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_load_factor_of_a_path_is_that_of_its_coordinated_turn(side):
    """The tangent of roll is V times the rate over g, here of 25 m/s and 0.2 rad/s, no heading."""
    chi, phi = 0.2 * side * np.arange(100) * 0.01, side * math.atan(25.0 * 0.2 / G)
    given = {"v_north": 25.0 * np.cos(chi), "v_east": 25.0 * np.sin(chi), "v_down": 0.0 * chi}
    motion = relations.Motion({**given, "phi": np.full(100, phi)}, 0.01)

    lift = relations._lift(motion)

    assert lift[1:-1] == pytest.approx(np.full(98, 1.0 / math.cos(phi)), rel=1e-4)


@pytest.fixture(scope="module")
def agreeing():
    """Columns at 10 Hz of a made-up flight in wind that obeys the laws of motion."""
    wind = np.array([7.0, -6.5, 0.0])
    fine = outer_loop(60.0, wind=wind, seed=2)
    over = np.column_stack([fine[f"v_{axis}"] for axis in ("north", "east", "down")])
    force = np.gradient(over, STEP, axis=0) - [0.0, 0.0, G]
    body = np.einsum("nij,ni->nj", axes_of(fine["phi"], fine["theta"], fine["psi"]), force)
    fine |= {
        "f_x": body[:, 0], "f_y": body[:, 1], "down": -fine["h"],
        "V_g": np.hypot(over[:, 0], over[:, 1]), "chi": np.arctan2(over[:, 1], over[:, 0]),
        "wind_north": 0.0 * over[:, 0] + wind[0], "wind_east": 0.0 * over[:, 0] + wind[1],
        "height_err": 500.0 - fine["h"], "theta_cmd": fine["theta"],
    }  # fmt: skip
    return {name: column[::10].copy() for name, column in fine.items() if name != "t_s"}


def right(name, others):
    """Ratio, its tolerance and the delay (s) of a relation of a flight without errors."""
    delay = {"phi_cmd": -0.25, "n_z_cmd": -0.2}.get(name, 0.0)  # of lags of 4 and 5 rad/s
    # Nose and path, roll and its command are alike, but not the same.
    loose = name in ("p", "psi", "theta", "V_err", "phi_cmd") or others in (
        "the load factor",
        "the wind that nose and course show",
    )
    return 1.0, 0.15 if loose else 0.01, 0.0 if others == "path and roll" else delay


@pytest.mark.parametrize("k", range(len(relations.RELATIONS)))
def test_every_relation_holds_in_a_flight_that_obeys_the_laws_of_motion(agreeing, k):
    relation = relations.RELATIONS[k]

    match = checks._match(relation, relations.Motion(agreeing, 0.1))

    if relation.name == "f_y":  # no side force acts
        assert match.why == "the flight shows too little of path and attitude"
        return
    ratio, tolerance, delay = right(relation.name, relation.others)
    assert match.status == "agrees"
    assert match.ratio == pytest.approx(ratio, abs=tolerance)
    slack = 0.3 if relation.name == "psi" else 0.06  # a nose leads its path, and is not it
    assert match.lag == pytest.approx(delay, abs=slack)
    assert relation.name in match.used


def test_every_column_of_a_right_log_is_said_to_agree(agreeing):
    verdicts = checks.judged(agreeing, 0.1)

    agree, rest = verdicts.notes
    assert (verdicts.wrong, verdicts.columns) == ([], set())
    assert rest == "f_y cannot be checked: the flight shows too little of path and attitude."
    for said in (
        "p, q and r with the changes of attitude;",
        "v_north, v_east, north, east, V_g and chi with the path;",
        "v_down, h, down and height_err with the vertical speed;",
        "wind_north and wind_east with the wind that speeds and nose show;",
        "n_z and n_z_cmd with path and roll;",
    ):
        assert said in agree
    assert {*re.findall(r"\w+", agree)} >= {*agreeing} - {"f_y"}


def late(seconds):
    """A column at 10 Hz that comes so much later."""
    return lambda x: np.interp(np.arange(len(x)) - 10.0 * seconds, np.arange(len(x)), x)


@pytest.mark.parametrize(
    ("there", "name", "change", "says"),
    [
        (
            "V_a h v_down", "h", lambda x: x / 0.3048,
            "the slope of h is 3.28 times the value from the vertical speed: "
            "a factor of 0.3048 would do (ft read as m)",
        ),
        (
            "V_a h v_down", "v_down", lambda x: x / 0.514444,
            "the slope of h is 0.514 times the value from the vertical speed: "
            "a factor of 0.5144 would do (kn read as m/s) to v_down",
        ),
        (
            "V_a h v_down", "h", late(3.0),
            "the slope of h comes 3.0 s after the vertical speed: a shift by -3.0 s would do",
        ),
        (
            "V_a h v_down", "h", late(-3.0),
            "the slope of h comes 3.0 s before the vertical speed: a shift by +3.0 s would do",
        ),
        (
            "V_a h v_down", "h", lambda x: 0.0 * x,
            "the slope of h does not change with the vertical speed (correlation 0.00): "
            "h or v_down is something else, and no factor, shift or exchange mends it",
        ),
        (
            "v_north v_east V_g", "V_g", lambda x: 3.6 * x,
            "V_g is 3.6 times the value from the velocities: "
            "a factor of 0.2778 would do (km/h read as m/s)",
        ),
        (
            "v_north v_east chi", "chi", lambda x: x - np.radians(20.0),
            "chi is -20.0 deg off that of the velocities all along: magnetic, or axes that are "
            "turned; a change by +20.0 deg would do",
        ),
        (
            "V_a height_err v_down", "height_err", lambda x: -x,
            "height_err is -0.999 times the value from the vertical speed: a factor of -1 would "
            "do (its sign is turned)",
        ),
    ],
)  # fmt: skip
def test_one_wrong_column_of_a_few_is_said_with_its_cure(agreeing, there, name, change, says):
    given = {x: agreeing[x] for x in ("phi", *there.split())}

    wrong = checks.judged(given | {name: change(given[name])}, 0.1)

    assert wrong.wrong == [says]
    assert name in wrong.columns


PATH = "V_a v_north v_east north east"
COMMANDS = "V_a v_north v_east v_down n_z phi_cmd n_z_cmd"
SWING = np.sin(0.6 * np.arange(600.0) * np.linspace(0.1, 0.5, 600))
NO_CURE = "is something else, and no factor, shift or exchange mends it"
"""What is said of a column whose values are others."""


@pytest.mark.parametrize(
    ("there", "change", "says", "columns"),
    [
        (
            "theta psi p q r", lambda x: {"q": x["r"], "r": x["q"]},
            "q is unlike the changes of attitude .*: q and r exchanged would do", "q r",
        ),
        (
            PATH, lambda x: {"v_north": x["v_east"], "v_east": x["v_north"]},
            "the velocity is unlike the path .*: v_east and v_north exchanged would do",
            "v_east v_north",
        ),
        (
            PATH, checks._rotated(0.4),
            r"chi is \+22.9 deg off that of the path .*: a turn of the velocity by -22.9 deg",
            "v_north v_east",
        ),
        (
            f"{PATH} chi", checks._rotated(-0.4),
            r"chi is -22.9 deg off that of the path .*: a turn of the velocity by \+22.9 deg",
            "v_north v_east",
        ),
        ("theta psi p q r", lambda _: {"p": 0.3 * SWING}, f"p is unlike .*: p {NO_CURE}", "p"),
        (COMMANDS, lambda x: {"n_z": x["n_z"] - 1.0}, r"n_z is 0.\d+ .*: a change by \+1", "n_z"),
        (COMMANDS, lambda _: {"phi_cmd": SWING}, f"phi_cmd is unlike .*: phi_cmd {NO_CURE}", ""),
    ],
)  # fmt: skip
def test_what_is_wrong_in_several_columns_is_one_sentence_about_them(
    agreeing, there, change, says, columns
):
    """A command that nothing confirms may be another law's, and is a note."""
    given = {x: agreeing[x] for x in ("phi", *there.split())}

    verdicts = checks.judged(given | change(given), 0.1)

    (said,) = verdicts.wrong if columns else verdicts.notes[:1]
    assert re.match(says, said)
    assert verdicts.columns == {*(columns or "phi_cmd").split()}
    agree = next(line for line in verdicts.notes if line.startswith("These agree"))
    assert not {*re.findall(r"\w+", agree)} & verdicts.columns
    assert (verdicts.wrong == []) == (columns == "")


def test_an_airspeed_agrees_by_its_ratio_or_is_the_ground_speed_or_cannot_be_checked(agreeing):
    def said(there, **changed):
        verdicts = checks.judged({x: agreeing[x] for x in ("phi", *there.split())} | changed, 0.1)
        assert (verdicts.wrong, verdicts.columns) == ([], set())
        return verdicts.notes

    (agree,) = said("psi v_north v_east", V_a=1.2 * agreeing["V_a"])
    assert "V_a (1.20 times it) with the ground speed" in agree
    (agree,) = said("psi v_north v_east V_a")
    assert "V_a with the ground speed" in agree
    _, copied = said("V_g chi", V_a=agreeing["V_g"])
    assert copied.startswith("V_a cannot be checked: it is the ground speed")
    agree, *rest = said("theta V_a V_err")
    assert agree == "These agree: V_err with the changes of speed."
    assert rest == [
        "phi and V_a cannot be checked: the log has no v_north and v_east.",
        "theta cannot be checked: the log has no gamma.",
    ]


@pytest.mark.parametrize("seconds", [2.03, -2.03])
def test_a_delay_that_is_possible_to_half_a_sample_is_not_what_is_said_of_a_wrong_unit(
    agreeing, seconds
):
    """Delays of 2 s are possible, and told to 0.1 s."""
    given = {x: agreeing[x] for x in ("phi", "V_a", "v_down")}

    wrong = checks.judged(given | {"h": late(seconds)(agreeing["h"] / 0.3048)}, 0.1).wrong

    assert wrong == [
        "the slope of h is 3.28 times the value from the vertical speed: "
        "a factor of 0.3048 would do (ft read as m)"
    ]


def test_a_large_error_of_height_in_feet_is_a_note_and_rates_of_zero_are_not_measured(agreeing):
    given = {x: agreeing[x] for x in ("phi", "V_a", "height_err", "v_down")}
    changed = {"height_err": given["height_err"] / 0.3048, "q": 0.0 * given["phi"]}
    calm = {"r": np.maximum(0.0, given["phi"]), "wind_north": 0.0 * given["phi"]}

    verdicts = checks.judged(given | changed | calm, 0.1)

    assert verdicts.wrong == []
    assert verdicts.notes[:2] == [
        "q is 0 throughout: it is taken as not measured",
        "height_err is 3.28 times the value from the vertical speed: a factor of 0.3048 would do "
        "(ft read as m)",
    ]


@pytest.mark.parametrize(("factor", "said"), [(1.1, True), (1.05, False), (0.9, True)])
def test_a_clock_is_wrong_where_all_rates_are_off_by_one_factor(agreeing, factor, said):
    names = [
        *("phi", "theta", "psi", "p", "q", "r"),
        *("v_north", "v_east", "v_down", "north", "east", "h"),
    ]

    verdicts = checks.judged({x: agreeing[x] for x in names}, 0.1 * factor)

    numbers = r"all ([\d.]+) times the changes by this clock: a factor of ([\d.]+) would do"
    found = [re.search(f"^t: rates and speeds are {numbers}", line) for line in verdicts.wrong]
    times = [[float(x) for x in match.groups()] for match in found]
    assert times == [[pytest.approx(x, rel=5e-3) for x in (factor, 1.0 / factor)]] * said
    assert verdicts.columns == ({"t"} if said else set())


def judgement_of(**matches):
    """A judgement of no columns but `phi`, with one match for each relation of some columns."""
    judgement = checks._Judgement({"phi": np.zeros(30)}, 0.1)
    judgement.matches = [
        checks.Match(**matches[relation.name]) if relation.name in matches else match
        for relation, match in zip(relations.RELATIONS, judgement.matches, strict=True)
    ]
    return judgement


@pytest.mark.parametrize(
    ("ratios", "factor"),
    [
        ({"p": 1.1, "q": 1.1, "r": 1.1}, 1.1),
        ({"p": 1.1, "q": 1.1, "h": 1.0 / 1.1, "down": 1.0 / 1.1}, 1.1),  # heights have no rate
        ({"p": 0.8, "q": 0.8, "r": 0.8, "v_north": 1.1}, 0.8),
        ({"p": 1.07, "q": 1.07, "r": 1.07}, 1.07),
        ({"p": 1.1, "q": 1.1, "phi": 1.1}, None),  # too few of motion
        ({"p": 1.1, "q": 1.1, "chi": 1.1, "V_g": 1.1}, None),  # of velocities alone
        ({"p": 1.2, "q": 1.2, "r": 1.2, "v_north": 0.7, "h": 1.0 / 0.7}, None),  # not all alike
        ({"p": 1.05, "q": 1.05, "r": 1.05}, None),  # near 1
    ],
)
def test_a_clock_is_that_of_three_quarters_of_the_rates(ratios, factor):
    matches = {name: {"status": "agrees", "ratio": x, "alike": 0.9} for name, x in ratios.items()}
    said = checks.Verdicts([], [], set())

    checks._say_clock(said, judgement_of(**matches))

    assert [line.partition(" would")[0].split("a factor of ")[1] for line in said.wrong] == (
        [f"{1.0 / factor:.3g}"] if factor else []
    )
    unlike = {name: match | {"alike": 0.8} for name, match in matches.items()}
    said = checks.Verdicts([], [], set())
    checks._say_clock(said, judgement_of(**unlike))
    assert said.columns == set()


def test_a_judgement_counts_what_breaks_and_what_holds_with_its_likeness():
    agrees = {"status": "agrees", "alike": -0.9, "at_once": 0.7}
    matches = {"p": agrees, "phi_cmd": agrees | {"at_once": 0.1}, "f_x": {"status": "contradicts"}}
    judgement = judgement_of(**matches, q={"status": "unlike"}, r={"status": "cannot tell"})

    assert [relations.RELATIONS[k].name for k in judgement.broken] == ["q", "f_x"]
    assert judgement.rank == (2, -2)
    assert judgement.confirmed == {"p", "phi_cmd"}
    assert judgement.likeness == pytest.approx(0.7 + 0.9)  # a command has its delay


@pytest.mark.parametrize(
    ("name", "turned", "stated", "changes"),
    [
        ("chi", 0.5, True, [-0.5]),
        ("psi", -0.5, False, [-0.5]),
        ("chi", 0.06, True, []),
        ("v_north", 0.5, True, []),
        ("n_z", 0.5, True, [1.0, math.cos(0.4) * math.cos(0.3)]),
        ("f_z", 0.5, False, [-9.80665, -9.80665 * math.cos(0.4) * math.cos(0.3)]),
    ],
)
def test_headings_may_lack_an_angle_and_load_factors_gravity(name, turned, stated, changes):
    given = {"phi": np.full(3, 0.4), "theta": np.full(3, 0.3), name: np.full(3, 2.0)}
    match = checks.Match("contradicts", turned=turned)

    cures = [*checks._changed(name, match, stated=stated)]

    assert [cure.apply(given)[name][1] - 2.0 for cure in cures] == pytest.approx(changes)
    assert all(cure.columns == (name,) for cure in cures)


@pytest.mark.parametrize(
    ("others", "turned", "by"), [("the path", -0.5, 0.5), ("the velocities", 0.5, 0.5)]
)
def test_a_velocity_is_turned_against_its_angle_to_the_path_and_with_that_of_a_course(
    others, turned, by
):
    given = {"phi": np.zeros(30), "v_north": np.full(30, 20.0), "v_east": np.full(30, 5.0)}
    (relation,) = (
        x for x in relations.RELATIONS if x.others == others and x.name in ("v_north", "chi")
    )
    used = frozenset({"v_north", "v_east"})
    match = checks.Match("contradicts", used, ratio=1.0, lag=0.0, turned=turned)

    cures = checks._cures(relations.Motion(given, 0.1), relation, match)

    (turn,) = (cure.apply(given) for cure in cures if "a turn of the velocity" in cure.words)
    velocity = complex(turn["v_north"][0], turn["v_east"][0])
    assert velocity == pytest.approx((20.0 + 5.0j) * np.exp(1j * by), rel=1e-12)


def noise(seed, n=1200):
    """Smooth noise of mean 0 and rms 1 at 10 Hz, shape (n, 1)."""
    rows = np.convolve(np.random.default_rng(seed).standard_normal(n + 40), np.hanning(41), "valid")
    return ((rows - rows.mean()) / rows.std())[:n, None]


A, B = noise(1), noise(2)
B -= A * np.mean(A * B) / np.mean(A * A)


def relation_of(about="changes", rests_on="motion", **options):
    return relations.Relation(
        "x", (), lambda _: "", "the others", (0.7, 1.4), 0.3, rests_on, about, **options
    )


def turned(by):
    """A velocity that turns, and the same turned clockwise."""
    angle = 0.02 * np.arange(1200.0)
    return tuple(20.0 * np.column_stack([np.cos(x), np.sin(x)]) for x in (angle + by, angle))


@pytest.mark.parametrize(
    ("relation", "column", "other", "expected"),
    [
        (relation_of(), A, A, ("agrees", 1.0, 0.0)),
        (relation_of(), 1.39 * A, A + 5.0, ("agrees", 1.39, 0.0)),
        (relation_of(), 1.41 * A, A, ("contradicts", 1.41, 0.0)),
        (relation_of(), -A, A, ("contradicts", -1.0, 0.0)),
        (relation_of(), np.roll(A, 8), A, ("agrees", 1.0, 0.8)),
        (relation_of(), np.roll(A, 25), A, ("contradicts", 1.0, 2.5)),
        (relation_of(), np.roll(A, -25), A, ("contradicts", 1.0, -2.5)),
        (relation_of(lag=(-3.0, 3.0)), np.roll(A, 25), A, ("agrees", 1.0, 2.5)),
        (relation_of(), 0.5 * A + B, A, ("unlike", 1.118, 0.0)),
        (relation_of(rests_on="loop"), 0.5 * A + B, A, ("cannot tell", 1.118, 0.0)),
        (relation_of(rests_on="flight"), 1.2 * A + B, A, ("cannot tell", 1.562, 0.0)),
        (relation_of(rests_on="flight"), 2.0 * A + B, A, ("contradicts", 2.236, 0.0)),
        (relation_of(), 0.0 * A, A, ("unlike", 0.0, math.nan)),
        (relation_of(), A, 0.29 * A, ("cannot tell", math.nan, math.nan)),
        (relation_of("values"), 2.0 * A + 20.0, A + 10.0, ("contradicts", 2.0, 0.0)),
        (relation_of("values"), A + 10.0, B + 10.0, ("agrees", 1.0, 0.0)),
        (relation_of("values", turned=0.2), *turned(0.19), ("agrees", 1.0, 0.0)),
        (relation_of("values", turned=0.2), *turned(-0.21), ("contradicts", 1.0, 0.0)),
    ],
)
def test_two_columns_are_judged_by_likeness_time_and_ratio(relation, column, other, expected):
    match = checks._judged(relation, column, other, 0.1)

    status, ratio, lag = expected
    assert match.status == status
    assert match.ratio == pytest.approx(ratio, rel=0.02, nan_ok=True)
    if status != "unlike" and column.shape[1] == 1 and relation.about == "changes":
        assert match.lag == pytest.approx(lag, abs=0.15, nan_ok=True)


def test_a_vector_is_turned_by_the_angle_to_the_others():
    for by in (0.3, -0.3):
        match = checks._judged(relation_of("values", turned=0.2), *turned(by), 0.1)
        assert match.turned == pytest.approx(by, abs=1e-9)


@pytest.mark.parametrize("centred", [True, False])
def test_correlations_at_all_delays_are_those_of_the_samples_that_both_have(centred):
    rng = np.random.default_rng(3)
    column, other = (5.0 + rng.standard_normal((200, 2)) for _ in range(2))
    column[40:60], other[100:110] = np.nan, np.nan

    lags, alike, ratios = checks._over_lags(column, other, 0.1, centred=centred)

    assert lags == pytest.approx(0.1 * np.arange(-50, 51))  # 5 s
    # Axes are centred by their means of all samples and by those of both.
    for k, shift in ((0, -50), (50, 0), (57, 7), (100, 50)):
        a = column[max(shift, 0) : 200 + min(shift, 0)]
        b = other[max(-shift, 0) : 200 - max(shift, 0)]
        both = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
        a, b = a[both], b[both]
        if centred:
            a, b = a - a.mean(axis=0), b - b.mean(axis=0)
        ab, aa, bb = (np.sum(x) for x in (a * b, a * a, b * b))
        assert alike[k] == pytest.approx(ab / math.sqrt(aa * bb), abs=1e-9)
        ratio = math.copysign(math.sqrt(aa / bb), ab) if centred else ab / bb
        assert ratios[k] == pytest.approx(ratio, rel=1e-9)


def test_delays_with_less_than_ten_seconds_of_both_columns_do_not_count():
    column = np.full((300, 1), np.nan)
    column[:120] = A[:120]

    lags, alike, _ = checks._over_lags(column, A[:300], 0.1, centred=True)

    far = lags > 2.0 + 1e-9  # of 120 samples fewer than 100 are left
    assert (alike[far] == 0.0).all()
    assert (alike[~far] != 0.0).all()


@pytest.mark.parametrize(
    ("score", "k", "beyond"),
    [
        ([1.0 - (x - 0.3) ** 2 for x in (-1, 0, 1)], 1, 0.3),
        ([1.0 - (x + 0.2) ** 2 for x in (-1, 0, 1)], 1, -0.2),
        ([1.0, 1.1, 1.5], 1, 0.0),  # no maximum
        ([1.0, 0.9, 0.8], 0, 0.0),
        ([0.8, 0.9, 1.0], 2, 0.0),
        ([0.0, 1.0, 1.9], 1, 0.5),
    ],
)
def test_a_maximum_lies_at_the_vertex_of_the_parabola_through_three_samples(score, k, beyond):
    assert checks._beyond(np.array(score), k) == pytest.approx(beyond)


@pytest.mark.parametrize(
    ("kind", "ratio", "factor", "words"),
    [
        ("speed", 1.0 / 0.514444, 0.514444, "kn read as m/s"),
        ("speed", -0.514444, 1.0 / 0.514444, "m/s read as kn"),
        ("angle", 50.0, constants.degree, "deg read as rad"),  # 14 % from 57.3
        ("angle", 48.0, 1.0 / 48.0, ""),
        ("load", 9.80665, 1.0 / 9.80665, "m/s2 read as g"),
        ("load", 32.174, constants.foot / 9.80665, "ft/s2 read as g"),
        ("force", 0.102, 9.80665, "g read as m/s2"),
        ("length", 0.3048, 1.0 / 0.3048, "m read as ft"),
        ("place", 2.0, 0.5, ""),
    ],
)
def test_a_ratio_near_a_known_mistake_has_its_factor_and_another_its_own(
    kind, ratio, factor, words
):
    found, said = checks._factor(kind, ratio)

    assert found == pytest.approx(factor, rel=1e-5)
    assert said == words


def test_cures_scale_shift_exchange_turn_and_remove_columns():
    x, y = np.arange(5.0), np.array([0.0, 3.0, -3.0, 1.0, 2.0])
    given = {"h": x, "psi": y, "n_z": x, "f_z": x, "phi": y, "theta": 0.1 * y}

    def of(change, name="h"):
        return change(given)[name].tolist()

    nan = pytest.approx(math.nan, nan_ok=True)
    assert of(checks._scaled(["h"], 2.0)) == [0.0, 2.0, 4.0, 6.0, 8.0]
    assert of(checks._moved(["h"], 2)) == [nan, nan, 0.0, 1.0, 2.0]
    assert of(checks._moved(["h"], -1)) == [1.0, 2.0, 3.0, 4.0, nan]
    assert of(checks._moved(["h"], 0)) == x.tolist()
    exchanged = checks._exchanged("h", "psi")
    assert (of(exchanged), of(exchanged, "psi")) == (y.tolist(), x.tolist())
    assert np.exp(1j * np.array(of(checks._turned("psi", 1.0), "psi"))) == pytest.approx(
        np.exp(1j * (y + 1.0))
    )
    assert np.abs(of(checks._turned("psi", 1.0), "psi")).max() <= math.pi
    up = np.cos(y) * np.cos(0.1 * y)
    for along, size in ((False, 1.0), (True, up)):
        gravity = (checks._with_gravity(name, along=along) for name in ("n_z", "f_z"))
        n_z, f_z = (of(change, name) for change, name in zip(gravity, ("n_z", "f_z"), strict=True))
        assert n_z == pytest.approx(x + size)
        assert f_z == pytest.approx(x - 9.80665 * size)
    assert "h" not in checks._without("h")(given)
    assert of(checks._without("phi"), "phi") == [nan] * 5


@pytest.mark.parametrize(("dt", "step"), [(0.1, 1), (0.02, 5), (0.04, 2), (0.2, 1)])
def test_columns_are_compared_at_means_over_a_tenth_of_a_second(dt, step):
    phi = np.where(np.arange(23) % 2, 3.1, -3.1)
    given = {"h": np.arange(23.0), "phi": phi}

    means, at = checks.coarse(given, dt)

    n = 23 // step
    assert at == pytest.approx(step * dt)
    assert means["h"] == pytest.approx(step * np.arange(n) + 0.5 * (step - 1))
    assert np.cos(means["phi"]).max() < -0.99  # between 3.1 and -3.1 rad, not at 0


def test_a_long_log_is_compared_at_20_000_samples():
    given = {"phi": np.zeros(60_001)}

    means, at = checks.coarse(given, 0.1)

    assert (len(means["phi"]), at) == (15_000, pytest.approx(0.4))


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("phi", [0.0, 3.17] * 9, ""),
        ("phi", [0.0, 12.0] * 9, "phi goes up to 12 rad: a factor of 0.01745 would do"),
        ("phi", [12.0], ""),
        ("phi", [*[1.0] * 500, 12.0], ""),  # one in 500 is noise
        ("theta", [0.0, 1.6] * 9, "theta goes up to 1.6 rad"),
        ("theta", [0.0, 1.57] * 9, ""),
        ("lat", [47.0] * 9, "lat goes up to 47 rad"),
        ("chi", np.linspace(0.0, 59.0, 99), ""),  # nine turns
        ("chi", np.linspace(300.0, 359.0, 99), "chi goes up to 358 rad"),
        ("chi", [*[1.0] * 9, *[230.0] * 9], "chi goes up to 230 rad"),
        ("psi", [math.nan, 6.3, math.nan, 6.3], ""),
        ("h", [500.0] * 9, ""),
    ],
)  # fmt: skip
def test_angles_beyond_their_range_look_like_degrees(name, values, says):
    said = checks.degrees_as_radians({name: (np.arange(len(values)), np.array(values, float))})

    assert list(said) == ([name] if says else [])
    assert all(line.startswith(says) and "(deg read as rad)" in line for line in said.values())


def test_signals_of_a_log_begin_at_its_first_place_and_have_their_errors():
    t = 0.1 * np.arange(50)
    raw = {"phi": 0.0 * t, "east": 0.0 * t + 7.0, "h": 300.0 + t, "chi_ref": 0.0 * t - 3.0}
    raw["north"] = np.where(t < 0.15, np.nan, 100.0 + 20.0 * t)
    raw |= {"v_north": -20.0 + 0.0 * t, "v_east": 20.0 + 0.0 * t}

    values, _ = checks.signals_of(raw, t)

    assert values["north"][2:] == pytest.approx(20.0 * (t[2:] - 0.2))
    assert values["east"] == pytest.approx(0.0 * t)
    assert values["down"] == pytest.approx(-t)
    # from a course of 135 deg to one of -3 rad
    assert values["chi_err"] == pytest.approx(np.full(50, 1.25 * math.pi - 3.0))


@pytest.mark.parametrize(
    ("signals", "vehicle", "says"),
    [
        ({"V_g": [4.9], "V_a": [9.0], "phi_cmd": [0.0]}, "", "a speed of at most 4.9 m/s"),
        ({"V_g": [5.0], "V_a": [1.0]}, "", ""),
        ({"V_a": [math.nan, 4.0]}, "", "a speed of at most 4 m/s"),
        ({"V_g": [math.nan], "V_a": [9.0]}, "", "a speed of at most 0 m/s"),
        ({"V_g": [20.0], "V_a": [20.0]}, "type 1 of PX4", "a vehicle without wings"),
        ({"V_g": [20.0], "V_a": [20.0]}, "type 1", ""),
        ({"V_g": [20.0]}, "type 13", "(type 13), no airspeed, no roll commands."),
        ({"phi": [0.0]}, "", "got no airspeed, no roll commands, no ground speed."),
        ({"phi_cmd": [0.0]}, "", ""),
    ],
)
def test_a_log_is_of_an_aeroplane_that_flew(signals, vehicle, says):
    signals = {name: np.array(values) for name, values in signals.items()}
    if not says:
        checks.check_flight("a log", signals, vehicle)
        return
    with pytest.raises(ft.RecordingError, match=re.escape(says)):
        checks.check_flight("a log", signals, vehicle)


@pytest.mark.parametrize(("n", "told"), [(99, False), (100, True)])
def test_columns_are_judged_from_ten_seconds_on(n, told):
    match = checks._judged(relation_of(), 3.0 * A[:n], 3.0 * A[:n], 0.1)

    assert match.why == ("" if told else "it and the others last less than 10 s")


RESPONSES = (
    *("theta", "V_err", "height_err", "p", "q", "r"),
    *("f_x", "n_z", "n_z_cmd", "phi_cmd", "h", "down"),
)


@pytest.mark.parametrize("name", RESPONSES)
def test_the_ratio_of_a_column_grows_with_it_and_the_value_from_others_does_not(agreeing, name):
    larger = agreeing | {name: 1.2 * agreeing[name]}

    for relation in (x for x in relations.RELATIONS if x.name == name and x.others != "down"):
        before, after = (
            checks._match(relation, relations.Motion(x, 0.1)) for x in (agreeing, larger)
        )
        assert after.ratio == pytest.approx(1.2 * before.ratio, rel=1e-6)
        assert after.alike == pytest.approx(before.alike, abs=1e-6)


def test_logs_whose_columns_contradict_each_other_are_refused():
    right, wrong = (
        made_up_run({"phi": [0.0]}, scenario={"log": {"wrong": said}})
        for said in ([], ["p is off"])
    )

    checks.refuse_wrong(right, made_up_run({"phi": [0.0]}))
    with pytest.raises(ft.InputError, match=r"columns of the log must agree: p is off\. Where"):
        checks.refuse_wrong(right, wrong)


def test_a_relation_that_does_not_hold_has_the_changes_that_may_mend_it():
    """A roll rate may be in degrees, of the other sign, late, or one of the two other rates."""
    given = {name: np.arange(200.0) for name in ("phi", *"pqr")}
    motion, relation = relations.Motion(given, 0.1), relations.RELATIONS[0]

    def cures(used="p", **match):
        found = checks.Match("contradicts", frozenset(used), alike=0.9, **match)
        return {(cure.columns, cure.words): cure for cure in checks._cures(motion, relation, found)}

    turned, all_three = "a factor of -1 would do (its sign is turned)", ("p", "q", "r")
    unit = "a factor of -0.01745 would do (deg read as rad and its sign turned)"
    exchanges = {(pair, f"p and {pair[1]} exchanged would do") for pair in (("p", "q"), ("p", "r"))}
    found = cures(ratio=-57.3, lag=0.0)
    assert {*found} == exchanges | {
        (("p",), ""), (("p",), turned), (("p",), unit),
        (all_three, f"{turned} to p, q and r"), (all_three, f"{unit} to p, q and r"),
    }  # fmt: skip
    for (columns, words), factor in (
        ((("p",), turned), -1.0), ((all_three, f"{unit} to p, q and r"), -math.pi / 180.0),
    ):  # fmt: skip
        after = found[columns, words].apply(given)
        assert after["phi"] is given["phi"]
        assert all(after[name] == pytest.approx(factor * given[name]) for name in columns)
    assert found[("p",), turned].cost < found[all_three, f"{turned} to p, q and r"].cost
    assert found[("p",), unit].cost < found[("p",), ""].cost

    found = cures(ratio=1.1, lag=2.0, turned=0.5)  # 10 % is no mistake of a unit
    late = "a shift by -2.0 s"
    assert {*found} == exchanges | {
        (("p",), ""), (("p",), f"{late} would do"), (all_three, f"{late} of p, q and r would do"),
    }  # fmt: skip
    after = found[("p",), f"{late} would do"].apply(given)
    assert after["p"][:180] == pytest.approx(given["p"][20:])
    # what is wrong may be the other side, whose factor and shift are the opposite
    found = cures(["phi"], ratio=57.3, lag=2.0)
    words = {words for columns, words in found if columns == ("phi",)}
    assert words == {
        "",
        "a factor of 57.3 would do (rad read as deg) to phi",
        "a shift by +2.0 s of phi would do",
    }
    assert {words for _, words in cures(["phi"], ratio=5.0, lag=0.0)} == {""}


@pytest.mark.parametrize(
    ("given", "sources"),
    [
        ("V_g chi v_down", {"v_north": "V_g chi", "chi": "V_g chi", "gamma": "V_g chi v_down"}),
        (
            "v_north v_east",
            {"V_g": "v_north v_east", "gamma": "v_north v_east", "north": "v_north"},
        ),
        ("v_north v_east h", {"gamma": "v_north v_east h", "down": "h", "v_down": "h", "h": "h"}),
        ("lat lon", {"north": "lat lon", "v_east": "lat lon", "down": "", "chi": "lat lon"}),
        ("north east", {"v_north": "north", "north": "north", "V_g": "north east"}),
        ("f_z wind_speed wind_from", {"n_z": "f_z", "wind_east": "wind_speed wind_from"}),
        ("V_g", {"v_north": "", "V_g": "", "phi": "phi"}),
    ],
)
def test_a_signal_is_made_from_the_columns_that_a_log_has(given, sources):
    motion = relations.Motion({name: np.ones(30) for name in ("phi", *given.split())}, 0.1)

    for name, expected in sources.items():
        assert motion.sources(name) == {*expected.split()}, name
    assert ("v_north" in motion) == (given != "V_g" and not given.startswith("f_z"))


def test_signals_are_completed_by_their_definitions():
    t = 0.1 * np.arange(60)
    given = {"lat": 0.8 + 1e-6 * t, "lon": 0.1 + 2e-6 * t, "h": 5.0 * t, "phi": 0.3 + 0.0 * t}
    given |= {"wind_speed": 4.0 + 0.0 * t, "wind_from": 0.5 + 0.0 * t, "f_z": -12.0 + 0.0 * t}

    values, notes = relations.completed(given, 0.1)

    # radii of the meridian and of the parallel on the ellipsoid WGS 84
    a, e2, sine = 6_378_137.0, 6.69437999014e-3, math.sin(0.8) ** 2
    meridian = a * (1.0 - e2) / (1.0 - e2 * sine) ** 1.5
    parallel = a / math.sqrt(1.0 - e2 * sine) * math.cos(0.8)
    assert values["north"] == pytest.approx(meridian * 1e-6 * t, rel=1e-6)
    assert values["east"] == pytest.approx(parallel * 2e-6 * t, rel=1e-6)
    assert values["v_east"] == pytest.approx(np.full(60, parallel * 2e-6), rel=1e-6)
    assert values["v_down"] == pytest.approx(np.full(60, -5.0))
    V_g = math.hypot(meridian, 2.0 * parallel) * 1e-6
    assert values["V_g"] == pytest.approx(np.full(60, V_g), rel=1e-6)
    chi = math.atan2(2.0 * parallel, meridian)
    assert values["chi"] == pytest.approx(np.full(60, chi), rel=1e-6)
    assert values["gamma"] == pytest.approx(np.full(60, math.atan2(5.0, V_g)), rel=1e-6)
    wind = values["wind_north"][0], values["wind_east"][0], values["wind_down"][0]
    assert wind == pytest.approx((-4.0 * math.cos(0.5), -4.0 * math.sin(0.5), 0.0))
    assert values["n_z"] == pytest.approx(np.full(60, 12.0 / 9.80665))
    assert notes == [f"v_{x} is the slope of {x}" for x in ("north", "east", "down")]


def test_places_are_integrals_of_velocities_and_a_sensor_turned_over_is_turned_back():
    t = 0.1 * np.arange(60)
    given = {"phi": 0.0 * t, "V_g": 9.0 + 0.0 * t, "chi": 0.5 + 0.0 * t, "f_z": 9.80665 + 0.0 * t}

    values, notes = relations.completed(given, 0.1)

    assert values["east"][-1] == pytest.approx(60 * 0.1 * 9.0 * math.sin(0.5))
    assert values["n_z"] == pytest.approx(np.ones(60))
    assert notes[:2] == [f"{x} is the integral of v_{x}" for x in ("north", "east")]
    assert notes[2].startswith("the load factor is of a sensor after its sign was turned")


def test_far_from_the_poles_alone_places_are_on_a_plane():
    for lat, lon, known in ((88.0, 0.0, True), (89.5, 0.0, False), (10.0, 361.0, False)):
        north, _ = relations.plane(np.radians([lat, lat]), np.radians([lon, lon]))
        assert np.isfinite(north).all() == known


def climbing_turn(**more):
    """A helix at 20 m/s that climbs by 0.2 rad and turns right by 0.3 rad/s, at 10 Hz."""
    chi = 0.3 * 0.1 * np.arange(80)
    level = 20.0 * math.cos(0.2)
    over = {"v_north": level * np.cos(chi), "v_east": level * np.sin(chi)}
    down = {"v_down": 0.0 * chi - 20.0 * math.sin(0.2)}
    return over | down | {"phi": 0.0 * chi} | {name: x(chi) for name, x in more.items()}


# A slope over 0.2 s of a turn by 0.3 rad/s is too small by 0.015 %, as sin(0.03) is.
SLOPE = 2e-4


@pytest.mark.parametrize("nose", [None, (0.1, 0.05)])
def test_forces_of_a_turn_are_across_the_path_or_across_the_nose(nose):
    turn = climbing_turn()
    if nose is not None:  # beside the path and above the horizon
        turn = climbing_turn(psi=lambda chi: chi + nose[0], theta=lambda chi: nose[1] + 0.0 * chi)
    motion = relations.Motion(turn, 0.1)

    right, up = (side[1:-1] for side in motion.across)

    inwards, G_0 = 20.0 * math.cos(0.2) * 0.3, 9.80665
    beside, climb = nose or (0.0, 0.2)
    along = inwards * math.sin(beside)
    assert right == pytest.approx(inwards * math.cos(beside), rel=SLOPE)
    expected = G_0 * math.cos(climb) - along * math.sin(climb)
    assert up == pytest.approx(expected, rel=SLOPE)
    assert np.exp(1j * motion.heading) == pytest.approx(
        np.exp(1j * (0.03 * np.arange(80) + beside))
    )
    assert motion.turning("chi")[1:-1] == pytest.approx(0.3)
    assert np.isnan(motion.turning("chi")[[0, -1]]).all()


def test_a_path_without_a_climb_is_level_and_forces_on_a_steep_one_are_unknown():
    level = climbing_turn()
    del level["v_down"]
    steep = climbing_turn() | {"v_down": np.full(80, -60.0)}

    assert (relations.Motion(level, 0.1).velocity[:, 2] == 0.0).all()
    _, up = relations.Motion(level, 0.1).across
    assert up[1:-1] == pytest.approx(9.80665)
    assert np.isnan(
        np.array(relations.Motion(steep, 0.1).across)
    ).all()  # cos(72 deg) is below 0.35


@pytest.mark.parametrize("names", ["phi theta psi", "phi theta", "phi psi", "phi"])
def test_axes_of_the_body_are_those_of_its_angles_or_of_its_path(names):
    angles = {"phi": 0.4, "theta": 0.25, "psi": -1.1}
    given = climbing_turn() | {name: np.full(80, angles[name]) for name in names.split()}

    axes = relations.Motion(given, 0.1).axes

    pitch = given.get("theta", np.full(80, 0.2))
    yaw = given.get("psi", np.arctan2(given["v_east"], given["v_north"]))
    assert axes == pytest.approx(axes_of(given["phi"], pitch, yaw), abs=1e-12)
    alone = relations.Motion({"phi": given["phi"]}, 0.1).axes
    assert alone == pytest.approx(axes_of(given["phi"], 0.0 * yaw, 0.0 * yaw), abs=1e-12)


def test_a_vehicle_flies_above_5_mps_and_half_of_its_usual_speed():
    V_a = np.array([4.0, 6.0, 9.0, 10.1, 20.0, 20.0, 21.0, np.nan])
    slow = np.array([4.9, 5.1, 5.0, 6.0, 7.0, 8.0, 5.2, 5.3])

    def flying(**speeds):
        found = relations.Motion({"phi": np.zeros(8)} | speeds, 0.1).flying
        assert set(found[np.isfinite(found)]) <= {1.0}
        return np.isfinite(found).tolist()

    # the median above 5 m/s is (10.1 + 20) / 2 = 15.05
    assert flying(V_a=V_a) == [False, False, True, True, True, True, True, False]
    assert flying(V_a=slow) == [False, True, False, True, True, True, True, True]
    assert flying(V_a=V_a, V_g=slow) == flying(V_a=V_a)
    assert flying(V_g=V_a) == flying(V_a=V_a)
    assert flying() == [False] * 8


@pytest.mark.parametrize(("dt", "span"), [(0.1, 11), (0.2, 5), (0.02, 51), (3.0, 3)])
def test_means_are_over_a_second_and_slopes_between_those_of_others(dt, span):
    n = 4 * span + 9
    t = dt * np.arange(n)
    motion = relations.Motion({"phi": 0.0 * t}, dt)

    assert motion.span == span
    means = motion.smooth(t**2)
    pad = span // 2
    # of a parabola the mean is its middle and dt^2 (span^2 - 1) / 12
    assert means[pad:-pad] == pytest.approx(t[pad:-pad] ** 2 + dt**2 * (span**2 - 1) / 12.0)
    assert np.isnan(means[:pad]).all()
    assert np.isnan(means[-pad:]).all()
    gap = np.where(np.arange(n) == n // 2, np.nan, t)
    assert np.count_nonzero(np.isnan(motion.smooth(gap))) == 2 * pad + span
    slopes = motion.slow_rate(t**2)
    there = np.isfinite(slopes)
    assert np.flatnonzero(there)[0] == pad + span + 1  # means that share no sample
    assert slopes[there] == pytest.approx(2.0 * t[there])
    assert np.isnan(motion.smooth(t[:span])).all()
    assert motion.rate(t**2)[1:-1] == pytest.approx(2.0 * t[1:-1])
    assert (relations.median(gap), math.isnan(relations.median(gap[:0]))) == (
        pytest.approx(np.nanmedian(gap)), True,
    )  # fmt: skip
