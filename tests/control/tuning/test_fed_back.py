"""Gains with inner feedback: fastest decay and least errors in turbulence, under a bound."""

from functools import cache

import numpy as np
import pytest
from fuzzing import slow
from made_up import made_up_scenario

import flighttune as ft

SAME, BETTER = 1e-6, 1e-2
OMEGA = np.geomspace(1e-2, 1e3, 4000)


def scenario(law="exact", **tuning):
    tuning = {"model": "identified", "identified": "aerosonde", **tuning}
    flown = {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}], "gains": ["tuned_identified"]}
    return made_up_scenario(law=[law], tuning=tuning, turbulence={"intensity": "light"}, **flown)


@cache
def tuned(objective, sensitivity_max=1.4, *, feedback=True):
    keys = {"objective": objective, "sensitivity_max": sensitivity_max, "feedback": feedback}
    return ft.tune(scenario(**keys), starts=3)


def lags(omega=OMEGA):
    """The identified lags with half a sample, as the delay of a first-order Pade section."""
    found = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags
    for lag in found:
        h, s = lag.delay + 0.01, 1j * omega
        w, z = lag.natural_frequency, lag.damping
        pade = (1.0 - s * h / 2.0) / (1.0 + s * h / 2.0)
        yield pade * w * w / (s * s + 2.0 * z * w * s + w * w) / (1.0 + s * lag.lag)


def sensitivity(G, K_P, K_I, k):
    s = 1j * OMEGA
    return np.abs(1.0 / (1.0 + G * (k + (1.0 + k) * (K_P + K_I / s) / s))).max()


@pytest.mark.slow
@pytest.mark.parametrize("objective", ["rms", *slow("decay")])
def test_the_largest_sensitivity_at_the_commands_is_at_most_the_bound_and_named(objective):
    result = tuned(objective)
    K_P, K_I = (np.diag(gain) for gain in (result.gains.K_P, result.gains.K_I))

    peaks = [*map(sensitivity, lags(), K_P, K_I, result.gains.feedback)]

    assert max(peaks) <= 1.4 * (1.0 + SAME)
    assert min(peaks) > 1.38
    assert result.sensitivity == pytest.approx(max(peaks), rel=1e-3)
    assert result.active == ("sensitivity",)
    assert any("its bound of 1.4 holds the gains" in note for note in result.answer().notes)


@pytest.mark.slow
def test_errors_in_gusts_are_those_of_the_spectrum_of_dryden():
    """``e = -d / (1 + L)`` but for what the feedback of d' adds, of ``(1 + 3 x) / (1 + x)^2``."""
    result, omega = tuned("rms"), np.geomspace(1e-5, 1e4, 100_000)
    for i, lag in enumerate(lags(omega)):
        s, K_P, K_I = 1j * omega, result.gains.K_P[i, i], result.gains.K_I[i, i]
        k, x = result.gains.feedback[i], (omega / result.problem.gusts[i]) ** 2
        a = (1.0 + k) * (K_P + K_I / s)
        error = lag / s * (a + k * s) / (1.0 + a * lag / s + k * lag) - 1.0
        density = (1.0 + 3.0 * x) / (1.0 + x) ** 2
        share = np.trapezoid(np.abs(error) ** 2 * density, omega) / np.trapezoid(density, omega)
        assert result.errors_in_gusts[i] == pytest.approx(np.sqrt(share), rel=1e-3)


@pytest.mark.slow
def test_the_feedback_makes_errors_smaller():
    with_it, without = tuned("rms"), tuned("rms", feedback=False)
    assert max(with_it.errors_in_gusts) < 0.92 * max(without.errors_in_gusts)
    assert without.gains.feedback == (0.0, 0.0)


@pytest.mark.slow
def test_gains_in_turbulence_decay_at_half_the_rate_of_the_largest_R_K():
    in_turbulence, careful = tuned("rms"), ft.tune(scenario(), starts=3)
    rate, whole = (
        -np.linalg.eigvals(ft.loop.closed_loop(result.problem.model, result.gains)).real.max()
        for result in (in_turbulence, careful)
    )

    assert rate == pytest.approx(0.5 * whole, rel=1e-4)
    assert in_turbulence.agreeing == 2  # the searches from both starts


@pytest.mark.slow
def test_no_bound_leaves_less_phase_than_meet_requires():
    result = tuned("rms", 2.5)
    margins = result.answer().tables[2].records[:2]

    assert min(row["phase_margin_deg"] for row in margins) >= 35.0
    assert min(row["gain_increase"] for row in margins) >= 10.0 ** (6.0 / 20.0)


def test_the_named_gains_are_those_of_the_exact_law_alone():
    fed = ft.load_scenario("mission", changes={"law": ["exact"], "gains": ["tuned_fed_back"]})
    run = ft.fly(fed.model_copy(update={"expect": []})).runs[0]
    gains = run.provenance.gains

    assert gains.inputs == ("chi_dot", "gamma_dot")
    assert min(gains.feedback) > 0.1
    with pytest.raises(ft.InputError, match=r"must be flown with law"):
        ft.fly(ft.load_scenario("mission", changes={"law": "paper"}))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "most"),
    [(0.85, 1.45), *(pytest.param(*x, marks=pytest.mark.counts) for x in ((0.5, 1.4), (2.0, 1.5)))],
)
def test_a_slow_load_factor_gets_gains_of_a_smaller_sensitivity(rate, most):
    """The aircraft's own rate is 1 per second: [limits] make it slower, not faster."""
    changes = {"limits": {"n_z_rate_per_s": rate}, "gains": ["tuned_fed_back"], "expect": []}
    gains = ft.fly("mission", changes=changes).runs[-1].provenance.gains
    peaks = map(sensitivity, lags(), *map(np.diag, (gains.K_P, gains.K_I)), gains.feedback)

    assert max(peaks) == pytest.approx(most, rel=1e-3)


def test_the_papers_law_has_no_feedback():
    with pytest.raises(ft.InputError, match=r"`feedback` .* must be false"):
        ft.tune(scenario("paper", objective="decay", feedback=True))
