"""TOML to a validated scenario."""

from flighttune.scenario.load import load_gains, load_scenario, scenario_from
from flighttune.scenario.schema import Scenario

__all__ = ["Scenario", "load_gains", "load_scenario", "scenario_from"]
