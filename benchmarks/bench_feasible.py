"""How much longer the fastest feasible reference takes than any flight within the same limits must.

Run it with ``python benchmarks/bench_feasible.py``; ``--json`` prints one object. Exits with 1
where the paper's change of course and path angle takes more than `MOST` times the lower bound.

The bound is the shortest time in which the exact point mass can make the turn where it may miss the
path angle at the end at a price: `PRICE` of turn for each radian. That only makes it shorter, so
that no flight that ends where it shall is faster. It is the global optimum, found by dynamic
programming over roll, load factor and path angle on grids whose steps are those of the rate limits.
Interpolation between path angles makes it longer; its error falls with their distance, so that the
distance is halved, and the two are extrapolated to none.
"""

import json
import math
from dataclasses import replace

import numpy as np
import running

from flighttune import load_scenario
from flighttune.flight.conditions import manoeuvre_of
from flighttune.routes.feasible import Manoeuvre, feasible_reference

MOST = 1.05
PRICE = 1.0
ROLL_CELLS = 4 if running.QUICK else 24
"""Steps from wings level to the largest roll."""

DISTANCES_DEG = (4.0, 2.0) if running.QUICK else (1.0, 0.5)
GAMMA_DEG = -10.0, 60.0
LONGEST_S = 20.0
NEVER = -1e6


def shortest(manoeuvre: Manoeuvre, distance: float) -> float:
    """The shortest time (s) on a grid whose path angles are `distance` (rad) apart."""
    turn, (_, gamma_end) = abs(manoeuvre.change[0]), manoeuvre.end
    c = manoeuvre.g / manoeuvre.V_a
    h = manoeuvre.upper[0] / manoeuvre.rate_upper[0] / ROLL_CELLS
    roll_step, n_z_step = (rate * h for rate in manoeuvre.rate_upper)
    level = math.cos(gamma_end)
    below, above = (
        math.ceil(abs(edge[1] - level) / n_z_step - 1e-9)
        for edge in (manoeuvre.lower, manoeuvre.upper)
    )  # a step beyond the range: the grid may do more than the aircraft
    phi = np.arange(-ROLL_CELLS, ROLL_CELLS + 1) * roll_step
    n_z = level + np.arange(-below, above + 1) * n_z_step
    gamma = np.radians(GAMMA_DEG[0]) + distance * np.arange(
        round(np.ptp(np.radians(GAMMA_DEG)) / distance) + 1
    )
    value = np.full((len(phi), len(n_z), len(gamma)), NEVER, dtype=np.float32)
    value[ROLL_CELLS, below] = -PRICE * np.abs(gamma - gamma_end)
    moves = [
        _move(phi, n_z, gamma, (a, b), (roll_step, n_z_step), c, h)
        for a in (-1, 0, 1)
        for b in (-1, 0, 1)
    ]
    at = (manoeuvre.u_0[1] - level) / n_z_step + below
    starts = {math.floor(at), math.ceil(at)}
    before = -math.inf
    for k in range(1, math.ceil(LONGEST_S / h)):
        best = np.full_like(value, NEVER)
        for begin, end, lower, share, gain in moves:
            reached = value[end]
            low = np.take_along_axis(reached, lower, 2)
            high = np.take_along_axis(reached, lower + 1, 2)
            np.maximum(best[begin], gain + low + share * (high - low), out=best[begin])
        value = best
        now = max(float(np.interp(manoeuvre.start[1], gamma, value[ROLL_CELLS, j])) for j in starts)
        if now >= turn:
            return h * (k - 1 + max(turn - before, 0.0) / (now - before))
        before = now
    return math.inf


def _move(phi, n_z, gamma, cells, steps, c, h):
    """Where a move begins and ends on the grid, the path angle it leads to, and its turn."""
    begin, end = (
        tuple(
            slice(max(0, -one) + by * one, size - max(0, one) + by * one)
            for one, size in zip(cells, (len(phi), len(n_z)), strict=True)
        )
        for by in (0, 1)
    )
    roll = (phi[begin[0]] + 0.5 * cells[0] * steps[0])[:, None, None]
    load = (n_z[begin[1]] + 0.5 * cells[1] * steps[1])[None, :, None]
    middle = gamma + 0.5 * h * c * (load * np.cos(roll) - np.cos(gamma))
    after = gamma + h * c * (load * np.cos(roll) - np.cos(middle))
    gain = h * c * load * np.sin(roll) / np.cos(middle)
    place = (after - gamma[0]) / (gamma[1] - gamma[0])
    gain = np.where((place < 0.0) | (place > len(gamma) - 1), NEVER, gain).astype(np.float32)
    place = np.clip(place, 0.0, len(gamma) - 1 - 1e-6)
    lower = place.astype(np.int64)
    return begin, end, lower, (place - lower).astype(np.float32), gain


def main() -> int:
    parser = running.options(__doc__)
    as_json = parser.parse_args().json

    manoeuvre = replace(manoeuvre_of(load_scenario("feasible")), lags=None)
    planned = feasible_reference(manoeuvre).duration
    coarse, fine = (shortest(manoeuvre, math.radians(one)) for one in DISTANCES_DEG)
    bound = fine - (coarse - fine)
    result = {
        "planned_s": planned, "bound_s": bound, "coarse_s": coarse, "fine_s": fine,
        "ratio": planned / bound, "most": MOST,
    }  # fmt: skip
    if as_json:
        print(json.dumps(result))
    else:
        print(
            f"the paper's change takes {planned:.3f} s, {planned / bound:.3f} times the lower "
            f"bound of {bound:.3f} s (at most {MOST:g}); on the grids {coarse:.3f} and {fine:.3f} s"
        )
    return 0 if planned <= MOST * bound else 1


if __name__ == "__main__":
    running.end(main)
