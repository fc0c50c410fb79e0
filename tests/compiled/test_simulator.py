"""Many flights of an aircraft at once, beside JSBSim that flies each of them alone."""

import math
import threading

import numpy as np
import pytest

import flighttune as ft

STEPS, EACH = 60, 5  # actions of a flight, and integration steps of each


def flown_by_jsbsim(aircraft, condition, actions, *, seed=0, **air):
    """Signals of JSBSim after each action."""
    plant = ft.loop.JSBSimPlant(aircraft, seed=seed, **air)
    plant.start(ft.loop.FlightCondition(**condition))
    rows = [plant.observe()]
    for phi, n_z in actions:
        assert plant.advance(phi, n_z, EACH / plant.rate) is None
        rows.append(plant.observe())
    return [dict(zip(plant.signals, row, strict=True)) for row in rows]


def assert_equal(state, lane, row):
    """A flight has the signals of JSBSim to the bit; angles that run on there lie within a turn."""
    for name, value in row.items():
        mine = float(state[name][lane])
        if name in ("chi", "psi"):
            assert math.remainder(mine - value, math.tau) == pytest.approx(0.0, abs=1e-12), name
        else:
            assert mine == value, (name, lane)


def drawn_actions(n, generator):
    phi, n_z = generator.uniform(-0.5, 0.5, (STEPS, n)), generator.uniform(0.8, 1.3, (STEPS, n))
    return np.stack([phi, n_z], axis=2)


KINDS = [
    pytest.param("aerosonde", 25.0, None, id="still air"),
    pytest.param("aerosonde", 25.0, "tustin", marks=pytest.mark.slow, id="tustin"),
    pytest.param("c172p", 50.0, "milspec", marks=pytest.mark.slow, id="milspec"),
    pytest.param("x8", 18.0, "tustin", marks=pytest.mark.soak, id="x8"),
    pytest.param("a4", 180.0, None, marks=pytest.mark.soak, id="a4"),
]


@pytest.mark.parametrize(("name", "V_a", "model"), KINDS)
def test_every_flight_is_that_of_jsbsim_to_the_bit(name, V_a, model):
    """Five flights, which fill no vector, of which one is put back half way and flown again."""
    n, generator = 5, np.random.default_rng(2)
    actions, speeds = drawn_actions(n, generator), V_a * generator.uniform(0.95, 1.1, n)
    aircraft = ft.compiled.load(name)
    air = {} if model is None else {"turbulence": "light", "model": model}
    start = state = aircraft.trim(V_a=speeds, h=800.0, chi=0.4, **air)
    half = None
    states = [state]
    for k, given in enumerate(actions):
        half = state if k == STEPS // 2 else half
        state = aircraft.step(state, given, steps=EACH)
        states.append(state)
    again = half.put(2, half[2])
    for given in actions[STEPS // 2 :]:
        again = aircraft.step(again, given, steps=EACH)

    for lane in range(n):
        condition = {"V_a": speeds[lane], "h": 800.0, "chi": 0.4}
        weather = scenario_weather(model)
        rows = flown_by_jsbsim(name, condition, actions[:, lane], seed=lane, weather=weather)
        for k in (0, 1, 7, STEPS):
            assert_equal(states[k], lane, rows[k])
        assert_equal(again, lane, rows[-1])
    assert_equal(start, 0, {"V_a": start["V_a"][0], "t": 0.0})


def scenario_weather(model):
    """The weather of a scenario in light turbulence."""
    if model is None:
        return None
    from flighttune.vehicles.plants.weather import Turbulence, Weather

    return Weather(turbulence=Turbulence(severity=3, wind_20ft=7.7, model=model))


@pytest.fixture(scope="module")
def aerosonde():
    return ft.compiled.load("aerosonde")


@pytest.fixture(scope="module")
def flights(aerosonde):
    """Seven flights after a second, each with its own mass and load factor."""
    start = aerosonde.trim(mass_factor=np.linspace(0.9, 1.1, 7), turbulence="light")
    return aerosonde.step(start, {"n_z_cmd": np.linspace(0.9, 1.1, 7)}, steps=200)


def test_flights_are_the_same_in_other_lanes_and_numbers(aerosonde, flights):
    """The first, the last, every other one, one alone, and all of them in two lanes each."""
    on = aerosonde.step(flights, [0.2, 1.0], steps=50)
    for key in (
        0,
        slice(-1, None),
        slice(None, None, 2),
        [6, 1],
        np.arange(7) > 3,
        [*range(7)] * 2,
    ):
        some = aerosonde.step(flights[key], [0.2, 1.0], steps=50)
        for name in ("V_a", "phi", "velocities/p-rad_sec", "aero/alpha-deg", "t"):
            assert some[name].tolist() == np.atleast_1d(on[name][key]).tolist()


def test_a_state_that_was_kept_flies_on_to_the_same_bits(aerosonde, flights):
    kept, before = flights.copy(), flights["phi"].tolist()
    on = aerosonde.step(flights, [0.4, 1.1], steps=100)

    assert flights["phi"].tolist() == before
    assert aerosonde.step(kept, [0.4, 1.1], steps=100)["phi"].tolist() == on["phi"].tolist()
    back = on.put([1, 5], flights[[1, 5]])
    assert back["phi"].tolist() == [(flights if i in (1, 5) else on)["phi"][i] for i in range(7)]
    assert back["aero/alpha-deg"].tolist() == [
        (flights if i in (1, 5) else on)["aero/alpha-deg"][i] for i in range(7)
    ]


def test_a_trace_has_the_signals_on_the_way_of_the_same_flight(aerosonde, flights):
    of, inputs = ["phi", "V_a"], [0.3, 1.05]
    end, rows = aerosonde.trace(flights, inputs, of=of, steps=50, every=20)

    assert rows.shape == (3, 7, 2)
    for row, steps in zip(rows, (20, 40, 50), strict=True):
        on = aerosonde.step(flights, inputs, steps=steps)
        assert row.T.tolist() == [on[name].tolist() for name in of]
    assert end["aero/alpha-deg"].tolist() == on["aero/alpha-deg"].tolist()


def test_steps_of_several_threads_at_once_have_the_bits_of_one(aerosonde, flights):
    wanted = aerosonde.step(flights, [0.3, 1.0], steps=300)["phi"].tolist()
    found = []
    threads = [
        threading.Thread(
            target=lambda: found.append(aerosonde.step(flights, [0.3, 1.0], steps=300)["phi"])
        )
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert [x.tolist() for x in found] == [wanted] * 4


def test_properties_are_in_the_units_of_jsbsim(flights):
    for name, property_, factor in (
        ("V_a", "velocities/vt-fps", 0.3048),
        ("p", "velocities/p-rad_sec", 1.0),
        ("alpha", "aero/alpha-deg", math.pi / 180.0),
        ("theta", "attitude/theta-deg", math.pi / 180.0),
    ):
        assert flights[name] == pytest.approx(factor * flights[property_], rel=1e-12)
    assert flights["inertia/mass-slugs"] / flights["inertia/mass-slugs"][3] == pytest.approx(
        np.linspace(0.9, 1.1, 7)
    )


def test_surfaces_fly_without_an_inner_loop():
    """Up elevator pitches up; what the trim found flies on, and the surfaces lag their commands."""
    aircraft = ft.compiled.load("aerosonde", inputs="surfaces")
    start = aircraft.trim(V_a=25.0, n=3)
    moved = {"elevator": start["elevator"] + [-0.02, 0.0, 0.02]}

    held, flown = aircraft.step(start, steps=200), aircraft.step(start, moved, steps=100)

    assert aircraft.inputs == ("aileron", "elevator", "rudder", "throttle")
    assert held["h"] == pytest.approx(start["h"], abs=1e-3)
    assert held["V_a"] == pytest.approx(25.0, abs=1e-3)
    assert flown["elevator"] == pytest.approx(moved["elevator"], abs=1e-4)
    assert flown["theta"][0] > flown["theta"][1] + 0.01 > flown["theta"][2] + 0.02


def test_slopes_are_the_differences_of_flights(aerosonde, flights):
    of, given, step = ("phi", "n_z", "V_a"), {"phi_cmd": 0.113, "n_z_cmd": 1.0137}, 1e-6
    some = flights[:3]

    found = aerosonde.slopes(some, given, of=of, by=[*given], steps=60)

    for j, name in enumerate(given):
        less, more = (
            aerosonde.step(some, given | {name: given[name] + x}, steps=60) for x in (-step, step)
        )
        for i, signal in enumerate(of):
            wanted = (more[signal] - less[signal]) / (2.0 * step)
            assert found[:, i, j] == pytest.approx(wanted, rel=1e-4, abs=1e-7)


REFUSED = {
    "one number for two inputs": (lambda a, s: a.step(s, [1.0]), r"shape \(2,\) or \(7, 2\)"),
    "a row too few": (lambda a, s: a.step(s, np.zeros((6, 2))), r"got \(6, 2\)"),
    "rows of several lengths": (lambda a, s: a.step(s, [[0.0], [0.0, 1.0]]), "must be numbers"),
    "not finite": (lambda a, s: a.step(s, [math.nan, 1.0]), "`inputs` must be finite"),
    "a signal as input": (lambda a, s: a.step(s, {"phi": 1.0}), "did you mean phi_cmd"),
    "too many values": (lambda a, s: a.step(s, {"phi_cmd": [0.0] * 3}), "a number or 7 of them"),
    "no steps": (lambda a, s: a.step(s, steps=0), "`steps` must be at least 1, got 0"),
    "a trace of none": (lambda a, s: a.trace(s, of=["fi"]), "`of` must be signals"),
    "rows without steps": (lambda a, s: a.trace(s, of=[], every=0), "`every` must be at least 1"),
    "a property that is none": (lambda a, s: s["velocities/p-rad"], "velocities/p-rad_sec"),
    "no flight": (lambda a, s: s[[]], "at least one flight"),
    "a difference that is none": (lambda a, s: a.trim(mass=1.0), "mass_factor.*got `mass`"),
    "two lengths": (lambda a, s: a.trim(V_a=[24.0, 25.0], h=[1e3] * 3), "3 of them, got 2"),
    "an airspeed outside": (lambda a, s: a.trim(V_a=[25.0, 90.0]), "flight 1: `V_a` must lie in"),
    "no such air": (lambda a, s: a.trim(turbulence="big"), "'light', 'moderate' or 'severe'"),
    "a wind of two": (lambda a, s: a.trim(wind=[1.0, 2.0]), r"`wind` must have the shape \(3,\)"),
    "other air": (lambda a, s: s.put(0, a.trim()), "in the same kind of air"),
    "a slope of none": (
        lambda a, s: a.slopes(s, of=["fi"], by=["phi_cmd"]),
        "`of` must be signals",
    ),
    "a slope by none": (lambda a, s: a.slopes(s, of=["phi"], by=["x"]), "must be inputs"),
    "no aircraft": (lambda a, s: ft.compiled.load("none"), "must be one of a4, aerosonde"),
    "other inputs": (lambda a, s: ft.compiled.load("x8", inputs="u"), "commands or surfaces"),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_cannot_be_flown_is_refused_in_a_line(kind, aerosonde, flights):
    call, words = REFUSED[kind]
    with pytest.raises(ft.FlightTuneError, match=words) as refused:
        call(aerosonde, flights)
    assert "\n" not in str(refused.value)
