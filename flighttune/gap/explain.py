"""A scenario to its gap: ladder, mismatch, and the certificate held against the flight."""

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal

import numpy as np
import pandas as pd

from flighttune.control.closed_loop import closed_loop, disturbance_entry
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import kinematic_model
from flighttune.flight import FlownScenario
from flighttune.gap.certified_set import LoopFlown, Verdict, loop_flown
from flighttune.gap.free_flight import FreeFlight, free_flight
from flighttune.gap.inner_loop import LagSource
from flighttune.gap.ladder import LEAST_SAMPLES, Ladder, climb, fly_aircraft
from flighttune.gap.mismatch import Mismatch, mismatch
from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.one_flight import Progress
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import Indicators, indicators

GapStatus = Literal["explained", "cut_short", "not_flown"]

SETTLED_FROM = 0.5
"""Part of the time flown from which the flight counts as settled."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gap:
    """Where the difference between the paper's law and the aircraft comes from.

    Attributes
    ----------
    scenario : Scenario
    status : "explained", "cut_short" or "not_flown"
        Cut short: a rung ended early, and everything is about the time all of them flew.
    reason : str
        Why, where it is not ``explained``.
    runs : tuple of Run
        The rungs, lowest first; the aircraft with its mismatch and tube as signals.
    ladder : Ladder or None
    mismatch : Mismatch or None
        Of the aircraft against the paper's law.
    loop : LoopFlown or None
        None also where the loop has no certificate, being unstable.
    verdict, settled : Verdict or None
        Of the whole flight, and of its second half alone.
    free : FreeFlight or None
        The part of the flight that no limit holds, in the reach of the linear loop.
    indicators : Indicators
        Of the kinematic law's loop about level flight on the first reference: the mismatch is
        against that law, whatever model the gains were tuned on.
    """

    scenario: Scenario
    status: GapStatus
    reason: str
    runs: tuple[Run, ...]
    indicators: Indicators
    ladder: Ladder | None = None
    mismatch: Mismatch | None = None
    loop: LoopFlown | None = None
    verdict: Verdict | None = None
    settled: Verdict | None = None
    free: FreeFlight | None = None

    def flown(self) -> FlownScenario:
        """The rungs as a flown scenario, to be recorded like any other."""
        runs = [run for run in self.runs if len(run.signals) > 1]
        names = {run.provenance.gains_name for run in self.runs}
        return FlownScenario(
            scenario=self.scenario,
            runs=self.runs,
            indicators=MappingProxyType(dict.fromkeys(names, self.indicators)),
            tuning=None,
            metrics=pd.concat({run.label: channel_metrics(run) for run in runs}, names=["run"])
            if runs
            else pd.DataFrame(),
            flight=pd.DataFrame.from_dict(
                {run.label: flight_metrics(run) for run in runs}, orient="index"
            ),
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
    """Fly the same gains up the ladder and say what each step adds.

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
        Label of the jsbsim plant, where it is not the first one.
    lag : {"identified", "fitted"}, optional
        Where the lag of the third rung comes from: the aircraft's model file, or this very flight.
        By default the model file, where there is one.
    progress : callable, optional
        Told how far each run is.

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
    _, gamma = scenario.followed().sampled(np.zeros(1))
    settings = scenario.flight
    model = kinematic_model(V_a=settings.V_a_mps, gamma=float(gamma[0]), g=settings.g_mps2)
    A_K = closed_loop(model, gains)
    certified = indicators(A_K)
    aircraft = fly_aircraft(scenario, gains, name, plant=plant, progress=progress)
    if len(aircraft.signals) < LEAST_SAMPLES:
        return Gap(
            scenario=scenario,
            status="not_flown",
            reason=f"{aircraft.label}: {aircraft.status}: {aircraft.reason}",
            runs=(aircraft,),
            indicators=certified,
        )
    ladder = climb(scenario, aircraft, lag=lag, progress=progress)
    top = ladder.runs[-1]
    found = mismatch(top, V_a=scenario.flight.V_a_mps, g=scenario.flight.g_mps2)
    entry = disturbance_entry(model)
    stable = certified.status == "stable" and found.L_d > 0.0
    loop = loop_flown(top, found, A_K, entry) if stable else None
    early = [run for run in ladder.runs if run.reason]
    return Gap(
        scenario=scenario,
        status="cut_short" if early else "explained",
        reason=f"{early[0].label}: {early[0].reason}" if early else "",
        runs=(*ladder.runs[:-1], with_mismatch(top, found, loop)),
        indicators=certified,
        ladder=ladder,
        mismatch=found,
        loop=loop,
        verdict=loop and loop.verdict(),
        settled=loop and loop.verdict(SETTLED_FROM * top.duration),
        free=free_flight(top, found, A_K, entry) if stable else None,
    )


def with_mismatch(run: Run, found: Mismatch, loop: LoopFlown | None) -> Run:
    """The run with the mismatch and, around its reference, the certified tube as signals.

    What is constant over a sample interval stands at the start of it; the last sample repeats.
    """
    columns = {f"mismatch_{name}": found.d[:, i] for i, name in enumerate(("chi", "gamma"))}
    if loop is not None:
        for i, name in enumerate(("chi", "gamma")):
            reference = run.signals[f"{name}_ref"].to_numpy()[:-1]
            columns[f"{name}_tube_low"] = reference - loop.tube()[:, i]
            columns[f"{name}_tube_high"] = reference + loop.tube()[:, i]
    added = {key: np.append(values, values[-1]) for key, values in columns.items()}
    return replace(run, signals=run.signals.assign(**added))
