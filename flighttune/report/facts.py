"""Everything a report shows, computed: runs, final errors, certificates, bounds, gaps, frontier."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from flighttune.certificates import Certification
from flighttune.comparison import Source
from flighttune.errors import FlightTuneError, RecordingError
from flighttune.flight.expectations import ClaimCheck, check_claim
from flighttune.flight.gap import Gap, explain_flight
from flighttune.flight.outer_loop import certify_scenario, tuning_problem
from flighttune.guarantee.flight_check import FlightCheck, flight_check
from flighttune.metrics import CHANNELS
from flighttune.report.panels import Drawn
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run, run_styles
from flighttune.tuning.frontier import frontier

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.present.palette import LineStyle

CONVERGED_PART = 0.05
CONVERGED_AT_LEAST = np.deg2rad(0.5)
"""An error has converged where, over the last quarter of the flight, it stays within 5 % of its
largest or within 0.5 deg."""

LATE = 0.75
"""Part of the flight after which its last quarter begins."""

FRONTIER_POINTS = 9
LONGEST_LADDER = 6_000
"""Longest aircraft run for which the ladder is flown: beyond it a report would take minutes."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainFacts:
    """A gain set and its guarantees."""

    name: str
    gains: "PIGains"
    # About the linear loop, and over the scenario's envelope where it gives one
    trim: Certification
    envelope: Certification | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Facts:
    """Everything a report shows."""

    name: str  # Source of the runs
    scenario: Scenario
    claim: ClaimCheck  # The runs against the scenario's requirements
    runs: tuple[Run, ...]  # Runs that flew
    grounded: tuple[Run, ...]  # Runs that did not fly
    styles: "dict[str, LineStyle]"  # Line of each run, by label
    convergence: dict[str, dict[str, Any]]  # `final_errors` of each run that flew, by label
    gains: tuple[GainFacts, ...]
    # Flights against the guarantee, by label; without runs whose gains have none
    checks: dict[str, FlightCheck]
    # One for each run of the first aircraft, nominal or not, for which the ladder was flown
    gaps: tuple[Gap, ...]
    without_gap: tuple[str, ...]  # Why the others have no ladder
    missing: tuple[str, ...]  # Recorded parts that cannot be read
    frontier: pd.DataFrame  # R_K against I_K with the gains marked

    @property
    def drawn(self) -> Drawn:
        """The runs with their lines."""
        return [(run, self.styles[run.label]) for run in self.runs]


def facts_of(source: Source) -> Facts:
    """Compute everything a report shows about the runs of one scenario.

    A RecordingError says that nothing flew or that the runs are of different scenarios.
    """
    runs = tuple(run for run in source.runs if len(run.signals) > 1)
    if not runs:
        raise RecordingError(f"{source.name}: a run must have flown, got none.")
    scenario = _scenario(source, runs)
    gaps, without = _gaps(scenario, runs)
    gains = _gains(scenario, runs)
    return Facts(
        name=source.name,
        scenario=scenario,
        claim=check_claim(scenario, source.runs),
        runs=runs,
        grounded=tuple(run for run in source.runs if len(run.signals) <= 1),
        styles=run_styles(source.runs),
        convergence={run.label: final_errors(run) for run in runs},
        gains=gains,
        checks={run.label: check for run in runs if (check := flight_check(run)) is not None},
        gaps=gaps,
        without_gap=without,
        missing=source.missing,
        frontier=frontier(
            tuning_problem(scenario),
            points=FRONTIER_POINTS,
            marked={gain_set.name: gain_set.gains for gain_set in gains},
            starts=0,  # drawn gains find the same curve in twice the time
        ),
    )


def final_errors(run: Run) -> dict[str, Any]:
    """Whether a run converges: its largest errors over the last quarter and their limits, rad."""
    t = run.t
    errors = np.abs(run.signals[[f"{channel}_err" for channel in CHANNELS]].to_numpy())
    residual = errors[t >= LATE * t[-1]].max(axis=0)
    allowed = np.maximum(CONVERGED_PART * errors.max(axis=0), CONVERGED_AT_LEAST)
    return {
        "converges": run.status == "completed" and bool((residual <= allowed).all()),
        "residual": dict(zip(CHANNELS, residual.tolist(), strict=True)),
        "allowed": dict(zip(CHANNELS, allowed.tolist(), strict=True)),
    }


def _scenario(source: Source, runs: Sequence[Run]) -> Scenario:
    def without_gains(run: Run) -> dict[str, object]:
        return {key: value for key, value in run.provenance.scenario.items() if key != "gains"}

    first = runs[0]
    for run in runs[1:]:
        if without_gains(run) != without_gains(first):
            raise RecordingError(
                f"{source.name}: the runs must be of one scenario, got another one for "
                f"{run.label} than for {first.label}; use compare for those."
            )
    return scenario_from(dict(first.provenance.scenario))


def _gains(scenario: Scenario, runs: Sequence[Run]) -> tuple[GainFacts, ...]:
    sets = {run.provenance.gains_name: run.provenance.gains for run in runs}
    return tuple(
        GainFacts(
            name=name,
            gains=gains,
            trim=certify_scenario(scenario, gains),
            envelope=certify_scenario(scenario, gains, envelope=True)
            if scenario.envelope and scenario.tuning.model == "kinematic"  # the law's ranges
            else None,
        )
        for name, gains in sets.items()
        if gains is not None
    )


def _gaps(scenario: Scenario, runs: Sequence[Run]) -> tuple[tuple[Gap, ...], tuple[str, ...]]:
    """Gaps of the first aircraft, nominal and off-nominal; reasons for the missing ones."""
    gaps, without = [], []
    aircraft = [table for table in scenario.plant if table.aircraft is not None]
    plants = {table.label for table in aircraft if table.aircraft == aircraft[0].aircraft}
    for run in runs:
        if run.provenance.plant not in plants:
            continue
        if len(run.signals) > LONGEST_LADDER:
            without.append(
                f"{run.label}: {len(run.signals)} samples are more than {LONGEST_LADDER}; "
                "flighttune gap flies the ladder of a flight of any length."
            )
            continue
        try:
            gaps.append(explain_flight(scenario, run))
        except FlightTuneError as error:
            without.append(f"{run.label}: {error}")
    return tuple(gaps), tuple(without)
