"""Commands that compare and publish: the gap to the aircraft, runs, pages, exports."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.band import band_around, band_page
from flighttune.cli.gains import chosen_gains
from flighttune.cli.show import COULD_NOT_RUN, NO, pick, progress_bar, tell
from flighttune.cli.tube import tubes_around
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Table

# Tables of the page that are printed too; ``--json`` has the records of all.
PRINTED = ("convergence", "certificates", "aircraft")


def gap(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    plant: options.AircraftPlantOption = None,
    out: Annotated[Path | None, options.out_folder("runs/NAME-gap")] = None,
    lag: Annotated[
        Literal["identified", "fitted"] | None,
        Option(
            help="Inner-loop lag of the third plant: from the aircraft's model file, or fitted to "
            "this flight [default: the model file, if there is one]."
        ),
    ] = None,
    tube: options.TubeOption = False,
    conformance: options.ConformanceOption = None,
    band: options.BandOption = None,
    settings: options.SetOption = None,
) -> Answer:
    """Fly gains on plants from the paper's law to the aircraft; show what each step adds.

    Exit status 1 if a flight ends early, or the aircraft leaves its tube.
    """
    from flighttune.flight.gap import explain_gap
    from flighttune.flight.gap_charts import gap_sheet
    from flighttune.recording.record import record
    from flighttune.report.gap import causes, gap_tables, gap_values, write_gap_page

    loaded, name, chosen = chosen_gains(scenario, gains, settings)
    for note in loaded.notes:
        tell(f"{scenario}: {note}")
    stem, source = f"{Path(scenario).stem}-gap", options.repeated(scenario, settings)
    folder = out or Path("runs") / stem
    with progress_bar() as progress:
        explained = explain_gap(loaded, chosen, name=name, plant=plant, lag=lag, progress=progress)
    tubes, tubes_answer = tubes_around(
        explained.runs[-1:],
        folder,
        f"flighttune gap {source} --tube",
        make=tube,
        conformance=conformance,
        scenario=source if gains in (None, name) else "",
    )
    runs, of_band = band_around(tubes.runs, band)
    explained = replace(explained, runs=(*explained.runs[:-1], *runs))
    files = record(explained.flown(), folder, name=stem)
    values = gap_values(explained, files.signals)
    tables = gap_tables(explained, values)
    notes = [*causes(explained), *tubes_answer.notes, *of_band.notes]
    figure = page = None
    if explained.steps:
        figure, page = folder / "gap.svg", folder / "gap.html"
        gap_sheet(explained).save(figure)
        write_gap_page(explained, tables, page)
        if failed := explained.failed:
            why = "; ".join(f"{plant} {reason}" for plant, reason in failed.items())
            notes.insert(0, f"No metrics of, from or to a rung that failed: {why}")
    ended = "" if explained.status == "explained" else f"{scenario}: {explained.reason}"
    return Answer(
        values={**values, **tubes_answer.values, **of_band.values},
        tables=[*tables, *tubes_answer.tables],
        notes=notes,
        files={"recording": files.recording, "figure": figure, "page": page},
        failure=tubes_answer.failure or ended,
    )


def compare(
    first: Annotated[
        str,
        Argument(
            metavar="A",
            help="A run folder, a Parquet file, a recording or SCENARIO@GAINS, which is flown. "
            "Append @ and a gain set, a plant or a run to choose among the runs of a folder.",
        ),
    ],
    others: Annotated[
        list[str] | None,
        Argument(
            metavar="[B...]",
            help="What to compare A with [default: the first run of A with each other].",
        ),
    ] = None,
    tolerance: Annotated[
        Path | None,
        Option(help="TOML file of allowed changes; exit status 1 if one is exceeded."),
    ] = None,
    out: Annotated[
        Path | None,
        Option(help="Recording (.rrd) or page (.html) to write, with all runs overlaid."),
    ] = None,
) -> Answer:
    """Compare runs: metrics, which is better, and how far apart the paths are.

    Exit status 2 if manoeuvre or aircraft differ.
    """
    from flighttune.comparison import compare as compare_sources
    from flighttune.comparison.compare import comparison_table, pairs_table
    from flighttune.comparison.tolerance import load_tolerances, violations

    options.check_ending(out, ".rrd", ".html")
    allowed = None if tolerance is None else load_tolerances(tolerance)
    comparison = compare_sources(first, *(others or ()))
    broken = violations(comparison, allowed) if allowed else []
    files: dict[str, Path | None] = {"recording": None, "page": None}
    if out is not None and comparison.comparable:
        if out.suffix.lower() == ".html":
            from flighttune.report.page import write_comparison_page as write
        else:
            from flighttune.comparison.compare import write_overlay as write
        write(comparison, out)
        files["page" if out.suffix.lower() == ".html" else "recording"] = out
    differs = {
        f"not the same: {key}: {first} and {second}"
        for pair in comparison.pairs
        for key, (first, second) in pair.differs.items()
    }
    failure, status = "", COULD_NOT_RUN
    if not comparison.comparable:
        failure = comparison.reason
    elif allowed and comparison.unpaired:
        unpaired = ", ".join(comparison.unpaired)
        failure = f"{tolerance}: every run must have a partner to be checked, got none: {unpaired}."
    elif broken:
        more = f" ({len(broken) - 1} more)" if len(broken) > 1 else ""
        failure, status = f"{tolerance}: {broken[0].sentence}{more}", NO
    return Answer(
        values={
            **pick(comparison, "comparable reason"),
            "metrics": comparison.metrics.to_dict(orient="records"),
            "max_distance_m": comparison.max_distance,
            **pick(comparison, "unpaired missing"),
            "violations": broken,
        },
        tables=[pairs_table(comparison), comparison_table("metrics", comparison.metrics)],
        notes=[
            *sorted(differs),
            *(f"missing: {line}" for line in comparison.missing),
            *(f"no partner: {line}" for line in comparison.unpaired),
            *(f"out of tolerance: {violation.sentence}" for violation in broken),
        ],
        files=files,
        failure=failure,
        status=status,
    )


def report(
    path: Annotated[
        str,
        Argument(
            metavar="PATH",
            help="A run folder, a recording or a Parquet file; SCENARIO@GAINS, which is flown; or "
            "a band file (.npz).",
        ),
    ],
    out: Annotated[Path, Option("--out", "-o", help="HTML file to write.")] = Path("report.html"),
    tube: options.TubeOption = False,
    conformance: options.ConformanceOption = None,
    band: options.BandOption = None,
    settings: options.SetOption = None,
) -> Answer:
    """Write one page about runs or a band: headline, figures, tables, how to fly them again.

    The page is one file and needs no network.
    """
    from flighttune.comparison import load_source
    from flighttune.report.page import write_report

    options.check_ending(out, ".html", ".htm")
    if Path(path).suffix == ".npz":
        return band_page(path, out)
    source = load_source(path, changes=options.changes(settings))
    folder = Path(path)
    if not folder.is_dir():
        folder = folder.parent if folder.exists() else out.parent
    command = f"flighttune report {options.repeated(path, settings)} --tube"
    tubes, tubes_answer = tubes_around(
        source.runs, folder, command, make=tube, conformance=conformance
    )
    runs, of_band = band_around(tubes.runs, band)
    page = write_report(
        replace(source, runs=tuple(runs)),
        out,
        tubes=tubes_answer.notes,
        at_a_glance=tubes.at_a_glance,
        tube_table=tubes_answer.tables[0],
    )
    named = [table for table in page.tables if table.name]
    return Answer(
        values={
            "bytes": page.path.stat().st_size,
            "summary": page.summary,
            "sections": page.sections,
            "tables": {table.name: table.records for table in named},
            **tubes_answer.values,
            **of_band.values,
        },
        tables=[
            *(replace(table, name="") for table in named if table.name in PRINTED),
            *tubes_answer.tables,
        ],
        notes=[*page.summary, *tubes_answer.notes, *of_band.notes],
        files={"report": page.path},
        failure=tubes_answer.failure,
    )


def reproduce(
    items: Annotated[
        list[str] | None,
        Argument(metavar="[ITEM ...]", help="Figures and tables by name [default: all]."),
    ] = None,
    out: Annotated[Path, Option(help="Folder for figures, tables and page.")] = Path(
        "runs/reproduce"
    ),
) -> Answer:
    """Reproduce the figures and tables of arXiv 2411.13140 and judge its claims."""
    from flighttune.paper.claims import VERDICTS
    from flighttune.paper.reproduce import reproduce as reproduce_items

    with progress_bar() as progress:
        made = reproduce_items(items or (), out, progress=progress)

    keys = "id text where verdict expected computed"
    findings = [pick(finding, keys) for finding in made.findings]
    counts = Counter(finding.verdict for finding in made.findings)
    # the claims of one item alone are few of many: the page lists them
    claims = [] if items else findings
    return Answer(
        values={
            "items": [
                {"name": item.name, "files": files, "values": made_item.values}
                for item, made_item, files in made.items
            ],
            "claims": findings,
            **pick(made, "page errata"),
        },
        tables=[Table(columns("id verdict text"), claims, "claims of the paper")],
        verdict=f"claims: {', '.join(f'{counts[verdict]} {verdict}' for verdict in VERDICTS)}",
        files={"page": made.page},
    )


def export(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    plant: options.AircraftPlantOption = None,
    form: Annotated[
        Literal["jsbsim", "c"],
        Option("--format", help="A folder that JSBSim flies by itself, or one C99 file."),
    ] = "jsbsim",
    out: Annotated[Path | None, options.out_folder("runs/NAME-export")] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Write one flight of SCENARIO for JSBSim alone, or its outer loop in C.

    JSBSim flies the folder at once: exit status 1 if its flight is not that of `fly`.
    """
    from flighttune.export import COLUMNS, CSV, README, SCRIPT, export_c, export_jsbsim

    loaded, name, chosen = chosen_gains(scenario, gains, settings)
    folder = out or Path("runs") / f"{Path(scenario).stem}-export"
    if form == "c":
        source = export_c(loaded, name, chosen, folder, plant=plant)
        return Answer(files={"folder": folder, "source": source})
    folder = folder.absolute()
    made = export_jsbsim(loaded, name, chosen, folder, plant=plant)
    return Answer(
        values={
            "start_s": made.start,
            "csv": folder / CSV,
            "differences": {COLUMNS[name]: value for name, value in made.differences.items()},
        },
        notes=[
            f"The command flies it and writes {folder / CSV}, which has the flight from "
            f"Time = {made.start:g} s on.",
            *([made.verdict] if made.same else ()),
        ],
        command=made.command,
        files={"folder": folder, "script": folder / SCRIPT, "readme": folder / README},
        failure="" if made.same else f"{folder}: {made.verdict} The folder is kept.",
    )
