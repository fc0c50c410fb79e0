"""One gain set flown on a ladder of plants, and what each step adds to the difference."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag
from flighttune.errors import InputError
from flighttune.flight.fly import Progress, fly_once, plant_of, steered, wind_met
from flighttune.identify.file import FILE_NAME, load_identified
from flighttune.identify.fit import FittedLag, assessed_lag, fitted_lag
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.plants.base import Plant
from flighttune.plants.point_mass import PointMassPlant
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.run import Run

# A shorter flight cannot be compared, and no lag can be fitted to it.
LEAST_SAMPLES = 12

# If the course reference moves by more between two samples, it may itself wrap the error.
REFERENCE_STEP = math.radians(5.0)

LagSource = Literal["identified", "fitted"]


@dataclass(frozen=True, slots=True, kw_only=True)
class InnerLoop:
    """Lags of roll and load factor."""

    # With the share of the flight's variance that each explains
    phi: FittedLag
    n_z: FittedLag
    source: LagSource  # From the aircraft's model file, or from this flight

    @property
    def lags(self) -> tuple[InnerLag, InnerLag]:
        """Lags of roll and of load factor."""
        return self.phi.lag, self.n_z.lag


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
    # the two failed; see `Ladder.failed`.
    metrics: pd.DataFrame
    flight: pd.Series  # Upper minus lower of `flight_metrics` that both have; NaN as in `metrics`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ladder:
    """Rungs from the paper's law to the aircraft, with the same controller and limits."""

    # Paper's law, exact point mass, point mass behind the inner loop, aircraft; cut to
    # the time that all of them flew, each with the status it ended with
    runs: tuple[Run, ...]
    inner_loop: InnerLoop  # Lags of the third rung, and their source
    steps: tuple[Step, ...]  # Three steps, from each rung to the next
    whole: Step  # From the first rung to the last

    @property
    def failed(self) -> dict[str, str]:
        """Why a rung has no metrics, by plant, lowest first; empty if all were completed."""
        return {run.provenance.plant: why for run in self.runs if (why := _failure(run))}

    @property
    def residual(self) -> float:
        """Largest difference between the sum of the steps and the whole; should be rounding.

        Metrics count only if the whole has them.
        """
        parts = [
            sum((getattr(step, name) for step in self.steps), np.zeros(1))
            - getattr(self.whole, name)
            for name in ("chi", "gamma")
        ]
        for name in ("metrics", "flight"):
            added = sum(getattr(step, name).to_numpy(dtype=float) for step in self.steps)
            parts.append(added - getattr(self.whole, name).to_numpy(dtype=float))
        return max(float(np.max(np.abs(part[np.isfinite(part)]), initial=0.0)) for part in parts)


def fly_ladder(
    scenario: Scenario,
    aircraft: Run,
    *,
    lag: LagSource | None = None,
    progress: Progress | None = None,
) -> Ladder:
    """Fly the lower rungs after the aircraft, in the wind that it met.

    `aircraft` is a flight of at least `LEAST_SAMPLES` samples, else there is an InputError; `lag`
    is the source of the third rung's lag, see `inner_loop_of`.
    """
    gains = aircraft.provenance.gains
    if len(aircraft.signals) < LEAST_SAMPLES:
        raise InputError(
            f"`aircraft` must have flown {LEAST_SAMPLES} samples, got {len(aircraft.signals)}: "
            f"{aircraft.reason}"
        )
    table = aircraft_table(scenario, aircraft.provenance.plant)
    inner_loop = inner_loop_of(table.aircraft or "", scenario, aircraft, wanted=lag)
    limits = scenario.limits.limits().within(plant_of(table, scenario).limits)
    g = scenario.flight.g_mps2
    # In still air JSBSim records a wind of rounding errors; to fly in it takes twice as long.
    wind = None if scenario.weather() is None else wind_met(aircraft)
    lower: dict[str, Plant] = {
        "kinematic": PointMassPlant(turn="paper", wind=wind, g=g),
        "point_mass": PointMassPlant(wind=wind, g=g),
        "point_mass_lag": PointMassPlant(inner_loop.lags, wind=wind, g=g),
    }
    runs = [
        fly_once(
            scenario,
            plant if wind is None else steered(plant, scenario),
            gains,
            plant_label=label,
            gains_name=aircraft.provenance.gains_name,
            limits=limits,
            progress=progress,
        )
        for label, plant in lower.items()
    ]
    return _ladder([*runs, aircraft], inner_loop)


def _ladder(runs: Sequence[Run], inner_loop: InnerLoop) -> Ladder:
    shortest = min(runs, key=lambda run: len(run.signals))
    n = len(shortest.signals)
    if n < LEAST_SAMPLES:
        raise InputError(
            f"{shortest.label} must have flown {LEAST_SAMPLES} samples, got {n}: {shortest.reason}"
        )
    cut = tuple(replace(run, signals=run.signals.iloc[:n]) for run in runs)
    adds = ("turning with actual lift", "lag of the inner loop", "six degrees of freedom")
    return Ladder(
        runs=cut,
        inner_loop=inner_loop,
        steps=tuple(
            _step(lower, upper, what)
            for (lower, upper), what in zip(pairwise(cut), adds, strict=True)
        ),
        whole=_step(cut[0], cut[-1], "total"),
    )


def rung_metrics(run: Run) -> pd.DataFrame:
    """`channel_metrics` of a rung, all NaN if it failed."""
    return channel_metrics(run) * (math.nan if _failure(run) else 1.0)


def _step(lower: Run, upper: Run, adds: str) -> Step:
    below, above = pd.Series(flight_metrics(lower)), pd.Series(flight_metrics(upper))
    # Only these are measured on every rung: a point mass has no angle of attack.
    shared = [name for name in below.index if name in ("V_a_dev_mps", "n_z_min", "n_z_max")]
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
    flight went around, and its overshoot is an artefact of the wrapping. A flight that the user
    interrupted is still valid.
    """
    if run.status not in ("completed", "interrupted"):
        return f"ended early ({run.status.replace('_', ' ')})"
    jumps, moved = (
        np.abs(np.diff(run.signals[f"chi_{part}"].to_numpy())) for part in ("err", "ref")
    )
    wrapped = (jumps > math.pi) & (moved < REFERENCE_STEP)
    return "diverged (course error past 180 deg)" if wrapped.any() else ""


def aircraft_table(scenario: Scenario, plant: str | None = None) -> PlantTable:
    """An aircraft of a scenario, by default the first: the top of the ladder."""
    aircraft = {table.label: table for table in scenario.plant if table.aircraft is not None}
    label = plant or next(iter(aircraft), None)
    if label not in aircraft:
        raise InputError(
            f"`plant` must be an aircraft (jsbsim), of which {scenario.title!r} has "
            f"{', '.join(aircraft) or 'none'}, got {label}."
        )
    return aircraft[label]


def inner_loop_of(
    aircraft: str, scenario: Scenario, run: Run, *, wanted: LagSource | None = None
) -> InnerLoop:
    """The inner loop of an aircraft that has flown, from its model file or fitted to the run.

    The condition of the model file is the one nearest to the airspeed and first climb angle of the
    scenario. By default the file is used if there is one; a ScenarioError says that it is required
    and missing, or cannot be used.
    """
    t = run.t
    phi, n_z = (
        (run.signals[f"{name}_cmd"].to_numpy(), run.signals[name].to_numpy())
        for name in ("phi", "n_z")
    )
    if wanted is None:
        file = Path(load_aircraft(aircraft).file).with_name(FILE_NAME)
        wanted = "identified" if file.exists() else "fitted"
    if wanted == "fitted":
        return InnerLoop(phi=fitted_lag(t, *phi), n_z=fitted_lag(t, *n_z), source=wanted)
    _, gamma = scenario.followed().initial
    roll, load = load_identified(aircraft).nearest(scenario.flight.V_a_mps, gamma).lags
    return InnerLoop(
        phi=assessed_lag(roll, t, *phi), n_z=assessed_lag(load, t, *n_z), source=wanted
    )
