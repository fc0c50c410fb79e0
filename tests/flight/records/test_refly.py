"""Flights that are flown again, of which any may differ."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run, made_up_scenario

import flighttune as ft
from flighttune.flight.records import refly


@pytest.mark.parametrize("different", [0, 1])
def test_one_flight_of_many_that_differs_is_told(different):
    plants = [{"kind": "kinematic"}, {"kind": "point_mass"}]
    runs = [*ft.fly(made_up_scenario(plant=plants, flight={"duration_s": 1.0})).runs]
    signals = runs[different].signals
    runs[different] = replace(runs[different], signals=signals.assign(chi=signals["chi"] + 1e-12))

    again = ft.refly(runs)

    assert [bool(run.differences) for run in again.runs] == [different == 0, different == 1]
    assert not again.equal
    assert runs[different].label in again.answer().failure


def test_a_flight_that_differs_by_the_sign_of_a_zero_is_not_equal_to_the_bit():
    (run,) = ft.fly(made_up_scenario(flight={"duration_s": 1.0})).runs
    zeros = run.signals["phi_limited"] == 0.0
    signs = run.signals["phi_limited"].where(~zeros, -0.0)

    again = ft.refly([replace(run, signals=run.signals.assign(phi_limited=signs))])

    assert zeros.any()
    assert not again.equal


def run(chi=(0.0, 1.0, 2.0), **changes):
    """Three samples, a second apart."""
    columns = {"chi": chi, "gamma": [0.0, math.nan, 0.5][: len(chi)]}
    return made_up_run(columns | changes.pop("columns", {}), np.arange(float(len(chi))), **changes)


def other_gains():
    K_P = ft.PAPER_GAINS.K_P.copy()
    K_P[1, 0] += 0.25
    return replace(ft.PAPER_GAINS, K_P=K_P)


K_10 = float(ft.PAPER_GAINS.K_P[1, 0])
DIFFERENT = [
    (run(), []),
    (run(columns={"alarm_score": [1.0, 2.0, 3.0]}), []),  # a monitor's, which is not repeated
    (run((0.0, 1.5, 7.0)), ["chi differs at t = 1 s: 1.0 recorded, 1.5 flown again"]),
    (
        run(columns={"gamma": [0.0, 0.25, 0.75]}),
        ["gamma differs at t = 1 s: nan recorded, 0.25 flown again"],
    ),
    (run((0.0, 1.0)), ["samples differs: 3 recorded, 2 flown again"]),
    (
        run(status="diverged", reason="t = 2 s."),
        [
            "status differs: completed recorded, diverged flown again",
            "reason differs:  recorded, t = 2 s. flown again",
        ],
    ),
    (run(columns={"phi": 0.0}), ["signals differs: others recorded, phi flown again"]),
    (run(gains=other_gains()), [f"K_P[1][0] differs: {K_10} recorded, {K_10 + 0.25} flown again"]),
    (run(gains=None), ["gains differs: found recorded, none flown again"]),
]


@pytest.mark.parametrize(("again", "said"), DIFFERENT)
def test_differences_are_said_of_gains_then_signals_then_the_end(again, said):
    assert [x.sentence for x in refly.differences(run(), again)] == said


def test_a_flight_without_samples_differs_by_their_number_alone():
    none = replace(run(), signals=run().signals.iloc[:0])

    assert [x.what for x in refly.differences(none, run())] == ["samples"]
    assert [*refly.differences(none, none)] == []
    both_none = replace(run(), provenance=replace(run().provenance, gains=None))
    assert [*refly.differences(both_none, both_none)] == []


def test_libraries_of_another_version_are_named_with_both():
    now = refly.library_versions()
    name = next(iter(now))

    assert refly.changed_versions(now) == {}
    assert refly.changed_versions({name: "0.1", "no-such-library": "2"}) == {
        name: ("0.1", now[name]), "no-such-library": ("2", "none"),
    }  # fmt: skip
