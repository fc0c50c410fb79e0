"""`design`, `identify` and `trim` as a user meets them."""

import json
import math
import shutil

import pytest
from commands import flighttune
from places import SHIPPED_AIRCRAFT

import flighttune as ft

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


def test_trim_answers_with_steady_flights_and_obstacles():
    found = json.loads(
        flighttune("trim", "aerosonde", "--V-a", 25, "--gamma", 0, "--gamma", -20, "--json")[0]
    )["trims"]

    lift = 11.0 * 9.80665 / (0.5 * 1.11164 * 25.0**2 * 0.55)
    alpha = math.radians(found[0]["trim"]["alpha_deg"])
    elevator = math.radians(found[0]["trim"]["elevator_deg"])
    assert 0.23 + 5.61 * alpha + 0.13 * elevator == pytest.approx(lift, rel=1e-2)
    drag = 0.043 + 0.0232 * lift**2 + 0.0135 * abs(elevator)
    thrust = 11.0 * 9.80665 * drag / lift / math.cos(alpha)
    assert found[0]["trim"]["throttle"] == pytest.approx(thrust / 120.0, rel=1e-2)
    assert found[1]["trim"] is None
    assert found[1]["reason"] == "the aircraft speeds up with the throttle closed"


@pytest.fixture(scope="module")
def aerosonde(tmp_path_factory):
    out = tmp_path_factory.mktemp("identified") / "aerosonde.json"
    printed, _ = flighttune("identify", "aerosonde", "--out", out, "--json")
    return json.loads(printed), out


@pytest.mark.soak
def test_the_model_file_can_be_tuned_on(aerosonde, tmp_path):
    found, out = aerosonde
    scenario = tmp_path / "mine.toml"
    scenario.write_text(
        'title = "mine"\n[flight]\nV_a_mps = 25.0\n[reference]\nchi_deg = 10.0\ngamma_deg = 0.0\n'
        f'[tuning]\nmodel = "identified"\nidentified = "{out}"\n[[plant]]\nkind = "kinematic"\n'
    )

    tuned = json.loads(flighttune("tune", scenario, "--json")[0])

    assert (
        ft.loop.load_identified(out).conditions[0].lags[0].order
        == found["channels"]["phi"]["order"]
    )
    assert tuned["status"] == "optimal"
    assert tuned["K_P"][0][1] == tuned["K_P"][1][0] == 0.0
    assert 2.0 < tuned["K_P"][0][0] < 5.0
