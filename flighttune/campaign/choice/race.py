"""The best of several candidates by a percentile, on the same draws, bad ones dropped early."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.campaign.statistics.paired import difference, ordered_quantile
from flighttune.errors import InputError

TAIL_DRAWS = 4
"""Draws beyond the percentile before a candidate may be dropped."""

MIN_DRAWS = 32
RESAMPLES = 1000
DROPPED_BELOW = 0.005
"""Drop a candidate that matches the leader in less than this fraction of resamples."""

MAX_RESAMPLED = 2_000_000
"""Numbers of one candidate that are resampled at a time."""

Tried = tuple[FloatArray, npt.NDArray[np.bool_]]
"""Scores and success of some candidates on some draws, both of shape (candidates, draws)."""

Fly = Callable[[Sequence[str], int, int], Tried | None]
"""Flies candidates on draws from a first to an end; None where it was stopped."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Race:
    """Outcome of a race."""

    # (draws flown,) of every candidate and baseline; infinite where a flight was lost
    scores: Mapping[str, FloatArray]
    success: Mapping[str, npt.NDArray[np.bool_]]  # (draws flown,) of the same
    # probability of doing as well as the leader, when the candidate was dropped
    dropped: Mapping[str, float]
    best: str  # the lowest percentile among the candidates that succeed often enough, if any does
    p_best: float  # 1; share of resamples won, less the probabilities that a drop was wrong
    wins: Mapping[str, float]  # 1; share of resamples that each remaining candidate wins
    loss: float  # mean over the resamples of the percentile of the best less that of the winner
    # (resamples,); percentile of each remaining set less that of the best
    differences: Mapping[str, FloatArray]
    finished: bool  # False where the observer stopped it


def race(
    candidates: Sequence[str],
    fly: Fly,
    *,
    draws: int,
    q: float,
    least_success: float = 0.0,
    baselines: Sequence[str] = (),
    cycle: int = 1,
    seed: int = 0,
) -> Race | None:
    """Fly candidates on more and more draws, and drop those that cannot be the best.

    `q` is the quantile of the scores to minimise. `least_success` is the minimum success rate:
    among candidates below it, the one with the higher rate wins. Baselines fly all draws and
    cannot be chosen. The result is None where the race was stopped before its first analysis.

    Draws are resampled with replacement, the same for all candidates (a paired bootstrap), whole
    cycles at a time. Interim analyses are at fixed numbers of draws, each twice that before.
    """
    if not candidates or draws < 1 or not 0.0 < q < 1.0:
        raise InputError(
            f"a race must have candidates, draws and `q` between 0 and 1, got {len(candidates)}, "
            f"{draws} and {q}."
        )
    scores: dict[str, FloatArray] = {name: np.empty(0) for name in (*candidates, *baselines)}
    success = {name: np.empty(0, dtype=bool) for name in scores}
    left, dropped, flown = list(candidates), {}, 0
    analysed = None
    for analysis, end in enumerate(_interim_analyses(draws, q, cycle)):
        tried = fly((*left, *baselines), flown, end)
        if tried is None:
            break
        for name, new, good in zip((*left, *baselines), *tried, strict=True):
            scores[name] = np.concatenate([scores[name], new])
            success[name] = np.concatenate([success[name], good])
        flown = end
        analysed = _resampled(
            left, baselines, scores, success, q, least_success, cycle, (seed, analysis)
        )
        if end < draws:
            worse = [name for name in left if analysed.as_good[name] < DROPPED_BELOW]
            dropped |= {name: analysed.as_good[name] for name in worse}
            left = [name for name in left if name not in worse]
    if analysed is None:
        return None
    return Race(
        scores=scores,
        success=success,
        dropped=dropped,
        best=analysed.leader,
        # A union bound: each dropped candidate may be the best with the probability at its drop.
        p_best=max(0.0, analysed.wins[analysed.leader] - sum(dropped.values())),
        wins={name: analysed.wins[name] for name in left},
        loss=analysed.loss,
        differences=analysed.differences,
        finished=flown == draws,
    )


def _interim_analyses(draws: int, q: float, cycle: int) -> Iterator[int]:
    """Numbers of draws after which candidates are compared, whole cycles, all draws last."""
    at = max(MIN_DRAWS, math.ceil(TAIL_DRAWS / min(q, 1.0 - q)))
    while (whole := math.ceil(at / cycle) * cycle) < draws:
        yield whole
        at = 2 * whole
    yield draws


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Resampled:
    leader: str
    wins: dict[str, float]
    as_good: dict[str, float]
    loss: float
    differences: dict[str, FloatArray]


def _resampled(
    left: Sequence[str],
    baselines: Sequence[str],
    scores: Mapping[str, FloatArray],
    success: Mapping[str, npt.NDArray[np.bool_]],
    q: float,
    least: float,
    cycle: int,
    seed: tuple[int, int],
) -> _Resampled:
    """The leader on the draws flown, and the share of resamples that each candidate wins."""
    names = [*left, *baselines]
    values = np.array([scores[name] for name in names])
    good = np.array([success[name] for name in names])
    lacks, size = _lacks(good.mean(axis=-1), least), ordered_quantile(values, q)
    chosen = int(_best(lacks[: len(left), None], size[: len(left), None])[0])
    lack = np.empty((len(names), RESAMPLES))
    high = np.empty((len(names), RESAMPLES))
    at = 0
    for picked in _picks(values.shape[1], cycle, seed):
        block = slice(at, at + len(picked))
        for i in range(len(names)):
            lack[i, block] = _lacks(good[i][picked].mean(axis=-1), least)
            high[i, block] = ordered_quantile(values[i][picked], q)
        at += len(picked)
    winners = _best(lack[: len(left)], high[: len(left)])
    no_worse = (lack < lack[chosen]) | ((lack == lack[chosen]) & (high <= high[chosen]))
    above = difference(high, high[chosen])
    lost = -np.take_along_axis(above, winners[None], axis=0)[0]
    return _Resampled(
        leader=left[chosen],
        wins={name: float(np.mean(winners == i)) for i, name in enumerate(left)},
        as_good={name: float(np.mean(no_worse[i])) for i, name in enumerate(left)},
        loss=float(np.mean(np.maximum(lost, 0.0))),
        differences=dict(zip(names, above, strict=True)),
    )


def _picks(n: int, cycle: int, seed: tuple[int, int]) -> Iterator[npt.NDArray[np.intp]]:
    """Indices of resampled draws, shape (some resamples, whole cycles of n)."""
    rng = np.random.default_rng(np.random.SeedSequence(seed[0], spawn_key=(seed[1],)))
    cycles = max(1, n // cycle)
    length = min(cycle, n)
    block = max(1, MAX_RESAMPLED // (cycles * length))
    for first in range(0, RESAMPLES, block):
        some = min(block, RESAMPLES - first)
        picked = rng.integers(cycles, size=(some, cycles))
        yield (picked[..., None] * length + np.arange(length)).reshape(some, -1)


def _lacks(rate: FloatArray, least: float) -> FloatArray:
    return np.maximum(0.0, least - rate)


def _best(lack: FloatArray, size: FloatArray) -> npt.NDArray[np.intp]:
    """Along the first axis: the smallest lack, then the smallest size, then the first."""
    return np.lexsort((size, lack), axis=0)[0]
