"""What is drawn: the dispersed keys and the seed of every draw of a campaign."""

import math

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.planning.copula import correlated
from flighttune.campaign.planning.design import run_seeds, unit_points
from flighttune.campaign.planning.disperse_table import DisperseTable
from flighttune.campaign.planning.schema import Campaign
from flighttune.scenario.schema import Scenario

SEED = "seed"
"""Column of the seeds, and the factor that stands for chance in a Saltelli design."""

Column = npt.NDArray[np.generic]


def grid_counts(campaign: Campaign) -> tuple[int, ...]:
    """Number of values of each grid key, in order of the file."""
    return tuple(len(table.grid().values) for table in _grids(campaign))


def factors(campaign: Campaign) -> tuple[str, ...]:
    """Factors of a Saltelli design: the dispersed keys, and `SEED` where chance plays a part."""
    if campaign.design != "saltelli":
        return ()
    return (*campaign.keys, SEED) if _by_chance(campaign.central) else campaign.keys


def cycle(campaign: Campaign) -> int:
    """Draws that belong together: the cells of the grid, or A, B and the AB of each factor."""
    if campaign.design == "saltelli":
        return len(factors(campaign)) + 2
    return math.prod(grid_counts(campaign))


def drawn(campaign: Campaign, first: int, end: int, *, draws: int) -> pd.DataFrame:
    """The dispersed values and seeds of draws `first` to `end`.

    Parameters
    ----------
    campaign : Campaign
    first, end : int
        Draws wanted, `end` not among them.
    draws : int
        Draws of the whole campaign; only a Latin hypercube depends on it.

    Returns
    -------
    DataFrame
        Index ``draw``; one column a dispersed key, in order of the file, and ``seed``.
    """
    length = cycle(campaign)
    point, place = np.divmod(np.arange(first, end), length)
    low, high, points = first // length, -(-end // length), -(-draws // length)
    sampled = [table for table in campaign.disperse if table.distribution != "grid"]
    if campaign.design == "saltelli":
        columns = _saltelli(campaign, low, high, point - low, place)
    else:
        u = _points(campaign, [table.key for table in sampled], low, high, points)
        columns = {t.key: t.of().at(u[:, i])[point - low] for i, t in enumerate(sampled)}
        columns |= _cells(campaign, place)
        columns[SEED] = run_seeds(campaign.seed, low, high)[point - low]
    return pd.DataFrame(
        {name: _series(columns[name]) for name in (*campaign.keys, SEED)},
        index=pd.RangeIndex(first, max(end, first), name="draw"),
    )


def _series(values: Column) -> Column | pd.api.extensions.ExtensionArray:
    """Values as a column whose type does not depend on how many there are."""
    return pd.array(values, dtype="str") if values.dtype == object else values


def _by_chance(scenario: Scenario) -> bool:
    """Whether a flight depends on the scenario's seed."""
    seen = scenario.sensors
    noises = () if seen is None else seen.sensors(0).noise_sd
    return scenario.turbulence is not None or any(noises)


def _grids(campaign: Campaign) -> list[DisperseTable]:
    return [table for table in campaign.disperse if table.distribution == "grid"]


def _points(campaign: Campaign, keys: list[str], low: int, high: int, points: int) -> FloatArray:
    kind = "random" if campaign.design == "grid" else campaign.design
    u = unit_points(kind, keys, seed=campaign.seed, first=low, end=high, points=points)
    return correlated(u, keys, campaign.correlation)


def _cells(campaign: Campaign, place: npt.NDArray[np.intp]) -> dict[str, Column]:
    grids = _grids(campaign)
    if not grids:
        return {}
    cells = np.unravel_index(place, grid_counts(campaign))
    counts = grid_counts(campaign)
    return {
        table.key: table.of().at((cell + 0.5) / count)
        for table, cell, count in zip(grids, cells, counts, strict=True)
    }


def _saltelli(
    campaign: Campaign,
    low: int,
    high: int,
    point: npt.NDArray[np.intp],
    place: npt.NDArray[np.intp],
) -> dict[str, Column]:
    """Of point j: A_j, B_j, and A_j with one factor of B_j in turn."""
    keys = campaign.keys
    u = unit_points(
        "sobol",
        [f"{block}:{key}" for block in "AB" for key in keys],
        seed=campaign.seed, first=low, end=high, points=high,
    )  # fmt: skip
    columns: dict[str, Column] = {}
    for i, name in enumerate(factors(campaign)):
        if name == SEED:
            a = run_seeds(campaign.seed, low, high)
            b = run_seeds(campaign.seed, low, high, name="seed of B")
        else:
            distribution = campaign.disperse[i].of()
            a, b = distribution.at(u[:, i]), distribution.at(u[:, len(keys) + i])
        columns[name] = np.where((place == 1) | (place == 2 + i), b[point], a[point])
    columns.setdefault(SEED, run_seeds(campaign.seed, low, high)[point])
    return columns
