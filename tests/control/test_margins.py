"""Margins against loops that are actually changed by as much, and against python-control's."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from printed import MARKED, MODEL, lagged

import flighttune as ft
from flighttune.control import margins
from flighttune.control.inner_loop import with_input_delay
from flighttune.flight.models import LARGEST_SENSITIVITY, SENSITIVITY

LAGGED, K6 = lagged(), MARKED["K6"]
BELOW, ABOVE = 0.99, 1.01
PADE_SECTIONS = 6
ROUNDING = 1e-9
OF_GRID = 2e-3

REFERENCE = json.loads(
    (Path(__file__).parents[1] / "reference" / "margins" / "margins.json").read_text("utf-8")
)["cases"]
"""Of python-control with SLICOT; made by make.py in the same folder."""


def abscissa(model, gains=ft.PAPER_GAINS):
    return np.linalg.eigvals(ft.loop.closed_loop(model, gains)).real.max()


def with_input_gains(model, factors):
    return replace(model, B=model.B * factors)


@pytest.mark.parametrize("gains", [ft.PAPER_GAINS, K6])
def test_a_lag_at_the_margin_puts_a_pair_on_the_imaginary_axis(gains):
    edge = 1.0 / margins.lag_margin(MODEL, gains)

    assert abscissa(lagged(edge, edge), gains) == pytest.approx(0.0, abs=ROUNDING)


def delayed_by(delay, model):
    """The model behind a delay of its inputs by `PADE_SECTIONS` sections in a row."""
    for _ in range(PADE_SECTIONS):
        model = with_input_delay(model, delay / PADE_SECTIONS)
    return model


@pytest.mark.parametrize(
    ("model", "gains"), [(MODEL, ft.PAPER_GAINS), (MODEL, K6), (LAGGED, ft.PAPER_GAINS)]
)
def test_a_delay_in_all_inputs_destabilises_at_the_margin(model, gains):
    delay = margins.delay_margin(model, gains)

    assert abscissa(delayed_by(BELOW * delay, model), gains) < 0.0
    assert abscissa(delayed_by(ABOVE * delay, model), gains) > 0.0


def stored_loop(case):
    A, B, C, K = (np.array(case[key]) for key in ("A", "B", "C", "K"))
    p = len(C)
    names = {kind: tuple(f"{kind[0]}{i}" for i in range(p)) for kind in ("inputs", "errors")}
    model = ft.loop.LinearModel(A=A, B=B, C=C, states=tuple(map(str, range(len(A)))), **names)
    return model, ft.PIGains(K_P=K[:, :p], K_I=K[:, p:], **names)


@pytest.mark.parametrize("name", REFERENCE)
def test_margins_are_those_of_python_control_with_slicot(name):
    expected = REFERENCE[name]

    model, gains = stored_loop(expected)
    *channels, together = margins.loop_margins(model, gains)

    assert tuple(channel.loop for channel in channels) == model.inputs
    for channel, numbers in zip(channels, expected["channels"], strict=True):
        for key, number in numbers.items():
            number = np.inf if number is None else number
            assert getattr(channel, key) == pytest.approx(number, rel=ROUNDING), key
    if len(channels) < 3:
        d = expected["disk_margin"]
        assert together.disk_margin == pytest.approx(d, rel=ROUNDING)
        # Seiler, Packard and Gahinet: where the disk meets the real axis and the unit circle
        disk = together.gain_decrease, together.gain_increase, together.phase_margin
        of_disk = (2.0 - d) / (2.0 + d), (2.0 + d) / (2.0 - d), 2.0 * np.arctan(d / 2.0)
        assert disk == pytest.approx(of_disk, rel=ROUNDING)
    else:  # of three inputs only a bound is computed, on the safe side
        assert 0.99 * expected["disk_margin"] < together.disk_margin < expected["disk_margin"]


def resonant(seed):
    """A stable loop of a lag and two resonances, which crosses 1 or the real axis several times."""
    rng, A = np.random.default_rng(seed), np.zeros((5, 5))
    A[0, 0] = -rng.uniform(-0.3, 1.0)
    for i in (1, 3):
        w = 10.0 ** rng.uniform(-0.5, 1.0)
        A[i : i + 2, i : i + 2] = [[0.0, w], [-w, -2.0 * rng.uniform(-0.02, 0.1) * w]]
    B, C = rng.normal(size=(5, 1)), 2.0 * rng.normal(size=(1, 5))
    K_P, K_I = -np.abs(rng.normal(size=2)) * [1.0, 0.3]
    names = {"inputs": ("u",), "errors": ("e",)}
    model = ft.loop.LinearModel(A=A, B=B, C=C, states=tuple("abcde"), **names)
    return model, ft.PIGains(K_P=[[K_P]], K_I=[[K_I]], **names)


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

    alone, together = margins.loop_margins(model, gains)

    assert max(len(on_circle), len(factors)) > 1
    assert alone.phase_margin == pytest.approx(lags.min(), rel=OF_GRID)
    assert alone.delay_margin == pytest.approx((lags / omega[on_circle]).min(), rel=OF_GRID)
    assert together.delay_margin == pytest.approx(alone.delay_margin, rel=ROUNDING)
    assert alone.gain_increase == pytest.approx(
        min(factors[factors > 1.0], default=np.inf), rel=OF_GRID
    )
    assert alone.gain_decrease == pytest.approx(
        max(factors[factors < 1.0], default=0.0), rel=OF_GRID
    )


def test_a_loop_that_is_real_and_positive_has_no_margin_of_gain_there():
    # L = K (s^2 + 0.4 s + 1) / (s (s + 1) (s + 20) (s + 30)) is positive twice from 1 rad/s on, and
    # its phase reaches -180 deg at infinity alone. By Routh it is stable for every K > 0.
    poles = np.poly([-1.0, -20.0, -30.0])
    names = {"inputs": ("u",), "errors": ("e",)}
    model = ft.loop.LinearModel(
        A=np.vstack([-poles[1:], np.eye(3)[:2]]),
        B=[[1.0], [0.0], [0.0]],
        C=[[-1.0, -0.4, -1.0]],
        states=("a", "b", "c"),
        **names,
    )
    gains = ft.PIGains(K_P=[[0.0]], K_I=[[500.0]], **names)
    s = 1j * np.geomspace(0.5, 20.0, 1001)
    L = 500.0 * (s**2 + 0.4 * s + 1.0) / (s * np.polyval(poles, s))
    assert np.count_nonzero(np.diff(L.imag > 0.0) & (L.real[:-1] > 0.0)) == 2

    alone, _ = margins.loop_margins(model, gains)

    assert (alone.gain_decrease, alone.gain_increase) == (0.0, np.inf)


def test_every_change_inside_the_disk_margin_is_survived():
    *channels, together = margins.loop_margins(LAGGED, ft.PAPER_GAINS)
    rng = np.random.default_rng(0)

    for exponents in rng.uniform(-1.0, 1.0, (200, 2)):
        assert abscissa(with_input_gains(LAGGED, together.gain_increase**exponents)) < 0.0

    assert together.phase_margin <= min(channel.phase_margin for channel in channels)
    assert 0.0 < together.disk_margin < 2.0


@pytest.mark.parametrize("K_I", [0.01, 1e-6])
def test_the_disk_margin_of_an_integrator_nearly_reaches_its_bound(K_I):
    # L = (s + K_I)/s^2, so that |S - T| is largest at omega = sqrt(K_I): sqrt(1 + 4 K_I). At
    # infinity it is 1, and no loop has a disk margin above 2.
    names = {"inputs": ("u",), "errors": ("e",)}
    integrator = ft.loop.LinearModel(A=[[0.0]], B=[[1.0]], C=[[-1.0]], states=("x",), **names)

    *_, together = margins.loop_margins(integrator, ft.PIGains(K_P=[[1.0]], K_I=[[K_I]], **names))

    expected = 2.0 / np.sqrt(1.0 + 4.0 * K_I)
    assert together.disk_margin == pytest.approx(expected, rel=1e-6)


def test_an_unstable_loop_has_no_margins():
    nothing = ft.PIGains(K_P=np.zeros((2, 2)), K_I=np.zeros((2, 2)))

    assert margins.loop_margins(MODEL, nothing) == ()
    assert margins.lag_margin(MODEL, nothing) == 0.0
    assert margins.delay_margin(MODEL, nothing) == 0.0


def decoupled(damping, proportional, integral):
    """Two loops ``s (s + damping) + proportional s + integral``, each on its own."""
    model = replace(MODEL, A=-damping * np.eye(2), B=-np.eye(2))
    return model, ft.PIGains(K_P=proportional * np.eye(2), K_I=integral * np.eye(2))


def test_a_lag_that_no_loop_minds_and_one_that_is_below_the_shortest_are_its_ends():
    # By Routh a lag T keeps it stable where (damping + proportional) (1 + damping T) > T integral.
    assert margins.lag_margin(*decoupled(2.0, 1.0, 5.0)) == np.inf
    assert margins.lag_margin(*decoupled(2.0, 1.0, 7.0)) == pytest.approx(3.0, rel=1e-6)
    assert margins.lag_margin(*decoupled(0.0, 1.0, 2e4)) == margins.SHORTEST_LAG


def test_a_response_at_a_pole_is_as_large_as_beside_it():
    at_rest, slow = margins.channel_responses(MODEL, K6, np.array([0.0, 1e-3]))

    assert np.isfinite(at_rest).all()
    assert (np.abs(at_rest) > np.abs(slow)).all()
    assert (margins.cut_margins((np.eye(2), np.eye(2), np.zeros((2, 2))), MODEL.inputs)) == ()


@pytest.mark.parametrize(
    ("sensitivity", "phase_deg"), [(LARGEST_SENSITIVITY, 35.0), (SENSITIVITY, 41.8)]
)
def test_a_sensitivity_of_tuned_gains_leaves_at_least_what_meet_requires(sensitivity, phase_deg):
    """6 dB and 35 deg; ``|1 + L| >= 1 / S`` leaves ``S / (S - 1)`` and ``2 asin(1 / (2 S))``."""
    phase = math.degrees(2.0 * math.asin(0.5 / sensitivity))

    assert phase == pytest.approx(phase_deg, abs=0.05)
    assert 20.0 * math.log10(sensitivity / (sensitivity - 1.0)) > 6.0
