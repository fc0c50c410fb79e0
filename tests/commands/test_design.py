"""`design`, `identify` and `trim` as a user meets them."""

import json
import shutil

import pytest
from commands import flighttune
from places import SHIPPED_AIRCRAFT

pytestmark = pytest.mark.slow


@pytest.fixture
def jet(tmp_path):
    """A copy of the jet."""
    shutil.copytree(SHIPPED_AIRCRAFT / "a4", tmp_path / "a4")
    (tmp_path / "a4/step_responses.svg").unlink()
    return tmp_path / "a4"


def test_design_writes_gains_and_figure_whatever_the_gains_before(jet):
    file = jet / "gains.json"
    shipped = file.read_text()
    file.write_text(shipped.replace(": 1.668", ": 9.9"))
    assert file.read_text() != shipped

    found = json.loads(flighttune("design", jet, "--json")[0])

    assert found["written"] == str(file)
    assert all(step["met"] for step in found["steps"])
    assert file.read_text() == shipped
    assert (jet / "step_responses.svg").read_text(encoding="utf-8").count('class="chart"') == 4


def test_design_writes_nothing_where_asked_or_where_a_step_misses(jet):
    gains, file = jet / "gains.json", jet / "aircraft.toml"
    before = gains.read_text()
    file.write_text(file.read_text().replace("roll_t90_s     = 1.0", "roll_t90_s     = 0.5"))

    _, err = flighttune("design", jet, status=1)

    assert "nothing is written" in err
    assert f"flighttune: {jet}: phi +30 deg at 150 m/s: t90 must be at most 0.5 s" in err
    assert err.count("\n") == 1
    assert gains.read_text() == before
    assert not (jet / "step_responses.svg").exists()
