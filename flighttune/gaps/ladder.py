"""The ladder from the paper's law to an aircraft: the same gains flown on each rung."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, overload

import numpy as np
import pandas as pd

from flighttune.control.gains import COMMANDS, WITH_AIRSPEED, PIGains
from flighttune.control.inner_loop import InnerLag
from flighttune.control.law import Law
from flighttune.control.linear_model import closed_loop
from flighttune.errors import InputError
from flighttune.files.load import LOG, written
from flighttune.flight.conditions import command_limits, lead_on, reference_of, weather_of
from flighttune.flight.fly import (
    Progress,
    aircraft_table,
    fly_alone,
    fly_once,
    plant_of,
    steered,
    wind_met,
)
from flighttune.flight.load import scenario_and_gains
from flighttune.flight.models import law_model
from flighttune.gaps.gap import Gap, LagSource, Step, failure_of
from flighttune.gaps.of_log import LogGap, log_gap
from flighttune.gaps.residual import CHANNELS, Mismatch, mismatch
from flighttune.identification.file import FILE_NAME
from flighttune.identification.fit import fitted_lag
from flighttune.logs.log import Columns
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.plants.point_mass import PointMassPlant, PoweredPointMass
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.run import Run
from flighttune.theory.indicators import Indicators, indicators

# A shorter flight cannot be compared, and no lag can be fitted to it.
LEAST_SAMPLES = 12

# Effects that each rung models and the one below it does not.
ADDS = ("turning with actual lift", "lag of the inner loop", "six degrees of freedom")


@overload
def gap(
    scenario: Scenario | str | Path,
    gains: PIGains | str | None = None,
    *,
    name: str = "",
    plant: str | None = None,
    lag: LagSource | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> Gap: ...


@overload
def gap(
    scenario: Run | str | Path,
    *,
    aircraft: str | Path,
    columns: Columns = (),
    progress: Progress | None = None,
) -> LogGap: ...


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
    progress: Progress | None = None,
) -> Gap | LogGap:
    """Fly the same gains up the ladder, or the commands of a log, and measure each effect.

    A log with an `aircraft` takes half a minute: its commands are flown in up to eight stretches
    on the law, the point mass and the aircraft, and lag, mass, damping and wind are fitted to what
    is left.

    Parameters
    ----------
    scenario : Scenario, Run, str or Path
        A scenario file, or the name of a shipped one; or the log of a real flight, with `aircraft`,
        ``@START:END`` for a part of it in s. A jsbsim plant of the scenario is the top of the
        ladder; limits of scenario and aircraft hold on every rung.
    gains : PIGains or str, optional
        The gains flown, or a gain set by name or file; by default the first of the scenario.
    name : str
        Name in labels of gains that are given as numbers.
    plant : str, optional
        Label of the jsbsim plant, by default the first aircraft.
    lag : {"identified", "fitted"}, optional
        Inner-loop lag of the third plant: from the aircraft's model file, or fitted to this flight,
        by default the model file, if there is one.
    aircraft : str or Path, optional
        Aircraft on which the commands of a log are flown: a shipped one, a folder, or the file of
        an identified model, which has no airframe.
    columns : mapping or sequence
        Where a log has its signals, as for `load_log`.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.
    progress : callable, optional
        Called with the progress of each run.

    Returns
    -------
    Gap or LogGap
        Also where the aircraft does not trim or a rung ends early: its status says so. Of a log
        the differences by what flew its commands, the factors that explain most with intervals at
        95 %, and the share that each cause explains.

    Raises
    ------
    InputError
        If the scenario has no such jsbsim plant, or a log no commands that can be flown on the
        aircraft.
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
        return log_gap(scenario, aircraft, columns=columns, progress=progress)
    if isinstance(scenario, Run) or written(scenario, LOG, columns=columns):
        raise InputError("`aircraft` must be given with a log: what its commands are flown on.")
    scenario, gains_name, gains = scenario_and_gains(scenario, gains, changes)
    name = name or gains_name
    table = aircraft_table(scenario, plant)
    top = fly_alone(scenario, table, gains, name, progress=progress)
    if len(top.signals) >= LEAST_SAMPLES:
        return explain_flight(scenario, top, lag=lag, progress=progress)
    law, _ = scenario.law_of(name, gains)
    return Gap(scenario=scenario, runs=(top,), indicators=_indicators(scenario, law, gains))


def explain_flight(
    scenario: Scenario,
    aircraft: Run,
    *,
    lag: LagSource | None = None,
    progress: Progress | None = None,
) -> Gap:
    """Explain the gap of an aircraft that has flown: fly the rungs below it in the wind it met."""
    made_by = aircraft.provenance
    if made_by.gains is None:
        raise InputError(f"`aircraft` must have gains, got none for {aircraft.label}.")
    _check_length(aircraft)
    table = aircraft_table(scenario, made_by.plant)
    lag_source, lags = _inner_loop(table, scenario, aircraft, lag)
    limits = command_limits(scenario).within(plant_of(table, scenario).limits)
    g = scenario.flight.g_mps2
    # In still air JSBSim records a wind of rounding errors; to fly in it takes twice as long.
    wind = None if weather_of(scenario) is None else wind_met(aircraft)
    lagged = tuple(lag for lag, _ in lags.values())
    make = PointMassPlant
    if scenario.airspeed:
        make = partial(PoweredPointMass, (float(limits.lower[2]), float(limits.upper[2])))
    lower = {
        "kinematic": make(turn="paper", wind=wind, g=g),
        "point_mass": make(wind=wind, g=g),
        "point_mass_lag": make(lagged, wind=wind, g=g),
    }
    fly = partial(
        fly_once,
        scenario,
        gains=made_by.gains,
        gains_name=made_by.gains_name,
        limits=limits,
        progress=progress,
    )
    runs = [
        fly(
            plant if wind is None else steered(plant, scenario),
            plant_label=label,
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
        unplanned = fly(plant_of(table, scenario), plant_label=made_by.plant)
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
        unplanned=unplanned,
    )


def _check_length(run: Run) -> None:
    if len(run.signals) < LEAST_SAMPLES:
        raise InputError(
            f"{run.label} must have flown {LEAST_SAMPLES} samples, got {len(run.signals)}: "
            f"{run.reason}"
        )


def _indicators(scenario: Scenario, law: Law, gains: PIGains) -> Indicators:
    return indicators(closed_loop(law_model(scenario, law), gains))


def _inner_loop(
    table: PlantTable, scenario: Scenario, run: Run, source: LagSource | None
) -> tuple[LagSource, dict[str, tuple[InnerLag, float]]]:
    """Source and lags of an aircraft that has flown: those of the nearest condition, or fitted."""
    commanded_and_flown = {
        name: (run.signals[f"{name}_cmd"].to_numpy(), run.signals[name].to_numpy())
        for name in (WITH_AIRSPEED[COMMANDS] if scenario.airspeed else COMMANDS)
    }
    if source is None:
        file = table.config.folder / FILE_NAME
        source = "identified" if file.exists() else "fitted"
    lags = (None,) * len(commanded_and_flown)
    if source == "identified":
        _, gamma = reference_of(scenario).initial
        nearest = table.identified_model.nearest(scenario.flight.V_a_mps, gamma)
        lags = (*nearest.lags, nearest.thrust_lag) if scenario.airspeed else nearest.lags
    return source, {
        name: fitted_lag(run.t, *signals, lag=lag)
        for (name, signals), lag in zip(commanded_and_flown.items(), lags, strict=True)
    }


def _step(lower: Run, upper: Run, adds: str) -> Step:
    below, above = pd.Series(flight_metrics(lower)), pd.Series(flight_metrics(upper))
    # Only these are measured on every rung: a point mass has no angle of attack.
    shared = ["V_a_dev_mps", "n_z_min", "n_z_max"]
    validity = math.nan if failure_of(lower) or failure_of(upper) else 1.0
    return Step(
        lower=lower.provenance.plant,
        upper=upper.provenance.plant,
        adds=adds,
        chi=(upper.signals["chi"] - lower.signals["chi"]).to_numpy(),
        gamma=(upper.signals["gamma"] - lower.signals["gamma"]).to_numpy(),
        metrics=validity * (channel_metrics(upper) - channel_metrics(lower)),
        flight=validity * (above - below).loc[shared],
    )


def _with_mismatch(run: Run, mismatch: Mismatch) -> Run:
    """The run with the mismatch as signals."""
    columns = {f"mismatch_{name}": mismatch.d[:, i] for i, name in enumerate(CHANNELS)}
    # constant over a sample interval and stored at its start; the last is repeated
    added = {key: np.append(values, values[-1]) for key, values in columns.items()}
    return replace(run, signals=run.signals.assign(**added))
