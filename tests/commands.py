"""The command line as a user meets it: a process with stdout, stderr and an exit status."""

import json
import subprocess
import sys

LONGEST_S = 300


def flighttune(*arguments, status=0, cwd=None):
    """Run a command; return what it printed on stdout and on stderr."""
    done = subprocess.run(
        [sys.executable, "-m", "flighttune", *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=LONGEST_S,
        check=False,
        cwd=cwd,
    )
    assert done.returncode == status, done.stderr
    return done.stdout, done.stderr


def answer(*arguments, status=0, cwd=None):
    """The JSON object a command prints."""
    return json.loads(flighttune(*arguments, "--json", status=status, cwd=cwd)[0])
