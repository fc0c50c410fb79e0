"""The controller against what can be worked out on paper, sample by sample."""

import math

import numpy as np
import pytest

import flighttune as ft

ROUNDING = 1e-12
HERE = (0.0, 0.0)


def diagonal(k_p, k_i):
    return ft.PIGains(K_P=np.diag(k_p), K_I=np.diag(k_i))


def limits(magnitude=(math.inf, math.inf), rate=(math.inf, math.inf)):
    magnitude, rate = np.array(magnitude), np.array(rate)
    return ft.loop.Limits(lower=-magnitude, upper=magnitude, rate_lower=-rate, rate_upper=rate)


def command(controller, ref, y=HERE, V_a=25.0):
    place = 1000.0, (0.0, 0.0, 0.0), None
    here = ft.loop.Measured(y[0], y[1], V_a, 0.0, 1.0, *place)
    return controller.step(here, ft.loop.ReferenceSample(*ref), 0.0)[:2]


def flown(controller, error, samples):
    """Commands under a constant error."""
    return np.array([command(controller, error) for _ in range(samples)])


def test_a_constant_error_is_answered_by_proportion_and_its_running_integral():
    dt, error = 0.02, np.array([0.3, -0.1])
    controller = ft.loop.MimoPI(ft.PAPER_GAINS, dt=dt)

    commands = flown(controller, error, 50)

    t = np.arange(50) * dt
    wanted = (ft.PAPER_GAINS.K_P @ error) + np.outer(t, ft.PAPER_GAINS.K_I @ error)
    assert commands == pytest.approx(wanted, abs=ROUNDING)


def test_the_integral_of_a_ramp_is_exact():
    dt, slope = 0.1, 0.5
    controller = ft.loop.MimoPI(diagonal([0.0, 0.0], [2.0, 0.0]), dt=dt)

    for k in range(21):
        u = command(controller, (slope * k * dt, 0.0))

    assert u[0] == pytest.approx(2.0 * slope * 2.0**2 / 2, abs=ROUNDING)


@pytest.mark.parametrize(("ref", "actual"), [(3.1, -3.1), (-3.1, 3.1), (0.1, 6.2)])
def test_the_course_error_takes_the_short_way_round_and_that_of_the_path_does_not(ref, actual):
    controller = ft.loop.MimoPI(diagonal([1.0, 1.0], [0.0, 0.0]), dt=0.02)

    command(controller, (ref, 4.0), (actual, 0.0))

    wanted = math.atan2(math.sin(ref - actual), math.cos(ref - actual))
    assert controller.state.error == pytest.approx([wanted, 4.0], abs=ROUNDING)


def test_magnitude_and_rate_limits_hold_and_are_told_apart():
    dt = 0.1
    held = limits((0.5, 0.25), (1.0, 9.0))
    controller = ft.loop.MimoPI(diagonal([10.0, 10.0], [0.0, 0.0]), held, dt=dt)

    first = flown(controller, (1.0, 1.0), 1)[0]
    kinds = list(controller.state.limited)
    later = flown(controller, (1.0, 1.0), 9)

    assert first == pytest.approx([0.1, 0.25], abs=ROUNDING)
    assert kinds == [2, 1]
    assert np.diff(later[:4, 0]) == pytest.approx(1.0 * dt, abs=ROUNDING)
    assert later[-1] == pytest.approx([0.5, 0.25], abs=ROUNDING)
    assert controller.state.limited == [1, 1]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_start_outside_the_range_comes_back_as_fast_as_the_rate_limit_lets_it(side):
    """The command wanted, 0.7, is outside of the range of 0.5 too."""
    held = limits((0.5, 9.0), (1.0, 9.0))
    controller = ft.loop.MimoPI(diagonal([1.0, 0.0], [0.0, 0.0]), held, dt=0.1)
    controller.start(ft.loop.FlightCondition(V_a=25.0, phi=side, n_z=0.0))

    commands = side * flown(controller, (0.7 * side, 0.0), 12)[:, 0]

    wanted = np.maximum(1.0 - 0.1 * np.arange(1, 13), 0.5)
    assert commands == pytest.approx(wanted, abs=ROUNDING)


def test_conditional_integration_never_drives_the_command_beyond_a_limit():
    controller = ft.loop.MimoPI(diagonal([0.1, 0.1], [0.5, 0.5]), limits((0.4, 0.4)), dt=0.1)

    for _ in range(60):
        command(controller, (1.0, -1.0))
        assert np.all(np.abs(controller.state.u_unsat) <= 0.4 + ROUNDING)

    assert controller.state.u == pytest.approx([0.4, -0.4], abs=ROUNDING)


def test_conditional_integration_stands_where_the_proportion_alone_is_beyond_a_limit():
    controller = ft.loop.MimoPI(diagonal([1.0, 1.0], [0.5, 0.5]), limits((0.4, 0.4)), dt=0.1)

    flown(controller, (1.0, -1.0), 5)

    assert controller.state.integral == [0.0, 0.0]


def test_conditional_integration_lets_go_as_soon_as_the_error_changes_sign():
    controller = ft.loop.MimoPI(diagonal([1.0, 1.0], [0.5, 0.5]), limits((0.4, 0.4)), dt=0.1)
    flown(controller, (1.0, 1.0), 50)

    command = flown(controller, (-0.5, -0.5), 2)[-1]

    assert np.all(command < 0.0)


def test_conditional_integration_under_a_rate_limit_does_not_lock():
    """An increment larger than one rate-limited step must still move the integrator."""
    dt, rate, error = 0.02, 0.5, 0.3
    controller = ft.loop.MimoPI(diagonal([0.0, 0.0], [5.0, 5.0]), limits(rate=(rate, rate)), dt=dt)

    commands = flown(controller, (error, error), 101)

    assert 5.0 * error > rate
    assert commands[-1] == pytest.approx([rate * dt * 100] * 2, rel=0.02)


def led_back(gains, tracking):
    held, settings = limits((0.4, 0.4)), {"anti_windup": "back_calculation", "dt": 0.02}
    return ft.loop.MimoPI(gains, held, tracking_time=tracking, **settings)


def test_back_calculation_settles_where_the_excess_balances_the_error():
    error, tracking = 1.0, 0.8
    controller = led_back(diagonal([1.0, 1.0], [0.5, 0.5]), tracking)

    flown(controller, (error, error), 2000)

    excess = np.array(controller.state.u_unsat) - 0.4
    assert excess == pytest.approx([0.5 * error * tracking] * 2, rel=1e-9)


def test_the_tracking_time_is_the_integral_time_unless_given():
    gains = diagonal([3.0, 4.0], [0.6, 0.8])

    by_default, given = (flown(led_back(gains, time), (1.0, -1.0), 100) for time in (None, 5.0))

    assert by_default == pytest.approx(given, abs=ROUNDING)


def test_scheduled_gains_grow_with_airspeed_and_its_change_does_not_move_the_integral():
    error = (0.2, 0.1)
    plain = ft.loop.MimoPI(ft.PAPER_GAINS, dt=0.02)
    scheduled = ft.loop.MimoPI(ft.PAPER_GAINS, dt=0.02, schedule_speed=25.0)
    for _ in range(10):
        for controller in (plain, scheduled):
            command(controller, error, V_a=30.0)
    before = list(scheduled.state.integral)

    command(scheduled, HERE, error, V_a=20.0)

    assert np.array(before) == pytest.approx(1.2 * np.array(plain.state.integral), abs=ROUNDING)
    assert scheduled.state.integral == pytest.approx(before, abs=ROUNDING)


def test_feed_forward_is_inside_the_limits():
    """The load factor of the path wanted: cos(gamma)."""
    none, climb = diagonal([0.0, 0.0], [0.0, 0.0]), (0.0, 0.4)
    free, held = (
        command(ft.loop.MimoPI(none, limits((1.0, most)), dt=0.02, feed_forward=True), climb, climb)
        for most in (9.0, 0.5)
    )

    assert free == pytest.approx((0.0, math.cos(0.4)), abs=ROUNDING)
    assert held == pytest.approx((0.0, 0.5), abs=ROUNDING)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"dt": 0.0}, r"`dt` must be positive, got 0\.0"),
        ({"dt": 0.1, "tracking_time": -1.0}, r"`tracking_time` must be positive, got -1\.0"),
        ({"dt": 0.1, "anti_windup": "clamp"}, r"`anti_windup` .*'clamp'"),
    ],
)
def test_impossible_settings_are_refused(settings, message):
    with pytest.raises(ft.InputError, match=message):
        ft.loop.MimoPI(ft.PAPER_GAINS, **settings)
