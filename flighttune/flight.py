"""A whole scenario: every gain set on every plant, with indicators and metrics beside the runs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import pandas as pd

from flighttune.control.closed_loop import closed_loop
from flighttune.control.gains import PIGains
from flighttune.expectations import missed_expectations
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.one_flight import Progress, fly_once, unflown
from flighttune.outer_loop import gain_set, tune_scenario
from flighttune.plants.air_path import AirPathPlant
from flighttune.plants.base import Plant
from flighttune.plants.kinematic import KinematicPlant
from flighttune.plants.point_mass import PointMassPlant
from flighttune.plants.wind import WindRecord
from flighttune.scenario.aircraft_check import check_aircraft
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import TUNED, Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import Indicators, indicators
from flighttune.tuning.result import TuningResult

LOWEST_FDM_RATE_HZ = 200.0
"""The flight dynamics run at the lowest multiple of the controller's rate from here on."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownScenario:
    """A scenario and all that came of it.

    Attributes
    ----------
    scenario : Scenario
        What was asked for.
    runs : tuple of Run
        Plant by plant, gain set by gain set.
    indicators : mapping of str to Indicators
        R_K and I_K on the linear model of the scenario, by name of the gain set.
    tuning : TuningResult or None
        How the gains named ``tuned`` were found, where the scenario asks for them.
    metrics : DataFrame
        `channel_metrics` of every run flown; index (run, channel).
    flight : DataFrame
        `flight_metrics` of every run flown; index run.
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Mapping[str, Indicators]
    tuning: TuningResult | None
    metrics: pd.DataFrame
    flight: pd.DataFrame

    @property
    def missed(self) -> tuple[str, ...]:
        """What the runs did not come to of what the scenario expects, a sentence each."""
        return missed_expectations(self.scenario, self.runs)

    def metrics_of(self, run: Run) -> dict[str, dict[str, float]]:
        """Measures of one run as numbers: ``chi``, ``gamma`` and ``flight``; empty if not flown."""
        if run.label not in self.flight.index:
            return {}
        channels = self.metrics.loc[run.label].to_dict(orient="index")
        return {**channels, "flight": self.flight.loc[run.label].to_dict()}


class Watcher(Protocol):
    """Who looks on while a scenario is flown.

    Attributes
    ----------
    stopped : bool
        Whether no other run shall begin.
    """

    @property
    def stopped(self) -> bool:
        """Whether no other run shall begin."""
        ...

    def watch(self, plant: Plant, label: str) -> Plant:
        """The plant of a run, wrapped so that it is seen."""
        ...


def fly(
    scenario: Scenario, *, progress: Progress | None = None, watcher: Watcher | None = None
) -> FlownScenario:
    """Fly every gain set of a scenario on each of its plants.

    Parameters
    ----------
    scenario : Scenario
        What to fly.
    progress : callable, optional
        Told how far each run is.
    watcher : Watcher, optional
        Sees every plant while it flies, and may stop the flights.

    Returns
    -------
    FlownScenario
        With one run a plant and gain set. A run that diverged, left the envelope, hit the ground or
        could not start says so in its status and reason.

    Raises
    ------
    ScenarioError
        If an aircraft does not exist, or the start or limits of the scenario lie outside it.
    PlantError
        If an aircraft cannot be built.
    """
    check_aircraft(scenario, scenario.title)
    tuning = tune_scenario(scenario) if TUNED in scenario.gains else None
    names = [entry if isinstance(entry, str) else entry.name for entry in scenario.gains]
    gain_sets = {name: gain_set(scenario, name, tuning) for name in names}
    model = scenario.linear_model()
    runs = _flights(scenario, gain_sets, progress, watcher)
    flown = [run for run in runs if len(run.signals) > 1]
    return FlownScenario(
        scenario=scenario,
        runs=runs,
        indicators=MappingProxyType(
            {
                name: indicators(closed_loop(model, gains))
                for name, gains in gain_sets.items()
                if gains is not None
            }
        ),
        tuning=tuning,
        metrics=pd.concat({run.label: channel_metrics(run) for run in flown}, names=["run"])
        if flown
        else pd.DataFrame(),
        flight=pd.DataFrame.from_dict(
            {run.label: flight_metrics(run) for run in flown}, orient="index"
        ),
    )


def plant_of(table: PlantTable, scenario: Scenario, wind: WindRecord | None = None) -> Plant:
    """A fresh plant of a scenario, ready to start.

    Parameters
    ----------
    table : PlantTable
        Which plant.
    scenario : Scenario
        Its weather, seed and rates.
    wind : WindRecord, optional
        What a plant that is no aircraft flies in; still air by default.

    Raises
    ------
    InputError
        If the aircraft cannot be off the nominal as the table says; the message names the key.
    PlantError
        If the aircraft cannot be built.
    """
    if table.aircraft is None:
        disturbance, g = (
            scenario.disturbance and scenario.disturbance.sinusoid(),
            scenario.flight.g_mps2,
        )
        if table.kind != "kinematic":
            return PointMassPlant(table.lags(), wind=wind, disturbance=disturbance, g=g)
        if wind is not None:
            return PointMassPlant(wind=wind, disturbance=disturbance, law="paper", g=g)
        return KinematicPlant(disturbance, g=g)
    from flighttune.plants.jsbsim.plant import JSBSimPlant

    rate = scenario.controller.rate_hz
    aircraft = JSBSimPlant(
        table.aircraft,
        fdm_rate_hz=rate * math.ceil(LOWEST_FDM_RATE_HZ / rate),
        seed=scenario.seed,
        weather=scenario.weather(),
        ground=scenario.flight.ground_m,
        throttle_max=table.throttle_max,
        off_nominal=table.airframe and table.airframe.off_nominal(),
    )
    return steered(aircraft, scenario)


def steered(plant: Plant, scenario: Scenario) -> Plant:
    """A plant in wind with the path a scenario steers it by: over ground, or through the air.

    Parameters
    ----------
    plant : Plant
        One that shows ground speed and wind.
    scenario : Scenario
        Its ``[disturbance]`` tells which.
    """
    by_air = scenario.disturbance is not None and scenario.disturbance.path == "air"
    return AirPathPlant(plant) if by_air else plant


def _flights(
    scenario: Scenario,
    gain_sets: Mapping[str, PIGains | None],
    progress: Progress | None,
    watcher: Watcher | None,
) -> tuple[Run, ...]:
    """In wind fly aircraft first: the others replay, gain set by gain set, what the first met."""
    order = sorted(scenario.plant, key=lambda plant: scenario.windy and plant.aircraft is None)
    leader = order[0].label if scenario.windy and order[0].aircraft else None
    runs: dict[tuple[str, str], Run] = {}
    for plant in order:
        for name, gains in gain_sets.items():
            led = runs.get((leader or "", name)) if plant.aircraft is None else None
            if watcher is not None and watcher.stopped and gains is not None:
                runs[plant.label, name] = unflown(
                    scenario,
                    gains,
                    "interrupted",
                    "the flights were stopped before this one began",
                    plant_label=plant.label,
                    gains_name=name,
                )
                continue
            runs[plant.label, name] = fly_alone(
                scenario, plant, gains, name, led=led, progress=progress, watcher=watcher
            )
    return tuple(runs[plant.label, name] for plant in scenario.plant for name in gain_sets)


def fly_alone(
    scenario: Scenario,
    table: PlantTable,
    gains: PIGains | None,
    gains_name: str,
    *,
    led: Run | None = None,
    progress: Progress | None = None,
    watcher: Watcher | None = None,
) -> Run:
    """Fly one gain set of a scenario on one of its plants.

    Parameters
    ----------
    scenario : Scenario
    table : PlantTable
        The plant.
    gains : PIGains or None
        None where tuning found none.
    gains_name : str
    led : Run, optional
        The flight of the same gains whose wind a plant that is no aircraft replays; without one it
        flies in the steady wind of the scenario.
    progress, watcher
        As of `fly`.

    Returns
    -------
    Run

    Raises
    ------
    PlantError
        If an aircraft cannot be built.
    """
    if led is not None and gains is not None and not len(led.signals):
        return unflown(
            scenario,
            gains,
            led.status,
            f"the wind is that of {led.provenance.plant}, which did not fly: {led.reason}",
            plant_label=table.label,
            gains_name=gains_name,
        )
    plant = plant_of(table, scenario, _wind_of(scenario, led))
    if watcher is not None:
        plant = watcher.watch(plant, f"{table.label} / {gains_name}")
    return fly_once(
        scenario, plant, gains, plant_label=table.label, gains_name=gains_name, progress=progress
    )


def _wind_of(scenario: Scenario, led: Run | None) -> WindRecord | None:
    """The wind met on a run, or the steady one where no aircraft flies."""
    if led is not None and len(led.signals):
        north, east, down = (
            led.signals[f"wind_{axis}"].to_numpy() for axis in ("north", "east", "down")
        )
        t = led.signals.index.to_numpy(dtype=float)
        return WindRecord(t=t, north=north, east=east, down=down)
    weather = scenario.weather()
    if weather is None or not scenario.windy:
        return None
    north, east, down = weather.deterministic(0.0, scenario.flight.h_m)
    return WindRecord.steady(north=north, east=east, down=down)
