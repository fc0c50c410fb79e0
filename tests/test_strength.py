"""The tool that breaks lines on purpose breaks what it says, and tells who noticed."""

import os
import subprocess
import sys

import pytest
from places import ROOT
from strength.breaking import Finder

SOURCE = '''
def f(a: int = 1, b="ä") -> float:
    """1 < 2"""
    if a < 2 and b is not None:
        raise ValueError(a + 1)
    x: float = -a * 3.0
    return min(x, a + 0.0, f"{a + 1}" == "ä" or not b)

OUTSIDE = 1 + 2
'''
BROKEN = {
    *{"< -> <=", "and -> or", "2 -> 3", "is not -> is", "- -> ", "* -> /"},
    *{"3.0 -> 3.3000000000000003", "min -> max", "+ -> -", "0.0 -> 1.0", "or -> and", "== -> !="},
    "not  -> ",
}


def test_each_kind_of_change_is_made_in_functions_alone():
    found = Finder("f.py", SOURCE).found
    lines = SOURCE.splitlines()

    assert {str(x).partition(": ")[2] for x in found} == BROKEN
    for change in found:
        new = change.within(SOURCE).splitlines()
        assert [i for i, line in enumerate(lines) if new[i] != line] == [change.line - 1]
        compile("\n".join(new), "f.py", "exec")


CALL = """
import flighttune as ft

def test_rates():
    rates = ft.loop.indicators_batch([[[-1.0]], [[-3.0]], [[1.0]]]).R_K.tolist()
"""


@pytest.mark.soak
def test_lines_are_noticed_by_a_test_that_asks_and_put_back(tmp_path):
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "-q", ROOT, clone], check=True)
    environment = os.environ | {"PYTHONPATH": f"{clone / 'tests'}:{clone}"}

    def run(*command):
        return subprocess.run(
            command, cwd=clone, env=environment, capture_output=True, text=True, check=True
        ).stdout

    def killed(question):
        (clone / "tests/test_asked.py").write_text(CALL + question)
        strength = (sys.executable, "-m", "strength")
        run(*strength, "learn", "-p", "no:xdist", "tests/test_asked.py")
        rooms = "control/theory/indicators"
        score = run(*strength, "score", "--lines", "6", "--seed", "1", "--rooms", rooms)
        assert "of 6 broken lines" in score
        return score.count("killed")

    assert killed("    assert rates == [2.0, 6.0, 0.0]\n") > killed("")
    assert not run("git", "status", "--short", "flighttune")
