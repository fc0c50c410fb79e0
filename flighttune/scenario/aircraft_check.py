"""Check that the aircraft of a scenario exist and, by their files, can fly it."""

from collections.abc import Iterator

from flighttune.aircraft.aircraft import AircraftConfig, load_aircraft, start_faults
from flighttune.errors import InputError, ScenarioError
from flighttune.identify.file import load_identified
from flighttune.mistakes import joined
from flighttune.plants.jsbsim.plant import check_off_nominal
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.units import DEG

# Key of [flight] for each attribute of a condition that an aircraft bounds.
FLIGHT_KEYS = {"V_a": "V_a_mps", "h": "h_m", "phi": "phi_deg", "n_z": "n_z"}


def check_aircraft(scenario: Scenario, source: str) -> None:
    """Refuse a scenario that one of its aircraft cannot start.

    Steady flight at the start is not required here: without it a run ends with a status. The
    ScenarioError names `source`, the file of the scenario, and every key.
    """
    faults = dict.fromkeys(fault for plant in scenario.plant for fault in _faults(scenario, plant))
    if faults:
        raise ScenarioError(f"{source}: {joined(faults)}")
    if scenario.reference.shape is None:
        return
    try:
        scenario.followed()
    except InputError as error:
        raise ScenarioError(f"{source}: {error}") from error


def check_identified(scenario: Scenario, source: str) -> None:
    """Refuse a scenario whose identified model cannot be read, naming `source` and key."""
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
        reason = str(error)
        if not reason.startswith("`aircraft` must"):
            reason = f"`aircraft` must be one that can be read: {reason}"
        yield f"[plant] {reason}"
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
    """Ranges of commands that do not overlap with those of the aircraft."""
    limits = scenario.limits
    for key, asked, (low, high), unit, symbol in (
        ("phi_deg", limits.phi_deg, config.limits.phi, DEG, " deg"),
        ("n_z", limits.n_z, config.limits.n_z, 1.0, ""),
    ):
        if asked is not None and not (asked[0] < high / unit and low / unit < asked[1]):
            yield (
                f"[limits] `{key}` must overlap {low / unit:g} to {high / unit:g}{symbol} "
                f"({config.file}), got {asked}"
            )
