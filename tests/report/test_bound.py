"""The guaranteed exponential against loops whose solution is known."""

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm

from flighttune.certificates import certify
from flighttune.control.closed_loop import closed_loop
from flighttune.control.gains import PAPER_GAINS
from flighttune.control.linear_model import kinematic_model
from flighttune.report.bound import bound_flown
from flighttune.report.facts import convergence
from flighttune.simulate.run import Provenance, Run

DIFFERENCES = 2e-3
"""Relative error of central differences of the errors at 100 Hz."""

DT = 0.01
MODEL = kinematic_model(V_a=25.0, gamma=np.deg2rad(15.0), g=9.81)


def made_up(errors, *, limited=0.0, moved=0.0, status="completed"):
    t = np.arange(len(errors)) * DT
    signals = pd.DataFrame(
        {
            "chi_err": errors[:, 0],
            "gamma_err": errors[:, 1],
            "phi_limited": np.where(t < limited, 2.0, 0.0),
            "n_z_limited": 0.0,
            "chi_ref": np.where(t < moved, 0.0, 0.5),
            "gamma_ref": 0.0,
        },
        index=pd.Index(t, name="t"),
    )
    made = Provenance(
        scenario={}, plant="kinematic", gains_name="paper", gains=PAPER_GAINS, seed=0, versions={},
        wall_s=0.0,
    )  # fmt: skip
    return Run(signals=signals, status=status, reason="", provenance=made)


@pytest.fixture(scope="module")
def certificate():
    return certify(MODEL, PAPER_GAINS).certificate


@pytest.fixture(scope="module")
def linear_flight():
    """``s(t) = exp(A_K t) s_0`` of the linear loop, shape (n, 4)."""
    step = expm(closed_loop(MODEL, PAPER_GAINS) * DT)
    s = [np.array([0.3, -0.2, -1.0, -0.5])]
    for _ in range(2000):
        s.append(step @ s[-1])
    return np.array(s)


def test_the_linear_loop_never_leaves_its_bound_and_the_norm_is_that_of_s(
    certificate, linear_flight
):
    found = bound_flown(made_up(linear_flight[:, 2:]), certificate)

    expected = np.linalg.norm(linear_flight, axis=1)
    assert found.norm[1:-1] == pytest.approx(expected[1:-1], rel=DIFFERENCES, abs=1e-6)
    assert found.t_broken is None
    assert found.t_free == 0.0


def test_the_bound_falls_at_half_the_certified_rate(certificate, linear_flight):
    found = bound_flown(made_up(linear_flight[:, 2:]), certificate)

    falls = np.diff(np.log(found.guaranteed)) / DT
    assert falls == pytest.approx(-0.5 * certificate.claim.rate, rel=1e-6)


def test_an_error_that_stops_falling_breaks_the_bound_where_they_meet(certificate):
    rate = certificate.claim.rate
    errors = np.full((2001, 2), 0.1)

    found = bound_flown(made_up(errors), certificate)

    s = np.array([0.0, 0.0, 0.1, 0.1])
    start = np.sqrt(s @ certificate.Q @ s / np.linalg.eigvalsh(certificate.Q)[0])
    meets = 2.0 / rate * np.log(start / np.linalg.norm(s))
    assert found.t_broken == pytest.approx(meets, abs=2.0 * DT)


def test_nothing_is_guaranteed_while_a_limit_holds_a_command(certificate, linear_flight):
    found = bound_flown(made_up(linear_flight[:, 2:], limited=3.0), certificate)

    assert found.t_free == pytest.approx(3.0, abs=2.0 * DT)
    assert np.isnan(found.guaranteed[found.t < found.t_free]).all()
    assert np.isfinite(found.guaranteed[found.t >= found.t_free]).all()


def test_the_bound_begins_anew_where_the_reference_moves(certificate, linear_flight):
    n = len(linear_flight)
    errors = np.vstack([linear_flight[: n // 2, 2:], linear_flight[:, 2:]])

    found = bound_flown(made_up(errors, moved=n // 2 * DT), certificate)

    assert found.t_broken is None
    jump = n // 2
    assert np.isnan(found.guaranteed[jump - 1 : jump + 1]).all()
    assert found.guaranteed[jump + 3] > 5.0 * found.guaranteed[jump - 4]


def test_where_limits_hold_to_the_end_nothing_is_guaranteed(certificate, linear_flight):
    found = bound_flown(made_up(linear_flight[:, 2:], limited=1e3), certificate)

    assert found.t_free is None
    assert found.t_broken is None


def test_under_a_disturbance_the_bound_does_not_go_below_the_certified_radius(linear_flight):
    certificate = certify(MODEL, PAPER_GAINS, L_d=0.015).certificate

    found = bound_flown(made_up(linear_flight[:, 2:]), certificate)

    assert found.guaranteed.min() == certificate.claim.radius


@pytest.mark.parametrize(
    ("first", "last", "status", "converged"),
    [
        (1.0, 0.04, "completed", True),
        (1.0, 0.06, "completed", False),
        (0.01, 0.008, "completed", True),
        (1.0, 0.04, "left_envelope", False),
    ],
)
def test_a_run_converged_if_the_last_quarter_is_within_5_percent_or_half_a_degree(
    first, last, status, converged
):
    errors = np.full((1001, 2), first)
    errors[700:] = last

    found = convergence(made_up(errors, status=status))

    assert found.converged is converged
    assert found.residual == pytest.approx((last, last))
