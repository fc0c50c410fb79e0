"""Numbers printed in the paper, and the few assumed numbers that it does not print.

Printed numbers come from arXiv 2411.13140; a name tells the table or figure. Figures, tables and
equations are numbered as in its PDF.
"""

import math
from dataclasses import replace
from itertools import product

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.control.limits import Limits
from flighttune.flight.loop.disturbance import Sinusoid

# Table 1: airspeed in m/s and acceleration of gravity in m/s^2.
V_A, G = 25.0, 9.81

# Table 1: start. The printed roll lies outside the printed range of roll.
CHI_0, GAMMA_0, PHI_0, N_Z_0 = math.pi / 3, math.pi / 4, math.pi / 3, 1.0

# Table 1: references, rad.
CHI_C, GAMMA_C = 0.0, math.pi / 12

# Table 1: simulated time, s.
DURATION = 20.0

# Section 4.4: time over which the first error is integrated for the input constraints, s.
OPTIMISATION_DT = 0.1

# Error at the start, rad.
E_0 = np.array([CHI_C - CHI_0, GAMMA_C - GAMMA_0])

# Table 2: R_K and I_K as printed.
TABLE_2: dict[str, tuple[float, float]] = {
    "K1": (0.7742, 7.873),
    "K2": (0.6754, 6.057),
    "K3": (0.5913, 5.312),
    "K4": (0.3626, 5.207),
    "K5": (0.2849, 6.161),
    "K6": (0.2192, 8.258),
}

# Name of the printed optimum among the families.
STAR = "K*"

# R_K and I_K as printed: the rows of Table 2, and the line below K* of section 5.2.
INDICATORS = {**TABLE_2, STAR: (0.4427, 4.9244)}

# Section 5.2.1: stated bounds on the overshoots, rad, and their times, s.
LARGEST_OVERSHOOT = {"chi": 0.8, "gamma": 0.4}
LARGEST_PEAK_TIME = 4.0

# Table 3: amplitude L_d in rad/s and angular frequency omega_d in rad/s of both channels.
TABLE_3: dict[str, tuple[float, float]] = {
    f"d{k}": pair for k, pair in enumerate(product((0.1, 0.2, 0.3), (0.1, 0.15, 0.2)), start=1)
}

# The disturbance of Table 1 is this one of Table 3.
PRINTED_DISTURBANCE = "d2"

# Assumed: duration of the d family, s, because the text discusses the time after 20 s.
AFTERWARDS = 40.0

# Assumed: bound on I_K of the optimisation model; the printed optimum must satisfy it.
I_STAR = INDICATORS[STAR][1]


def last_digits(name: str) -> FloatArray:
    """One unit of the last printed digit of R_K and of I_K of a gain set."""
    return np.array([1e-4, 1e-4 if name == STAR else 1e-3])


def printed_limits() -> Limits:
    """Ranges of roll and load factor, and of their rates, of Table 1."""
    return Limits(
        lower=np.array([-math.pi / 4, -2.1]),
        upper=np.array([math.pi / 4, 2.1]),
        rate_lower=np.array([-math.pi / 6, -1.0]),
        rate_upper=np.array([math.pi / 6, 1.0]),
    )


def printed_ranges() -> Limits:
    """The ranges of Table 1 without the limits on the rates."""
    limits = printed_limits()
    return replace(Limits.none(2), lower=limits.lower, upper=limits.upper)


def disturbance(name: str) -> Sinusoid:
    """One of the disturbances ``d1`` to ``d9`` of Table 3."""
    L_d, omega = TABLE_3[name]
    return Sinusoid(chi_amplitude=L_d, chi_omega=omega, gamma_amplitude=L_d, gamma_omega=omega)


# Figure 1 (a): the oscillator.
DUFFING_A = {"alpha": 0.5, "beta": 0.25, "delta": 1.5}

# Figure 1 (a): bound on the disturbance.
DUFFING_L_D = 2.5

# Assumed start of the oscillator.
DUFFING_X_0 = (1.5, 0.0)

# Assumed set of figure 1 (b) to (d); beta is alpha / 2 and delta is equal, as in (a).
DUFFING_ALPHAS = (0.2, 0.35, 0.5, 0.75, 1.0, 1.5)

# Assumed noise: hold time, s, number of runs, and seed.
DUFFING_HOLD, DUFFING_RUNS, DUFFING_SEED = 0.1, 40, 2411
