"""Claims of sections 5.2 and 5.2.1: K*, its indicators, and the manoeuvre flown with it."""

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.paper import parameters as printed
from flighttune.paper.claims.base import (
    Check,
    Checks,
    at_most,
    below,
    printed_number,
)
from flighttune.paper.claims.thresholds import AS_GOOD, DERIVATIVE, ROUNDING, VERY_SMALL
from flighttune.paper.commands import largest_share
from flighttune.paper.flight import NEAR
from flighttune.paper.parameters import DURATION, STAR, printed_limits
from flighttune.paper.study import Study
from flighttune.plants.point_mass import turn_rates

# Step of the central differences: rounding and curvature are about equal there.
SMALL_STEP = 1e-6


def _error_rates(z: FloatArray) -> FloatArray:
    """f_e at z = (e_chi, e_gamma, phi, n_z)."""
    gamma = printed.GAMMA_C - z[1]
    return -np.array(turn_rates(printed.V_A, gamma, z[2], z[3], g=printed.G))


def jacobians(study: Study) -> Checks:
    """The printed Jacobians are those of the law, and the printed equilibrium is one."""
    steady = np.array([0.0, 0.0, 0.0, np.cos(printed.GAMMA_C)])
    differences = np.column_stack(
        [
            (_error_rates(steady + step) - _error_rates(steady - step)) / (2.0 * SMALL_STEP)
            for step in SMALL_STEP * np.eye(4)
        ]
    )
    off = float(np.max(np.abs(differences - np.hstack([study.model.A, study.model.B]))))
    yield at_most("largest distance of the Jacobians from differences", off, DERIVATIVE)
    n_z = np.cos(printed.GAMMA_C) / printed.G
    rate = float(np.linalg.norm(_error_rates(np.array([0.0, 0.0, 0.0, n_z]))))
    yield at_most("rate of the error at n_z = cos(γ_c)/g [rad/s]", rate, DERIVATIVE)


def star_indicators(study: Study) -> Checks:
    """R_K* and I_K* follow from the printed gains."""
    row, digit = study.indicators[STAR], printed.STAR_LAST_DIGIT
    yield printed_number("R_K* [1/s]", row.R_K, printed.R_K_PRINTED, digit)
    yield printed_number("I_K* [s²]", row.I_K, printed.I_K_PRINTED, digit)


def star_feasible(study: Study) -> Checks:
    """K* is a point of the optimisation model: every command and rate at t_0 in its range."""
    share = largest_share(study.star)
    yield at_most("largest command or rate at t_0 over its limit [1]", share, 1.0)


def star_optimal(study: Study) -> Checks:
    """K* has the highest R_K of all gains that meet the constraints."""
    result, bound = study.constrained, f"{printed.I_STAR:g}"
    what = f"smallest I_K within the input constraints [s²], I* = {bound}"
    yield Check(what, f"≤ {bound}", result.I_K, result.status == "optimal")
    best, own = study.optimum.R_K, study.indicators[STAR].R_K
    what = "R_K* against the best without input constraints [1/s]"
    yield Check(what, f"{best:.5g}", own, own >= (1.0 - AS_GOOD) * best)


def eigenvalues(study: Study) -> Checks:
    """All eigenvalues of A_K(0) have a negative real part."""
    yield below("largest real part [1/s]", study.indicators[STAR].spectral_abscissa, 0.0)


def small_region(study: Study) -> Checks:
    """Both errors end in a very small region."""
    for channel in ("chi", "gamma"):
        left = study.flights[STAR].after(channel, DURATION)
        yield at_most(f"|e_{channel}| at 20 s [rad]", left, VERY_SMALL)


def overshoot_chi(study: Study) -> Checks:
    """Maximum overshoot of the course error."""
    overshoot, _ = study.flights[STAR].peak("chi")
    yield at_most("MO of e_chi [rad]", overshoot, printed.LARGEST_OVERSHOOT["chi"])


def overshoot_gamma(study: Study) -> Checks:
    """Maximum overshoot of the path-angle error."""
    overshoot, _ = study.flights[STAR].peak("gamma")
    yield at_most("MO of e_gamma [rad]", overshoot, printed.LARGEST_OVERSHOOT["gamma"])


def peak_time(study: Study) -> Checks:
    """The later of both peaks, which is the maximum the sentence speaks of."""
    peaks = {channel: study.flights[STAR].peak(channel)[1] for channel in ("chi", "gamma")}
    channel, latest = max(peaks.items(), key=lambda peak: peak[1])
    yield below(f"largest PT, that of e_{channel} [s]", latest, printed.LARGEST_PEAK_TIME)


def peak_time_gamma(study: Study) -> Checks:
    """The peak of the path-angle error alone."""
    _, t = study.flights[STAR].peak("gamma")
    yield below("PT of e_gamma [s]", t, printed.LARGEST_PEAK_TIME)


def commands_in_range(study: Study) -> Checks:
    """Roll and load factor after the limits stay in their ranges: the simulation sees to that."""
    largest = np.max(np.abs(study.flights[STAR].u), axis=0)
    for name, value, limit in zip(("φ", "n_z"), largest, printed_limits().upper, strict=True):
        yield at_most(f"largest |{name}| flown", float(value), float(limit) + ROUNDING)


def commands_in_rate(study: Study) -> Checks:
    """Rates of roll and load factor after the limits stay in their ranges."""
    rates = np.max(np.abs(study.flights[STAR].command_rates), axis=0)
    for name, value, limit in zip(("φ", "n_z"), rates, printed_limits().rate_upper, strict=True):
        yield at_most(f"largest rate of {name} flown [1/s]", float(value), float(limit))


def converges_with_all_limits(study: Study) -> Checks:
    """With ranges and rate limits together, as Table 1 has them, the errors still converge."""
    flight = study.readings["ranges and rate limits"]
    for channel in ("chi", "gamma"):
        left = flight.after(channel, flight.t[-1] - 2.0)
        yield at_most(f"largest |e_{channel}| from 18 s on, rate limits too [rad]", left, NEAR)
