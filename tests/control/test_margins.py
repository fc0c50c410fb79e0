"""Margins against loops that are actually changed by as much, and against python-control's."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from printed import MARKED, MODEL, lagged

import flighttune as ft
from flighttune.control.inner_loop import with_input_delay
from flighttune.control.margins import cut_margins, delay_margin, lag_margin, loop_margins

LAGGED, K6 = lagged(), MARKED["K6"]
BELOW, ABOVE = 0.99, 1.01
PADE_SECTIONS = 6
ROUNDING = 1e-9

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
    edge = 1.0 / lag_margin(MODEL, gains)

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
    delay = delay_margin(model, gains)

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
    *channels, together = loop_margins(model, gains)

    assert tuple(channel.loop for channel in channels) == model.inputs
    for channel, numbers in zip(channels, expected["channels"], strict=True):
        for key, number in numbers.items():
            number = np.inf if number is None else number
            assert getattr(channel, key) == pytest.approx(number, rel=ROUNDING), key
    if len(channels) < 3:
        assert together.disk_margin == pytest.approx(expected["disk_margin"], rel=ROUNDING)
    else:  # of three inputs only a bound is computed, on the safe side
        assert 0.99 * expected["disk_margin"] < together.disk_margin < expected["disk_margin"]


def test_the_delay_margin_of_an_input_is_the_least_of_all_its_crossovers():
    """An integrator beside a resonance at 3 rad/s: |L| is 1 below, before and behind the peak."""
    A = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -9.0, -0.12]])
    omega = np.geomspace(0.1, 10.0, 1_000_001)
    L = 0.5 / (1j * omega) + 0.3j * omega / (9.0 - omega**2 + 0.12j * omega)
    at = np.flatnonzero(np.diff(np.abs(L) > 1.0))
    delays = (np.pi + np.angle(L[at])) / omega[at]

    (found,) = cut_margins((A, np.array([[1.0], [0.0], [1.0]]), np.array([[0.5, 0.0, 0.3]])), "u")

    assert len(delays) == 3
    assert delays.argmin() == 2
    assert found.delay_margin == pytest.approx(delays.min(), rel=1e-4)


def test_every_change_inside_the_disk_margin_is_survived():
    *channels, together = loop_margins(LAGGED, ft.PAPER_GAINS)
    rng = np.random.default_rng(0)

    for exponents in rng.uniform(-1.0, 1.0, (200, 2)):
        assert abscissa(with_input_gains(LAGGED, together.gain_increase**exponents)) < 0.0

    assert together.phase_margin <= min(channel.phase_margin for channel in channels)
    assert 0.0 < together.disk_margin < 2.0


def test_an_unstable_loop_has_no_margins():
    nothing = ft.PIGains(K_P=np.zeros((2, 2)), K_I=np.zeros((2, 2)))

    assert loop_margins(MODEL, nothing) == ()
    assert lag_margin(MODEL, nothing) == 0.0
    assert delay_margin(MODEL, nothing) == 0.0
