"""The same flight by JSBSim and by compiled code, property by property."""

import math

import numpy as np
from airframes import varied

import flighttune as ft
from flighttune.vehicles.plants.jsbsim import steps

SEED = 7


def commands(t):
    """Roll and load factor: a turn, a reversal, climbs and a steep pull."""
    phi = 0.5 * math.sin(0.4 * t) + 0.2 * math.sin(1.7 * t)
    return phi, 1.0 + 0.25 * math.sin(0.9 * t) + (0.3 if 8.0 < t < 9.0 else 0.0)


def step_of(config, weather=None, **settings):
    """The compiled step of an aircraft in this weather; a step that is refused fails the test."""
    turbulence, gust = (weather.turbulence, weather.gust) if weather else (None, None)
    model = turbulence and turbulence.model
    step = steps.compiled(config, turbulence=model, gust=gust is not None, **settings)
    assert not hasattr(step, "reason"), step.reason
    return step


def why_not(aircraft, air=None, **keys):
    """Why JSBSim flies an aircraft itself, with the keys of `airframe`; empty if it is compiled.

    `air`: its turbulence and gust, by default none.
    """
    return getattr(steps.compiled(varied(aircraft, **keys), **(air or {})), "reason", "")


def started(aircraft, condition=None, fdm=None, **settings):
    """An aircraft in a flight, by default that of its design."""
    plant = ft.loop.JSBSimPlant(aircraft, seed=SEED, **settings)
    design = plant.config.design
    plant.start(condition or ft.loop.FlightCondition(V_a=design.V_a, h=design.h), fdm)
    return plant


def flown_by_both(aircraft, seconds, condition=None, *, starts=False, **settings):
    """Rows of each property that both show, by JSBSim and compiled; `starts`: compiled too."""
    plant = started(aircraft, condition, **settings)
    config, of_air = plant.config, settings.get("weather")
    step = step_of(config, of_air, steps=settings.get("steps", 1))
    fdm, names = plant.fdm, step.names
    shown_by_both = {name: i for i, name in enumerate(names.properties) if fdm.shows(name)}
    read = [fdm.reader(name) for name in shown_by_both]
    count = round(seconds * fdm.rate)
    expected = np.empty((count, len(read)))
    for k, row in enumerate(expected):
        assert plant.advance(*commands(k / fdm.rate), 1.0 / fdm.rate) is None
        row[:] = [value() for value in read]
    by_code = steps.evaluated(config, ground=settings.get("ground", 0.0)) if starts else None
    assert bool(by_code) == starts
    start = steps.start_of(step, started(aircraft, condition, by_code, **settings))
    levers = [names.parameters.index(f"ft/{name}") for name in ("phi-cmd-rad", "n_z-cmd")]
    shown = np.empty(len(names.signals) + len(names.properties))
    stream = step.normals(start.random, count)
    actual = np.empty_like(expected)
    for k, row in enumerate(actual):
        start.parameters[levers] = commands(k / fdm.rate)
        step.fly(start.states, start.parameters, 1, stream[k : k + 1], shown)
        row[:] = shown[len(names.signals) :][list(shown_by_both.values())]
    return {name: (expected[:, j], actual[:, j]) for j, name in enumerate(shown_by_both)}


def differing(flown):
    """Names of properties that are not equal to the bit in each step."""
    return [name for name, rows in flown.items() if len({row.tobytes() for row in rows}) > 1]
