"""The frontier of R_K against I_K, and where it lies against E_K, as a table and as figures."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from flighttune.arrays import check_at_least
from flighttune.control.gains import PIGains
from flighttune.present.chart import Chart
from flighttune.present.palette import INK, NEUTRAL, LineStyle
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.program import Program, stabilising_starts
from flighttune.tuning.result import Assessment, assessment
from flighttune.tuning.tune import STARTS, smallest_radius

if TYPE_CHECKING:
    import pandas as pd

POINTS = 25
WIDEST = 3.0

DECADE = 10.0

# Title and horizontal axis of the figure over each indicator
AXES = {
    "I_K": (
        "R_K against I_K: nothing can lie above the curve",
        "I_K, the paper's bound on the ultimate set [s²]",
    ),
    "E_K": (
        "The same gains against E_K, the exact largest error",
        "E_K, largest error per L_d [s²]; smaller is better",
    ),
}

# Part of the height left for names above and below the marks
ROOM = 0.08


def frontier(
    problem: TuningProblem,
    *,
    points: int = POINTS,
    marked: Mapping[str, PIGains] | None = None,
    starts: int = 1,
) -> "pd.DataFrame":
    """The largest R_K for every I_K, and where given gains lie.

    The `I_star` of the problem plays no part. `points`: at least 2, from the smallest I_K on,
    closest there, to `WIDEST` times that or the largest of the gains `marked`. `starts`: searches
    at each point from drawn gains, besides the one from the gains of the smallest I_K.

    Returns a row for each point and marked set: ``name`` (``frontier`` or the mark), ``I_star``
    (nan for marks), ``I_K``, ``R_K``, ``spectral_abscissa``, ``E_K``, ``within_limits``, ``active``
    (names, separated by spaces) and each gain, ``K_P[phi,chi]`` and so on. R_K never falls along
    the frontier. The rows are those of the marks alone if no stable gains were found within the
    limits. Raises InputError if `points` is less than 2.
    """
    import pandas as pd

    check_at_least(2, points=points)
    marks = {name: assessment(problem, gains.K) for name, gains in (marked or {}).items()}
    rows = [_row(problem, name, math.nan, measured) for name, measured in marks.items()]
    k = stabilising_starts(problem, max(STARTS, starts))
    if (smallest := smallest_radius(problem, k)) is None:
        return pd.DataFrame(rows)
    finite = [measured.I_K for measured in marks.values() if math.isfinite(measured.I_K)]
    I_max = max([WIDEST * smallest.I_K, *finite])
    growth = np.linspace(0.0, 1.0, points) ** 2 * math.log(I_max / smallest.I_K)
    I_star = smallest.I_K * np.exp(growth)
    # At the smallest I_K there is nothing left to search.
    best, along = smallest, [_row(problem, "frontier", smallest.I_K, smallest)]
    first = np.vstack([smallest.K[problem.free], k[:starts]])
    task = Program([replace(problem, I_star=I_star[-1])], "R_K")
    ends, _ = task.descend(np.tile(first, (points - 1, 1)), np.repeat(I_star[1:], len(first)))
    ends = ends.reshape(points - 1, len(first), -1)
    for limit, K in zip(I_star[1:], problem.K(ends), strict=True):
        at_limit = replace(problem, I_star=limit)
        candidates = [best, *(assessment(at_limit, gains) for gains in K)]
        best = max(
            (candidate for candidate in candidates if candidate.meets(at_limit)),
            key=lambda candidate: candidate.R_K,
        )
        along.append(_row(problem, "frontier", limit, best))
    return pd.DataFrame(along + rows)


def frontier_chart(
    table: "pd.DataFrame",
    styles: Mapping[str, LineStyle],
    *,
    against: Literal["I_K", "E_K"] = "I_K",
) -> Chart:
    """Draw the frontier and the marked gains, each with its name, over I_K or over E_K."""
    title, x = AXES[against]
    along, marks = (table[(table["name"] == "frontier") == yes] for yes in (True, False))
    marks = marks[marks["R_K"] > 0.0]
    radii = np.concatenate([np.asarray(table[against], dtype=float) for table in (along, marks)])
    # The axis is logarithmic where it spans more than one decade.
    spread = len(radii) > 1 and radii.max() > DECADE * radii.min()
    chart = Chart(title=title, x=x, y="R_K, guaranteed rate [1/s]", log="x" if spread else "")
    chart.line(along[against], along["R_K"], NEUTRAL, width=2.4, name="largest R_K found")
    columns = (np.asarray(marks[key]) for key in ("name", against, "R_K", "within_limits"))
    points = list(zip(*columns, strict=True))
    # A mark that breaks the input limits is hollow. Gains without a style are dark.
    for name, size, R_K, within in points:
        tip = f"{name}: R_K {R_K:.4f} 1/s, {against} {size:.3f} s²" + (
            "" if within else ", beyond the limits"
        )
        colour = styles[name].colour if name in styles else INK
        chart.points(size, R_K, colour, run="", size=5, filled=bool(within), tips=[tip])
    (low, high), (left, right) = chart.y_ends(), chart.x_ends()
    chart.y_range = (low - ROOM * (high - low), high + ROOM * (high - low))
    side = (right / left) ** ROOM if spread else 1.0
    shift = 0.0 if spread else ROOM * (right - left)
    chart.x_range = (left / side - shift, right * side + shift)
    chart.label_points([(float(x), float(y), str(name)) for name, x, y, _ in points])
    return chart


def _row(
    problem: TuningProblem, name: str, I_star: float, measured: Assessment
) -> dict[str, object]:
    figures = ("I_K", "E_K", "R_K", "spectral_abscissa", "within_limits")
    return {
        "name": name,
        "I_star": I_star,
        **{figure: getattr(measured, figure) for figure in figures},
        "active": " ".join(name for name in measured.active if name != "I_K"),
        **dict(zip(problem.gain_names.flat, measured.K.flat, strict=True)),
    }
