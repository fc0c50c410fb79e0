"""How much wider the corridor of a mission is than the one that 95 % of its flights need.

Many flights are counted with a corridor that is learned from 30 others. Random parts of them are
then counted as `mission` counts: the ratio of the scale of each part to the 95 % quantile of all
flights, in the median and in 95 % of the parts, and the share of parts whose corridor is left by
more flights than the epsilon of the count, which must not be above the complement of its
confidence, apart from chance.

Run it with ``python benchmarks/bench_corridor.py [PLAN:AIRCRAFT ...]``, by default for a shipped
campaign; ``--json`` prints one object. Exits with 1 where the median of a mission is above
`MOST_RATIO`, or where too many corridors are left.
"""

import json
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

# Numbers of flights allowed outside, and the share of flights that the true corridor holds.
OUTSIDE, TRUE = (0, 2, 5, 10), 0.95
MOST_RATIO = 1.3
FLIGHTS, PARTS = (80, 20) if running.QUICK else (6000, 720)
SHIPPED = ("circuit_in_wind_x8",)


def corridor(mission: str) -> dict[str, Any]:
    """Claimed over true corridor of a mission, by number of flights allowed outside."""
    confidence = each_of(2, CONFIDENCE)  # shared with a fence
    epsilon, confidence = (0.2, 0.8) if running.QUICK else (EPSILON, confidence)
    source, _, aircraft = mission.partition(":")
    stated = ft.flights(source, aircraft=aircraft or None).knowing(None)
    counted = counting.counted_on(
        Band,
        counting.drawn(stated),
        Fixed.enough(FLIGHTS, epsilon, confidence),
        place=source,
        learn=LEARN,
        fliers=Fliers(),
    )
    scores, rng, rows = np.sort(counted.scores), np.random.default_rng(1), []
    needed = scores[int(TRUE * len(scores))]
    for outside in OUTSIDE:
        flights = flights_needed(epsilon, confidence, outside)
        parts = (rng.choice(scores, flights, replace=False) for _ in range(PARTS))
        scales = np.array([np.sort(part)[-1 - outside] for part in parts])
        left = 1.0 - np.searchsorted(scores, scales, side="right") / len(scores)
        rows.append(
            {
                "outside": outside,
                "flights": flights,
                "ratio": float(np.median(scales) / needed),
                "most": float(np.sort(scales)[int(TRUE * PARTS)] / needed),
                "short": float(np.mean(left > epsilon)),
                "may_be_short": 1.0 - confidence,
            }
        )
    return {"mission": mission, "counted": len(scores), "rows": rows}


def main() -> int:
    """Print a table, or one object with ``--json``."""
    parser = running.options(__doc__)
    parser.add_argument("missions", nargs="*", default=SHIPPED, metavar="PLAN:AIRCRAFT")
    args = parser.parse_args()
    results = [corridor(mission) for mission in args.missions]
    rows = [(result, row) for result in results for row in result["rows"]]
    missed = any(
        row["outside"] == KEPT
        and (row["ratio"] > MOST_RATIO or row["short"] > 2.0 * row["may_be_short"])
        for _, row in rows
    )
    if args.json:
        print(json.dumps({"missions": results, "missed": missed}))
        return int(missed)
    for result, row in rows:
        print(
            f"{result['mission']}: {row['outside']} of {row['flights']} flights outside, "
            f"{row['ratio']:.3f} times the true corridor in the median, in 95 % at most "
            f"{row['most']:.3f} times, {100 * row['short']:.2f} % of {PARTS} are left by more "
            f"than was claimed"
        )
    return int(missed)


if __name__ == "__main__":
    running.end(main)
