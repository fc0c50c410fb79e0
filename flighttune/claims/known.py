"""How far the errors of navigation alone reach in the flights of a corridor."""

from typing import NamedTuple

import numpy as np

from flighttune.claims.band import Band
from flighttune.flight.loop.run import Run
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.routes.follow import SEEN_SIGNALS


class NavigationErrors(NamedTuple):
    """Position errors (m) within which as many flights stay as within the corridor."""

    beside: float  # across the path
    above: float  # in height


def navigation_errors_of(run: Run) -> list[float]:
    """Largest errors (m) of the distances from its route that the autopilot of a run saw."""
    seen, true = (run.signals[[*names]].to_numpy() for names in (SEEN_SIGNALS, OFF_ROUTE))
    return np.abs(seen - true).max(axis=0).tolist()


def navigation_errors(band: Band) -> NavigationErrors | None:
    """Errors of navigation in the flights of a band along a route.

    None if navigation is exact, if no flight completed, or for a file of version 0.4.0.
    """
    largest = band.navigation[np.isfinite(band.scores)]
    if not largest.size:
        return None
    kept = 1.0 - band.outside / len(band.scores)
    beside, above = np.quantile(largest, kept, axis=0, method="inverted_cdf").tolist()
    return NavigationErrors(beside, above)
