"""Windows of flights whose phases are known, and boxes around made-up residuals."""

import numpy as np
import pytest
from scipy.stats import norm

from flighttune.conformance.boxes import CHANCE, MARGIN, Windows, fitted_boxes, widening
from flighttune.errors import InputError

ROUNDING = 1e-12


@pytest.mark.parametrize(("duration", "count"), [(2.0, 4), (1.0, 2)])
def test_windows_by_time_last_half_a_second_and_the_last_one_to_the_end(duration, count):
    t = 0.1 * np.arange(21)

    windows = Windows.covering("time", duration)

    assert windows.count == count
    expected = [min(i // 5, count - 1) for i in range(20)]
    assert windows.of_samples(t, 0.0 * t, 0.0 * t).tolist() == expected


def test_windows_by_phase_count_from_where_the_reference_stops():
    t = 0.1 * np.arange(31)
    ramp = np.clip(t - 0.5, 0.0, 0.7)  # moves from 0.5 to 1.2 s

    window = Windows.covering("phase", 3.0).of_samples(t, ramp, np.zeros(31))

    assert window[:5].tolist() == [1] * 5
    assert window[5:12].tolist() == [0] * 7
    assert window[12:17].tolist() == [1] * 5
    assert window[17:22].tolist() == [2] * 5


def test_boxes_hold_what_they_were_fitted_to_with_a_margin():
    rng = np.random.default_rng(1)
    windows = Windows(over="time", count=3)
    residual = rng.normal((0.5, -1.0, 0.0, 2.0, 1.0, -2.0), size=(20, 30, 6))
    windowed = [windows.extremes(one, np.arange(30) // 10) for one in residual]
    lows, highs = map(np.array, zip(*windowed, strict=True))

    boxes, _ = fitted_boxes(windows, lows, highs, 100)

    low = residual.reshape(20, 3, 10, 6).min(axis=(0, 2))
    high = residual.reshape(20, 3, 10, 6).max(axis=(0, 2))
    # Errors are those of a second before and after: here of all three windows.
    low[:, 4:], high[:, 4:] = low[:, 4:].min(axis=0), high[:, 4:].max(axis=0)
    centre, half = 0.5 * (low + high), MARGIN * 0.5 * (high - low)
    assert boxes.low == pytest.approx(centre - half, abs=ROUNDING)
    assert boxes.high == pytest.approx(centre + half, abs=ROUNDING)
    assert boxes.hold(lows, highs).all()


def test_a_flight_that_leaves_one_box_or_was_not_flown_is_outside():
    windows = Windows(over="time", count=2)
    low, high = np.full((1, 2, 6), -1.0), np.full((1, 2, 6), 1.0)
    boxes, _ = fitted_boxes(windows, low, high, 100)
    leaves = high.copy()
    leaves[0, 1, 0] = MARGIN + 0.01

    flights = np.concatenate([low, low, np.full((1, 2, 6), np.nan)])
    assert boxes.hold(flights, np.concatenate([high, leaves, flights[2:]])).tolist() == [
        True, False, False,
    ]  # fmt: skip


def test_a_window_that_no_flight_was_in_is_as_wide_as_all():
    windows = Windows(over="phase", count=3)
    low, high = windows.extremes(
        np.array([[-1.0, 0.0, 0.0, 4.0, 1.0, 2.0], [2.0, 3.0, 1.0, 4.5, 2.0, 6.0]]),
        np.array([0, 1]),
    )

    boxes, _ = fitted_boxes(windows, low[None], high[None], 100)

    centre, half = (
        [0.5, 1.5, 0.5, 4.25, 1.5, 4.0],
        MARGIN * np.array([1.5, 1.5, 0.5, 0.25, 0.5, 2.0]),
    )
    assert boxes.low[2] == pytest.approx(centre - half)
    assert boxes.high[2] == pytest.approx(centre + half)


# The tail of normal residuals is lighter than the fitted one.
@pytest.mark.parametrize(("learned", "fresh", "widest"), [(500, 797, 1.8), (2000, 138_149, 2.5)])
def test_boxes_are_widened_as_far_as_so_many_normal_residuals_need(learned, fresh, widest):
    rng = np.random.default_rng(3)
    residual = rng.normal(size=(learned, 4, 2))
    # so that each of the 8 is inside with a probability of (1 - CHANCE)^(1 / (8 fresh))
    needed = norm.isf(0.5 * CHANCE / (8 * fresh))

    widened = widening(residual, residual, fresh)

    half = 0.5 * (residual.max(axis=0) - residual.min(axis=0)).mean(axis=0)
    assert np.all((needed < widened * half) & (widened * half < widest * needed))


def test_errors_may_come_in_a_second_later_and_residuals_may_not():
    windows = Windows.covering("time", 4.0)
    falls = np.repeat(np.array([4.0, 3.0, 2.0, 1.0, 0.0, 0.0, 0.0, 0.0])[:, np.newaxis], 6, axis=1)
    boxes, _ = fitted_boxes(windows, np.stack([-falls, -falls]), np.stack([falls, falls]), 10)

    later = np.concatenate([falls[:1], falls[:1], falls[:-2]])
    as_error, as_residual = falls.copy(), falls.copy()
    as_error[:, 4:], as_residual[:, 0] = later[:, 4:], later[:, 0]

    assert boxes.hold(-as_error, as_error)
    assert not boxes.hold(-as_residual, as_residual)


def test_each_quantity_is_widened_by_what_it_needs_itself():
    rng = np.random.default_rng(3)
    normal, bounded = rng.normal(size=(500, 4, 1)), rng.uniform(-1.0, 1.0, size=(500, 4, 1))
    both = np.concatenate([normal, bounded], axis=2)

    assert widening(both, both, 797)[1] < 1.15 < 1.25 < widening(both, both, 797)[0]


def test_windows_may_be_shorter_but_not_shorter_than_a_sample():
    t = np.arange(51) * 0.02

    found = Windows.covering("time", 1.0, 0.1).of_samples(t, np.zeros(51), np.zeros(51))

    assert found.tolist() == [k // 5 for k in range(50)]
    with pytest.raises(InputError, match=r"`window`.*0\.02 s.* 0 s"):
        Windows.covering("time", 1.0, 0.0)
