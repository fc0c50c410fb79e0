"""Metrics of responses whose measures follow from a formula."""

import dataclasses
import math

import numpy as np
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.flight import metrics
from flighttune.flight.loop import kernel
from flighttune.flight.loop.measures import error_measures, step_measures

SAMPLING = 2e-4
T = np.linspace(0.0, 20.0, 200_001)


def run_of(chi_err, gamma_err=None, **columns):
    zero = "chi_ref", "gamma_ref", "phi_cmd", "phi_limited", "n_z_limited"
    level = dict.fromkeys(zero, 0.0)
    level |= {"n_z_cmd": 1.0, "n_z": 1.0, "V_a": 25.0}
    errors = {"chi_err": chi_err, "gamma_err": 0.0 if gamma_err is None else gamma_err}
    return made_up_run({**errors, **level, **columns}, T)


def second_order(damping, omega):
    """Error of a unit step of a second-order lag, which starts at -1 and overshoots."""
    damped = omega * math.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * omega * T)
    return -decay * (np.cos(damped * T) + damping * omega / damped * np.sin(damped * T))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_and_peak_time_of_a_second_order_lag_are_those_of_the_textbook(sign):
    damping, omega = 0.3, 1.2

    found = ft.loop.channel_metrics(run_of(sign * second_order(damping, omega))).loc["chi"]

    root = math.sqrt(1.0 - damping**2)
    assert found["MO_rad"] == pytest.approx(math.exp(-math.pi * damping / root), abs=1e-6)
    assert found["PT_s"] == pytest.approx(math.pi / (omega * root), abs=SAMPLING)


def test_times_of_an_airspeed_count_from_the_first_change_of_its_reference():
    damping, omega, at = 0.3, 1.2, 80_000
    error = np.append(np.zeros(at), second_order(damping, omega)[:-at])
    run = run_of(
        np.zeros_like(T), V_err=error, V_ref=25.0 + (error != 0.0), n_x_cmd=0.0, n_x_limited=0.0
    )

    found = metrics.airspeed_metrics(run)

    root = math.sqrt(1.0 - damping**2)
    assert found["PT_s"] == pytest.approx(math.pi / (omega * root), abs=SAMPLING)
    assert found["MO_mps"] == pytest.approx(math.exp(-math.pi * damping / root), abs=1e-6)
    assert found["rise_s"] < found["PT_s"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_response_that_overshoots_within_a_sample_is_judged_by_the_side_it_came_from(sign):
    t, error = np.linspace(0.0, 0.4, 5), sign * np.array([1.0, -0.5, -0.25, 0.125, 0.0])

    peak_time, overshoot, rise = step_measures(t, error)

    assert (peak_time, overshoot) == (pytest.approx(0.1), 0.5)
    # the line from 1 to -0.5 passes 0.9 and 0.1 a fifteenth and nine fifteenths on its way
    assert rise == pytest.approx(0.1 * (0.9 - 0.1) / 1.5)


def test_an_exponential_has_the_integrals_and_times_of_its_formula():
    rate = 0.8
    found = ft.loop.channel_metrics(run_of(np.exp(-rate * T))).loc["chi"]

    left = math.exp(-rate * 20.0)
    itae = (1.0 - left * (1.0 + rate * 20.0)) / rate**2
    last = np.exp(-rate * T[T >= 15.0])
    assert found["ITAE"] == pytest.approx(itae, rel=1e-6)
    assert found["ITAE_mean"] == pytest.approx(itae / 20.0, rel=1e-6)
    assert found["MO_rad"] == 0.0
    assert found["rise_s"] == pytest.approx(math.log(9.0) / rate, abs=SAMPLING)
    assert found["settling_s"] == pytest.approx(math.log(20.0) / rate, abs=SAMPLING)
    mean = (math.exp(-rate * 15.0) - left) / (rate * 5.0)
    assert found["MS_rad"] == pytest.approx(mean, rel=1e-3)
    assert found["ST_rad"] == pytest.approx(math.sqrt(np.mean(last**2) - np.mean(last) ** 2))


def test_settling_within_a_band_of_its_own_is_the_last_time_an_error_leaves_it():
    rate, name = 0.8, "settling_s within 5 deg"

    settles, swings = -np.exp(-rate * T), np.deg2rad(6.0) * np.cos(math.tau * T)
    names = {"chi": ["error within 3 deg", name]}
    found, wavy = (
        metrics.measures_of(T, metrics.signal_arrays(run_of(error), metrics.MEASURED), names)["chi"]
        for error in (settles, swings)
    )

    assert found[name] == pytest.approx(math.log(1.0 / math.radians(5.0)) / rate, abs=SAMPLING)
    assert math.isnan(wavy[name])
    assert wavy["late_rad"] == pytest.approx(math.radians(6.0))
    assert wavy["settling_band_rad"] == pytest.approx(0.05 * math.radians(6.0))


CHANGED_S, RATE = 3.0, 0.8
AFTER = np.clip(T - CHANGED_S, 0.0, None)
STEP = (T >= CHANGED_S).astype(float)


@pytest.mark.parametrize(
    ("subject", "within", "error", "more", "ratio"),
    [
        # The error is largest at the change, then as the bounds of 2 and 6 s after it begin.
        ("chi", [[0, 90], [2, 8], [6, 1]], np.deg2rad(60.0 * STEP * np.exp(-RATE * AFTER)),
         {"chi_ref": np.deg2rad(60.0 * STEP)}, 60.0 * math.exp(-2.0 * RATE) / 8.0),
        ("gamma", [[0, 90], [1, 0.2]], np.deg2rad(1.0 - STEP), {"gamma_ref": 0.1 * STEP}, 5.0),
        # While a ramp lasts, the first bound holds: its error is 2 deg, its end at 8 s.
        ("chi", [[0, 4], [1.5, 1]], np.deg2rad(2.0) * ((T > 3.0) & (T < 9.0)),
         {"chi_ref": np.clip(T - 3.0, 0.0, 5.0)}, 0.5),
        ("V", [[0, 3], [4, 0.1]], 2.0 * STEP * np.exp(-RATE * AFTER),
         {"V_ref": 20.0 + 2.0 * STEP, "n_x_cmd": 0.0, "n_x_limited": 0.0},
         20.0 * math.exp(-4.0 * RATE)),
        # On a route all count from the start, whatever its guidance commands.
        ("cross_track", [[0, 20], [5, 3]], -10.0 * np.exp(-0.1 * T),
         {"chi_ref": 0.1 * T}, 10.0 * math.exp(-0.5) / 3.0),
        ("chi", [[0, 90], [5, 0.5]], np.deg2rad(1.0),
         {"chi_ref": 0.1 * T, "cross_track": 0.0}, 2.0),
    ],
)  # fmt: skip
def test_the_largest_ratio_of_an_error_to_its_envelope_is_that_of_the_formula(
    subject, within, error, more, ratio
):
    (names,) = metrics.required_names([{"at_most": {subject: {"within": within}}}]).values()
    signal = subject if subject == "cross_track" else f"{subject}_err"
    signals = run_of(**{"chi_err": 0.0, **more, signal: error}).signals
    columns = {name: signals[name].to_numpy() for name in signals}

    found = metrics.measures_of(T, columns, {subject: names})

    assert found[subject][names[0]] == pytest.approx(ratio, rel=2.0 * SAMPLING)


def test_what_does_not_happen_has_no_time():
    swinging, still = ft.loop.channel_metrics(run_of(np.cos(T))).loc[["chi", "gamma"]].iloc

    assert math.isnan(swinging["settling_s"])
    assert still["MO_rad"] == 0.0
    assert still[["PT_s", "rise_s"]].isna().all()


def step(t, lag):
    """Error of a first-order lag to a unit step of its reference at t = 0."""
    return np.where(t < 0.0, 0.0, np.exp(-t / lag))


def ramp(t, lag, lasting=3.0):
    """Error of a first-order lag to a reference that rises by 1 in a time."""
    rises = np.clip(t, 0.0, lasting), np.maximum(t - lasting, 0.0)
    return lag / lasting * (1.0 - np.exp(-rises[0] / lag)) * np.exp(-rises[1] / lag)


# Errors of a first-order lag of a time constant, s, in closed form, and what they settle in.
LAG = 0.7
SETTLED = {
    "a step in mid-flight": (1.0 * (T >= 5.0), step(T - 5.0, LAG), math.log(20.0) * LAG),
    "a ramp, from its end": (
        np.clip((T - 2.0) / 3.0, 0.0, 1.0),
        ramp(T - 2.0, LAG),
        LAG * math.log(20.0 * LAG / 3.0 * (1.0 - math.exp(-3.0 / LAG))),
    ),
    "a ramp that is followed": (np.clip((T - 2.0) / 3.0, 0.0, 1.0), ramp(T - 2.0, 0.1), 0.0),
    "no end of a ramp": (T / 20.0, ramp(T, 0.1, 20.0), 0.0),
    "a start beside the reference": (0.0 * T, step(T, LAG), math.log(20.0) * LAG),
    "two steps, 5 % of both": (
        1.0 * (T >= 2.0) + (T >= 10.0),
        step(T - 2.0, LAG) + step(T - 10.0, LAG),
        math.log(10.0) * LAG,
    ),
    "two steps, the first settles later": (
        1.0 * (T >= 2.0) + (T >= 10.0),
        step(T - 2.0, LAG) + step(T - 10.0, 0.2),
        math.log(10.0) * LAG,
    ),
    "a step before it has settled": (
        (T >= 2.0) - 1.0 * (T >= 3.0),
        step(T - 2.0, LAG) - step(T - 3.0, LAG),
        math.log(20.0 * (1.0 - math.exp(-1.0 / LAG))) * LAG,
    ),
    "a gust before a step": (
        1.0 * (T >= 5.0), 0.2 * (abs(T - 3.0) < 0.1) + step(T - 5.0, LAG), math.log(20.0) * LAG,
    ),
    "no change": (0.0 * T, math.radians(0.004) * np.sin(T), 0.0),
    "no change, and an error": (0.0 * T, math.radians(0.006) * np.sin(T), math.nan),
    "a step that is never reached": (1.0 * (T >= 5.0), 0.06 * (T >= 5.0), math.nan),
}  # fmt: skip


@pytest.mark.parametrize("compiled", [False, True], ids=["", "compiled"])
@pytest.mark.parametrize(("ref", "error", "settled"), SETTLED.values(), ids=SETTLED)
def test_settling_counts_from_the_end_of_a_change_to_5_percent_of_it(ref, error, settled, compiled):
    measure = kernel.error_measures if compiled else error_measures
    found = measure(T, ref, error, 0.0 * T, 0.0 * T)

    assert found.settling_s == pytest.approx(settled, abs=SAMPLING, nan_ok=True)


@pytest.mark.parametrize("measure", [error_measures, kernel.error_measures])
def test_measures_of_a_few_samples_are_those_by_hand(measure):
    """The flight starts at 0.4, beside a reference of 0 that goes to 1 and to 0.5."""
    t = np.array([0.0, 1.0, 3.0, 6.0, 10.0, 15.0, 16.0])
    ref = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.5])
    error = np.array([-0.4, -0.2, 0.0, 0.5, 0.0, -0.1, 0.0])
    limited = np.array([2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0])

    found = measure(t, ref, error, 0.0 * t, limited)

    assert found.change_rad == pytest.approx(1.0 - 0.4)  # 5 % of it are 0.03
    assert found.saturation_s == 1.0 + 4.0
    assert (found.peak_rad, found.late_rad, found.rest_s) == (0.5, 0.1, 15.0)
    # the start settles in 3 s, the first change in 4 s, and the second in 1 s
    assert found.settling_s == 4.0
    slow_start = measure(t, ref, error * [1, 1, 1, 0, 0, 0, 0], 0.0 * t, limited)
    assert slow_start.settling_s == 3.0
    assert math.isnan(measure(t, 0.0 * t, 1e-3 * error, 0.0 * t, limited).rise_s)


@pytest.mark.parametrize("measure", [error_measures, kernel.error_measures])
def test_errors_while_a_reference_moves_take_no_time(measure):
    t = np.arange(9.0)
    ref, follows = np.clip(t - 2.0, 0.0, 3.0), np.array([0, 0, 0, 0.5, 0.5, 0, 0, 0, 0])

    assert measure(t, ref, follows, 0.0 * t, 0.0 * t).settling_s == 0.0
    late = np.where((t == 5.0) | (t == 6.0), 0.4, follows)
    assert measure(t, ref, late, 0.0 * t, 0.0 * t).settling_s == 2.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_path_angle_that_gives_way_is_held_against_the_one_that_is_given(side):
    """Of 0.1 rad asked for 0.05 are given, and 0.04 are flown."""
    angles = {"gamma_ref": 0.1 * side, "gamma_given": 0.05 * side}
    error = np.full_like(T, (0.1 - 0.04) * side)

    found = metrics.measures(run_of(0.0 * T, error, **angles))
    assert found["gamma"]["end_error"] == pytest.approx(0.05 - 0.04)
    assert found["chi"]["end_error"] == 0.0
    del angles["gamma_given"]
    assert metrics.measures(run_of(0.0 * T, error, **angles))["gamma"][
        "end_error"
    ] == pytest.approx(0.06)


def test_the_end_begins_with_the_last_change_of_a_reference_in_the_last_quarter():
    """Six of eight seconds begin the last quarter, and the path angle changes after seven."""
    late, early = 0.5 * (np.arange(9) >= 7), 0.5 * (np.arange(9) >= 2)
    error = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 9.0, -0.9, 0.4, 0.2])
    t, columns = level_columns(
        9, gamma_ref=late, gamma_err=error, chi_ref=early, chi_err=error, V_ref=25.0 + late,
        V_err=-error, n_x_cmd=0.0, n_x_limited=0.0,
    )  # fmt: skip

    found = metrics.measures_of(t, columns, {})
    given = metrics.measures_of(t, columns | {"gamma_given": late - 0.01 * np.arange(9)}, {})

    assert found["gamma"]["end_error"] == pytest.approx((0.4 + 0.2) / 2.0)
    assert found["V"]["end_error"] == pytest.approx((0.4 + 0.2) / 2.0)
    assert found["gamma"]["end_allowed"] == pytest.approx(0.2 * 0.5)
    assert found["chi"]["end_error"] == pytest.approx((0.9 - 0.4 - 0.2) / 3.0)
    assert given["gamma"]["end_error"] == pytest.approx((0.4 - 0.07 + 0.2 - 0.08) / 2.0)


def test_effort_and_time_at_limits_are_those_of_the_command():
    phi_limited = np.where(T < 3.0, 2.0, np.where(T < 4.5, 1.0, 0.0))
    run = run_of(
        np.cos(T),
        phi_cmd=0.2 * np.sin(math.tau * T),
        phi_limited=phi_limited,
        gamma_ref=0 * T + 0.5,
    )
    found = ft.loop.channel_metrics(run)

    assert found.at["chi", "effort_rms"] == pytest.approx(0.2 / math.sqrt(2.0), rel=1e-4)
    assert found.at["gamma", "effort_rms"] == pytest.approx(1.0 - math.cos(0.5), rel=1e-9)
    assert found.at["chi", "saturation_s"] == pytest.approx(4.5, abs=SAMPLING)
    assert found.at["gamma", "saturation_s"] == 0.0


def test_flight_metrics_are_the_extremes():
    run = run_of(np.cos(T), V_a=25.0 - np.sin(T), alpha=-0.2 * np.sin(T), n_z=1.0 + 0.5 * np.sin(T))
    found = ft.loop.flight_metrics(run)

    assert "alpha_max_rad" not in ft.loop.flight_metrics(run_of(np.cos(T)))
    assert found["V_a_dev_mps"] == pytest.approx(1.0, abs=1e-6)
    assert found["alpha_max_rad"] == pytest.approx(0.2, abs=1e-6)
    assert (found["n_z_min"], found["n_z_max"]) == pytest.approx((0.5, 1.5), abs=1e-6)


def test_a_run_of_one_sample_has_no_measures():
    run = run_of(np.cos(T))

    assert metrics.measures(dataclasses.replace(run, signals=run.signals.iloc[:1])) == {}


@pytest.mark.parametrize(
    ("subject", "name", "unit"),
    [
        ("chi", "ITAE", "rad s^2"), ("gamma", "ITAE_mean", "rad s"), ("chi", "MO_rad", "rad"),
        ("chi", "effort_rms", "rad"), ("gamma", "effort_rms", "1"), ("V", "effort_rms", "1"),
        ("V", "ITAE", "m/s s^2"), ("V", "MS_mps", "m/s"), ("V", "PT_s", "s"),
        ("flight", "n_z_min", "1"), ("flight", "n_z_max", "1"), ("flight", "cross_track_m", "m"),
        ("flight", "alpha_max_rad", "rad"), ("chi", "error within 2 deg", "1"),
        ("chi", "settling_s within 5 deg", "s"),
    ],
)  # fmt: skip
def test_a_measure_has_the_unit_of_its_definition(subject, name, unit):
    assert metrics.unit_of(subject, name) == unit


def level_columns(samples, **signals):
    """Signals of a level flight, a sample a second."""
    level = dict.fromkeys(("chi_err", "gamma_err", "chi_ref", "gamma_ref"), 0.0)
    level |= dict.fromkeys(("phi_cmd", "phi_limited", "n_z_limited"), 0.0)
    level |= {"n_z_cmd": 1.0, "n_z": 1.0, "V_a": 25.0}
    t = np.arange(float(samples))
    return t, {name: np.broadcast_to(x, t.shape) * 1.0 for name, x in (level | signals).items()}


def test_measures_of_an_airspeed_are_those_by_hand():
    """2 m/s more are asked for from 2 s on, in a climb of 0.1 rad."""
    err = [0.0, 0.5, 2.0, 1.0, 0.0, -0.5, -0.2, 0.3, 0.3]
    t, columns = level_columns(
        9, gamma_ref=0.1, V_err=err, V_ref=25.0 + 2.0 * (np.arange(9) >= 2), V_a=24.0 - np.abs(err),
        n_x_cmd=math.sin(0.1) + 0.2, n_x_limited=[0, 0, 2, 1, 0, 0, 0, 0, 0],
    )  # fmt: skip

    found = metrics.measures_of(t, columns, {})["V"]

    # the trapezoidal rule of t |e|: its ends count half, and the first is zero
    itae = 0.5 + 4.0 + 3.0 + 2.5 + 1.2 + 2.1 + 2.4 / 2.0
    assert found == pytest.approx(
        {
            "ITAE": itae, "ITAE_mean": itae / 8.0, "MO_mps": 0.5, "PT_s": 3.0,
            # 90 % of 2 m/s are passed after 0.2 s, 10 % in the second second
            "rise_s": 1.8 - 0.2, "settling_s": math.nan, "effort_rms": 0.2, "saturation_s": 2.0,
            "MS_mps": (-0.2 + 0.3 + 0.3) / 3.0, "ST_mps": np.std([-0.2, 0.3, 0.3]),
            "peak_mps": 2.0, "min_mps": 22.0, "end_error": 0.4 / 3.0, "end_allowed": 0.4,
        },
        nan_ok=True,
    )  # fmt: skip


def test_the_end_is_judged_by_the_change_but_along_no_route_and_of_no_steady_airspeed():
    t, columns = level_columns(
        5, chi_err=0.01, V_err=0.0, V_ref=25.0, n_x_cmd=0.0, n_x_limited=0.0, gamma_err=-0.3,
    )  # fmt: skip

    found = metrics.measures_of(t, columns, {})
    on_route = metrics.measures_of(t, columns | {"cross_track": np.array([0, 1, -7, 2, 0.0])}, {})

    # a fifth of the change, at least a degree; a start beside the reference is a change
    assert found["chi"]["end_allowed"] == pytest.approx(math.radians(1.0))
    assert found["chi"]["end_error"] == pytest.approx(0.01)
    assert found["gamma"]["end_allowed"] == pytest.approx(0.2 * 0.3)
    assert found["gamma"]["end_error"] == pytest.approx(0.3)
    assert "end_error" not in found["V"]
    assert all("end_error" not in measured for measured in on_route.values())
    assert on_route["flight"]["cross_track_m"] == 7.0
    assert math.isnan(on_route["gamma"]["settling_s"])
    assert math.isnan(on_route["chi"]["settling_s"])


@pytest.mark.parametrize(
    ("limited", "command", "unlimited", "held"),
    [
        # The last quarter of 16 samples begins at 11.25 s and has four.
        ([1, 1, 0, 0], [1, 1, 1, 1], [2, 2, 2, 2], None),
        ([1, 1, 1, 0], [1, 1, 1, 1], [2, 2, 2, 2], (0.75, 0.0, 0.0)),
        ([1, 1, 1, 1], [1, 0, 1, 0], [2, -1, 2, -1], (1.0, 0.0, 3.0)),
        # A rate limit is on the side of the motion, whatever is wanted.
        ([2, 2, 2, 0], [1, 2, 1, 1], [9, 9, 9, 9], (0.0, 0.75, 1.0)),
        ([2, 1, 2, 1], [1, 2, 1, 1], [0, 3, 9, 0], (0.5, 0.5, 1.0)),
        ([2, 2, 1, 1], [0, 0, 0, 0], [0, 0, 1, 1], (0.5, 0.5, 0.0)),  # at rest on neither side
    ],
)
def test_what_holds_a_command_in_the_last_quarter_is_counted(limited, command, unlimited, held):
    before = [0.0] * 12
    columns = {
        "phi_limited": np.array([*before, *limited]),
        "phi_cmd": np.array([*before, *command]),
        "phi_unlimited": np.array([*before, *unlimited]),
    }

    found = metrics.held_at_end(np.arange(16.0), columns, "phi")

    names = "held_magnitude", "held_rate", "swings"
    wanted = {} if held is None else dict(zip(names, held, strict=True))
    assert found == wanted | ({"swings_each": held[2] / 4.0} if held else {})


def test_shares_at_limits_are_those_of_each_kind_and_are_said():
    t, columns = level_columns(8, phi_limited=[1, 1, 2, 0, 0, 0, 2, 1], n_z_limited=2.0)
    run = made_up_run(columns, t)

    found = metrics.at_limits(run)

    # 5.25 s begin the last quarter: two samples
    assert found["phi"] == {
        "magnitude": 3 / 8, "rate": 2 / 8, "magnitude_end": 1 / 2, "rate_end": 1 / 2,
    }  # fmt: skip
    assert found["n_z"] == {"magnitude": 0.0, "rate": 1.0, "magnitude_end": 0.0, "rate_end": 1.0}
    assert "n_x" not in found
    held = {"held_magnitude": 0.25, "held_rate": 0.5, "swings": 3.0}
    assert metrics.limits_in_words({"chi": held, "gamma": held | {"held_rate": 0.0}, "V": {}}) == [
        "phi_cmd is at its magnitude limit in 25 % and at its rate limit in 50 % of the last "
        "quarter",
        "n_z_cmd is at its magnitude limit in 25 % of the last quarter",
    ]


def test_names_of_measures_that_only_requirements_use_hold_their_band_or_envelope():
    own = {"chi": {"settling_s": 4.0, "band_deg": 0.5}, "V": {"within": [[0, 3], [4, 1]]}}
    expect = [
        {"at_most": own},
        {"at_least": {"gamma": {"MO_deg": 1.0}}, "at_most": {"chi": {"settling_s": 9.0}}},
    ]

    names = metrics.required_names(expect)

    assert names["chi"] == ["settling_band_rad", "late_rad", "settling_s within 0.5 deg"]
    assert names["V"] == ["error within 3 m/s, 1 m/s from 4 s"]
    assert names["gamma"] == []
    assert metrics.settling_band("settling_s within 0.5 deg") == pytest.approx(math.radians(0.5))
    assert metrics.settling_band("settling_s") is None
    limits = {"settling_s": 4.0, "band_deg": 0.5, "ITAE": 2.0}
    assert metrics.stated_bounds("chi", limits) == {"settling_s within 0.5 deg": 4.0, "ITAE": 2.0}
    assert metrics.stated_bounds("V", own["V"]) == {"error within 3 m/s, 1 m/s from 4 s": 1.0}


def test_two_samples_are_enough_for_measures_of_a_run():
    t, columns = level_columns(2, V_err=0.0, V_ref=25.0, n_x_cmd=0.0, n_x_limited=0.0)
    run = made_up_run(columns, t)

    one = dataclasses.replace(run, signals=run.signals.iloc[:1])
    logged = made_up_run(columns, t, scenario={"log": {"checks": []}}, gains_name="flown")
    channels, flights = metrics.metric_tables([one, logged, run])

    assert (len(channels), len(flights)) == (2, 1)
    assert metrics.airspeed_metrics(run)["min_mps"] == 25.0
    assert metrics.measures(run)["V"]["min_mps"] == 25.0
    assert metrics.airspeed_metrics(one) == metrics.measures(logged) == {}
    without = dataclasses.replace(run, signals=run.signals.drop(columns="V_err"))
    assert metrics.airspeed_metrics(without) == {}
