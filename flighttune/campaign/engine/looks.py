"""When enough has been flown: looked at after numbers of runs that are known beforehand."""

import math
from collections.abc import Iterator

import numpy as np

from flighttune.campaign.dataset.dataset import Dataset
from flighttune.campaign.intervals import wilson
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import InputError

FIRST_DRAWS = 100
GROWTH = 1.25


def looks(plan: Plan, halfwidth: float | None) -> Iterator[int]:
    """Numbers of runs after which the rates of success are looked at; the last is all.

    They depend on the plan alone, so that where a campaign stops depends on nobody who flies it.

    Parameters
    ----------
    plan : Plan
        What is flown.
    halfwidth : float or None, 1
        The half width asked for; None to fly everything without a look.

    Raises
    ------
    InputError
        If it is not between 0 and 0.5.
    """
    if halfwidth is None:
        yield plan.runs
        return
    if not 0.0 < halfwidth < 0.5:
        raise InputError(f"`until_halfwidth` must lie between 0 and 0.5, got {halfwidth}.")
    cycle = plan.cycle * len(plan.groups)
    at = FIRST_DRAWS * len(plan.groups)
    while (whole := math.ceil(at / cycle) * cycle) < plan.runs:
        yield whole
        at = max(whole + 1, round(whole * GROWTH))
    yield plan.runs


def widest(dataset: Dataset, runs: int) -> float:
    """Largest half width of Wilson's interval of the rate of success of a group.

    Parameters
    ----------
    dataset : Dataset
        Of a campaign.
    runs : int
        The first so many runs are looked at.
    """
    groups = len(dataset.plan.groups)
    n, successes = np.zeros(groups), np.zeros(groups)
    for rows in dataset.tables(["success"]):
        run = rows.column("run").to_numpy()
        success = rows.column("success").fill_null(False).to_numpy()[run < runs]
        group = run[run < runs] % groups
        n += np.bincount(group, minlength=groups)
        successes += np.bincount(group, weights=success, minlength=groups)
    low, high = wilson(successes, n)
    return float(np.max(high - low) / 2.0)
