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
def test_certify_draws_the_margins_that_it_prints_and_the_rate_over_the_envelope(tmp_path):
    found = answer(
        "certify", "paper", "--gains", "paper", "--envelope", "--figure", tmp_path / "loop.svg"
    )

    figure = Path(found["figure"]).read_text(encoding="utf-8")
    for channel in found["margins"][:-1]:
        assert f"phase margin {channel['phase_margin_deg']:.1f}°" in figure
    for title in ("Nyquist", "Eigenvalues of the closed loop", "Rate certified over an envelope"):
        assert title in figure
