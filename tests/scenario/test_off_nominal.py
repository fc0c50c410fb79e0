"""[plant.airframe] and [sensors]: from keys to values, and what is refused."""

import math

import pytest
from made_up import scenario_tables

import flighttune as ft

DEG = math.pi / 180.0


def tables(airframe=None, sensors=None, **plant):
    plant = {"kind": "jsbsim", "aircraft": "aerosonde"} | plant
    plant |= {} if airframe is None else {"airframe": airframe}
    seen = {} if sensors is None else {"sensors": sensors}
    return scenario_tables(seed=4, flight={"duration_s": 0.2}, plant=[plant], **seen)


def test_sensors_are_in_radians_and_draw_from_the_seed_of_the_scenario():
    scenario = ft.scenario_from(
        tables(
            sensors={
                "chi_bias_deg": 1.0, "gamma_bias_deg": -2.0, "V_a_bias_mps": 0.5,
                "chi_noise_sd_deg": 0.1, "gamma_noise_sd_deg": 0.2, "V_a_noise_sd_mps": 0.3,
                "noise_time_constant_s": 0.4,
            }
        )
    )  # fmt: skip

    found = scenario.sensors.sensors(scenario.seed)

    assert found == ft.loop.Sensors(
        bias=(DEG, -2.0 * DEG, 0.5), noise_sd=(0.1 * DEG, 0.2 * DEG, 0.3), time_constant=0.4, seed=4
    )


REFUSED = [
    *(({"name": name}, r"\[plant\] `name`") for name in ("", "two words", "a:b", "a/b", "a[0]")),
    ({"airframe": {"mass_facto": 1.1}}, r"`mass_facto` is not .*did you mean `mass_factor`\?"),
    ({"airframe": {"coefficient_factors": {"Cm_alpha": -1.0}}}, r"`Cm_alpha` must be greater than"),
    ({"airframe": {}, "kind": "kinematic", "aircraft": None}, r"`airframe` must be given with"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_impossible_values_are_refused_by_table_and_key(change, message):
    given = tables(**change)
    given["plant"][0] = {k: v for k, v in given["plant"][0].items() if v is not None}

    with pytest.raises(ft.ScenarioError, match=message):
        ft.scenario_from(given)


@pytest.mark.parametrize("name", ["heavy", "v1.2+cg*", "größer"])
def test_a_plant_of_any_kind_may_have_a_name(name):
    given = tables(name=name)
    given["plant"].append({"kind": "kinematic", "name": name})

    scenario = ft.scenario_from(given)

    labels = [f"jsbsim:aerosonde:{name}", f"kinematic:{name}"]
    assert [plant.label for plant in scenario.plant] == labels
    assert ft.scenario_from(scenario.as_dict()) == scenario


OF_THE_AIRCRAFT = [
    ({"izz_factor": 1.5}, r"`izz_factor` must leave principal inertias"),
    ({"coefficient_factors": {"CM_alpha": 1.1}}, r"`coefficient_factors\.CM_alpha` .*Cm_alpha"),
]


@pytest.mark.parametrize(("airframe", "message"), OF_THE_AIRCRAFT)
def test_what_the_aircraft_cannot_be_is_refused_before_anything_flies(airframe, message):
    with pytest.raises(
        ft.ScenarioError, match=rf"^Straight on: \[plant\.airframe\] {message}"
    ) as got:
        ft.fly(ft.scenario_from(tables(airframe)))

    assert "\n" not in str(got.value)
