"""Draws: the places of the dispersed keys, their values and the seed of every draw.

A draw depends only on the campaign's seed and its number, so that any process makes the draws of
its own chunk, to the bit.
"""

import hashlib
import math
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
import scipy

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, ScenarioError
from flighttune.campaigns.planning.schema import Campaign, CorrelationTable, Dispersion, Grid
from flighttune.flight.scenario.load import Place, places_of, value_at, with_values
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED

# Column of the seeds
SEED = "seed"

# Points of the unit interval stay this far from 0, and `1 - LARGEST_POINT` from 1, where an inverse
# CDF is infinite.
SMALLEST_POINT = 2.0**-54

LARGEST_POINT = 1.0 - 2.0**-53

# Bits of a coordinate of a Sobol point: the maximum with which SciPy can skip points
SOBOL_BITS = 32

# Tables and keys of a scenario that are equal for all draws; each draw has its own seed
NOT_DISPERSED = (
    *("plant.kind", "plant.aircraft", "plant.name", "gains", "tuning", "envelope", "expect"),
    *("seed", "title", "verifies", "source"),
)

# Hint for a key that cannot be dispersed
INSTEAD = {"plant": "give each plant in a [[plant]]", "gains": "give each gain set in `gains`"}


def dispersed_places(
    disperse: Sequence[Dispersion], scenario: Scenario, source: str
) -> dict[str, tuple[Place, ...]]:
    """All places in the undispersed scenario that each dispersed key refers to."""
    values = scenario.as_dict()
    places_by_key: dict[str, tuple[Place, ...]] = {}
    for table in disperse:
        where = f"{source}: [[disperse]] `{table.key}`"
        named = re.sub(r"\[[^\]]*\]", "", table.key)
        top = named.split(".")[0]
        if {named, top} & {*NOT_DISPERSED}:
            why = INSTEAD.get(top, "it is the same for all draws")
            raise ScenarioError(f"{where} must not be dispersed: {why}.")
        # a trial value shows which plants have the key
        tried = {"sets": table.central, "adds": 0.0, "multiplies": 1.0}[table.acts]
        try:
            places = places_of(table.key, values, tried)
        except InputError as error:
            stop = "" if str(error).endswith("?") else "."
            raise ScenarioError(f"{where} {error}{stop}") from None
        for other, theirs in places_by_key.items():
            if any(a[: len(b)] == b[: len(a)] for a in places for b in theirs):
                raise ScenarioError(f"{where} must be dispersed once, but `{other}` means it too.")
        for place in places if table.acts != "sets" else ():
            value = value_at(values, place)
            if isinstance(value, bool) or not isinstance(value, (int, float)):
                raise ScenarioError(
                    f"{where} must be a number in the scenario for `acts` {table.acts!r}, "
                    f"got {'nothing' if value is None else repr(value)}."
                )
        places_by_key[table.key] = places
    return places_by_key


def with_drawn(
    tables: Mapping[str, Any],
    disperse: Sequence[Dispersion],
    places: Mapping[str, tuple[Place, ...]],
    values: Mapping[str, Any],
) -> dict[str, Any]:
    """The tables of a scenario after drawn values have been set, added or multiplied."""
    entries: list[tuple[Place, Any]] = []
    for table in disperse:
        for place in places[table.key]:
            value = values[table.key]
            if table.acts == "adds":
                value = value_at(tables, place) + value
            elif table.acts == "multiplies":
                value = value_at(tables, place) * value
            entries.append((place, value))
    return with_values(tables, entries)


def cycle(campaign: Campaign) -> int:
    """Number of draws that belong together: the cells of the grid."""
    return math.prod(len(grid.levels) for grid in campaign.grids)


def drawn(campaign: Campaign, first: int, end: int, *, draws: int) -> pd.DataFrame:
    """Dispersed values (columns by key, and ``seed``) of draws `first` to `end`, exclusive."""
    length = cycle(campaign)
    point, place = np.divmod(np.arange(first, end), length)
    low, high = first // length, -(-end // length)
    sampled = [table for table in campaign.disperse if not isinstance(table, Grid)]
    keys = [table.key for table in sampled]
    design = "random" if campaign.design == "grid" else campaign.design
    u = unit_points(
        design, keys, seed=campaign.seed, first=low, end=high, points=-(-draws // length)
    )
    u = correlated(u, keys, campaign.correlation)
    columns: dict[str, Any] = {
        table.key: table.at(u[:, i])[point - low] for i, table in enumerate(sampled)
    }
    counts = [len(grid.levels) for grid in campaign.grids]
    cells = np.unravel_index(place, counts) if counts else ()
    for grid, cell, count in zip(campaign.grids, cells, counts, strict=True):
        columns[grid.key] = grid.at((cell + 0.5) / count)
    columns[SEED] = run_seeds(campaign.seed, low, high)[point - low]
    for name, values in columns.items():
        if values.dtype == object:  # a type that does not depend on the number of values
            columns[name] = pd.array(values, dtype="str")
    index = pd.RangeIndex(first, max(end, first), name="draw")
    return pd.DataFrame({name: columns[name] for name in (*campaign.keys, SEED)}, index=index)


def unit_points(
    design: str, keys: Sequence[str], *, seed: int, first: int, end: int, points: int
) -> FloatArray:
    """Points `first` to `end` of a design of `points`, in (0, 1): (end - first, len(keys))."""
    # A coordinate of a random or Latin hypercube point depends only on the seed, the point and the
    # key; a Sobol point depends on the seed and the set of keys.
    if end <= first or not keys:
        return np.empty((max(end - first, 0), len(keys)))
    match design:
        case "random":
            u = np.column_stack([_stream(seed, key, first).random(end - first) for key in keys])
        case "latin_hypercube":
            u = np.column_stack([_strata(seed, key, points)[first:end] for key in keys])
        case _:
            u = _sobol(seed, len(keys), first, end)
            u = u[:, np.argsort(np.argsort(np.array(keys)))]  # coordinates in order of sorted keys
    return np.clip(u, SMALLEST_POINT, LARGEST_POINT)


def run_seeds(seed: int, first: int, end: int) -> npt.NDArray[np.int64]:
    """Seeds of points `first` to `end`, 0 to `LARGEST_SEED`."""
    raw = _stream(seed, SEED, first).bit_generator.random_raw(max(end - first, 0))
    return (np.atleast_1d(raw) >> np.uint64(33)).astype(np.int64) % (LARGEST_SEED + 1)


def correlated(
    u: FloatArray, keys: Sequence[str], correlations: Sequence[CorrelationTable]
) -> FloatArray:
    """Uniform coordinates, (n, keys), correlated by a Gaussian copula."""
    # Normal scores with the correlation ``2 sin(pi rho / 6)`` have Spearman's rank correlation
    # ``rho``: W. H. Kruskal, "Ordinal measures of association", J. Am. Stat. Assoc. 53 (1958)
    # 814-861.
    lower, named = copula_factor(correlations)
    columns = [keys.index(key) for key in named]
    scores = [scipy.special.ndtri(u[:, column]) for column in columns]
    result = u.copy()
    for i, column in enumerate(columns):
        if not np.any(lower[i, :i]):
            continue
        mixed = np.zeros(len(u))
        for j in range(i + 1):  # not a matrix product: a chunk must have the same bits as all draws
            mixed += lower[i, j] * scores[j]
        result[:, column] = np.clip(scipy.special.ndtr(mixed), SMALLEST_POINT, LARGEST_POINT)
    return result


def copula_factor(correlations: Sequence[CorrelationTable]) -> tuple[FloatArray, list[str]]:
    """Lower Cholesky factor of the correlation of the normal scores, and its sorted keys."""
    named = sorted({key for table in correlations for key in table.keys})
    matrix = np.eye(len(named))
    for table in correlations:
        i, j = (named.index(key) for key in table.keys)
        matrix[i, j] = matrix[j, i] = 2.0 * np.sin(np.pi * table.rank / 6.0)
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=np.float64), named
    except np.linalg.LinAlgError:
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        raise InputError(
            "`rank` of the [[correlation]] tables must be possible together (a positive definite "
            f"matrix), got one of smallest eigenvalue {smallest:.3g}."
        ) from None


def _stream(seed: int, key: str, skipped: int) -> np.random.Generator:
    """The random numbers of one key, after the first `skipped`."""
    words = np.frombuffer(hashlib.sha256(key.encode()).digest()[:16], dtype="<u4")
    bits = np.random.PCG64(np.random.SeedSequence(seed, spawn_key=tuple(words.tolist())))
    return np.random.Generator(bits.advance(skipped))


@lru_cache(maxsize=256)  # a chunk needs a few points of a permutation of all points
def _strata(seed: int, key: str, points: int) -> FloatArray:
    """One coordinate of a Latin hypercube: its coordinates are independent permutations."""
    from scipy.stats import qmc

    column = qmc.LatinHypercube(1, rng=_stream(seed, key, 0)).random(points)[:, 0]
    column.flags.writeable = False
    return column


def _sobol(seed: int, keys: int, first: int, end: int) -> FloatArray:
    from scipy.stats import qmc

    rng = np.random.default_rng(np.random.SeedSequence(seed))
    engine = qmc.Sobol(keys, bits=SOBOL_BITS, rng=rng)
    if first:
        u = engine.fast_forward(first).random(end - first)
    else:
        head = engine.random(1)  # alone: the engine warns unless it is a power of two
        u = np.vstack([head, engine.random(end - 1)]) if end > 1 else head
    return np.maximum(u, 2.0 ** -(SOBOL_BITS + 1))  # 0 is the lowest cell: take its middle
