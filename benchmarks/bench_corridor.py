"""How much wider the corridor of a mission is than the one that 95 % of its flights need.

A corridor is learned from 30 flights and counted, then fresh flights of another seed say how wide
it had to be: the ratio of the counted scale to their 95 % quantile, and the share of them outside,
which must not be above the epsilon of the count.

Run it with ``python benchmarks/bench_corridor.py [PLAN:AIRCRAFT ...]``, by default for a shipped
campaign; ``--json`` prints one object. Exits with 1 where the corridor of a mission is above
`MOST_RATIO`, or where too many fresh flights are outside.
"""

import json
from functools import partial
from typing import Any

import numpy as np
import running

import flighttune as ft
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.statistics.count import flights_needed
from flighttune.claims import counting
from flighttune.claims.band import Band
from flighttune.claims.ending import Fixed, each_of
from flighttune.claims.mission import CONFIDENCE, EPSILON, LEARN
from flighttune.claims.mission import OUTSIDE as KEPT
from flighttune.claims.shape import scores_of

# Numbers of flights allowed outside, and the share of flights that the true corridor holds.
OUTSIDE, TRUE = (0, 2, 5), 0.95
MOST_RATIO = 1.3
FRESH = 40 if running.QUICK else 2000
SHIPPED = ("circuit_in_wind_x8",)


def corridor(mission: str) -> dict[str, Any]:
    """Claimed over true corridor of a mission, by number of flights allowed outside."""
    confidence = each_of(2, CONFIDENCE)  # shared with a fence
    epsilon, confidence = (0.2, 0.8) if running.QUICK else (EPSILON, confidence)
    needed_for = partial(flights_needed, epsilon, confidence)
    source, _, aircraft = mission.partition(":")
    stated = ft.flights(source, aircraft=aircraft or None).knowing(None)

    def count(flights: int, seed: int) -> Band:
        return counting.counted_on(
            Band,
            counting.drawn(stated).with_seed(seed),
            Fixed.enough(flights, epsilon, confidence),
            place=source,
            learn=LEARN,
            fliers=Fliers(),
        )

    counted, fresh = count(needed_for(max(OUTSIDE)), 1), count(FRESH, 2)
    assert (counted.flights.edges == fresh.flights.edges).all()
    about = counted.about
    scores = scores_of(fresh.extremes, fresh.wind, about.coefficients, about.half)
    needed = float(np.quantile(scores, TRUE))
    rows = []
    for outside in OUTSIDE:
        flights = needed_for(outside)
        scale = float(np.sort(counted.scores[:flights])[-1 - outside])
        rows.append(
            {
                "outside": outside,
                "flights": flights,
                "ratio": scale / needed,
                "beyond": float(np.mean(scores > scale)),
            }
        )
    return {"mission": mission, "fresh": len(scores), "rows": rows}


def main() -> int:
    """Print a table, or one object with ``--json``."""
    parser = running.options(__doc__)
    parser.add_argument("missions", nargs="*", default=SHIPPED, metavar="PLAN:AIRCRAFT")
    args = parser.parse_args()
    results = [corridor(mission) for mission in args.missions]
    rows = [(result, row) for result in results for row in result["rows"]]
    missed = any(
        row["outside"] == KEPT and (row["ratio"] > MOST_RATIO or row["beyond"] > EPSILON)
        for _, row in rows
    )
    if args.json:
        print(json.dumps({"missions": results, "missed": missed}))
        return int(missed)
    for result, row in rows:
        print(
            f"{result['mission']}: {row['outside']} of {row['flights']} "
            f"flights outside, {row['ratio']:.3f} times the true corridor, "
            f"{100 * row['beyond']:.2f} % of {result['fresh']} fresh flights beyond"
        )
    return int(missed)


if __name__ == "__main__":
    running.end(main)
