"""Ranges of runs: which are missing, and how many are flown at a time."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

CHUNK_S = 10.0
"""Longest time a chunk of runs should take."""

SHORTEST_CHUNK_S = 0.25
"""Time below which what a chunk costs beside its flights is felt: about 5 ms."""

CHUNKS_LEFT = 4
"""Of what is left each worker shall have this many chunks, so that all end together."""

GROWTH = 8


class Span(NamedTuple):
    """The runs from `first` up to, but not including, `end`."""

    first: int
    end: int

    @property
    def runs(self) -> int:
        """How many there are."""
        return self.end - self.first


def missing(there: Iterable[Span], runs: int) -> tuple[Span, ...]:
    """Return the gaps of `there` among the runs 0 to `runs`, in order."""
    gaps, at = [], 0
    for span in sorted(there):
        if at < min(span.first, runs):
            gaps.append(Span(at, min(span.first, runs)))
        at = max(at, span.end)
    if at < runs:
        gaps.append(Span(at, runs))
    return tuple(gaps)


class Chunks:
    """Hands out chunks of the missing runs, of a size that follows from how long flights take.

    Parameters
    ----------
    gaps : iterable of Span
        What is to be flown.
    draw : int
        Runs of one draw: a chunk ends with a draw where it can, because the flights of a draw share
        their wind.
    longest_s : float, s
        Longest time a chunk should take.
    """

    def __init__(self, gaps: Iterable[Span], *, draw: int, longest_s: float = CHUNK_S) -> None:
        self._gaps = list(gaps)[::-1]
        self._draw = draw
        self._longest = longest_s
        self._run_s = math.nan
        self._largest = 0
        self.left = sum(gap.runs for gap in self._gaps)

    def learn(self, span: Span, seconds: float) -> None:
        """Take note of how long a chunk took, s."""
        run_s = seconds / span.runs
        weight = 0.5 if span.runs <= self._largest else 1.0
        self._run_s = (
            run_s if math.isnan(self._run_s) else weight * run_s + (1.0 - weight) * self._run_s
        )
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

    def __iter__(self) -> Iterator[Span]:
        return iter(self._gaps[::-1])

    def _size(self, workers: int) -> int:
        if math.isnan(self._run_s):
            return 1
        share_s = self.left * self._run_s / (CHUNKS_LEFT * workers)
        seconds = min(max(share_s, SHORTEST_CHUNK_S), self._longest)
        return max(1, min(round(seconds / max(self._run_s, 1e-9)), GROWTH * self._largest))

    def _whole_draws(self, end: int, first: int) -> int:
        return max(first // self._draw + 1, math.ceil(end / self._draw)) * self._draw
