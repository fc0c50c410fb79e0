"""The compiled step of each shipped aircraft against JSBSim, property by property."""

import math

import numpy as np
import pytest

from flighttune.control.controller import FlightCondition
from flighttune.vehicles.compiled.face import CompiledStep, compiled
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.weather import Turbulence, Weather

SEED = 7


def commands(t):
    """Roll and load factor: a turn, a reversal, climbs and a steep pull."""
    phi = 0.5 * math.sin(0.4 * t) + 0.2 * math.sin(1.7 * t)
    return phi, 1.0 + 0.25 * math.sin(0.9 * t) + (0.3 if 8.0 < t < 9.0 else 0.0)


def started(aircraft, turbulence=None):
    """An aircraft in its design flight."""
    weather = turbulence and Weather(
        turbulence=Turbulence(severity=4, wind_20ft=6.0, model=turbulence)
    )
    plant = JSBSimPlant(aircraft, weather=weather, seed=SEED)
    design = plant.config.design
    plant.start(FlightCondition(V_a=design.V_a, h=design.h))
    return plant


def differing(aircraft, seconds, turbulence=None):
    """Properties in which JSBSim and the compiled step differ, and how many were compared."""
    plant = started(aircraft, turbulence)
    step = compiled(plant.config, turbulence=turbulence)
    assert isinstance(step, CompiledStep)
    fdm, names = plant.fdm, step.names
    places = [i for i, name in enumerate(names.properties) if fdm.shows(name)]
    read = [fdm.reader(names.properties[i]) for i in places]
    write = [fdm.writer(name) for name in (properties.PHI_CMD, properties.N_Z_CMD)]
    count = round(seconds * fdm.rate)
    expected = np.empty((count, len(read)))
    for k, row in enumerate(expected):
        for put, value in zip(write, commands(k / fdm.rate), strict=True):
            put(value)
        plant._run()
        row[:] = [value() for value in read]
    start = step.start_from(started(aircraft, turbulence))
    levers = [names.parameters.index(name) for name in (properties.PHI_CMD, properties.N_Z_CMD)]
    shown = np.empty(len(names.signals) + len(names.properties))
    stream = step.normals(SEED, count)
    actual = np.empty_like(expected)
    for k, row in enumerate(actual):
        start.parameters[levers] = commands(k / fdm.rate)
        step.fly(start.states, start.parameters, 1, stream[k], shown)
        row[:] = shown[len(names.signals) :][places]
    same = (expected == actual).all(axis=0)
    return [names.properties[i] for i, equal in zip(places, same, strict=True) if not equal], len(
        places
    )


@pytest.mark.parametrize("aircraft", ["aerosonde", "x8", "a4", "c172p"])
def test_every_property_is_that_of_jsbsim_to_the_bit(aircraft):
    different, compared = differing(aircraft, 10.0)

    assert compared > 200
    assert different == []


@pytest.mark.parametrize("model", ["tustin", "milspec"])
def test_turbulence_is_that_of_jsbsim_to_the_bit(model):
    different, _ = differing("aerosonde", 5.0, model)

    assert different == []
