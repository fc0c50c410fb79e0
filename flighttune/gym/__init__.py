"""Scenarios, campaigns and routes as environments of Gymnasium, of one flight and of many."""

from importlib.util import find_spec

from flighttune.gym.flight import FlightEnv
from flighttune.gym.stable import stable_baselines
from flighttune.gym.vector import FlightVectorEnv

__all__ = ["FlightEnv", "FlightVectorEnv", "stable_baselines"]

# Its name in Gymnasium, whose options are those of the environments, and the world by default.
NAME, WORLD = "flighttune/Flight-v0", "level_turn"

if find_spec("gymnasium"):
    from gymnasium import register

    register(
        NAME,
        "flighttune.gym:FlightEnv",
        vector_entry_point="flighttune.gym:FlightVectorEnv",
        kwargs={"world": WORLD, "scaled": True},
    )
