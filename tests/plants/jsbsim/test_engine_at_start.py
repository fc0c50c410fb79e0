"""An engine that takes time gives its thrust from the first step of a flight on."""

from pathlib import Path

import pytest

import flighttune as ft
from flighttune.flight.conditions import start_condition
from flighttune.flight.fly import plant_of

TURBOPROP = Path(__file__).parents[2] / "adopted/DHC6/turn.toml"
STEADY = 1e-3
"""Share by which thrust may change in the first second: the torque turns the aircraft."""


@pytest.mark.slow
def test_the_thrust_of_a_turboprop_does_not_fall_after_the_start():
    scenario = ft.load_scenario(TURBOPROP)
    plant = plant_of(scenario.plant[0], scenario)
    plant.start(start_condition(scenario))
    thrust = plant.signals.index("thrust")
    before = plant.observe()[thrust]

    for _ in range(50):
        assert plant.advance(0.0, 1.0, 0.02) is None

    assert plant.observe()[thrust] == pytest.approx(before, rel=STEADY)
