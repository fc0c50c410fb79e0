"""The same law flown up a ladder of plants, and what each step adds to the difference."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.errors import InputError
from flighttune.flight import plant_of, steered
from flighttune.gap.inner_loop import InnerLoop, LagSource, inner_loop_of
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.one_flight import Progress, fly_once
from flighttune.plants.base import Plant
from flighttune.plants.kinematic import KinematicPlant
from flighttune.plants.point_mass import PointMassPlant
from flighttune.plants.wind import WindRecord
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run

LEAST_SAMPLES = 12
"""A rung that flew less says nothing."""

REFERENCE_STEP = math.radians(5.0)
"""A course reference that moves by more between two samples may wrap the error by itself."""

WIND = ("wind_north", "wind_east", "wind_down")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Step:
    """One step of the ladder: from a plant to the next one up.

    Attributes
    ----------
    lower, upper : str
        Labels of the two plants.
    adds : str
        What the upper one knows and the lower one does not.
    chi, gamma : ndarray, shape (n,), rad
        Upper minus lower at every sample.
    metrics : DataFrame
        Upper minus lower; index ``chi``, ``gamma`` and columns as `channel_metrics`. NaN where one
        of the two failed; see `Ladder.failed`.
    flight : Series
        Upper minus lower of `flight_metrics` that both have; NaN as in `metrics`.
    """

    lower: str
    upper: str
    adds: str
    chi: FloatArray
    gamma: FloatArray
    metrics: pd.DataFrame
    flight: pd.Series


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ladder:
    """Rungs from the paper's law to the aircraft, all flown by the same law under the same limits.

    Attributes
    ----------
    runs : tuple of Run, length 4
        Paper's law, exact point mass, point mass behind the inner loop, aircraft; cut to the time
        all of them flew, with the status each ended with.
    inner_loop : InnerLoop
        Lags of the third rung, and where they come from.
    steps : tuple of Step, length 3
    whole : Step
        From the first rung to the last.
    """

    runs: tuple[Run, ...]
    inner_loop: InnerLoop
    steps: tuple[Step, ...]
    whole: Step

    @property
    def failed(self) -> dict[str, str]:
        """Why a rung has no metrics, by plant, lowest first; empty where all flew to the end."""
        return {run.provenance.plant: why for run in self.runs if (why := _failure(run))}

    def known_metrics(self, run: Run) -> pd.DataFrame:
        """`channel_metrics` of a rung, all NaN where it failed."""
        return channel_metrics(run) * (math.nan if _failure(run) else 1.0)

    @property
    def residual(self) -> float:
        """Largest difference between the sum of the steps and the whole; rounding, or an error.

        Of metrics where the whole has them.
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


def fly_aircraft(
    scenario: Scenario,
    gains: PIGains | None,
    name: str,
    *,
    plant: str | None = None,
    progress: Progress | None = None,
) -> Run:
    """Fly the top rung: a jsbsim plant of a scenario.

    Parameters
    ----------
    scenario : Scenario
    gains : PIGains or None
        None where tuning found none.
    name : str
        Name of the gains in labels.
    plant : str, optional
        Label of the plant, where it is not the first one.
    progress : callable, optional
        As of `flighttune.flight.fly`.

    Raises
    ------
    InputError
        If the scenario has no such plant.
    PlantError
        If the aircraft cannot be built.
    """
    table = aircraft_table(scenario, plant)
    return fly_once(
        scenario, plant_of(table, scenario), gains,
        plant_label=table.label, gains_name=name, progress=progress,
    )  # fmt: skip


def climb(
    scenario: Scenario,
    aircraft: Run,
    *,
    lag: LagSource | None = None,
    progress: Progress | None = None,
) -> Ladder:
    """Fly the lower rungs after the aircraft has flown, in the air that it met.

    Parameters
    ----------
    scenario : Scenario
        With a jsbsim plant.
    aircraft : Run
        What `fly_aircraft` returns, of at least `LEAST_SAMPLES` samples.
    lag : {"identified", "fitted"}, optional
        Where the lag of the third rung comes from; see `inner_loop_of`.
    progress : callable, optional
        Told how far each run is.

    Returns
    -------
    Ladder

    Raises
    ------
    InputError
        If a rung has too few samples.
    ScenarioError
        If a model of the inner loop cannot be used.
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
    g, wind = scenario.flight.g_mps2, _wind_met(aircraft)
    lower: dict[str, Plant] = {
        "kinematic": KinematicPlant(g=g)
        if wind is None
        else PointMassPlant(law="paper", wind=wind, g=g),
        "point_mass": PointMassPlant(wind=wind, g=g),
        "point_mass_lag": PointMassPlant(inner_loop.lags, wind=wind, g=g),
    }
    runs = [
        fly_once(
            scenario, plant if wind is None else steered(plant, scenario), gains, plant_label=label,
            gains_name=aircraft.provenance.gains_name, limits=limits, progress=progress,
        )
        for label, plant in lower.items()
    ]  # fmt: skip
    return _ladder([*runs, aircraft], inner_loop)


def _ladder(runs: Sequence[Run], inner_loop: InnerLoop) -> Ladder:
    shortest = min(runs, key=lambda run: len(run.signals))
    n = len(shortest.signals)
    if n < LEAST_SAMPLES:
        raise InputError(
            f"{shortest.label} must have flown {LEAST_SAMPLES} samples, got {n}: {shortest.reason}"
        )
    cut = tuple(replace(run, signals=run.signals.iloc[:n]) for run in runs)
    adds = (
        "the lift there is turns the path",
        "lag of the inner loop",
        "six degrees of freedom",
    )
    return Ladder(
        runs=cut,
        inner_loop=inner_loop,
        steps=tuple(
            _step(lower, upper, what)
            for (lower, upper), what in zip(pairwise(cut), adds, strict=True)
        ),
        whole=_step(cut[0], cut[-1], "all of it"),
    )


def _step(lower: Run, upper: Run, adds: str) -> Step:
    below, above = pd.Series(flight_metrics(lower)), pd.Series(flight_metrics(upper))
    shared = [name for name in below.index if name in ("V_a_dev_mps", "n_z_min", "n_z_max")]
    known = math.nan if _failure(lower) or _failure(upper) else 1.0
    return Step(
        lower=lower.provenance.plant,
        upper=upper.provenance.plant,
        adds=adds,
        chi=(upper.signals["chi"] - lower.signals["chi"]).to_numpy(),
        gamma=(upper.signals["gamma"] - lower.signals["gamma"]).to_numpy(),
        metrics=known * (channel_metrics(upper) - channel_metrics(lower)),
        flight=known * (above - below).loc[shared],
    )


def _failure(run: Run) -> str:
    """Why the metrics of a run tell nothing; empty where they do.

    A course error that jumps by more than half a turn while the reference does not was wrapped: the
    flight went around, and its overshoot is that of the wrapping. Who stopped a flight by hand
    still has a good one.
    """
    if run.status not in ("completed", "cut_off"):
        return f"ended early ({run.status.replace('_', ' ')})"
    jumps, moved = (np.abs(np.diff(run.signals[f"chi_{one}"].to_numpy())) for one in ("err", "ref"))
    wrapped = (jumps > math.pi) & (moved < REFERENCE_STEP)
    return "diverged (course error past 180 deg)" if wrapped.any() else ""


def aircraft_table(scenario: Scenario, plant: str | None = None) -> PlantTable:
    """The jsbsim plant of a scenario that is the top of the ladder.

    Parameters
    ----------
    scenario : Scenario
    plant : str, optional
        Its label, where it is not the first one.

    Raises
    ------
    InputError
        If there is none.
    """
    aircraft = [table for table in scenario.plant if table.kind == "jsbsim"]
    if not aircraft:
        raise InputError(
            "`plant` must have one of kind jsbsim for a gap to be explained, got "
            f"{', '.join(table.label for table in scenario.plant)}."
        )
    if plant is None:
        return aircraft[0]
    for table in aircraft:
        if table.label == plant:
            return table
    known = ", ".join(table.label for table in aircraft)
    raise InputError(f"`plant` must be one of {known} for a gap to be explained, got {plant!r}.")


def _wind_met(run: Run) -> WindRecord | None:
    """The wind that the aircraft recorded; None in still air or where it records none."""
    if not set(WIND) <= set(run.signals) or not run.signals[list(WIND)].to_numpy().any():
        return None
    north, east, down = (run.signals[name].to_numpy() for name in WIND)
    return WindRecord(t=run.signals.index.to_numpy(), north=north, east=east, down=down)
