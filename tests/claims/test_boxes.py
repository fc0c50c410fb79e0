"""Windows of flights whose phases are known, and boxes around made-up residuals."""

import numpy as np
import pytest

from flighttune.claims.boxes import RateBoxes, Windows
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


def test_the_smallest_boxes_hold_the_flights_they_were_learned_from():
    rng = np.random.default_rng(1)
    windows = Windows(over="time", count=3)
    residual = rng.normal((0.5, -1.0, 0.0, 2.0), size=(20, 30, 4))
    windowed = [windows.extremes(flight, np.arange(30) // 10) for flight in residual]
    lows, highs = map(np.array, zip(*windowed, strict=True))

    boxes = RateBoxes.around(windows, lows, highs)

    assert boxes.low == pytest.approx(residual.reshape(20, 3, 10, 4).min(axis=(0, 2)))
    assert boxes.high == pytest.approx(residual.reshape(20, 3, 10, 4).max(axis=(0, 2)))
    scores = [boxes.score(*flight) for flight in windowed]
    assert max(scores) == pytest.approx(1.0)
    assert min(scores) < 1.0 - ROUNDING


def test_no_box_is_narrower_than_a_twentieth_of_the_widest_of_its_quantity():
    windows = Windows(over="time", count=2)
    ends = np.array([[[1.0, 1.0, 1.0, 1.0], [0.0, 10.0, 0.0, 0.0]]])

    boxes = RateBoxes.around(windows, -ends, ends)

    assert boxes.high == pytest.approx(np.array([[1.0, 1.0, 1.0, 1.0], [0.05, 10.0, 0.05, 0.05]]))
    assert boxes.low == pytest.approx(-boxes.high)


def test_the_score_is_the_scale_at_which_a_flight_is_just_inside():
    windows = Windows(over="time", count=3)
    rng = np.random.default_rng(2)
    low, high = np.sort(rng.normal(size=(2, 3, 4)), axis=0)
    boxes = RateBoxes(windows=windows, low=low, high=high)
    flight = np.sort(2.0 * rng.normal(size=(2, 3, 4)), axis=0)
    flight[:, 1] = np.array([np.inf, -np.inf])[:, None]  # the flight was never in this window

    score = boxes.score(*flight)

    def inside(scale):
        wide = boxes.scaled(scale)
        return bool(((flight[0] >= wide.low) & (flight[1] <= wide.high)).all())

    assert inside(score * (1.0 + ROUNDING))
    assert not inside(score * (1.0 - ROUNDING))


def test_a_box_without_width_is_left_by_any_other_value():
    boxes = RateBoxes(windows=Windows(over="time", count=1), low=[[1.0] * 4], high=[[1.0] * 4])

    assert boxes.score(np.ones((1, 4)), np.ones((1, 4))) == 0.0
    assert boxes.score(np.ones((1, 4)), np.full((1, 4), 1.1)) == np.inf


def test_a_window_that_no_flight_was_in_is_as_wide_as_all():
    windows = Windows(over="phase", count=3)
    low, high = windows.extremes(
        np.array([[-1.0, 0.0, 0.0, 4.0], [2.0, 3.0, 1.0, 4.5]]), np.array([0, 1])
    )

    boxes = RateBoxes.around(windows, low[None], high[None])

    assert boxes.low[2] == pytest.approx([-1.0, 0.0, 0.0, 4.0])
    assert boxes.high[2] == pytest.approx([2.0, 3.0, 1.0, 4.5])


def test_windows_may_be_shorter_but_not_shorter_than_a_sample():
    t = np.arange(51) * 0.02

    found = Windows.covering("time", 1.0, 0.1).of_samples(t, np.zeros(51), np.zeros(51))

    assert found.tolist() == [k // 5 for k in range(50)]
    with pytest.raises(InputError, match=r"`window`.*0\.02 s.* 0 s"):
        Windows.covering("time", 1.0, 0.0)
