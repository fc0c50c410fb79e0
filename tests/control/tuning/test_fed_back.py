"""Gains with inner feedback: fastest decay and least errors in turbulence, under a bound."""

import math
from functools import cache

import numpy as np
import pytest
from fuzzing import slow
from made_up import made_up_scenario
from scipy.integrate import quad

import flighttune as ft
from flighttune.control.tuning import shaped
from flighttune.control.tuning.shaped import GustLoop

SAME, BETTER = 1e-6, 1e-2
FOUR_DIGITS = 2e-4
OMEGA = np.geomspace(1e-2, 1e3, 4000)


def scenario(law="exact", **tuning):
    tuning = {"model": "identified", "identified": "aerosonde", **tuning}
    flown = {"plant": [{"kind": "jsbsim", "aircraft": "aerosonde"}], "gains": ["tuned_identified"]}
    return made_up_scenario(law=[law], tuning=tuning, turbulence={"intensity": "light"}, **flown)


@cache
def tuned(objective, sensitivity_max=1.4, *, feedback=True):
    keys = {"objective": objective, "sensitivity_max": sensitivity_max, "feedback": feedback}
    return ft.tune(scenario(**keys), starts=3)


def lags():
    """The identified lags with half a sample, as the delay of a first-order Pade section."""
    found = ft.loop.load_identified("aerosonde").nearest(25.0, 0.0).lags
    for lag in found:
        h, s = lag.delay + 0.01, 1j * OMEGA
        w, z = lag.natural_frequency, lag.damping
        pade = (1.0 - s * h / 2.0) / (1.0 + s * h / 2.0)
        yield pade * w * w / (s * s + 2.0 * z * w * s + w * w) / (1.0 + s * lag.lag)


def sensitivity(G, K_P, K_I, k):
    s = 1j * OMEGA
    return np.abs(1.0 / (1.0 + G * (k + (1.0 + k) * (K_P + K_I / s) / s))).max()


def test_errors_in_gusts_are_the_integral_of_drydens_spectrum():
    K_P, K_I, k, w, a = 1.5, 0.8, 0.4, 6.0, 0.05
    names = {"states": ("chi", "chi_dot"), "inputs": ("chi_dot",), "errors": ("chi",)}
    model = ft.loop.LinearModel(A=[[0.0, -1.0], [0.0, -w]], B=[[0.0], [w]], C=[[1.0, 0.0]], **names)

    def spectrum(omega):
        s, x = 1j * omega, (omega / a) ** 2
        G = w / (s + w)
        loop = G * (k + (1.0 + k) * (K_P + K_I / s) / s)  # at the command
        return (1.0 + 3.0 * x) / (1.0 + x) ** 2 / (math.pi * a) * abs(1.0 / (1.0 + loop)) ** 2

    pieces = [(0.0, a), (a, 1.0), (1.0, 10.0), (10.0, np.inf)]
    by_hand = math.sqrt(sum(quad(spectrum, *ends, epsabs=1e-12)[0] for ends in pieces))

    problem = ft.loop.TuningProblem(model=model, objective="rms", gusts=np.array([a]))
    found = GustLoop(problem).errors(np.array([[K_P, K_I]]), np.array([k]))
    assert found == pytest.approx([by_hand], rel=SAME)


@pytest.mark.parametrize("q", [(1.0, 0.25), (0.25, 1.0)])
def test_the_largest_error_of_two_channels_is_that_of_the_worse(q):
    """Where ``e'' + p e' + q e = d'`` has real poles, its impulse response is above 0: 1 / q."""
    names = dict.fromkeys(("states", "inputs", "errors"), ("chi", "gamma"))
    model = ft.loop.LinearModel(A=np.zeros((2, 2)), B=-np.eye(2), C=np.eye(2), **names)
    K = np.hstack([2.5 * np.eye(2), np.diag(q)])

    found = GustLoop(ft.loop.TuningProblem(model=model)).largest_error(K, np.zeros(2))

    assert found == pytest.approx(4.0, rel=FOUR_DIGITS)


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
def test_the_feedback_makes_errors_smaller_and_the_decay_faster():
    with_it, without = tuned("rms"), tuned("rms", feedback=False)
    assert max(with_it.errors_in_gusts) < 0.92 * max(without.errors_in_gusts)
    assert without.gains.feedback == (0.0, 0.0)
    assert tuned("decay").spectral_abscissa < 1.3 * tuned("decay", feedback=False).spectral_abscissa


@pytest.mark.slow
def test_gains_in_turbulence_decay_at_half_the_rate_of_the_largest_R_K():
    in_turbulence, careful = tuned("rms"), ft.tune(scenario(), starts=3)
    rate, whole = (
        -np.linalg.eigvals(ft.loop.closed_loop(result.problem.model, result.gains)).real.max()
        for result in (in_turbulence, careful)
    )

    assert rate == pytest.approx(0.5 * whole, rel=1e-4)
    assert in_turbulence.agreeing == 2  # the searches from both starts


@pytest.mark.parametrize("lost", [[1.6], *slow([1.6, 2.0])])
@pytest.mark.slow
def test_a_search_that_loses_the_integral_is_left_out(monkeypatch, lost):
    """SciPy's search may fail at a bound; without an integral, errors stay for ever."""
    end, begun = shaped._Search.end, []

    def failing(self, z, room, **options):
        if z[0] == z[1]:  # a start: all gains have the same factor
            begun.append(z[0])
        kept = begun[-1] not in lost
        return end(self, z, room, **options) * np.array([1.0, kept, 1.0])

    monkeypatch.setattr(shaped._Search, "end", failing)
    most = 1.5 + 0.01 * len(lost)  # results are remembered
    result = ft.tune(scenario(objective="rms", sensitivity_max=most, feedback=True), starts=3)

    assert result.status == "optimal"
    assert result.spectral_abscissa < -0.1


@pytest.mark.soak
@pytest.mark.parametrize("objective", ["rms", "decay"])
def test_random_gains_around_the_answer_are_no_better(objective):
    result, rng = tuned(objective), np.random.default_rng(1)
    gains, problem = result.gains, result.problem
    for i, G in enumerate(lags()):
        best = np.array([gains.K_P[i, i], gains.K_I[i, i], gains.feedback[i]])
        for _ in range(400):
            K_P, K_I, k = best * rng.uniform(0.85, 1.15, 3)
            if sensitivity(G, K_P, K_I, k) > 1.4:
                continue
            K, fed = gains.K.copy(), list(gains.feedback)
            K[i, [i, 2 + i]], fed[i] = (K_P, K_I), k
            other = problem.gains(K, tuple(fed))
            decay = np.linalg.eigvals(ft.loop.closed_loop(problem.model, other)).real.max()
            if objective == "decay":
                assert decay > result.spectral_abscissa * (1.0 + 5.0 * BETTER)
            elif decay <= result.spectral_abscissa:
                value = GustLoop(problem).errors(K, np.array(fed))[i]
                assert value > result.errors_in_gusts[i] * (1.0 - BETTER)


@pytest.mark.slow
@pytest.mark.parametrize(("objective", "feedback"), [("rms", True), *slow(("E_K", False))])
def test_no_bound_leaves_less_phase_than_meet_requires(objective, feedback):
    result = tuned(objective, 2.5, feedback=feedback)
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
    ("rate", "most"), [pytest.param(0.5, 1.4, marks=pytest.mark.soak), (0.85, 1.45), (2.0, 1.5)]
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
