"""The command line as a user meets it: what it prints on stdout and stderr, and its exit status."""

import io
import json
import sys
import tomllib
from contextlib import chdir, nullcontext, redirect_stderr, redirect_stdout
from unittest import mock

from places import ROOT

from flighttune.cli import main


def flighttune(*arguments, status=0, cwd=None, stderr=None):
    """Run a command in this process; return what it printed on stdout and on stderr.

    A process of its own costs two seconds of imports: commands/test_terminal.py has what needs one.
    With a terminal as `stderr` nothing is returned of that.
    """
    stdout, stderr = io.StringIO(), stderr or io.StringIO()
    ended = 0
    with (
        redirect_stdout(stdout),
        redirect_stderr(stderr),
        mock.patch.object(sys, "argv", ["flighttune", *map(str, arguments)]),
        chdir(cwd) if cwd else nullcontext(),
    ):
        try:
            main()
        except SystemExit as exit_:
            ended = exit_.code or 0
    assert status is None or ended == status, said(stderr)
    return stdout.getvalue(), said(stderr)


def said(stream):
    return stream.getvalue() if isinstance(stream, io.StringIO) else ""


def answer(*arguments, status=0, cwd=None):
    """The JSON object a command prints."""
    return json.loads(flighttune(*arguments, "--json", status=status, cwd=cwd)[0])


def written(folder):
    """The files that commands wrote in a folder; what they were given there are links."""
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    return {path.relative_to(folder).as_posix() for path in files}


PANELS = tomllib.loads((ROOT / "flighttune/cli/commands.toml").read_text(encoding="utf-8"))
ALIKE, FORMER = PANELS.pop("alike"), PANELS.pop("former")
COMMANDS = {name: texts for panel in PANELS.values() for name, texts in panel.items()}
"""What the table of commands says of each, without what is said of options in general."""
