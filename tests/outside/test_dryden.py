"""Turbulence against the Dryden spectra that MIL-F-8785C prints, averaged over many seeds."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import periodogram

import flighttune as ft
from flighttune.vehicles.plants import weather
from flighttune.vehicles.plants.jsbsim.air import weather_step
from flighttune.vehicles.plants.jsbsim.fdm import Fdm
from flighttune.vehicles.plants.jsbsim.trim import trim

FPS = 0.3048
V_A = 200.0
SEEDS, SAMPLES, RATE = 100, 8192, 50.0
SPIN_UP = 1024
"""Samples left out: the filters begin at rest; a correlation lasts 130 at most."""

BANDS = np.geomspace(0.1, 10.0, 11)
"""Rad/s, two decades about the corner at V/L = 0.4 to 1.3 rad/s."""

NEAR = 0.10
STANDARD_ERRORS = 3.0

WIND_20FT = 30.0
LOW, BETWEEN, HIGH = 500.0, 1500.0, 3000.0
"""Heights in ft: below 1000 ft the standard goes by height and the wind 20 ft above ground, above
2000 ft by the curve of a severity (sections 3.7.2 and 3.7.3, Figs. 7, 10 and 11), between them by a
straight line.
"""

SHAPE = 0.177 + 0.000823 * LOW
AT_1000, AT_2000, AT_3000 = (
    0.1 * WIND_20FT,
    *np.interp([2000.0, HIGH], [1750.0, 3750.0], [6.9, 7.4]).tolist(),
)
"""Curve 3 of Fig. 7: 6.9 ft/s at 1750 ft, 7.4 ft/s at 3750 ft."""

AIR = {
    LOW: (LOW / SHAPE**1.2, LOW, AT_1000 / SHAPE**0.4, AT_1000),
    BETWEEN: (1375.0, 1375.0, 0.5 * (AT_1000 + AT_2000), 0.5 * (AT_1000 + AT_2000)),
    HIGH: (1750.0, 1750.0, AT_3000, AT_3000),
}
"""L_u, L_w in ft and sigma_u, sigma_w in ft/s."""


def along(omega, L, sigma):
    """One-sided spectrum of the gusts along the flight, over angular frequency."""
    return sigma**2 * 2.0 * L / (math.pi * V_A) / (1.0 + (L * omega / V_A) ** 2)


def across(omega, L, sigma):
    """That of the gusts across it."""
    x = (L * omega / V_A) ** 2
    return sigma**2 * L / (math.pi * V_A) * (1.0 + 3.0 * x) / (1.0 + x) ** 2


def gusts(h):
    """Turbulence met by an aircraft that is held where it is: (seeds, samples, 3), m/s."""
    config = ft.loop.JSBSimPlant("a4").config.model_copy(update={"inner_loop_rate": RATE})
    fdm = Fdm(config)
    trim(fdm, ft.loop.FlightCondition(V_a=V_A, h=h * FPS))
    for write, _ in fdm.integrators.values():
        write(0.0)
    turbulence = weather.Turbulence(severity=3, wind_20ft=WIND_20FT * FPS)
    step = weather_step(fdm, weather.Weather(turbulence=turbulence), RATE)
    seed = fdm.writer("simulation/randomseed")
    axes = [fdm.reader(f"atmosphere/total-wind-{axis}-fps") for axis in ("north", "east", "down")]
    found = np.empty((SEEDS, SAMPLES, 3))
    for i in range(SEEDS):
        seed(float(i + 1))
        for k in range(-SPIN_UP, SAMPLES):
            step()
            if k >= 0:
                found[i, k] = [read() * FPS for read in axes]
    return found


@pytest.mark.counts
@pytest.mark.parametrize("h", AIR)
def test_the_spectra_of_turbulence_are_drydens_over_two_decades(h):
    L_u, L_w, sigma_u, sigma_w = (value * FPS for value in AIR[h])
    found = gusts(h)
    frequency, power = periodogram(found, fs=RATE, window="hann", axis=1)
    omega, density = 2.0 * math.pi * frequency, power / (2.0 * math.pi)
    spectra = along(omega, L_u, sigma_u), across(omega, L_u, sigma_u), across(omega, L_w, sigma_w)

    for low, high in pairwise(BANDS):
        band = (low <= omega) & (omega < high)
        for axis, spectrum in enumerate(spectra):
            of_seeds = density[:, band, axis].mean(axis=1)
            error = of_seeds.std() / math.sqrt(SEEDS)
            expected = spectrum[band].mean()
            near = max(NEAR * expected, STANDARD_ERRORS * error)
            assert of_seeds.mean() == pytest.approx(expected, abs=near), (low, axis)
