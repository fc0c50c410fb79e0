"""A flight in steady wind starts along its course over ground, trimmed in the moving air."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft

SPEED = 8.0

CHI = math.radians(10.0)


LIMITS = {"phi_deg": [-45.0, 45.0], "n_z": [-2.1, 2.1]}
LAW = {"kind": "kinematic"}


def windy(from_deg, plants, *, speed=SPEED, down=0.0, **flight):
    start = {"h_m": 500.0, "chi_deg": 10.0, "duration_s": 2.0, **flight}
    return made_up_scenario(
        flight=start,
        plant=plants,
        limits=LIMITS,
        reference={"chi_deg": start["chi_deg"], "gamma_deg": start.get("gamma_deg", 0.0)},
        controller={"feed_forward": True},
        wind={"speed_mps": speed, "from_deg": from_deg, "down_mps": down},
    )


def through_air(now, from_deg, down=0.0):
    """Velocity over ground less that of the wind, m/s in NED; V_g is level."""
    level = now["V_g"]
    blows = math.radians(from_deg + 180.0)
    return np.array(
        [
            level * math.cos(now["chi"]) - SPEED * math.cos(blows),
            level * math.sin(now["chi"]) - SPEED * math.sin(blows),
            -level * math.tan(now["gamma"]) - down,
        ]
    )


@pytest.mark.parametrize("kind", ["kinematic", "point_mass", "point_mass_lag"])
@pytest.mark.parametrize("start", ["course", "heading"])
def test_a_point_mass_starts_along_its_course_or_with_its_nose_there(kind, start):
    lags = {"roll_lag_rad_s": 4.0, "n_z_lag_rad_s": 8.0} if kind == "point_mass_lag" else {}
    table = {"kind": kind, **lags}

    (run,) = ft.fly(windy(100.0, [table], gamma_deg=20.0, start=start)).runs

    now = run.signals.iloc[0].to_dict()
    level = 25.0 * math.cos(math.radians(20.0))
    drift = 0.0 if start == "course" else -math.atan2(SPEED, level)
    assert now["chi"] == pytest.approx(CHI + drift, abs=1e-12)
    assert np.linalg.norm(through_air(now, 100.0)) == pytest.approx(25.0)
    if start == "course":
        assert now["gamma"] == pytest.approx(math.radians(20.0), abs=1e-12)


@pytest.mark.parametrize("wind", [None, {"speed_mps": 0.0, "from_deg": 70.0}])
@pytest.mark.parametrize("plant", [LAW, {"kind": "jsbsim", "aircraft": "aerosonde"}])
def test_in_calm_air_both_starts_are_one_to_the_bit(wind, plant):
    calm = {} if wind is None else {"wind": wind}
    on_course, by_heading = (
        ft.fly(scenario).runs[0].signals
        for start in ("course", "heading")
        for scenario in [
            made_up_scenario(
                flight={"gamma_deg": 7.0, "chi_deg": 33.0, "duration_s": 2.0, "start": start},
                plant=[plant], limits=LIMITS, **calm,
            )
        ]
    )  # fmt: skip

    assert on_course.to_numpy().tobytes() == by_heading.to_numpy().tobytes()


class Still(ft.loop.PointMassPlant):
    """A plant of the user's that knows no wind."""


def test_a_plant_that_shows_no_wind_starts_as_the_scenario_states():
    scenario = windy(100.0, [LAW])

    flown = ft.fly(scenario, plants={"own": Still})

    now = flown["own / paper"].signals.iloc[0]
    assert not {"wind_north"} & {*now.index}
    assert {*ft.loop.COMMON_SIGNALS} <= {*now.index}
    assert now["chi"] == pytest.approx(CHI, abs=1e-15)


def test_a_recording_from_before_the_key_is_flown_again_as_it_was():
    # a wind that no course can be held in
    (run,) = ft.fly(windy(100.0, [LAW], speed=30.0, start="heading")).runs
    tables = dict(run.provenance.scenario)
    tables["flight"] = {k: v for k, v in tables["flight"].items() if k != "start"}
    older = ft.Run(
        signals=run.signals, status=run.status, reason=run.reason,
        provenance=replace(run.provenance, scenario=tables),
    )  # fmt: skip

    assert ft.refly([older]).equal
