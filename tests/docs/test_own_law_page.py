"""docs/own_law.md: what it says to copy flies."""

import re
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs/own_law.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_first_example_flies_and_records(tmp_path, monkeypatch):
    (code, *_) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names = {}

    exec(compile(code, "own_law.md", "exec"), names)

    assert [run.label for run in names["flown"].runs] == [
        "kinematic / paper",
        "kinematic / mine:paper",
        "jsbsim:aerosonde / paper",
        "jsbsim:aerosonde / mine:paper",
    ]
    assert {run.status for run in names["flown"].runs} == {"completed"}
    assert list((tmp_path / "runs/mine").glob("*.rrd"))


@pytest.mark.slow
def test_the_example_of_an_agent_flies_and_records(tmp_path, monkeypatch):
    code = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[-1]
    monkeypatch.chdir(tmp_path)
    names = {}

    exec(compile(code, "own_law.md", "exec"), names)

    assert names["env"].flown.runs[0].status == "completed"
    assert list((tmp_path / "runs/agent").glob("*.rrd"))
