"""Measures of responses that are known in closed form or counted by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import made_up_run, made_up_scenario

import flighttune as ft

SAMPLING = 2e-3
T = np.linspace(0.0, 20.0, 20_001)
LAG = 0.7
LATER = np.clip(T - 3.0, 0.0, None)
STEP = (T >= 3.0).astype(float)
IN_LEVEL = dict.fromkeys(("chi_ref", "gamma_ref", "chi_err", "gamma_err", "phi_cmd"), 0.0)
IN_LEVEL |= {"phi_limited": 0.0, "n_z_limited": 0.0, "n_z_cmd": 1.0, "n_z": 1.0, "V_a": 25.0}
FASTER = {"V_err": 0.0, "V_ref": 25.0, "n_x_cmd": 0.0, "n_x_limited": 0.0}


def run_of(t=T, **columns):
    return made_up_run(IN_LEVEL | columns, t)


def flown(run, *expect):
    """The flights of a scenario that flew this run alone."""
    speed = {"reference": {"V_mps": 25.0}, "limits": {"n_x": [-0.3, 0.3]}, "gains": ["tuned"]}
    airspeed = speed | {"plant": [{"kind": "point_mass"}]} if "V_err" in run.signals else {}
    scenario = made_up_scenario(expect=[*expect], **airspeed)
    made_by = replace(run.provenance, scenario=scenario.as_dict())
    return ft.FlownScenario(
        scenario=scenario, runs=(replace(run, provenance=made_by),), indicators={}
    )


def measured(t=T, **columns):
    run = run_of(t, **columns)
    return flown(run).metrics_of(run)


def value(run, sense, subject, **bound):
    """The value that a bound is held against, and why it has none."""
    (check, *_) = flown(run, {sense: {subject: bound}}).claim.bounds
    return check


def second_order(damping, omega, t=T):
    """Error of a unit step of a second-order lag, which starts at -1 and overshoots."""
    damped = omega * math.sqrt(1.0 - damping**2)
    decay = np.exp(-damping * omega * t)
    return -decay * (np.cos(damped * t) + damping * omega / damped * np.sin(damped * t))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_overshoot_and_peak_time_are_those_of_the_textbook_of_angles_and_airspeed(sign):
    damping, omega = 0.3, 1.2
    late = second_order(damping, omega, LATER) * STEP
    speed = FASTER | {"V_err": sign * late, "V_ref": 25.0 - sign * STEP}

    found = measured(chi_err=sign * second_order(damping, omega), **speed)

    root = math.sqrt(1.0 - damping**2)
    for subject, unit in (("chi", "rad"), ("V", "mps")):
        most = math.exp(-math.pi * damping / root)
        assert found[subject][f"MO_{unit}"] == pytest.approx(most, abs=1e-6)
        assert found[subject]["PT_s"] == pytest.approx(math.pi / (omega * root), abs=SAMPLING)
    assert found["V"]["rise_s"] == pytest.approx(found["chi"]["rise_s"], abs=SAMPLING)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_response_that_overshoots_within_a_sample_is_judged_by_the_side_it_came_from(sign):
    error = sign * np.array([1.0, -0.5, -0.25, 0.125, 0.0])

    found = measured(np.linspace(0.0, 0.4, 5), gamma_err=error)["gamma"]

    assert (found["PT_s"], found["MO_rad"]) == (pytest.approx(0.1), 0.5)
    # the line from 1 to -0.5 passes 0.9 and 0.1 a fifteenth and nine fifteenths on its way
    assert found["rise_s"] == pytest.approx(0.1 * (0.9 - 0.1) / 1.5)


def test_an_exponential_has_the_integrals_and_times_of_its_formula():
    rate = 0.8
    found = ft.loop.channel_metrics(run_of(chi_err=np.exp(-rate * T))).loc["chi"]

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


def lagged(t, lag=LAG):
    """Error of a first-order lag to a unit step of its reference at t = 0."""
    return np.where(t < 0.0, 0.0, np.exp(-t / lag))


def rising(t, lag, lasting=3.0):
    """Error of a first-order lag to a reference that rises by 1 in a time."""
    rises = np.clip(t, 0.0, lasting), np.maximum(t - lasting, 0.0)
    return lag / lasting * (1.0 - np.exp(-rises[0] / lag)) * np.exp(-rises[1] / lag)


# Reference, error in closed form, and the time in which it settles.
SETTLED = {
    "a step in mid-flight": (1.0 * (T >= 5.0), lagged(T - 5.0), math.log(20.0) * LAG),
    "a ramp, from its end": (
        np.clip((T - 2.0) / 3.0, 0.0, 1.0),
        rising(T - 2.0, LAG),
        LAG * math.log(20.0 * LAG / 3.0 * (1.0 - math.exp(-3.0 / LAG))),
    ),
    "a ramp that is followed": (np.clip((T - 2.0) / 3.0, 0.0, 1.0), rising(T - 2.0, 0.1), 0.0),
    "no end of a ramp": (T / 20.0, rising(T, 0.1, 20.0), 0.0),
    "a start beside the reference": (0.0 * T, lagged(T), math.log(20.0) * LAG),
    "two steps, the first settles later": (
        1.0 * (T >= 2.0) + (T >= 10.0),
        lagged(T - 2.0) + lagged(T - 10.0, 0.2),
        math.log(10.0) * LAG,
    ),
    "a step before it has settled": (
        (T >= 2.0) - 1.0 * (T >= 3.0),
        lagged(T - 2.0) - lagged(T - 3.0),
        math.log(20.0 * (1.0 - math.exp(-1.0 / LAG))) * LAG,
    ),
    "no change": (0.0 * T, math.radians(0.004) * np.sin(T), 0.0),
    "no change, and an error": (0.0 * T, math.radians(0.006) * np.sin(T), math.nan),
    "a step that is never reached": (1.0 * (T >= 5.0), 0.06 * (T >= 5.0), math.nan),
}


@pytest.mark.parametrize(("ref", "error", "settled"), SETTLED.values(), ids=SETTLED)
def test_settling_counts_from_the_end_of_a_change_to_5_percent_of_it(ref, error, settled):
    found = measured(chi_ref=ref, chi_err=error)["chi"]["settling_s"]

    assert found == pytest.approx(settled, abs=SAMPLING, nan_ok=True)


def test_measures_of_a_few_samples_are_those_by_hand():
    """The flight starts at 0.4, beside a reference of 0 that goes to 1 and to 0.5."""
    t = np.array([0.0, 1.0, 3.0, 6.0, 10.0, 15.0, 16.0])
    run = run_of(
        t,
        chi_ref=[0.0, 0.0, 0.0, 1.0, 1.0, 0.5, 0.5],
        chi_err=[-0.4, -0.2, 0.0, 0.5, 0.0, -0.1, 0.0],
        phi_limited=[2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0],
    )
    found = flown(run).metrics_of(run)["chi"]

    assert found["saturation_s"] == 1.0 + 4.0
    # the start settles in 3 s, the first change in 4 s, and the second in 1 s
    assert found["settling_s"] == 4.0
    assert value(run, "at_most", "chi", peak_deg=9.0).value == pytest.approx(math.degrees(0.5))


def test_settling_within_a_band_of_its_own_is_the_last_time_an_error_leaves_it():
    settles = run_of(chi_err=-np.exp(-0.8 * T))
    swings = run_of(chi_err=np.deg2rad(6.0) * np.cos(math.tau * T))
    band = {"settling_s": 9.0, "band_deg": 5.0}

    found, never = (value(run, "at_most", "chi", **band) for run in (settles, swings))

    assert found.value == pytest.approx(math.log(1.0 / math.radians(5.0)) / 0.8, abs=SAMPLING)
    assert math.isnan(never.value)
    assert "reach 6 deg" in never.why


RAMP = {"chi_ref": np.clip(T - 3.0, 0.0, 5.0)}
ENVELOPES = [
    # The error is largest at the change, then as the bounds of 2 and 6 s after it begin.
    ("chi", [[0, 90], [2, 8], [6, 1]], np.deg2rad(60.0 * STEP * np.exp(-0.8 * LATER)),
     {"chi_ref": np.deg2rad(60.0 * STEP)}, 60.0 * math.exp(-1.6) / 8.0),
    ("gamma", [[0, 90], [1, 0.2]], np.deg2rad(1.0 - STEP), {"gamma_ref": 0.1 * STEP}, 5.0),
    # While a ramp lasts, the first bound holds: its error is 2 deg, its end at 8 s.
    ("chi", [[0, 4], [1.5, 1]], np.deg2rad(2.0) * ((T > 3.0) & (T < 9.0)), RAMP, 0.5),
    ("V", [[0, 3], [4, 0.1]], 2.0 * STEP * np.exp(-0.8 * LATER),
     FASTER | {"V_ref": 20.0 + 2.0 * STEP}, 20.0 * math.exp(-3.2)),
    # On a route all count from the start, whatever its guidance commands.
    ("chi", [[0, 90], [5, 0.5]], np.deg2rad(1.0), {"chi_ref": 0.1 * T, "cross_track": 0.0}, 2.0),
]  # fmt: skip


@pytest.mark.parametrize(("subject", "within", "error", "more", "ratio"), ENVELOPES)
def test_an_error_is_held_against_its_envelope_by_its_largest_ratio(
    subject, within, error, more, ratio
):
    check = value(run_of(**more | {f"{subject}_err": error}), "at_most", subject, within=within)

    assert check.value == pytest.approx(ratio, rel=2.0 * SAMPLING)
    assert check.met == (ratio <= 1.0)


def test_what_does_not_happen_has_no_time():
    swinging, still = ft.loop.channel_metrics(run_of(chi_err=np.cos(T))).loc[["chi", "gamma"]].iloc

    assert math.isnan(swinging["settling_s"])
    assert still["MO_rad"] == 0.0
    assert still[["PT_s", "rise_s"]].isna().all()


def test_effort_and_time_at_limits_are_those_of_the_command():
    limited = np.where(T < 3.0, 2.0, np.where(T < 4.5, 1.0, 0.0))
    found = measured(phi_cmd=0.2 * np.sin(math.tau * T), phi_limited=limited, gamma_ref=0 * T + 0.5)

    assert found["chi"]["effort_rms"] == pytest.approx(0.2 / math.sqrt(2.0), rel=1e-4)
    assert found["gamma"]["effort_rms"] == pytest.approx(1.0 - math.cos(0.5), rel=1e-9)
    assert found["chi"]["saturation_s"] == pytest.approx(4.5, abs=SAMPLING)
    assert found["gamma"]["saturation_s"] == 0.0


def test_flight_metrics_are_the_extremes():
    swing = {"V_a": 25.0 - np.sin(T), "alpha": -0.2 * np.sin(T), "n_z": 1.0 + 0.5 * np.sin(T)}
    found = ft.loop.flight_metrics(run_of(**swing, cross_track=-7.0 * np.cos(T), height_err=0.5))

    assert "alpha_max_rad" not in ft.loop.flight_metrics(run_of())
    expected = {"V_a_dev_mps": 1.0, "alpha_max_rad": 0.2, "n_z_min": 0.5, "n_z_max": 1.5}
    assert found == pytest.approx(expected | {"cross_track_m": 7.0, "height_err_m": 0.5}, abs=1e-6)


def test_measures_of_an_airspeed_are_those_by_hand():
    """2 m/s more are asked for from 2 s on, in a climb of 0.1 rad."""
    t, error = np.arange(9.0), np.array([0.0, 0.5, 2.0, 1.0, 0.0, -0.5, -0.2, 0.3, 0.3])
    found = measured(
        t, gamma_ref=0.1, V_err=error, V_ref=25.0 + 2.0 * (t >= 2), V_a=24.0 - np.abs(error),
        n_x_cmd=math.sin(0.1) + 0.2, n_x_limited=[0, 0, 2, 1, 0, 0, 0, 0, 0],
    )["V"]  # fmt: skip

    # the trapezoidal rule of t |e|: its ends count half, and the first is zero
    itae = 0.5 + 4.0 + 3.0 + 2.5 + 1.2 + 2.1 + 2.4 / 2.0
    expected = {
        "ITAE": itae, "ITAE_mean": itae / 8.0, "MO_mps": 0.5, "PT_s": 3.0,
        # 90 % of 2 m/s are passed after 0.2 s, 10 % in the second second
        "rise_s": 1.8 - 0.2, "settling_s": math.nan, "effort_rms": 0.2, "saturation_s": 2.0,
        "MS_mps": (-0.2 + 0.3 + 0.3) / 3.0, "ST_mps": np.std([-0.2, 0.3, 0.3]),
        "peak_mps": 2.0, "min_mps": 22.0,
    }  # fmt: skip
    assert {name: found[name] for name in expected} == pytest.approx(expected, nan_ok=True)


# The last quarter of 16 samples begins at 11.25 s and has four.
@pytest.mark.parametrize(
    ("limited", "command", "unlimited", "magnitude", "rate", "swings"),
    [
        ([1, 1, 0, 0], [1, 1, 1, 1], [2, 2, 2, 2], 0.5, 0.0, False),
        ([1, 1, 1, 0], [1, 1, 1, 1], [2, 2, 2, 2], 0.75, 0.0, False),
        ([1, 1, 1, 1], [1, 0, 1, 0], [2, -1, 2, -1], 1.0, 0.0, True),
        # A rate limit is on the side of the motion, whatever is wanted.
        ([2, 2, 2, 0], [1, 2, 1, 1], [9, 9, 9, 9], 0.0, 0.75, False),
        ([2, 1, 2, 1], [1, 2, 1, 2], [0, 3, 0, 3], 0.5, 0.5, False),
        ([2, 2, 1, 1], [0, 0, 0, 0], [0, 0, 1, 1], 0.5, 0.5, False),  # at rest on neither side
    ],
)
def test_what_holds_a_command_in_the_last_quarter_is_counted_and_said(
    limited, command, unlimited, magnitude, rate, swings
):
    before = [0.0] * 12
    columns = {"phi_limited": limited, "phi_cmd": command, "phi_unlimited": unlimited}
    run = run_of(np.arange(16.0), **{name: [*before, *x] for name, x in columns.items()})

    found = flown(run, {"at_most": {"chi": {"peak_deg": 90.0}}})

    (told,) = found.answer().values["runs"]
    shares = told["at_limits"]["phi"]
    assert (shares["magnitude_end"], shares["rate_end"]) == (magnitude, rate)
    assert (shares["magnitude"], shares["rate"]) == (magnitude / 4.0, rate / 4.0)
    assert any("phi_cmd swings" in x for x in found.claim.missed) == swings
    assert len(found.claim.held) == (magnitude + rate > 0.5 and not swings)
    for share in (magnitude, rate):
        assert not found.claim.held or not share or f"{100 * share:.0f} %" in found.claim.held[0]


def test_a_run_of_one_sample_and_a_log_have_no_measures():
    run = run_of(np.arange(2.0), **FASTER)
    (one, log) = (
        made_up_run(IN_LEVEL | FASTER, np.arange(n), scenario=of, gains_name="other")
        for n, of in ((1.0, {}), (2.0, {"log": {"file": "flight.ulg", "checks": []}}))
    )
    found = ft.FlownScenario(scenario=made_up_scenario(), runs=(one, log, run), indicators={})

    assert {*found.flight.index} == {run.label}
    assert {*found.metrics.index.get_level_values("run")} == {run.label}
    assert found.metrics_of(one) == found.metrics_of(log) == {}
    assert found.metrics_of(run)["V"]["min_mps"] == 25.0


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_measures_scale_with_the_error_and_with_time(factor):
    """Angles by the factor of the error, times by that of the time, ITAE by both, squared."""
    t = np.linspace(0.0, 20.0, 2001)
    error = second_order(0.4, 0.9, t)
    plain = measured(t, chi_err=error)["chi"]

    larger = measured(t, chi_err=0.5 * error)["chi"]
    slower = measured(factor * t, chi_err=error)["chi"]

    angles, times = ("MO_rad", "MS_rad", "ST_rad"), ("PT_s", "rise_s", "settling_s")
    for name in angles:
        assert larger[name] == pytest.approx(0.5 * plain[name])
        assert slower[name] == pytest.approx(plain[name])
    for name in times:
        assert larger[name] == pytest.approx(plain[name])
        assert slower[name] == pytest.approx(factor * plain[name])
    assert larger["ITAE"] == pytest.approx(0.5 * plain["ITAE"])
    assert slower["ITAE"] == pytest.approx(factor**2 * plain["ITAE"])
    assert slower["ITAE_mean"] == pytest.approx(factor * plain["ITAE_mean"])
