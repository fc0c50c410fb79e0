"""Declared rates of faults, flights that leave a volume, and the claim per flight hour."""

import json
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft
from flighttune.base.errors import InputError, ScenarioError
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.claims import counting
from flighttune.claims.per_hour import PerHour, Volume, check_rates, count_per_hour, load_per_hour
from flighttune.claims.rates_keys import RatesTable, load_rates

FAULT = 'kind = "engine"\nper_hour = 1e-3\nsource = "a log"\n'
STUCK = 'kind = "rudder_stuck"\nper_hour = 1e-3\nsource = "a log"\n'

# A straight route of 300 m, 10 s of flight.
SHORT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}


@pytest.mark.parametrize(
    ("fault", "line"),
    [
        (FAULT.replace("engine", "wing"), r"`kind` must be one of engine, aileron_stuck"),
        (FAULT.replace("per_hour", "rate"), r"`rate`"),
        (FAULT.replace("1e-3", "1.5"), r"`per_hour` must be less than or equal to 1, got 1.5"),
        (FAULT.replace('source = "a log"\n', ""), r"`source`"),
        (FAULT + "factor = [2.0, 4.0]\n", r"`factor` must be absent for the fault engine"),
        (FAULT + "detected_s = 3.0\nended_s = 2.0\n", r"`ended_s` must be at least `detected_s`"),
        (FAULT + "detected_s = 3.0\n", r"`ended_s` must be given beside `detected_s`"),
        (FAULT.replace("engine", "receiver_jump"), r"`jump_m` must be given for the fault"),
    ],
)
def test_a_bad_fault_is_refused_in_one_line(tmp_path, fault, line):
    file = tmp_path / "rates.toml"
    file.write_text(f"[[fault]]\n{fault}")
    with pytest.raises(ScenarioError, match=line) as refused:
        load_rates(file)
    assert "\n" not in str(refused.value)
    assert str(file) in str(refused.value)


def rates(**fault):
    stated = {"kind": "engine", "per_hour": 0.1, "source": "a log", "flights": 6, **fault}
    return RatesTable.model_validate({"flights": 8, "fault": [stated]})


def short_plan():
    stated = ft.flights("circuit_in_wind", changes=SHORT).knowing(None)
    return counting.drawn(stated, None, None, None, None)


def test_an_aircraft_without_a_rudder_cannot_have_it_stuck():
    stated = ft.flights("circuit_in_wind_x8").knowing(None)
    plan = counting.drawn(stated, None, None, None, None)
    with pytest.raises(InputError, match="rudder_stuck: it has no rudder"):
        check_rates(plan, rates(kind="rudder_stuck"))


def test_a_surface_cannot_be_stuck_beyond_its_travel():
    with pytest.raises(InputError, match=r"`stuck_deg` of aileron_stuck must lie in the travel"):
        check_rates(short_plan(), rates(kind="aileron_stuck", stuck_deg=[0.0, 40.0]))


def box(half):
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    return Volume(rings=(corners,), outside=(False,), low=None, high=50.0)


def test_margins_are_distances_to_the_sides_and_the_top():
    places = np.array([[0.0, 0.0, 0.0], [90.0, 0.0, 60.0], [120.0, 0.0, 0.0]])
    assert box(100.0).margins(places)[:, :2] == pytest.approx(
        np.array([[100.0, 50.0], [10.0, -10.0], [-20.0, 50.0]])
    )


@pytest.mark.slow
def test_flights_in_a_wide_volume_stay_and_in_a_narrow_one_all_leave(tmp_path):
    wide, narrow = (
        count_per_hour(short_plan(), rates(), box(half), confidence=0.9, fliers=Fliers(workers=1))
        for half in (1e4, 100.0)
    )
    # From the middle of the box, the route of 300 m leaves it after 100 m: 3.0 to 6.0 s at 25 m/s
    # over ground in up to 8 m/s of wind.
    assert wide.terms[0].count.outside == 0
    assert narrow.terms[0].count.outside == 8
    assert all(3.0 < left < 6.0 for left in narrow.terms[0].left_s)
    assert narrow.bound.total > wide.bound.total

    file = tmp_path / "hours.json"
    narrow.save(file)
    loaded = load_per_hour(file)
    assert loaded.bound == narrow.bound
    assert ft.verify(file, count=2, workers=1).valid

    stated = json.loads(file.read_text())
    stated["terms"][0]["left_s"] = [-1.0] * 8
    file.write_text(json.dumps(stated))
    verified = ft.verify(file, count=8, workers=1)
    assert not verified.valid
    assert "healthy flight must be as JSBSim flies it again" in verified.reason


def test_flights_fewer_than_stated_are_refused(tmp_path):
    file = Path(tmp_path, "hours.json")
    claim = dict.fromkeys(("rates", "confidence", "plan", "volume", "terms", "later"))
    claim |= {"format": PerHour.FORMAT, "units": dict(PerHour.UNITS), "confidence": 0.9}
    claim |= {"rates": rates().model_dump(mode="json", exclude_none=True), "plan": {}, "later": []}
    claim |= {"volume": {"rings": [], "outside": [], "low": None, "high": None}}
    claim["terms"] = [{"fault": None, "ended_s": None, "left_s": [-1.0], "end_s": [9.0]}]
    file.write_text(json.dumps(claim))
    with pytest.raises(ScenarioError, match="`terms` must be the flights that `rates` states"):
        load_per_hour(file)
