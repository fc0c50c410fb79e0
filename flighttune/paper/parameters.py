"""What the paper prints, and what had to be assumed because it does not.

Printed numbers are those of arXiv 2411.13140; a name says which table or figure. Items carry the
names of the figure labels in the paper's source; in print the figures are numbered 1 to 10 in the
order in which they appear.
"""

import math
from dataclasses import dataclass

import numpy as np

from flighttune.control.limits import Limits
from flighttune.simulate.disturbance import Sinusoid

V_A, G = 25.0, 9.81
"""Table 1: airspeed in m/s and acceleration of gravity in m/s^2."""

CHI_0, GAMMA_0, PHI_0, N_Z_0 = math.pi / 3, math.pi / 4, math.pi / 3, 1.0
"""Table 1: start. The printed roll lies outside the printed range of roll."""

CHI_C, GAMMA_C = 0.0, math.pi / 12
"""Table 1: references, rad."""

DURATION = 20.0
"""Table 1: time simulated, s."""

OPTIMISATION_DT = 0.1
"""Section 4.4: time over which the first error is integrated for the input constraints, s."""

E_0 = np.array([CHI_C - CHI_0, GAMMA_C - GAMMA_0])
"""Error at the start, rad."""

R_K_PRINTED, I_K_PRINTED = 0.4427, 4.9244
"""Section 5.2: indicators printed below K*."""

TABLE_2: dict[str, tuple[float, float]] = {
    "K1": (0.7742, 7.873),
    "K2": (0.6754, 6.057),
    "K3": (0.5913, 5.312),
    "K4": (0.3626, 5.207),
    "K5": (0.2849, 6.161),
    "K6": (0.2192, 8.258),
}
"""Table 2: R_K and I_K as printed."""

LAST_DIGITS = 1e-4, 1e-3
"""One unit of the last digit of R_K and of I_K in Table 2."""

STAR = "K*"
"""Name of the printed optimum among the families."""

TABLE_3: dict[str, tuple[float, float]] = {
    "d1": (0.1, 0.1),
    "d2": (0.1, 0.15),
    "d3": (0.1, 0.2),
    "d4": (0.2, 0.1),
    "d5": (0.2, 0.15),
    "d6": (0.2, 0.2),
    "d7": (0.3, 0.1),
    "d8": (0.3, 0.15),
    "d9": (0.3, 0.2),
}
"""Table 3: amplitude L_d in rad/s and angular frequency omega_d in rad/s of both channels."""

PRINTED_DISTURBANCE = "d2"
"""The disturbance of Table 1 is this one of Table 3."""

AFTERWARDS = 40.0
"""Assumed: the d family is flown to here, s, because the text speaks of the time after 20 s."""

I_STAR = I_K_PRINTED
"""Assumed: bound on I_K of the optimisation model; the printed optimum must satisfy it."""


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
    both, none = printed_limits(), Limits.none(2)
    return Limits(
        lower=both.lower,
        upper=both.upper,
        rate_lower=none.rate_lower,
        rate_upper=none.rate_upper,
    )


def disturbance(name: str) -> Sinusoid:
    """One of the disturbances ``d1`` to ``d9`` of Table 3."""
    amplitude, omega = TABLE_3[name]
    return Sinusoid(
        chi_amplitude=amplitude, chi_omega=omega, gamma_amplitude=amplitude, gamma_omega=omega
    )


@dataclass(frozen=True, slots=True)
class Assumption:
    """Something that had to be chosen because the paper does not print it.

    Attributes
    ----------
    what : str
        What is missing.
    taken : str
        What was taken instead.
    why : str
        Why that.
    """

    what: str
    taken: str
    why: str


PEAK_TIME = Assumption(
    "definition of the peak time PT",
    "the time of the largest value of the signal over the time simulated",
    "the paper's words are “rise from a defined initial value to its highest point”",
)
STEADY_PART = Assumption(
    "sign of MS",
    "the mean keeps its sign for errors and rates; for s_chi and s_gamma it is positive anyway",
    "the paper says “mean value of convergence errors”; its Fig. 13 shows s_chi and s_gamma",
)
ONLY_RANGES = Assumption(
    "how the limits act in the simulation",
    "the ranges cut off the command, the rate limits do not act, there is no anti-windup",
    "of the readings tried only this one gives the printed overshoots; with the rate limits the "
    "loop does not converge",
)
TIME_ITAE = Assumption(
    "weight of ITAE",
    "the integral of t |e| over the time simulated, not divided by it",
    "the printed words describe an average without the time; the name is that of the usual measure",
)


DUFFING_A = {"alpha": 0.5, "beta": 0.25, "delta": 1.5}
"""Figure 3 (a): the oscillator."""

DUFFING_L_D = 2.5
"""Figure 3 (a): bound on the disturbance."""

DUFFING_X_0 = (1.5, 0.0)
"""Assumed start of the oscillator."""

DUFFING_ALPHAS = (0.2, 0.35, 0.5, 0.75, 1.0, 1.5)
"""Assumed set of figure 3 (b) to (d); beta is alpha / 2 as in (a), delta that of (a)."""

DUFFING_HOLD, DUFFING_RUNS, DUFFING_SEED = 0.1, 40, 2411
"""Assumed noise: held for this many s, this many runs, from this seed."""

DUFFING_ASSUMED = (
    Assumption(
        "the disturbance of the Duffing case",
        f"uniform on [-L_d, L_d], a new value every {DUFFING_HOLD} s, seed {DUFFING_SEED}; beside "
        "it the constant L_d and ±L_d always along the motion",
        "only its bound is printed; noise is the mild end of what the bound allows, the other two "
        "the hard end",
    ),
    Assumption(
        "start of the oscillator",
        f"x = {DUFFING_X_0}",
        "inside the region in which the theorem's condition holds for the chosen P",
    ),
    Assumption(
        "the sets of alpha and beta of (b) to (d)",
        f"alpha in {DUFFING_ALPHAS}, beta = alpha / 2, delta = {DUFFING_A['delta']}",
        "the ratio and the damping are those printed for (a); R(f) rises with alpha over this set",
    ),
    Assumption(
        "P and epsilon",
        "the solution of J(0)'P + P J(0) + I = 0, epsilon = 1",
        "it gives the largest R(f) at the origin, and the numbers of Table 2 in section 5.2",
    ),
)
"""What the paper does not print on the Duffing case."""
