"""Claims around runs: which runs they cover, and what a run keeps of them."""

import hashlib
import html
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from commands import answer, flighttune
from made_up import run_file, scenario_file
from made_up_tubes import EXACT_PAPER, tube, tube_scenario

import flighttune as ft

START_DEG, DISTURBANCE = 1.0, 0.004
CLAIMS = Path(__file__).parents[1] / "files_of_0_3_0"


def turn(**changes):
    scenario = tube_scenario(chi_err_deg=20.0, gamma_deg=0.0, duration_s=0.5)
    return ft.scenario_from(scenario.as_dict() | {"gains": ["paper"], "expect": []} | changes)


@pytest.fixture(scope="module")
def proven():
    around = {"start": np.radians(START_DEG), "disturbance": DISTURBANCE}
    return tube(turn(), ft.PAPER_GAINS, for_ever=False, **around)


def flown(**changes):
    return ft.fly(turn(**changes))


def start(**angles):
    return {"flight": {**turn().as_dict()["flight"], **angles}}


def swing(amplitude):
    return {"disturbance": {"chi_amplitude": amplitude, "chi_omega_rad_s": 3.0}}


def test_a_run_keeps_the_tube_that_covers_it_and_is_the_same_when_read_again(proven, tmp_path):
    (run,) = flown().within(proven).runs
    (claim,) = run.claims

    assert (claim.kind, claim.title) == ("proven", "tube in calm air")
    assert claim.contains(run.signals)
    assert "chi_err" in run.signals
    assert not [name for name in run.signals if "low" in name or "high" in name]

    (again,) = ft.load(run_file(tmp_path / "run.parquet", run)).runs[0].claims
    assert again.sentence == claim.sentence == proven.sentence
    assert again.bounds.names == ("chi_err", "gamma_err")
    assert np.array_equal(again.bounds.pairs, claim.bounds.pairs)


def test_a_tube_says_of_which_runs_it_is_none(proven):
    (run,) = flown().runs
    soft = replace(run.provenance, gains=ft.PIGains(K_P=0.5 * np.eye(2), K_I=0.1 * np.eye(2)))
    exact = replace(run, provenance=replace(run.provenance, gains=EXACT_PAPER))
    lost = replace(proven, status="unbounded", reason="roll is lost")
    other_files = replace(proven, files={"aerosonde": "0" * 64})
    ended = replace(run, signals=run.signals[:1], status="no_trim", reason="none")

    assert proven.why_not(run) == ""
    assert lost.why_not(run) == "the set is not bounded: roll is lost"
    assert "files of aerosonde must be those" in other_files.why_not(run)
    assert proven.why_not(ended).startswith("it did not fly: ")
    assert proven.why_not(exact) == "its law must be paper, got exact"
    assert proven.why_not(replace(run, provenance=replace(run.provenance, gains=None)))
    assert proven.why_not(replace(run, provenance=soft)).startswith("its gains must be those")


@pytest.mark.parametrize(
    "changes", [start(chi_deg=20.0 - START_DEG), swing(0.9 * DISTURBANCE)], ids=["start", "air"]
)
def test_flights_from_starts_and_under_disturbances_enclosed_are_covered_and_inside(
    proven, changes
):
    (run,) = flown(**changes).within(proven).runs

    assert run.claims[0].contains(run.signals)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        (start(chi_deg=20.0 + 1.01 * START_DEG), r"`flight\.chi_deg` must be"),
        (start(V_a_mps=26.0), r"`flight\.V_a_mps` must be 25"),
        (swing(1.1 * DISTURBANCE), r"`disturbance\.chi_amplitude` must be"),
        ({"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, r"`wind\."),
        ({"disturbance": {**swing(0.001)["disturbance"], "as_wind": True}}, "as_wind` must be"),
        ({"reference": {"chi_deg": 1.0, "gamma_deg": 15.0}}, "its reference must be"),
        ({"gains": ["K5"]}, "its gains must be"),
        ({"plant": [{"kind": "point_mass"}]}, "its plant must be kinematic"),
        ({"limits": {"phi_deg": [-30.0, 30.0]}}, r"`limits\."),
    ],
)
def test_a_run_that_the_tube_does_not_enclose_is_refused_with_the_reason(proven, changes, why):
    with pytest.raises(ft.InputError, match=rf"`claim` must cover a run: .*{why}"):
        flown(**changes).within(proven)


def test_the_bounds_that_a_tube_states_in_words_are_not_below_those_proven(proven):
    widest = np.rad2deg(proven.bounds.half_widths[:, :2].max(axis=0))

    stated = [float(words.split()[0]) for words in proven.sentence.split(" within ")[-2:]]

    assert all(stated >= widest)
    assert all(stated <= 1.1 * widest)


@pytest.mark.soak
def test_commands_draw_a_claim_by_its_content_whatever_the_name_of_its_file(proven, tmp_path):
    scenario, file = tmp_path / "turn.toml", tmp_path / "a_claim"
    scenario_file(scenario, turn())
    proven.save(tmp_path / "t.npz")
    (tmp_path / "t.npz").rename(file)

    found = answer("fly", scenario, "--claim", file, "--out", tmp_path / "runs")

    (claim,) = found["claims"]
    assert (claim["kind"], claim["inside"]) == ("proven", True)
    assert ft.load(file).sentence == claim["sentence"]
    assert answer("verify", tmp_path / "runs")["equal"]
    page = answer("report", tmp_path / "runs", "--out", tmp_path / "r.html")["report"]
    assert claim["sentence"] in html.unescape(Path(page).read_text(encoding="utf-8"))
    assert answer("report", file, "--out", tmp_path / "t.html")["status"] == "bounded"


@pytest.mark.slow
def test_a_flight_that_leaves_its_tube_is_a_failure(proven, tmp_path):
    scenario, file = tmp_path / "turn.toml", tmp_path / "t.npz"
    scenario_file(scenario, turn(**swing(0.9 * DISTURBANCE)))
    narrow = replace(proven.bounds, low=0.99 * proven.bounds.low, high=0.5 * proven.bounds.high)
    replace(proven, bounds=replace(narrow, low=np.minimum(narrow.low, narrow.high))).save(file)

    _, told = flighttune("fly", scenario, "--claim", file, "--out", tmp_path / "runs", status=1)

    assert "kinematic / paper: the flight leaves its tube in calm air" in told


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return ft.record(flown(), tmp_path_factory.mktemp("recording"), name="turn")


def test_a_file_that_is_no_claim_is_refused_in_one_true_line(recording, tmp_path):
    (tmp_path / "notes.txt").write_text("a note")
    _, line = flighttune("verify", tmp_path / "notes.txt", status=2)
    assert "must be a claim (certificate, bound on R_K, tube, band or monitor)" in line
    assert "got another file, or a damaged one" in line
    assert line.count("\n") == 1
    _, line = flighttune("verify", tmp_path / "none.npz", status=2)
    assert line == f"flighttune: {tmp_path / 'none.npz'}: there is no such file.\n"
    _, line = flighttune("report", recording.recording, "--claim", recording.recording, status=2)
    assert "must be a claim about flights" in line
    assert "got a recording, which `flighttune view`" in line


def test_a_claim_about_gains_is_drawn_around_no_flight():
    with pytest.raises(ft.InputError, match="must bound flights"):
        flown().within(ft.load(CLAIMS / "certificate.json"))


@pytest.mark.slow
def test_every_claim_about_gains_has_a_page_with_its_sentence_and_hash(tmp_path):
    for kind in ("certificate", "bound"):
        file, page = tmp_path / kind, tmp_path / f"{kind}.html"
        shutil.copy(CLAIMS / f"{kind}.json", file)

        printed = answer("report", file, "--out", page)

        text = html.unescape(page.read_text(encoding="utf-8"))
        sentence = ft.load(file).sentence
        assert printed["verdict"] == sentence
        assert sentence[1:] in text
        assert hashlib.sha256(file.read_bytes()).hexdigest() in text
