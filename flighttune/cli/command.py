"""Common parts of commands: place in the help, example, --json, -q and status line."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from flighttune.cli.show import working

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only failures, and the object of --json.")
]

LONGEST_SENTENCE = 200
"""Characters of the first sentence of a command's help."""


class Grouped(TyperGroup):
    """A group of commands whose help lists them under headings, in the order they were added."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the commands, each group of them under its heading."""
        panels: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", None)
            rows = panels.setdefault(panel if isinstance(panel, str) else "Commands", [])
            rows.append((name, command.get_short_help_str(LONGEST_SENTENCE)))
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)


def add_command(
    app: typer.Typer,
    function: Callable[..., None],
    *,
    doing: str,
    example: str,
    name: str | None = None,
    panel: str | None = None,
    answers: bool = True,
) -> None:
    """Add a command to an app; the docstring of `function` is its help.

    `doing` is the status on a terminal, such as ``tuning``; `panel` is the heading in the help.
    With `answers` the command prints an answer, which can be a JSON object.
    """
    options = {"as_json": JsonOption} if answers else {}
    options["quiet"] = QuietOption

    @wraps(function)
    def command(*args: Any, quiet: bool = False, as_json: bool = False, **kwargs: Any) -> None:
        with working(doing, quiet=quiet, as_json=as_json):
            function(*args, **kwargs)

    signature = inspect.signature(function)
    added = [
        inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=option)
        for key, option in options.items()
    ]
    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*signature.parameters.values(), *added]
    )
    command.__annotations__ = function.__annotations__ | options
    app.command(name or function.__name__, rich_help_panel=panel, epilog=f"Example: {example}")(
        command
    )
