"""Compared runs in one recording, aligned at the start of the flight."""

from dataclasses import replace
from pathlib import Path

from flighttune.comparison.compare import Comparison, comparison_table
from flighttune.metrics import metric_tables
from flighttune.recording.page import scenario_page
from flighttune.recording.rrd import write_recording
from flighttune.simulate.run import Run


def write_overlay(found: Comparison, path: str | Path) -> None:
    """Write all runs of a comparison to one recording.

    Parameters
    ----------
    found : Comparison
        Comparable; time 0 of every run is the start of its flight.
    path : path-like
        A ``.rrd`` file to write or replace.

    Raises
    ------
    RecordingError
        If the file cannot be written.
    """
    runs = overlaid(found)
    scenario = runs[0].provenance.scenario
    title = f"{scenario.get('title', 'Flight')}: comparison"
    metrics, flight = metric_tables(runs)
    page = scenario_page(runs, scenario=scenario, metrics=metrics, flight=flight)
    compared = comparison_table("Compared", found.metrics).markdown()
    write_recording(runs, Path(path), page=f"{page}\n## Compared\n\n{compared}\n", title=title)


def overlaid(found: Comparison) -> list[Run]:
    """Every run of a comparison once, with a letter for the source if runs share a label.

    The first source is A, the next one B and so on.
    """
    sources = list(
        dict.fromkeys([p.source_a for p in found.pairs] + [p.source_b for p in found.pairs])
    )
    runs: dict[tuple[str, str], Run] = {}
    for pair in found.pairs:
        for source, run in ((pair.source_a, pair.a), (pair.source_b, pair.b)):
            known = runs.get((source, run.label))
            if known is None or known.duration < run.duration:
                runs[source, run.label] = run
    labels = [label for _, label in runs]
    return [
        _named(run, f"{run.provenance.gains_name} ({chr(ord('A') + sources.index(source))})")
        if labels.count(label) > 1
        else run
        for (source, label), run in runs.items()
    ]


def _named(run: Run, gains_name: str) -> Run:
    return replace(run, provenance=replace(run.provenance, gains_name=gains_name))
