"""Starts by machine code against those by JSBSim, number by number and to the bit."""

import random
from pathlib import Path

import numpy as np
import pytest
from airframes import changed_aerosonde

import flighttune as ft
from flighttune.base.errors import TrimError
from flighttune.flight.loop import aircraft as loop_aircraft
from flighttune.vehicles.aircraft.aircraft import OffNominal, load_aircraft
from flighttune.vehicles.compiled import engines, face, masses, run, settling, trimming
from flighttune.vehicles.compiled.check import _start_numbers
from flighttune.vehicles.compiled.model import Air, Source
from flighttune.vehicles.compiled.properties import Unsupported, named
from flighttune.vehicles.compiled.rigid_body import INERTIA
from flighttune.vehicles.compiled.trace import fabs
from flighttune.vehicles.plants import weather as air
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

ADOPTED = Path(__file__).parents[2] / "adopted"

SHIPPED = "aerosonde", "x8", "a4", "c172p"

# Airspeeds that all drawn aircraft can hold, m/s
SPEED = {
    "aerosonde": 25.0,
    "x8": 18.0,
    "a4": 120.0,
    "c172p": 48.0,
    "DHC6": 60.0,
    "737": 180.0,
    "c182": 45.0,
}


def draws(name, count, seed):
    """Off-nominal aircraft with a flight in wind each, every second one in turbulence."""
    draw = random.Random(seed).uniform
    factors = ("mass", "lift", "drag", "ixx", "iyy", "izz")
    for k in range(count):
        numbers = {f"{key}_factor": draw(0.95, 1.05) for key in factors}
        if name in ("a4", "737"):
            # The largest inertia is nearly the sum of the others, and may not be more.
            numbers["iyy_factor"] = numbers["izz_factor"] = numbers["ixx_factor"]
        numbers |= {"actuator_lag_factor": draw(0.8, 1.5), "cg_aft_m": draw(-0.004, 0.004)}
        wind = air.WindProfile(((0.0, (draw(-4, 4), draw(-4, 4), draw(-0.2, 0.2))),))
        rough = air.Turbulence(severity=3, wind_20ft=4.0, model="tustin") if k % 2 else None
        condition = ft.loop.FlightCondition(
            V_a=SPEED[name] * draw(0.95, 1.1),
            h=draw(600.0, 1500.0),
            chi=draw(-3.1, 3.1),
            gamma=draw(-0.05, 0.08 if name != "DHC6" else 0.02),  # it has little thrust to spare
            phi=draw(-0.3, 0.3),
        )
        yield (
            OffNominal.model_validate(numbers),
            condition,
            air.Weather(wind=wind, turbulence=rough),
        )


def differing_at_start(config, condition, weather=None, ground=0.0, **settings):
    """Names of states and parameters of a step that are not equal to the bit."""
    turbulence, gust = (weather.turbulence, weather.gust) if weather else (None, None)
    step = face.compiled(config, turbulence=turbulence and turbulence.model, gust=gust is not None)
    assert isinstance(step, face.CompiledStep), step.reason
    numbers = []
    for fdm in (None, face.evaluated(config, ground=ground)):
        plant = ft.loop.JSBSimPlant(config, weather=weather, ground=ground, **settings)
        plant.start(condition, fdm)
        numbers.append(_start_numbers(step, plant))
    assert fdm is not None
    expected, actual = numbers
    assert len(expected) > 150
    return [name for name in expected if expected[name] != actual[name]]


@pytest.mark.parametrize(
    ("name", "count", "seed"),
    [
        ("aerosonde", 3, 6),
        pytest.param("c182", 1, 3, marks=pytest.mark.soak),  # whose engine stops, and is started
        pytest.param("DHC6", 3, 3, marks=pytest.mark.counts),
        pytest.param("c182", 3, 3, marks=pytest.mark.counts),
        pytest.param("x8", 2, 20, marks=pytest.mark.soak),
        pytest.param("a4", 2, 20, marks=pytest.mark.soak),
        *(pytest.param(x, 120, 120, marks=pytest.mark.counts) for x in SHIPPED),
        pytest.param("737", 1, 40, marks=pytest.mark.soak),
        pytest.param("737", 40, 40, marks=pytest.mark.counts),
    ],
)
def test_starts_of_drawn_aircraft_are_those_of_jsbsim(name, count, seed):
    config = load_aircraft(ADOPTED / name if (ADOPTED / name).exists() else name)

    for off_nominal, condition, weather in draws(name, count, seed):
        drawn = config.with_off_nominal(off_nominal)
        assert differing_at_start(drawn, condition, weather) == [], (off_nominal, condition)


@pytest.mark.soak
def test_so_are_those_over_raised_ground_and_with_n_x():
    config = load_aircraft("aerosonde")
    condition = ft.loop.FlightCondition(V_a=25.0, h=900.0, gamma=0.02)

    assert differing_at_start(config, condition, ground=430.0) == []
    assert differing_at_start(config, condition, takes_n_x=True) == []


@pytest.mark.parametrize("name", ["aerosonde", "a4", "c172p"])
def test_masses_are_those_of_jsbsim(name):
    off = OffNominal(mass_factor=1.03, cg_aft_m=0.01, ixx_factor=1.02, iyy_factor=0.97)
    config = load_aircraft(name).with_off_nominal(off)
    fdm, source = Fdm(config), Source(config, 1)

    def value(name):
        return fdm.reader(name)() if fdm.shows(name) else None

    def shown(name):
        return fdm.reader(name)()

    found = masses.mass_properties(source.model(Air()).root, source.numbers, value)

    of_mass = ["inertia/mass-slugs", *named("inertia/cg-{}-in")]
    assert [found[name] for name in of_mass] == [shown(name) for name in of_mass]
    signs = {"xx": 1.0, "yy": 1.0, "zz": 1.0, "xy": -1.0, "xz": 1.0, "yz": -1.0}
    J = np.reshape([found[name] for name in INERTIA], (3, 3))
    for axes, sign in signs.items():
        i, j = ("xyz".index(axis) for axis in axes)
        assert J[i, j] == sign * shown(f"inertia/i{axes}-slugs_ft2"), axes


ALPHA = "<input>aero/alpha-rad</input>"
DELAY = f'<sensor name="late">{ALPHA}<delay>0.02</delay></sensor>'
PLAY = f'<actuator name="play">{ALPHA}<hysteresis_width>0.1</hysteresis_width></actuator>'


def aerosonde_with(folder, *parts):
    """The Aerosonde with components in front of its aerodynamics."""

    def change(text):
        system = f'<system name="more"><channel name="more">{"".join(parts)}</channel></system>'
        return text.replace("<aerodynamics>", f"{system}<aerodynamics>")

    return load_aircraft(changed_aerosonde(folder, change))


def test_filters_delays_and_play_of_the_model_begin_as_in_jsbsim(tmp_path):
    lag = f'<lag_filter name="l">{ALPHA}<c1>5</c1></lag_filter>'
    config = aerosonde_with(tmp_path / "aircraft", lag, DELAY, PLAY)

    assert differing_at_start(config, ft.loop.FlightCondition(V_a=25.0, h=900.0, gamma=0.02)) == []


@pytest.mark.soak
def test_delays_and_play_of_a_model_start_without_jsbsim_and_a_gust_comes_at_its_time(tmp_path):
    config = aerosonde_with(tmp_path / "aircraft", DELAY, PLAY)
    gust = air.Gust(axis="right", peak=3.0, start=1.3, rise=0.7, hold=0.4)
    condition = ft.loop.FlightCondition(V_a=26.0, h=900.0, chi=0.4, gamma=0.03, phi=0.2)

    assert differing_at_start(config, condition, air.Weather(gust=gust)) == []


def later_wind(now, to_local, of=trimming._through_air):
    return [x * (1.0 + 2.0**-52) for x in of(now, to_local)]


def weaker(now, engine, of=engines._MOTORS["electric"]):
    return fabs(of(now, engine)) * (1.0 - (2.0**-52 if now.trimming else 0.0))


def drifting(now, of=run.hold):
    of(now)
    now["velocities/pi-rad_sec"] = now["velocities/pi-rad_sec"] * (1.0 + 2.0**-52)


@pytest.mark.parametrize(
    ("aircraft", "place", "name", "operation"),
    [
        pytest.param(*case, marks=getattr(pytest.mark, mark))
        for mark, case in [
            ("slow", ("aerosonde", trimming, "_through_air", later_wind)),
            ("counts", ("aerosonde", engines._MOTORS, "electric", weaker)),
            ("counts", ("aerosonde", masses, "_SLUG", masses._SLUG * (1.0 + 2.0**-52))),
            ("soak", ("c172p", run, "hold", drifting)),
            ("counts", ("c172p", settling, "_SEARCH_STEP", 0.5 * (1.0 + 2.0**-52))),
        ]
    ],
    ids=["wind", "engine", "mass", "motion that is not held", "search"],
)  # fmt: skip
def test_a_wrong_start_is_found_and_jsbsim_starts(
    aircraft, place, name, operation, empty_cache, monkeypatch
):
    setter = monkeypatch.setitem if isinstance(place, dict) else monkeypatch.setattr
    setter(place, name, operation)
    config = load_aircraft(aircraft).with_off_nominal(OffNominal(mass_factor=1.02))

    assert isinstance(face.compiled(config), face.CompiledStep)
    assert face.evaluated(config) is None


def loaded_by_both(name):
    """An aircraft by JSBSim and by machine code, as it is loaded."""
    config = load_aircraft(name)
    compiled = face.evaluated(config)
    assert compiled is not None
    return Fdm(config), compiled


def test_an_aircraft_of_machine_code_has_the_properties_of_that_of_jsbsim():
    both = loaded_by_both("aerosonde")
    fixed, of_air = "atmosphere/a-sl-fps", "atmosphere/turb-type"

    names = [fdm.names("propulsion/") for fdm in both]
    assert sorted(names[0]) == sorted(names[1])
    for name in (*names[0], "fcs/throttle-cmd-norm", of_air, "aero/alpha-rad", "nowhere/at-all"):
        assert len({fdm.shows(name) for fdm in both}) == 1, name
        assert len({fdm.has(name) for fdm in both}) == 1, name
    for fdm in both:
        assert fdm.value("nowhere/at-all", 7.0) == 7.0
        fdm.writer(of_air)(3.0)
        assert fdm.reader(of_air)() == fdm.value(of_air, 0.0) == 3.0
        with pytest.raises(ft.loop.PlantError, match="a-sl-fps` must be writable"):
            fdm.writer(fixed)
        for access in (fdm.reader, fdm.writer):
            with pytest.raises(ft.loop.PlantError, match="`nowhere/at-all`"):
                access("nowhere/at-all")
    with pytest.raises(ft.loop.PlantError, match="an aircraft of machine code has no steps"):
        both[1].run()
    with pytest.raises(Unsupported, match="engine 1, which stands in a trim"):
        both[1].start_engine(0)  # an electric one


@pytest.mark.slow
def test_a_piston_engine_that_is_started_turns_its_propeller_as_in_jsbsim():
    started = []
    for fdm in loaded_by_both("c172p"):
        fdm.start_engine(0)
        names = (f"propulsion/engine/{x}" for x in ("propeller-rpm", "engine-rpm", "set-running"))
        started.append([fdm.reader(name)() for name in names])

    assert started[0] == started[1]
    assert started[0][0] > 500.0


def test_a_start_that_fails_says_what_jsbsim_says():
    steep = ft.loop.FlightCondition(V_a=45.0, gamma=1.2)
    plant = ft.loop.JSBSimPlant("aerosonde")
    with pytest.raises(TrimError) as by_jsbsim:
        plant.start(steep)
    compiled = loop_aircraft.CompiledAircraft(ft.loop.JSBSimPlant("aerosonde"))
    compiled.compiles = True

    with pytest.raises(TrimError) as said:
        compiled.start(steep)

    assert str(said.value) == str(by_jsbsim.value)
