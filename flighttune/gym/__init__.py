"""Environments of Gymnasium: `FlightEnv` of one flight, `FlightVectorEnv` of many at once."""

from flighttune.gym.env import NAME as NAME
from flighttune.gym.env import FlightEnv
from flighttune.gym.stable import stable_baselines
from flighttune.gym.vector import FlightVectorEnv

__all__ = ["FlightEnv", "FlightVectorEnv", "stable_baselines"]
