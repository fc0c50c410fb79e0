"""How far the errors of navigation alone reach in the flights of a corridor."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flighttune.claims.band import Band
from flighttune.claims.counted_flights import plan_in

# Maximum number of flights whose errors are drawn: each takes 25 ms for 450 s.
MAX_DRAWN = 126


class NavigationErrors(NamedTuple):
    """Position errors (m) within which as many flights stay as within the corridor."""

    beside: float  # across the path
    above: float  # in height


@lru_cache(maxsize=8)
def navigation_errors(band: Band) -> NavigationErrors | None:
    """Errors of navigation in the flights of a band along a route; None if navigation is exact.

    The errors are drawn as for the flights, over the time and courses of the planned route in still
    air.
    """
    flights = band.flights
    central = flights.central
    if central.navigation is None:
        return None
    plan, reference, dt = (
        plan_in(band.about),
        flights.route.reference,
        1.0 / central.controller.rate_hz,
    )
    n = max(round(flights.route.time / dt), 1)
    course, _ = reference.sampled(np.arange(n, dtype=np.float64) * dt)
    s, c, V_a = np.sin(course), np.cos(course), float(reference.V[0])
    largest = []
    for draw in band.draws[:MAX_DRAWN].tolist():
        scenario = plan.scenario_of(draw)
        table = scenario.navigation or central.navigation
        errors = table.navigation(scenario.seed).errors(n, dt, V_a)
        north, east, h = errors[:, 3:6].T
        largest.append((np.abs(east * c - north * s).max(), np.abs(h).max()))
    kept = 1.0 - band.outside / len(band.scores)
    beside, above = np.quantile(largest, kept, axis=0, method="inverted_cdf").tolist()
    return NavigationErrors(beside, above)
