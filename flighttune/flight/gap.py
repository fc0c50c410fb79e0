"""The gap between the paper's law and an aircraft: ladder and mismatch."""

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from flighttune.control.gains import PIGains
from flighttune.control.linear_model import closed_loop
from flighttune.errors import InputError
from flighttune.flight.fly import FlownScenario, Progress, fly_alone
from flighttune.flight.ladder import (
    LEAST_SAMPLES,
    Ladder,
    LagSource,
    Step,
    aircraft_table,
    fly_ladder,
)
from flighttune.guarantee.mismatch import CHANNELS, Mismatch, mismatch
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import Indicators, indicators

GapStatus = Literal["explained", "cut_short", "not_flown"]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gap:
    """Where the difference between the paper's law and the aircraft comes from.

    Attributes
    ----------
    scenario : Scenario
    status : "explained", "cut_short" or "not_flown"
        Cut short: a rung ended early; all results are about the time that all of them flew.
    reason : str
        Why the status is not ``explained``; else empty.
    runs : tuple of Run
        The rungs, lowest first; the aircraft with its mismatch as signals.
    indicators : Indicators
        Indicators of the kinematic law's loop about wings-level flight on the first reference.
    ladder : Ladder or None
    mismatch : Mismatch or None
        Mismatch of the aircraft against the paper's law.
    """

    scenario: Scenario
    status: GapStatus
    reason: str
    runs: tuple[Run, ...]
    indicators: Indicators
    ladder: Ladder | None = None
    mismatch: Mismatch | None = None

    @property
    def aircraft(self) -> Run:
        """The top rung."""
        return self.runs[-1]

    @property
    def name(self) -> str:
        """Name of the gains, with that of the plant in brackets if the scenario names it."""
        made_by = self.aircraft.provenance
        names = {table.label: table.name for table in self.scenario.plant}
        plant = names.get(made_by.plant)
        return f"{made_by.gains_name} ({plant})" if plant else made_by.gains_name

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps of the ladder; none where the aircraft did not fly."""
        return () if self.ladder is None else self.ladder.steps

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
        Source of the lag of the third rung: the aircraft's model file, or a fit to this flight.
        Source of the lags; by default the model file, if there is one.
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
    """
    table = aircraft_table(scenario, plant)
    aircraft = fly_alone(scenario, table, gains, name, progress=progress)
    if len(aircraft.signals) >= LEAST_SAMPLES:
        return explain_flight(scenario, aircraft, lag=lag, progress=progress)
    return Gap(
        scenario=scenario,
        status="not_flown",
        reason=f"{aircraft.label}: {aircraft.status}: {aircraft.reason}",
        runs=(aircraft,),
        indicators=indicators(
            closed_loop(scenario.kinematic_model(scenario.law_of(name, gains)[0]), gains)
        ),
    )


def explain_flight(
    scenario: Scenario,
    aircraft: Run,
    *,
    lag: LagSource | None = None,
    progress: Progress | None = None,
) -> Gap:
    """Explain the gap of an aircraft that has flown: fly the rungs of the ladder below it.

    `aircraft` is a run of one of the scenario's jsbsim plants. An InputError says that the flight
    is too short or has no gains.
    """
    gains = aircraft.provenance.gains
    if gains is None:
        raise InputError(f"`aircraft` must have gains, got none for {aircraft.label}.")
    ladder = fly_ladder(scenario, aircraft, lag=lag, progress=progress)
    top = ladder.runs[-1]
    measured = mismatch(top)
    early = [run for run in ladder.runs if run.reason]
    return Gap(
        scenario=scenario,
        status="cut_short" if early else "explained",
        reason=f"{early[0].label}: {early[0].reason}" if early else "",
        runs=(*ladder.runs[:-1], with_mismatch(top, measured)),
        indicators=indicators(
            closed_loop(scenario.kinematic_model(aircraft.provenance.law), gains)
        ),
        ladder=ladder,
        mismatch=measured,
    )


def with_mismatch(run: Run, mismatch: Mismatch) -> Run:
    """The run with the mismatch as signals.

    Values that are constant over a sample interval are stored at its start; the last is repeated.
    """
    columns = {f"mismatch_{name}": mismatch.d[:, i] for i, name in enumerate(CHANNELS)}
    added = {key: np.append(values, values[-1]) for key, values in columns.items()}
    return replace(run, signals=run.signals.assign(**added))
