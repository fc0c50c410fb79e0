"""Commands that write pages: on runs, and on the paper's figures, tables and claims."""

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli.options import ConformanceOption, TubeOption, check_ending
from flighttune.cli.progress import progress_bar
from flighttune.cli.show import emit, pick
from flighttune.cli.tube import (
    fail_if_outside,
    run_tubes,
    run_tubes_notes,
    run_tubes_table,
    run_tubes_values,
)
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Table

PRINTED = ("convergence", "certificates", "aircraft")
"""Tables of the page that are printed too; ``--json`` has the records of all."""


def report(
    path: Annotated[
        str,
        Argument(
            metavar="PATH",
            help="A run folder, a recording or a Parquet file; or SCENARIO@GAINS, which is flown.",
        ),
    ],
    out: Annotated[Path, Option("--out", "-o", help="HTML file to write.")] = Path("report.html"),
    tube: TubeOption = False,
    conformance: ConformanceOption = None,
) -> None:
    """Write one page about runs: headline, figures, tables and how to fly them again.

    The page is one file and needs no network.
    """
    from flighttune.comparison import load_source
    from flighttune.report.page import write_report

    check_ending(out, ".html", ".htm")
    source = load_source(path)
    folder = Path(path)
    if not folder.is_dir():
        folder = folder.parent if folder.exists() else out.parent
    tubes = run_tubes(source.runs, folder, make=tube, conformance=conformance)
    notes = run_tubes_notes(tubes, f"flighttune report {path} --tube")
    page = write_report(
        replace(source, runs=tubes.runs),
        out,
        tubes=notes,
        at_a_glance=tubes.at_a_glance,
        tube_table=run_tubes_table(tubes),
    )
    emit(
        Answer(
            values={
                "bytes": page.path.stat().st_size,
                "summary": page.summary,
                "sections": page.sections,
                "tables": {table.name: table.records for table in page.tables if table.name},
                "tubes": run_tubes_values(tubes),
            },
            tables=[
                *(replace(table, name="") for table in page.tables if table.name in PRINTED),
                run_tubes_table(tubes),
            ],
            notes=[*page.summary, *notes],
            files={"report": page.path},
        )
    )
    fail_if_outside(tubes)


def reproduce(
    items: Annotated[
        list[str] | None,
        Argument(metavar="[ITEM ...]", help="Figures and tables by name [default: all]."),
    ] = None,
    out: Annotated[Path, Option(help="Folder for figures, tables and page.")] = Path(
        "runs/reproduce"
    ),
) -> None:
    """Reproduce the figures and tables of arXiv 2411.13140 and judge its claims."""
    from flighttune.paper.claims import VERDICTS
    from flighttune.paper.reproduce import reproduce as reproduce_items

    with progress_bar() as progress:
        made = reproduce_items(items or (), out, progress=progress)

    findings = [
        pick(finding, "id text where verdict expected computed") for finding in made.findings
    ]
    counts = Counter(finding.verdict for finding in made.findings)
    verdicts = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS)
    # the claims of one item alone are few of many: the page lists them
    claims = [] if items else findings
    emit(
        Answer(
            values={
                "items": [
                    {"name": item.name, "files": files, "values": made_item.values}
                    for item, made_item, files in made.items
                ],
                "claims": findings,
                **pick(made, "page errata"),
            },
            tables=[
                Table(
                    title="claims of the paper", columns=columns("id verdict text"), records=claims
                )
            ],
            verdict=f"claims: {verdicts}",
            files={"page": made.page},
        )
    )
