"""Flights that are flown again, of which any may differ."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run, made_up_scenario

import flighttune as ft


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
