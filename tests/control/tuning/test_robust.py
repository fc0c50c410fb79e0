"""Tuning for several models: the worst one counts, and gains say what they are for."""

import numpy as np
import pytest

import flighttune as ft

pytestmark = pytest.mark.slow
EVERYWHERE = {"tuning.model": "identified", "tuning.robust": True}


@pytest.mark.parametrize(
    ("name", "tuning", "options", "speeds"),
    [
        # The Aerosonde is identified at 25, 20 and 30 m/s.
        pytest.param(*("paper_identified", EVERYWHERE, {}, [20.0, 30.0]), marks=pytest.mark.soak),
        ("paper_identified", {"tuning.model": "identified"}, {}, [25.0, 25.0]),
        ("paper", {}, {}, [25.0]),
    ],
)
def test_gains_say_the_airspeeds_that_they_are_tuned_for(name, tuning, options, speeds):
    made = ft.tune(name, changes=tuning, starts=1, **options)

    assert made.tuned_for["V_a_mps"] == speeds


@pytest.mark.soak
def test_gains_for_all_conditions_have_the_rate_of_the_worst_and_none_does_better():
    robust = ft.tune("mission", changes=EVERYWHERE, starts=1)
    nominal = ft.tune("mission", changes={"tuning.model": "identified"}, starts=1)
    units = robust.problem.scaling
    certificate = ft.certify("mission", robust.gains, envelope=True, changes=EVERYWHERE).certificate

    def worst(gains):
        loops = (ft.loop.closed_loop(model, gains) for model in certificate.models)
        return min(ft.loop.indicators(A, scaling=units).R_K for A in loops)

    assert len(certificate.models) == 12
    assert robust.R_K == pytest.approx(worst(robust.gains), rel=5e-3)
    assert robust.R_K >= 0.995 * worst(nominal.gains)
    assert robust.R_K <= nominal.R_K * (1.0 + 1e-9)


@pytest.fixture(scope="module")
def narrow():
    ranges = {"V_a_mps": [17, 33], "gamma_deg": [10, 20], "phi_deg": [-2, 2], "n_z": [0.95, 1.05]}
    changes = {f"envelope.{key}": value for key, value in ranges.items()}
    found = ft.tune("paper", changes=changes, envelope=True, starts=1)
    proven = ft.certify("paper", found.gains, envelope=True, changes=changes).certificate
    return changes, found, proven.claim.rate


@pytest.mark.soak
def test_gains_for_an_envelope_have_the_rate_that_a_certificate_proves_and_nearly_its_bound(narrow):
    _, found, proven = narrow

    assert (found.status, found.factor) == ("found", 1.0)
    assert proven == pytest.approx(found.R_envelope, rel=1e-5)
    assert found.R_envelope <= found.R_envelope_bound <= 1.0002 * found.R_envelope
    assert found.R_envelope <= found.R_K
    assert found.I_K <= found.problem.I_star
    assert found.tuned_for["V_a_mps"] == [17.0, 33.0]


def test_gains_for_an_envelope_are_better_there_than_those_for_its_trim(narrow):
    changes, found, proven = narrow
    trim = ft.tune("paper", starts=1)
    of_trim = ft.certify("paper", trim.gains, envelope=True, changes=changes).certificate

    assert proven > 1.001 * of_trim.claim.rate
    assert found.R_K <= trim.R_K * (1.0 + 1e-6)
    assert np.isfinite(found.gains.K).all()
