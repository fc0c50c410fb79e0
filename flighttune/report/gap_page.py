"""The gap of one set of gains as a page."""

from pathlib import Path

from flighttune.flight.gap import Gap
from flighttune.flight.gap_charts import gap_charts
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.report.gap_tables import largest_step, step_table
from flighttune.report.tables import provenance_table
from flighttune.report.toml_text import toml_text
from flighttune.simulate.run import run_styles

TUBE_NOTE = (
    "The error of the aircraft is drawn in its tube where there is one: "
    "flighttune gap SCENARIO --tube --conformance FILE makes it."
)


def write_gap_page(gap: Gap, path: str | Path) -> Report:
    """Write one self-contained page about a gap; parent folders are made.

    Raises InputError if the aircraft did not fly, OutputError if the file cannot be written.
    """
    charts = gap_charts(gap)
    made = gap.aircraft.provenance
    return write_page(
        Path(path),
        page_template("flighttune.report", "commands.html.jinja"),
        summary=(largest_step(gap),),
        sections=[
            Section(id="runs", title="", note=TUBE_NOTE, charts=charts, legend=False, folded=False),
            Section(
                id="bound",
                title="Numbers",
                tables=[step_table([gap])],
                legend=False,
            ),
        ],
        title=f"From the law to the aircraft: {gap.scenario.title}; gains {gap.name}",
        styles=run_styles(gap.runs),
        provenance=provenance_table(gap.scenario.title, gap.scenario, gap.runs),
        commands=f"flighttune gap scenario.toml --gains {made.gains_name}",
        scenario_text=toml_text(made.scenario),
    )
