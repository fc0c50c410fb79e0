"""The words of a distribution of flights: what a claim is about, with ranges and units."""

import math
from dataclasses import replace

import numpy as np
import pytest
from dispersed import AEROSONDE, KINEMATIC, WIND, campaign_of, one_of, plan_of, tables_of, uniform

import flighttune as ft
from flighttune.claims import counted_flights
from flighttune.claims.band import RecordedSignals
from flighttune.claims.distribution import spread
from flighttune.claims.monitor import FAULTS

# 2 m/s^2 from 1 s on, for 1.5 s: from 25 to 28 m/s.
V_RAMP = {"chi_deg": 0.0, "gamma_deg": 0.0}
V_RAMP["V_mps"] = [{"shape": "ramp", "start_s": 1.0, "duration_s": 1.5, "rate_mps2": 2.0}]

MASS = {"key": "plant.airframe.mass_factor", "distribution": "log_normal", "median": 1.0}
RAMP = {"shape": "ramp", "start_s": 0.5, "duration_s": 2.0, "rate_dps": 4.0}

MASS["sd_log"] = 0.0487901642  # more digits than a reader compares


def route_at(*airspeeds, holds_airspeed=True):
    """A route north whose waypoints set these airspeeds; the last one ends the flight."""
    points = [{"north_m": 1e3 * i, "east_m": 0.0, "V_mps": V} for i, V in enumerate(airspeeds)]
    limits = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 60.0, "n_x": [-0.3, 0.3]}
    route = {"waypoint": points, "holds_airspeed": holds_airspeed}
    return {"route": route, "reference": None, "limits": limits, "plants": [{"kind": "kinematic"}],
            "flight": {"V_a_mps": 25.0, "duration_s": 1e3}}  # fmt: skip


def distribution(*disperse, plants=(AEROSONDE,), **tables):
    campaign = campaign_of(ft.scenario_from(tables_of(plants, **tables)), *disperse)
    return counted_flights.distribution_of(
        counted_flights.at_random(campaign), campaign.nominal.plant[0].label
    )


def spoken(*disperse, **tables):
    return distribution(*disperse, **tables).sentence("aircraft / gains")


@pytest.mark.parametrize(
    ("disperse", "tables", "words"),
    [
        ([], {}, "aircraft / gains at 25 m/s in calm air"),
        ([uniform("flight.V_a_mps", 20.0, 30.0)], {}, "at 20 to 30 m/s in calm air"),
        ([], route_at(27, 23, 19), "at 25, 27 and 23 m/s in calm air"),
        ([], route_at(24, 23, 22, 21, 20), "at 21 to 25 m/s in calm air"),
        ([uniform("flight.V_a_mps", 25.0, 26.0)], route_at(27, None), "at 25 to 27 m/s in calm"),
        ([], route_at(27, 23, holds_airspeed=False), "at 25 m/s in calm air"),
        ([], {**route_at(), "route": None, "reference": V_RAMP}, "at 25 to 28 m/s in calm air"),
        ([], {"wind": WIND}, "in wind 6 m/s from 250 deg"),
        (
            [uniform("gust.peak_mps", 2.0, 5.0)],
            {"gust": {"axis": "right", "start_s": 1.0, "peak_mps": 3.0, "length_m": 50.0}},
            "in a gust of 2 to 5 m/s (right)",
        ),
        ([uniform("wind.speed_mps", 0.0, 8.0)], {"wind": WIND}, "wind 0 to 8 m/s from 250 deg"),
        (
            [one_of("turbulence.intensity", "light", "severe")],
            {"turbulence": {"intensity": "light"}},
            "in light or severe turbulence",
        ),
        (
            [],
            {"sensors": {"chi_noise_sd_deg": 5.0}},
            "in calm air, measured with course noise deviation 5 deg",
        ),
        (
            [one_of("controller.schedule", True, False)],
            {},
            "drawn at random: gains the same at all airspeeds or proportional to airspeed",
        ),
        ([uniform("flight.chi_deg", -5.0, 5.0)], {}, "drawn at random: initial course -5 to 5 deg"),
        ([MASS], {}, "(log-normal, sd 0.0488)"),
    ],
)
def test_the_sentence_names_the_air_the_airspeed_and_ranges_with_units(disperse, tables, words):
    assert words in spoken(*disperse, **tables)


def test_many_keys_stand_in_the_table_with_their_units_and_the_sentence_counts_them():
    campaign = ft.load_campaign("mission_in_wind")
    known = counted_flights.distribution_of(campaign, campaign.nominal.plant[0].label)

    sentence, records = known.sentence("x"), known.records("x")
    rows = {row["quantity"]: (row["values"], row["drawn"]) for row in records}

    assert "wind 0 to 8 m/s from anywhere, light turbulence" in sentence
    assert "mass factor 0.91 to 1.09 (normal, sd 0.03)" in sentence
    assert "8 more in the table of flights" in sentence
    assert rows["centre of gravity aft"] == ("-0.012 to 0.012 m", "normal, sd 0.005 m")
    assert rows["wind speed"] == ("0 to 8 m/s", "uniform")
    assert {*campaign.keys} == {*known.dispersed}
    assert rows["gains"] == ("the same at all airspeeds", "fixed")
    drawn = [row for row in records if row["drawn"] != "fixed"]
    assert len(drawn) == 4 + len(campaign.keys) + len(campaign.correlation)


def test_a_key_of_another_plant_is_not_of_this_distribution():
    other = {**AEROSONDE, "name": "other"}
    ends = {"jsbsim:aerosonde": 1.1, "jsbsim:aerosonde:other": 1.3}
    keys = [uniform(f"plant[{name}].airframe.mass_factor", 0.9, ends[name]) for name in ends]

    rows = distribution(*keys, plants=[AEROSONDE, other]).records("x")

    (row,) = [row for row in rows if row["drawn"] != "fixed"][3:]
    assert row == {"quantity": "mass factor", "values": "0.9 to 1.1", "drawn": "uniform"}


LIGHT = {"turbulence": {"intensity": "light"}}
COUNTED = uniform("wind.speed_mps", 2.0, 8.0), uniform("plant.airframe.mass_factor", 0.9, 1.1)
FAULT = {"from_s": 1.0, "aileron_stuck_deg": 5.0}


def plant(**airframe):
    return {"plants": [AEROSONDE | {"airframe": airframe}]}


@pytest.mark.parametrize(
    ("disperse", "counted", "flown", "differs"),
    [
        ((), LIGHT, LIGHT, ""),
        ((), LIGHT, {"turbulence": {"intensity": "severe"}},
         "turbulence is severe, counted on light"),
        ((), LIGHT, {}, "turbulence is none, counted on light"),
        ((), {}, LIGHT, "turbulence is light, counted on none"),
        ([one_of("turbulence.intensity", "light", "moderate")], LIGHT,
         {"turbulence": {"intensity": "severe"}}, "turbulence is severe, counted on light or "),
        ([one_of("turbulence.intensity", "light", "moderate")], LIGHT,
         {"turbulence": {"intensity": "moderate"}}, ""),
        (COUNTED, {"wind": WIND}, {"wind": WIND}, ""),
        (COUNTED, {"wind": WIND}, {"wind": WIND | {"speed_mps": 9.0}},
         "wind.speed_mps is 9, counted on 2 to 8"),
        (COUNTED, {"wind": WIND}, {}, "wind.speed_mps is none, counted on 2 to 8"),
        ([uniform("wind.speed_mps", 0.0, 8.0)], {"wind": WIND}, {}, ""),
        ((), {}, {"wind": WIND | {"speed_mps": 0.0}}, ""),
        (COUNTED, {"wind": WIND}, {"wind": WIND} | plant(mass_factor=1.2),
         "plant.airframe.mass_factor is 1.2, counted on 0.9 to 1.1"),
        ([uniform("plant.airframe.mass_factor", 1.2, 1.3)], {}, {},
         "plant.airframe.mass_factor is 1, counted on 1.2 to 1.3"),
        ((), {}, plant(mass_factor=1.0), ""),
        ((), {}, plant(fault=FAULT), "plant.airframe.fault.from_s is 1, counted on none"),
        ((), {}, {"sensors": {"chi_bias_deg": 1.0}}, "sensors.chi_bias_deg is 1, counted on 0"),
        ((), {"sensors": {"chi_bias_deg": 1.0}}, {}, "sensors.chi_bias_deg is 0, counted on 1"),
        ((), {}, {"disturbance": {"chi_amplitude": 0.01, "chi_omega_rad_s": 2.0, "as_wind": True}},
         "disturbance.chi_amplitude is 0.01, counted on 0"),
        ((), {}, {"reference": {"chi_deg": 1.0, "gamma_deg": 0.0}},
         "reference.chi_deg is 1, counted on 0"),
        ((), {}, {"controller": {"feed_forward": False}}, "controller.feed_forward is False"),
        ((), {}, {"limits": {"phi_deg": [-30.0, 45.0]}}, "limits.phi_deg is [-30.0, 45.0], "),
        ([uniform("limits.phi_deg[1]", 40.0, 45.0)], {},
         {"limits": {"phi_deg": [-45.0, 30.0]}}, "limits.phi_deg[1] is 30, counted on 40 to 45"),
        ((), {}, {"law": "exact"}, "law.kind is exact, counted on paper"),
    ],
)  # fmt: skip
def test_a_flight_of_others_than_those_counted_is_named_with_both_values(
    disperse, counted, flown, differs
):
    tables, own = tables_of((AEROSONDE,), gains=["paper"], **counted), flown.copy()
    plan = plan_of(tables, *disperse, gains=["paper"], design="random")
    flights = counted_flights.flights_of(plan, RecordedSignals.chosen(plan, None), 7)
    other = ft.scenario_from(tables_of(own.pop("plants", (AEROSONDE,)), **own))
    name = "exact:paper" if "law" in flown else "paper"

    said = flights.not_counted(other, "jsbsim:aerosonde", name)

    assert said.startswith(differs)
    assert bool(said) == bool(differs)
    if "fault" in differs:
        assert not flights.not_counted(other, "jsbsim:aerosonde", name, FAULTS)


@pytest.mark.parametrize(
    ("chi", "gamma", "away"),
    [
        ((-1.0, 3.0), (-2.0, 2.0), 2.0),
        ((-1.0, 4.0), (-2.0, 2.0), None),
        ((-2.0, 3.0), (-2.0, 2.0), None),
        ((-1.0, 3.0), (-2.0, 1.0), None),
        ((-1.0, 3.0), (-3.0, 2.0), None),
        ((-1.0, 3.0), (-3.0, 3.0), None),
    ],
)
def test_starts_have_one_range_where_they_go_as_far_to_every_side(chi, gamma, away):
    """The scenario starts at a course of 1 deg and a path angle of 0."""
    starts = {"flight.chi_deg": chi, "flight.gamma_deg": gamma}
    flight = {"V_a_mps": 25.0, "duration_s": 4.0, "chi_deg": 1.0, "gamma_deg": 0.0}
    drawn = distribution(*(uniform(key, *ends) for key, ends in starts.items()), flight=flight)
    scenario = ft.scenario_from(tables_of((AEROSONDE,), flight=flight))

    distance = drawn.start_range(scenario, scenario.plant[0])
    assert distance == (None if away is None else pytest.approx(np.deg2rad(away)))


NORMAL = {"key": "flight.gamma_deg", "distribution": "normal", "mean": 0.0, "sd": 2.0,
          "lower": -2.0, "upper": 2.0}  # fmt: skip


@pytest.mark.parametrize(
    ("disperse", "tables"),
    [
        ([NORMAL], {}),  # of which a few go further
        ([uniform("flight.gamma_deg", -2.0, 2.0), uniform("flight.V_a_mps", 24.0, 26.0)], {}),
        ([uniform("flight.gamma_deg", -2.0, 2.0)], {"wind": WIND}),
        ([uniform("flight.gamma_deg", -2.0, 2.0)], {"limits": {"phi_deg": [-30.0, 30.0]}}),
    ],
)
def test_starts_have_a_range_only_if_nothing_else_is_drawn_or_differs(disperse, tables):
    flight = {"V_a_mps": 25.0, "duration_s": 4.0, "chi_deg": 0.0, "gamma_deg": 0.0}
    course = uniform("flight.chi_deg", -2.0, 2.0)
    scenario = ft.scenario_from(tables_of((AEROSONDE,), flight=flight))
    in_wind = ft.scenario_from(tables_of((AEROSONDE,), flight=flight, wind=WIND))

    drawn = distribution(course, *disperse, flight=flight, **tables)

    for flown in (scenario, in_wind):
        assert drawn.start_range(flown, flown.plant[0]) is None


def test_five_drawn_keys_stand_in_the_sentence_and_a_key_without_its_table_is_refused():
    angles = [uniform(f"flight.{name}_deg", -2.0, 2.0) for name in ("chi", "gamma")]
    factors = [uniform(f"plant.airframe.{x}_factor", 0.9, 1.1) for x in ("mass", "drag", "izz")]
    five = distribution(*angles, *factors)

    assert len(five.varied) == 5
    assert "more in the table" not in five.sentence("x")
    with pytest.raises(ft.InputError, match="`disperse` must say how"):
        replace(five, disperse=five.disperse[1:])
    assert [distribution(**x).windy for x in ({}, {"wind": WIND})] == [False, True]


@pytest.mark.parametrize(
    ("values", "unit", "words"),
    [
        ([0.0, 8.0], "m/s", "0 to 8 m/s"),
        ([0.9523809523, 1.0499999], "", "0.9524 to 1.05"),  # ends of a log-normal factor
        ([12345.0, 400.0], "m", "400 to 12345 m"),
        ([-12345.0, 400.0], "m", "-12345 to 400 m"),
        (["severe", "light", "severe"], "", "severe or light"),
    ],
)
def test_a_range_has_the_digits_that_it_deserves(values, unit, words):
    assert spread(values, unit) == words


@pytest.mark.parametrize("reference", [[RAMP], []])
def test_a_flight_is_one_of_those_counted_if_its_reference_begins_where_theirs_do(reference):
    """The reference of a plan's starts stays in place; that of a campaign moves with each start."""
    tables = tables_of(reference={"chi_deg": reference, "gamma_deg": 10.0})
    scenario = ft.scenario_from(tables)
    beside = ft.flights(scenario).starting(2.0).plan().campaign
    moving = distribution(
        uniform("flight.chi_deg", 18.0, 22.0), plants=[KINEMATIC], reference=tables["reference"]
    )
    beside = counted_flights.distribution_of(beside, "kinematic")

    def counted(start, begin=None):
        own = {"reference": tables["reference"] | ({"chi_from_deg": begin} if begin else {})}
        own["flight"] = tables["flight"] | {"chi_deg": start}
        flown = ft.scenario_from(tables | own)
        plant = flown.plant[0]
        found = [not known.not_counted(flown, plant) for known in (beside, moving)]
        assert found == [not known.difference(flown, plant) for known in (beside, moving)]
        return found

    assert counted(20.0) == [True, True]
    assert counted(21.0) == [False, True]
    assert counted(21.0, 21.0) == [False, True]
    assert counted(21.0, 20.0) == [True, False]
    assert counted(23.0, 20.0) == [False, False]
    assert (beside.reference_moves, moving.reference_moves) == (False, True)
    assert beside.start_range(scenario, scenario.plant[0]) == pytest.approx(math.radians(2.0))
    assert moving.start_range(scenario, scenario.plant[0]) is None
