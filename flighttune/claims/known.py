"""How far errors of navigation reach in the flights of a corridor, and errors of flying."""

from typing import NamedTuple

import numpy as np

from flighttune.claims.band import Band
from flighttune.flight.loop.run import Run
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.routes.follow import SEEN_SIGNALS

# The distances that an autopilot sees are told for this share of its time.
MOST_OF_THE_TIME = 0.95

# A flight begins beside the place where its autopilot believes it to be. Its course leads back to
# the path as exp(-t / T), T being the look-ahead time: after five times T, less than 1 % is left.
# This start is no error of flying and is left out, at most half of a short flight.
JOINING = 5.0

# Numbers of a flight: errors beside the route and in height, then the distances seen.
NUMBERS = 4


class NavigationErrors(NamedTuple):
    """Bounds (m) within which as many flights stay as within the corridor."""

    beside: float  # largest error of position across the path
    above: float  # in height
    seen_beside: float  # distance across the path as seen, for `MOST_OF_THE_TIME` once joined
    seen_above: float


def navigation_errors_of(run: Run, look_ahead: float) -> list[float]:
    """Largest errors (m) of the distances from its route that the autopilot of a run saw.

    After them the distances (m) that it saw, the flight technical error: for `MOST_OF_THE_TIME`
    from `JOINING` times its `look_ahead` (s) on.
    """
    seen, true = (
        np.stack([run.signals[name].to_numpy() for name in names])
        for names in (SEEN_SIGNALS, OFF_ROUTE)
    )
    joined = run.t >= min(JOINING * look_ahead, 0.5 * float(run.t[-1]))
    flying = np.quantile(np.abs(seen[:, joined]), MOST_OF_THE_TIME, axis=1)
    return [*np.abs(seen - true).max(axis=1).tolist(), *flying.tolist()]


def navigation_errors(band: Band) -> NavigationErrors | None:
    """Errors of navigation in the flights of a band along a route.

    None if navigation is exact, if no flight completed, or for a file of version 0.4.0.
    """
    largest = band.navigation[np.isfinite(band.scores)]
    if not largest.size:
        return None
    kept = 1.0 - band.outside / len(band.scores)
    return NavigationErrors(*np.quantile(largest, kept, axis=0, method="inverted_cdf").tolist())
