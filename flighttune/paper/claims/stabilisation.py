"""Claims of section 5.2.1: what K* does on the manoeuvre."""

from collections.abc import Iterator

import numpy as np

from flighttune.paper.claims.base import Check, Claim, at_most
from flighttune.paper.flight import NEAR, PaperFlight
from flighttune.paper.parameters import DURATION, STAR, printed_limits
from flighttune.paper.study import Study

VERY_SMALL = 0.02
"""An error below this at the end is in a “very small region”, rad: 2 % of the first in course."""

ROUNDING = 1e-9


def stable(study: Study) -> Iterator[Check]:
    """All eigenvalues of A_K(0) are on the left."""
    abscissa = study.indicators[STAR].spectral_abscissa
    yield Check("largest real part [1/s]", "< 0", abscissa, abscissa < 0.0)


def converges(study: Study) -> Iterator[Check]:
    """Both errors end in a very small region."""
    flight = study.flights[STAR]
    for channel in ("chi", "gamma"):
        left = flight.after(channel, DURATION)
        yield at_most(f"|e_{channel}| at 20 s [rad]", left, VERY_SMALL)


def overshoot_chi(study: Study) -> Iterator[Check]:
    """Maximum overshoot of the course error."""
    yield at_most("MO of e_chi [rad]", study.flights[STAR].peak("chi")[0], 0.8)


def overshoot_gamma(study: Study) -> Iterator[Check]:
    """Maximum overshoot of the path-angle error."""
    yield at_most("MO of e_gamma [rad]", study.flights[STAR].peak("gamma")[0], 0.4)


def peak_time(study: Study) -> Iterator[Check]:
    """The later of both peaks, which is the maximum the sentence speaks of."""
    peaks = {channel: study.flights[STAR].peak(channel)[1] for channel in ("chi", "gamma")}
    last = max(peaks, key=lambda channel: peaks[channel])
    yield Check(f"largest PT, that of e_{last} [s]", "< 4", peaks[last], peaks[last] < 4.0)


def peak_time_gamma(study: Study) -> Iterator[Check]:
    """The peak of the path-angle error alone."""
    peak = study.flights[STAR].peak("gamma")[1]
    yield Check("PT of e_gamma [s]", "< 4", peak, peak < 4.0)


def _rates(flight: PaperFlight) -> np.ndarray:
    return np.max(np.abs(flight.command_rates), axis=0)


def commands_in_range(study: Study) -> Iterator[Check]:
    """Roll and load factor as flown stay in their ranges (the simulation cuts them off)."""
    largest = np.max(np.abs(study.flights[STAR].u), axis=0)
    for name, value, limit in zip(("φ", "n_z"), largest, printed_limits().upper, strict=True):
        yield at_most(f"largest |{name}| flown", float(value), float(limit) + ROUNDING)


def commands_in_rate(study: Study) -> Iterator[Check]:
    """Rates of roll and load factor as flown stay in their ranges."""
    limits = printed_limits().rate_upper
    for name, value, limit in zip(("φ", "n_z"), _rates(study.flights[STAR]), limits, strict=True):
        yield at_most(f"largest rate of {name} flown [1/s]", float(value), float(limit))


def converges_with_all_limits(study: Study) -> Iterator[Check]:
    """With ranges and rate limits together, as Table 1 has them, the errors still converge."""
    flight = study.readings["ranges and rate limits"]
    for channel in ("chi", "gamma"):
        left = flight.after(channel, flight.t[-1] - 2.0)
        yield at_most(f"largest |e_{channel}| from 18 s on, rate limits too [rad]", left, NEAR)


WHERE = "section 5.2.1"

CLAIMS = (
    Claim(
        id="eigenvalues",
        text="all eigenvalues lie in the left half plane",
        where=f"{WHERE}, Fig. 6 (a)",
        checks=stable,
    ),
    Claim(
        id="small-region",
        text="e_chi and e_gamma rapidly converge to a very small region within 20 s",
        where=f"{WHERE}, Fig. 5",
        checks=converges,
    ),
    Claim(
        id="overshoot-chi",
        text="the maximum overshoot of e_chi does not exceed 0.8 rad",
        where=f"{WHERE}, Fig. 5 (a)",
        checks=overshoot_chi,
    ),
    Claim(
        id="overshoot-gamma",
        text="that of e_gamma is within 0.4 rad",
        where=f"{WHERE}, Fig. 5 (b)",
        checks=overshoot_gamma,
    ),
    Claim(
        id="peak-time",
        text="their maximum peak time is less than 4 s",
        where=f"{WHERE}, Fig. 5",
        checks=peak_time,
    ),
    Claim(
        id="peak-time-gamma",
        text="their maximum peak time is less than 4 s: that of e_gamma by itself",
        where=f"{WHERE}, Fig. 5 (b)",
        checks=peak_time_gamma,
    ),
    Claim(
        id="commands-in-range",
        text="the commands satisfy the input constraints: ranges",
        where=f"{WHERE}, Fig. 12 and Table 1",
        checks=commands_in_range,
    ),
    Claim(
        id="commands-in-rate",
        text="the commands satisfy the input constraints: rates",
        where=f"{WHERE}, Fig. 12 and Table 1",
        checks=commands_in_rate,
    ),
    Claim(
        id="converges-with-all-limits",
        text="the errors converge under the constraints of Table 1",
        where=f"{WHERE}, Figs. 5 and 12 taken together",
        checks=converges_with_all_limits,
    ),
)
