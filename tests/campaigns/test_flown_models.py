"""Identified models that fly missions: as their lags, within the limits that are known of them."""

import json
import shutil

import pytest
from places import ROOT
from plans import plan_file, waypoint

import flighttune as ft

SHORT = waypoint(47.4, 8.5, 60), waypoint(47.402, 8.5, 60)
MODEL = ROOT / "aircraft" / "aerosonde" / "identified.json"


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    return plan_file(tmp_path_factory.mktemp("flown") / "short.plan", *SHORT)


@pytest.fixture(scope="module")
def mine(mission):
    """A model of the aircraft's own, in a file beside the mission."""
    return str(shutil.copy(MODEL, mission.with_name("mine.json")))


def test_a_model_of_a_log_flies_within_the_limits_that_the_log_showed(mission, mine, tmp_path):
    tables = json.loads(MODEL.read_text())
    shown = {"phi_deg": [-31.0, 33.0], "phi_rate_dps": 25.0, "n_z": [0.2, 1.6]}
    of_fits = {name: {} for name in ("frequency_95_rad_s", "delay_95_s", "stretches")}
    evidence = {"logs": ["flight.bin"], "assumed": [], "n_z_rate_per_s": 0.9}
    tables["log"] = evidence | shown | of_fits
    tables["aircraft"] = "an aircraft of which only a log is known"
    (tmp_path / "logged.json").write_text(json.dumps(tables))

    scenario = ft.flights(mission, aircraft=str(tmp_path / "logged.json")).scenario

    assert scenario.limits.phi_deg == (-31.0, 33.0)
    assert (scenario.limits.phi_rate_dps, scenario.limits.n_z_rate_per_s) == (25.0, 0.9)


@pytest.mark.soak
def test_a_model_flies_as_its_lags_in_wind_without_turbulence(mission, mine):
    stated = ft.flights(mission, aircraft=mine)

    (plant,) = stated.scenario.plant
    assert (plant.kind, plant.identified) == ("point_mass_lag", mine)
    assert any("lags" in note for note in stated.scenario.notes)
    assert stated.plan().campaign.central.turbulence is None
    assert [x.key for x in stated.campaign.disperse] == ["wind.speed_mps", "wind.from_deg"]
    # 45 deg, 30 deg/s, and -2.1 to 2.1 of aircraft/aerosonde/aircraft.toml
    limits = stated.scenario.limits
    assert limits.phi_deg == pytest.approx((-45.0, 45.0))
    assert limits.phi_rate_dps == pytest.approx(30.0)
    assert limits.n_z == (-2.1, 2.1)
