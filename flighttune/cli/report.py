"""Commands that write pages: on runs, and on the paper's figures, tables and claims."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli.options import ConformanceOption, TubeOption, check_ending
from flighttune.cli.progress import progress_bar
from flighttune.cli.show import emit, table
from flighttune.cli.tube import fail_if_outside, run_tubes, run_tubes_json, run_tubes_text
from flighttune.present.tables import Bad, Table

if TYPE_CHECKING:
    from flighttune.paper.claims.base import Finding


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
    lines = [*run_tubes_text(tubes, f"flighttune report {path} --tube")]
    written = write_report(
        replace(source, runs=tubes.runs), out, tubes=lines, at_a_glance=tubes.at_a_glance
    )
    answer = {
        "report": written.path,
        "bytes": written.path.stat().st_size,
        "summary": written.summary,
        "headline": written.answers,
        "sections": written.sections,
        "tubes": run_tubes_json(tubes),
    }

    def text() -> Iterator[str]:
        yield from written.summary
        for one in written.answers:
            yield f"{one.question} {one.short}"
            for sentence in (one.criterion, *one.sentences):
                if sentence:
                    yield f"  {sentence}"
        yield f"report: {written.path}"

    emit(answer, text())
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
    from flighttune.paper.claims.base import VERDICTS
    from flighttune.paper.reproduce import reproduce as reproduce_items

    with progress_bar() as progress:
        made = reproduce_items(items or (), out, progress=progress)

    def text() -> Iterator[Table | str]:
        counts = Counter(finding.verdict for finding in made.findings)
        verdicts = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS)
        if items:
            yield f"claims: {verdicts}; the page lists them"
        else:
            head = ("claim", "verdict", "the paper says", "agree", "expected", "computed")
            rows = [
                (f.claim.id, _verdict(f.verdict), f.claim.text, *_cells(f)) for f in made.findings
            ]
            yield table(verdicts, head, rows)
            yield "agree: comparisons; expected and computed: of the first that does not agree"
        yield f"page: {made.page}"
        if made.recording is not None:
            yield f"recording: {made.recording}   (open it with: flighttune view {made.recording})"

    emit(made.as_dict(), text())


def _verdict(verdict: str) -> str:
    return Bad(verdict) if verdict == "not reproduced" else verdict


def _cells(finding: "Finding") -> tuple[str, str, str]:
    """How many comparisons agree, and both sides of the first that does not."""
    from flighttune.paper.claims.base import text_of

    checks = finding.checks
    if not checks:
        return "-", "-", "-"
    first = next((check for check in checks if not check.holds), checks[0])
    agreeing = f"{sum(check.holds for check in checks)} of {len(checks)}"
    return agreeing, text_of(first.expected), text_of(first.computed)
