"""The command line as a user meets it: what it prints on stdout and stderr, and its exit status."""

import io
import json
import subprocess
import sys
from contextlib import chdir, nullcontext, redirect_stderr, redirect_stdout
from unittest import mock

from flighttune.cli import main

LONGEST_S = 300


def flighttune(*arguments, status=0, cwd=None):
    """Run a command in this process; return what it printed on stdout and on stderr.

    A process of its own costs two seconds of imports: `flighttune_process` is for what needs one.
    """
    stdout, stderr = io.StringIO(), io.StringIO()
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
    assert ended == status, stderr.getvalue()
    return stdout.getvalue(), stderr.getvalue()


def flighttune_process(*arguments, status=0, **options):
    """The same in a process of its own, with `options` of `subprocess.run`."""
    done = subprocess.run(
        [sys.executable, "-m", "flighttune", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
        **options,
    )
    assert done.returncode == status, done.stderr
    return done.stdout, done.stderr


def answer(*arguments, status=0, cwd=None):
    """The JSON object a command prints."""
    return json.loads(flighttune(*arguments, "--json", status=status, cwd=cwd)[0])
