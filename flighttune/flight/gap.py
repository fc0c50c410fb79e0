"""The gap between the paper's law and an aircraft: one gain set on a ladder of plants."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Literal

import numpy as np
import pandas as pd

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import Law
from flighttune.control.linear_model import closed_loop
from flighttune.errors import InputError
from flighttune.flight.fly import (
    FlownScenario,
    Progress,
    aircraft_table,
    fly_alone,
    fly_once,
    plant_of,
    steered,
    wind_met,
)
from flighttune.guarantee.mismatch import CHANNELS, Mismatch, mismatch
from flighttune.identify.file import FILE_NAME, load_identified
from flighttune.identify.fit import fitted_lag
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.plants.point_mass import PointMassPlant
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import Indicators, indicators

# A shorter flight cannot be compared, and no lag can be fitted to it.
LEAST_SAMPLES = 12

# If the course reference moves by more between two samples, it may itself wrap the error.
REFERENCE_STEP = math.radians(5.0)

# Effects that each rung models and the one below it does not.
ADDS = ("turning with actual lift", "lag of the inner loop", "six degrees of freedom")

LagSource = Literal["identified", "fitted"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One step of the ladder: from a plant to the next one up."""

    # Labels of the two plants
    lower: str
    upper: str
    adds: str  # Effect that only the upper plant models
    # (n,), rad: Upper minus lower at every sample
    chi: FloatArray
    gamma: FloatArray
    # Upper minus lower; index ``chi``, ``gamma`` and columns as `channel_metrics`. NaN if one of
    # the two failed; see `Gap.failed`.
    metrics: pd.DataFrame
    flight: pd.Series  # Upper minus lower of `flight_metrics` that both have; NaN as in `metrics`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gap:
    """Where the difference between the paper's law and the aircraft comes from.

    Attributes
    ----------
    scenario : Scenario
    runs : tuple of Run
        The rungs with the same controller and limits: paper's law, exact point mass, point mass
        behind the inner loop, and the aircraft with its mismatch as signals. They are cut to the
        time that all of them flew, each with the status it ended with. The aircraft alone where it
        did not fly.
    indicators : Indicators
        Indicators of the kinematic law's loop about wings-level flight on the first reference.
    steps : tuple of Step
        Three steps, from each rung to the next; none where the aircraft did not fly.
    whole : Step or None
        From the first rung to the last.
    lags : mapping of str to (InnerLag, float)
        Lags of roll (``phi``) and load factor (``n_z``) of the third rung, with the share of the
        flight's variance that each explains.
    lag_source : "identified", "fitted" or None
        Source of the lags: the aircraft's model file, or this flight.
    mismatch : Mismatch or None
        Mismatch of the aircraft against the paper's law.

    Examples
    --------
    >>> gap = ft.explain_gap(ft.load_scenario("paper"), ft.PAPER_GAINS)
    >>> gap.status, [run.provenance.plant for run in gap.runs]
    ('explained', ['kinematic', 'point_mass', 'point_mass_lag', 'jsbsim:aerosonde'])
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Indicators
    steps: tuple[Step, ...] = ()
    whole: Step | None = None
    lags: Mapping[str, tuple[InnerLag, float]] = field(default_factory=dict)
    lag_source: LagSource | None = None
    mismatch: Mismatch | None = None

    @property
    def status(self) -> Literal["explained", "cut_short", "not_flown"]:
        """Whether all rungs flew to the end; otherwise results are about the time they all flew."""
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
        """Name of the gains, with that of the plant in brackets if the scenario names it."""
        made_by = self.aircraft.provenance
        plant = self.scenario.plant_table(made_by.plant).name
        return f"{made_by.gains_name} ({plant})" if plant else made_by.gains_name

    @property
    def failed(self) -> dict[str, str]:
        """Why a rung has no metrics, by plant, lowest first; empty if all were completed."""
        return {run.provenance.plant: why for run in self.runs if (why := _failure(run))}

    @property
    def residual(self) -> float:
        """Largest difference between the sum of the steps and the whole; should be rounding.

        Metrics count only if the whole has them.
        """
        parts = []
        for name in ("chi", "gamma", "metrics", "flight"):
            steps = [np.asarray(getattr(step, name), dtype=float) for step in self.steps]
            parts.append(np.ravel(sum(steps) - np.asarray(getattr(self.whole, name), dtype=float)))
        return float(np.nanmax(np.abs(np.concatenate(parts))))

    def cause(self, channel: str) -> tuple[str, float] | None:
        """The step that changes the ITAE of a channel most, and by how much; None without ITAE."""
        changes = [(step.adds, float(step.metrics.loc[channel, "ITAE"])) for step in self.steps]
        valid = all(math.isfinite(change) for _, change in changes) and changes
        return max(changes, key=lambda change: abs(change[1])) if valid else None

    def flown(self) -> FlownScenario:
        """The rungs as a flown scenario, to be recorded like any other."""
        names = {run.provenance.gains_name for run in self.runs}
        return FlownScenario(
            self.scenario, self.runs, MappingProxyType(dict.fromkeys(names, self.indicators))
        )


def explain_gap(
    scenario: Scenario,
    gains: PIGains,
    *,
    name: str = "gains",
    plant: str | None = None,
    lag: LagSource | None = None,
    progress: Progress | None = None,
) -> Gap:
    """Fly the same gains up the ladder and measure the effect of each step.

    Parameters
    ----------
    scenario : Scenario
        With a jsbsim plant, the top of the ladder. Its limits and those of the scenario hold on
        every rung.
    gains : PIGains
        The gains flown.
    name : str
        Their name in labels.
    plant : str, optional
        Label of the jsbsim plant; by default the first one.
    lag : {"identified", "fitted"}, optional
        Source of the lag of the third rung: the aircraft's model file, or a fit to this flight; by
        default the model file, if there is one.
    progress : callable, optional
        Called with the progress of each run.

    Returns
    -------
    Gap
        Also where the aircraft does not trim or a rung ends early: its status says so.

    Raises
    ------
    InputError
        If the scenario has no such jsbsim plant.
    PlantError
        If the aircraft cannot be built.

    Examples
    --------
    >>> gap = ft.explain_gap(ft.load_scenario("paper"), ft.PAPER_GAINS)
    >>> [step.adds for step in gap.steps]
    ['turning with actual lift', 'lag of the inner loop', 'six degrees of freedom']
    """
    table = aircraft_table(scenario, plant)
    aircraft = fly_alone(scenario, table, gains, name, progress=progress)
    if len(aircraft.signals) >= LEAST_SAMPLES:
        return explain_flight(scenario, aircraft, lag=lag, progress=progress)
    law, _ = scenario.law_of(name, gains)
    return Gap(scenario=scenario, runs=(aircraft,), indicators=_indicators(scenario, law, gains))


def explain_flight(
    scenario: Scenario,
    aircraft: Run,
    *,
    lag: LagSource | None = None,
    progress: Progress | None = None,
) -> Gap:
    """Explain the gap of an aircraft that has flown: fly the rungs below it in the wind it met.

    `aircraft` is a run of one of the scenario's jsbsim plants; `lag` is as for `explain_gap`. An
    InputError says that a flight is too short or has no gains.
    """
    made_by = aircraft.provenance
    if made_by.gains is None:
        raise InputError(f"`aircraft` must have gains, got none for {aircraft.label}.")
    _check_length(aircraft)
    table = aircraft_table(scenario, made_by.plant)
    lag_source, lags = _inner_loop(table.aircraft or "", scenario, aircraft, lag)
    limits = scenario.command_limits.within(plant_of(table, scenario).limits)
    g = scenario.flight.g_mps2
    # In still air JSBSim records a wind of rounding errors; to fly in it takes twice as long.
    wind = None if scenario.weather() is None else wind_met(aircraft)
    lower = {
        "kinematic": PointMassPlant(turn="paper", wind=wind, g=g),
        "point_mass": PointMassPlant(wind=wind, g=g),
        "point_mass_lag": PointMassPlant((lags["phi"][0], lags["n_z"][0]), wind=wind, g=g),
    }
    runs = [
        fly_once(
            scenario,
            plant if wind is None else steered(plant, scenario),
            made_by.gains,
            plant_label=label,
            gains_name=made_by.gains_name,
            limits=limits,
            progress=progress,
        )
        for label, plant in lower.items()
    ]
    runs.append(aircraft)
    shortest = min(runs, key=lambda run: len(run.signals))
    _check_length(shortest)
    cut = [replace(run, signals=run.signals.iloc[: len(shortest.signals)]) for run in runs]
    measured = mismatch(cut[-1])
    steps = zip(pairwise(cut), ADDS, strict=True)
    return Gap(
        scenario=scenario,
        runs=(*cut[:-1], _with_mismatch(cut[-1], measured)),
        indicators=_indicators(scenario, made_by.law, made_by.gains),
        steps=tuple(_step(below, above, adds) for (below, above), adds in steps),
        whole=_step(cut[0], cut[-1], "total"),
        lags=lags,
        lag_source=lag_source,
        mismatch=measured,
    )


def _check_length(run: Run) -> None:
    if len(run.signals) < LEAST_SAMPLES:
        raise InputError(
            f"{run.label} must have flown {LEAST_SAMPLES} samples, got {len(run.signals)}: "
            f"{run.reason}"
        )


def _indicators(scenario: Scenario, law: Law, gains: PIGains) -> Indicators:
    return indicators(closed_loop(scenario.kinematic_model(law), gains))


def _inner_loop(
    aircraft: str, scenario: Scenario, run: Run, wanted: LagSource | None
) -> tuple[LagSource, dict[str, tuple[InnerLag, float]]]:
    """Lags of an aircraft that has flown, and their source.

    The condition of the model file is the one nearest to the airspeed and first climb angle of the
    scenario. A ScenarioError says that the file is required and missing, or cannot be used.
    """
    flown = {
        name: (run.signals[f"{name}_cmd"].to_numpy(), run.signals[name].to_numpy())
        for name in ("phi", "n_z")
    }
    if wanted is None:
        file = load_aircraft(aircraft).folder / FILE_NAME
        wanted = "identified" if file.exists() else "fitted"
    lags = None, None
    if wanted == "identified":
        _, gamma = scenario.followed().initial
        lags = load_identified(aircraft).nearest(scenario.flight.V_a_mps, gamma).lags
    return wanted, {
        name: fitted_lag(run.t, *signals, lag=lag)
        for (name, signals), lag in zip(flown.items(), lags, strict=True)
    }


def _step(lower: Run, upper: Run, adds: str) -> Step:
    below, above = pd.Series(flight_metrics(lower)), pd.Series(flight_metrics(upper))
    # Only these are measured on every rung: a point mass has no angle of attack.
    shared = ["V_a_dev_mps", "n_z_min", "n_z_max"]
    validity = math.nan if _failure(lower) or _failure(upper) else 1.0
    return Step(
        lower=lower.provenance.plant,
        upper=upper.provenance.plant,
        adds=adds,
        chi=(upper.signals["chi"] - lower.signals["chi"]).to_numpy(),
        gamma=(upper.signals["gamma"] - lower.signals["gamma"]).to_numpy(),
        metrics=validity * (channel_metrics(upper) - channel_metrics(lower)),
        flight=validity * (above - below).loc[shared],
    )


def _failure(run: Run) -> str:
    """Why the metrics of a run are meaningless; empty if they are valid.

    A course error that jumps by more than half a turn while the reference does not has wrapped: the
    flight went around, and its overshoot is an artefact of the wrapping.
    """
    if run.status != "completed":
        return f"ended early ({run.status.replace('_', ' ')})"
    jumps, moved = (
        np.abs(np.diff(run.signals[f"chi_{part}"].to_numpy())) for part in ("err", "ref")
    )
    wrapped = (jumps > math.pi) & (moved < REFERENCE_STEP)
    return "diverged (course error past 180 deg)" if wrapped.any() else ""


def _with_mismatch(run: Run, mismatch: Mismatch) -> Run:
    """The run with the mismatch as signals.

    Values that are constant over a sample interval are stored at its start; the last is repeated.
    """
    columns = {f"mismatch_{name}": mismatch.d[:, i] for i, name in enumerate(CHANNELS)}
    added = {key: np.append(values, values[-1]) for key, values in columns.items()}
    return replace(run, signals=run.signals.assign(**added))
