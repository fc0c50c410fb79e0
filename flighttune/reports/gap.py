"""The page of a gap."""

from collections.abc import Sequence
from pathlib import Path

from flighttune.files.table import toml_text
from flighttune.gaps.gap import Gap
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.tables import Table
from flighttune.reports.gap_charts import gap_charts
from flighttune.reports.tables import provenance_table
from flighttune.simulate.run import claim_notes, run_styles

CLAIM_NOTE = (
    "The error of the aircraft is drawn in the tubes and bands that cover its flight: "
    "flighttune gap SCENARIO takes --claim FILE."
)


def write_gap_page(gap: Gap, tables: Sequence[Table], path: str | Path) -> Report:
    """Write one self-contained page about a gap; InputError if the aircraft did not fly."""
    origin = gap.aircraft.provenance
    return write_page(
        Path(path),
        page_template("flighttune.reports", "commands.html.jinja"),
        summary=gap.causes,
        sections=[
            Section(
                note=" ".join([CLAIM_NOTE, *claim_notes([gap.aircraft])]),
                charts=gap_charts(gap),
                legend=False,
            ),
            Section(id="numbers", title="Numbers", tables=tables, legend=False),
        ],
        title=f"From the law to the aircraft: {gap.scenario.title}; gains {gap.name}",
        styles=run_styles(gap.runs),
        provenance=provenance_table(gap.scenario.title, gap.scenario, gap.runs),
        commands=f"flighttune gap scenario.toml --gains {origin.gains_name}",
        scenario_text=toml_text(origin.scenario),
    )
