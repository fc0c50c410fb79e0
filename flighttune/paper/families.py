"""The flights of the paper: families of gains and of disturbances, and readings of the limits."""

from collections.abc import Sequence

import numpy as np

from flighttune.control.gains import PAPER_EPSILON, PIGains
from flighttune.control.limits import Limits
from flighttune.control.mimo_pi import AntiWindup
from flighttune.paper import parameters as printed
from flighttune.paper.flight import SAMPLE, PaperFlight
from flighttune.plants.base import FlightCondition
from flighttune.simulate.batch import Flights, fly_continuous
from flighttune.simulate.continuous import continuous_flight
from flighttune.simulate.disturbance import Sinusoid

START = FlightCondition(
    V_a=printed.V_A,
    chi=printed.CHI_0,
    gamma=printed.GAMMA_0,
    phi=printed.PHI_0,
    n_z=printed.N_Z_0,
)
"""Table 1."""


REFERENCE = printed.CHI_C, printed.GAMMA_C


PAIRS = {
    "x": ("chi", "gamma"),
    "error": ("chi_err", "gamma_err"),
    "error_rate": ("chi_err_rate", "gamma_err_rate"),
    "u": ("phi_cmd", "n_z_cmd"),
    "unlimited": ("phi_unlimited", "n_z_unlimited"),
    "integral": ("phi_integral", "n_z_integral"),
}
"""Signals of a batch that make up the arrays of a flight."""


def gain_family(star: PIGains) -> dict[str, PIGains]:
    """`star` as ``K*`` and ``K1`` to ``K6`` of Table 2 made from it, by name."""
    shift = np.eye(2)
    return {
        printed.STAR: star,
        **{
            name: PIGains(K_P=star.K_P - epsilon * shift, K_I=star.K_I - epsilon * shift)
            for name, epsilon in PAPER_EPSILON.items()
        },
    }


def fly(
    gains: PIGains,
    disturbance: Sinusoid | None,
    *,
    limits: Limits | None = None,
    anti_windup: AntiWindup = "none",
    duration: float = printed.DURATION,
) -> PaperFlight:
    """Fly the paper's manoeuvre.

    Parameters
    ----------
    gains : PIGains
        From (chi, gamma) to (phi, n_z).
    disturbance : Sinusoid or None
        Of the two rates.
    limits : Limits, optional
        By default the printed ranges without rate limits, as the paper must have flown.
    anti_windup : {"none", "conditional", "back_calculation"}
        None by default, as in the paper.
    duration : float, s
        Time to fly.

    Returns
    -------
    PaperFlight
    """
    flown = continuous_flight(
        gains,
        np.arange(round(duration / SAMPLE) + 1) * SAMPLE,
        condition=START,
        ref=REFERENCE,
        limits=printed.printed_ranges() if limits is None else limits,
        anti_windup=anti_windup,
        disturbance=disturbance,
        roll="any",
        g=printed.G,
    )
    return PaperFlight(
        t=flown.t,
        x=flown.x,
        error=flown.error,
        error_rate=flown.error_rate,
        u=flown.u,
        unlimited=flown.unlimited,
        integral=flown.integral,
        status=flown.status,
        reason=flown.reason,
        disturbance=disturbance,
    )


def fly_many(
    gains: Sequence[PIGains], disturbances: Sequence[Sinusoid], *, duration: float
) -> list[PaperFlight]:
    """Fly the paper's manoeuvre, ranges only, many times at once.

    Parameters
    ----------
    gains : sequence of PIGains, length 1 or N
    disturbances : sequence of Sinusoid, length N
    duration : float, s

    Returns
    -------
    list of PaperFlight, length N
    """
    flown = fly_continuous(
        Flights.of(
            gains,
            condition=START,
            ref=REFERENCE,
            limits=printed.printed_ranges(),
            disturbance=disturbances,
        ),
        dt=SAMPLE,
        duration=duration,
        roll="any",
        trajectories=True,
        g=printed.G,
    )
    flights = []
    for k, disturbance in enumerate(disturbances):
        last = int(flown.samples[k])
        status, reason = flown.status(k)
        pairs = {
            name: np.column_stack([flown.signal(signal)[k, :last] for signal in signals])
            for name, signals in PAIRS.items()
        }
        flights.append(
            PaperFlight(
                t=flown.t[:last], status=status, reason=reason, disturbance=disturbance, **pairs
            )
        )
    return flights


def readings(gains: PIGains) -> dict[str, PaperFlight]:
    """The manoeuvre under each reading of the printed limits, by name."""
    calm = printed.disturbance(printed.PRINTED_DISTURBANCE)
    both = printed.printed_limits()
    return {
        "ranges only": fly(gains, calm),
        "ranges and rate limits": fly(gains, calm, limits=both),
        "with rate limits and anti-windup": fly(
            gains, calm, limits=both, anti_windup="conditional"
        ),
        "no limits": fly(gains, calm, limits=Limits.none(2)),
    }
