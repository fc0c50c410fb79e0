"""Errors of the gyros and accelerometers that the inner loop reads, and flights with them."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import flighttune as ft
from flighttune.vehicles.plants.inertial import inertial_errors

RATE, G = 200.0, 9.80665
GYRO, ACCELEROMETER = math.radians(0.05), 0.03 / G  # of a standard unit, per root Hz
FOUR_SIGMA = 4.0


def standard(seed=0, **numbers):
    return ft.loop.Navigation.of("standard", seed=seed, inner_loop=True, **numbers)


def filtered_sd(density, rate, cutoff):
    """Deviation of white noise behind a Butterworth filter that is made digital bilinearly."""

    def passed(f):
        return 1.0 / (1.0 + (math.tan(math.pi * f / rate) / math.tan(math.pi * cutoff / rate)) ** 4)

    return density * math.sqrt(2.0 * quad(passed, 0.0, rate / 2.0)[0])


@pytest.mark.parametrize(("rate", "cutoff"), [(RATE, 30.0), (50.0, 20.0)])
def test_noise_is_white_noise_behind_the_filter_of_an_autopilot(rate, cutoff):
    n = 30_000
    drawn = inertial_errors(standard(), n, rate)

    expected = [filtered_sd(x, rate, cutoff) for x in [GYRO] * 3 + [ACCELEROMETER] * 3]
    # Neighbours are alike, so of the samples about a fifth count.
    assert drawn.std(axis=0) == pytest.approx(expected, rel=FOUR_SIGMA / math.sqrt(2.0 * n / 5))


@pytest.mark.slow
def test_biases_have_their_deviations():
    """Of the gyros what a Kalman filter with EKF2's gains leaves of their random walk."""
    means = np.array(
        [inertial_errors(standard(seed), 800, RATE).mean(axis=0) for seed in range(100)]
    )

    sd = means.std(axis=0)
    within = FOUR_SIGMA / math.sqrt(2.0 * len(means))
    noise = filtered_sd(ACCELEROMETER, RATE, 30.0) / math.sqrt(800 / 5)
    assert sd[3:] == pytest.approx([math.hypot(0.011, noise)] * 3, rel=within)
    assert (np.abs(means.mean(axis=0)) < FOUR_SIGMA * sd / math.sqrt(len(means))).all()
    assert (sd[:3] < math.radians(0.1)).all()


def test_errors_are_a_function_of_their_seed_and_a_longer_flight_begins_as_a_shorter_one():
    long = inertial_errors(standard(4), 1000, RATE)

    for samples in (1, 7, 333):
        assert np.array_equal(inertial_errors(standard(4), samples, RATE), long[:samples])
    louder = inertial_errors(standard(4, n_z_bias_sd=0.2), 1000, RATE)
    assert np.array_equal(louder[:, :3], long[:, :3])
    assert not np.any(long == inertial_errors(standard(5), 1000, RATE))
    assert len({*long[500]}) == 6


FED = {
    "name": "fed", "law": "exact", "K_P": [[2.87, 0.0], [0.0, 2.51]],
    "K_I": [[1.16, 0.0], [0.0, 0.948]], "feedback": [0.43, 0.306],
}  # fmt: skip


def flown(navigation, rate_hz=50.0):
    made = ft.load_scenario("level_turn").as_dict()
    made["plant"] = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    made |= {"law": "exact", "gains": [FED], "expect": [], "navigation": navigation}
    made["controller"] = made.get("controller", {}) | {"rate_hz": rate_hz}
    (run,) = ft.fly(ft.scenario_from(made)).runs
    assert run.status == "completed", run.reason
    return run.signals


def busy(signals, name):
    """Root mean square of the rate of a signal."""
    return math.sqrt(float(np.mean(np.square(np.diff(signals[name]) / np.diff(signals.index)))))


@pytest.mark.slow
@pytest.mark.parametrize("rate_hz", [50.0, pytest.param(400.0, marks=pytest.mark.soak)])
def test_elevator_and_rudder_are_busier_and_the_path_is_the_same(rate_hz):
    """At 400 Hz JSBSim makes two steps in a sample of the inner loop, with one error."""
    steady, shaken = flown({}, rate_hz), flown({"inner_loop": True}, rate_hz)

    for name in ("elevator", "rudder"):
        assert busy(shaken, name) > 1.5 * busy(steady, name)
    assert np.abs(shaken["chi"] - steady["chi"]).max() < math.radians(0.5)


def test_a_plant_without_an_inner_loop_is_refused():
    made = ft.load_scenario("circuit").as_dict() | {"navigation": {"inner_loop": True}}
    made["plant"] = [{"kind": "point_mass"}]
    made["expect"] = []

    with pytest.raises(
        ft.ScenarioError, match=r"`inner_loop` of \[navigation\] must be absent without"
    ):
        ft.scenario_from(made)
