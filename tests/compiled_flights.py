"""The same flight by JSBSim and by compiled code, property by property."""

import math

import numpy as np

import flighttune as ft
from flighttune.base.arrays import same_bits
from flighttune.vehicles.compiled.face import CompiledStep, compiled
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.trim import level

SEED = 7
COMMANDS = (properties.PHI_CMD, properties.N_Z_CMD)


def commands(t):
    """Roll and load factor: a turn, a reversal, climbs and a steep pull."""
    phi = 0.5 * math.sin(0.4 * t) + 0.2 * math.sin(1.7 * t)
    return phi, 1.0 + 0.25 * math.sin(0.9 * t) + (0.3 if 8.0 < t < 9.0 else 0.0)


def started(aircraft, condition=None, **settings):
    """An aircraft in a flight, by default that of its design."""
    plant = ft.loop.JSBSimPlant(aircraft, seed=SEED, **settings)
    design = plant.config.design
    plant.start(condition or level(plant.config, design.V_a, design.h))
    return plant


def flown_by_both(aircraft, seconds, step=None, condition=None, **settings):
    """Rows of each property that both show, by JSBSim and compiled."""
    plant = started(aircraft, condition, **settings)
    step = step or compiled(plant.config, steps=plant.fdm.steps)
    assert isinstance(step, CompiledStep), step.reason
    fdm, names = plant.fdm, step.names
    shown_by_both = {name: i for i, name in enumerate(names.properties) if fdm.shows(name)}
    read = [fdm.reader(name) for name in shown_by_both]
    count = round(seconds * fdm.rate)
    expected = np.empty((count, len(read)))
    for k, row in enumerate(expected):
        assert plant.advance(*commands(k / fdm.rate), 1.0 / fdm.rate) is None
        row[:] = [value() for value in read]
    start = step.start_from(started(aircraft, condition, **settings))
    levers = [names.parameters.index(name) for name in COMMANDS]
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
    return [name for name, rows in flown.items() if not same_bits(*rows).all()]
