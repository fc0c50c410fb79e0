"""Certificates, frontiers and units of state as commands and their verbs give them."""

import json
from pathlib import Path

import pytest
from commands import answer, flighttune

import flighttune as ft


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    path = tmp_path_factory.mktemp("certificate") / "paper.json"
    answer("certify", "paper_as_printed", "--out", path)
    return path


def test_verify_shows_the_claim_and_the_gains_that_it_checked(certificate):
    stored = json.loads(certificate.read_text())

    claim = answer("verify", certificate)["claim"]
    text = " ".join(flighttune("verify", certificate)[0].split())

    assert stored["scenario_sha256"] == ft.load_scenario("paper_as_printed").sha256
    assert {key: claim[key] for key in ("rate", "radius", "L_d")} == {
        key: stored["claim"][key] for key in ("rate", "radius", "L_d")
    }
    assert claim["gains"]["K_P"] == ft.PAPER_GAINS.K_P.tolist()
    assert claim["model"]["A"] == stored["model"]["A"]
    assert f"{stored['claim']['rate']:.6g}" in text
    assert "for the linear model (states chi, gamma)" in text
    assert "phi [rad] 1.6968 0.5906 3.4869 0.1784" in text


def test_verify_refuses_a_changed_digit_and_names_the_inequality(certificate, tmp_path):
    tables = json.loads(certificate.read_text())
    tables["claim"]["rate"] *= 1.02
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(tables))

    assert "claimed, not proven: for the linear model" in flighttune("verify", path, status=1)[0]
    out, err = flighttune("verify", path, "--json", status=1)

    found = json.loads(out)
    assert not found["valid"]
    assert found["reason"] in err
    assert err.count("\n") == 1


@pytest.mark.slow
def test_tune_and_certify_say_their_units_of_state_and_agree_in_the_same_ones():
    tables = ft.load_scenario("paper_identified").as_dict()
    tables["tuning"] = {"model": "identified", "identified": "aerosonde"}
    scenario = ft.scenario_from(tables)

    scaled = ft.tune(scenario)
    certified = ft.certify(scenario, "tuned").answer().values

    assert set(certified["scaling"]) == {1.0} != set(scaled.problem.scaling)
    assert list(certified["scaled"]["scaling"]) == list(scaled.problem.scaling)
    assert certified["scaled"]["R_K"] == pytest.approx(scaled.R_K)
    assert ft.certify("paper").answer().values["scaled"] is None
    assert scaled.answer().notes[0].startswith("units of state: scaled")
    assert ft.tune("paper").answer().notes == ["units of state: plain, as in `certify`"]


@pytest.mark.slow
def test_gains_tuned_over_the_envelope_decay_faster_there_than_those_printed():
    found = ft.tune("paper", envelope=True)
    printed = ft.certify("paper", envelope=True)

    assert 0.0 < printed.certificate.claim.rate < 0.5 * found.R_envelope
    assert found.status == "found"
    assert found.I_K <= 5.0 + 1e-6


@pytest.mark.slow
def test_certify_draws_the_margins_that_it_prints_and_the_rate_over_the_envelope(tmp_path):
    found = answer(
        "certify", "paper", "--gains", "paper", "--envelope", "--figure", tmp_path / "loop.svg"
    )

    figure = Path(found["figure"]).read_text(encoding="utf-8")
    for channel in found["margins"][:-1]:
        assert f"phase margin {channel['phase_margin_deg']:.1f}°" in figure
    for title in ("Nyquist", "Eigenvalues of the closed loop", "Rate certified over an envelope"):
        assert title in figure
