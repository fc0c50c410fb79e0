"""docs/own_law.md: what it says to copy flies."""

import re
from contextlib import chdir
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs/own_law.md").read_text(encoding="utf-8")


def example(number, folder):
    """Names in a block of Python of the page, which is run in a folder."""
    code = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[number]
    names = {}
    with chdir(folder):
        exec(compile(code, "own_law.md", "exec"), names)
    return names


@pytest.mark.slow
def test_the_first_example_flies_and_records(tmp_path):
    names = example(0, tmp_path)

    assert [run.label for run in names["flown"].runs] == [
        "kinematic / paper",
        "kinematic / mine:paper",
        "jsbsim:aerosonde / paper",
        "jsbsim:aerosonde / mine:paper",
    ]
    assert {run.status for run in names["flown"].runs} == {"completed"}
    assert list((tmp_path / "runs/mine").glob("*.rrd"))
