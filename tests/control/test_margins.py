"""Margins of loops known in closed form, and of those that cross 1 or the real axis repeatedly."""

import math
from dataclasses import replace

import numpy as np
import pytest
from printed import MODEL, lagged

import flighttune as ft

ROUNDING = 1e-9
OF_GRID = 2e-3
ONE = {"inputs": ("u",), "errors": ("e",)}


def margins_of(model, gains):
    """Rows of every input by itself and of all together, as an answer states them."""
    (table,) = (x for x in ft.certify(model, gains).answer().tables if x.name == "margins")
    return table.records


def resonant(seed):
    """A stable loop of a lag and two resonances, which crosses 1 or the real axis several times."""
    rng, A = np.random.default_rng(seed), np.zeros((5, 5))
    A[0, 0] = -rng.uniform(-0.3, 1.0)
    for i in (1, 3):
        w = 10.0 ** rng.uniform(-0.5, 1.0)
        A[i : i + 2, i : i + 2] = [[0.0, w], [-w, -2.0 * rng.uniform(-0.02, 0.1) * w]]
    B, C = rng.normal(size=(5, 1)), 2.0 * rng.normal(size=(1, 5))
    K_P, K_I = -np.abs(rng.normal(size=2)) * [1.0, 0.3]
    model = ft.loop.LinearModel(A=A, B=B, C=C, states=tuple("abcde"), **ONE)
    return model, ft.PIGains(K_P=[[K_P]], K_I=[[K_I]], **ONE)


@pytest.mark.parametrize("seed", [3878, 4346, 23397, 24838])
def test_margins_are_those_of_the_worst_of_several_crossings(seed):
    model, gains = resonant(seed)
    omega = np.geomspace(1e-3, 1e3, 1_000_001)
    rates, modes = np.linalg.eig(model.A)
    residues = (model.C @ modes)[0] * np.linalg.solve(modes, model.B)[:, 0]
    G = sum(residue / (1j * omega - rate) for residue, rate in zip(residues, rates, strict=True))
    L = -(gains.K_P[0, 0] + gains.K_I[0, 0] / (1j * omega)) * G
    on_circle = np.flatnonzero(np.diff(np.abs(L) > 1.0))
    lags = (np.pi + np.angle(L[on_circle])) % (2.0 * np.pi)
    factors = 1.0 / np.abs(L[np.flatnonzero(np.diff(L.imag > 0.0) & (L.real[:-1] < 0.0))])

    alone, together = margins_of(model, gains)

    assert max(len(on_circle), len(factors)) > 1
    assert math.radians(alone["phase_margin_deg"]) == pytest.approx(lags.min(), rel=OF_GRID)
    assert alone["delay_margin_s"] == pytest.approx((lags / omega[on_circle]).min(), rel=OF_GRID)
    assert together["delay_margin_s"] == pytest.approx(alone["delay_margin_s"], rel=ROUNDING)
    assert alone["gain_increase"] == pytest.approx(
        min(factors[factors > 1.0], default=np.inf), rel=OF_GRID
    )
    assert alone["gain_decrease"] == pytest.approx(
        max(factors[factors < 1.0], default=0.0), rel=OF_GRID
    )


def test_a_loop_that_is_real_and_positive_has_no_margin_of_gain_there():
    # L = K (s^2 + 0.4 s + 1) / (s (s + 1) (s + 20) (s + 30)) is positive twice from 1 rad/s on, and
    # its phase reaches -180 deg at infinity alone. By Routh it is stable for every K > 0.
    poles = np.poly([-1.0, -20.0, -30.0])
    model = ft.loop.LinearModel(
        A=np.vstack([-poles[1:], np.eye(3)[:2]]),
        B=[[1.0], [0.0], [0.0]],
        C=[[-1.0, -0.4, -1.0]],
        states=("a", "b", "c"),
        **ONE,
    )
    gains = ft.PIGains(K_P=[[0.0]], K_I=[[500.0]], **ONE)
    s = 1j * np.geomspace(0.5, 20.0, 1001)
    L = 500.0 * (s**2 + 0.4 * s + 1.0) / (s * np.polyval(poles, s))
    assert np.count_nonzero(np.diff(L.imag > 0.0) & (L.real[:-1] > 0.0)) == 2

    alone, _ = margins_of(model, gains)

    assert (alone["gain_decrease"], alone["gain_increase"]) == (0.0, np.inf)


def test_every_change_inside_the_disk_margin_is_survived():
    model = lagged()
    *channels, together = margins_of(model, ft.PAPER_GAINS)

    for exponents in np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2)):
        changed = replace(model, B=model.B * together["gain_increase"] ** exponents)
        assert np.linalg.eigvals(ft.loop.closed_loop(changed, ft.PAPER_GAINS)).real.max() < 0.0
    assert together["phase_margin_deg"] <= min(x["phase_margin_deg"] for x in channels)
    assert 0.0 < together["disk_margin"] < 2.0


@pytest.mark.parametrize("K_I", [0.01, 1e-6])
def test_the_disk_margin_of_an_integrator_nearly_reaches_its_bound(K_I):
    # L = (s + K_I)/s^2, so that |S - T| is largest at omega = sqrt(K_I): sqrt(1 + 4 K_I). At
    # infinity it is 1, and no loop has a disk margin above 2.
    integrator = ft.loop.LinearModel(A=[[0.0]], B=[[1.0]], C=[[-1.0]], states=("x",), **ONE)

    *_, together = margins_of(integrator, ft.PIGains(K_P=[[1.0]], K_I=[[K_I]], **ONE))

    expected = 2.0 / np.sqrt(1.0 + 4.0 * K_I)
    assert together["disk_margin"] == pytest.approx(expected, rel=1e-6)


def decoupled(damping, proportional, integral):
    """Two loops ``s (s + damping) + proportional s + integral``, each on its own."""
    model = replace(MODEL, A=-damping * np.eye(2), B=-np.eye(2))
    return model, ft.PIGains(K_P=proportional * np.eye(2), K_I=integral * np.eye(2))


@pytest.mark.parametrize(
    ("loop", "lag"),
    # By Routh a lag T keeps it stable where (damping + proportional) (1 + damping T) > T integral;
    # lags below 0.1 ms are not told apart.
    [
        ((2.0, 1.0, 5.0), math.inf),
        ((2.0, 1.0, 7.0), 3.0),
        ((0.5, 1.5, 900.5), 1.0 / 449.75),
        ((0.0, 1.0, 2e4), 1e-4),
    ],
)
def test_a_lag_that_no_loop_minds_is_endless_and_one_that_is_felt_is_that_of_routh(loop, lag):
    *_, together = margins_of(*decoupled(*loop))

    assert together["lag_margin_s"] == pytest.approx(lag, rel=1e-6)
