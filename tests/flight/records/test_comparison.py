"""Comparisons of flights whose metrics and distances are known in closed form."""

import copy
import dataclasses
import math
from itertools import product

import pandas as pd
import pytest
from made_up import run_file

import flighttune as ft

TRAPEZOID = 1e-3
"""Relative error of the trapezoidal rule and of linear interpolation at 50 Hz."""

ONE_SAMPLE = 0.02
MICROMETRE = 1e-6


def value(found, name, channel="chi"):
    rows = found.metrics
    return rows[(rows["name"] == name) & (rows["channel"] == channel)].iloc[0]


def test_differences_of_exponential_errors_are_those_of_the_closed_forms(fly_line):
    found = ft.compare(fly_line(rate=0.5), fly_line(rate=2.0))

    def itae(a, T=20.0):
        return (1.0 - (1.0 + a * T) * math.exp(-a * T)) / a**2

    row = value(found, "ITAE")
    assert (row["a"], row["b"]) == pytest.approx((itae(0.5), itae(2.0)), rel=TRAPEZOID)
    assert row["diff"] == row["b"] - row["a"]
    assert row["better"] == "b"
    rise = value(found, "rise_s", "gamma")
    assert rise["diff"] == pytest.approx(math.log(9.0) * (1 / 2.0 - 1 / 0.5), rel=TRAPEZOID)
    settling = value(found, "settling_s")
    assert settling["diff"] == pytest.approx(math.log(20.0) * (1 / 2.0 - 1 / 0.5), abs=ONE_SAMPLE)


@pytest.mark.parametrize(
    ("flown", "distance"),
    [
        ({"offset": (3.0, 4.0, 12.0)}, 13.0),
        ({"drift": (0.0, 0.6, 0.8)}, 20.0),
        ({"dt": 0.05, "offset": (0.0, 0.0, 2.0)}, 2.0),
    ],
)
def test_the_largest_distance_is_that_of_pythagoras(fly_line, flown, distance):
    (pair,) = ft.compare(fly_line(), fly_line(**flown)).pairs

    assert pair.max_distance == pytest.approx(distance, abs=MICROMETRE)
    if "drift" in flown:
        assert pair.t_max_distance == 20.0


@pytest.mark.parametrize(
    ("table", "key", "got"),
    [
        ("flight", "V_a_mps", 30.0),
        ("flight", "duration_s", 40.0),
        ("reference", "chi_deg", 45.0),
        ("reference", "gamma_deg", [{"shape": "ramp"}]),
    ],
)
def test_another_manoeuvre_cannot_be_compared(fly_line, table, key, got):
    run = fly_line()
    scenario = copy.deepcopy(run.provenance.scenario)
    scenario[table][key] = got

    found = ft.compare(run, fly_line(scenario=scenario))

    assert not found.comparable
    assert "the manoeuvre must be the same" in found.reason
    assert f"`{table}.{key}`" in found.reason
    assert not len(found.metrics)
    assert math.isnan(found.max_distance)


def test_two_aircraft_cannot_be_compared_but_law_and_aircraft_can(fly_line):
    craft = fly_line(plant="jsbsim:aerosonde")

    assert ft.compare(fly_line(), craft).comparable
    refused = ft.compare(craft, fly_line(plant="jsbsim:c172p"))
    assert "the aircraft must be the same, got aerosonde and c172p" in refused.reason


def never_flown(run):
    nothing = pd.DataFrame(index=pd.Index([], name="t", dtype=float))
    return dataclasses.replace(run, signals=nothing, status="no_gains", reason="infeasible")


def test_a_run_that_never_flew_cannot_be_compared(fly_line):
    run = fly_line()

    assert "must have flown, got no_gains: infeasible" in ft.compare(run, never_flown(run)).reason


def test_a_run_cut_short_is_compared_over_the_time_both_flew(fly_line):
    found = ft.compare(fly_line(), fly_line(seconds=5.0, status="left_envelope"))

    assert found.comparable
    assert found.pairs[0].a.duration == found.pairs[0].b.duration == 5.0
    assert value(found, "ITAE")["diff"] == 0.0


def test_behind_an_at_sign_gains_or_plant_choose_among_the_runs_of_a_folder(fly_line, tmp_path):
    for plant, gains in product(("kinematic", "jsbsim:aerosonde"), ("paper", "K1")):
        run = fly_line(plant=plant, gains=gains)
        run_file(tmp_path / f"{plant[:3]}-{gains}.parquet", run)

    def chosen(*others):
        pairs = ft.compare(*(f"{tmp_path}@{name}" for name in others)).pairs
        return {run.label for pair in pairs for run in (pair.a, pair.b)}

    assert chosen("K1") == {"kinematic / K1", "jsbsim:aerosonde / K1"}
    assert chosen("kinematic") == {"kinematic / paper", "kinematic / K1"}
    assert chosen("kinematic / K1", "kinematic / K1") == {"kinematic / K1"}
    with pytest.raises(ft.RecordingError, match="'K9' must be"):
        chosen("K9")


def test_a_recording_is_the_same_as_the_files_of_its_runs(tmp_path):
    flown = ft.fly(ft.load_scenario("paper_as_printed"))
    files = ft.record(flown, tmp_path, name="printed")
    (signals,) = files.signals.values()

    for found in (ft.compare(files.recording, signals), ft.compare(tmp_path, flown)):
        assert found.comparable
        assert found.missing == ()
        assert found.max_distance == 0.0
        assert set(found.metrics["better"]) <= {"same", ""}
