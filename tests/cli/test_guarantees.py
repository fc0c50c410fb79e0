"""Certificates, frontiers and diagnoses from the command line."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import answer, flighttune

from flighttune import load_scenario
from flighttune.control.gains import PIGains
from flighttune.files.shipped import scenario_files
from flighttune.reports.tables import certificates_table

PAPER_RADIUS = 0.0333
"""Invariant ellipsoid of K* under L_d = 0.015, to the digits given."""


@pytest.fixture(scope="module")
def certificate(tmp_path_factory):
    path = tmp_path_factory.mktemp("certificate") / "paper.json"
    return answer("certify", "paper_as_printed", "--out", path), path


def test_certify_writes_a_certificate_that_verify_proves(certificate):
    found, path = certificate

    verified = answer("verify", path)

    assert found["certificate"]["status"] == "certified"
    assert found["certificate"]["rate"] == pytest.approx(found["R_K"], rel=1e-6)
    assert found["certificate"]["radius"] == pytest.approx(PAPER_RADIUS, abs=5e-5)
    assert found["certificate"]["L_d"] == pytest.approx(0.015)
    assert verified["valid"]
    assert all(check["exact"] for check in verified["checks"])
    stored = json.loads(path.read_text())
    assert stored["scenario_sha256"] == load_scenario("paper_as_printed").sha256


def test_verify_shows_the_claim_and_the_gains_that_it_checked(certificate):
    stored = json.loads(certificate[1].read_text())

    claim = answer("verify", certificate[1])["claim"]
    text = " ".join(flighttune("verify", certificate[1])[0].split())

    assert claim["rate"] == stored["claim"]["rate"]
    assert claim["radius"] == stored["claim"]["radius"]
    assert claim["L_d"] == 0.015
    assert claim["gains"] == {
        "inputs": ["phi", "n_z"],
        "errors": ["chi", "gamma"],
        "K_P": [[1.6968, 0.5906], [-0.5906, 1.9556]],
        "K_I": [[3.4869, 0.1784], [-0.1784, 3.4869]],
    }
    assert claim["model"]["A"] == stored["model"]["A"]
    assert f"{stored['claim']['rate']:.6g}" in text
    assert "for the linear model (states chi, gamma)" in text
    assert "phi [rad] 1.6968 0.5906 3.4869 0.1784" in text


@pytest.mark.slow
def test_a_radius_over_the_envelope_is_larger_and_verify_shows_where_it_holds(
    certificate, tmp_path
):
    path = tmp_path / "c.json"
    over = answer("certify", "paper_as_printed", "--envelope", "--out", path)["certificate"]

    assert over["status"] == "certified"
    assert over["radius"] > certificate[0]["certificate"]["radius"]
    assert all(check["exact"] is True for check in over["checks"])
    assert answer("verify", path)["claim"]["envelope"]["V_a"] == [22.0, 28.0]
    assert (
        "over the envelope V_a 22..28 m/s, gamma -15..45 deg, phi -20..20 deg, n_z 0.8..1.3"
        in " ".join(flighttune("verify", path)[0].split())
    )


def test_where_certified_is_printed_it_says_what_that_is_worth(tmp_path):
    gains, proof = tmp_path / "weak.json", tmp_path / "proof.json"
    gains.write_text('{"K_P": [[1.5, 0.0], [0.0, 1.9]], "K_I": [[2e-5, 0.0], [0.0, 2e-5]]}')
    words = "certified, but the proven rate halves errors in 56 hours"

    printed, _ = flighttune("certify", "paper", "--gains", gains, "--out", proof)

    assert words in " ".join(printed.split())
    assert words in flighttune("verify", proof)[0]
    weak = certificates_table(
        load_scenario("paper"),
        {
            "weak": PIGains(
                **json.loads(gains.read_text()), inputs=("phi", "n_z"), errors=("chi", "gamma")
            )
        },
    )
    assert weak.records[0]["status"].startswith(words)


CHANGES = {
    "rate": lambda tables: scale(tables["claim"], "rate", 1.02),
    "radius": lambda tables: scale(tables["claim"], "radius", 0.98),
    "K_P": lambda tables: scale(tables["gains"]["K_P"][0], 0, 0.9),
    "Q": lambda tables: scale(tables["Q"][0], 0, 0.9),
}


def scale(holder, key, factor):
    holder[key] *= factor


@pytest.mark.parametrize("digit", CHANGES)
def test_verify_refuses_a_changed_digit_and_names_the_inequality(certificate, tmp_path, digit):
    tables = json.loads(certificate[1].read_text())
    CHANGES[digit](tables)
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(tables))

    assert "claimed, not proven: for the linear model" in flighttune("verify", path, status=1)[0]
    out, err = flighttune("verify", path, "--json", status=1)

    found = json.loads(out)
    assert not found["valid"]
    assert any(not check["exact"] and check["margin"] < 0.0 for check in found["checks"])
    assert err.count("\n") == 1


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    text = scenario_files()["paper_identified"].read_text()
    path = tmp_path_factory.mktemp("identified") / "identified.toml"
    lines = [line for line in text.splitlines() if not line.startswith(("model ", "I_star"))]
    path.write_text("\n".join(lines).replace("[tuning]", '[tuning]\nmodel = "identified"'))
    return path


@pytest.mark.slow
def test_a_certificate_over_every_condition_identified(identified, tmp_path):
    out = tmp_path / "c.json"

    found = answer(
        "certify", identified, "--gains", "tuned_identified", "--envelope", "--out", out
    )  # fmt: skip

    assert found["certificate"]["status"] == "certified"
    assert len(found["certificate"]["conditions"]) == 12
    assert found["envelope"] == {"R_K": found["certificate"]["rate"], "largest_factor": None}
    assert found["envelope"]["R_K"] < found["R_K"]
    assert answer("verify", out)["valid"]


@pytest.mark.slow
def test_tune_and_certify_say_their_units_of_state_and_agree_in_the_same_ones(identified):
    tuned, certified = answer("tune", identified), answer("certify", identified, "--gains", "tuned")

    assert set(certified["scaling"]) == {1.0} != set(tuned["scaling"])
    assert certified["scaled"]["scaling"] == tuned["scaling"]
    assert certified["scaled"]["R_K"] == pytest.approx(tuned["R_K"])
    assert answer("tune", "paper")["scaling"] == [1.0] * 4
    assert answer("certify", "paper")["scaled"] is None
    assert "units of state: scaled" in flighttune("tune", identified)[0]


def test_certify_shows_the_lag_at_which_the_printed_gains_lose_stability():
    margins = answer("certify", "paper")["margins"]

    assert margins[-1]["lag_margin_s"] == pytest.approx(0.360, abs=5e-4)


@pytest.mark.slow
def test_gains_tuned_over_the_envelope_decay_faster_there_than_those_printed():
    found = answer("tune", "paper", "--envelope")
    printed = answer("certify", "paper", "--envelope")["envelope"]

    assert 0.0 < printed["R_K"] < 0.5 * found["R_envelope"]
    assert found["status"] == "found"
    assert {"spectral_abscissa", "active", "starts", "margins"} <= found.keys()
    assert found["I_K"] <= 5.0 + 1e-6


@pytest.mark.slow
def test_an_infeasible_problem_is_diagnosed():
    why = answer("tune", "paper_printed_limits", status=1)["diagnosis"]

    assert why["smallest_I_K"] == pytest.approx(67.15, abs=0.005)
    assert 5.5 < why["common_factor"] < 6.0
    assert why["limits"][0]["name"] == "phi_rate"


@pytest.mark.slow
def test_the_frontier_is_written_as_table_and_figure(tmp_path):
    found = answer("frontier", "paper", "--points", "6", "--out", tmp_path)

    table = pd.read_csv(found["csv"])
    along = table[table["name"] == "frontier"]
    assert len(along) == len(found["points"]) == 6
    assert np.all(np.diff(along["R_K"]) >= 0.0)
    assert found["points"][0]["I_K"] == pytest.approx(4.8503, abs=5e-5)
    assert {"paper", "K1", "K6", "tuned"} <= found["marked"].keys()
    for name, mark in found["marked"].items():
        beyond = along[along["I_K"] >= mark["I_K"]]["R_K"]
        assert mark["R_K"] <= beyond.min() + 1e-9, name
    figure = Path(found["figure"]).read_text(encoding="utf-8")
    for name in found["marked"]:
        assert f">{name}</text>" in figure


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
