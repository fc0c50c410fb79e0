"""Whether flown runs came to what their scenario expects of them."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from flighttune.metrics import channel_metrics, flight_metrics
from flighttune.scenario.expect_table import Bounds, in_rad
from flighttune.scenario.schema import Scenario
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


def _missed_by(scenario: Scenario, run: Run) -> Iterator[str]:
    made_by = run.provenance
    tables = [t for t in scenario.expect if t.meant(made_by.plant, made_by.gains_name)]
    expected = [t.status for t in tables if t.status] or ["completed"]
    if run.status not in expected:
        wanted = "" if expected == ["completed"] else f", must be {' or '.join(expected)}"
        yield f"{run.status}{wanted}: {run.reason or 'flown to its end'}"
        return
    measures = _measures(run) if any(t.at_most or t.at_least for t in tables) else {}
    for table in tables:
        yield from _outside(measures, table.at_most, "at most", 1.0)
        yield from _outside(measures, table.at_least, "at least", -1.0)


def _outside(
    measures: Mapping[str, Mapping[str, float]], bounds: Bounds, word: str, sense: float
) -> Iterator[str]:
    for subject, limits in bounds.items():
        for name, bound in limits.items():
            got = measures.get(subject, {}).get(in_rad(name), math.nan)
            got = got / DEG if name.endswith("_deg") else got
            beyond = sense * (got - bound)
            if not beyond <= 0.0:
                missed = f"missed by {beyond:.3g}" if math.isfinite(beyond) else "there is no value"
                yield f"{subject}.{name} must be {word} {bound:g}, got {got:.4g} ({missed})"


def _measures(run: Run) -> dict[str, dict[str, float]]:
    if len(run.signals) < 2:
        return {}
    measures = channel_metrics(run).to_dict(orient="index")
    for channel, of_channel in measures.items():
        of_channel["peak_rad"] = float(np.max(np.abs(run.signals[f"{channel}_err"].to_numpy())))
    return {**{str(c): dict(m) for c, m in measures.items()}, "flight": flight_metrics(run)}
