"""What sliders stand for: the flights of the scenario with the same values set by its keys."""

import json
import re
from html import unescape

import numpy as np
import pytest
from drawn import drawn

import flighttune as ft
from tests.outputs.live.test_server import ask

pytestmark = pytest.mark.slow

SCENARIOS = "level_turn", "exact_law"
DEG = 180.0 / np.pi


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Opens the page of a scenario, once each; all end together."""
    opened = {}

    def page(name):
        if name not in opened:
            opened[name] = ft.open(name, out=tmp_path_factory.mktemp("page"), browser=False)
        return opened[name]

    yield page
    for one in opened.values():
        one.close()


def sliders_of(page):
    """Attributes of the sliders of a page by their key, in their order, and choices."""
    _, _, text = ask(page)
    found = {}
    for tag in re.findall(r"<(?:input|select)\b[^>]*>", text.decode()):
        about = {k: unescape(v) for k, v in re.findall(r'([\w-]+)="([^"]*)"', tag)}
        if about.get("type") == "range":
            found[about["name"]] = {k: float(about[k]) for k in ("min", "max", "value")}
    return found


def pictured(page, values):
    """Charts of the answer to a move, and its words."""
    status, _, text = ask(page, "picture", {"values": values, "ghosts": {}})
    assert status == 200, text
    answer = json.loads(text)
    pieces = answer["pieces"]
    return drawn(pieces if isinstance(pieces, str) else "".join(map(str, pieces.values()))), answer


def courses(page, values):
    """Lines of course of a move, by run."""
    charts, _ = pictured(page, values)
    chart = next(x for x in charts if x.title.startswith("Course"))
    return {
        one.get("data-run"): chart.curve(one) for one in chart.paths if one.get("data-run")
    }, chart


def check_flies_as(page, values, scenario, gains):
    lines, chart = courses(page, values)
    (run,) = (x for x in ft.fly(scenario, gains).runs if x.label == next(iter(lines)))
    name = "chi" if "error" not in chart.title else "chi_err"
    x, y = lines[run.label]
    wanted = np.interp(x, run.t, DEG * np.unwrap(run.signals[name].to_numpy()))
    assert y == pytest.approx(wanted, abs=0.02 * max(1.0, np.ptp(wanted)))


@pytest.mark.soak
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_page_begins_with_the_flights_of_its_scenario(pages, name):
    page = pages(name)
    every = sliders_of(page)
    scenario = ft.load_scenario(name)

    check_flies_as(page, {}, scenario, scenario.gain_names[0])
    check_flies_as(
        page, {k: x["value"] for k, x in every.items()}, scenario, scenario.gain_names[0]
    )
    for key, one in every.items():
        assert one["min"] <= one["value"] <= one["max"], key
        if match := re.fullmatch(r"gains\[0\]\.K_[PI]\[(\d)\]\[(\d)\]", key):
            # a gain of a channel goes from zero, one across channels to both sides
            if match[1] == match[2]:
                assert (one["min"], one["max"]) == pytest.approx(
                    (0.0, 3.0 * one["value"]), rel=0.01
                )
            else:
                assert one["min"] == pytest.approx(-one["max"])
        if "feedback" in key:
            assert (one["min"], one["max"]) == (0.0, 0.95)
    gains = [key.startswith("gains") for key in every]
    assert gains == sorted(gains, reverse=True)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("key", "value", "changes"),
    [
        ("flight.V_a_mps", 27.0, {"flight.V_a_mps": 27.0}),
        ("limits.phi_deg[1]", 20.0, {"limits.phi_deg": [-20.0, 20.0]}),
        ("limits.n_z[1]", 1.2, {"limits.n_z": [-2.1, 1.2]}),
        ("limits.phi_rate_dps", 8.0, {"limits.phi_rate_dps": 8.0}),
        ("wind.speed_mps", 4.0, {"wind.speed_mps": 4.0, "wind.from_deg": 270.0}),
        ("turbulence.intensity", "light", {"turbulence.intensity": "light"}),
        ("plant.airframe.mass_factor", 1.1, {"plant.airframe.mass_factor": 1.1}),
        ("reference.gamma_deg", 3.0, {"reference.gamma_deg": 3.0}),
    ],
)
def test_a_slider_flies_as_the_key_of_the_scenario(pages, key, value, changes):
    wanted = ft.load_scenario("level_turn", changes=changes)

    check_flies_as(pages("level_turn"), {key: value}, wanted, wanted.gain_names[0])


def test_a_gain_that_is_moved_flies_as_the_same_gain_of_a_file(pages, tmp_path):
    K_P = ft.PAPER_GAINS.K_P.copy()
    K_P[0, 0] = 1.1
    own = ft.PIGains(K_P=K_P, K_I=ft.PAPER_GAINS.K_I)
    page = pages("level_turn")
    lines, chart = courses(page, {"gains[0].K_P[0][0]": 1.1})
    own.save(tmp_path / "mine.json")
    runs = ft.fly("level_turn", str(tmp_path / "mine.json")).runs
    (label, (x, y)) = next(iter(lines.items()))
    (run,) = (x for x in runs if x.provenance.plant == label.split(" / ")[0])

    wanted = np.interp(x, run.t, DEG * np.unwrap(run.signals["chi"].to_numpy()))
    assert y == pytest.approx(wanted, abs=0.02 * max(1.0, np.ptp(wanted))), chart.title


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"flight.V_a_mps": "25"}, "`V_a_mps` must be a valid number"),
        ({"flight.V_a_mps": 1e9}, "less than or equal to 1000"),
        ({"limits.phi_deg[1]": "30"}, "`phi_deg` must be"),
        ({"turbulence.intensity": "mighty"}, "'light', 'moderate' or 'severe'"),
        ({"plant[0].module": "law.py"}, "must be a slider of the page"),
    ],
)
def test_a_value_that_no_slider_has_is_refused(pages, values, words):
    status, _, text = ask(pages("level_turn"), "picture", {"values": values, "ghosts": {}})

    assert (
        words in unescape(json.loads(text).get("failed", text.decode())) or words in text.decode()
    )
    assert status in (200, 400, 422)
