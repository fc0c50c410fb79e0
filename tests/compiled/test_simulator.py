"""Many flights of an aircraft at once, beside JSBSim that flies each of them alone."""

import math
import threading
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from places import AIRCRAFT_NAMES

import flighttune as ft

EACH = 5  # integration steps of an action


class Given:
    """Actions that are known before the flight, as a law."""

    actions = ()

    def __init__(self, setup):
        self.signals, self.dt = {}, setup.dt

    def start(self, condition):
        self.left = [*Given.actions]

    def step(self, *_):
        return self.left.pop(0) if self.left else (0.0, 1.0)


def flown_by_jsbsim(name, air, V_a, actions, *, seed):
    """Signals of JSBSim at the samples of a scenario whose law gives these actions."""
    made = ft.load_scenario("level_turn").as_dict() | air | {"seed": seed}
    rate = ft.loop.JSBSimPlant(name).rate / EACH
    made["plant"] = [{"kind": "jsbsim", "aircraft": name}]
    made["flight"] = {"V_a_mps": V_a, "h_m": 1000.0, "duration_s": len(actions) / rate}
    made |= {"controller": {"rate_hz": rate}, "reference": {"chi_deg": 0.0, "gamma_deg": 0.0}}
    made |= {"limits": WIDE, "expect": []}
    Given.actions = [(float(phi), float(n_z)) for phi, n_z in actions]
    with ft.in_jsbsim():
        runs = ft.fly(ft.scenario_from(made), laws={"given": Given}).runs
    run = next(run for run in runs if "given" in run.label)
    assert run.status == "completed"
    return run.signals


def assert_equal(state, lane, row):
    """A flight has the signals of JSBSim to the bit; angles that run on there lie within a turn."""
    for name in set(state.signals) & {*row.index}:
        mine, value = float(state[name][lane]), row[name]
        if name in ("chi", "psi"):
            assert math.remainder(mine - value, math.tau) == pytest.approx(0.0, abs=1e-12), name
        else:
            assert mine == value, (name, lane)


def actions_of(n, samples):
    """Slow turns and pulls, another one for each flight, within the limits of rates."""
    t, lane = np.arange(samples)[:, None] * 0.025, np.arange(n)
    phi = 0.1 * (np.sin(1.5 * t + lane) - np.sin(lane))
    n_z = 1.0 + 0.05 * (np.sin(3.0 * t + 2.0 * lane) - np.sin(2.0 * lane))
    return np.stack([phi, n_z], axis=2)


WIDE = {"phi_deg": [-40.0, 40.0], "phi_rate_dps": 300.0, "n_z": [0.5, 1.5], "n_z_rate_per_s": 9.0}
AIRS = (None, "tustin", "milspec")
QUICK = ("aerosonde", None), ("aerosonde", "tustin"), ("c172p", "milspec")
LONGER = [
    pytest.param(*both, marks=pytest.mark.soak)
    for both in product(AIRCRAFT_NAMES, AIRS)
    if both not in QUICK
]


GUST = {"axis": "right", "peak_mps": 3.0, "start_s": 0.3, "length_m": 20.0}


def assert_flown_as_by_jsbsim(name, model, lanes, samples, gust=None):
    """Flights of five, which fill no vector, of which one is put back half way and flown again."""
    n, actions = 5, actions_of(5, samples)
    aircraft = ft.compiled.load(name)
    air = {} if model is None else {"turbulence": {"intensity": "light", "model": model}}
    asked = {} if model is None else {"turbulence": "light", "model": model}
    asked, air = (asked | {"gust": gust}, air | {"gust": gust}) if gust else (asked, air)
    speeds = aircraft.trim()["V_a"] * np.linspace(0.98, 1.04, n)
    state = half = aircraft.trim(V_a=speeds, h=1000.0, seed=np.arange(1, n + 1), **asked)
    states = [state]
    for k, given in enumerate(actions):
        half = state if k == samples // 2 else half
        state = aircraft.step(state, given, steps=EACH)
        states.append(state)
    again = half.put(2, half[2])
    for given in actions[samples // 2 :]:
        again = aircraft.step(again, given, steps=EACH)

    for lane in lanes:
        flown = flown_by_jsbsim(name, air, float(speeds[lane]), actions[:, lane], seed=lane + 1)
        for k in (0, 1, 7, samples):
            assert_equal(states[k], lane, flown.iloc[k])
        assert_equal(again, lane, flown.iloc[-1])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "model"), [*QUICK, *LONGER])
def test_every_flight_is_that_of_jsbsim_to_the_bit(name, model):
    assert_flown_as_by_jsbsim(name, model, range(5), 60)


@pytest.mark.slow
def test_flights_through_a_gust_are():
    assert_flown_as_by_jsbsim("aerosonde", None, (0, 4), 60, GUST)


# JSBSim's own aircraft that are adopted; of some no step is compiled.
ADOPTED = sorted(Path(__file__).parents[1].joinpath("adopted").iterdir())


@pytest.mark.counts
@pytest.mark.parametrize("model", AIRS)
@pytest.mark.parametrize("folder", [*AIRCRAFT_NAMES, *ADOPTED], ids=lambda x: Path(x).name)
def test_3000_steps_are_those_of_jsbsim(folder, model):
    try:
        ft.compiled.load(folder).trim()
    except ft.loop.PlantError as why:
        pytest.skip(str(why))
    assert_flown_as_by_jsbsim(str(folder), model, (0, 2, 4), 600)


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
    "a gust along none": (
        lambda a, s: a.trim(gust=GUST | {"axis": "up"}),
        "`axis` must be 'ahead', 'right' or 'down'",
    ),
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
