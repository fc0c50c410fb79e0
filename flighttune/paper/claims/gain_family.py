"""Claims of section 5.2.2: K1 to K6, and what R_K and I_K say of their flights."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper.claims.base import (
    Check,
    Checks,
    at_least,
    at_most,
    lower_with_higher_R_K,
    printed_number,
    rising_steps,
)
from flighttune.paper.claims.thresholds import CORRELATED, INVERSE, ORDER_OF_1E3
from flighttune.paper.flight import oscillations
from flighttune.paper.study import Study, rank_correlation

# The errors of the sentence on ITAE, MS and ST, and what Fig. 13 shows in their place.
ERRORS = ("chi", "gamma", "chi_dot", "gamma_dot")
ERRORS_AND_S = (*ERRORS, "s_chi", "s_gamma")


def table_2(study: Study) -> Checks:
    """R_K and I_K of every row."""
    digit_R, digit_I = printed.LAST_DIGITS
    for name, (R_K, I_K) in printed.TABLE_2.items():
        row = study.indicators[name]
        yield printed_number(f"R_K of {name} [1/s]", row.R_K, R_K, digit_R)
        yield printed_number(f"I_K of {name} [s²]", row.I_K, I_K, digit_I)


def faster_convergence(study: Study) -> Checks:
    """The slowest eigenvalue and the late errors of every channel follow R_K."""
    R_K = study.indicator("R_K")
    rated = {"the spectral abscissa": study.indicator("spectral_abscissa")}
    rated |= {f"ITAE of {channel}": study.of_gains(channel, "ITAE") for channel in ERRORS}
    for name, values in rated.items():
        correlation = rank_correlation(R_K, values)
        yield at_most(f"rank correlation of R_K and {name}", correlation, -CORRELATED)


def small_R_oscillates(study: Study) -> Checks:
    """The smallest R_K crosses zero more often than the largest, and ends farther away."""
    R_K = study.indicator("R_K")
    high, low = study.flights[str(R_K.idxmax())], study.flights[str(R_K.idxmin())]
    for channel in ("chi", "gamma"):
        few, many = (oscillations(flight.channels[channel]) for flight in (high, low))
        what = f"zero crossings of e_{channel}, lowest R_K"
        yield Check(what, f"> {few} of the highest", many, many > few)
        near, far = (float(f.measures.loc[channel, "ST_rad"]) for f in (high, low))
        what = f"ST of e_{channel}, lowest R_K [rad]"
        yield Check(what, f"> {near:.3g} of the highest", far, far > near)


def slower_oscillation(study: Study) -> Checks:
    """A larger R_K has smaller amplitudes and slower oscillation frequencies."""
    for channel in ("chi", "gamma"):
        yield lower_with_higher_R_K(f"MO of e_{channel}", study.of_gains(channel, "MO_rad"))
    order = study.indicator("R_K").sort_values(ascending=False).index
    frequency = {
        name: float(np.max(study.indicators[str(name)].eigenvalues.imag)) for name in order
    }
    yield lower_with_higher_R_K("eigenfrequency", pd.Series(frequency))


def R_more_than_I(study: Study) -> Checks:
    """R_K orders convergence and steady error better than I_K does."""
    R_K, I_K = study.indicator("R_K"), study.indicator("I_K")
    for measure, channels in (("ITAE", ("chi", "gamma")), ("ST_rad", ("s_chi", "s_gamma"))):
        for channel in channels:
            values = study.of_gains(channel, measure)
            by_R, by_I = (abs(rank_correlation(key, values)) for key in (R_K, I_K))
            what = f"|rank correlation| of R_K and {measure.split('_')[0]} of {channel}"
            yield Check(what, f"> {by_I:.3g} of I_K", by_R, by_R > by_I)


def _lower(study: Study, name: str, measure: str, channels: Sequence[str]) -> Checks:
    """The size of a measure falls with rising R_K at every step, in each channel."""
    for channel in channels:
        values = study.of_gains(channel, measure).abs()
        yield lower_with_higher_R_K(f"{name} of {channel}", values)


def lower_ITAE(study: Study) -> Checks:
    """ITAE falls with rising R_K at every step."""
    return _lower(study, "ITAE", "ITAE", ERRORS)


def lower_MS(study: Study) -> Checks:
    """|MS| falls with rising R_K at every step."""
    return _lower(study, "|MS|", "MS_rad", ERRORS_AND_S)


def lower_ST(study: Study) -> Checks:
    """ST falls with rising R_K at every step."""
    return _lower(study, "ST", "ST_rad", ERRORS_AND_S)


def mostly_smaller_MO_PT(study: Study) -> Checks:
    """MO and PT fall with rising R_K at most steps."""
    for measure, name in (("MO_rad", "MO"), ("PT_s", "PT")):
        for channel in ("chi", "gamma"):
            rising, count = rising_steps(study.of_gains(channel, measure))
            what = f"{name} of e_{channel} lower with higher R_K"
            computed = f"{rising} of {count} steps"
            yield Check(what, f"most of {count} steps", computed, 2 * rising > count)


def minor_means(study: Study) -> Checks:
    """The mean rate of error differs by some 1e-3 over the gain sets."""
    for channel in ("chi_dot", "gamma_dot"):
        spread = float(np.ptp(study.of_gains(channel, "mean")))
        what = f"spread of the mean of {channel} over the gain sets [rad/s]"
        yield Check(what, "of the order of 1e-3", spread, spread < ORDER_OF_1E3)


def inverse_deviation(study: Study) -> Checks:
    """The deviation of the rates of error is proportional to 1 / R_K, about."""
    for channel in ("chi_dot", "gamma_dot"):
        values = study.of_gains(channel, "std")
        R_K = study.indicator("R_K").loc[values.index].to_numpy()
        stable = (R_K > 0.0).all()
        correlation = float(np.corrcoef(1.0 / R_K, values)[0, 1]) if stable else 0.0
        yield at_least(f"correlation of 1/R_K and the deviation of {channel}", correlation, INVERSE)
        yield lower_with_higher_R_K(f"deviation of {channel}", values)


def less_energy(study: Study) -> Checks:
    """The energy of the rates of error falls with rising R_K."""
    return _lower(study, "energy", "energy", ("chi_dot", "gamma_dot"))
