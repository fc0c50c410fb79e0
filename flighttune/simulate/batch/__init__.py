"""Thousands of kinematic flights at once."""

from flighttune.simulate.batch.flights import Flights, FlownBatch
from flighttune.simulate.batch.fly import fly_continuous, fly_sampled

__all__ = ["Flights", "FlownBatch", "fly_continuous", "fly_sampled"]
