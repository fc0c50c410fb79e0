"""A scenario to runs: every gain set on every plant, with indicators and metrics."""

import platform
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from types import MappingProxyType
from typing import Protocol

import pandas as pd

from flighttune.control.controller import LawSetup
from flighttune.control.gains import PIGains
from flighttune.control.guarded import LawError
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.errors import TrimError
from flighttune.flight.expectations import ClaimCheck, check_claim
from flighttune.flight.outer_loop import gain_sets
from flighttune.flight.own import LawMaker, PlantMaker, with_own
from flighttune.metrics import metric_tables
from flighttune.plants.air_path import AirPathPlant
from flighttune.plants.base import Plant
from flighttune.plants.guarded import GuardedPlant
from flighttune.plants.point_mass import PointMassPlant
from flighttune.plants.wind import WIND, WindRecord
from flighttune.scenario.aircraft_check import check_aircraft
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.loop import LOOP_SIGNALS, simulate
from flighttune.simulate.run import SIGNAL_UNITS, Provenance, Run, RunStatus
from flighttune.theory.indicators import Indicators, indicators
from flighttune.tuning.result import TuningResult

"""The flight dynamics run at the lowest multiple of the controller's rate from here on."""

VERSIONED = ("flighttune", "numpy", "scipy", "pandas", "jsbsim")

Progress = Callable[[str, float], None]
"""Called with the label of a run and the part of it flown, 0 to 1."""


@dataclass(frozen=True, eq=False)
class FlownScenario:
    """A scenario with its runs, indicators and metrics.

    Attributes
    ----------
    scenario : Scenario
    runs : tuple of Run
        Plant by plant, gain set by gain set.
    indicators : mapping of str to Indicators
        R_K and I_K on the linear model of the scenario, by name of the gain set.
    tuning : TuningResult or None
        Result of the tuning of the gains ``tuned``, where the scenario asks for them.
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Mapping[str, Indicators]
    tuning: TuningResult | None = None

    @property
    def metrics(self) -> pd.DataFrame:
        """`channel_metrics` of every run flown; index (run, channel)."""
        return self._tables[0]

    @property
    def flight(self) -> pd.DataFrame:
        """`flight_metrics` of every run flown; index run."""
        return self._tables[1]

    @cached_property
    def _tables(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        return metric_tables(self.runs)

    def __getitem__(self, label: str) -> Run:
        return next(run for run in self.runs if run.label == label)

    @property
    def claim(self) -> ClaimCheck:
        """The runs against the ``[[expect]]`` tables of the scenario."""
        return check_claim(self.scenario, self.runs)

    def metrics_of(self, run: Run) -> dict[str, dict[str, float]]:
        """Measures of one run as numbers: ``chi``, ``gamma`` and ``flight``; empty if not flown."""
        if run.label not in self.flight.index:
            return {}
        channels = self.metrics.loc[run.label].to_dict(orient="index")
        return {**channels, "flight": self.flight.loc[run.label].to_dict()}


class Observer(Protocol):
    """Sees the flights of a scenario while they are flown, and may end them."""

    @property
    def stopped(self) -> bool:
        """True once no further run may begin."""
        ...

    def watch(self, plant: Plant, label: str) -> Plant:
        """Wrap the plant of a run, so that the observer sees its signals."""
        ...


def fly(
    scenario: Scenario,
    *,
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    progress: Progress | None = None,
    observer: Observer | None = None,
) -> FlownScenario:
    """Fly every gain set of a scenario by each of its laws on each of its plants.

    Parameters
    ----------
    scenario : Scenario
        The scenario to fly.
    laws : mapping of str to callable, optional
        Laws of your own by name, flown besides those of the scenario: each is called with a
        `LawSetup` for every flight and returns a `Controller`.
    plants : mapping of str to callable, optional
        Plants of your own by label: each is called for every flight and returns a `Plant`.
    progress : callable, optional
        Called with how far each run is.
    observer : Observer, optional

    Returns
    -------
    FlownScenario
        With one run a plant, law and gain set. A run that diverged, left the envelope, hit the
        ground, could not start, or whose law failed says so in its status and reason.

    Raises
    ------
    ScenarioError
        If an aircraft does not exist, the start or limits of the scenario lie outside it, or a file
        of a law or plant cannot be loaded.
    PlantError
        If an aircraft cannot be built.
    """
    scenario = with_own(scenario, laws, plants)
    check_aircraft(scenario, scenario.title)
    sets, tuning = gain_sets(scenario)
    indicators_of = {}
    for name, gains in sets.items():
        linear = None if gains is None else linear_loop(scenario, name, gains)
        if linear is not None:
            indicators_of[name] = indicators(closed_loop(*linear))
    runs = _flights(scenario, sets, progress, observer)
    return FlownScenario(scenario, runs, MappingProxyType(indicators_of), tuning)


def linear_loop(
    scenario: Scenario, name: str, gains: PIGains
) -> tuple[LinearModel, PIGains] | None:
    """The linear model that a law acts on, and its gains; None where it has none.

    The scenario holds the classes of the user's laws, as `with_own` returns it.
    """
    law, _ = scenario.law_of(name, gains)
    setup = law_setup(scenario, gains, scenario.limits.limits())
    return law.loop(scenario.linear_model(law), gains, setup)


def law_setup(scenario: Scenario, gains: PIGains, limits: Limits) -> LawSetup:
    """The setup from which a law of a scenario is made."""
    settings, flight = scenario.controller, scenario.flight
    return LawSetup(
        dt=1.0 / settings.rate_hz,
        limits=limits,
        gains=gains,
        g=flight.g_mps2,
        scenario=scenario.as_dict(),
        anti_windup=settings.anti_windup,
        tracking_time=settings.tracking_time_s,
        schedule_speed=flight.V_a_mps if settings.schedule else None,
        feed_forward=settings.feed_forward,
    )


def plant_of(
    table: PlantTable,
    scenario: Scenario,
    wind: WindRecord | None = None,
) -> Plant:
    """A fresh plant of a scenario, ready to start.

    A plant that is no aircraft flies in `wind`, by default in still air. An InputError names
    the key of an off-nominal value that the aircraft cannot have.
    """
    if table.of_the_user:
        return GuardedPlant.made(table.label, table.maker, table.parameters or {})
    if table.aircraft is None:
        return PointMassPlant(
            table.lags(),
            wind=wind,
            disturbance=None if scenario.disturbance is None else scenario.disturbance.sinusoid(),
            law=table.family.turn,
            g=scenario.flight.g_mps2,
        )
    from flighttune.aircraft.aircraft import load_aircraft
    from flighttune.plants.jsbsim.plant import JSBSimPlant, steps_for

    config = load_aircraft(table.aircraft)
    aircraft = JSBSimPlant(
        config,
        steps=steps_for(config, scenario.controller.rate_hz),
        seed=scenario.seed,
        weather=scenario.weather(),
        ground=scenario.flight.ground_m,
        throttle_max=table.throttle_max,
        off_nominal=None if table.airframe is None else table.airframe.off_nominal(),
    )
    return steered(aircraft, scenario)


def steered(plant: Plant, scenario: Scenario) -> Plant:
    """A plant in wind with the path a scenario steers it by: over ground, or through the air."""
    by_air = scenario.disturbance is not None and scenario.disturbance.path == "air"
    return AirPathPlant(plant) if by_air else plant


def _flights(
    scenario: Scenario,
    sets: Mapping[str, PIGains | None],
    progress: Progress | None,
    observer: Observer | None,
) -> tuple[Run, ...]:
    # In wind the first aircraft flies first: plants without weather replay the wind it met.
    order = sorted(scenario.plant, key=lambda plant: scenario.windy and plant.aircraft is None)
    source = scenario.wind_source
    runs: dict[tuple[str, str], Run] = {}
    for plant in order:
        for name, gains in sets.items():
            if observer is not None and observer.stopped and gains is not None:
                reason = "the flights were stopped before this one began"
                made_by = _provenance(scenario, plant.label, name, gains)
                run = _unflown(made_by, "interrupted", reason)
            else:
                replays = source is not None and plant.aircraft is None
                run = fly_alone(
                    scenario,
                    plant,
                    gains,
                    name,
                    wind_run=runs[source.label, name] if source and replays else None,
                    progress=progress,
                    observer=observer,
                )
            runs[plant.label, name] = run
    return tuple(runs[plant.label, name] for plant in scenario.plant for name in sets)


def fly_alone(
    scenario: Scenario,
    table: PlantTable,
    gains: PIGains | None,
    gains_name: str,
    *,
    wind_run: Run | None = None,
    progress: Progress | None = None,
    observer: Observer | None = None,
) -> Run:
    """Fly one gain set of a scenario on one of its plants.

    `gains` is None where tuning found none. A plant that is no aircraft replays the wind of
    `wind_run`, a flight of the same gains; without one it flies in the steady wind of the scenario.
    """
    if wind_run is not None and gains is not None and not len(wind_run.signals):
        source = wind_run.provenance.plant
        reason = f"the wind is that of {source}, which did not fly: {wind_run.reason}"
        made_by = _provenance(scenario, table.label, gains_name, gains)
        return _unflown(made_by, wind_run.status, reason)
    scenario, wind = with_own(scenario), _steady_wind(scenario)
    if wind_run is not None and len(wind_run.signals):
        wind = wind_met(wind_run)
    plant = plant_of(scenario.plant_table(table.label), scenario, wind)
    if observer is not None:
        plant = observer.watch(plant, f"{table.label} / {gains_name}")
    return fly_once(
        scenario,
        plant,
        gains,
        plant_label=table.label,
        gains_name=gains_name,
        progress=progress,
    )


def wind_met(run: Run) -> WindRecord:
    """The wind that an aircraft recorded, for other plants to fly in."""
    north, east, down = (run.signals[name].to_numpy() for name in WIND)
    t = run.t
    return WindRecord(t=t, north=north, east=east, down=down)


def _steady_wind(scenario: Scenario) -> WindRecord | None:
    weather = scenario.weather()
    if weather is None or not scenario.windy:
        return None
    north, east, down = weather.deterministic(0.0, scenario.flight.h_m)
    return WindRecord.steady(north=north, east=east, down=down)


def fly_once(
    scenario: Scenario,
    plant: Plant,
    gains: PIGains | None,
    *,
    plant_label: str,
    gains_name: str,
    limits: Limits | None = None,
    progress: Progress | None = None,
) -> Run:
    """Fly the manoeuvre of a scenario once, on a plant that has not flown before.

    `gains` is None where tuning found none: the run then says so. `limits` are by default those of
    the scenario and of the plant. A run that diverged, left the envelope, hit the ground or could
    not start says so in its status and reason; only an aircraft that cannot be built raises a
    PlantError.
    """
    if gains is None:
        reason = "tuning found no gains that meet the constraints"
        made_by = _provenance(scenario, plant_label, gains_name, None)
        return _unflown(made_by, "no_gains", reason)
    started = time.perf_counter()
    duration = scenario.flight.duration_s
    if limits is None:
        limits = scenario.limits.limits().within(plant.limits)
    scenario = with_own(scenario)
    law, _ = scenario.law_of(gains_name, gains)
    # A law that gains do not describe flies by something of its own, and its run has none.
    made_by = _provenance(scenario, plant_label, gains_name, gains if law.by_gains else None)
    try:
        controller = law.controller(law_setup(scenario, gains, limits))
    except LawError as error:
        return _unflown(made_by, "law_failed", str(error))
    label = f"{plant_label} / {gains_name}"
    try:
        signals, stop = simulate(
            plant,
            controller,
            scenario.followed(),
            condition=scenario.condition,
            duration=duration,
            sensors=None if scenario.sensors is None else scenario.sensors.sensors(scenario.seed),
            progress=None if progress is None else (lambda t: progress(label, t / duration)),
        )
    except TrimError as error:
        return _unflown(made_by, "no_trim", str(error))
    if progress is not None:
        progress(label, 1.0)
    wall_s = time.perf_counter() - started
    return Run(
        signals=signals,
        status="completed" if stop is None else stop.status,
        reason="" if stop is None else stop.reason,
        provenance=replace(made_by, wall_s=wall_s),
        units={name: u for name, u in controller.signals.items() if name not in SIGNAL_UNITS},
    )


def _unflown(made_by: Provenance, status: RunStatus, reason: str) -> Run:
    """The run, without samples, of a flight that could not begin."""
    signals = pd.DataFrame(
        columns=pd.Index(LOOP_SIGNALS), index=pd.Index([], name="t"), dtype=float
    )
    return Run(signals=signals, status=status, reason=reason, provenance=made_by)


def _provenance(
    scenario: Scenario, plant_label: str, gains_name: str, gains: PIGains | None
) -> Provenance:
    return Provenance(
        scenario=scenario.as_dict(),
        plant=plant_label,
        gains_name=gains_name,
        gains=gains,
        seed=scenario.seed,
        versions=library_versions(),
        wall_s=0.0,
    )


def library_versions() -> dict[str, str]:
    """Version of every library that shapes the numbers of a flight."""
    return dict(_installed())


@cache
def _installed() -> tuple[tuple[str, str], ...]:
    """Names and versions, looked up once: it takes as long as a tenth of a flight."""
    versions = [("python", platform.python_version())]
    versions += [(name, version(name)) for name in VERSIONED]
    with suppress(PackageNotFoundError):  # it need not be there; rows of a batch are its own
        versions.append(("numba", version("numba")))
    return tuple(versions)
