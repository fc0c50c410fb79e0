"""Claims of section 5.2.2 on R_K and I_K: Table 2 and Figs. 8, 7 and 13."""

from collections.abc import Callable, Iterator

import numpy as np
import pandas as pd

from flighttune.paper import parameters as printed
from flighttune.paper.claims.base import (
    Check,
    Claim,
    lower_with_higher_R_K,
    printed_number,
    steps,
)
from flighttune.paper.flight import oscillations
from flighttune.paper.study import Study, rank_correlation

ERRORS = ("chi", "gamma", "chi_dot", "gamma_dot")
CLEAR = -0.9
"""A rank correlation with R_K at or below this is called a correlation."""


def table_2(study: Study) -> Iterator[Check]:
    """R_K and I_K of every row."""
    for name, (R_K, I_K) in printed.TABLE_2.items():
        found = study.indicators[name]
        yield printed_number(f"R_K of {name} [1/s]", found.R_K, R_K, printed.LAST_DIGITS[0])
        yield printed_number(f"I_K of {name} [s²]", found.I_K, I_K, printed.LAST_DIGITS[1])


def converges_faster(study: Study) -> Iterator[Check]:
    """The slowest eigenvalue and the late errors of every channel follow R_K."""
    R_K = study.indicator("R_K")
    abscissa = rank_correlation(R_K, study.indicator("spectral_abscissa"))
    yield Check(
        "rank correlation of R_K and the spectral abscissa",
        f"≤ {CLEAR:g}",
        abscissa,
        abscissa <= CLEAR,
    )
    for channel in ERRORS:
        found = rank_correlation(R_K, study.of_gains(channel, "ITAE"))
        yield Check(
            f"rank correlation of R_K and ITAE of {channel}", f"≤ {CLEAR:g}", found, found <= CLEAR
        )


def oscillates_when_small(study: Study) -> Iterator[Check]:
    """The smallest R_K crosses zero more often than the largest, and ends farther away."""
    order = list(study.of_gains("chi", "ITAE").index)
    low, high = study.flights[order[-1]], study.flights[order[0]]
    for channel in ("chi", "gamma"):
        few, many = (oscillations(flight.channels[channel]) for flight in (high, low))
        what = f"zero crossings of e_{channel}, lowest R_K"
        yield Check(what, f"> {few} of the highest", many, many > few)
        near, far = (float(f.measures.loc[channel, "ST_rad"]) for f in (high, low))
        what = f"ST of e_{channel}, lowest R_K [rad]"
        yield Check(what, f"> {near:.3g} of the highest", far, far > near)


def slower_oscillation(study: Study) -> Iterator[Check]:
    """A larger R_K has smaller amplitudes and slower oscillation frequencies."""
    order = list(study.of_gains("chi", "ITAE").index)
    for channel in ("chi", "gamma"):
        amplitudes = study.of_gains(channel, "MO_rad")
        yield lower_with_higher_R_K(f"MO of e_{channel} lower with higher R_K", amplitudes)
    frequency = pd.Series(
        {name: float(np.max(study.indicators[name].eigenvalues.imag)) for name in order}
    )
    yield lower_with_higher_R_K("eigenfrequency lower with higher R_K", frequency)


def stronger_than_I_K(study: Study) -> Iterator[Check]:
    """R_K orders convergence and steady error better than I_K does."""
    R_K, I_K = study.indicator("R_K"), study.indicator("I_K")
    for measure, channels in (("ITAE", ("chi", "gamma")), ("ST_rad", ("s_chi", "s_gamma"))):
        for channel in channels:
            values = study.of_gains(channel, measure)
            by_R, by_I = (abs(rank_correlation(key, values)) for key in (R_K, I_K))
            what = f"|rank correlation| of R_K and {measure.split('_')[0]} of {channel}"
            yield Check(what, f"> {by_I:.3g} of I_K", by_R, by_R > by_I)


def _lower(
    measure: str, name: str, channels: tuple[str, ...]
) -> Callable[[Study], Iterator[Check]]:
    """The size of a measure falls with rising R_K at every step, in each channel."""

    def checks(study: Study) -> Iterator[Check]:
        for channel in channels:
            values = study.of_gains(channel, measure).abs()
            yield lower_with_higher_R_K(f"{name} of {channel} lower with higher R_K", values)

    return checks


def mostly_smaller(study: Study) -> Iterator[Check]:
    """MO and PT fall with rising R_K at most steps."""
    for measure, name in (("MO_rad", "MO"), ("PT_s", "PT")):
        for channel in ("chi", "gamma"):
            rising, count = steps(study.of_gains(channel, measure))
            yield Check(
                f"{name} of e_{channel} lower with higher R_K",
                f"most of {count} steps",
                f"{rising} of {count} steps",
                2 * rising > count,
            )


WHERE = "section 5.2.2"
LOWER = "higher R_K corresponds to lower ITAE, MS and ST for all errors e_χ, e_γ, ė_χ, ė_γ"
ERRORS_AND_S = (*ERRORS, "s_chi", "s_gamma")
"""The errors of the sentence, and what Fig. 13 shows in their place."""

CLAIMS = (
    Claim(
        id="table-2",
        text="R_K and I_K of K1 to K6",
        where=f"{WHERE}, Table 2",
        checks=table_2,
    ),
    Claim(
        id="faster-convergence",
        text="a higher R_K correlates with superior exponential convergence",
        where=f"{WHERE}, Fig. 8",
        checks=converges_faster,
    ),
    Claim(
        id="small-R-oscillates",
        text="a small R_K is more likely to cause oscillation and a lack of convergence",
        where=f"{WHERE}, Fig. 8",
        checks=oscillates_when_small,
    ),
    Claim(
        id="slower-oscillation",
        text="larger R_K: smaller amplitudes and slower oscillation frequencies",
        where=f"{WHERE}, Fig. 8",
        checks=slower_oscillation,
    ),
    Claim(
        id="R-more-than-I",
        text="R_K has a significantly more pronounced influence than I_K",
        where=f"{WHERE}, above Fig. 7",
        checks=stronger_than_I_K,
    ),
    Claim(
        id="lower-ITAE",
        text=f"{LOWER}: ITAE",
        where=f"{WHERE}, Fig. 7 (a)",
        checks=_lower("ITAE", "ITAE", ERRORS),
    ),
    Claim(
        id="lower-MS",
        text=f"{LOWER}: MS, taken as |MS| because a mean below zero is an offset too",
        where=f"{WHERE}, Fig. 13 (a)",
        checks=_lower("MS_rad", "|MS|", ERRORS_AND_S),
    ),
    Claim(
        id="lower-ST",
        text=f"{LOWER}: ST",
        where=f"{WHERE}, Fig. 13 (b)",
        checks=_lower("ST_rad", "ST", ERRORS_AND_S),
    ),
    Claim(
        id="mostly-smaller-MO-PT",
        text="in most cases larger R_K correlates with smaller MO and PT",
        where=f"{WHERE}, Fig. 7 (b), (c)",
        checks=mostly_smaller,
    ),
)
