"""All runs of a comparison in one recording."""

from pathlib import Path

from flighttune.recording.page import scenario_page
from flighttune.recording.record import write_recording
from flighttune.records.compare import Comparison, comparison_table, overlaid


def write_overlay(comparison: Comparison, path: str | Path) -> None:
    """Write all runs of a comparison to one recording, aligned at the start of the flight."""
    runs = overlaid(comparison)
    scenario = runs[0].provenance.scenario
    title = f"{scenario.get('title', 'Flight')}: comparison"
    page = scenario_page(runs, scenario=scenario)
    compared = comparison_table("Compared", comparison.metrics).markdown()
    write_recording(runs, Path(path), page=f"{page}\n## Compared\n\n{compared}\n", title=title)
