"""The largest envelope over which gains have a common Q, where it is known on paper."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.linear_model import Envelope
from flighttune.control.tuning import envelope as tuned_over

G = 9.81


def by_the_circle_criterion(_, over, g):
    """A loop of K_P = K_I = 1 at all speeds has a common Q: `sqrt(V_2) - sqrt(V_1) < sqrt(g)`.

    In level flight the course answers as ``b (K_P s + K_I) / s^2`` with ``b = g / V``.
    """
    low, high = np.sqrt(over.V_a)
    return SimpleNamespace(R=np.sqrt(g) - (high - low))


@pytest.mark.parametrize("counted", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_speeds_of_a_common_Q_are_those_of_the_circle_criterion(monkeypatch, counted):
    """25 m/s plus and minus x with ``sqrt(25 + x) - sqrt(25 - x) = sqrt(g)``."""
    if counted:
        monkeypatch.setattr(tuned_over, "envelope_rate", by_the_circle_criterion)
    gains = ft.PIGains(K_P=np.eye(2), K_I=np.diag([1.0, 0.1]))
    level = {"gamma": (0.0, 0.0), "phi": (0.0, 0.0), "n_z": (1.0, 1.0)}

    factor = tuned_over.largest_factor(
        gains, Envelope(V_a=(20.0, 30.0), **level), Envelope.at(V_a=25.0, gamma=0.0), g=G
    )

    largest = np.sqrt(25.0**2 - (25.0 - 0.5 * G) ** 2) / 5.0
    assert (1.0 - tuned_over.FACTOR_TOLERANCE) * largest < factor <= largest


GAMMA = np.pi / 12.0
AT = Envelope.at(V_a=25.0, gamma=GAMMA)
WEAK = ft.PIGains(K_P=np.diag([1.7, 0.5]), K_I=np.eye(2))
STEEPEST = np.pi / 6.0
"""The path angle at which ``gamma'' = g/V ((sin(gamma) - 0.5) gamma' - ...)`` is no longer damped.

Two loops of one K_I and different damping have a common Q wherever both are stable.
"""


def climbing(low, high):
    """Path angles of straight flight at 25 m/s."""
    return Envelope(V_a=(25.0, 25.0), gamma=(low, high), phi=(0.0, 0.0), n_z=(0.9, 1.0))


def within(factor):
    """Factors of an envelope, as near as bisection finds them."""
    return pytest.approx(factor, rel=2.0 * tuned_over.FACTOR_TOLERANCE)


@pytest.mark.parametrize(
    ("gains", "envelope", "factor"),
    [
        (WEAK, climbing(-0.2, 0.8), (STEEPEST - GAMMA) / (0.8 - GAMMA)),
        # no envelope is vertical, to either side
        (ft.PAPER_GAINS, climbing(-0.2, 0.8), (0.5 * np.pi - GAMMA) / (0.8 - GAMMA)),
        (ft.PAPER_GAINS, climbing(-0.8, 0.4), (0.5 * np.pi + GAMMA) / (0.8 + GAMMA)),
        (ft.PAPER_GAINS, climbing(GAMMA - 0.01, GAMMA + 0.01), 64.0),
        (ft.PIGains(K_P=-np.eye(2), K_I=np.eye(2)), climbing(-0.2, 0.8), 0.0),
    ],
)
def test_the_climbs_of_a_common_Q_are_those_that_are_damped(gains, envelope, factor):
    assert tuned_over.largest_factor(gains, envelope, AT, g=G) == within(factor)


def test_a_curve_of_rates_ends_where_no_common_Q_is_left_or_where_it_was_asked_to(monkeypatch):
    monkeypatch.setattr(tuned_over, "SAMPLES", 3)
    envelope, end = climbing(-0.2, 0.8), (STEEPEST - GAMMA) / (0.8 - GAMMA)

    factors, rates = tuned_over.rate_curve(WEAK, envelope, AT, g=G)
    assert factors == within(end * np.array([0.0, 0.4975, 0.995, 1.0]))
    assert (np.diff(rates) < 0.0).all()
    assert rates[-1] == 0.0

    factors, rates = tuned_over.rate_curve(WEAK, envelope, AT, g=G, up_to=0.4)
    assert factors == pytest.approx([0.0, 0.2, 0.4])
    at_trim = ft.loop.closed_loop(ft.loop.kinematic_model(V_a=25.0, gamma=GAMMA, g=G), WEAK)
    assert rates[0] == pytest.approx(ft.loop.indicators(at_trim).R_K, rel=1e-5)
    assert (rates > 0.0).all()


@pytest.mark.parametrize(
    ("gains", "high", "part"),
    [
        (WEAK, 0.8, 0.95 * (STEEPEST - GAMMA) / (0.8 - GAMMA)),
        (WEAK, 0.5, 1.0),
        (ft.PIGains(K_P=-np.eye(2), K_I=np.eye(2)), 0.8, None),
    ],
)
def test_a_search_begins_on_the_part_of_an_envelope_that_its_gains_have(
    monkeypatch, gains, high, part
):
    """A search of no steps ends where it begins."""
    monkeypatch.setattr(tuned_over, "ITERATIONS", 0)
    model = ft.loop.kinematic_model(V_a=25.0, gamma=GAMMA, g=G)
    problem = ft.loop.TuningProblem(model=model)

    reached = tuned_over._grow(problem, gains.K.ravel(), climbing(-0.2, high), AT, g=G)

    if part is None:
        assert reached is None
        return
    factor, best = reached
    assert factor == within(part)
    assert best.k.tolist() == gains.K.ravel().tolist()
    scaled = climbing(-0.2, high).scaled(AT, factor)
    assert best.common.R == pytest.approx(tuned_over.envelope_rate(gains, scaled, g=G).R)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"E_star": 3.0}, "`E_star` must be inf for a rate over an envelope, got 3"),
        ({"scaling": np.array([1.0, 1.0, 1.0, 2.0])}, "`scaling` must be all ones"),
    ],
)
def test_a_rate_over_an_envelope_has_no_bound_on_the_error_and_no_units(change, says):
    model = ft.loop.kinematic_model(V_a=25.0, gamma=GAMMA, g=G)
    with pytest.raises(ft.InputError, match=says):
        tuned_over.tune_over_envelope(
            ft.loop.TuningProblem(model=model, **change), climbing(-0.2, 0.8), AT, g=G
        )


@pytest.fixture(scope="module")
def weak():
    """A problem in which all gains but the integral one of the path angle are those of `WEAK`."""
    fixed = WEAK.K.copy()
    fixed[1, 3] = np.nan
    model = ft.loop.kinematic_model(V_a=25.0, gamma=GAMMA, g=G)
    return ft.loop.TuningProblem(model=model, K_fixed=fixed)


@pytest.mark.slow
@pytest.mark.parametrize(("high", "starts"), [(0.8, 0), (0.45, 1)])
def test_gains_for_an_envelope_reach_as_far_as_climbs_are_damped(monkeypatch, weak, high, starts):
    """A search of no steps ends at the better of its starts, one of them the gains of the trim."""
    monkeypatch.setattr(tuned_over, "ITERATIONS", 0)
    envelope, damped = climbing(-0.2, high), (STEEPEST - GAMMA) / (high - GAMMA)
    of_trim = ft.tune(weak).gains

    found = tuned_over.tune_over_envelope(weak, envelope, AT, g=G, starts=starts)

    assert (found.method, found.starts) == ("envelope", starts)
    at_trim = ft.loop.indicators(ft.loop.closed_loop(weak.model, found.gains))
    assert (found.R_K, found.I_K) == pytest.approx((at_trim.R_K, at_trim.I_K))
    rate = tuned_over.envelope_rate(found.gains, envelope, g=G).R
    assert rate >= tuned_over.envelope_rate(of_trim, envelope, g=G).R
    assert found.wall_s > 0.0
    if damped > 1.0:
        assert (found.status, found.reason, found.factor) == ("found", "", 1.0)
        assert found.R_envelope == pytest.approx(rate)
        assert 0.0 < found.R_envelope <= found.R_envelope_bound < at_trim.R_K
    else:
        assert found.status == "infeasible"
        assert found.factor == within(0.95 * damped)
        assert f"beyond {found.factor:.3g} of the envelope about the trim" in found.reason
        assert (found.R_envelope, found.R_envelope_bound) == (0.0, np.inf)
        assert rate == 0.0


def test_a_trim_without_gains_has_none_for_its_envelope_either(weak):
    """Of a path angle hardly damped no I_K is small."""
    bounded = replace(weak, I_star=10.0)

    found = tuned_over.tune_over_envelope(bounded, climbing(-0.2, 0.45), AT, g=G, starts=1)

    assert (found.status, found.gains, found.factor) == ("infeasible", None, 0.0)
    assert found.reason.startswith("`I_star` must be at least ")
    assert found.reason == ft.tune(bounded).reason
    assert (found.R_envelope, found.R_envelope_bound) == (0.0, np.inf)
