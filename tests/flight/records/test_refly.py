"""Flights that are flown again, of which any may differ."""

import shutil
from dataclasses import replace

import pytest
from made_up import made_up_scenario

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


def test_a_folder_says_which_runs_of_its_flight_are_missing_and_what_is_of_another(tmp_path):
    made = made_up_scenario(gains=["paper", "K1", "K2"], flight={"duration_s": 0.2})
    other = made_up_scenario(gains=["K3"], flight={"duration_s": 0.2})
    ft.record(ft.fly(made), tmp_path / "a")
    ft.record(ft.fly(other), tmp_path / "b")
    first, second, third = (next((tmp_path / "a").glob(f"*{x}*.parquet")) for x in ("r", "1", "2"))
    (stranger,) = (tmp_path / "b").glob("*.parquet")
    names = [run.provenance.gains_name for run in ft.load(tmp_path / "a").runs]

    assert names == ["paper", "K1", "K2"]
    assert ft.load(tmp_path / "a").missing == ()
    second.unlink()
    one = ft.load(tmp_path / "a")
    assert [run.provenance.gains_name for run in one.runs] == ["paper", "K2"]
    assert "1 of 3 runs is missing" in one.lacks
    third.unlink()
    two = ft.load(tmp_path / "a")
    assert "2 of 3 runs are missing" in two.lacks
    assert [two.lacks in x for x in two.missing] == [True]
    assert two[two.runs[0].label].signals.equals(two.runs[0].signals)
    # the newest flight that is complete counts
    shutil.copy(stranger, tmp_path / "a" / "x.parquet")
    both = ft.load(tmp_path / "a")
    assert [run.provenance.gains_name for run in both.runs] == ["K3"]
    assert len(both.missing) == 1
    assert str(first) in both.missing[0]
