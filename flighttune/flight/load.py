"""A scenario from its file, with its aircraft and models; faults are refused in one line."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from flighttune.base.errors import InfeasibleError, InputError, ScenarioError, TrimError, naming
from flighttune.base.files.shipped import scenario_files
from flighttune.base.files.table import joined, toml_tables, validated
from flighttune.base.units import DEG
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import TUNED_FED_BACK
from flighttune.flight import conditions
from flighttune.flight.entry import Entry, entry_of
from flighttune.flight.models import gain_set, tuning_scaling
from flighttune.flight.scenario.load import (
    existing_file,
    title_with,
    with_changes,
    with_files,
    with_gains,
)
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.items import RouteFile
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, load_aircraft, start_faults
from flighttune.vehicles.identification.file import load_identified
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.jsbsim.plant import check_off_nominal

# What a flight of an identified model says.
LAGS_ALONE = (
    "The aircraft is the lags of an identified model, in steady wind without turbulence. A search "
    "on lags alone once chose parameters that left the route by 175 m: fly a turn onto a leg, and "
    "hold its log beside these flights with `flighttune compare MISSION --with PARAMETERS --log "
    "LOG`."
)

# Key of [flight] for each attribute of a condition with bounds by an aircraft.
FLIGHT_KEYS = {"V_a": "V_a_mps", "h": "h_m", "phi": "phi_deg", "n_z": "n_z"}

# Commands of level flight, by key of [limits], in the key's unit, and the unit in SI.
LEVEL_FLIGHT = {"phi_deg": (0.0, DEG), "n_z": (1.0, 1.0), "n_x": (0.0, 1.0)}

# Tolerance for a route shallower than a glide, rad: 0.1 deg.
OFF_GLIDE = 0.1 * DEG

# Key of the airspeed of a whole flight, or of its start.
SPEED = "flight.V_a_mps"

# Longest flight along the route of a file, s.
LONGEST_S = 10_000.0


def load_scenario(
    path: str | Path, *, changes: Mapping[str, Any] | None = None, gains: Sequence[str] = ()
) -> Scenario:
    """Read and check a scenario file.

    Parameters
    ----------
    path : path-like
        A TOML file, or the name of a scenario that ships with the package.
    changes : mapping of str to value, optional
        Values to set by dotted key, ``{"flight.V_a_mps": 30.0}``; the title then names them.
    gains : sequence of str, optional
        Gain sets that replace the scenario's: names as in runs, or files.

    Returns
    -------
    Scenario
        Frozen and valid.

    Raises
    ------
    ScenarioError
        If the file cannot be read, a key is unknown, missing or impossible, or an aircraft does not
        exist or cannot start at its condition, or a model named in [tuning] cannot be read.

    Examples
    --------
    >>> ft.load_scenario("level_turn").flight.V_a_mps
    25.0
    """
    path = existing_file(path, "scenario", scenario_files(), ["scenarios"])
    stated, source = toml_tables(path), str(path)
    if "scenario" in stated:
        raise ScenarioError(
            f"{path}: must be a scenario, got a campaign, which `flighttune campaign` flies."
        )
    tables = with_files(stated, path)
    scenario = validated(Scenario, tables, source)
    if changes:
        source = f"{path} with its changes"
        tables = with_changes(scenario.as_dict(), changes, f"{source}:")
        scenario = validated(Scenario, tables | {"title": title_with(tables, changes)}, source)
    check_scenario(scenario, source)
    check_identified(scenario, source)
    scenario = scenario.assuming()
    return with_gains(scenario, gains, source) if gains else scenario


def as_scenario(
    source: Scenario | str | Path,
    changes: Mapping[str, Any] | None = None,
    gains: Sequence[str] = (),
) -> Scenario:
    """A scenario itself, or a file's scenario with `changes`; with other `gains` if given."""
    if not isinstance(source, Scenario):
        return load_scenario(source, changes=changes, gains=gains)
    if changes:
        raise InputError(
            f"`changes` must be absent for a scenario that is not read from a file, got "
            f"{', '.join(changes)}."
        )
    return with_gains(source, gains, source.title) if gains else source


def route_scenario(
    file: Path, mission: RouteFile, aircraft: str, changes: Mapping[str, Any] | None = None
) -> Scenario:
    """The scenario that flies a mission file with the limits of an aircraft, or of a model's."""
    first, changes = load_identified(aircraft).conditions[0], changes or {}
    tables = {
        "title": file.stem,
        "law": ["exact"],
        "gains": [TUNED_FED_BACK],
        "flight": {"V_a_mps": first.V_a, "h_m": first.h, "duration_s": LONGEST_S} | mission.flight,
        **_flown_by(aircraft, mission.limits),
        "tuning": {"identified": aircraft},
    }
    route, start = dict(mission.route), tables["flight"]
    if is_model(aircraft):
        route["notes"] = [*route.get("notes", ()), LAGS_ALONE]
    if SPEED in changes:
        route.pop("airspeed_assumed", None)
    elif "V_a_mps" not in mission.flight:
        route["airspeed_assumed"] = True
    speeds = [row["V_mps"] for row in route["waypoint"] if "V_mps" in row]
    if speeds and SPEED not in changes and "holds_airspeed" not in route:
        takes_n_x = not is_model(aircraft) and load_aircraft(aircraft).limits.n_x is not None
        route["holds_airspeed"] = takes_n_x
        if route["holds_airspeed"]:
            tables["controller"] |= {"schedule": True}
        elif max(speeds) >= start["V_a_mps"]:
            start["V_a_mps"] = max(speeds)
            route.pop("airspeed_assumed", None)
    tables = with_changes({**tables, "route": route}, changes, f"{file}:")
    scenario = validated(Scenario, tables, str(file))
    check_scenario(scenario, str(file))
    return scenario.assuming()


def is_model(aircraft: str) -> bool:
    """Whether an aircraft is the file of an identified model, which flies as its lags."""
    return Path(aircraft).suffix == ".json"


def _flown_by(aircraft: str, limits: Mapping[str, Any]) -> dict[str, Any]:
    """Tables of a scenario about an aircraft, or about lags within the limits that are known."""
    if not is_model(aircraft):
        return {
            "limits": dict(limits),
            "controller": {"feed_forward": True, **speed_protected(load_aircraft(aircraft))},
            "plant": [{"kind": "jsbsim", "aircraft": aircraft}],
        }
    model = load_identified(aircraft)
    if (log := model.log) is not None:
        known = log.phi_deg, log.phi_rate_dps, log.n_z, log.n_z_rate_per_s
    else:
        of = load_aircraft(model.aircraft).limits
        known = [x / DEG for x in of.phi], of.phi_rate / DEG, of.n_z, of.n_z_rate
    own = zip(("phi_deg", "phi_rate_dps", "n_z", "n_z_rate_per_s"), known, strict=True)
    return {
        "limits": dict(own) | dict(limits),
        "controller": {"feed_forward": True},
        "plant": [{"kind": "point_mass_lag", "identified": aircraft}],
    }


def speed_protected(config: AircraftConfig) -> dict[str, bool]:
    """Keys of [controller] that protect the airspeed of an aircraft with an engine."""
    return {"speed_priority": True} if config.engines.count else {}


def chosen_entry(
    source: Scenario | str | Path,
    wanted: PIGains | str | None,
    changes: Mapping[str, Any] | None = None,
) -> Entry:
    """The entry of the `wanted` (or first) gains of a scenario with `changes`."""
    scenario = as_scenario(source, changes)
    place = scenario.title if isinstance(source, Scenario) else str(source)
    if isinstance(wanted, PIGains):
        return entry_of(scenario, "gains", wanted)
    if wanted not in (None, *scenario.gain_names):
        scenario, wanted = with_gains(scenario, [wanted], place), None
    name = wanted or scenario.gain_names[0]
    if (gains := gain_set(scenario, name)) is None:
        raise InfeasibleError(f"{place}: `{name}` must be feasible: tuning found no such gains.")
    return entry_of(scenario, name, gains)


def check_scenario(scenario: Scenario, source: str) -> None:
    """Read the aircraft of a scenario; refuse it if an aircraft cannot start or be tuned for."""
    # Steady flight at the start is not required here; without it a run ends with a status.
    with naming(source, ScenarioError):
        if scenario.route is not None:
            conditions.reference_of(scenario)
        conditions.start_condition(scenario)
        conditions.check_roll_in(scenario)
        for plant in scenario.plant:
            conditions.lead_on(scenario, plant)
        tuning_scaling(scenario)
        faults = {fault: None for plant in scenario.plant for fault in _faults(scenario, plant)}
        faults = faults or dict.fromkeys(_level_faults(scenario))
        if scenario.feasible and not faults:
            conditions.reference_of(scenario)
    if faults:
        raise ScenarioError(f"{source}: {joined(faults)}")


def check_identified(scenario: Scenario, source: str) -> None:
    """Read the model that [tuning] names, or refuse it, naming `source` and key."""
    place = f"{source}: [tuning] `identified` must be an aircraft or a model file"
    with naming(place, ScenarioError):
        if scenario.tuning.identified is not None:
            _ = scenario.identified_model


def _faults(scenario: Scenario, plant: PlantTable) -> Iterator[str]:
    if plant.identified is not None:
        key = "[plant] `identified` must be an aircraft or a model file:"
        yield from _fault(key, lambda: plant.identified_model)
    if plant.aircraft is None:
        return
    try:
        config = plant.config
    except InputError as error:
        reason = str(error)
        if not reason.startswith("`aircraft` must"):
            reason = f"`aircraft` must be one that can be read: {reason}"
        yield f"[plant] {reason}"
        return
    if (most := plant.throttle_max) is not None:
        yield from _fault("[plant]", lambda: config.with_throttle_max(most))
    if (off := plant.airframe) is not None:
        yield from _fault(
            "[plant.airframe]", lambda: check_off_nominal(config.with_off_nominal(off))
        )
    if not config.engines.count:
        if scenario.controller.speed_priority:
            yield (
                "[controller] `speed_priority` must be absent or false for an aircraft without an "
                f"engine, {config.folder.name}"
            )
        if scenario.route is not None:
            yield from _glide_faults(scenario, config)
    ground = scenario.flight.ground_m
    for name, fault in start_faults(config, conditions.start_condition(scenario), ground):
        yield f"[flight] `{FLIGHT_KEYS[name]}` {fault}"
    yield from _limit_faults(scenario, config)


def _fault(key: str, read: Callable[[], object]) -> Iterator[str]:
    """The message of an InputError that `read` raises, if any, beginning with `key`."""
    try:
        read()
    except InputError as error:
        yield f"{key} {error}"


def _glide_faults(scenario: Scenario, config: AircraftConfig) -> Iterator[str]:
    """Faults of a route that is flatter than the glide of an aircraft without an engine."""
    from flighttune.vehicles.plants.jsbsim.trim import level  # where only the law flies, no JSBSim

    f = scenario.flight
    try:
        glide = level(config, f.V_a_mps, f.h_m).gamma
    except TrimError:  # the run reports it
        return
    highest = max(conditions.slopes(scenario))
    if highest.air > glide + OFF_GLIDE:
        yield (
            "[plant] `aircraft` must have an engine for a route that is flatter than its glide: "
            f"the path angle is {highest.air / DEG:.1f} deg{highest.over_ground} on the "
            f"{highest.words}, and {Path(config.file).parent.name} glides at {glide / DEG:.1f} deg"
        )


def _limit_faults(scenario: Scenario, config: AircraftConfig) -> Iterator[str]:
    """Faults of commands and airspeeds beyond the aircraft's limits."""
    for key, (least, most), unit, symbol in (
        ("phi_deg", config.limits.phi, DEG, " deg"),
        ("n_z", config.limits.n_z, 1.0, ""),
    ):
        asked, ends = getattr(scenario.limits, key), (least / unit, most / unit)
        if asked is not None and not (asked[0] < ends[1] and ends[0] < asked[1]):
            yield (
                f"[limits] `{key}` must overlap {ends[0]:g} to {ends[1]:g}{symbol} "
                f"({config.file}), got {asked}"
            )
    if not scenario.airspeed:
        return
    low, high = config.envelope.V_a
    where = "[reference]" if scenario.route is None else "[[route.waypoint]]"
    if wrong := [V for V in scenario.airspeeds[1:] if not low < V < high]:
        yield (
            f"{where} `V_mps` must stay inside {low:g} to {high:g} m/s of {config.folder.name}, "
            f"got {wrong[0]:g} m/s"
        )


def _level_faults(scenario: Scenario) -> Iterator[str]:
    """Faults of limits that contain neither the commands of the start nor of level flight."""
    # A flight may begin beyond its limits and return, or turn all the time.
    limits = conditions.limits_on(scenario, scenario.plant)
    bounds = zip(LEVEL_FLIGHT.items(), limits.lower.tolist(), limits.upper.tolist(), strict=False)
    for i, ((key, (level, unit)), low, high) in enumerate(bounds):
        if low <= level * unit <= high:
            continue
        at_start = conditions.start_condition(scenario).commands(len(limits.lower))[i]
        if not low <= at_start <= high:
            yield (
                f"[limits] `{key}` must hold that of steady flight at the start, "
                f"{at_start / unit:.3g}, or of level flight, {level:g}, got {low / unit:g} to "
                f"{high / unit:g}"
            )
