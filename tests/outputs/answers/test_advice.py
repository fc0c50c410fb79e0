"""What is said to try next where a requirement is missed: only what would help."""

import math
import re
from dataclasses import replace

import pytest
from made_up import made_up_scenario

import flighttune as ft

TURN = {"chi_deg": 60.0, "gamma_deg": 0.0}
RAMP = {"chi_deg": [{"shape": "ramp", "duration_s": 2.0, "rate_dps": 20.0}], "gamma_deg": 0.0}
BOTH = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
FEASIBLE, SLOWER, MEET = '`shape = "feasible"`', "`rate_dps`", "`flighttune meet"
IDENTIFIED, SCHEDULE = "`tuned_identified` in `gains`", "`schedule = true`"


def advised(flown):
    """What the answer of flights advises to try next, in a line."""
    return flown.answer().values["claim"]["next"]


@pytest.mark.parametrize(
    ("change", "bound", "said"),
    [
        ({"reference": TURN}, {"MO_deg": 1.0}, {FEASIBLE}),
        ({"reference": RAMP}, {"MO_deg": 0.1}, {SLOWER}),
        ({"plant": BOTH}, {"MO_deg": 2.5}, {MEET}),
        ({"flight": {"V_a_mps": 50.0, "duration_s": 20.0}}, {"MO_deg": 0.1}, {IDENTIFIED}),
        ({"flight": {"V_a_mps": 28.5, "duration_s": 5.0}}, {"MO_deg": 0.1}, set()),
        ({"flight": {"V_a_mps": 29.0, "duration_s": 5.0}}, {"MO_deg": 0.1}, {IDENTIFIED}),
        ({"flight": {"V_a_mps": 21.0, "duration_s": 5.0}}, {"MO_deg": 0.1}, {IDENTIFIED}),
        ({"reference": TURN}, {"MO_deg": 90.0}, set()),
    ],
    ids=["step", "ramp", "aircraft", "airspeed", "near", "faster", "slower", "met"],
)
def test_what_may_help_is_said_and_nothing_else(change, bound, said):
    tables = {
        "gains": ["paper"],
        "flight": {"V_a_mps": 25.0, "duration_s": 20.0},
        "reference": {"chi_deg": 5.0, "gamma_deg": 0.0},
        "limits": {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0},
        "controller": {"feed_forward": True},
        "expect": [{"at_most": {"chi": bound}}],
    }
    scenario = made_up_scenario(**(tables | change))

    line = advised(ft.fly(scenario))

    ways = (FEASIBLE, SLOWER, MEET, IDENTIFIED, SCHEDULE)
    assert {way for way in ways if way in line} == said
    assert line.count("\n") == 0
    assert bool(line) == bool(said)


@pytest.mark.parametrize(("law", "said"), [("paper", True), ("exact", False)])
def test_a_schedule_is_advised_to_laws_that_it_changes(law, said):
    tables = ft.load_scenario("speed_change_in_turn").as_dict()
    (gains,) = tables["gains"]
    never = [{"at_most": {"V": {"MO_mps": 1e-6}}}]
    tables |= {"law": [law], "gains": [gains | {"law": law}], "expect": never}
    scenario = ft.scenario_from(tables | {"plant": [{"kind": "kinematic"}]})

    assert (SCHEDULE in advised(ft.fly(scenario))) == said


# deg and m/s: to both sides of the steepest descent, and airspeeds that are held and that are not
BESIDE, HELD, LOST = 0.5, 0.3, 0.6


@pytest.mark.soak
def test_the_steepest_descent_that_can_be_held_is_that_of_flights():
    def descent(gamma):
        return made_up_scenario(
            gains=["paper"],
            flight={"V_a_mps": 25.0, "h_m": 900.0, "duration_s": 90.0},
            reference={"chi_deg": 0.0, "gamma_deg": gamma},
            plant=[{"kind": "jsbsim", "aircraft": "aerosonde"}],
            expect=[{"at_most": {"flight": {"V_a_dev_mps": 0.1}}}],
        )

    def strays(gamma):
        (run,) = ft.fly(descent(gamma)).runs
        return abs(run.signals["V_a"].iloc[-1] - 25.0)

    told = ft.fly(descent(-9.5)).answer()

    (note,) = (x for x in told.notes if "descends at 9.5 deg" in x)
    assert "speeds up with the throttle closed" in note
    steepest = float(re.search(r"up to ([\d.]+) deg", note)[1])
    assert strays(-steepest + BESIDE) < HELD
    assert strays(-steepest - BESIDE) > LOST
    assert "less steep" in told.verdict
    assert SCHEDULE not in told.verdict
    assert not [x for x in ft.fly(descent(-2.0)).answer().notes if "descends" in x]


SIGN = "mine:paper: the law turns away from the reference: is the sign of its output right?"
DEGREES = "mine:paper: its roll commands are more than half a turn: are they degrees?"


@pytest.mark.parametrize(
    ("roll_by", "pull_by", "line"),
    [(-1.0, 1.0, SIGN), (1.0, -1.0, SIGN), (180.0 / math.pi, 1.0, DEGREES), (1.0, 1.0, "")],
    ids=["roll the wrong way", "pull the wrong way", "degrees", "sound"],
)
def test_a_law_with_the_wrong_sign_or_in_degrees_gets_that_hint(roll_by, pull_by, line):
    class Mine:
        def __init__(self, setup):
            self.dt, self.signals = setup.dt, {}

        def start(self, condition):
            pass

        def step(self, measured, reference, t):
            e_chi = math.remainder(reference.chi - measured.chi, math.tau)
            lift = math.cos(measured.gamma) / math.cos(measured.phi)
            e_gamma = reference.gamma - measured.gamma
            return 1.5 * roll_by * e_chi, lift + 1.5 * pull_by * e_gamma

    expect = [{"at_most": {"chi": {"MO_deg": 1.0}}}]
    tables = ft.load_scenario("paper").as_dict() | {"gains": ["paper"], "expect": expect}
    scenario = ft.scenario_from(tables | {"plant": [{"kind": "kinematic"}]})
    flown = ft.fly(scenario, laws={"mine": Mine})
    runs = tuple(run for run in flown.runs if "mine" in run.label)

    found = advised(replace(flown, runs=runs))

    assert found == line if line else "mine" not in found


def test_a_flight_that_misses_requirements_names_the_first_and_the_number_of_the_others():
    bounds = {"MO_deg": 0.01, "ITAE": 1e-6, "peak_deg": 90.0, "ST_deg": 1e-9}
    tables = {
        "gains": ["paper"], "flight": {"duration_s": 9.0}, "reference": {"chi_deg": 5.0},
        "expect": [{"at_most": {"chi": bounds}}],
    }  # fmt: skip

    def said(**changes):
        return ft.fly(made_up_scenario(**tables | changes)).answer()

    missed = said()
    assert missed.failure == f"{missed.values['missed'][0]} (2 more)"
    assert len(missed.values["missed"]) == 3
    assert missed.status == 1
    one = said(expect=[{"at_most": {"chi": {"ITAE": 1e-6}}}])
    assert one.failure == one.values["missed"][0]
    met = said(expect=[{"at_most": {"chi": {"peak_deg": 90.0}}}])
    assert met.failure == ""
    assert met.verdict.startswith("1 of 1 requirement met. Tightest: ")
    assert "status" not in [column.key for column in met.tables[0].columns]
    assert met.values["claim"]["verdict"] == "met"


def test_the_gap_is_asked_of_the_gains_that_flew():
    notes = ft.fly("level_turn", ["K1"], changes={"flight.duration_s": 4.0}).answer().notes

    named = "level_turn --set flight.duration_s=4.0 --gains K1"
    assert f"Why aircraft and law differ: flighttune gap {named}" in notes
