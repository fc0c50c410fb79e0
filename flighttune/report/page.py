"""The report on the runs of a scenario, one self-contained HTML file."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flighttune.comparison import Source, load_source
from flighttune.flight.gap_charts import bound_chart, itae_chart, steps_chart
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.present.tables import Table
from flighttune.report.facts import CONVERGED_AT_LEAST, CONVERGED_PART, Facts, facts_of
from flighttune.report.gap import step_table
from flighttune.report.guarantee_panels import certificate_panels, frontier_panel
from flighttune.report.panels import commands, errors, paths, tracking
from flighttune.report.tables import (
    certificates_table,
    convergence_table,
    gains_table,
    kept_table,
    paths_table,
    provenance_table,
    runs_table,
    tracking_table,
)
from flighttune.report.toml_text import toml_text
from flighttune.units import DEG_PER_RAD

MAX_GAPS = 3
"""Gain sets whose gap is drawn; the table has all of them."""

CONVERGES = (
    "A run converges if it was completed and over the last quarter of the flight both errors stay "
    f"within {100.0 * CONVERGED_PART:.0f} % of their largest, or within "
    f"{CONVERGED_AT_LEAST * DEG_PER_RAD:.1f}°."
)
BOUND = (
    "The proof is about the linear law. s stacks error rates and errors. Dashed: the guaranteed "
    "bound, i.e. the linear law's decay plus the ultimate bound (dotted) for the mismatch measured "
    "in the second half of the flight. It pauses while a command is limited and restarts when the "
    "reference changes slope. A red cross marks where a flight first exceeds it."
)
SENSED = "It does not include sensor errors, by which alone a flight may exceed it."
NO_CURVE = (
    "There is no curve of R_K against I_K: no stable gains were found within the limits of the "
    "scenario's tuning."
)


def write_report(
    source: str | Path | Source,
    path: str | Path,
    *,
    tubes: Sequence[str] = (),
    at_a_glance: Sequence[str] = (),
    tube_table: Table | None = None,
) -> Report:
    """Write one self-contained page about the runs of a scenario.

    Parameters
    ----------
    source : str, path-like or Source
        Anything `flighttune.comparison.load_source` takes: a run folder, a recording, a Parquet
        file or ``scenario@gains``.
    path : path-like
        HTML file to write or replace; parent folders are made.
    tubes : sequence of str
        A sentence for each tube of the runs. Tubes are drawn where the runs have them.
    at_a_glance : sequence of str
        Sentences for the top of the page, on the possible deviation of each aircraft.
    tube_table : Table, optional
        Widths of the tubes.

    Returns
    -------
    Report

    Raises
    ------
    RecordingError
        If no run flew, the runs are of several scenarios, or the file cannot be written.
    ScenarioError
        If the recorded scenario is not valid any more.
    """
    source = source if isinstance(source, Source) else load_source(source)
    facts = facts_of(source)
    made = facts.runs[0].provenance
    converged = sum(late["converges"] for late in facts.convergence.values())
    return write_page(
        Path(path),
        page_template("flighttune.report", "page.html.jinja"),
        summary=(
            f"{facts.claim.short}.",
            f"{converged} of {len(source.runs)} runs converge.",
            *at_a_glance,
        ),
        claim_sentence=f"{facts.claim.sentence}.",
        criterion=CONVERGES,
        sections=_sections(facts, tubes, [tube_table] if tube_table else []),
        title=facts.scenario.title,
        claim=facts.scenario.verifies,
        legend=[(run.label, facts.styles[run.label]) for run in facts.runs],
        styles=facts.styles,
        without_gap=facts.without_gap,
        missing=facts.missing,
        provenance=provenance_table(facts.name, facts.scenario, facts.runs),
        scenario_text=toml_text(made.scenario),
        first_gains=facts.gains[0].name if facts.gains else None,
        version=made.versions.get("flighttune", ""),
    )


def _sections(facts: Facts, tubes: Sequence[str], widths: list[Table]) -> list[Section]:
    errors_note = (
        "Errors are reference minus actual, the course error wrapped to ±180°. A band is the tube "
        "of a run: every flight of its model is in it."
    )
    sections = [
        Section(
            id="runs",
            title="",
            charts=tracking(facts.drawn),
            tables=[convergence_table(facts)],
            folded=False,
        ),
        Section(
            id="tracking",
            title="Errors and metrics",
            note=" ".join([errors_note, *tubes]),
            charts=errors(facts.drawn),
            tables=[tracking_table(facts), runs_table(facts), *widths],
        ),
        Section(
            id="commands",
            title="Commands and path",
            note="Commands after magnitude and rate limits.",
            charts=[*commands(facts.drawn), *paths(facts.drawn)],
        ),
    ]
    if facts.gaps:
        sections.append(_gap_section(facts))
    curve = frontier_panel(facts)
    notes = [BOUND, SENSED if facts.scenario.sensors else "", "" if curve else NO_CURVE]
    certificate = Section(
        id="certificate",
        title="Certificate",
        note=" ".join(filter(None, notes)),
        charts=[*certificate_panels(facts), *curve],
        tables=[gains_table(facts), certificates_table(facts), kept_table(facts)],
    )
    return [*sections, certificate]


def _gap_section(facts: Facts) -> Section:
    drawn = facts.gaps[:MAX_GAPS]
    more = len(facts.gaps) - len(drawn)
    unseen = f" The tables have {more} more." if more else ""
    return Section(
        id="gap",
        title="From the law to the aircraft",
        note="The same gains under the same limits in the same air, on the paper's law, the exact "
        "point mass, the point mass behind the inner loop and the aircraft. Red: the tube of the "
        f"aircraft, where there is one; flighttune fly SCENARIO --tube makes it.{unseen}",
        charts=[
            kind(gap, channel)
            for gap in drawn
            for channel in CHANNEL_SYMBOLS
            for kind in (itae_chart, steps_chart, bound_chart)
        ],
        columns=3,
        tables=[replace(step_table(facts.gaps), name="gap"), paths_table(facts)],
        legend=False,
    )
