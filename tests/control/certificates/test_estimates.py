"""Peak gains from errors of the estimates: against flights, closed forms, and forged."""

import math
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import expm

import flighttune as ft

TAKEN_FOR_WHOLE = 1e-3  # relative: a flight of 40 s with an input held for 4 ms
CLOSED_FORM = 2e-6  # relative: what is left when the response is no longer followed
DT, SAMPLES = 0.004, 10_000


IDENTIFIED = {"tuning__model": "identified"}


@cache
def certified(scenario, name, **changes):
    changes = {key.replace("__", "."): value for key, value in changes.items()}
    return ft.certify(scenario, name, navigation="standard", changes=changes)


def exact(K_P, K_I, feedback=(0.0, 0.0)):
    gains = ft.PIGains.from_lists(np.diag(K_P), np.diag(K_I), law="exact", feedback=feedback)
    return ft.certify("mission", gains, navigation="standard")


def responses(certificate):
    """Error i at each sample for an impulse in the estimate of error j, shape (N, p, p)."""
    model, gains = certificate.model, certificate.gains
    n, m, p = model.shape
    feedback = np.zeros(m)
    feedback[: len(gains.feedback)] = gains.feedback
    feedback[[name not in model.states for name in model.inputs]] = 0.0
    states = np.vstack([-model.B @ np.diag(1.0 + feedback) @ gains.K_P, -np.eye(p)])
    over, found = expm(ft.loop.closed_loop(model, gains) * DT), []
    for _ in range(SAMPLES):
        found.append(model.C @ states[:n])
        states = over @ states
    return np.array(found)


@pytest.mark.parametrize(
    ("scenario", "name", "changes"),
    [
        ("paper", "paper", {"flight__V_a_mps": 40.0, "controller__rate_hz": 20.0}),
        pytest.param("mission", "exact:tuned_fed_back", IDENTIFIED, marks=pytest.mark.counts),
    ],
)
@pytest.mark.soak
def test_no_input_makes_a_larger_error_and_the_worst_one_attains_it(scenario, name, changes):
    """n(t) = sign h(T - t) is the worst input up to T."""
    certification = certified(scenario, name, **changes)
    certificate = certification.certificate
    attained = np.abs(responses(certificate)).sum(axis=0) * DT
    rows = certification.values["estimates"]

    assert attained == pytest.approx(certificate.peak_gains, rel=TAKEN_FOR_WHOLE, abs=1e-3)
    largest = 3.0 * np.array(certification.estimate_sd)
    if scenario == "paper":
        of_grade = ft.loop.Navigation.of("standard").path_sd(0.05, 40.0)
        assert certification.estimate_sd == pytest.approx(of_grade[:2])
        assert certification.navigation == "standard"
    assert [row["error"] for row in rows] == ["chi", "gamma"]
    assert [row["estimate_rad"] for row in rows] == pytest.approx(largest)
    assert [row["error_rad"] for row in rows] == pytest.approx(certificate.peak_gains @ largest)
    assert [row["peak_gain"] for row in rows] == pytest.approx(certificate.peak_gains.diagonal())
    words = re.findall(r"error of (\w+) of at most ([\d.]+) n", certificate.sentence)
    for (_, said), gain in zip(words, certificate.peak_gains.sum(axis=1), strict=True):
        assert gain <= float(said) < gain + 2e-3
    forged = certificate.peak_gains * [[1.0, 1.0], [1.0, 0.99]]
    refused = ft.verify(replace(certificate, peak_gains=forged))
    failed = [check.name for check in refused.checks if not check.exact]
    assert len(failed) == 1
    assert "peak gain from the estimation error of gamma to" in failed[0]


@pytest.mark.parametrize(("K_P", "K_I"), [((2.5, 1.0), (1.0, 0.2)), ((4.0, 3.0), (3.9, 1.1))])
def test_two_real_poles_by_their_residues(K_P, K_I):
    """(K_P s + K_I) / (s^2 + K_P s + K_I): h = r1 exp(p1 t) + r2 exp(p2 t) has one zero."""
    gains = exact(K_P, K_I).certificate.peak_gains
    for i in (0, 1):
        p1, p2 = np.sort(np.roots([1.0, K_P[i], K_I[i]]))
        r1, r2 = (K_P[i] * p1 + K_I[i]) / (p1 - p2), (K_P[i] * p2 + K_I[i]) / (p2 - p1)
        zero = math.log(-r2 / r1) / (p1 - p2)
        until = r1 / p1 * (math.exp(p1 * zero) - 1.0) + r2 / p2 * (math.exp(p2 * zero) - 1.0)
        # The whole integral is 1, the gain of a constant error.
        expected = abs(until) + abs(1.0 - until)
        assert expected <= gains[i, i] <= expected * (1.0 + CLOSED_FORM)
    assert np.fliplr(gains).diagonal() == pytest.approx(0.0, abs=1e-6)


@pytest.mark.counts
def test_the_answer_bounds_the_true_error_by_three_deviations_of_the_estimate():
    """0.0657 m/s across at 25 m/s is 0.15 deg, by the covariance recursion of the navigation."""
    certification = certified("mission", "exact:tuned_fed_back", tuning__model="identified")
    chi, _ = certification.answer().values["certificate"]["estimates"]

    assert np.rad2deg(chi["estimate_rad"]) == pytest.approx(3.0 * 0.1506, rel=0.01)
    # found by a simulation outside of the package, which held the commands for a sample
    assert certification.certificate.peak_gains.diagonal() == pytest.approx(
        [1.244, 1.26], rel=0.015
    )
