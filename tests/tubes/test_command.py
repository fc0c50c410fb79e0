"""`flighttune tube` and `verify` of its file, as a user meets them."""

import json
import re

import pytest
from made_up import scenario_file

from flighttune.present.answer import quoted
from tests.commands import flighttune
from tests.tubes.test_proof import claim_of, rewritten
from tests.tubes.test_soundness import made_up


@pytest.fixture
def scenario(tmp_path):
    def write(duration=0.6, **more):
        turn = made_up(chi_err_deg=20.0, gamma_deg=0.0, gamma_ref_deg=0.0, duration_s=duration)
        return scenario_file(tmp_path / "short.toml", turn, **more)

    return write


@pytest.mark.slow
def test_a_title_in_a_proof_is_quoted_and_cannot_move_the_cursor(scenario, tmp_path):
    proof = tmp_path / "proof.npz"
    flighttune("tube", scenario(), "--out", proof)
    title = "A turn of 90 deg\x1b[2J, of 10^9 flights none left"
    rewritten(proof, {}, scenario={**claim_of(proof)["scenario"], "title": title})

    stdout, _ = flighttune("verify", proof)

    assert "\x1b" not in stdout
    assert quoted(title) in " ".join(stdout.split())


@pytest.mark.slow
def test_a_set_that_cannot_be_bounded_is_an_answer_with_time_and_reason(scenario, tmp_path):
    # The disturbance alone turns the path upright in half a second.
    out = tmp_path / "proof.npz"
    arguments = scenario(), "--disturbance", "4", "--out", out

    stdout, stderr = flighttune("tube", *arguments, "--json", status=1)

    found = json.loads(stdout)
    assert found["status"] == "unbounded"
    assert re.search(r"from t = 0\.\d\d s on", found["reason"])
    # The start is 20 deg off: roll meets its rate limit of 30 deg/s at once.
    assert found["limits_can_hold"]["phi_cmd"][0][0] == 0.0
    assert found["reason"] in stderr
    assert not out.exists()


@pytest.mark.slow
def test_the_largest_disturbance_that_is_bounded_is_found_to_two_digits(scenario):
    stdout, _ = flighttune("tube", scenario(duration=0.1), "--disturbance", "largest", "--json")

    found = json.loads(stdout)
    tried = {row["disturbance"]: row["status"] for row in found["tried"]}
    largest = found["largest_disturbance"]
    assert tried[largest] == "bounded"
    lost = [size for size, status in tried.items() if status == "unbounded"]
    assert all(row["reason"] for row in found["tried"] if row["disturbance"] in lost)
    # No number of two digits is in between.
    assert largest < min(lost) <= float(f"{largest * 1.1:.1e}")


@pytest.mark.parametrize(
    ("arguments", "more", "what"),
    [
        (["--disturbance", "-1"], {}, "`disturbance` must be positive, got -1"),
        (["--disturbance", "most"], {}, "--disturbance: must be a number, got 'most'"),
        (["--plant", "jsbsim:x"], {}, "`plant` must be one of kinematic"),
        (
            ["--disturbance", "largest", "--out", "proof.npz"],
            {},
            "`disturbance` must be a number with",
        ),
        ([], {"wind": {"speed_mps": 3.0, "from_deg": 0.0}}, "`wind` must not"),
        (
            ["--plant", "jsbsim:aerosonde"],
            {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}]},
            "`start_deg` must be given",
        ),
        (
            ["--disturbance", "0.01"],
            {"disturbance": {"chi_amplitude": 0.1, "chi_omega_rad_s": 1.0}},
            "at least that of the scenario's",
        ),
    ],
)
def test_what_no_tube_is_known_for_is_refused_in_one_line(scenario, arguments, more, what):
    stdout, stderr = flighttune("tube", scenario(**more), *arguments, status=2)

    assert stdout == ""
    assert what in stderr
    assert stderr.count("\n") == 1
