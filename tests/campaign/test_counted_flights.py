"""Flights that can be counted: of one air, drawn at random, and which scenario is one of them."""

import pytest
from dispersed import AEROSONDE, SOFT, TURBULENCE, WIND, plan_of, tables_of, uniform

import flighttune as ft
from flighttune.campaign.counted_flights import air_of, at_random, distribution_of, in_air

START = uniform("flight.chi_deg", -5.0, 5.0), uniform("flight.gamma_deg", 3.0, 7.0)


def small_campaign(**tables):
    return plan_of(tables_of((AEROSONDE,), **{"gains": [SOFT], **tables}), *START).campaign


def test_a_wind_that_is_drawn_may_be_stated():
    plan = ft.plan_campaign(ft.load_campaign("light_turbulence"))
    (plant,) = plan.scenario.plant
    known = distribution_of(plan.campaign, plant.label)

    def difference(**wind):
        scenario = ft.scenario_from({**plan.scenario.as_dict(), "wind": wind})
        return known.difference(scenario, plant)

    assert known.windy
    assert difference(speed_mps=0.0, from_deg=30.0) is None
    assert "`wind.speed_mps` must be 0 to 8, got 9.0" in difference(speed_mps=9.0, from_deg=30.0)
    assert "`wind.down_mps` must be 0.0" in difference(speed_mps=3.0, from_deg=30.0, down_mps=1.0)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"flight": {"V_a_mps": 26.0}}, "`flight.V_a_mps` must be 25.0, got 26.0"),
        ({"flight": {"chi_deg": 9.0}}, "`flight.chi_deg` must be -5 to 5, got 9"),
        ({"limits": {"n_z_rate_per_s": 1.0}}, "`limits.n_z_rate_per_s` must be "),
        ({"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, "`wind.speed_mps` must be None, got 3.0"),
    ],
)
def test_flights_that_differ_are_told_by_key(change, key):
    campaign = small_campaign()
    tables = campaign.central.as_dict()
    tables["flight"] |= {"chi_deg": 0.0, "gamma_deg": 5.0}
    (plant,) = campaign.nominal.plant
    known = distribution_of(campaign, plant.label)

    assert known.difference(ft.scenario_from(tables), plant) is None
    changed = {name: {**tables.get(name, {}), **values} for name, values in change.items()}
    assert key in known.difference(ft.scenario_from(tables | changed), plant)


def test_air_is_taken_apart():
    campaign = small_campaign(wind=WIND, turbulence=TURBULENCE)
    words = small_campaign(wind=WIND, turbulence={"intensity": "light"})

    assert air_of(campaign.central).startswith("severity")
    assert air_of(in_air(campaign, "calm").nominal) == "calm"
    assert air_of(in_air(campaign, "wind").nominal) == "wind"
    assert air_of(in_air(words, "severe").nominal) == "severe"
    with pytest.raises(ft.InputError, match=r"`air`.*'stormy'"):
        in_air(campaign, "stormy")


def test_points_of_a_design_become_independent_draws():
    campaign = small_campaign().model_copy(update={"design": "sobol"})

    assert at_random(campaign).design == "random"
