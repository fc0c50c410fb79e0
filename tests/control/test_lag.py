"""Lag and delay against their transfer functions."""

import numpy as np
import pytest

from flighttune.control.inner_loop import with_input_delay, with_input_lag
from flighttune.control.linear_model import kinematic_model
from flighttune.errors import InputError, ShapeError

MODEL = kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=9.81)
ROUNDING = 1e-12


def response(model, s):
    return model.C @ np.linalg.solve(s * np.eye(len(model.A)) - model.A, model.B)


@pytest.mark.parametrize("s", [0.3j, 2.0j, 1.0 + 5.0j])
def test_a_lag_multiplies_each_input_by_its_own_first_order_response(s):
    bandwidths = np.array([4.0, 8.0])

    lagged = response(with_input_lag(MODEL, bandwidths), s)

    assert lagged == pytest.approx(response(MODEL, s) * bandwidths / (s + bandwidths), rel=ROUNDING)


@pytest.mark.parametrize("sections", [1, 2, 4])
def test_a_delay_is_all_pass_and_its_phase_error_falls_with_the_sections(sections):
    omega, delay = 2.0, np.array([0.1, 0.3])

    delayed = response(with_input_delay(MODEL, delay, sections=sections), 1j * omega)

    ratio = np.diag(delayed) / np.diag(response(MODEL, 1j * omega))
    assert np.abs(ratio) == pytest.approx(1.0, rel=ROUNDING)
    assert -np.angle(ratio) == pytest.approx(omega * delay, rel=0.04 / sections**2)


def test_lag_and_delay_keep_the_names_and_count_the_states():
    changed = with_input_delay(with_input_lag(MODEL, 5.0), 0.02, sections=2)

    assert (changed.inputs, changed.errors) == (MODEL.inputs, MODEL.errors)
    assert changed.shape == (8, 2, 2)
    assert len(set(changed.states)) == 8 or changed.states[:2] == MODEL.states


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (lambda: with_input_lag(MODEL, [4.0, 0.0]), InputError, "`bandwidths` must be positive"),
        (lambda: with_input_lag(MODEL, [4.0] * 3), ShapeError, "`bandwidths` must have shape"),
        (lambda: with_input_delay(MODEL, -0.1), InputError, "`delay` must be positive"),
        (lambda: with_input_delay(MODEL, 0.1, sections=0), InputError, "`sections` must be at"),
    ],
)
def test_impossible_lags_and_delays_are_refused(call, error, message):
    with pytest.raises(error, match=message):
        call()
