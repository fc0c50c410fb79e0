"""A counted band around runs: recorded with its claim, on pages, and draw by draw."""

import html
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from commands import answer, flighttune
from dispersed import uniform
from flown_campaigns import write_campaign

import flighttune as ft

pytestmark = pytest.mark.slow

SINGLE = 1e-4
"""Relative: ends of windows are kept in single precision, rounded outwards."""

STARTS = [uniform("flight.chi_deg", -5.0, 5.0)]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A band of a turn on the law, five of 29 flights outside."""
    folder = tmp_path_factory.mktemp("band")
    campaign = write_campaign(folder, aircraft=(), wind="", disperse=STARTS)
    claim = "--epsilon", 0.3, "--confidence", 0.9, "--learn", 10
    out = folder / "band.npz"
    answer("band", campaign, *claim, "--gains", "soft", "--workers", 1, "--out", out)
    return out


def page_text(page):
    return html.unescape(Path(page).read_text(encoding="utf-8"))


@pytest.mark.soak
def test_a_draw_of_a_band_is_flown_with_the_band_around_it(file, tmp_path):
    band = ft.load(file)
    outside = band.about.learned + int(np.argmax(band.scores))

    for draw, inside in ((band.nearest, True), (outside, False)):
        found = answer("verify", file, "--run", draw, cwd=tmp_path)
        out = tmp_path / found["recording"]
        (run,) = ft.load(out).runs
        (claim,) = run.claims
        assert [claim["inside"] for claim in found["claims"]] == [inside]
        assert (claim.kind, claim.sentence) == ("counted", band.sentence)
        assert _stays(run) is inside
    assert answer("verify", out)["equal"]

    _, told = flighttune("verify", file, "--run", 39, status=2)
    assert "`run` must be 10 to 38, got 39" in told


@pytest.mark.soak
def test_a_page_of_a_recorded_run_states_the_claim_of_its_band_again(file, tmp_path):
    band = ft.load(file)
    flown = answer("verify", file, "--run", band.nearest, cwd=tmp_path)

    made = answer("report", tmp_path / flown["recording"], "--out", tmp_path / "r.html")

    page = page_text(made["report"])
    assert f"Counted band: {band.sentence}." in page.replace("</li><li>", " ")
    assert "in calm air; drawn at random: initial course -5 to 5 deg" in page
    assert page.count("counted band</button>") == 2  # a chart for each error
    assert any(band.sentence in note for note in made["notes"])


@pytest.mark.soak
def test_the_page_of_a_band_names_the_flight_nearest_to_leaving(file, tmp_path):
    band = ft.load(file)

    made = answer("report", file, "--out", tmp_path / "b.html")

    page = page_text(made["report"])
    assert f"flighttune verify {file} --run {band.nearest}" in page
    assert page.count(f"draw {band.nearest}, nearest to leaving</button>") == 2
    assert sha256(file.read_bytes()).hexdigest() in page
    assert "<td>initial course" in page or "initial course</t" in page
    assert page.count("24 inside</button>") == page.count(" 5 outside</button>") == 2


@pytest.mark.soak
def test_the_draw_nearest_to_the_edge_of_a_band_is_searched(file, tmp_path):
    toml = tmp_path / "worst.toml"

    found = answer("worst", file, "--budget", 32, "--workers", 1, "--out", toml)

    # soft gains do not follow to the end, which the requirements of the scenario ask for
    again = answer("fly", toml, "--claim", file, "--out", tmp_path, status=1)
    assert found["metric"] == "band"
    (run,) = ft.load(tmp_path).runs
    assert [claim["inside"] for claim in again["claims"]] == [_stays(run)]
    assert found["value"] == pytest.approx(_share(run), rel=SINGLE)
    _, told = flighttune("worst", file, "--metric", "chi.ITAE", status=2)
    assert "must be absent for a tube or band file" in told


def _errors(run):
    """Each error of a run with the ends of its band."""
    for name in ("chi_err", "gamma_err"):
        yield run.signals[name].to_numpy(), *run.claims[0].bounds.of([name]).pairs[:, 0].T


def _stays(run):
    """Whether no sample of a run is outside of its band."""
    return not any(((x < low) | (x > high)).any() for x, low, high in _errors(run))


def _share(run):
    """Largest distance from the middle of the band over its half-width at that sample."""
    return max((np.abs(2.0 * x - low - high) / (high - low)).max() for x, low, high in _errors(run))
