"""Write docs/commands.md from the help of the commands: python docs/figures/commands.py."""

import io
import os
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any
from unittest import mock

import typer

from flighttune.cli.app import app

PAGE = Path(__file__).parents[1] / "commands.md"
HEAD = """# Commands

Which command does what you want, and how does it say no? `flighttune COMMAND --help` explains a
command and its options; the built site has all of that help below. The page is made by
`python docs/figures/commands.py`.

Exit status: 0 fine; 1 the answer is no (infeasible, unstable, refused, ended
early); 2 the command could not run, and one line on stderr names the file and the key; or it could
not judge (runs are missing, a claim is not about the flight, most flights ended early), and its
answer says why. With `--json` a command that ran prints one object on stdout and nothing else.
`-q` prints failures only. A gains file is JSON or TOML with `K_P` and `K_I`; the output of
`tune --json` is one. In a pipe tables are 120 characters wide, or as wide as `COLUMNS` says.
`flighttune --install-completion` sets up completion in the shell.
"""


def commands(group: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Heading and words of every command, in the order of the help."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            for _, words in commands(command, (*above, name)):
                yield command.rich_help_panel, words
        else:
            yield command.rich_help_panel, (*above, name)


def help_of(*words: str) -> str:
    """What ``--help`` of a command prints on a terminal of 80 columns."""
    with mock.patch.dict(os.environ, COLUMNS="80"), redirect_stdout(io.StringIO()) as shown:
        app([*words, "--help"], prog_name="flighttune", standalone_mode=False)
    return shown.getvalue().rstrip()


def page() -> str:
    """The page in the repository, as Markdown: the commands of each part of the help."""
    under: dict[str, list[str]] = {}
    for heading, words in commands(typer.main.get_command(app)):
        under.setdefault(heading, []).append(f"`{' '.join(words)}`")
    rows = (f"| {heading} | {', '.join(named)} |" for heading, named in under.items())
    return "\n".join([HEAD, "| to | flighttune ... |", "|---|---|", *rows, ""])


def helps() -> str:
    """The help of all commands, as the site appends it to the page."""
    under: dict[str, list[str]] = {}
    for heading, words in commands(typer.main.get_command(app)):
        shown = f"### flighttune {' '.join(words)}\n\n```text\n{help_of(*words)}\n```\n"
        under.setdefault(heading, [f"## {heading}\n"]).append(shown)
    return "\n".join(part for parts in under.values() for part in parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
