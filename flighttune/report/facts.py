"""What a report is about: runs, whether they converge, their guarantees, what aircraft add."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.certificates import Certification
from flighttune.comparison import Comparison, Source, compare
from flighttune.errors import FlightTuneError, RecordingError
from flighttune.figures import MOST_POINTS
from flighttune.outer_loop import certify_scenario, tuning_problem
from flighttune.palette import Look, looks, many_looks
from flighttune.recording.certified import Certified, certified
from flighttune.report.explained import ExplainedGap, explained_gap
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.tuning.frontier import frontier

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains

CONVERGED_PART = 0.05
CONVERGED_AT_LEAST = np.deg2rad(0.5)
"""An error has converged where, over the last quarter of the flight, it stays within 5 % of its
largest or within 0.5 deg."""

LATE = 0.75
"""Part of the flight after which its last quarter begins."""

FRONTIER_POINTS = 12
MOST_SAMPLES = 6_000
"""Of an aircraft run for which the ladder is flown: beyond, a report would take minutes."""

TWELVE, FEW_RUNS = 12, 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Convergence:
    """How far the errors of a run came down.

    Attributes
    ----------
    converged : bool
        The flight was completed, and both errors came down.
    residual : tuple of float, rad
        Largest errors of course and path angle over the last quarter of the flight.
    allowed : tuple of float, rad
        What they may be at most in a run that converged.
    """

    converged: bool
    residual: tuple[float, float]
    allowed: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainFacts:
    """A gain set and its guarantees.

    Attributes
    ----------
    name : str
    gains : PIGains
    trim, envelope : Certification or None
        About the linear loop, and over the scenario's envelope where it gives one.
    """

    name: str
    gains: "PIGains"
    trim: Certification
    envelope: Certification | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Facts:
    """Everything a report shows.

    Attributes
    ----------
    name : str
        Where the runs come from.
    scenario : Scenario
    runs : tuple of Run
        Those that flew.
    grounded : tuple of Run
        Those that did not.
    looks : mapping of str to Look
        By label of the run.
    convergence : mapping of str to Convergence
        By label.
    gains : tuple of GainFacts
    bounds : mapping of str to Certified
        By label; without runs whose gains have no certificate.
    aircraft : Comparison or None
        Each gain set on the first plant that is no aircraft against the first aircraft.
    gaps : tuple of ExplainedGap
        One each run of the first aircraft, nominal or not, for which the ladder could be flown.
    without_gap : tuple of str
        Why not for the others.
    missing : tuple of str
        What was recorded and cannot be had.
    frontier : DataFrame
        R_K against I_K with the gains marked.
    """

    name: str
    scenario: Scenario
    runs: tuple[Run, ...]
    grounded: tuple[Run, ...]
    looks: dict[str, Look]
    convergence: dict[str, Convergence]
    gains: tuple[GainFacts, ...]
    bounds: dict[str, Certified]
    aircraft: Comparison | None
    gaps: tuple[ExplainedGap, ...]
    without_gap: tuple[str, ...]
    missing: tuple[str, ...]
    frontier: pd.DataFrame

    @property
    def points(self) -> int:
        """Points a line may have, so that the page of many long runs stays small."""
        return MOST_POINTS * FEW_RUNS // max(FEW_RUNS, len(self.runs))


def facts_of(source: Source) -> Facts:
    """Gather what is to be told about the runs of one scenario.

    Parameters
    ----------
    source : Source
        Runs of one scenario.

    Raises
    ------
    RecordingError
        If nothing flew, or the runs are of different scenarios.
    ScenarioError
        If the recorded scenario is not valid any more.
    """
    runs = tuple(run for run in source.runs if len(run.signals) > 1)
    if not runs:
        raise RecordingError(f"{source.name}: a run must have flown, got none.")
    scenario = _scenario(source, runs)
    pairs = [(run.provenance.plant, run.provenance.gains_name) for run in source.runs]
    known = looks(pairs) if len(set(pairs)) <= TWELVE else many_looks(pairs)
    gains = _gains(scenario, runs)
    gaps, without = _gaps(scenario, runs)
    return Facts(
        name=source.name,
        scenario=scenario,
        runs=runs,
        grounded=tuple(run for run in source.runs if len(run.signals) <= 1),
        looks={run.label: known[pair] for run, pair in zip(source.runs, pairs, strict=True)},
        convergence={run.label: convergence(run) for run in runs},
        gains=gains,
        bounds={run.label: one for run in runs if (one := certified(run)) is not None},
        aircraft=_aircraft(runs),
        gaps=gaps,
        without_gap=without,
        missing=source.missing,
        frontier=frontier(
            tuning_problem(scenario),
            points=FRONTIER_POINTS,
            marked={one.name: one.gains for one in gains},
        ),
    )


def convergence(run: Run) -> Convergence:
    """Whether the errors of a run came down; see `CONVERGED_AT_LEAST`."""
    t = run.signals.index.to_numpy(dtype=float)
    errors = np.abs(run.signals[["chi_err", "gamma_err"]].to_numpy())
    residual = errors[t >= LATE * t[-1]].max(axis=0)
    allowed = np.maximum(CONVERGED_PART * errors.max(axis=0), CONVERGED_AT_LEAST)
    return Convergence(
        converged=run.status == "completed" and bool((residual <= allowed).all()),
        residual=(float(residual[0]), float(residual[1])),
        allowed=(float(allowed[0]), float(allowed[1])),
    )


def _scenario(source: Source, runs: Sequence[Run]) -> Scenario:
    def without_gains(run: Run) -> dict[str, object]:
        return {key: value for key, value in run.provenance.scenario.items() if key != "gains"}

    first = runs[0]
    for run in runs[1:]:
        if without_gains(run) != without_gains(first):
            raise RecordingError(
                f"{source.name}: the runs must be of one scenario, got another one for "
                f"{run.label} than for {first.label}; hold them against each other with compare."
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


def _aircraft(runs: Sequence[Run]) -> Comparison | None:
    sides: list[tuple[Run, ...]] = []
    for is_aircraft in (False, True):
        side = [run for run in runs if (run.provenance.aircraft is not None) == is_aircraft]
        if not side:
            return None
        sides.append(tuple(run for run in side if run.provenance.plant == side[0].provenance.plant))
    law, craft = (Source(name=side[0].provenance.plant, runs=side) for side in sides)
    found = compare(law, craft)
    return found if found.comparable else None


def _gaps(
    scenario: Scenario, runs: Sequence[Run]
) -> tuple[tuple[ExplainedGap, ...], tuple[str, ...]]:
    """Of the first aircraft, as its files say and off the nominal."""
    found, without = [], []
    aircraft = [table for table in scenario.plant if table.aircraft is not None]
    plants = {table.label: table for table in aircraft if table.aircraft == aircraft[0].aircraft}
    flown = [run for run in runs if run.provenance.plant in plants]
    for run in flown:
        if len(run.signals) > MOST_SAMPLES:
            without.append(
                f"{run.label}: {len(run.signals)} samples are more than {MOST_SAMPLES}; "
                "flighttune gap flies the ladder of any flight."
            )
            continue
        try:
            own, gains = plants[run.provenance.plant].name, run.provenance.gains_name
            found.append(explained_gap(scenario, run, f"{gains} ({own})" if own else gains))
        except FlightTuneError as error:
            without.append(f"{run.label}: {error}")
    return tuple(found), tuple(without)
