"""The command that writes a page to send to a colleague."""

from pathlib import Path
from typing import Annotated

import typer

from flighttune.cli.show import JsonOption, print_json, say
from flighttune.errors import InputError


def report(
    path: Annotated[
        str,
        typer.Argument(
            metavar="PATH",
            help="A run folder, a recording or a Parquet file; or SCENARIO@GAINS, which is flown.",
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="HTML file to write.")] = Path(
        "report.html"
    ),
    as_json: JsonOption = False,
) -> None:
    """Write one page about runs: headline, figures, tables and how to fly them again.

    The page needs no network and nothing beside it.
    """
    from flighttune.report.page import write_report

    if out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: --out must end in .html.")
    written = write_report(path, out)
    if as_json:
        print_json(
            {
                "report": str(written.path),
                "bytes": written.path.stat().st_size,
                "headline": [
                    {
                        "question": answer.question,
                        "verdict": answer.verdict,
                        "short": answer.short,
                        "criterion": answer.criterion,
                        "sentences": list(answer.sentences),
                    }
                    for answer in written.answers
                ],
                "sections": list(written.sections),
            }
        )
        return
    for answer in written.answers:
        say(f"{answer.question} {answer.short}")
        if answer.criterion:
            say(f"  {answer.criterion}")
        for sentence in answer.sentences:
            say(f"  {sentence}")
    say(f"report: {written.path}")
