"""An autopilot's parameters searched by flights, and written only if they are better."""

import math
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from commands import flighttune
from dispersed import WIND, plan_of, tables_of, uniform
from flown_campaigns import Killer, flown_here, seen_here
from fuzzing import in_child
from log_files import straight_log
from made_up import made_up_run
from places import SHIPPED_SCENARIOS

import flighttune as ft
from flighttune.base.errors import StoppedError
from flighttune.campaigns.engine.kept import KeptRows
from flighttune.campaigns.engine.progress import CampaignProgress
from flighttune.campaigns.flying.rows import scenario_of_run
from flighttune.claims import counting
from flighttune.control.laws.autopilot import Autopilot, guidance
from flighttune.control.margins import Margins
from flighttune.logs.parameters import flown_now
from flighttune.outputs.answers import retuned
from flighttune.studies import retune

BEND = (0.0, 0.0), (100.0, 0.0), (200.0, 80.0)
CORNERS = (0.0, 0.0), (500.0, 0.0), (700.0, 300.0)
SHORT = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in CORNERS]}
PX4 = (
    "# Vehicle: Fixed Wing\n# Version: 1.14.0\n1\t1\tNPFG_PERIOD\t{}\t9\n"
    "1\t1\tNPFG_DAMPING\t0.7\t9\n1\t1\tFW_T_ALT_TC\t5\t9\n1\t1\tFW_T_PTCH_DAMP\t0.1\t9\n"
)


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("now") / "plane.params"
    path.write_text(PX4.format(10.0))
    return path


@pytest.fixture(scope="module")
def plan():
    stated = ft.flights("circuit_in_wind", changes={**SHORT, "gains": ["paper"]})
    return counting.drawn(stated, gains="paper")


@pytest.fixture(scope="module")
def search(plan):
    with flown_here() as pool:
        law = Autopilot(name="now", parameters={"NPFG_PERIOD": 10.0})
        yield retune.Search(plan, law, KeptRows(None, {}, pool), draws=1)


def guided_by(search, **parameters):
    return search.candidate(Autopilot(name="now", parameters=parameters))


def rows_of(yours, tuned):
    """Rows of a count; of each draw the numbers of a flight, or None for a lost aircraft."""
    rows = []
    for n, both in enumerate(zip(yours, tuned, strict=True)):
        for name, flight in zip(("yours", "tuned"), both, strict=True):
            row = {"draw": n, "gains": name, "status": "completed" if flight else "diverged"}
            row |= {"kept": flight and flight[:6], "success": bool(flight)}
            rows.append(row | dict(zip(LARGEST, (flight or [math.nan] * 11)[6:], strict=True)))
    return pd.DataFrame(rows)


# Columns of the largest errors of a flight, in m, m/s and rad.
LARGEST = (
    *("flight.cross_track_m", "flight.height_err_m", "flight.V_a_dev_mps"),
    *("chi.peak_rad", "gamma.peak_rad"),
)


def flight(*errors, rates=(0.1, 0.5), **largest):
    """Errors of cross track, height, airspeed and course, rates of roll and load factor, largest.

    The largest errors are those of `LARGEST`.
    """
    of = {"cross": 6.0, "height": 8.0, "airspeed": 2.5, "course": 0.1, "path": 0.2} | largest
    return [*errors, *rates, *of.values()]


GOOD = flight(2.0, 3.0, 1.0, 4.0)
BETTER, LOST = flight(1.0, 2.0, 1.0, 4.0, rates=(0.15, 0.6)), None
SAFE = Margins(loop="roll", gain_decrease=0.0, gain_increase=4.0, phase_margin=1.0, delay_margin=1)


def against(rows, margins=(SAFE, SAFE), way_back=0.5, same=False):
    laws = [Autopilot(name="x", parameters={"NPFG_PERIOD": p}) for p in (10.0, 10.0 if same else 7)]
    start, best = (
        retune.with_flights(
            retune.Candidate(law=law, margins=margins, way_back=way_back),
            rows[rows["gains"] == name],
        )
        for law, name in zip(laws, ("yours", "tuned"), strict=True)
    )
    return retune._against(start, best, rows)


def test_what_is_better_on_fresh_draws_is_written():
    assert against(rows_of([GOOD] * 9, [BETTER] * 9)) == []
    slower = flight(1.0, 2.0, 1.0, 4.0, airspeed=2.95)  # a largest error may grow by 20 %
    assert against(rows_of([GOOD] * 9, [slower] * 9)) == []


WEAK = replace(SAFE, gain_increase=1.9)  # 5.6 dB
FAST = flight(1.0, 2.0, 1.0, 4.0, rates=(0.21, 0.5))
TRADED = flight(2.2, 1.0, 1.0, 4.0)  # cheaper, and farther from the track
SWINGING = flight(1.0, 2.0, 1.0, 4.4)  # nearer to the track, about which it swings
FAR = flight(30.0, 3.0, 1.0, 4.0)
SLOWING = flight(1.0, 2.0, 1.0, 4.0, airspeed=3.1)  # nearer to the stall for a moment


@pytest.mark.parametrize(
    ("rows", "more", "words"),
    [
        (rows_of([GOOD] * 9, [BETTER] * 8 + [LOST]), {}, "it loses 1 of 9 aircraft, yours 0"),
        (rows_of([BETTER] * 9, [GOOD] * 9), {}, "not surely better"),
        # 5 of 5 draws: 0.5 is not below the interval of Clopper and Pearson, 0.478 to 1
        (rows_of([GOOD] * 5, [BETTER] * 5), {}, "in 5 of 5 draws: that is not surely better"),
        # less in most draws, and more on average
        (rows_of([GOOD] * 9, [BETTER] * 8 + [FAR]), {}, "and less in 8 of 9 draws"),
        (rows_of([GOOD] * 9, [LOST] * 9), {}, "it loses 9 of 9 aircraft, yours 0"),
        (rows_of([GOOD] * 9, [BETTER] * 9), {"margins": (WEAK, SAFE)}, "gain margin of roll is"),
        (
            rows_of([GOOD] * 9, [BETTER] * 9),
            {"margins": ()},
            "stability of the loop is beyond its bound",
        ),
        (rows_of([GOOD] * 9, [BETTER] * 9), {"way_back": 1.1}, "way back to the track is beyond"),
        (rows_of([GOOD] * 9, [FAST] * 9), {}, "commanded roll moves 2.1 times as fast"),
        (
            rows_of([GOOD] * 9, [TRADED] * 9),
            {},
            "the mean error of cross track grows from 2 to 2.2 m",
        ),
        (rows_of([GOOD] * 9, [SWINGING] * 9), {}, "error of course grows from 4 to 4.4 deg"),
        (
            rows_of([GOOD] * 9, [SLOWING] * 9),
            {},
            "the largest error of airspeed grows from 2.5 to 3.1 m/s",
        ),
        (rows_of([GOOD] * 9, [GOOD] * 9), {"same": True}, "no candidate was better"),
        (
            rows_of([GOOD] * 9, [BETTER] * 9).assign(
                success=lambda rows: (rows["gains"] == "yours") | (rows["draw"] > 1)
            ),
            {},
            "2 of 9 flights miss a requirement, 0 with yours",
        ),
    ],
)
def test_nothing_is_written_that_is_worse_or_loses_more_or_has_less_margin(rows, more, words):
    assert words in " ".join(against(rows, **more))


def test_a_mean_that_grows_in_a_few_draws_is_not_surely_larger():
    few = [flight(3.0, 1.0, 1.0, 4.0)] * 4 + [flight(1.9, 1.0, 1.0, 4.0)] * 5  # 2.39 m for 2 m
    assert against(rows_of([GOOD] * 9, few)) == []


def test_two_flights_of_93_that_leave_the_others_behind_are_enough_to_write_nothing():
    # Of 93 flights one may lie beyond what 95 % keep to: P(Bin(93, 0.05) <= 1) = 0.0499. The others
    # are nearer to the track, and so is the mean.
    far = flight(1.0, 2.0, 1.0, 4.0, cross=9.0, course=math.radians(17.0))
    near = flight(1.0, 2.0, 1.0, 4.0, cross=3.0)

    assert against(rows_of([GOOD] * 93, [near] * 92 + [far])) == []
    assert against(rows_of([GOOD] * 93, [near] * 91 + [far] * 2)) == [
        "the largest error of cross track grows from 6 to 9 m, by more than 20 %",
        "the largest error of course grows from 5.73 to 17 deg, by more than 20 %",
    ]
    # the same two leave it with both
    assert against(rows_of([GOOD] * 91 + [far] * 2, [near] * 91 + [far] * 2)) == []


def test_a_candidate_has_the_means_of_the_flights_that_it_completes():
    """Of four flights one is lost and one misses a requirement; 95 % keep to the largest."""
    others = flight(4.0, 1.0, 2.0, 2.0, rates=(0.3, 0.7), cross=9.0, course=0.2)
    rows = rows_of([GOOD, LOST, others, GOOD], [LOST] * 4)
    rows.loc[rows["draw"] == 3, "success"] = False
    yours = rows[rows["gains"] == "yours"]
    start = retune.Candidate(law=law_of(10.0), margins=(SAFE, SAFE), way_back=0.5)

    made = retune.with_flights(start, yours)

    assert (made.lost, made.missed) == (1, 1)
    assert made.cost == pytest.approx((6.0 + 7.0 + 6.0) / 3.0)
    assert made.rates == pytest.approx([0.5 / 3.0, 1.7 / 3.0])
    means, largest = [8.0 / 3.0, 7.0 / 3.0, 4.0 / 3.0, 10.0 / 3.0], [9.0, 8.0, 2.5]
    assert made.errors == pytest.approx([*means, *largest, *np.degrees([0.2, 0.2])])
    assert {*made.each} == {0, 2, 3}
    assert made.each[2] == pytest.approx(
        [4.0, 1.0, 2.0, 2.0, 9.0, 8.0, 2.5, *np.degrees([0.2] * 2)]
    )
    none = retune.with_flights(start, rows[rows["gains"] == "tuned"])
    assert (none.lost, none.cost, none.each) == (4, math.inf, {})


def test_errors_are_compared_in_the_draws_that_both_completed():
    # with the old parameters the draw with the largest errors is lost
    far = flight(1.0, 2.0, 1.0, 4.0, cross=60.0)
    assert against(rows_of([GOOD] * 20 + [LOST], [BETTER] * 20 + [far])) == []


def test_what_is_larger_in_the_table_is_in_the_first_line(file, plan):
    rows = rows_of([GOOD] * 93, [BETTER] * 93)
    tuned = rows["gains"] == "tuned"
    rows["flight.cross_track_m"] = np.where(tuned, 2.0, 5.0)
    rows["flight.height_err_m"] = np.where(tuned, 3.12, 3.0)  # by 4 %
    rows["flight.V_a_dev_mps"] = np.where(tuned, 1.8, 1.5)
    rows["chi.peak_rad"] = rows["gamma.peak_rad"] = np.nan
    rows["plant"] = "jsbsim:aerosonde"

    first = retuned.sentence(retuned_of(rows, file, plan.with_runs(93)))

    assert first.endswith(
        "These errors in the table below are larger with them: airspeed 1.5 | 1.8 m/s."
    )


def retuned_of(rows, file, plan):
    """The answer of a count of these rows on a plan."""
    laws = [Autopilot(name="x", parameters={"NPFG_PERIOD": p}) for p in (10.0, 7.0)]
    start, best = (
        retune.with_flights(retune.Candidate(law=law, margins=(SAFE, SAFE), way_back=0.5), of)
        for law, (_, of) in zip(laws, sorted(rows.groupby("gains"), reverse=True), strict=True)
    )
    return retune.Retuned(
        now=flown_now(file), file=file, plan=plan, rows=rows, start=start, best=best, flights=0,
        candidates=70, finalists=4, held_by=(), against=(), notes=(), tracking=[],
    )  # fmt: skip


def test_the_answer_says_what_its_flights_tell_and_what_they_do_not(file, plan):
    rows = rows_of([GOOD] * 92 + [LOST], [BETTER] * 93)
    # One-sided bounds of Clopper and Pearson: (1 - p)^93 = 0.05, and for one of 93
    # (1 - p)^93 + 93 p (1 - p)^92 = 0.05. Of 93 fair coins 57 heads or more have a chance of 0.0188
    # and 56 of 0.0307, where the two-sided interval leaves 0.025.
    none = 1.0 - 0.05 ** (1.0 / 93.0)
    assert (1 - 0.0500) ** 93 + 93 * 0.0500 * (1 - 0.0500) ** 92 == pytest.approx(0.05, abs=2e-3)

    counted = retuned_of(rows, file, plan.with_runs(93))
    words = retuned.told(counted)

    assert "Of 70 candidates on 6 draws 4 flew on 12 others, and the best of these on 93 " in words
    assert f"at most 5 % | {100.0 * none:.2g} % of all flights are lost" in words
    assert "sure if one is better in 57 of them" in words
    # of 5 never, of 6 only in all
    assert [retuned_of(rows, file, plan.with_runs(n)).sure_from for n in (5, 6)] == [6, 6]
    assert "No difference is sure in so few" in retuned.told(
        retuned_of(rows, file, plan.with_runs(5))
    )


@pytest.mark.parametrize(("lost", "of_yours"), [(93, 93), (60, 93), (60, 0), (0, 93)])
def test_a_search_whose_flights_end_early_says_that_alone(file, plan, lost, of_yours):
    """The reason is that of a flight on an aircraft; a result that completes is an answer."""
    why = "t = 1.94 s: alpha must stay inside -14 to 16 deg, got 16.3 deg."
    yours = [LOST] * of_yours + [GOOD] * (93 - of_yours)
    rows = rows_of(yours, [LOST] * lost + [BETTER] * (93 - lost))
    rows = rows.assign(plant="jsbsim:aerosonde", reason=why)

    said = retuned_of(rows, file, plan.with_runs(93)).answer()

    assert said.status == (2 if lost else 0)
    if lost:
        first, condition = said.summary
        assert f"{lost} of 93 flights with the tuned ones" in first
        assert "alpha left its range of -14 to 16 deg (16.3 deg): fly faster" in first
        assert "jsbsim:aerosonde at 25 m/s" in condition
    assert not re.search(r"\b(inf|nan)\b|∞", " ".join(said.summary))


def test_the_answer_states_both_sides_of_every_number(file, plan):
    """Cost of 2 + 3 + 1 and of 1 + 2 + 1; a factor of 4 is 12.0 dB, and 1 rad is 57 deg."""
    rows = rows_of([GOOD] * 92 + [LOST], [BETTER] * 93).assign(plant="jsbsim:aerosonde")
    margins = [("gain margin", "roll"), ("gain margin", "lift"), ("range", "NPFG_PERIOD")]
    counted = replace(
        retuned_of(rows, file, plan.with_runs(93)), flights=600,
        held_by=tuple(retune.Constraint(*of) for of in margins),
    )  # fmt: skip

    said = counted.answer()

    first, aircraft, errors, cuts = said.summary
    assert first.startswith(
        "Lost 1 | 0 of 93 fresh draws, yours | tuned. The tuned parameters are better, after 600 "
        "flights of 70 candidates. They are held by the gain margins of roll and lift, and the "
        "range of NPFG_PERIOD."
    )
    assert errors == (
        "Root mean squares: cross track 2 | 1 m, height 3 | 2 m, airspeed 1 | 1 m/s, course 4 | 4 "
        "deg; cost 6 | 4, which is 1 cross track [m] + 1 height [m] + 1 airspeed [m/s]."
    )
    assert cuts == (
        "Margins: roll 12.0 dB, 57 deg | 12.0 dB, 57 deg; lift 12.0 dB, 57 deg | 12.0 dB, 57 deg. "
        "Rates of the commands of roll and lift: 1.50 and 1.20 times yours."
    )
    assert "jsbsim:aerosonde at 25 m/s" in aircraft
    assert "`--aircraft`" in aircraft
    assert said.failure == ""
    (change,) = said.values["changes"]
    assert [change[x] for x in ("name", "old", "new")] == ["NPFG_PERIOD", 10.0, 7]
    assert change["why"] == "speed of the return to the track"
    (published,) = (x for x in counted.now.rows if x["name"] == "NPFG_PERIOD")
    assert change["range"] == published["range"]
    assert said.values["better"] is True
    assert said.values["held_by"][0] == "the gain margin of roll"
    lost, cost = said.values["lost"], said.values["cost"]
    assert (lost, cost) == ({"yours": 1, "tuned": 0}, {"yours": 6.0, "tuned": 4.0})
    assert said.values["lost_at_most"]["tuned"] == pytest.approx(1.0 - 0.05 ** (1.0 / 93.0))
    assert said.tables[1].records == said.values["accuracy"] == counted.accuracy
    assert said.tables[1].title.endswith("at a confidence of 95 %")
    others = retuned.other_aircraft(replace(counted, file=counted.file.with_suffix(".ulg")))
    assert "`--aircraft " in others
    assert "flies the lags of the log instead" in others


def test_what_changed_is_written_into_the_file_of_the_user_or_a_new_one(file, plan, tmp_path):
    rows = rows_of([GOOD] * 9, [BETTER] * 9).assign(plant="jsbsim:aerosonde")
    counted = retuned_of(rows, file, plan.with_runs(9))
    ardupilot = tmp_path / "plane.parm"
    ardupilot.write_text("NAVL1_PERIOD 10\n")
    of_log = replace(counted, file=tmp_path / "flown.ULG")
    of_other = replace(of_log, now=flown_now(ardupilot, "4.5"))

    texts = [
        counted.save_parameters(tmp_path / "a.params").read_text(),
        *(x.save_parameters(tmp_path / "b.params").read_text() for x in (of_log, of_other)),
    ]

    rest = [[x for x in text.splitlines() if not x.startswith("# ")] for text in texts]
    old = [x for x in file.read_text().splitlines() if not x.startswith("# ")]
    assert [a for a, b in zip(rest[0], old, strict=True) if a != b] == ["1\t1\tNPFG_PERIOD\t7\t9"]
    assert rest[1:] == [["1\t1\tNPFG_PERIOD\t7\t9"], ["NPFG_PERIOD,7"]]
    assert all("NPFG_PERIOD 10 to 7" in text for text in texts)
    with pytest.raises(ft.InputError, match="must be better to be written: slower"):
        replace(counted, against=("slower",)).save_parameters(tmp_path / "c.params")
    assert not (tmp_path / "c.params").exists()


def test_rows_of_guidances_are_those_of_their_own_flights_on_the_first_draws(plan):
    """Two guidances fly on three draws, and the gains of the plan do not."""
    asked = []

    def flown(plan, probes, *, doing):
        asked.append((plan, {*probes}))
        size = len(plan.groups)
        each = ((run, *divmod(run, size)) for run in range(plan.runs))
        return [
            {"run": run, "draw": draw, "kept": [run], "success": True, "reason": "", "missed": "",
             "status": "completed"} | plan.groups[k]._asdict()
            for run, draw, k in each
        ]  # fmt: skip

    laws = {f"c{n}": law_of(period) for n, period in enumerate((9.0, 8.0))}

    rows = retune.fly(plan, laws, 3, SimpleNamespace(flown=flown))

    ((of_both, probes),) = asked
    assert (of_both.runs, len(of_both.groups)) == (6, 2)
    assert probes == {"kept", retune.KEPT}
    assert rows["gains"].tolist() == ["c0", "c1"] * 3
    assert rows["draw"].tolist() == [0, 0, 1, 1, 2, 2]
    own = {x.name: x.parameters for x in of_both.scenario.law_tables if x.name in laws}
    assert own == {name: law.parameters for name, law in laws.items()}
    assert [x.gains.partition(":")[0] for x in of_both.groups] == [*laws]
    assert retune.fly(plan, {}, 3, None).empty


@pytest.mark.parametrize(
    ("held_by", "changed", "refused"),
    [
        ([("rate", "the commanded roll")], False, "the rate of the commanded roll"),
        ([("rate", "the commanded roll")], True, ""),
        ([], False, ""),
    ],
)
def test_what_is_not_better_is_said_first_with_what_refused_the_cheaper(
    file, plan, held_by, changed, refused
):
    """Bounds refuse what costs less only where the start itself came out."""
    rows = rows_of([GOOD] * 9, [BETTER] * 9).assign(plant="jsbsim:aerosonde")
    counted = retuned_of(rows, file, plan.with_runs(9))
    best = counted.best if changed else replace(counted.best, law=counted.start.law)
    constraints = tuple(retune.Constraint(*of) for of in held_by)
    reasons = ("it is heavier", "it is slower")
    counted = replace(counted, best=best, held_by=constraints, against=reasons)

    said = counted.answer()

    words = f" What costs less is refused by {refused}." * bool(refused)
    assert (
        said.failure
        == said.summary[0]
        == (
            "Lost 0 | 0 of 9 fresh draws, yours | tuned. Nothing is written, after 0 flights of 70 "
            f"candidates: it is heavier and it is slower.{words}"
        )
    )
    assert said.values["better"] is False
    assert said.values["against"] == ["it is heavier", "it is slower"]
    assert retuned.constraints([]) == ""


@pytest.mark.parametrize("period", guidance())
def test_every_place_of_a_search_is_within_the_published_range(period):
    table = guidance()[period]
    published = {name: (low, high) for name, _, _, _, low, high in table["parameters"]}
    for name in table["searched"]:
        low, high = published[name]
        searched = retune.Range(name, low, min(high, 20.0))
        values = [searched.at(x) for x in np.linspace(0.0, 1.0, 101)]
        assert min(values) == pytest.approx(low)
        assert all(low <= value <= high for value in values)
        assert np.all(np.diff(values) >= 0.0)
        # three digits are kept
        assert searched.at(searched.place(values[40])) == pytest.approx(values[40], rel=5e-3)


@pytest.mark.parametrize(
    ("low", "high", "place", "value"),
    [
        # equal ratios from a positive end, squares from zero, three digits
        (2.0, 8.0, 0.5, 4.0),
        (2.0, 8.0, 1.0, 8.0),
        (0.0, 9.0, 0.5, 2.25),
        (1.0, 10.0, 1.0 / 3.0, 2.15),
    ],
)
def test_places_are_of_equal_ratios_or_of_squares_from_zero(low, high, place, value):
    searched = retune.Range("NPFG_PERIOD", low, high)

    assert searched.at(place) == value
    assert searched.place(value) == pytest.approx(place, abs=1e-3)
    assert (searched.place(low - 1.0), searched.place(high + 1.0)) == (0.0, 1.0)


@pytest.mark.parametrize(
    ("margins", "held"),
    [
        # 4 or 1 / 0.2 times the gain: the nearer is 4
        ({"gain_increase": 4.0, "gain_decrease": 0.2}, 20.0 * math.log10(4.0)),
        ({"gain_increase": 4.0, "gain_decrease": 0.5}, 20.0 * math.log10(2.0)),
        ({"gain_increase": 1.5, "gain_decrease": 0.0}, 20.0 * math.log10(1.5)),
    ],
)
def test_margins_are_held_against_6_db_and_35_deg(margins, held):
    roll, lift = replace(SAFE, **margins), replace(SAFE, phase_margin=math.radians(70.0))
    candidate = retune.Candidate(law=law_of(9.0), margins=(roll, lift), way_back=0.25)

    used = candidate.held

    assert used[retune.Constraint("gain margin", "roll")] == pytest.approx(6.0 / held)
    assert used[retune.Constraint("phase margin", "lift")] == pytest.approx(0.5)
    assert used[retune.Constraint("roll", "the way back to the track")] == 0.25
    assert candidate.allowed is (held >= 6.0)
    assert not replace(candidate, way_back=1.01).allowed
    assert replace(candidate, margins=(SAFE, SAFE), way_back=1.0).allowed


def test_bounds_rank_before_lost_aircraft_these_before_requirements_and_rates():
    fast = flight(2.0, 3.0, 1.0, 4.0, rates=(0.25, 0.5))
    search = made_up({10.0: GOOD, 9.0: GOOD, 8.0: fast})
    same, faster = search.candidates[1:]
    broken = replace(same, margins=(WEAK, SAFE))
    unstable = replace(same, margins=())

    values = [search.value(x) for x in (
        search.start, faster, replace(same, missed=1), replace(same, lost=1, cost=math.inf),
        broken, unstable,
    )]  # fmt: skip

    assert values == sorted(set(values))
    assert values[0] == pytest.approx(1.0)
    # 2.5 times as fast where 2 is allowed: a quarter beyond, and worse than the start by 1
    assert values[1] == pytest.approx(10.0 * 0.25 + 1.0 + 1.0)
    assert values[2] == pytest.approx(1e3 + 1.0)
    assert values[3] == pytest.approx(1e6)
    gain = 6.0 / (20.0 * math.log10(1.9))
    assert values[4] == pytest.approx(1e9 * gain)
    assert search.used(faster)[retune.Constraint("rate", "the commanded roll")] == pytest.approx(
        1.25
    )


def test_a_result_at_the_end_of_a_range_or_near_a_bound_is_held_by_it():
    """Ends of the range are a hundredth of it, bounds a twentieth."""
    errors = {10.0: GOOD, 7.0: growing(1.0, 1.0)}
    final = made_up(errors)
    near, far = [(7.0, 20.0), (2.0, 7.0), (6.93, 20.0), (2.0, 7.08)], [(6.8, 20.0), (2.0, 7.2)]
    ends = [retune.Range("NPFG_PERIOD", low, high) for low, high in near + far]

    held = [[str(x) for x in retune._held_by(final, final, [end])] for end in ends]

    assert held == [["the range of NPFG_PERIOD"]] * 4 + [[]] * 2
    near = made_up({10.0: GOOD, 7.0: flight(2.0, 1.0, 1.0, 4.0, rates=(0.192, 0.5))})
    assert [str(x) for x in retune._held_by(near, near, [])] == ["the rate of the commanded roll"]
    far = made_up({10.0: GOOD, 7.0: flight(2.0, 1.0, 1.0, 4.0, rates=(0.188, 0.5))})
    assert retune._held_by(far, far, []) == []


def test_what_a_file_does_not_state_is_not_searched(file):
    ranges, notes = retune.ranges_of(flown_now(file), file.name)
    assert [x.name for x in ranges] == [
        *("NPFG_PERIOD", "NPFG_DAMPING", "FW_T_ALT_TC", "FW_T_PTCH_DAMP")
    ]
    assert "FW_T_HRATE_FF and FW_T_I_GAIN_PIT" in notes[0]


def test_what_a_file_states_beyond_its_published_range_is_named(file, tmp_path):
    (tmp_path / "slow.params").write_text(PX4.format(150.0))

    assert retune._beyond(flown_now(file)) == []
    (said,) = retune._beyond(flown_now(tmp_path / "slow.params"))
    assert "NPFG_PERIOD" in said


def test_parameters_of_a_tecs_that_is_not_emulated_are_not_searched(tmp_path):
    old = tmp_path / "old.param"
    old.write_text("NAVL1_PERIOD,17\nTECS_TIME_CONST,5\nTECS_PTCH_DAMP,0.3\n")
    for version, searched in (("4.3", 1), ("4.4", 3)):
        ranges, notes = retune.ranges_of(flown_now(old, version), old.name)
        assert len(ranges) == searched
        assert ("TECS of this version is not the emulated one: TECS_TIME" in str(notes)) == (
            version == "4.3"
        )


@pytest.mark.filterwarnings("error")
def test_an_error_that_is_none_with_both_bounds_nothing(file):
    exact = flight(1.0, 2.0, 0.0, 4.0, airspeed=0.0)
    rows = rows_of([exact] * 3, [exact] * 3)
    law = flown_now(file).law
    start = retune.with_flights(retune.Candidate(law=law, margins=(SAFE, SAFE), way_back=0.5), rows)
    searching = MadeUpFlights(start)
    assert np.nanmax(searching.growth(start)) == pytest.approx(0.0, abs=1e-12)
    assert searching.value(start) == pytest.approx(1.0)
    assert not [x for x in searching.used(start) if x.of == "airspeed"]


class MadeUpFlights(retune.Search):
    """Candidates whose flights are made up, each with a name for its period."""

    def __init__(self, start, errors=None):
        self.start, self.candidates, self.errors, self.flights = start, [start], errors or {}, 0

    def fly(self, laws):
        made = [candidate_of(self.errors[law.parameters["NPFG_PERIOD"]], law) for law in laws]
        self.candidates += made
        return made


def candidate_of(kept, law):
    """A candidate whose six flights all have these errors and rates."""
    rows = rows_of([kept] * 6, [kept] * 6)
    candidate = retune.Candidate(law=law, margins=(SAFE, SAFE), way_back=0.5)
    return retune.with_flights(candidate, rows[rows["gains"] == "yours"])


def made_up(errors):
    """A search of the start and of candidates with these errors, by their periods."""
    laws = {p: Autopilot(name="x", parameters={"NPFG_PERIOD": p}) for p in errors}
    (first, *others) = errors
    search = MadeUpFlights(candidate_of(errors[first], laws[first]), errors)
    search.fly([laws[p] for p in others])
    return search


def growing(height, airspeed):
    """Errors and rates of a flight whose height costs less, and whose airspeed errs more."""
    return flight(2.0, height, airspeed, 4.0)


def test_a_growing_error_has_a_price_up_to_its_bound():
    # the start costs 2 + 3 + 1 = 6; 5 % more airspeed is allowed to the count, of which the search
    # takes four fifths, and the whole of it has the price of a tenth of the cost of the start
    search = made_up({10.0: GOOD, 9.0: growing(2.0, 1.0), 8.0: growing(2.0, 1.03)})
    same, grown = search.candidates[1:]

    assert search.value(same) == pytest.approx(5.0 / 6.0)
    assert search.value(grown) == pytest.approx(5.03 / 6.0 + 0.1 * 0.6)
    assert search.best is same

    beyond = made_up({10.0: GOOD, 9.0: growing(0.5, 1.041)})
    assert beyond.value(beyond.candidates[1]) > beyond.value(beyond.start)
    assert beyond.best is beyond.start


def test_a_largest_error_that_grows_on_the_draws_of_the_search_has_a_price_and_a_bound_too():
    # 20 % are allowed to the count, and the search takes four fifths of them
    grown = flight(2.0, 2.0, 1.0, 4.0, cross=1.15 * 6.0)
    search = made_up({10.0: GOOD, 9.0: grown})
    assert search.value(search.candidates[1]) == pytest.approx(5.0 / 6.0 + 0.1 * 0.75)
    assert search.best is search.candidates[1]

    far = flight(2.0, 2.0, 1.0, 4.0, cross=1.17 * 6.0)
    beyond = made_up({10.0: GOOD, 9.0: far})
    assert beyond.best is beyond.start
    # one flight of six
    rows = rows_of([GOOD] * 6, [growing(2.0, 1.0)] * 5 + [far])
    (_, some) = (retune.with_flights(x, rows[rows["gains"] == "tuned"]) for x in beyond.candidates)
    assert beyond.value(some) > beyond.value(beyond.start)


def test_the_best_of_the_search_is_chosen_on_other_draws():
    # On other draws the airspeed errs by 6 % more with each: the first is beyond its bound then,
    # the next would be too, and the third is not.
    errors = {10.0: GOOD, 9.0: growing(1.0, 1.0), 8.0: growing(1.1, 0.99), 7.0: growing(1.5, 0.97)}
    others = {p: [*x[:2], 1.06 * x[2], *x[3:]] for p, x in errors.items()} | {10.0: GOOD}
    search, final = made_up(errors), MadeUpFlights(candidate_of(GOOD, law_of(10.0)), others)
    assert search.best.law.parameters["NPFG_PERIOD"] == 9.0

    chosen = search.choose(final)

    assert [x.law.parameters["NPFG_PERIOD"] for x in final.candidates] == [10.0, 9.0, 7.0, 8.0]
    assert chosen is final.candidates[2]
    assert retune._held_by(search, final, []) == []


def law_of(period):
    return Autopilot(name="x", parameters={"NPFG_PERIOD": period})


def test_a_search_whose_candidates_are_all_refused_names_the_bound():
    errors = {10.0: GOOD, 9.0: growing(1.0, 1.0)}
    others = errors | {9.0: growing(1.0, 1.06)}
    search, final = made_up(errors), MadeUpFlights(candidate_of(GOOD, law_of(10.0)), others)

    assert search.choose(final) is final.start

    held = retune._held_by(search, final, [])
    assert [str(x) for x in held] == ["the mean error of airspeed"]
    unflown = MadeUpFlights(candidate_of(GOOD, law_of(10.0)))
    assert retune._held_by(made_up({10.0: GOOD, 9.0: BETTER}), unflown, []) == []
    # of two that cost less, the cheapest
    far = flight(2.6, 2.0, 1.0, 4.0)
    two = made_up({10.0: GOOD, 8.0: far, 9.0: growing(1.0, 1.045)})
    assert [str(x) for x in retune._held_by(two, unflown, [])] == ["the mean error of airspeed"]


def test_no_more_candidates_are_flown_again_than_stated():
    errors = {10.0 - 0.1 * n: growing(2.9 - 0.1 * n, 1.0) for n in range(1, 9)}
    search = made_up({10.0: GOOD} | errors)
    final = MadeUpFlights(candidate_of(GOOD, law_of(10.0)), dict.fromkeys(errors, LOST))

    assert search.choose(final) is final.start
    assert len(final.candidates) == 1 + retune.FINALISTS


def test_what_holds_a_search_is_said_in_one_phrase():
    held = [
        retune.Constraint("gain margin", "lift"),
        *(retune.Constraint("mean error", x) for x in ("cross track", "airspeed")),
        retune.Constraint("largest error", "course"),
        *(retune.Constraint("range", x) for x in ("NPFG_PERIOD", "FW_T_ALT_TC", "FW_T_PTCH_DAMP")),
    ]
    assert retuned.constraints(held) == (
        "the gain margin of lift, the mean errors of cross track and airspeed, the largest error "
        "of course, and the ranges of NPFG_PERIOD, FW_T_ALT_TC and FW_T_PTCH_DAMP"
    )
    assert retuned.constraints(held[:1]) == "the gain margin of lift"
    assert retuned.constraints([]) == ""


def test_the_way_back_is_held_against_the_strongest_wind_of_the_draws(plan):
    speeds = [scenario_of_run(plan.with_runs(9), run).wind.speed_mps for run in range(9)]
    for n in (1, 4, 9):
        assert retune._wind(plan, n) == pytest.approx(max(speeds[:n]))
    of_start = uniform("flight.chi_deg", 0.0, 10.0)
    assert retune._wind(plan_of(tables_of(wind=WIND), of_start), 3) == WIND["speed_mps"]
    assert retune._wind(plan_of(tables_of(), of_start), 3) == 0.0


class SearchedError(Exception):
    """A search that has begun."""


@pytest.mark.parametrize(("like", "required"), [(None, 0), ("circuit_in_wind", 1)])
def test_a_search_on_a_mission_minimises_no_requirement_that_nobody_stated(
    file, monkeypatch, like, required
):
    def begun(stated, *_):
        raise SearchedError(counting.drawn(stated).scenario.expect)

    monkeypatch.setattr("flighttune.studies.meet.retune", begun)
    with pytest.raises(SearchedError) as begins:
        ft.meet(SHIPPED_SCENARIOS / "approach.plan", autopilot=file, like=like)
    assert len(begins.value.args[0]) == required


def test_errors_and_rates_of_a_flight_are_root_mean_squares():
    t = np.linspace(0.0, 2.0 * math.pi, 10001)
    airspeed = 25.0 - 4.0 * np.sin(t)
    signals = {"cross_track": 3.0 * np.sin(t), "height_err": 0.0 * t - 2.0, "V_a": airspeed}
    signals |= {"chi_err": np.radians(5.0) * np.cos(t)}
    run = made_up_run(signals | {"phi_cmd": 0.5 * np.sin(2.0 * t), "n_z_cmd": 1.0 + 0.2 * t}, t)
    scenario = ft.load_scenario("circuit")  # at 25 m/s
    root = math.sqrt(2.0)
    expected = [3.0 / root, 2.0, 4.0 / root, 5.0 / root, 1.0 / root, 0.2]
    assert retune.numbers(run, scenario) == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_margins_of_a_candidate_are_those_of_a_frequency_response(search):
    # L = G (a s + b) / s^2 with the identified roll behind half a sample
    (lag, _) = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags
    a, late = 4.0 * math.pi * 0.8 / 8.0, 0.8 * 8.0
    s = 1j * np.geomspace(1e-2, 60.0, 200_001)
    second = s**2 / lag.natural_frequency**2 + 2.0 * lag.damping * s / lag.natural_frequency + 1.0
    L = np.exp(-s * (lag.delay + 0.01)) / ((1.0 + s * lag.lag) * second)
    L = L * (a * s + a * math.pi / late) / s**2
    crossing = np.flatnonzero((np.abs(L[:-1]) > 1.0) & (np.abs(L[1:]) <= 1.0))[-1]
    phase = np.degrees(np.unwrap(np.angle(L))[crossing]) % 360.0 - 180.0

    candidate = guided_by(search, NPFG_PERIOD=8.0, NPFG_DAMPING=0.8)

    assert candidate.held[retune.Constraint("phase margin", "roll")] == pytest.approx(
        35.0 / phase, rel=0.01
    )


@pytest.mark.slow
def test_a_period_whose_way_back_is_steeper_than_the_roll_is_not_flown(search):
    # look ahead by pi/2 (1 - e)^2 at a part e of the bound: the course turns on the way back by
    # d(bearing)/de sin(bearing) V / (damping period), largest over e, by differences
    e = np.linspace(0.0, 1.0, 100_001)
    bearing = 0.5 * math.pi * (1.0 - (1.0 - e) ** 2)
    turn = np.max(np.abs(np.gradient(bearing, e) * np.sin(bearing)))
    free = {"NPFG_DAMPING": 0.8, "NPFG_LB_PERIOD": 0.0}
    for period in (3.0, 4.0, 12.0):
        candidate = guided_by(search, NPFG_PERIOD=period, **free)
        roll = turn * search.V_g / (0.8 * period * 9.80665 * math.tan(search.roll_limit))
        assert candidate.way_back == pytest.approx(roll, rel=1e-3)
    before = search.flights
    (steep,) = search.fly([guided_by(search, NPFG_PERIOD=3.0, **free).law])
    assert not steep.allowed
    assert search.flights == before
    assert search.best is search.start
    assert search.value(steep) > search.value(search.start)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["circuit_in_wind", "--with", "plane.param", "--out", "x.json"], ".params or .param"),
        (["circuit_in_wind", "--with", "plane.param", "--out", "x.params"], ".param or .parm"),
        (["circuit_in_wind", "--with", "plane.param", "--out", "plane.param"], "another file than"),
        (["circuit_in_wind", "--with", "plane.param", "--success", "0.9"], "must be absent with"),
        (["circuit", "--flights", "5"], "`flights` must be absent without the parameters"),
        (["level_turn", "--with", "plane.param"], "must be a route"),
        (["circuit_in_wind", "--with", "plane.param", "--budget", "9"], "at least 300 flights"),
        (["circuit_in_wind", "--with", "other.param"], "must state one of NAVL1_PERIOD"),
        (
            ["circuit_in_wind", "--with", "plane.param", "--assume", "n_z=4"],
            "`assume` must be absent without the log of an aircraft",
        ),
    ],
)
def test_what_cannot_be_searched_is_refused_in_a_line(tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plane.param").write_text("NAVL1_PERIOD,14\nROLL_LIMIT_DEG,45\n")
    (tmp_path / "other.param").write_text("TECS_SPDWEIGHT,1\nROLL_LIMIT_DEG,45\n")
    assert words in " ".join(flighttune("meet", *options, status=2)[1].split())


def bend_in_wind():
    """Flights of 14 s on the lags of an aircraft in any wind of up to 3 m/s."""
    tables = tables_of(
        ({"kind": "point_mass_lag", "identified": "aerosonde"},),
        route={"waypoint": [{"north_m": n, "east_m": e} for n, e in BEND]},
        flight={"V_a_mps": 25.0, "duration_s": 14.0, "h_m": 500.0},
        controller={"rate_hz": 10.0, "feed_forward": True},
    )
    del tables["reference"]
    wind = uniform("wind.speed_mps", 0.0, 3.0), uniform("wind.from_deg", 0.0, 359.0)
    return plan_of(tables, *wind)


@pytest.fixture
def bettered(tmp_path, monkeypatch):
    """A slow period, bettered on the lags of an aircraft in a bend, beside a log off the track.

    With the seeds of the draws that searched and chose.
    """
    seeds = []

    class Seeded(retune.Search):
        def __init__(self, plan, *others):
            seeds.append(plan.campaign.seed)
            super().__init__(plan, *others)

    monkeypatch.setattr(retune, "Search", Seeded)
    monkeypatch.setattr(retune, "DRAWS", 1)
    monkeypatch.setattr(retune, "FINAL_DRAWS", 1)
    slow = tmp_path / "slow.params"
    slow.write_text("".join(PX4.format(80.0).splitlines(keepends=True)[:4]))  # nothing of height
    log = straight_log(tmp_path / "log.bin", {}, cross_track=40.0, height_err=0.0)
    with flown_here():
        found = ft.meet(
            ft.flights(bend_in_wind()), autopilot=slow, flights=6, budget=26, workers=1, log=log
        )
    return found, seeds


@pytest.mark.slow
def test_what_betters_a_slow_period_is_counted_on_fresh_draws_and_written(bettered, tmp_path):
    bettered, seeds = bettered
    assert len({bettered.plan.campaign.seed, *seeds}) == 3  # what searches, chooses and is counted
    now, period = bettered.start.law.parameters, bettered.best.law.parameters["NPFG_PERIOD"]
    both = dict(iter(bettered.rows.groupby("gains")))

    assert period < now["NPFG_PERIOD"] == 80.0
    assert bettered.changes.items() <= bettered.best.law.parameters.items()
    assert all(now[name] != value for name, value in bettered.changes.items())
    assert {"NPFG_PERIOD", "NPFG_DAMPING"} >= {*bettered.changes}
    assert {"NPFG_PERIOD": "period", "NPFG_DAMPING": "damping"}.items() <= bettered.searched.items()
    # six of six draws: the lower end of 95 % is 0.025^(1/6) = 0.541
    assert bettered.better
    assert bettered.sure_from == 6
    drawn = [both[name][[*bettered.plan.keys]].to_numpy() for name in ("yours", "tuned")]
    assert (drawn[0] == drawn[1]).all()
    assert len({*map(tuple, drawn[0])}) == 6
    cross, *_ = bettered.accuracy
    for name, rows in both.items():
        assert cross[name] == rows["flight.cross_track_m"].max()
    assert (cross["better"], cross["flights"]) == (6, 6)
    # the start and 8 candidates on one draw, the start and 4 finalists on another, 6 draws of both
    assert (bettered.candidates, bettered.finalists) == (9, 4)
    assert bettered.flights == 9 + 5 + 12 - 1
    (of_log, *_) = bettered.tracking
    assert of_log["log"] == pytest.approx(0.95 * 40.0, rel=0.01)
    assert of_log["high"] < 10.0
    assert any("outside of" in note and "cross track" in note for note in bettered.notes)

    out = bettered.save_parameters(tmp_path / "tuned.params")
    assert flown_now(out).law.parameters["NPFG_PERIOD"] == pytest.approx(period)
    lines = [[*path.read_text().splitlines()] for path in (bettered.file, out)]
    old, new = ([x for x in text if not x.startswith("# ")] for text in lines)
    assert sum(a != b for a, b in zip(old, new, strict=True)) == len(bettered.changes)
    of_log = replace(bettered, file=tmp_path / "flown.ULG")
    text = of_log.save_parameters(tmp_path / "new.params").read_text()
    assert {x.split("\t")[2] for x in text.splitlines() if x[0] != "#"} == {*bettered.changes}
    with pytest.raises(ft.InputError, match="must be better to be written: slower"):
        replace(bettered, against=("slower",)).save_parameters(out)


@pytest.mark.soak
def test_a_slow_period_is_bettered_written_and_read_back(tmp_path, monkeypatch):
    monkeypatch.setattr(retune, "DRAWS", 1)
    monkeypatch.setattr(retune, "FINAL_DRAWS", 1)
    slow, out = (tmp_path / x for x in ("slow.params", "tuned.params"))
    of_track = PX4.format(80.0).splitlines(keepends=True)[:4]  # the height is not searched
    slow.write_text("".join(of_track))
    log = straight_log(tmp_path / "flown.bin", {}, cross_track=50.0, height_err=0.0)
    options = ["--with", slow, "--flights", 6, "--budget", 26, "--out", out, "--workers", 1]
    options += ["--log", log, "--navigation", "exact"]
    legs = [{"north_m": n, "east_m": e} for n, e in BEND]
    route = [f"--set=route.waypoint={legs}".replace("':", "'=")]
    with flown_here():
        said = flighttune("meet", "circuit_in_wind", *options, *route, status=0)[0]
    now, then = (flown_now(x).law.parameters for x in (slow, out))
    assert then["NPFG_PERIOD"] < now["NPFG_PERIOD"]
    assert "emulation of guidance and height" in out.read_text()
    changed = {x for x in now if now[x] != then[x]}
    kept = [x for x in out.read_text().splitlines() if not x.startswith("# ")]
    old = [x for x in slow.read_text().splitlines() if not x.startswith("# ")]
    assert {a.split("\t")[2] for a, b in zip(old, kept, strict=True) if a != b} == changed
    assert "tuned better in" in said
    assert re.search(r"The log lies [a-z ]*outside of [a-z ]*cross track", " ".join(said.split()))


# Flies each run once, and stops after so many flights.
def flying(stop_after, flown):
    def rows(plan, runs, **_):
        for run in runs:
            if len(flown) == stop_after:
                raise StoppedError("the observer stopped the flights.")
            flown.append((plan.campaign.seed, run))
            kept = [run / 3.0, math.nan]
            row = {"run": run, "kept": kept, "status": "completed", "reason": "", "success": True}
            yield row

    pool = SimpleNamespace(observer=ft.CampaignObserver(), progress=CampaignProgress())
    pool.rows = rows
    return pool


class MadeUpSearch(retune.Search):
    """Candidates cost what their period is away from 14 s, and do not fly."""

    def __init__(self, law):
        self.draws, self.flights, self.start = 10, 10, SimpleNamespace(law=law)
        self.asked = []

    def fly(self, laws):
        self.flights += self.draws * len(laws)
        self.asked += [law.parameters["NPFG_PERIOD"] for law in laws]
        return laws

    def value(self, law):
        return abs(law.parameters["NPFG_PERIOD"] - 14.0)


@pytest.mark.slow
def test_a_search_flies_what_its_budget_allows_and_comes_closer():
    law = Autopilot(name="now", parameters={"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7})
    search = MadeUpSearch(law)

    search.descend(
        [retune.Range("NPFG_PERIOD", 1.0, 100.0), retune.Range("NPFG_DAMPING", 0.1, 1.0)], 1000
    )

    generation = retune.POPULATION * search.draws
    assert 1000 - generation < search.flights <= 1000
    assert min(abs(period - 14.0) for period in search.asked) < 0.5


@pytest.mark.parametrize("stop_after", [0, 2, 3, 5])
def test_flights_of_several_plans_are_kept_and_none_is_flown_twice(plan, tmp_path, stop_after):
    other = replace(plan, campaign=plan.campaign.model_copy(update={"seed": 77}))
    plans, file = [plan.with_runs(3), other.with_runs(3)], tmp_path / "kept.jsonl"
    expected = [(x.campaign.seed, run) for x in plans for run in range(3)]
    flown = []
    first = KeptRows(file, {"start": 1}, flying(stop_after, flown))
    with pytest.raises(StoppedError) as stopped:
        [first.flown(x, {}) for x in plans]
    (name,) = stopped.value.kept
    file = Path(name)
    file.write_text(file.read_text() + '{"of": "half of a li')

    others = []  # another command takes none of them, and this one goes on without them
    asked = tmp_path / "kept.jsonl"
    assert len(KeptRows(tmp_path / "no.jsonl", {"start": 1}, flying(9, others))) == 0
    other_search = KeptRows(asked, {"start": 2}, flying(9, others))
    assert len(other_search) == 0
    other_search.remove()
    kept = KeptRows(asked, {"start": 1}, flying(9, flown))
    assert len(kept) == stop_after
    rows = [kept.flown(x, {}) for x in plans]
    assert flown == expected
    assert [[row["kept"][0] for row in x] for x in rows] == [[0.0, 1.0 / 3.0, 2.0 / 3.0]] * 2
    opened = shutil.copy(file, file.with_name(file.name.replace("kept", "open")))
    opened.chmod(0o666)  # anybody may have changed it
    assert len(KeptRows(tmp_path / "open.jsonl", {"start": 1}, flying(9, others))) == 0
    kept.remove()
    assert not file.exists()


@pytest.mark.soak
def test_a_killed_search_goes_on_and_is_the_same_to_the_bit(file, tmp_path, monkeypatch):
    monkeypatch.setattr(retune, "DRAWS", 1)
    monkeypatch.setattr(retune, "FINAL_DRAWS", 1)
    kept, said = tmp_path / "runs" / "kept.jsonl", tmp_path / "said"

    def search(most=math.inf, kept=None):
        options = {"flights": 2, "budget": 20, "kept": kept, "observer": Killer(said, most)}
        with seen_here():
            return ft.meet(ft.flights(bend_in_wind()), autopilot=file, **options)

    # the start and a generation have at most 9 flights
    assert in_child(lambda: search(11, kept), 60.0, 8 << 30) == "ended by SIGKILL"
    (file_of_it,) = kept.parent.glob("kept-*.jsonl")
    flown = len(file_of_it.read_text().splitlines())
    assert flown >= 11
    on, whole = search(kept=kept), search()

    assert said.read_text() == f"{file_of_it}: {flown} flights are flown already."
    assert on.answer().json() == whole.answer().json()
    assert on.changes
    assert not file_of_it.exists()
