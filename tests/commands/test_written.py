"""A command on files: its exit status, words of what it prints, and the files that it writes.

A row of written.txt is `command | status | words of stdout | words of stderr | files`;
`first ; command` runs another before.
"""

import re
import shlex
from pathlib import Path

import pytest
from commands import flighttune, written

SHORT = {
    "band": "band turn.toml --start-deg 2 --plant kinematic --epsilon 0.5 --confidence 0.9"
    " --learn 10 --gains paper --workers 1",
    "pair": "compare paper_as_printed@paper paper_as_printed@K1",
    "box": "tube small.toml --gains paper --start-deg 0.1",
}
"""Beginnings of commands that rows name in braces."""
LINES = Path(__file__).with_name("written.txt").read_text("utf-8").format(**SHORT).splitlines()
ROWS = [[cell.strip() for cell in line.split(" |")] for line in LINES if line[0] != "#"]


LONG = "worst", "tune paper_printed", "fly infeasible", "meet aim.toml --start paper --budget 2 |"


def marks(command):
    """Commands that take over two seconds, or half of one."""
    if command.startswith(LONG):
        return [pytest.mark.slow, pytest.mark.soak]
    return [pytest.mark.slow] * command.startswith(
        ("band", "tube", "tune", "fly", "meet", "report")
    )


@pytest.mark.parametrize(
    ("command", "status", "out", "err", "files"),
    [pytest.param(*row, id=row[0], marks=marks(row[0])) for row in ROWS],
)
def test_a_command_ends_says_and_writes_what_its_row_states(here, command, status, out, err, files):
    *before, last = command.split(" ; ")
    for one in before:
        flighttune(*shlex.split(one))

    printed, told = flighttune(*shlex.split(last), status=int(status))

    assert out in printed
    assert err in told
    assert bool(re.search("^flighttune: ", told, re.MULTILINE)) == (status != "0")
    assert all(x.isprintable() or x in "\n\u00a0" for x in printed + told)
    if files == "-":
        assert written(here) == set()
    else:
        assert written(here) >= set(files.split())
