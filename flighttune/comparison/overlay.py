"""Compared runs in one recording, aligned at the start of the flight."""

from dataclasses import replace
from pathlib import Path

from flighttune.comparison.compare import Comparison, comparison_table
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
    page = scenario_page(runs, scenario=scenario)
    compared = comparison_table("Compared", comparison.metrics).markdown()
    write_recording(runs, Path(path), page=f"{page}\n## Compared\n\n{compared}\n", title=title)


def sources_of(comparison: Comparison) -> list[str]:
    """Names of the sources, the first one before all others."""
    firsts = [pair.source_a for pair in comparison.pairs]
    return list(dict.fromkeys([*firsts, *(pair.source_b for pair in comparison.pairs)]))


def overlaid(comparison: Comparison) -> list[Run]:
    """Every run of a comparison once, with a letter for the source if runs share a label.

    The first source is A, the next one B and so on.
    """
    letters = {name: chr(ord("A") + i) for i, name in enumerate(sources_of(comparison))}
    runs: dict[tuple[str, str], Run] = {}
    for pair in comparison.pairs:
        for source, run in ((pair.source_a, pair.a), (pair.source_b, pair.b)):
            earlier = runs.get((source, run.label))
            if earlier is None or earlier.duration < run.duration:
                runs[source, run.label] = run
    labels = [label for _, label in runs]
    for (source, label), run in runs.items():
        if labels.count(label) > 1:
            name = f"{run.provenance.gains_name} ({letters[source]})"
            runs[source, label] = replace(run, provenance=replace(run.provenance, gains_name=name))
    return list(runs.values())
