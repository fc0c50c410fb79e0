"""Scenario files: what is read, and the one line that says what is wrong."""

import math
import pickle
import re
import shutil

import numpy as np
import pytest
from made_up import made_up_scenario, scenario_file, scenario_tables
from places import SHIPPED_AIRCRAFT
from plans import item, plan_file, waypoint

import flighttune as ft

ROUNDING = 1e-12


@pytest.fixture
def tables():
    return ft.load_scenario("paper").as_dict()


def test_a_rate_may_be_a_range(tables):
    tables["limits"]["phi_rate_dps"] = [-10.0, 20.0]
    limits = ft.scenario_from(tables).limits.limits()

    assert limits.rate_lower[0] == pytest.approx(math.radians(-10.0))
    assert limits.rate_upper[0] == pytest.approx(math.radians(20.0))


def test_a_scenario_cannot_be_changed():
    with pytest.raises(ValueError, match="frozen"):
        ft.load_scenario("paper").seed = 2  # pyright: ignore[reportAttributeAccessIssue]


def test_of_many_mistakes_five_are_told_and_the_rest_counted(tables):
    tables["flight"].update({f"key{i}": i for i in range(8)})

    with pytest.raises(ft.ScenarioError, match=r"; and 3 more\.$") as caught:
        ft.scenario_from(tables)

    assert str(caught.value).count("is not a known key") == 5
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1]", r"must hold one object, got list"),
        ('{"K_P": [[1, 0], [0, 1]]}', r"`K_I` must be given"),
        ('{"K_P": [[1, 0]], "K_I": [[1, 0], [0, 1]]}', r"`K_P` must have 2 rows"),
    ],
)
def test_gains_that_cannot_be_read_get_one_line(text, message, tmp_path):
    path = tmp_path / "gains.json"
    path.write_text(text)

    with pytest.raises(ft.ScenarioError, match=message) as caught:
        ft.load_gains(path)

    assert str(caught.value).startswith(f"{path}: ")


def test_a_scenario_keeps_its_aircraft_but_does_not_send_it_to_workers():
    scenario = ft.load_scenario("paper")
    table = scenario.aircraft[0]

    copy = pickle.loads(pickle.dumps(scenario))

    assert table.config is table.config
    assert "config" not in vars(copy.aircraft[0])  # its files may lie elsewhere there
    assert copy == scenario
    assert copy.aircraft[0].config == table.config


def test_a_path_angle_beyond_the_vertical_that_is_never_reached_is_flown():
    steep = [{"shape": "ramp", "start_s": 0.3, "duration_s": 60.0, "rate_dps": 10.0}]

    made_up_scenario(flight={"gamma_deg": 87.0, "duration_s": 0.4}, reference={"gamma_deg": steep})


@pytest.mark.parametrize(
    ("duration", "rate", "flown"), [(3.0, 1.5, 8 / 3), (0.05, 50.0, 0.04), (10.0, 7.3, 10.0)]
)
def test_a_duration_that_is_no_whole_number_of_samples_is_said(duration, rate, flown):
    scenario = made_up_scenario(flight={"duration_s": duration}, controller={"rate_hz": rate})
    (run,) = ft.fly(scenario).runs

    assert run.duration == pytest.approx(flown)
    (note,) = scenario.notes if flown != duration else ("",)
    assert note.endswith(f"{flown:.6g} s are flown" if note else "")


def test_a_scenario_made_in_python_is_refused_by_its_title_when_it_is_flown():
    plants = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
    scenario = made_up_scenario(flight={"V_a_mps": 250.0}, plant=plants)

    with pytest.raises(ft.ScenarioError, match=r"^Straight on: .*`V_a_mps`.*15 to 45"):
        ft.fly(scenario)


def test_sensors_are_in_radians_and_draw_from_the_seed_of_the_scenario():
    errors = {
        "chi_bias_deg": 1.0, "gamma_bias_deg": -2.0, "V_a_bias_mps": 0.5, "chi_noise_sd_deg": 0.1,
        "gamma_noise_sd_deg": 0.2, "V_a_noise_sd_mps": 0.3, "noise_time_constant_s": 0.4,
    }  # fmt: skip
    found = made_up_scenario(seed=4, sensors=errors).sensors_on("kinematic")

    bias, noise = np.deg2rad([1.0, -2.0]), np.deg2rad([0.1, 0.2])
    assert found.bias == pytest.approx((*bias, 0.5), rel=ROUNDING)
    assert found.noise_sd == pytest.approx((*noise, 0.3), rel=ROUNDING)
    assert (found.time_constant, found.seed) == (0.4, 4)


@pytest.mark.parametrize("name", ["heavy", "v1.2+cg*", "größer"])
def test_a_plant_of_any_kind_may_have_a_name(name):
    plants = [{"kind": "jsbsim", "aircraft": "aerosonde"}, {"kind": "kinematic"}]
    scenario = made_up_scenario(plant=[plant | {"name": name} for plant in plants])

    labels = [f"jsbsim:aerosonde:{name}", f"kinematic:{name}"]
    assert [plant.label for plant in scenario.plant] == labels
    assert ft.scenario_from(scenario.as_dict()) == scenario


def test_a_list_that_is_none_is_refused_with_the_file(tmp_path):
    file = scenario_file(tmp_path / "own.toml", made_up_scenario(), gains="paper")

    with pytest.raises(ft.ScenarioError, match=r"own\.toml: `gains` must be"):
        ft.load_scenario(file)


def test_a_scenario_names_each_file_of_its_code_once():
    own = {"kind": "python", "module": "mine.py", "class": "Mine"}
    tables = scenario_tables(
        law=[{"name": "first", **own}, {"name": "second", **own}],
        plant=[{"name": "glider", **own, "module": "glider.py"}],
    )

    scenario = ft.Scenario(**tables)

    assert scenario.code == ("mine.py", "glider.py")
    assert [key for key, _ in scenario.of_files()] == ["law", "law", "plant"]
    assert [table.name for _, table in scenario.of_files(["second"])] == ["second"]
    assert made_up_scenario().code == ()


@pytest.fixture
def steady(tmp_path):
    """An Aerosonde whose law is given no thrust to command."""
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "steady")
    file = folder / "aircraft.toml"
    file.write_text(re.sub(r"(?m)^n_x.*\n", "", file.read_text()))
    return str(folder)


# Airspeeds that a plan states behind its first waypoints, and values set by key; then the airspeed
# of the flight, whether gains are scheduled, whether the route holds airspeeds, and is assumed one.
MISSIONS = [
    ((), {}, 25.0, False, None, True),
    ((27.0, 22.0), {}, 27.0, True, True, None),
    ((22.0, 27.0), {}, 22.0, True, True, None),
    ((22.0,), {}, 22.0, False, None, None),
    ((27.0,), {"flight.V_a_mps": 24.0}, 24.0, False, None, None),
]


def mission(folder, speeds, aircraft, changes):
    """The scenario of a plan of three points, with changes of airspeed on the way."""
    items, points = [waypoint(47.4, 8.5, 80)], [(47.41, 8.5), (47.42, 8.51)]
    for place, speed in zip(points, (*speeds, None, None), strict=False):
        items += [item(178, 0, speed, -1, 0, 0, 0, 0, frame=2)] * (speed is not None)
        items.append(waypoint(*place, 80))
    file = plan_file(folder / "way.plan", *items)
    return ft.route(file, aircraft=aircraft, changes=changes).scenario


@pytest.mark.parametrize(("speeds", "changes", "V_a", "scheduled", "holds", "assumed"), MISSIONS)
def test_a_mission_is_flown_at_the_airspeeds_that_its_file_states(
    tmp_path, speeds, changes, V_a, scheduled, holds, assumed
):
    made = mission(tmp_path, speeds, "aerosonde", changes)

    assert made.flight.V_a_mps == V_a
    assert (made.controller.schedule, made.controller.feed_forward) == (scheduled, True)
    assert made.controller.speed_priority is True
    assert (made.route.holds_airspeed or None) == (holds or None)
    assert (made.route.airspeed_assumed or None) == assumed
    assert [made.title, *made.gains, made.flight.h_m] == ["way", "tuned_fed_back", 560.0]
    assert [plant.label for plant in made.plant] == ["jsbsim:aerosonde"]


def test_a_mission_of_an_aircraft_that_holds_its_airspeed_is_flown_at_the_fastest(steady, tmp_path):
    slow_first = mission(tmp_path, (22.0, 27.0), steady, {})

    assert slow_first.flight.V_a_mps == 27.0
    assert not slow_first.route.holds_airspeed
    assert not slow_first.controller.schedule


def test_a_mission_of_a_model_flies_its_lags_within_the_limits_of_its_aircraft(tmp_path):
    model = str(SHIPPED_AIRCRAFT / "aerosonde/identified.json")
    own = ft.loop.JSBSimPlant("aerosonde").limits

    made = mission(tmp_path, (), model, {})

    assert made.plant[0].kind == "point_mass_lag"
    limits = made.limits.limits()
    for name in ("lower", "upper", "rate_lower", "rate_upper"):
        assert getattr(limits, name) == pytest.approx(getattr(own, name))
    assert any("lags of an identified model" in note for note in made.route.notes)
