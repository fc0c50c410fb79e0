"""The command that makes the paper again."""

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from flighttune.cli.show import JsonOption, print_json, print_table, progress_bar, say

if TYPE_CHECKING:
    from flighttune.paper.claims.base import Finding


def reproduce(
    items: Annotated[
        list[str] | None,
        typer.Argument(metavar="[ITEM ...]", help="Figures and tables by name; all by default."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of figures, tables and page.")] = Path(
        "runs/reproduce"
    ),
    as_json: JsonOption = False,
) -> None:
    """Make the figures and tables of arXiv 2411.13140 again and judge its claims."""
    from flighttune.paper.claims.base import VERDICTS
    from flighttune.paper.reproduce import reproduce as reproduce_items

    with progress_bar() as progress:
        made = reproduce_items(items or (), out, progress=progress)
    if as_json:
        print_json(made.as_dict())
        return
    counts = Counter(finding.verdict for finding in made.findings)
    verdicts = ", ".join(f"{counts[verdict]} {verdict}" for verdict in VERDICTS)
    if items:
        say(f"claims: {verdicts}; they stand on the page")
    else:
        print_table(
            verdicts,
            ("claim", "verdict", "the paper says", "holds", "expected", "computed"),
            [(f.claim.id, f.verdict, f.claim.text, *_cells(f)) for f in made.findings],
        )
        say("holds: comparisons that agree; expected and computed are of the first that does not")
    say(f"page: {made.page}")
    if made.recording is not None:
        say(f"recording: {made.recording}   (open it with: flighttune view {made.recording})")


def _cells(finding: "Finding") -> tuple[str, str, str]:
    """How many comparisons hold, and what is expected and computed in the first that does not."""
    from flighttune.paper.page import shown

    checks = finding.checks
    if not checks:
        return "-", "-", "-"
    telling = next((check for check in checks if not check.holds), checks[0])
    held = sum(check.holds for check in checks)
    return f"{held} of {len(checks)}", shown(telling.expected), shown(telling.computed)
