"""What a scenario expects is held against what was flown, and said in one line each."""

import re

import numpy as np
import pytest
from made_up import made_up_run, made_up_scenario

import flighttune as ft

T = np.linspace(0.0, 10.0, 101)
OFF = np.deg2rad(2.0)
ZEROS = "gamma_err", "gamma_ref", "phi_cmd", "n_z_cmd", "phi_limited", "n_z_limited"


def claimed(expect, *flights):
    """The claim of a scenario about runs that are flown here, and its sentence."""
    made = {"gains": ["paper", "K5"]}
    if any("V_err" in flight for flight in flights):
        made = {"reference": {"V_mps": 25.0}, "limits": {"n_x": [-0.3, 0.3]}, "gains": ["tuned"]}
        made |= {"plant": [{"kind": "point_mass"}]}
    scenario = made_up_scenario(expect=[*expect], **made)
    runs = tuple(run(scenario, **flight) for flight in flights or ({},))
    found = ft.FlownScenario(scenario=scenario, runs=runs, indicators={})
    return found.claim, found.answer().values["claim"]["sentence"]


def run(scenario, *, gains="paper", status="completed", reason="", turn_deg=20.0, **columns):
    """An error of the course of 2 deg unless another is given; the course is to turn after 1 s."""
    made = dict.fromkeys(ZEROS, 0.0) | {"n_z": 1.0, "V_a": 25.0, "chi_err": OFF}
    made |= {"chi_ref": np.deg2rad(turn_deg) * (T >= 1.0)}
    return made_up_run(
        made | columns, T, gains_name=gains, status=status, reason=reason,
        scenario=scenario.as_dict(),
    )  # fmt: skip


SPEED = {"V_err": 0.0, "V_ref": 25.0 + 5.0 * (T >= 1.0), "n_x_cmd": 0.0, "n_x_limited": 0.0}
SWING = np.deg2rad(0.6 * np.cos(2.0 * np.pi * T))
SETTLE = {"settling_s": 5.0}
NONE = "got no value"
# A bound, the signals of the flight, and the numbers of the miss, or none.
BOUNDS = [
    ({"at_most": {"chi": {"peak_deg": 2.1}}}, {}, ()),
    ({"at_most": {"chi": {"peak_deg": 1.5}}}, {}, ("chi.peak_deg", "1.5, got 2 ", "by 0.5")),
    ({"at_least": {"flight": {"n_z_min": 1.3}}}, {"n_z": 1.2}, ("n_z_min", "1.3, got 1.2", "0.1)")),
    ({"at_most": {"flight": {"n_z_max": 1.2}}}, {"n_z": 1.2}, ()),
    # of 2 deg for 10 s: the integral of t |e| is 50 s^2 times 0.0349 rad
    ({"at_most": {"chi": {"ITAE": 1.0}}}, {}, ("chi.ITAE", "at most 1, got 1.745", "0.745")),
    ({"at_most": {"V": {"peak_mps": 1.0}}}, SPEED | {"V_err": 0.9 * np.cos(T)}, ()),
    ({"at_most": {"V": {"peak_mps": 0.5}}}, SPEED | {"V_err": 0.9 * np.cos(T)}, ("0.5, got 0.9",)),
    # 5 % of 3 deg and of the start beside it, a band of its own, and no change at all
    ({"at_most": {"chi": SETTLE}}, {"turn_deg": 3.0, "chi_err": SWING}, (NONE, "0.18 deg", "0.6")),
    ({"at_most": {"chi": SETTLE | {"band_deg": 0.5}}}, {"chi_err": SWING}, (NONE, "0.5 deg")),
    ({"at_most": {"chi": SETTLE | {"band_deg": 1.0}}}, {"chi_err": SWING}, ()),
    ({"at_most": {"chi": SETTLE}}, {"turn_deg": 0.0, "chi_err": SWING * (T > 0)},
     (NONE, "`band_deg`")),
    # from 2 deg the error is within 5 % of the change, 1 deg, after 4 s
    ({"at_most": {"chi": {"settling_s": 3.0}}},
     {"chi_err": np.deg2rad(np.where(T < 5.0, 2.0 * (T >= 1.0), 0.5))}, ("at most 3, got 4", "1)")),
]  # fmt: skip


@pytest.mark.parametrize(("bound", "columns", "missed"), BOUNDS)
def test_a_bound_is_met_or_missed_by_so_much(bound, columns, missed):
    claim, said = claimed([bound], columns)

    assert claim.verdict == ("not met" if missed else "met")
    assert len(claim.missed) == bool(missed)
    for word in missed:
        assert word in claim.missed[0]
        assert word in said


BOUND = {"at_most": {"flight": {"V_a_dev_mps": 9.0}}}
LOWER = {"at_least": {"gamma": {"ST_deg": 0.0}}}
MEAN = "(chi|gamma|V) does not follow .* at most ([0-9.]+) (deg|m/s), got ([0-9.]+)"
LATE = T >= 7.5


def late_by(deg):
    """Whole periods about a mean in the last quarter."""
    swing = np.where(LATE, np.deg2rad(deg + 9.0 * np.cos(2.0 * np.pi * T / 0.5)), 0.0)
    swing[-1] = np.deg2rad(deg)
    return {"chi_err": swing}


CLIMB = {"gamma_ref": np.deg2rad(5.0) * (T >= 1.0)}
FOLLOWS = [
    # a fifth of the change of 20 deg
    (late_by(3.9), [BOUND], None),
    (late_by(-3.9), [BOUND], None),
    (late_by(4.1), [BOUND], ("chi", "4", "4.1")),
    (late_by(-4.1), [BOUND], ("chi", "4", "4.1")),
    (late_by(20.0), [BOUND | {"status": "completed"}], ("chi", "4", "20")),
    (late_by(20.0), [{"status": "completed"}], None),
    (late_by(20.0), [], None),
    (late_by(20.0), [BOUND, {"at_least": {"chi": {"ST_deg": 0.0}}}], None),
    (late_by(20.0), [BOUND, LOWER], ("chi", "4", "20")),
    # the worst relative to what it is allowed; a degree is allowed always
    (late_by(4.1) | CLIMB | {"gamma_err": np.deg2rad(1.5) * LATE}, [BOUND], ("gamma", "1", "1.5")),
    (late_by(8.0) | CLIMB | {"gamma_err": np.deg2rad(1.5) * LATE}, [BOUND], ("chi", "4", "8")),
    (late_by(4.1) | CLIMB | {"gamma_err": np.deg2rad(1.5) * LATE}, [BOUND, LOWER],
     ("chi", "4", "4.1")),
    ({"turn_deg": 3.0, "chi_err": np.deg2rad(0.9) * LATE}, [BOUND], None),
    (SPEED | {"V_err": 1.2 * LATE}, [BOUND], ("V", "1", "1.2")),
    (SPEED | {"V_err": 0.9 * LATE}, [BOUND], None),
    # since the last change, where it is within the last quarter
    ({"chi_ref": np.deg2rad(20.0) * (T >= 8.5), "chi_err": np.deg2rad(9.0) * (T < 8.4)}, [BOUND],
     None),
    # against the path angle that is given, where thrust is short
    (CLIMB | {"gamma_err": np.deg2rad(4.0) * LATE, "gamma_given": np.deg2rad(1.0) * (T >= 1.0)},
     [BOUND], None),
]  # fmt: skip


@pytest.mark.parametrize(("columns", "expect", "missed"), FOLLOWS)
def test_a_flight_with_requirements_follows_its_reference_to_the_end(columns, expect, missed):
    claim, said = claimed(expect, {"chi_err": 0.0} | columns)

    assert len(claim.missed) == bool(missed)
    if missed:
        channel, most, _, got = re.search(MEAN, claim.missed[0]).groups()
        assert (channel, most) == missed[:2]
        assert float(got) == pytest.approx(float(missed[2]), rel=0.02)
        assert claim.total.met == claim.total.requirements  # that it follows is implied
        assert "1 of 1 run did not follow" in said


DIVERGED = {"status": "left_envelope", "reason": "t = 3 s: too slow."}
ENDED = {"status": "left_envelope"}
BOTH = {"at_most": {"chi": {"peak_deg": 1.0, "ITAE": 0.1}}}
MANY = {"chi": {"peak_deg": 2.1, "ITAE": 3.0, "MS_deg": 3.0, "ST_deg": 3.0, "saturation_s": 3.0}}
K5 = {"gains": "K5"}
# Requirements, flights, the verdict, what is counted (requirements, met, not flown, ended, strayed)
# and words of the sentence.
VERDICTS = [
    ([], [{}], "not tested", (0, 0, 0, 0, 0), ("[[expect]]", "1 of 1 run completed")),
    ([], [{}, K5], "not tested", (0, 0, 0, 0, 0), ("2 of 2 runs completed",)),
    ([], [{}, DIVERGED], "not tested", (0, 0, 0, 1, 0), ("1 of 2 runs ended early", "too slow")),
    ([ENDED], [DIVERGED], "met", (1, 1, 0, 0, 0), ("1 of 1 requirement met",)),
    ([ENDED], [{}], "not met", (1, 0, 0, 0, 0), ("must be left_envelope", "to its end")),
    ([ENDED, {"status": "completed"}], [{}, DIVERGED], "met", (2, 2, 0, 0, 0), ("2 of 2",)),
    ([{"at_most": MANY}], [{}], "met", (5, 5, 0, 0, 0), ("5 of 5", "chi.peak_deg", "2.1")),
    ([BOTH], [{}], "not met", (2, 0, 0, 0, 0), ("0 of 2", "2 missed", "peak_deg must")),
    ([BOTH], [{}, DIVERGED | K5], "not met", (4, 0, 2, 1, 0), ("2 not flown", "1 of 2 runs ended")),
    ([BOTH | ENDED | K5], [{}, DIVERGED | K5], "not met", (3, 1, 0, 0, 0), ("2 missed",)),
    ([BOTH | ENDED | K5], [{}, K5], "not met", (3, 0, 2, 0, 0), ("2 not flown",)),
    # gains that fly beside those that are judged may end early, where all requirements name gains
    ([{"at_most": {"chi": {"peak_deg": 1.0}}} | K5], [{}], "not tested", (0, 0, 0, 0, 0), ()),
    ([{"at_most": {"chi": {"peak_deg": 3.0}}} | K5], [K5, DIVERGED], "met", (1, 1, 0, 0, 0),
     ("1 of 1 requirement met",)),
    ([{"at_most": {"chi": {"peak_deg": 3.0}}} | K5, {"status": "completed"}], [K5, DIVERGED],
     "not met", (3, 2, 0, 0, 0), ()),
    # 2 deg is above a lower bound of 1 deg, which a poor flight meets, too
    ([{"at_least": {"chi": {"peak_deg": 1.0}}}], [{}], "met", (1, 1, 0, 0, 0),
     ("1 asks for a slow or poor flight", "at least 1, got 2")),
    ([{"at_least": {"chi": {"peak_deg": 1.0}}, "at_most": {"chi": {"peak_deg": 3.0}}}], [{}], "met",
     (2, 2, 0, 0, 0), ("2 of 2 requirements met. Tightest",)),
    ([{"at_least": {"flight": {"n_z_max": 0.5}}}], [{}], "met", (1, 1, 0, 0, 0), ("met. Tight",)),
    ([BOUND], [late_by(20.0), late_by(20.0) | K5], "not met", (2, 2, 0, 0, 2),
     ("2 of 2 runs did not follow",)),
]  # fmt: skip


@pytest.mark.parametrize(("expect", "flights", "verdict", "counts", "words"), VERDICTS)
def test_every_requirement_is_met_or_missed_or_was_not_flown(
    expect, flights, verdict, counts, words
):
    claim, said = claimed(expect, *flights)

    assert claim.verdict == verdict
    assert claim.total == counts
    assert [word for word in words if word not in said] == [], said
    assert ("poor flight" in said) == ("1 asks for a slow or poor flight" in words)
    assert len(claim.lower) == ("poor flight" in said)


@pytest.mark.parametrize(
    ("sense", "bound", "value", "margin"),
    [("at_least", -2.0, -3.0, 0.5), ("at_most", 4.0, 3.0, -0.25), ("at_most", 0.0, 3.0, 3.0)],
)
def test_a_margin_is_relative_to_the_size_of_its_bound(sense, bound, value, margin):
    bounds = {sense: {"flight": {"n_z_min": bound}}}

    claim, _ = claimed([bounds], {"chi_err": 0.0, "n_z": value})

    assert claim.bounds[0].margin == margin
    assert claim.bounds[0].met == (margin <= 0.0)


def test_the_tightest_of_all_bounds_is_told_first():
    expect = [{"at_most": {"chi": {"ITAE": 1.8}, "gamma": {"peak_deg": 1.0}}}]

    _, said = claimed(expect)

    assert "Tightest: " in said
    assert "chi.ITAE must be at most 1.8, got 1.745" in said.partition("Tightest")[2]
