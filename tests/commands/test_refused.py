"""What a command cannot do is one line with exit status 2, and no file is written.

A row of refused/ROOM.txt is `command | words | more words`; `first ; command` runs another before.
"""

import shlex
from pathlib import Path

import pytest
from commands import flighttune, written

FILES = sorted((Path(__file__).parent / "refused").glob("*.txt"))
LINES = [line for file in FILES for line in file.read_text("utf-8").splitlines()]
ROWS = [line.split(" | ") for line in LINES if line and not line.startswith("#")]


@pytest.mark.parametrize(("command", "words"), [(c, w) for c, *w in ROWS], ids=[x[0] for x in ROWS])
def test_what_cannot_run_is_one_line_with_status_2_and_no_file(here, command, words):
    *before, last = command.split(" ; ")
    for one in before:
        flighttune(*shlex.split(one))
    there = written(here)
    out, err = flighttune(*shlex.split(last), status=2)

    assert out == ""
    assert [word for word in words if word not in err] == [], err
    assert err.startswith("flighttune: ")
    assert err.count("\n") == 1
    assert len(err) < 700
    assert written(here) == there
