"""The page of a gap."""

from collections.abc import Sequence
from pathlib import Path

from flighttune.files.table import toml_text
from flighttune.gaps.gap import Gap
from flighttune.present.frame import Report, Section, write_answer
from flighttune.present.tables import Table
from flighttune.reports.gap_charts import gap_charts
from flighttune.reports.page import flown_in_words
from flighttune.reports.tables import provenance_table
from flighttune.simulate.run import claim_notes, run_styles

CLAIM_NOTE = (
    "The error of the aircraft is drawn in the tubes and bands that cover its flight: "
    "flighttune gap SCENARIO takes --claim FILE."
)


def write_gap_page(gap: Gap, tables: Sequence[Table], path: str | Path) -> Report:
    """Write one self-contained page about a gap; InputError if the aircraft did not fly."""
    origin = gap.aircraft.provenance
    return write_answer(
        path,
        title=f"From the law to the aircraft: {gap.scenario.title}; gains {gap.name}",
        about=(flown_in_words(gap.scenario, gap.runs),),
        summary=gap.causes,
        parts={
            "responses": Section(
                note=" ".join([CLAIM_NOTE, *claim_notes([gap.aircraft])]),
                charts=gap_charts(gap),
                legend=False,
            ),
            "numbers": Section(title="Numbers", tables=tables, legend=False),
        },
        styles=run_styles(gap.runs),
        provenance=provenance_table(gap.scenario.title, gap.scenario, gap.runs),
        commands=f"flighttune gap scenario.toml --gains {origin.gains_name}",
        texts={"scenario.toml": toml_text(origin.scenario)},
    )
