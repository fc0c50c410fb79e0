"""Speed has priority beside two channels: where thrust is short the path angle gives way."""

import math
import shutil

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT

import flighttune as ft

V_0 = 25.0

CALM = {"speed_mps": 0.0, "from_deg": 0.0}
WINDS = {"sinking air": CALM | {"down_mps": 3.0}, "head wind": {"speed_mps": 10.0, "from_deg": 0.0}}
FAULT = {"airframe": {"fault": {"from_s": 5.0, "throttle_factor": 0.01}}}


def level(plant, *, protected=True, duration_s=45.0, reference=None, **tables):
    """Level flight of an Aerosonde at 25 m/s that an engine fails in."""
    return ft.scenario_from(
        {
            "title": "level flight",
            "law": ["exact"],
            "gains": ["tuned_fed_back"],
            "flight": {"V_a_mps": V_0, "h_m": 1000.0, "duration_s": duration_s},
            "reference": reference or {"chi_deg": 0.0, "gamma_deg": 0.0},
            "controller": {"speed_priority": True} if protected else {},
            "tuning": {"identified": "aerosonde"},
            "plant": [{"kind": "jsbsim", "aircraft": "aerosonde", **plant}],
            **tables,
        }
    )


@pytest.mark.soak
@pytest.mark.parametrize(
    ("aircraft", "V_a"),
    [
        *(("aerosonde", 25.0), ("c172p", 50.0)),
        pytest.param("x8", 18.0, marks=pytest.mark.counts),
        pytest.param("a4", 200.0, marks=pytest.mark.counts),
    ],
)
def test_no_aircraft_is_lost_whose_engine_fails_in_light_turbulence(aircraft, V_a):
    for seed in range(2):
        air = {"turbulence": {"intensity": "light"}, "seed": seed}
        scenario = level({"aircraft": aircraft, **FAULT}, **air).as_dict()
        scenario["tuning"]["identified"] = aircraft
        scenario["flight"] |= {"V_a_mps": V_a, "h_m": 2500.0}

        (run,) = ft.fly(ft.scenario_from(scenario)).runs

        assert run.status == "completed", run.reason


@pytest.mark.soak
def test_a_healthy_aircraft_with_a_slow_engine_pays_little_for_its_protection():
    """At most 5 % of the ITAE of both angles, in turns at 35 deg of roll and light turbulence."""
    rate = math.degrees(9.81 * math.tan(math.radians(35.0)) / 50.0)
    turn = {"shape": "ramp", "roll_in_s": 3.5}
    turns = [
        turn | {"start_s": 6.0, "duration_s": 12.0, "rate_dps": rate},
        turn | {"start_s": 25.0, "duration_s": 18.0, "rate_dps": -rate},
    ]
    errors = []
    for protected in (False, True):
        for seed in range(2):
            air = {"turbulence": {"intensity": "light"}, "seed": seed}
            tables = level({"aircraft": "c172p"}, protected=protected, **air).as_dict()
            tables["tuning"]["identified"] = "c172p"
            tables["flight"] |= {"V_a_mps": 50.0, "duration_s": 55.0}
            tables["reference"] = {"chi_deg": turns, "gamma_deg": 0.0}
            (run,) = ft.fly(ft.scenario_from(tables)).runs
            measured = run.signals[["chi_err", "gamma_err"]].abs().to_numpy()
            errors.append(np.trapezoid(measured.T * run.t, run.t))
    without, kept = np.reshape(errors, (2, 2, 2))

    assert np.exp(np.log(kept / without).mean()) < 1.05


@pytest.mark.soak
def test_a_route_whose_height_is_given_up_is_flown_to_its_end():
    """Height given up for the airspeed is no failure to arrive; the notes say how much it was."""
    points = [{"north_m": north, "east_m": 0.0, "up_m": 0.0} for north in (0.0, 1500.0)]
    limits = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 30.0, "n_z": [-2.0, 2.0]}
    tables = level(FAULT, duration_s=120.0, wind=WINDS["sinking air"]).as_dict()
    del tables["reference"]
    tables |= {"route": {"waypoint": points}, "limits": limits}

    flown = ft.fly(ft.scenario_from(tables))

    (run,) = flown.runs
    assert run.status == "completed"
    below = run.signals["height_err"].max()
    assert below > 150.0  # beyond the look-ahead, within which a flight counts as arrived
    assert any(f"{below:.0f} m below the route" in note for note in flown.answer().notes)


@pytest.mark.soak
@pytest.mark.parametrize(("plant", "outside"), [(FAULT, True), ({}, False)])
def test_a_flight_that_gives_way_is_outside_of_what_was_counted_of_a_model(plant, outside):
    """The point mass behind lags knows no airspeed: its residual signals say nothing then."""
    own = level(plant, duration_s=12.0, law=["paper"], gains=["paper"])
    few = {"flights": 8, "learn": 10, "epsilon": 0.5, "confidence": 0.5, "air": "calm"}

    counted = ft.residual(own, plant="jsbsim:aerosonde", start_deg=1.0, **few)

    assert (np.isinf(counted.scores) == outside).all()


@pytest.fixture
def glider(tmp_path):
    """An Aerosonde whose engine is not counted."""
    folder = tmp_path / "glider"
    shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder)
    file = folder / "aircraft.toml"
    file.write_text(file.read_text().replace("[engines]\n", "[engines]\ncount = 0\n"))
    return str(folder)


def test_an_aircraft_without_an_engine_has_no_airspeed_to_protect_by_thrust(glider):
    with pytest.raises(ft.ScenarioError, match=r"\[controller\] `speed_priority` must be absent"):
        ft.fly(level({"aircraft": glider}))
