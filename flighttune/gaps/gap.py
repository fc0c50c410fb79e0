"""The ladder from the paper's law to an aircraft: the same gains on each rung, and their gap."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, overload

import numpy as np
import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.errors import InputError
from flighttune.base.files import code
from flighttune.base.files.load import LOG, written
from flighttune.base.signals import CHANNEL_SYMBOLS
from flighttune.control import inner_loop, linear_model
from flighttune.control.gains import COMMANDS, WITH_AIRSPEED, PIGains
from flighttune.control.theory.indicators import Indicators, indicators
from flighttune.flight import fly as flight
from flighttune.flight import load, models
from flighttune.flight.conditions import lead_on, reference_of, weather_of
from flighttune.flight.entry import Entry, entry_of
from flighttune.flight.flown import FlownScenario
from flighttune.flight.loop.run import Claim, Run, with_claims
from flighttune.flight.metrics import channel_metrics, flight_metrics
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.of_log import LogGap, log_gap
from flighttune.gaps.residual import CHANNELS, Mismatch, mismatch
from flighttune.logs.log import Columns
from flighttune.vehicles.identification.file import FILE_NAME
from flighttune.vehicles.identification.fit import fitted_lag
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.plants.point_mass import PointMassPlant, PoweredPointMass

# A shorter flight is too short for a comparison and for the fit of a lag.
LEAST_SAMPLES = 12

# Effects that each rung models and the rung below it does not.
ADDS = ("turning with actual lift", "lag of the inner loop", "six degrees of freedom")

# A larger step of the course reference between two samples may itself wrap the error.
REFERENCE_STEP = math.radians(5.0)

LagSource = Literal["identified", "fitted"]


class Step:
    """One step of the ladder, from a plant to the next, with the effect that it adds.

    Differences are upper minus lower: `chi` and `gamma` (rad) at every sample, `metrics` as
    `channel_metrics`, and `flight` as `flight_metrics` of both. Measures are NaN if one of the two
    failed; see `Gap.failed`.
    """

    def __init__(self, lower: Run, upper: Run, adds: str) -> None:
        self.lower, self.upper = lower.provenance.plant, upper.provenance.plant
        self.adds = adds
        self.chi, self.gamma = (
            (upper.signals[name] - lower.signals[name]).to_numpy() for name in CHANNELS
        )
        valid = math.nan if failure_of(lower) or failure_of(upper) else 1.0
        self.metrics = valid * (channel_metrics(upper) - channel_metrics(lower))
        below, above = (pd.Series(flight_metrics(run)) for run in (lower, upper))
        # Measures that exist on every rung: a point mass has no angle of attack.
        self.flight = valid * (above - below).loc[["V_a_dev_mps", "n_z_min", "n_z_max"]]

    @property
    def values(self) -> dict[str, Any]:
        """The step as ``--json`` has it."""
        metrics = {**self.metrics.to_dict(orient="index"), "flight": self.flight.to_dict()}
        return {"from": self.lower, "to": self.upper, "adds": self.adds, "metrics": metrics}


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gap(Answering):
    """The difference between the paper's law and the aircraft, split into its causes.

    Attributes
    ----------
    scenario : Scenario
    runs : tuple of Run
        The rungs with the same controller and limits: paper's law, exact point mass, point mass
        behind the inner loop, and the aircraft with its mismatch as signals. They are cut to the
        time that all flew, and each keeps its status. Only the aircraft if it did not fly.
    indicators : Indicators
        Indicators of the kinematic law's loop about wings-level flight on the first reference.
    steps : tuple of Step
        Three steps, from each rung to the next; none if the aircraft did not fly.
    whole : Step or None
        From the first rung to the last.
    lags : mapping of str to (InnerLag, float)
        Lags of roll (``phi``) and load factor (``n_z``) of the third rung, with the explained share
        of the flight's variance.
    lag_source : "identified", "fitted" or None
        Source of the lags: the aircraft's model file, or this flight.
    mismatch : Mismatch or None
        Mismatch of the aircraft against the paper's law.
    unplanned : Run or None
        A second flight of the aircraft without planned roll and lift, if the reference rolls in.

    Examples
    --------
    >>> found = ft.gap("paper", ft.PAPER_GAINS)
    >>> found.status, [run.provenance.plant for run in found.runs]
    ('explained', ['kinematic', 'point_mass', 'point_mass_lag', 'jsbsim:aerosonde'])
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Indicators
    steps: tuple[Step, ...] = ()
    whole: Step | None = None
    lags: Mapping[str, tuple[inner_loop.InnerLag, float]] = field(default_factory=dict)
    lag_source: LagSource | None = None
    mismatch: Mismatch | None = None
    unplanned: Run | None = None

    @property
    def status(self) -> Literal["explained", "cut_short", "not_flown"]:
        """Whether all rungs flew to the end; otherwise results cover the time that all flew."""
        if not self.steps:
            return "not_flown"
        return "cut_short" if self.reason else "explained"

    @property
    def reason(self) -> str:
        """Why the status is not ``explained``; else empty."""
        if not self.steps:
            return f"{self.aircraft.label}: {self.aircraft.status}: {self.aircraft.reason}"
        early = next((run for run in self.runs if run.reason), None)
        return f"{early.label}: {early.reason}" if early else ""

    @property
    def aircraft(self) -> Run:
        """The top rung."""
        return self.runs[-1]

    @property
    def name(self) -> str:
        """Name of the gains, with the plant's name in brackets if the scenario names it."""
        made_by = self.aircraft.provenance
        plant = self.scenario.plant_table(made_by.plant).name
        return f"{made_by.gains_name} ({plant})" if plant else made_by.gains_name

    @property
    def failed(self) -> dict[str, str]:
        """Why a rung has no metrics, by plant, lowest first; empty if all were completed."""
        return {run.provenance.plant: why for run in self.runs if (why := failure_of(run))}

    @property
    def residual(self) -> float:
        """Largest difference between the sum of the steps and the whole: rounding errors only."""
        parts = []
        for name in ("chi", "gamma", "metrics", "flight"):
            steps = [np.asarray(getattr(step, name), dtype=float) for step in self.steps]
            parts.append(np.ravel(sum(steps) - np.asarray(getattr(self.whole, name), dtype=float)))
        return float(np.nanmax(np.abs(np.concatenate(parts))))

    def cause(self, channel: str) -> tuple[str, float] | None:
        """The step that changes the ITAE of a channel most, with the change; None without ITAE."""
        changes = [(step.adds, float(step.metrics.loc[channel, "ITAE"])) for step in self.steps]
        valid = all(math.isfinite(change) for _, change in changes) and changes
        return max(changes, key=lambda change: abs(change[1])) if valid else None

    def flown(self) -> FlownScenario:
        """The rungs as a flown scenario, which can be recorded."""
        names = {run.provenance.gains_name for run in self.runs}
        return FlownScenario(
            self.scenario, self.runs, MappingProxyType(dict.fromkeys(names, self.indicators))
        )

    def within(self, *claims: Claim) -> "Gap":
        """The gap with a claim about the aircraft's flight; InputError if it is not covered."""
        return replace(self, runs=(*self.runs[:-1], *with_claims(self.runs[-1:], claims)))

    @property
    def largest_errors(self) -> dict[str, dict[str, float]] | None:
        """Largest errors (rad) with and without planned roll and lift, by channel."""
        if self.unplanned is None:
            return None
        return {
            channel: {
                word: float(run.signals[f"{channel}_err"].abs().max())
                for word, run in (("planned", self.aircraft), ("unplanned", self.unplanned))
            }
            for channel in CHANNEL_SYMBOLS
        }


def failure_of(run: Run) -> str:
    """Why the metrics of a run are meaningless; empty if they are valid."""
    if run.status != "completed":
        return f"ended early ({run.status.replace('_', ' ')})"
    jumps, moved = (
        np.abs(np.diff(run.signals[f"chi_{part}"].to_numpy())) for part in ("err", "ref")
    )
    # The course went past a half turn: its overshoot is an artefact of wrapping.
    wrapped = (jumps > math.pi) & (moved < REFERENCE_STEP)
    return "diverged (course error past 180 deg)" if wrapped.any() else ""


@overload
def gap(
    scenario: Scenario | str | Path,
    gains: PIGains | str | None = None,
    *,
    name: str = "",
    plant: str | None = None,
    lag: LagSource | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: flight.Progress | None = None,
) -> Gap: ...


@overload
def gap(
    scenario: Run | str | Path,
    *,
    aircraft: str | Path,
    columns: Columns = (),
    progress: flight.Progress | None = None,
) -> LogGap: ...


@code.flies
def gap(
    scenario: Scenario | Run | str | Path,
    gains: PIGains | str | None = None,
    *,
    name: str = "",
    plant: str | None = None,
    lag: LagSource | None = None,
    aircraft: str | Path | None = None,
    columns: Columns = (),
    changes: Mapping[str, Any] | None = None,
    progress: flight.Progress | None = None,
) -> Gap | LogGap:
    """Fly the same gains up the ladder, or the commands of a log, and measure each effect.

    A log with an `aircraft` takes half a minute: its commands are flown in up to eight stretches
    on the law, the point mass and the aircraft, and lag, mass, damping and wind are fitted to the
    remaining difference.

    Parameters
    ----------
    scenario : Scenario, Run, str or Path
        A scenario file, or the name of a shipped scenario; or, with `aircraft`, the log of a real
        flight, ``@START:END`` for a part of it in s. A jsbsim plant of the scenario is the top of
        the ladder; limits of scenario and aircraft hold on every rung.
    gains : PIGains or str, optional
        Gains, or a gain set by name or file; by default the first of the scenario.
    name : str
        Name of gains that are given as numbers, for labels.
    plant : str, optional
        Label of the jsbsim plant, by default the first aircraft.
    lag : {"identified", "fitted"}, optional
        Inner-loop lag of the third plant: from the aircraft's model file, or fitted to this flight;
        by default from the model file, if there is one.
    aircraft : str or Path, optional
        Aircraft on which the commands of a log are flown: a shipped aircraft, a folder, or the file
        of an identified model, which has no airframe.
    columns : mapping or sequence
        Columns of the signals in a log, as for `load_log`.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.
    progress : callable, optional
        Called with the progress of each run.

    Returns
    -------
    Gap or LogGap
        Its status tells whether the aircraft did not trim or a rung ended early. For a log: the
        differences from each model that flew its commands, the factors that explain most, with
        intervals at 95 %, and the share that each cause explains.

    Raises
    ------
    InputError
        If the scenario has no such jsbsim plant, or the aircraft cannot fly the commands of a log.
    InfeasibleError
        If tuning finds no such gains.
    PlantError
        If the aircraft cannot be built.

    Examples
    --------
    >>> found = ft.gap("paper", ft.PAPER_GAINS)
    >>> [step.adds for step in found.steps]
    ['turning with actual lift', 'lag of the inner loop', 'six degrees of freedom']
    """
    if aircraft is not None:
        if isinstance(scenario, Scenario) or gains or plant or lag or changes:
            raise InputError("`aircraft` must be given with a log and its columns alone.")
        return log_gap(scenario, aircraft, columns, progress)
    if isinstance(scenario, Run) or written(scenario, LOG, columns=columns):
        raise InputError("`aircraft` must be given with a log: what its commands are flown on.")
    chosen = load.chosen_entry(scenario, gains, changes)
    scenario, table = chosen.scenario, flight.aircraft_table(chosen.scenario, plant)
    entry = entry_of(scenario, name or chosen.name, chosen.gains, table.label)
    top = flight.fly_alone(entry, progress=progress, compiled=False)
    if len(top.signals) >= LEAST_SAMPLES:
        return explain_flight(scenario, top, lag=lag, progress=progress)
    return Gap(scenario=scenario, runs=(top,), indicators=_indicators(entry))


def explain_flight(
    scenario: Scenario,
    aircraft: Run,
    *,
    lag: LagSource | None = None,
    progress: flight.Progress | None = None,
) -> Gap:
    """Explain the gap of an aircraft that has flown by flying the lower rungs in its wind."""
    made_by = aircraft.provenance
    if made_by.gains is None:
        raise InputError(f"`aircraft` must have gains, got none for {aircraft.label}.")
    _check_length(aircraft)
    table = flight.aircraft_table(scenario, made_by.plant)
    entry = entry_of(scenario, made_by.gains_name, made_by.gains, table.label)
    lag_source, lags = _inner_loop(table, scenario, aircraft, lag)
    limits, g = entry.limits, scenario.flight.g_mps2
    # In still air JSBSim records a wind of rounding errors, in which a flight takes twice as long.
    wind = None if weather_of(scenario) is None else flight.wind_met(aircraft)
    make = PointMassPlant
    if scenario.airspeed:
        make = partial(PoweredPointMass, (float(limits.lower[2]), float(limits.upper[2])))
    lower = {
        "kinematic": make(turn="paper", wind=wind, g=g),
        "point_mass": make(wind=wind, g=g),
        "point_mass_lag": make(tuple(lag for lag, _ in lags.values()), wind=wind, g=g),
    }
    runs = [
        flight.fly_once(
            entry,
            plant if wind is None else flight.steered(plant, scenario),
            beside=label,
            progress=progress,
            lead=lead_on(scenario, table if label == "point_mass_lag" else None),
        )
        for label, plant in lower.items()
    ]
    runs.append(aircraft)
    shortest = min(runs, key=lambda run: len(run.signals))
    _check_length(shortest)
    cut = [replace(run, signals=run.signals.iloc[: len(shortest.signals)]) for run in runs]
    unplanned = None
    if scenario.rolls_in:
        unplanned = flight.fly_once(entry, flight.plant_of(table, scenario), progress=progress)
    measured = mismatch(cut[-1])
    # constant over a sample interval and stored at its start; the last value is repeated
    samples = np.vstack([measured.d, measured.d[-1:]])
    columns = {f"mismatch_{name}": samples[:, i] for i, name in enumerate(CHANNELS)}
    return Gap(
        scenario=scenario,
        runs=(*cut[:-1], replace(cut[-1], signals=cut[-1].signals.assign(**columns))),
        indicators=_indicators(entry),
        steps=tuple(Step(*pair, adds) for pair, adds in zip(pairwise(cut), ADDS, strict=True)),
        whole=Step(cut[0], cut[-1], "total"),
        lags=lags,
        lag_source=lag_source,
        mismatch=measured,
        unplanned=unplanned,
    )


def _check_length(run: Run) -> None:
    if len(run.signals) < LEAST_SAMPLES:
        raise InputError(
            f"{run.label} must have flown {LEAST_SAMPLES} samples, got {len(run.signals)}: "
            f"{run.reason}"
        )


def _indicators(entry: Entry) -> Indicators:
    model = models.law_model(entry.scenario, entry.law)
    return indicators(linear_model.closed_loop(model, entry.found_gains))


def _inner_loop(
    table: PlantTable, scenario: Scenario, run: Run, source: LagSource | None
) -> tuple[LagSource, dict[str, tuple[inner_loop.InnerLag, float]]]:
    """Source and lags of an aircraft that has flown: from the nearest condition, or fitted."""
    commanded_and_flown = {
        name: (run.signals[f"{name}_cmd"].to_numpy(), run.signals[name].to_numpy())
        for name in (WITH_AIRSPEED[COMMANDS] if scenario.airspeed else COMMANDS)
    }
    if source is None:
        source = "identified" if (table.config.folder / FILE_NAME).exists() else "fitted"
    lags = (None,) * len(commanded_and_flown)
    if source == "identified":
        _, gamma = reference_of(scenario).initial
        nearest = table.identified_model.nearest(scenario.flight.V_a_mps, gamma)
        lags = (*nearest.lags, nearest.thrust_lag) if scenario.airspeed else nearest.lags
    return source, {
        name: fitted_lag(run.t, *signals, lag=lag)
        for (name, signals), lag in zip(commanded_and_flown.items(), lags, strict=True)
    }
