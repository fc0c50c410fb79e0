"""Aircraft compiled and by JSBSim, from start to end, property by property and to the bit."""

import math
import random
from pathlib import Path

import pytest
from airframes import blowing, changed_aerosonde, varied
from commands import answer
from compiled_flights import differing, flown_by_both, why_not
from places import AIRCRAFT_NAMES, ROOT

import flighttune as ft

ADOPTED = Path(__file__).parents[1] / "adopted"


# Adopted aircraft of `make soak`: one that is refused by a difference, a turboprop and one whose
# start is refused; `make counts` has the others.
LONGER = "f16", "DHC6", "Short_S23"
MARKS = {"x8": pytest.mark.soak, "a4": pytest.mark.soak}
SHIPPED = [pytest.param(x, marks=MARKS.get(x, pytest.mark.slow)) for x in AIRCRAFT_NAMES]


@pytest.mark.parametrize("aircraft", SHIPPED)
def test_every_property_is_that_of_jsbsim(aircraft):
    flown = flown_by_both(aircraft, 1.0, starts=True)

    assert len(flown) > 200
    assert differing(flown) == []


# Of two of these the attitude that is shown hides some of that which is flown.
DIRECTIONS = [(800.0, math.radians(chi), 0.05, 0.3) for chi in (90.0, 135.0, 180.0, -90.0)] + [
    *((800.0, math.radians(170.0), 0.03, -0.2), (729.645, -2.899430, -0.038077, -0.232003)),
    (807.855, -0.101528, 0.052358, -0.112261),
]


@pytest.mark.parametrize(("h", "chi", "gamma", "phi"), DIRECTIONS)
def test_flights_in_all_directions_are(h, chi, gamma, phi):
    condition = ft.loop.FlightCondition(V_a=27.0, h=h, chi=chi, gamma=gamma, phi=phi)

    assert differing(flown_by_both("aerosonde", 0.25, condition, starts=True)) == []


@pytest.mark.soak
def test_slow_computers_and_raised_ground_are():
    assert differing(flown_by_both("c172p", 1.0, steps=3, ground=430.0)) == []


SPEED = {"aerosonde": 25.0, "x8": 18.0, "a4": 120.0, "c172p": 48.0, "737": 180.0, "DHC6": 60.0}


def draws(name, count, seed):
    """Off-nominal aircraft with a flight in wind each, every second one in turbulence."""
    draw = random.Random(seed).uniform
    factors = ("mass", "lift", "drag", "ixx", "iyy", "izz", "thrust")
    for k in range(count):
        keys = {f"{key}_factor": draw(0.95, 1.05) for key in factors}
        if name in ("a4", "737"):
            # The largest inertia is nearly the sum of the others, and may not be more.
            keys["iyy_factor"] = keys["izz_factor"] = keys["ixx_factor"]
        keys |= {"actuator_lag_factor": draw(0.8, 1.5), "cg_aft_m": draw(-0.004, 0.004)}
        rough = {"severity": 3, "wind_20ft": 4.0, "model": "tustin"} if k % 2 else None
        weather = blowing((draw(-4, 4), draw(-4, 4), draw(-0.2, 0.2)), rough)
        condition = ft.loop.FlightCondition(
            V_a=SPEED[name] * draw(0.95, 1.1), h=draw(600.0, 1500.0), chi=draw(-3.1, 3.1),
            gamma=draw(-0.05, 0.02), phi=draw(-0.3, 0.3),
        )  # fmt: skip
        yield keys, condition, weather


@pytest.mark.parametrize(
    ("name", "count", "seed"),
    [
        pytest.param("aerosonde", 2, 6, marks=pytest.mark.slow),
        pytest.param("737", 2, 20, marks=pytest.mark.soak),
        *(pytest.param(x, 60, 120, marks=pytest.mark.counts) for x in SPEED),
    ],
)
def test_drawn_aircraft_start_and_fly_as_by_jsbsim(name, count, seed):
    aircraft = ADOPTED / name if (ADOPTED / name).exists() else name
    for keys, condition, weather in draws(name, count, seed):
        drawn = varied(aircraft, **keys)
        flown = flown_by_both(drawn, 0.25, condition, starts=True, weather=weather)
        assert differing(flown) == [], (keys, condition)


ALPHA = "<input>aero/alpha-rad</input>"
MEMORY = f"""<system name="more"><channel name="more"><lag_filter name="l">{ALPHA}<c1>5</c1>
    </lag_filter><sensor name="late">{ALPHA}<delay>0.02</delay></sensor><actuator name="play">
    {ALPHA}<hysteresis_width>0.1</hysteresis_width></actuator></channel></system><aerodynamics>"""


@pytest.mark.slow
def test_filters_delays_and_play_of_the_model_begin_as_in_jsbsim(tmp_path):
    folder = changed_aerosonde(
        tmp_path / "aircraft", lambda text: text.replace("<aerodynamics>", MEMORY)
    )
    gust = blowing(gust={"axis": "right", "peak": 3.0, "start": 0.3, "rise": 0.7, "hold": 0.4})
    condition = ft.loop.FlightCondition(V_a=26.0, h=900.0, chi=0.4, gamma=0.03, phi=0.2)

    assert differing(flown_by_both(folder, 0.8, condition, weather=gust)) == []


@pytest.mark.soak
def test_starts_over_raised_ground_are_those_of_jsbsim():
    condition = ft.loop.FlightCondition(V_a=25.0, h=900.0, gamma=0.02)

    assert differing(flown_by_both("aerosonde", 0.5, condition, starts=True, ground=430.0)) == []


@pytest.mark.parametrize(
    "aircraft",
    [
        *(pytest.param(x, marks=pytest.mark.soak) for x in LONGER),
        *(
            pytest.param(x, marks=pytest.mark.counts)
            for x in sorted(path.name for path in ADOPTED.iterdir())
            if x not in LONGER
        ),
    ],
)
def test_adopted_aircraft_are_compiled_or_refused_by_name(aircraft):
    assert REFUSED.get(aircraft, "") in why_not(ADOPTED / aircraft)
    assert (aircraft in REFUSED) == bool(why_not(ADOPTED / aircraft))


# Aeroplanes of JSBSim's set that are not compiled, with a word of the reason.
REFUSED = {
    **dict.fromkeys(("c172x", "c310", "global5000"), "<waypoint_heading>"),
    "Short_S23": "a pressure behind the throttle",
    "f16": "`fcs/g-load-pid` differs first",
}
COMPILED = (
    *("737", "787-8", "A320", "A4", "B17", "B747", "Boeing314", "C130", "Camel", "Concorde"),
    *("DHC6", "F4N", "F80C", "J3Cub", "L17", "L410", "MD11", "OV10", "Shuttle", "T37", "T38"),
    *("X15", "XB-70", "c172p", "c172r", "c182", "dr1", "f104", "f15", "f22", "fokker100"),
    *("minisgs", "p51d", "pa28", "pc7", "pogo-jsbsim", "sgs126", "sgs233", "t6texan2", "x24b"),
)


# tests/adopted has jets, pistons, a turboprop and some that are refused.
ROCKET = "X15"


@pytest.mark.slow
@pytest.mark.parametrize(
    "model",
    [
        pytest.param(ROCKET, marks=pytest.mark.soak),
        *(
            pytest.param(model, marks=pytest.mark.counts)
            for model in (*COMPILED, *REFUSED)
            if model != ROCKET
        ),
    ],
)
def test_the_fleet_of_jsbsim_is_compiled_to_the_bit_or_refused_by_name(tmp_path, model):
    # The f15 flies and is not adopted: its sideslip diverges.
    answer("adopt", model, "--out", tmp_path / model, status=None)

    assert REFUSED.get(model, "") in why_not(tmp_path / model)
    assert (model in REFUSED) == bool(why_not(tmp_path / model))


def test_the_page_counts_the_fleet_and_names_who_is_refused():
    page = (ROOT / "docs/compiled.md").read_text(encoding="utf-8")

    assert f"{len(COMPILED)} of {len(COMPILED) + len(REFUSED)} that fly" in page
    assert all(model in page for model in REFUSED)
    assert f"| shipped | {len(AIRCRAFT_NAMES)} of {len(AIRCRAFT_NAMES)} |" in page
