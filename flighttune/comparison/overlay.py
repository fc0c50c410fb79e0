"""Compared runs in one recording, aligned at the start of the flight."""

from dataclasses import replace
from pathlib import Path

from flighttune.comparison.compare import Comparison, comparison_table
from flighttune.metrics import metric_tables
from flighttune.recording.page import scenario_page
from flighttune.recording.rrd import write_recording
from flighttune.simulate.run import Run


def write_overlay(comparison: Comparison, path: str | Path) -> None:
    """Write all runs of a comparison to one recording.

    `comparison`: comparable; time 0 of every run is the start of its flight. `path`: a ``.rrd``
    file to write or replace. Raises RecordingError if the file cannot be written.
    """
    runs = overlaid(comparison)
    scenario = runs[0].provenance.scenario
    title = f"{scenario.get('title', 'Flight')}: comparison"
    metrics, flight = metric_tables(runs)
    page = scenario_page(runs, scenario=scenario, metrics=metrics, flight=flight)
    compared = comparison_table("Compared", comparison.metrics).markdown()
    write_recording(runs, Path(path), page=f"{page}\n## Compared\n\n{compared}\n", title=title)


def overlaid(comparison: Comparison) -> list[Run]:
    """Every run of a comparison once, with a letter for the source if runs share a label.

    The first source is A, the next one B and so on.
    """
    sources = list(
        dict.fromkeys(
            [p.source_a for p in comparison.pairs] + [p.source_b for p in comparison.pairs]
        )
    )
    runs: dict[tuple[str, str], Run] = {}
    for pair in comparison.pairs:
        for source, run in ((pair.source_a, pair.a), (pair.source_b, pair.b)):
            earlier = runs.get((source, run.label))
            if earlier is None or earlier.duration < run.duration:
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
