"""A comparison as a page: runs overlaid, and their metrics."""

from pathlib import Path

from flighttune.comparison import Comparison
from flighttune.comparison.compare import comparison_table, pairs_table
from flighttune.comparison.overlay import overlaid, sources_of
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.report.panels import commands, errors, paths, tracking
from flighttune.report.tables import provenance_table
from flighttune.report.toml_text import toml_text
from flighttune.scenario.load import scenario_from
from flighttune.simulate.run import run_styles


def write_comparison_page(comparison: Comparison, path: str | Path) -> Report:
    """Write one self-contained page about comparable runs; parent folders are made.

    Raises OutputError if the file cannot be written.
    """
    runs = tuple(overlaid(comparison))
    styles = run_styles(runs)
    drawn = [(run, styles[run.label]) for run in runs]
    scenario = runs[0].provenance.scenario
    sources = sources_of(comparison)
    return write_page(
        Path(path),
        page_template("flighttune.report", "commands.html.jinja"),
        sections=[
            Section(
                id="runs",
                title="",
                charts=tracking(drawn),
                tables=[pairs_table(comparison)],
                folded=False,
            ),
            Section(
                id="metrics",
                title="Errors and metrics",
                charts=errors(drawn),
                tables=[comparison_table("metrics", comparison.metrics)],
            ),
            Section(
                id="commands",
                title="Commands and path",
                charts=[*commands(drawn), *paths(drawn)],
            ),
        ],
        title=f"{scenario.get('title', 'Flight')}: comparison",
        legend=list(styles.items()),
        styles=styles,
        provenance=provenance_table(", ".join(sources), scenario_from(dict(scenario)), runs),
        commands=f"flighttune compare {' '.join(sources)}",
        scenario_text=toml_text(scenario),
    )
