"""Points of the unit hypercube: random, Latin hypercube, Sobol."""

import hashlib
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.campaign.planning.distributions import LARGEST_POINT, SMALLEST_POINT
from flighttune.errors import InputError

SOBOL_BITS = 32
"""Bits of a coordinate of a Sobol point: the most with which scipy can skip points."""


def unit_points(
    design: str, keys: Sequence[str], *, seed: int, first: int, end: int, points: int
) -> FloatArray:
    """Points `first` to `end` of a design.

    A coordinate of a random or Latin hypercube point depends on the seed, the point and the key
    alone, not on the other keys; a Sobol point on the seed and the set of keys.

    Parameters
    ----------
    design : str
        ``random``, ``latin_hypercube`` or ``sobol``.
    keys : sequence of str
        One a coordinate.
    seed : int
    first, end : int
        Points wanted, `end` not among them.
    points : int
        Points of the whole design; only those of a Latin hypercube depend on it.

    Returns
    -------
    ndarray, shape (end - first, len(keys)), 1
        Inside the open unit interval.

    Raises
    ------
    InputError
        If there is no such design.
    """
    if end <= first or not keys:
        return np.empty((max(end - first, 0), len(keys)))
    match design:
        case "random":
            columns = [_stream(seed, key, first).random(end - first) for key in keys]
            u = np.column_stack(columns)
        case "latin_hypercube":
            u = np.column_stack([_strata(seed, key, points)[first:end] for key in keys])
        case "sobol":
            u = _sobol(seed, tuple(sorted(keys)), first, end)
            u = u[:, np.argsort(np.argsort(np.array(keys)))]
        case _:
            raise InputError(f"`design` must be random, latin_hypercube or sobol, got {design!r}.")
    return np.clip(u, SMALLEST_POINT, LARGEST_POINT)


def run_seeds(seed: int, first: int, end: int, *, name: str = "seed") -> npt.NDArray[np.int64]:
    """Seeds of points `first` to `end`: each depends on the campaign's seed and the point alone.

    Parameters
    ----------
    seed : int
        Of the campaign.
    first, end : int
        Points wanted, `end` not among them.
    name : str
        Of the stream they come from.

    Returns
    -------
    ndarray of int64, shape (end - first,)
        0 to 2^31 - 1.
    """
    raw = _stream(seed, name, first).bit_generator.random_raw(max(end - first, 0))
    return (np.atleast_1d(raw) >> np.uint64(33)).astype(np.int64)


def _stream(seed: int, key: str, skipped: int) -> np.random.Generator:
    """The random numbers of one key, from its number `skipped` on."""
    words = np.frombuffer(hashlib.sha256(key.encode()).digest()[:16], dtype="<u4")
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=tuple(words.tolist())))
    return np.random.Generator(bits.advance(skipped))


@lru_cache(maxsize=256)
def _strata(seed: int, key: str, points: int) -> FloatArray:
    """One coordinate of a Latin hypercube: the coordinates of one are independent permutations."""
    from scipy.stats import qmc

    column = qmc.LatinHypercube(1, rng=_stream(seed, key, 0)).random(points)[:, 0]
    column.flags.writeable = False
    return column


def _sobol(seed: int, keys: tuple[str, ...], first: int, end: int) -> FloatArray:
    from scipy.stats import qmc

    rng = np.random.default_rng(np.random.SeedSequence(seed))
    engine = qmc.Sobol(len(keys), bits=SOBOL_BITS, rng=rng)
    if first:
        u = engine.fast_forward(first).random(end - first)
    else:
        head = engine.random(1)  # alone, as the engine warns of a number that is no power of two
        u = np.vstack([head, engine.random(end - 1)]) if end > 1 else head
    return np.maximum(u, 2.0 ** -(SOBOL_BITS + 1))  # where a bit is all there is, half of it
