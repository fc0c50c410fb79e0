"""Errors of the gyros and accelerometers that the inner loop of an aircraft reads."""

import math

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.units import G_0
from flighttune.vehicles.plants.navigation import GYRO_BIAS, Navigation

# Errors at a sample of the inner loop, measured minus true: body rates (rad/s), and specific forces
# over standard gravity.
GYROS = "p", "q", "r"
INERTIAL = *GYROS, "n_x", "n_y", "n_z"

# Cutoff of the second-order Butterworth filter in front of an inner loop, Hz: PX4's IMU_GYRO_CUTOFF
# is 40 and its IMU_ACCEL_CUTOFF 30, ArduPilot's INS_GYRO_FILTER and INS_ACCEL_FILTER are 20. At low
# rates it is lower, as a share of the rate.
CUTOFF_HZ, CUTOFF_SHARE = 30.0, 0.4

# Spawn key of the errors; each sensor has a stream of its own.
_STREAM = 0x6C05


def inertial_errors(navigation: Navigation, samples: int, rate: float) -> FloatArray:
    """`INERTIAL` at each of the samples, `rate` a second, shape (samples, 6).

    White noise of the densities of `navigation` behind the low-pass filter of an autopilot, from
    rest, and a constant bias: of the gyros as the estimator leaves it, of the accelerometers that
    of the load factor. A seed gives the same bits; the errors of a longer flight begin with those
    of a shorter one.
    """
    from scipy.signal import butter, lfilter

    level, _ = navigation.axes(1.0 / rate)
    gyro_bias = math.sqrt(level.covariance[GYRO_BIAS, GYRO_BIAS])
    b, a = butter(2, min(CUTOFF_HZ, CUTOFF_SHARE * rate), fs=rate)
    errors = np.empty((samples, len(INERTIAL)))
    for j, name in enumerate(INERTIAL):
        rng = np.random.default_rng(np.random.SeedSequence(navigation.seed, spawn_key=(_STREAM, j)))
        if name in GYROS:
            density, bias = navigation.gyro_noise, gyro_bias
        else:
            density, bias = navigation.accelerometer_noise / G_0, navigation.n_z_bias_sd
        constant = bias * rng.standard_normal()
        white = density * math.sqrt(rate) * rng.standard_normal(samples)
        errors[:, j] = lfilter(b, a, white) + constant
    return errors
