"""Whether the aircraft of a scenario are there and can fly it as far as their files say."""

from collections.abc import Iterator

from flighttune.errors import InputError, ScenarioError
from flighttune.plants.identification.file import load_identified
from flighttune.plants.jsbsim.aircraft import AircraftConfig, load_aircraft
from flighttune.plants.jsbsim.plant import check_off_nominal
from flighttune.plants.jsbsim.start_check import start_faults
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import Scenario
from flighttune.scenario.sentence import joined
from flighttune.units import DEG

FLIGHT_KEYS = {"V_a": "V_a_mps", "h": "h_m", "phi": "phi_deg", "n_z": "n_z"}
"""Key of [flight] for each attribute of a condition that an aircraft bounds."""


def check_aircraft(scenario: Scenario, source: str) -> None:
    """Refuse a scenario that one of its aircraft cannot start.

    Whether there is steady flight at the start is not looked at: that is a run's status.

    Parameters
    ----------
    scenario : Scenario
    source : str
        File the scenario came from, or what else to call it.

    Raises
    ------
    ScenarioError
        If an aircraft does not exist, or the start or limits of the scenario lie outside it; the
        message names `source` and every key.
    """
    faults = dict.fromkeys(fault for plant in scenario.plant for fault in _faults(scenario, plant))
    if faults:
        raise ScenarioError(f"{source}: {joined(faults)}")


def check_identified(scenario: Scenario, source: str) -> None:
    """Refuse a scenario whose identified model is named and cannot be read.

    Parameters
    ----------
    scenario : Scenario
    source : str
        File the scenario came from, or what else to call it.

    Raises
    ------
    ScenarioError
        If there is no such model; the message names `source` and key.
    """
    if scenario.tuning.identified is None:
        return
    try:
        load_identified(scenario.tuning.identified)
    except InputError as error:
        raise ScenarioError(
            f"{source}: [tuning] `identified` must be an aircraft or a model file: {error}"
        ) from error


def _faults(scenario: Scenario, plant: PlantTable) -> Iterator[str]:
    if plant.aircraft is None:
        return
    try:
        config = load_aircraft(plant.aircraft)
    except InputError as error:
        says = str(error)
        if not says.startswith("`aircraft` must"):
            says = f"`aircraft` must be one that can be read: {says}"
        yield f"[plant] {says}"
        return
    if plant.throttle_max is not None:
        try:
            config.with_throttle_max(plant.throttle_max)
        except InputError as error:
            yield f"[plant] {error}"
    if plant.airframe is not None:
        try:
            check_off_nominal(config.with_off_nominal(plant.airframe.off_nominal()))
        except InputError as error:
            yield f"[plant.airframe] {error}"
    ground = scenario.flight.ground_m
    for name, fault in start_faults(config, scenario.condition, ground):
        yield f"[flight] `{FLIGHT_KEYS[name]}` {fault}"
    yield from _limit_faults(scenario, config)


def _limit_faults(scenario: Scenario, config: AircraftConfig) -> Iterator[str]:
    """Ranges of commands that have nothing in common with those of the aircraft."""
    asked = scenario.limits
    for key, given, (low, high), unit, symbol in (
        ("phi_deg", asked.phi_deg, config.limits.phi, DEG, " deg"),
        ("n_z", asked.n_z, config.limits.n_z, 1.0, ""),
    ):
        if given is not None and not (given[0] < high / unit and low / unit < given[1]):
            yield (
                f"[limits] `{key}` must overlap {low / unit:g} to {high / unit:g}{symbol} "
                f"({config.file}), got {given}"
            )
