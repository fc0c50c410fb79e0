"""What a command does at its limits to the end is said, and judged where it swings between them."""

import math

import pytest
from made_up import made_up_scenario

import flighttune as ft
from flighttune.flight import metrics
from flighttune.outputs.answers.verdict import sentence

WANTED = [{"at_most": {"chi": {"peak_deg": 90.0}, "gamma": {"peak_deg": 90.0}}}]
LIMITS = {"phi_deg": [-40.0, 40.0], "phi_rate_dps": 40.0, "n_z": [0.5, 2.0], "n_z_rate_per_s": 1.0}
TURN = {"reference": {"chi_deg": 10.0, "gamma_deg": 0.0}, "flight": {"duration_s": 20.0}}


class Flips:
    """A law that flies straight on, but for one command, which it turns back after each `every`."""

    dt, signals = 0.02, {}

    def __init__(self, setup, command, every, size):
        self._place, self._every, self._size = command, every, size

    def start(self, condition):
        self._k = 0

    def step(self, measured, reference, t):
        self._k += 1
        commands = [
            -1.5 * (measured.chi - reference.chi),
            math.cos(measured.gamma) - measured.gamma,
        ]
        commands[self._place] += self._size * (-1.0) ** (self._k // self._every)
        return commands


def flown(command, every, size, **changes):
    tables = {**TURN, "limits": LIMITS, **changes}
    scenario = made_up_scenario(expect=WANTED, **tables)
    law = {"flips": lambda setup: Flips(setup, command, every, size)}
    tables = scenario.as_dict() | {"law": [{"name": "flips", "kind": "python"}]}
    return ft.fly(ft.scenario_from(tables), laws=law)


SWINGING = {
    "load factor, each sample, by its rate": (1, 1, 5.0, "n_z_cmd", {}),
    "roll, each sample, by its rate": (0, 1, 9.0, "phi_cmd", {}),
    "roll, each sample, by its range": (0, 1, 9.0, "phi_cmd", {"limits": {"phi_deg": [-1.0, 1.0]}}),
    "load factor, each fifth of a second": (1, 10, 0.3, "n_z_cmd", {}),
}


@pytest.mark.parametrize("case", SWINGING)
def test_a_command_that_swings_between_its_limits_meets_nothing(case):
    place, every, size, command, changes = SWINGING[case]

    found = flown(place, every, size, **changes)

    assert found.claim.verdict == "not met"
    (sentence,) = found.claim.missed
    assert found.claim.held == ()
    assert f"{command} swings between its limits to the end" in sentence
    assert found.answer().failure == sentence
    assert sentence in found.answer().values["claim"]["sentence"]


@pytest.mark.parametrize(
    ("turned_back", "each", "calm", "judged"),
    [
        (3, 0.01, True, True),
        (2, 0.01, True, False),
        (9, 0.5, False, False),
        (900, 0.2, False, False),
        (9, 0.9, False, True),
    ],
)
def test_in_moving_air_only_a_command_that_turns_back_in_most_samples_is_judged(
    turned_back, each, calm, judged
):
    assert metrics.swings({"swings": turned_back, "swings_each": each}, calm=calm) is judged
    assert not metrics.swings({}, calm=calm)


def test_a_turn_at_the_limit_of_roll_to_its_end_is_met_and_said():
    turn = {"shape": "ramp", "start_s": 1.0, "duration_s": 30.0, "rate_dps": 9.0}
    scenario = made_up_scenario(
        reference={"chi_deg": [turn], "gamma_deg": 0.0},
        flight={"V_a_mps": 25.0, "duration_s": 20.0},
        limits={"phi_deg": [-21.0, 21.0]},
        expect=[{"at_most": {"gamma": {"peak_deg": 5.0}}}],
        gains=[{"name": "firm", "K_P": [[4.0, 0.0], [0.0, 4.0]], "K_I": [[0.1, 0.0], [0.0, 0.5]]}],
    )

    found = ft.fly(scenario)

    (said,) = found.claim.held
    assert "phi_cmd is at its magnitude limit in 100 % of the last quarter" in said
    assert said in sentence(found.claim)
    assert not any("swings" in sentence for sentence in found.claim.missed)


def test_the_shares_at_limits_are_counted_of_flight_and_last_quarter():
    found = flown(1, 1, 5.0)
    run = found.runs[0]

    shares = metrics.at_limits(run)["n_z"]

    held = run.signals["n_z_limited"].to_numpy() == 2
    late = run.t >= 0.75 * run.t[-1]
    assert shares["rate"] == pytest.approx(held.mean())
    assert shares["rate_end"] == pytest.approx(held[late].mean())
    assert found.answer().values["runs"][0]["at_limits"]["n_z"] == shares


def test_gains_that_make_a_command_swing_meet_nothing(tmp_path):
    """Beyond K_P dt = 2 the sampled loop of a plant without lag is unstable: limits end it."""
    scenario = made_up_scenario(
        law=["exact"], expect=WANTED, limits=LIMITS, tuning={"model": "kinematic"}, **TURN
    )
    steep = ft.PIGains.from_lists([[1.0, 0.0], [0.0, 150.0]], [[0.1, 0.0], [0.0, 0.1]], law="exact")

    found = ft.meet(scenario, start=steep, budget=1)

    assert found.status == "missed"
    assert any("n_z_cmd swings" in row["why"] for row in found.requirements)
