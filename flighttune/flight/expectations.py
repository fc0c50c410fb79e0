"""Whether flown runs came to what their scenario expects of them."""

import math
from collections.abc import Iterator, Mapping, Sequence

from flighttune.metrics import measures
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import Bounds, ExpectTable, in_rad
from flighttune.simulate.run import Run
from flighttune.units import DEG


def missed_expectations(scenario: Scenario, runs: Sequence[Run]) -> tuple[str, ...]:
    """Return a sentence for each expectation that a run does not meet.

    Parameters
    ----------
    scenario : Scenario
        With its ``[[expect]]`` tables. A run of which no table names a status must be completed.
    runs : sequence of Run
        What was flown of it.

    Returns
    -------
    tuple of str
        Each names the run, the measure, its bound, what was got and by how much it missed.
    """
    return tuple(
        f"{run.label}: {sentence}" for run in runs for sentence in _missed_by(scenario, run)
    )


def missed(
    tables: Sequence[ExpectTable],
    status: str,
    reason: str,
    measured: Mapping[str, Mapping[str, float]],
) -> tuple[str, ...]:
    """Return a sentence for each expectation that one run does not meet.

    Parameters
    ----------
    tables : sequence of ExpectTable
        Those that mean the run. Where none names a status it must be completed.
    status, reason : str
        How the run ended.
    measured : mapping
        Its `measures`; empty for a flight too short to have any.
    """
    expected = [t.status for t in tables if t.status] or ["completed"]
    if status not in expected:
        wanted = "" if expected == ["completed"] else f", must be {' or '.join(expected)}"
        return (f"{status}{wanted}: {reason or 'flown to its end'}",)
    return tuple(
        sentence
        for table in tables
        for bounds, word, sense in (
            (table.at_most, "at most", 1.0),
            (table.at_least, "at least", -1.0),
        )
        for sentence in _outside(measured, bounds, word, sense)
    )


def _missed_by(scenario: Scenario, run: Run) -> tuple[str, ...]:
    made_by = run.provenance
    tables = [t for t in scenario.expect if t.meant(made_by.plant, made_by.gains_name)]
    bounded = any(t.at_most or t.at_least for t in tables)
    return missed(tables, run.status, run.reason, measures(run) if bounded else {})


def _outside(
    measured: Mapping[str, Mapping[str, float]], bounds: Bounds, word: str, sense: float
) -> Iterator[str]:
    for subject, limits in bounds.items():
        for name, bound in limits.items():
            got = measured.get(subject, {}).get(in_rad(name), math.nan)
            got = got / DEG if name.endswith("_deg") else got
            beyond = sense * (got - bound)
            if not beyond <= 0.0:
                missed = f"missed by {beyond:.3g}" if math.isfinite(beyond) else "there is no value"
                yield f"{subject}.{name} must be {word} {bound:g}, got {got:.4g} ({missed})"
