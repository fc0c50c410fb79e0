"""Columns of a log against the laws of motion: each error is said with what mends it."""

import math
import re
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_columns import RIGHT, STEP, G, axes_of, outer_loop, sampled
from log_files import heavy_cessna
from scipy import constants as si

import flighttune as ft

FLIGHTS = {"still air": RIGHT["turns and climbs"], "Cessna": lambda: of_run(heavy_cessna(150.0))}
WIND = np.array([7.0, -6.5, 0.0])


def of_run(run):
    """Columns of a simulated flight; its velocity over ground is the slope of its path."""
    names = "phi theta psi p q r n_z V_a north east phi_cmd n_z_cmd h"
    columns = {name: run.signals[name].to_numpy() for name in names.split()}
    over = {"v_north": run.signals["north"], "v_east": run.signals["east"], "v_down": -columns["h"]}
    return {"t_s": run.t, **columns, **{x: np.gradient(y, run.t) for x, y in over.items()}}


@pytest.fixture(scope="module")
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


@pytest.mark.counts
@pytest.mark.parametrize("rate", [10, 25, 50])
@pytest.mark.parametrize("make", [*RIGHT.values(), FLIGHTS["Cessna"]], ids=[*RIGHT, "Cessna"])
def test_no_right_log_is_accused_at_any_rate(log_of, make, rate):
    assert log_of(make, rate)["wrong"] == []


def test_a_right_rate_is_not_accused_for_a_few_bad_seconds(log_of):
    """As between two kinds of flight: attitude is coarse, and the rate is large and unlike it."""
    rate, at = "q", 60.0

    def shaken(log):
        bad = (log["t_s"] >= at) & (log["t_s"] < at + 6.0)
        noise = np.random.default_rng(7).standard_normal(len(log))
        return {rate: np.where(bad, log[rate] + 0.1 * noise.cumsum(), log[rate])}

    log = log_of(FLIGHTS["still air"], 10, shaken)

    assert not log["wrong"]
    assert rate in str([line for line in log["checks"] if line.startswith("These agree")])


@pytest.fixture(scope="module")
def agreeing():
    """Columns at 10 Hz of a made-up flight in wind that obeys the laws of motion."""
    fine = outer_loop(60.0, wind=WIND, seed=2)
    over = np.column_stack([fine[f"v_{axis}"] for axis in ("north", "east", "down")])
    force = np.gradient(over, STEP, axis=0) - [0.0, 0.0, G]
    body = np.einsum("nij,ni->nj", axes_of(fine["phi"], fine["theta"], fine["psi"]), force)
    fine |= {
        "f_x": body[:, 0],
        "f_y": body[:, 1],
        "f_z": -G * fine["n_z"],
        "down": -fine["h"],
        "V_g": np.hypot(over[:, 0], over[:, 1]),
        "chi": np.arctan2(over[:, 1], over[:, 0]),
        "wind_north": 0.0 * over[:, 0] + WIND[0],
        "wind_east": 0.0 * over[:, 0] + WIND[1],
        "height_err": 500.0 - fine["h"],
        "theta_cmd": fine["theta"],
    }
    return {name: column[::10].copy() for name, column in fine.items()}


@pytest.fixture
def said(agreeing, tmp_path):
    """What a log of some columns says of them: what is wrong, and the notes."""

    def said(there, change=lambda _: {}, **options):
        given = {x: agreeing[x] for x in ("t_s", "phi", *there.split())}
        changed = pd.DataFrame(given | change({**agreeing, **given}))
        changed.to_csv(tmp_path / "f.csv", index=False)
        log = ft.load_log(tmp_path / "f.csv", **options).provenance.log
        return log["wrong"], [line for line in log["checks"] if line not in log["wrong"]]

    return said


ALL = (
    "theta psi p q r n_z V_a v_north v_east v_down north east h phi_cmd n_z_cmd V_err down V_g chi "
    "wind_north wind_east height_err theta_cmd f_x f_y"
)
AGREE = """
p q r | the changes of attitude
v_north v_east north east V_g chi | the path
v_down h down height_err | the vertical speed
wind_north wind_east | the wind that speeds and nose show
n_z n_z_cmd | path and roll
phi_cmd | the roll
theta_cmd | the pitch
V_err | the changes of speed
f_x | path and attitude
V_a | the ground speed
psi | the course
theta | gamma and lift
phi | course and speed in turns
"""


def test_every_column_of_a_right_log_agrees_with_others_that_are_named(said):
    """A side force alone does not act. Each column has its partner in this table."""
    wrong, (agree, rest, *_) = said(ALL)

    assert wrong == []
    assert re.match(r"f_y cannot be checked: .*too little", rest)
    pairs = dict(
        reversed(x.split(" with ")) for x in agree.removeprefix("These agree: ").split("; ")
    )
    found = {
        others.rstrip("."): {*re.findall(r"[a-zA-Z]\w*", re.sub(r"\(.*?\)| and ", " ", names))}
        for others, names in pairs.items()
    }
    rows = [row.split(" | ") for row in AGREE.strip().splitlines()]
    assert found == {others: {*names.split()} - {"and"} for names, others in rows}
    assert {*ALL.split(), "phi"} - {"f_y"} == {x for names, _ in rows for x in names.split()}


def late(seconds, *names):
    """Columns at 10 Hz that come so much later."""
    k = np.arange(600.0)
    return lambda x: {name: np.interp(k - 10.0 * seconds, k, x[name]) for name in names}


def times(factor, *names):
    return lambda x: {name: factor * x[name] for name in names}


def plus(angle, *names):
    return lambda x: {name: x[name] + angle for name in names}


def swapped(a, b):
    return lambda x: {a: x[b], b: x[a]}


def turned(by):
    c, s = math.cos(by), math.sin(by)
    return lambda x: {
        "v_north": c * x["v_north"] - s * x["v_east"],
        "v_east": s * x["v_north"] + c * x["v_east"],
    }


SWING = np.sin(0.6 * np.arange(600.0) * np.linspace(0.1, 0.5, 600))
DOWN, PATH, AIR = "V_a h v_down", "V_a v_north v_east north east", "V_a v_north v_east v_down"
RATES, COMMANDS = "V_a theta psi p q r", f"{AIR} n_z phi_cmd n_z_cmd"
NO_CURE = "something else, and no factor, shift or exchange mends it"
ABOUT = pytest.approx(-1.0, rel=0.13)  # of means over a second
SIGN = r"a factor of -1 would do \(its sign is turned\)"
WRONG = [
    # columns, change, what is said (how it differs, and what would mend it), by how many times
    (DOWN, times(1 / si.foot, "h"), r"slope of h .*of 0\.3048 .*\(ft read as m\)", 1 / si.foot),
    (DOWN, times(1 / si.knot, "v_down"), r"h .*0\.5144 .*kn read as m/s\) to v_down", si.knot),
    (DOWN, times(-1.0, "h"), f"h is .*{SIGN}", -1.0),
    (DOWN, late(3.0, "h"), r"slope of h comes 3\.0 s after .*: a shift by -3\.0 s would", None),
    (DOWN, late(-3.0, "h"), r"slope of h comes 3\.0 s before .*: a shift by \+3\.0 s would", None),
    (DOWN, times(0.0, "h"), rf"does not change with .*0\.00\): h or v_down is {NO_CURE}", None),
    ("V_a v_down down h", times(100.0, "down"), r"slope of down is .*a factor of 0\.01", 100.0),
    ("V_a down h", times(100.0, "h"), r"slope of h is .*a factor of 0\.01 .*\(cm read", 100.0),
    ("V_a height_err v_down", times(-1.0, "height_err"), f"height_err is .*{SIGN}", -1.0),
    (f"{AIR} V_g", times(1 / si.kmh, "V_g"), r"V_g is .*0\.2778 .*\(km/h read as m/s\)", 3.6),
    (f"{AIR} V_g", times(1 / si.mph, "V_g"), r"V_g is .*0\.447 .*\(mph read", 1 / si.mph),
    ("v_north v_east chi", plus(-np.radians(20.0), "chi"), r"chi is -20\.0 deg .*\+20\.0 deg",
     None),
    (f"{AIR} psi", plus(np.radians(90.0), "psi"), r"psi is \+10\d\.\d .*a change by -10\d\.\d",
     None),
    (RATES, swapped("q", "r"), "q is unlike the changes of attitude .*q and r exchanged", None),
    (RATES, times(1 / si.degree, "r"), r"r is .*0\.01745 .*deg read as rad", 1 / si.degree),
    (RATES, late(3.0, *"pqr"), r"[pqr] comes 3\.\d s after .*-3\.\d s of p, q and r", None),
    (RATES, lambda _: {"p": 0.3 * SWING}, f"p is unlike .*: p is {NO_CURE}", None),
    (f"{AIR} theta q r", times(-1.0, "r"), f"r is .*{SIGN}", ABOUT),
    ("V_a V_g chi p q r", times(-1.0, "q"), f"q is .*{SIGN}", ABOUT),
    (f"{RATES} v_north v_east v_down north east h", lambda x: {"t_s": 1.1 * x["t_s"]},
     r"t: rates .* all 1\.1 times .*a factor of 0\.90[789]", None),
    (PATH, swapped("v_north", "v_east"), r"velocity is unlike .*v_east and v_north exch", None),
    (PATH, turned(0.4), r"chi is \+22\.9 deg off .*a turn of the velocity by -22\.9 deg", None),
    (PATH, times(1 / si.foot, "north", "east"), r"velocity is .*0\.3048 .*to north and east",
     si.foot),
    (PATH, times(-1.0, "v_east"), rf"\(correlation 0\.\d+\): {SIGN} to v_east", None),
    (AIR, times(1 / si.kmh, "V_a"), r"V_a in turns is .*0\.2778 .*km/h", 3.6),
    (f"{AIR} psi", times(1 / si.knot, "V_a"), r"V_a in turns .*0\.5144 .*kn", 1 / si.knot),
    (f"{AIR} psi", lambda x: {"V_a": x["V_g"]},
     rf"V_g less V_a does not change .*: V_a or psi is {NO_CURE}", None),
    (AIR, times(-1.0, "phi"), f"phi is .* in turns: {SIGN}", -1.0),
    (f"{AIR} theta", swapped("phi", "theta"), "phi and theta exchanged", None),
    (f"{AIR} theta", times(-1.0, "theta"), f"theta is .* gamma and lift: {SIGN}", ABOUT),
    ("v_north v_east v_down theta n_z", times(-1.0, "theta"), f"theta is .*{SIGN}", ABOUT),
    (COMMANDS, plus(-1.0, "n_z"), r"n_z is 0\.\d+ .*a change by \+1 would do \(gravity", None),
    ("V_a n_z", times(2.0, "n_z"), r"n_z, .* path and roll: a factor of 0\.50", 2.0),
    ("V_a n_z theta", times(-1.0, "n_z"), f"n_z, .* path and roll: {SIGN}", -1.0),
    (f"{AIR} theta psi n_z", times(G, "n_z"), r"n_z, .*of 0\.102 .*m/s2 read as g", G),
    (COMMANDS, times(-1.0, "n_z_cmd"), f"n_z_cmd.* is .*{SIGN}", -1.0),
    (COMMANDS, times(-1.0, "phi_cmd"), f"phi_cmd is .*{SIGN}", -1.0),
    (COMMANDS, swapped("phi", "phi_cmd"), "phi and phi_cmd exchanged", None),
    (COMMANDS, late(1.0, "phi_cmd"), r"phi_cmd comes 0\.[67] s after .*a shift by -0\.[67] s",
     None),
    ("V_a theta theta_cmd", times(5.0, "theta_cmd"), r"theta_cmd is .*a factor of 0\.2 w", 5.0),
    (f"{AIR} theta psi f_x f_y", times(1 / G, "f_x"), r"f_x is .*9\.807 .*g read as", 1 / G),
    (f"{AIR} psi wind_north wind_east", times(-1.0, "wind_north", "wind_east"),
     f"the wind is .*{SIGN} to wind_north and wind_east", -1.0),
]  # fmt: skip


@pytest.fixture(scope="module")
def of_right():
    """What agrees in a right log, by its columns."""
    return {}


def agreed(notes):
    """Columns that agree with others."""
    pairs = [x for line in notes for x in line.removeprefix("These agree: ").split("; ")]
    names = " ".join(pair.partition(" with ")[0] for pair in pairs if " with " in pair)
    return {*re.findall(r"\w+", names)} - {"and", "times", "it"}


@pytest.mark.parametrize(("there", "change", "words", "ratio"), WRONG)
def test_a_wrong_column_is_said_with_its_numbers_and_its_cure(
    said, of_right, there, change, words, ratio
):
    """All others agree as in the right log."""
    if there not in of_right:
        wrong, notes = said(there)
        assert wrong == []
        of_right[there] = agreed(notes)
    (wrong,), notes = said(there, change)

    assert re.search(words, wrong), (wrong, notes)
    named = re.findall(r"\w+", wrong.replace("velocity", "v_north v_east"))
    assert of_right[there] - {*named} <= agreed(notes)
    if ratio is not None:
        found = float(re.search(r" is (-?[\d.]+) times", wrong)[1])
        assert found == ratio or found == pytest.approx(ratio, rel=0.04)


NOTED = [
    (COMMANDS, lambda _: {"phi_cmd": SWING}, rf"phi_cmd is unlike .*: phi_cmd is {NO_CURE}"),
    ("V_a height_err v_down", times(1.0 / si.foot, "height_err"), r"3\.28 .*0\.3048"),
    (RATES, times(0.0, "q"), "q is 0 throughout"),
    (f"{AIR} V_g chi", lambda x: {"V_a": x["V_g"]},
     "V_a cannot be checked: it is the ground speed"),
    ("psi v_north v_east V_a", times(1.2, "V_a"), r"V_a \(1\.20 times it\) with the ground speed"),
    ("theta V_a V_err", times(1.0), "phi and V_a cannot be checked: the log has no v_north and v_"),
    ("theta V_a V_err", times(1.0), "theta cannot be checked: the log has no gamma"),
    ("V_a", times(1.0), "phi and V_a cannot be checked"),
    ("V_a lat lon", lambda x: {"lat": 0.8 + x["north"] / 6.4e6, "lon": 0.1 + x["east"] / 4.4e6},
     r"(?s)v_north is the slope of north.*v_east is the slope of east"),
    ("V_g chi", times(1.0), r"(?s)north is the integral of v_north"),
    ("V_a f_z v_north v_east v_down", times(-1.0, "f_z"), "after its sign was turned: z is up"),
    ("v_north v_east V_a", lambda x: {"v_north": 20.0 + 0.0 * x["phi"], "v_east": 0.0 * x["phi"]},
     "V_a cannot be checked: the log is of one heading"),
]  # fmt: skip


@pytest.mark.parametrize(("there", "change", "words"), NOTED)
def test_what_cannot_be_told_is_a_note_and_no_fault(said, there, change, words):
    for name in ("lat", "lon"):
        there = there.replace(f" {name}", "")
    wrong, notes = said(there, change)

    assert wrong == []
    assert re.search(words, "\n".join(notes)), notes


def test_several_errors_at_once_are_each_said(said):
    change = {
        "p": lambda x: -x["p"],
        "h": lambda x: x["h"] / si.foot,
        "V_a": lambda x: 3.6 * x["V_a"],
    }
    wrong, _ = said(f"{RATES} {AIR} h", lambda x: {k: f(x) for k, f in change.items()})

    assert len(wrong) == 3
    for words in (r"^p is -.*-1", r"^the slope of h .*0\.3048", r"^V_a in turns .*0\.2778"):
        assert any(re.search(words, line) for line in wrong), wrong


def test_what_is_said_of_a_trusted_column_passes_and_models_refuse_the_rest(said, tmp_path):
    change, columns = times(1.0 / si.foot, "h"), DOWN
    assert said(columns, change, columns="trusted=V_g")[0] != []
    with pytest.raises(ft.InputError, match=r"columns of the log must agree: .*trusted="):
        ft.identify(tmp_path / "f.csv")
    wrong, notes = said(columns, change, columns="trusted=h v_down")
    assert wrong == []
    assert any("0.3048" in line and "trusted= passes" in line for line in notes)


def test_a_part_of_a_log_has_the_verdict_of_the_whole(said):
    """A part may hardly vary, or be too short to tell anything."""
    change = times(-1.0, "p")
    whole, _ = said(RATES, change)
    assert len(whole) == 1
    assert said(RATES, change, start=30.0, end=38.0)[0] == whole


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("theta", [0.0, 1.6] * 99, "theta goes up to 1.6 rad"),
        ("theta", [0.0, 1.57] * 99, ""),
        ("phi", [*[1.0] * 500, 12.0], ""),  # one in 500 is noise
        ("chi", np.linspace(0.0, 59.0, 99), ""),  # nine turns
        ("chi", np.linspace(300.0, 359.0, 99), "chi goes up to 358 rad"),
        ("chi", [*[1.0] * 99, *[230.0] * 99], "chi goes up to 230 rad"),
        ("psi", [6.3] * 99, ""),
    ],
)
def test_angles_beyond_their_range_look_like_degrees(tmp_path, name, values, says):
    table = {"t": 0.1 * np.arange(len(values)), "phi": 0.0, "V_g": 20.0} | {name: values}
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)

    wrong = ft.load_log(tmp_path / "f.csv").provenance.log["wrong"]

    assert [line.partition(":")[0] for line in wrong if "goes up" in line] == [says] * bool(says)


def test_signals_that_a_log_lacks_follow_from_those_that_it_has(tmp_path):
    """Wind from a side, load factor from a force, course error, and a place without its start."""
    t = 0.1 * np.arange(150)
    table = {"t": t, "phi": 0.0, "h": 300.0 + t, "chi_ref": -3.0, "f_z": -12.0, "V_a": 20.0}
    table |= {"wind_speed": 4.0, "wind_from": 0.5, "v_north": -20.0, "v_east": 20.0}
    table["north"] = np.where(t < 0.15, np.nan, 100.0 - 20.0 * t)
    table["east"] = 7.0 + 20.0 * t
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)

    signals = ft.load_log(tmp_path / "f.csv").signals.iloc[10:-10]

    first = {name: signals[name].iloc[0] for name in signals}
    found = [first[x] for x in ("wind_north", "wind_east", "wind_down", "n_z", "V_g", "chi_err")]
    assert found == pytest.approx(
        [-4 * math.cos(0.5), -4 * math.sin(0.5), 0.0, 12 / G, 800**0.5, 1.25 * math.pi - 3.0]
    )
    assert first["gamma"] == pytest.approx(math.atan(1.0 / 800**0.5))
    assert signals["north"].to_numpy() == pytest.approx(-20.0 * (signals.index - 0.2))
    assert signals["east"].to_numpy() == pytest.approx(20.0 * signals.index)


@pytest.mark.soak
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_columns_are_judged_whatever_they_hold(tmp_path_factory, seed):
    """Subsets of columns at random sizes, with gaps, zeros, drifts and nothing at all."""
    random, names = np.random.default_rng(seed), ALL.split()
    t = random.choice([0.02, 0.1, 0.2]) * np.arange(random.integers(200, 500))
    columns = {"t": t, "phi": random.standard_normal(len(t)), "phi_cmd": 0.0 * t}
    for name in (name for name in names if random.random() < 0.4):
        column = 10.0 ** random.integers(-3, 8) * random.standard_normal(len(t))
        gaps = np.where(random.random(len(t)) < 0.3, np.nan, column)
        kinds = [column, gaps, 0.0 * column, np.nan * column, np.cumsum(column)]
        columns[name] = kinds[random.integers(len(kinds))]
    path = tmp_path_factory.mktemp("any") / "f.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    with suppress(ft.RecordingError):  # a flight at no speed
        assert {"phi", "phi_cmd"} <= {*ft.load_log(path).signals}
