"""A whole scenario: every gain set on every plant, with indicators and metrics beside the runs."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd

from flighttune.control.closed_loop import closed_loop
from flighttune.control.gains import PIGains, paper_family
from flighttune.errors import InputError
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.one_flight import Progress, fly_once
from flighttune.plants.base import Plant
from flighttune.plants.kinematic import KinematicPlant
from flighttune.plants.point_mass import PointMassPlant
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import TUNED, GainsTable, Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import Indicators, indicators
from flighttune.tuning.problem import TuningProblem, decoupled
from flighttune.tuning.result import TuningResult
from flighttune.tuning.tune import tune
from flighttune.units import wrap_angle

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

    def metrics_of(self, run: Run) -> dict[str, dict[str, float]]:
        """Measures of one run as numbers: ``chi``, ``gamma`` and ``flight``; empty if not flown."""
        if run.label not in self.flight.index:
            return {}
        channels = self.metrics.loc[run.label].to_dict(orient="index")
        return {**channels, "flight": self.flight.loc[run.label].to_dict()}


def tuning_problem(scenario: Scenario) -> TuningProblem:
    """The paper's optimisation model for a scenario.

    Returns
    -------
    TuningProblem
        Maximise R_K of the loop about the first reference under ``I_K <= I_star`` and, where the
        scenario asks, the input limits at the first error.

    Notes
    -----
    Section 3.4 of arXiv 2411.13140. The limits hold for the PI part alone, as printed: a
    feed-forward is not counted.
    """
    chi_ref, gamma_ref = (float(ref[0]) for ref in scenario.followed().sampled(np.zeros(1)))
    condition, settings, model = scenario.condition, scenario.tuning, scenario.linear_model()
    _, m, p = model.shape
    bound = None if settings.gain_max is None else np.full((m, 2 * p), settings.gain_max)
    return TuningProblem(
        model=model,
        I_star=settings.I_star,
        limits=scenario.limits.limits() if settings.input_limits else None,
        x_0=np.array([wrap_angle(chi_ref - condition.chi), gamma_ref - condition.gamma]),
        scaling=None if settings.state_scaling is None else np.array(settings.state_scaling),
        K_min=None if bound is None else -bound,
        K_max=bound,
        K_fixed=decoupled(model) if settings.structure == "decoupled" else None,
        seed=scenario.seed,
    )


def tune_scenario(scenario: Scenario) -> TuningResult:
    """The gains named ``tuned`` of a scenario, and how they were found."""
    return tune(
        tuning_problem(scenario),
        method=scenario.tuning.method,
        starts=scenario.tuning.starts,
    )


def fly(scenario: Scenario, *, progress: Progress | None = None) -> FlownScenario:
    """Fly every gain set of a scenario on each of its plants.

    Parameters
    ----------
    scenario : Scenario
        What to fly.
    progress : callable, optional
        Told how far each run is.

    Returns
    -------
    FlownScenario
        With one run a plant and gain set. A run that diverged, left the envelope, hit the ground or
        could not start says so in its status and reason.

    Raises
    ------
    PlantError
        If an aircraft cannot be built.
    """
    tuning = tune_scenario(scenario) if TUNED in scenario.gains else None
    names = [entry if isinstance(entry, str) else entry.name for entry in scenario.gains]
    gain_sets = {name: gain_set(scenario, name, tuning) for name in names}
    model = scenario.linear_model()
    runs = tuple(
        fly_once(
            scenario,
            plant_of(plant, scenario),
            gains,
            plant_label=plant.label,
            gains_name=name,
            progress=progress,
        )
        for plant in scenario.plant
        for name, gains in gain_sets.items()
    )
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


def plant_of(table: PlantTable, scenario: Scenario) -> Plant:
    """A fresh plant of a scenario, ready to start.

    Raises
    ------
    PlantError
        If the aircraft cannot be built.
    """
    if table.aircraft is None:
        disturbance = scenario.disturbance and scenario.disturbance.sinusoid()
        if table.kind == "kinematic":
            return KinematicPlant(disturbance, g=scenario.flight.g_mps2)
        return PointMassPlant(table.lags(), disturbance=disturbance, g=scenario.flight.g_mps2)
    from flighttune.plants.jsbsim.plant import JSBSimPlant

    rate = scenario.controller.rate_hz
    return JSBSimPlant(
        table.aircraft, fdm_rate_hz=rate * math.ceil(LOWEST_FDM_RATE_HZ / rate), seed=scenario.seed
    )


def gain_set(scenario: Scenario, name: str, tuning: TuningResult | None = None) -> PIGains | None:
    """Gains by the name a scenario knows them by.

    Parameters
    ----------
    scenario : Scenario
        Whose gain sets and tuning problem are meant.
    name : str
        ``paper``, ``K1`` to ``K6``, ``tuned``, or the name of gains given as numbers.
    tuning : TuningResult, optional
        Result for ``tuned``; found anew by default.

    Returns
    -------
    PIGains or None
        None for ``tuned`` where the problem is infeasible.

    Raises
    ------
    InputError
        If there are no such gains.
    """
    if name == TUNED:
        tuning = tune_scenario(scenario) if tuning is None else tuning
        return tuning.gains if tuning.status == "optimal" else None
    known = paper_family()
    known.update({e.name: e.gains() for e in scenario.gains if isinstance(e, GainsTable)})
    if name not in known:
        raise InputError(f"`gains` must be one of {', '.join([TUNED, *known])}, got {name!r}.")
    return known[name]
