"""From a scenario to runs: every gain set by each law on each plant, with metrics."""

import platform
import shlex
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

from flighttune.base.c_library import c_library
from flighttune.base.errors import OF_A_FLIGHT, DifferenceError, InputError, TrimError
from flighttune.base.files import code
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.control.controller import MAX_LAG_S, Controller, LawError
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import TUNED
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.control.theory.indicators import indicators
from flighttune.flight import conditions, load, models
from flighttune.flight.apart import Progress, apart
from flighttune.flight.entry import Entry, entries, entry_of
from flighttune.flight.flown import FlownScenario, Measured, bound_checks, missed
from flighttune.flight.loop.aircraft import CompiledAircraft, inside
from flighttune.flight.loop.loop import LOOP_SIGNALS, simulate
from flighttune.flight.loop.run import Provenance, Run, RunStatus
from flighttune.flight.metrics import measures
from flighttune.flight.own import LawMaker, PlantMaker, with_own
from flighttune.flight.scenario.load import as_arguments, from_level
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.base import (
    N_X_SIGNALS,
    AirPathPlant,
    GuardedPlant,
    Plant,
    Stop,
    WrappedPlant,
    follows_at_once,
)
from flighttune.vehicles.plants.point_mass import PointMassPlant, PoweredPointMass
from flighttune.vehicles.plants.weather import WIND, WindRecord

VERSIONED = ("flighttune", "numpy", "scipy", "pandas", "jsbsim")

# Maximum time to load an aircraft and find its steady flight, s.
START_S = 20.0

# JSBSim also flies every n-th compiled flight, and every flight that is beyond a bound or within
# this share of it. The number n is prime, so that the repeated flights cycle through the groups of
# a plan. Of a single flight it flies the first seconds, unless the flight decides.
EVERY, NEAR, FIRST_S = 101, 0.1, 20.0

# Numbers of the compiled flights of this process that belong to no plan.
_NUMBERS = count()


@code.flies
def fly(
    scenario: Scenario | str | Path,
    gains: str | Sequence[str] = (),
    *,
    changes: Mapping[str, Any] | None = None,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    progress: Progress | None = None,
) -> FlownScenario:
    """Fly every gain set of a scenario by each of its laws on each of its plants.

    Parameters
    ----------
    scenario : Scenario, str or Path
        The scenario to fly, its file, or the name of a shipped scenario.
    gains : str or sequence of str, optional
        Gain sets by name or file, by default those of the scenario.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.
    laws : mapping of str to callable, optional
        Your own laws by name, in addition to the scenario's laws: each is called with a `LawSetup`
        for every flight and returns a `Controller`.
    plants : mapping of str to callable, optional
        Your own plants by label: each is called for every flight and returns a `Plant`.
    progress : callable, optional
        Called with the progress of each run.

    Returns
    -------
    FlownScenario
        One run for each plant, law and gain set, which takes about 0.05 s for 20 s on a point mass
        and 1 s on an aircraft. If a run diverged, left the envelope, hit the ground or could not
        start, or if its law failed, its status and reason tell so.

    Raises
    ------
    ScenarioError
        If there is no such scenario or gain set, an aircraft does not exist, the start or limits of
        the scenario lie outside it, or a file of a law or plant cannot be loaded.
    PlantError
        If an aircraft cannot be built.
    DifferenceError
        If a compiled flight is not that of JSBSim.

    Examples
    --------
    >>> flown = ft.fly("paper_as_printed", ["paper", "K1"])
    >>> flown.metrics.loc["kinematic / paper", "MO_rad"].round(3).tolist()
    [0.775, 0.362]
    """
    flown = fly_unchecked(
        scenario, gains, changes=changes, laws=laws, plants=plants, progress=progress
    )
    check_flown(flown)
    return flown


@code.flies
def fly_unchecked(
    scenario: Scenario | str | Path,
    gains: str | Sequence[str] = (),
    *,
    changes: Mapping[str, Any] | None = None,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    progress: Progress | None = None,
) -> FlownScenario:
    """The flights of `fly`, for a caller that lets JSBSim repeat them later, by `check_flown`."""
    arguments = "SCENARIO" if isinstance(scenario, Scenario) else as_arguments(scenario, changes)
    wanted = [gains] if isinstance(gains, str) else gains
    scenario = with_own(load.as_scenario(scenario, changes, wanted), laws, plants)
    load.check_scenario(scenario, scenario.title)
    sets, tuning = models.gain_sets(scenario)
    indicators_of = {}
    listed = entries(scenario, sets)
    for entry in listed[: len(sets)]:  # the loop depends on law and gains, not on the plant
        linear = _linear_loop(entry)
        if linear is not None:
            indicators_of[entry.name] = indicators(
                closed_loop(*linear), errors=len(linear[0].errors)
            )
    runs: dict[str, Run] = {}
    # aircraft first, because plants without weather replay an aircraft's wind
    for entry in sorted(listed, key=lambda entry: entry.wind_from is not None):
        run = _flown(entry, entry.wind_from and runs[entry.wind_from.label], progress)
        of_tuning = entry.gains is None and entry.listed == TUNED
        if of_tuning and tuning is not None and tuning.reason:
            run = replace(run, reason=tuning.reason)
        runs[entry.label] = run
    flown = tuple(runs[entry.label] for entry in listed)
    chosen = shlex.join(["--gains", str(wanted[0])]) if wanted else ""
    return FlownScenario(
        scenario, flown, MappingProxyType(indicators_of), tuning, arguments, chosen
    )


def _linear_loop(entry: Entry) -> tuple[LinearModel, PIGains] | None:
    """`linear_loop`; in a copy of this process if the law is a file, which may crash."""
    if not any(key == "law" for key, _ in entry.own):
        return models.linear_loop(entry)
    loop, *_ = apart(lambda _: models.linear_loop(entry), START_S)
    return loop


def _flown(entry: Entry, wind_run: Run | None, progress: Progress | None) -> Run:
    """A flight; in a copy of this process if its law or plant is a file, which may crash."""
    if not entry.own:
        return fly_alone(entry, wind_run=wind_run, progress=progress)
    duration = entry.scenario.flight.duration_s
    silence = duration + MAX_LAG_S + START_S
    flight = partial(fly_alone, entry, wind_run=wind_run)
    run, end, part = apart(lambda report: flight(progress=report), silence, progress)
    if run is not None:
        return run
    key, name = entry.own[0]
    reason = f"{key} {name} after t = {part * duration:.2f} s: its process {end}."
    status = "law_failed" if key == "law" else "plant_failed"
    return _without_samples(provenance(replace(entry, gains=None)), status, reason)


def aircraft_table(scenario: Scenario, plant: str | None = None) -> PlantTable:
    """An aircraft of a scenario by its label, by default the first."""
    aircraft = {table.label: table for table in scenario.aircraft}
    label = plant or next(iter(aircraft), None)
    if label not in aircraft:
        raise InputError(
            f"`plant` must be an aircraft (jsbsim), of which {scenario.title!r} has "
            f"{', '.join(aircraft) or 'none'}, got {label}."
        )
    return aircraft[label]


def plant_of(
    table: PlantTable,
    scenario: Scenario,
    wind: WindRecord | None = None,
    *,
    compiled: bool = False,
    until_s: float | None = None,
) -> Plant:
    """A new plant of a scenario, ready to start; a plant without weather flies in `wind`.

    `compiled`: an aircraft may be flown by its compiled step. `until_s`: JSBSim ends its flight.
    """
    if table.of_the_user:
        return GuardedPlant.made(table.label, table.maker, table.parameters or {})
    if table.aircraft is None:
        # A kind that is listed but made nowhere would fly as a point mass under its own name.
        assert table.family.turn is not None, f"`plant_of` must make plants of kind {table.kind}"
        lags = table.lags()
        options: dict[str, Any] = {
            "wind": wind,
            "disturbance": scenario.disturbance and scenario.disturbance.sinusoid(),
            "turn": table.family.turn,
            "g": scenario.flight.g_mps2,
        }
        if not scenario.airspeed:
            return PointMassPlant(lags, **options)
        limits = conditions.command_limits(scenario)
        n_x = float(limits.lower[2]), float(limits.upper[2])
        return PoweredPointMass(n_x, lags and (*lags, table.thrust_lag()), **options)
    from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant, steps_for

    aircraft = JSBSimPlant(
        table.config,
        steps=steps_for(table.config, scenario.controller.rate_hz),
        seed=scenario.seed,
        weather=conditions.weather_of(scenario),
        ground=scenario.flight.ground_m,
        throttle_max=table.throttle_max,
        throttle_max_from=table.throttle_max_from_s or 0.0,
        off_nominal=table.airframe,
        takes_n_x=scenario.airspeed,
        shows_n_x=bool(scenario.controller.speed_priority),
    )
    if compiled:
        return steered(CompiledAircraft(aircraft), scenario)
    if until_s is not None:
        return steered(EndedPlant(aircraft, until_s), scenario)
    return steered(aircraft, scenario)


class EndedPlant(WrappedPlant):
    """A plant whose flight ends at a time, s."""

    def __init__(self, plant: Plant, until_s: float) -> None:
        super().__init__(plant, ())
        self._left_s = until_s

    def observe(self) -> tuple[float, ...]:
        """The signals of the plant."""
        return self._observe()

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float, *n_x: float) -> Stop | None:
        """Fly `duration` seconds with the command held, as the plant does until its end."""
        self._left_s -= duration
        if self._left_s < 0.0:
            return Stop("left_envelope", "its time is over")
        return self.plant.advance(phi_cmd, n_z_cmd, duration, *n_x)


def steered(plant: Plant, scenario: Scenario) -> Plant:
    """A plant in wind, steered along the path of the scenario over ground or through the air."""
    by_air = scenario.disturbance is not None and scenario.disturbance.path == "air"
    return AirPathPlant(plant) if by_air else plant


def fly_alone(
    entry: Entry,
    *,
    wind_run: Run | None = None,
    progress: Progress | None = None,
    compiled: bool = True,
    until_s: float | None = None,
) -> Run:
    """Fly an entry, in the steady wind unless the flight with its wind is given.

    `compiled`: an aircraft may be flown by its compiled step. `until_s`: JSBSim ends its flight.
    """
    entry = entry.bound()
    scenario = entry.scenario
    if entry.gains is None:
        reason = "tuning found no gains that meet the constraints"
        return _without_samples(provenance(entry), "no_gains", reason)
    if wind_run is None:
        wind = steady_wind(scenario)
    elif len(wind_run.signals):
        wind = wind_met(wind_run)
    else:
        source = wind_run.provenance.plant
        reason = f"the wind is that of {source}, which did not fly: {wind_run.reason}"
        made_by = replace(provenance(entry), gains=entry.gains)
        return _without_samples(made_by, wind_run.status, reason)
    compiled = compiled and not code.jsbsim_flies()
    plant = plant_of(entry.plant, scenario, wind, compiled=compiled, until_s=until_s)
    run = fly_once(entry, plant, lead=entry.lead, progress=progress)
    turns = scenario.turn_back
    if run.status == "no_trim" and turns is not None and turns.or_level and turns.sloped_s is None:
        level = replace(entry, scenario=from_level(scenario))
        return fly_alone(
            level, wind_run=wind_run, progress=progress, compiled=compiled, until_s=until_s
        )
    return run


def steady_wind(scenario: Scenario) -> WindRecord | None:
    """The initial wind of a flight, for plants without weather; None in still air."""
    weather = conditions.weather_of(scenario)
    if weather is None or not scenario.windy:
        return None
    return WindRecord.steady(weather.deterministic(0.0, scenario.flight.h_m))


def wind_met(run: Run) -> WindRecord:
    """The wind recorded by an aircraft, for other plants."""
    return WindRecord(t=run.t, wind=run.signals[list(WIND)].to_numpy())


def fly_once(
    entry: Entry,
    plant: Plant,
    *,
    beside: str = "",
    lead: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> Run:
    """Fly an entry once within its limits, on a plant that has not flown before.

    `beside`: label of a plant that is not in the scenario. The status and reason of a run tell
    whether it diverged, left the envelope, hit the ground or could not start. Only an aircraft that
    cannot be built raises a PlantError.
    """
    started = time.perf_counter()
    entry = entry.bound("law")
    made_by = provenance(entry, beside)
    label, duration = f"{made_by.plant} / {entry.name}", entry.scenario.flight.duration_s
    try:
        controller = controller_on(entry, plant)
        signals, stop = simulate(
            plant,
            controller,
            **manoeuvre(entry, plant, made_by.plant),
            lead=lead,
            progress=None if progress is None else (lambda t: progress(label, t / duration)),
        )
    except LawError as error:
        return _without_samples(made_by, "law_failed", str(error))
    except TrimError as error:
        return _without_samples(made_by, "no_trim", str(error))
    if progress is not None:
        progress(label, 1.0)
    status, reason = ("completed", "") if stop is None else (stop.status, stop.reason)
    made_by = replace(made_by, wall_s=time.perf_counter() - started)
    units = {name: unit for name, unit in controller.signals.items() if name not in SIGNAL_UNITS}
    aircraft = inside(plant, CompiledAircraft)
    compiled = aircraft is not None and aircraft.compiled
    return Run(
        signals=signals,
        status=status,
        reason=reason,
        provenance=made_by,
        units=units,
        compiled=compiled,
        why_jsbsim="" if aircraft is None or compiled else aircraft.refused,
    )


def controller_on(entry: Entry, plant: Plant) -> Controller:
    """The law of an entry with its gains, within the limits of a plant."""
    limits = entry.limits.within(plant.limits)
    setup = models.law_setup(
        entry.scenario, entry.found_gains, limits, at_once=follows_at_once(plant)
    )
    return entry.law.controller(setup)


def decides(entry: Entry, measured: Measured, *, success: bool) -> bool:
    """Whether a flight misses a requirement or is close to its bound."""
    tables = entry.scenario.expected(entry.plant.label, entry.name)
    margins = (check.margin for check in bound_checks(tables, measured) if check.subject != "loop")
    return not (success and all(margin < -NEAR for margin in margins))


def check_flown(flown: FlownScenario) -> None:
    """Repeat in JSBSim what decides among the flights of a scenario, and one flight in `EVERY`."""
    scenario, runs = flown.scenario, {run.label: run for run in flown.runs}
    if not any(run.compiled for run in flown.runs):
        return
    deciding: set[str] = set()
    of_runs: dict[str, Entry] = {}
    for label, run in runs.items():
        made_by = run.provenance
        entry = entry_of(scenario, made_by.gains_name, made_by.gains, made_by.plant)
        source = entry.wind_from or entry
        of_runs[label] = entry
        tables, measured = scenario.expected(made_by.plant, entry.name), measures(run)
        misses = missed(tables, run.status, run.reason, measured, calm=scenario.calm)
        if decides(entry, measured, success=not misses):
            deciding.add(source.label)
    for label, run in runs.items():
        if not run.compiled:
            continue
        if label in deciding:
            check_compiled(of_runs[label], run)
        elif next(_NUMBERS) % EVERY == 0:
            check_compiled(of_runs[label], run, until_s=FIRST_S)


def check_compiled(entry: Entry, run: Run, *, until_s: float | None = None, of: str = "") -> Run:
    """Repeat a compiled run in JSBSim, up to `until_s` (s) if given, and return JSBSim's run.

    DifferenceError names the flight, with `of` before it, and the first signal that differs.
    """
    try:
        again = fly_alone(entry, compiled=False, until_s=until_s)
    except OF_A_FLIGHT as error:
        raise difference(of + run.label, f"JSBSim does not fly it: {error}") from error
    compiled = run.signals if until_s is None else run.signals.iloc[: len(again.signals)]
    what = ""
    if compiled.shape != again.signals.shape:
        what = f"it has {len(compiled)} samples for {len(again.signals)}"
    else:
        # No command ends for the sign of a zero, which only checks of a step compare.
        a, b = (x.to_numpy(dtype=float) for x in (compiled, again.signals))
        same = (a == b) | (np.isnan(a) & np.isnan(b))
        if not same.all():
            first = int(np.argmin(same.all(axis=1)))
            name = compiled.columns[int(np.argmin(same[first]))]
            what = f"`{name}` differs first, at t = {compiled.index[first]:.3f} s"
        elif until_s is None and (run.status, run.reason) != (again.status, again.reason):
            what = f"it ends as {run.status}, not as {again.status}"
    if what:
        raise difference(of + run.label, what)
    return again


def difference(
    subject: str, what: str, remedy: str = "--jsbsim lets JSBSim fly, and its numbers are right"
) -> DifferenceError:
    """The error about a compiled flight, or about several, that differs from JSBSim's."""
    return DifferenceError(
        f"{subject}: the compiled flight must be that of JSBSim, got another: {what}. No compiled "
        f"flight of this command is kept; {remedy}."
    )


def manoeuvre(entry: Entry, plant: Plant, label: str) -> dict[str, Any]:
    """Reference, start, duration and errors of what is seen of a plant's flight, for `simulate`."""
    scenario, flies_in_wind = entry.scenario, WIND[0] in plant.signals
    return {
        "reference": entry.reference,
        "condition": entry.condition if flies_in_wind else conditions.stated_condition(scenario),
        "duration": scenario.flight.duration_s,
        "sensors": scenario.sensors_on(label),
        "navigation": scenario.navigation and scenario.navigation.navigation(scenario.seed),
        # Other plants hold their airspeed on any path.
        "speed_priority": bool(scenario.controller.speed_priority)
        and N_X_SIGNALS[0] in plant.signals,
    }


def _without_samples(made_by: Provenance, status: RunStatus, reason: str) -> Run:
    """A run without samples."""
    no_samples = pd.Index([], name="t")
    signals = pd.DataFrame(columns=pd.Index(LOOP_SIGNALS), index=no_samples, dtype=float)
    return Run(signals=signals, status=status, reason=reason, provenance=made_by)


def provenance(entry: Entry, beside: str = "") -> Provenance:
    """Origin of a run of an entry, or of another plant `beside` it; its time is added later."""
    return Provenance(
        scenario=entry.scenario.as_dict(),
        plant=beside or entry.plant.label,
        gains_name=entry.name,
        # a law without gains (a user's own) leaves the run's gains empty
        gains=entry.gains if entry.law.by_gains else None,
        seed=entry.scenario.seed,
        versions=library_versions(),
        wall_s=0.0,
    )


def library_versions() -> dict[str, str]:
    """Version of every library that affects the numbers of a flight, the C library included."""
    return {"python": platform.python_version(), "libc": c_library(), **_installed()}


@cache
def _installed() -> dict[str, str]:
    """Cached versions, because the lookup takes as long as a tenth of a flight."""
    versions = {name: version(name) for name in VERSIONED}
    with suppress(PackageNotFoundError):  # the package may be missing
        versions["numba"] = version("numba")
    return versions
