"""Flights that can be counted: of one air, drawn at random, and which scenario is one of them."""

import pytest
from counted_turns import START
from dispersed import AEROSONDE, SOFT, TURBULENCE, WIND, one_of, plan_of, tables_of, uniform

import flighttune as ft
from flighttune.campaigns.planning.schema import Uniform
from flighttune.claims import counted_flights


def small_campaign(**tables):
    return plan_of(tables_of((AEROSONDE,), **{"gains": [SOFT], **tables}), *START).campaign


def test_a_wind_that_is_drawn_may_be_stated():
    plan = ft.plan_campaign(ft.load_campaign("light_turbulence"))
    (plant,) = plan.scenario.plant
    known = counted_flights.distribution_of(plan.campaign, plant.label)

    def difference(**wind):
        scenario = ft.scenario_from({**plan.scenario.as_dict(), "wind": wind})
        return known.difference(scenario, plant)

    assert known.windy
    assert difference(speed_mps=0.0, from_deg=30.0) is None
    assert "`wind.speed_mps` must be 0 to 8, got 9.0" in difference(speed_mps=9.0, from_deg=30.0)
    assert "`wind.down_mps` must be 0.0" in difference(speed_mps=3.0, from_deg=30.0, down_mps=1.0)


def test_air_is_taken_apart():
    campaign = small_campaign(wind=WIND, turbulence=TURBULENCE)
    words = small_campaign(wind=WIND, turbulence={"intensity": "light"})

    assert counted_flights.air_of(campaign.central).startswith("severity")
    assert counted_flights.air_of(counted_flights.in_air(campaign, "calm").nominal) == "calm"
    assert counted_flights.air_of(counted_flights.in_air(campaign, "wind").nominal) == "wind"
    assert counted_flights.air_of(counted_flights.in_air(words, "severe").nominal) == "severe"
    with pytest.raises(ft.InputError, match=r"`air`.*'stormy'"):
        counted_flights.in_air(campaign, "stormy")


@pytest.mark.parametrize(
    ("air", "kept"),
    [
        ("calm", {"flight.V_a_mps"}),
        ("wind", {"flight.V_a_mps", "wind.speed_mps"}),
        ("light", {"flight.V_a_mps", "wind.speed_mps"}),
    ],
)
def test_what_is_drawn_of_the_air_is_drawn_where_there_is_such_air(air, kept):
    drawn = (
        uniform("flight.V_a_mps", 24.0, 26.0),
        uniform("wind.speed_mps", 0.0, 5.0),
        one_of("turbulence.intensity", "light", "severe"),
    )
    air_moves = {"wind": WIND, "turbulence": {"intensity": "light"}}
    campaign = plan_of(tables_of((AEROSONDE,), gains=[SOFT], **air_moves), *drawn).campaign

    assert {table.key for table in counted_flights.in_air(campaign, air).disperse} == kept


@pytest.mark.parametrize(
    ("acts", "own", "ends"),
    [
        ("sets", 20.0, [0.5, 1.5]),
        ("adds", 20.0, [20.5, 21.5]),
        ("multiplies", 20.0, [10.0, 30.0]),
        ("multiplies", -20.0, [-30.0, -10.0]),
    ],
)
def test_the_range_of_a_key_is_that_of_its_flights(acts, own, ends):
    table = Uniform(key="flight.chi_deg", acts=acts, lower=0.5, upper=1.5)

    assert counted_flights._range(table, own) == ends
    if acts != "sets":
        with pytest.raises(ft.InputError, match=r"`acts` of `flight.chi_deg` must be sets"):
            counted_flights._range(table, None)
