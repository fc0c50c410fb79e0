"""How commands answer: tables and lines on stdout, one JSON object, one line on stderr."""

import json
import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any, NoReturn

import typer

FINE, NO, COULD_NOT_RUN = 0, 1, 2
PLAIN_WIDTH, WIDEST = 132, 10_000
MISSING = ("-", "never")

ScenarioArgument = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a shipped one.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def print_table(title: str, header: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    """Print a titled table; columns of numbers stand to the right, and are never cut."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(width=None if sys.stdout.isatty() else PLAIN_WIDTH, highlight=False)
    table = Table()
    for i, column in enumerate(header):
        numbers = bool(rows) and all(_is_number(row[i]) for row in rows)
        whole = numbers or i == 0
        table.add_column(
            Text(column),
            justify="right" if numbers else "left",
            no_wrap=whole,
            min_width=max(len(cell) for cell in (column, *(row[i] for row in rows)))
            if whole
            else None,
        )
    for row in rows:
        table.add_row(*map(Text, row))
    unbounded = console.options.update(max_width=WIDEST)
    console.width = max(console.width, console.measure(table, options=unbounded).minimum)
    console.print(Text(title))
    console.print(table)


def _is_number(cell: str) -> bool:
    return cell in MISSING or cell.lstrip("-+")[:1].isdigit()


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None] | None]:
    """A bar on stderr where someone watches, nothing elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, Any] = {}

        def show(label: str, part: float) -> None:
            if label not in tasks:
                tasks[label] = bar.add_task(label, total=1.0)
            bar.update(tasks[label], completed=part)

        yield show


def print_json(value: dict[str, Any]) -> None:
    """Print one JSON object; numbers JSON has no word for become null."""
    print(json_text(value))


def json_text(value: dict[str, Any]) -> str:
    """One JSON object; numbers JSON has no word for become null."""
    return json.dumps(_finite(value), indent=2)


def _finite(value: Any) -> Any:
    """`value` with None for numbers that JSON has no word for."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return value


def say(line: str) -> None:
    """Print one line on stdout."""
    print(line)


def tell(line: str) -> None:
    """Print one line on stderr, for someone who watches."""
    print(line, file=sys.stderr)


def fail(reason: str, status: int) -> NoReturn:
    """Print the reason in one line on stderr and exit with `status`."""
    print(f"flighttune: {' '.join(reason.split())}", file=sys.stderr)
    sys.exit(status)
