"""Identified models that fly missions: as their lags, within the limits that are known of them."""

import json
import math
import shutil

import pytest
from places import ROOT
from plans import plan_file, waypoint

import flighttune as ft
from flighttune.claims import counting
from flighttune.flight.load import LAGS_ALONE
from flighttune.studies.beside import lags_alone

SHORT = waypoint(47.4, 8.5, 60), waypoint(47.402, 8.5, 60)
MODEL = ROOT / "aircraft" / "aerosonde" / "identified.json"


@pytest.fixture(scope="module")
def mission(tmp_path_factory):
    return plan_file(tmp_path_factory.mktemp("flown") / "short.plan", *SHORT)


@pytest.fixture(scope="module")
def mine(mission):
    """A model of the aircraft's own, in a file beside the mission."""
    return str(shutil.copy(MODEL, mission.with_name("mine.json")))


@pytest.mark.slow
def test_a_model_flies_as_its_lags_in_wind_without_turbulence(mission, mine):
    stated = ft.flights(mission, aircraft=mine)

    (plant,) = stated.scenario.plant
    assert (plant.kind, plant.identified) == ("point_mass_lag", mine)
    assert LAGS_ALONE in stated.scenario.notes
    assert stated.plan().campaign.central.turbulence is None
    assert [x.key for x in stated.campaign.disperse] == ["wind.speed_mps", "wind.from_deg"]
    # 45 deg, 30 deg/s, and -2.1 to 2.1 of aircraft/aerosonde/aircraft.toml
    limits = stated.scenario.limits
    assert limits.phi_deg == pytest.approx((-45.0, 45.0))
    assert limits.phi_rate_dps == pytest.approx(30.0)
    assert limits.n_z == (-2.1, 2.1)


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "said"),
    [
        ({"kind": "point_mass_lag", "identified": str(MODEL)}, [LAGS_ALONE]),
        ({"kind": "jsbsim", "aircraft": "aerosonde"}, []),
    ],
)
def test_lags_of_a_model_are_said_where_they_fly(plant, said):
    source = ft.load_scenario("level_turn").as_dict()
    stated = ft.flights(ft.scenario_from(source | {"plant": [plant], "expect": []}))

    assert lags_alone(counting.drawn(stated)) == said


@pytest.mark.soak
def test_the_answers_say_that_lags_alone_were_flown(mission, mine, monkeypatch):
    monkeypatch.setattr("flighttune.claims.mission.LEARN", 10)
    # A better receiver needs no flights by RTK beside its own.
    few = {"epsilon": 0.3, "confidence": 0.9, "flights": 7, "workers": 1, "navigation": "rtk"}
    odds = ft.mission(mission, aircraft=mine, **few)

    said = odds.answer()
    assert said.summary[0].startswith("Yes: the mission can be flown")
    assert "turbulence" not in said.summary[-1]
    assert LAGS_ALONE in said.changed
    (mission.parent / "px4.params").write_text("# Version: 1.14.0\n1\t1\tNPFG_PERIOD\t10\t9\n")
    beside = ft.compare(
        mission, autopilot=mission.parent / "px4.params", aircraft=mine, flights=2, workers=1
    )
    assert beside.notes[0] == LAGS_ALONE
    assert all(math.isfinite(row["ours"]) for row in beside.accuracy)
    assert len(beside.margins) == 2
