"""The page of the log of a real flight, and what a comparison with one shows."""

from collections.abc import Sequence
from pathlib import Path

from flighttune.present.answer import Answer, Table, facts_table
from flighttune.present.frame import Report, Section, write_answer
from flighttune.records.compare import Source
from flighttune.reports import panels
from flighttune.simulate.run import run_styles

ABOVE = (("chi", "Course", "χ [deg]"), ("gamma", "Path angle", "γ [deg]"))
BELOW = (
    *(("phi", "Roll", "φ [deg]"), ("phi_cmd", "Roll command", "φ_cmd [deg]")),
    *(("n_z", "Load factor", "n_z [1]"), ("n_z_cmd", "Load-factor command", "n_z,cmd [1]")),
    *(("V_a", "Airspeed", "V_a [m/s]"), ("V_g", "Ground speed", "V_g [m/s]")),
)
NOTE = "Gaps of the log are gaps of its lines. Positions count from the start of the part shown."


def log_sections(flights: panels.Drawn, tables: Sequence[Table] = ()) -> list[Section]:
    """Sections about flights of which one at least is a log: signals that any of them has."""

    def charts(signals: Sequence[tuple[str, str, str]]) -> list[panels.Chart]:
        there = {name for run, _ in flights for name in run.signals}
        return [*panels.flown_signals(flights, [row for row in signals if row[0] in there])]

    placed = [(run, style) for run, style in flights if {"north", "east", "down"} <= {*run.signals}]
    paths = panels.paths(placed) if placed else []
    return [
        Section(note=NOTE, charts=[*charts(ABOVE), *paths], tables=tables),
        Section(id="commands", title="Commands, load and speed", charts=charts(BELOW)),
    ]


def log_facts(source: Source) -> Table:
    """Contents and gaps of logs, and what they show about their own units and signs."""
    facts: dict[str, str] = {}
    for run in source.runs:
        log = run.provenance.log or {}
        samples = f"{run.duration:.1f} s from {log['from_s']:g} s on, {len(run.signals)} samples"
        facts |= {"log": f"{log['file']} ({log['kind']})", "part": samples}
        facts |= {key: "; ".join(log[key]) for key in ("missing", "gaps", "checks") if log[key]}
    return facts_table("The log", facts)


def write_log_page(source: Source, path: Path) -> Report:
    """Write one self-contained page about the log of a real flight; parent folders are made."""
    (run,), styles = source.runs, run_styles(source.runs)
    facts = log_facts(source)
    sections = log_sections([(run, styles[run.label])], [facts])
    page = write_answer(
        path,
        summary=(f"A real flight of {run.duration:.1f} s.",),
        parts={section.id: section for section in sections},
        title=str(run.provenance.scenario["title"]),
        legend=list(styles.items()),
        styles=styles,
        provenance=facts_table("Versions", run.provenance.versions),
        commands=f"flighttune report {source.name}",
    )
    log = run.provenance.log or {}
    shown = Answer(
        values={"bytes": path.stat().st_size, "summary": page.summary, "log": log},
        notes=[*page.summary, *log["checks"], *(f"missing: {line}" for line in source.missing)],
    )
    return Report(
        path=path, summary=page.summary, sections=page.sections, tables=page.tables, shown=shown
    )
