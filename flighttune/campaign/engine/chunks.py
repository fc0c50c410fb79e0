"""How many runs a worker is given at a time."""

import math
from collections.abc import Iterable

from flighttune.campaign.dataset import Span

LONGEST_S = 10.0
"""Longest time a chunk should take: it is lost with its worker, or at Ctrl-C."""

SHORTEST_S = 0.25
"""Shortest time of a chunk but for the last ones, which are shared evenly: handing it out costs
5 ms, 2 % of this."""

CHUNKS_LEFT = 4
"""Each worker should get this many more chunks of the runs left, so that all end together."""

GROWTH = 8
"""A chunk is at most this many times the largest so far: the first runs may be unusually quick."""


class Chunks:
    """Hands out chunks of the missing runs; their size follows from how long flights take.

    Parameters
    ----------
    gaps : iterable of Span
        What is to be flown.
    draw : int
        Runs of one draw: a chunk ends with a draw where it can, because the flights of a draw share
        their wind.
    """

    def __init__(self, gaps: Iterable[Span], *, draw: int) -> None:
        self._gaps = list(gaps)[::-1]
        self._draw = draw
        self._run_s = math.nan
        self._largest = 0
        self.left = sum(gap.runs for gap in self._gaps)

    def learn(self, span: Span, seconds: float) -> None:
        """Update the time of a run from that of a chunk, s."""
        run_s = seconds / span.runs
        # A chunk larger than any before replaces the estimate: kinematic flights of one batch
        # share its fixed cost, so that a small chunk overestimates the time of a run.
        if math.isnan(self._run_s) or span.runs > self._largest:
            self._run_s = run_s
        else:
            self._run_s = 0.5 * (run_s + self._run_s)
        self._largest = max(self._largest, span.runs)

    def take(self, workers: int) -> Span | None:
        """The next chunk for one of `workers`; None where there is nothing left."""
        if not self._gaps:
            return None
        gap = self._gaps.pop()
        end = min(gap.end, self._whole_draws(gap.first + self._size(workers), gap.first))
        if end < gap.end:
            self._gaps.append(Span(end, gap.end))
        self.left -= end - gap.first
        return Span(gap.first, end)

    def _size(self, workers: int) -> int:
        if math.isnan(self._run_s):
            return 1
        even_s = self.left * self._run_s / workers
        seconds = min(max(even_s / CHUNKS_LEFT, SHORTEST_S), even_s, LONGEST_S)
        runs = round(seconds / max(self._run_s, 1e-9))  # a clock may say that a run took no time
        return max(1, min(runs, GROWTH * self._largest))

    def _whole_draws(self, end: int, first: int) -> int:
        """The end of a draw at or after `end`, at least one draw after `first`."""
        return max(first // self._draw + 1, math.ceil(end / self._draw)) * self._draw
