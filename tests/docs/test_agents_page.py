"""docs/agents.md: what it says to copy flies."""

import re
from contextlib import chdir
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[2] / "docs/agents.md").read_text(encoding="utf-8")


def example(number, folder):
    """Names in a block of Python of the page, which is run in a folder."""
    code = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)[number]
    names = {}
    with chdir(folder):
        exec(compile(code, "agents.md", "exec"), names)
    return names


@pytest.mark.soak
def test_the_example_of_one_flight_flies_and_records(tmp_path):
    names = example(0, tmp_path)

    assert names["env"].flown.runs[0].status == "completed"
    assert list((tmp_path / "runs/agent").glob("*.rrd"))


@pytest.mark.slow
def test_the_example_of_many_flights_flies(tmp_path):
    names = example(1, tmp_path)

    assert names["obs"].shape == (256, 10)
    assert not names["terminated"].any()
    assert names["envs"].unwrapped.state["phi"].shape == (256,)
