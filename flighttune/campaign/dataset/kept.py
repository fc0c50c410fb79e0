"""Of which runs the whole time history is kept: a choice that follows from the rows alone."""

import numpy as np

from flighttune.campaign.dataset.dataset import Dataset

UNFLOWN = ("crashed", "timed_out", "invalid", "no_gains", "no_trim")
"""Statuses without a time history."""


def chosen(dataset: Dataset) -> tuple[int, ...]:
    """The runs to keep signals of: the first failures, the worst by a measure, and a sample.

    Parameters
    ----------
    dataset : Dataset
        With all its rows.

    Returns
    -------
    tuple of int
        In order. A failure is a run that does not meet what the campaign calls success; the worst
        are those with the largest measure, of all groups together; the sample is drawn by the seed
        of the campaign. Runs without a time history are not among them, and among the worst none
        that do not have the measure.
    """
    campaign = dataset.plan.campaign
    keep = campaign.keep
    rows = dataset.rows(["success", "status", keep.worst_by])
    flew = ~np.isin(rows.column("status").to_numpy(), UNFLOWN)
    run = rows.column("run").to_numpy()[flew]
    success = rows.column("success").fill_null(False).to_numpy()[flew]
    measure = rows.column(keep.worst_by).to_numpy()[flew]
    known = np.flatnonzero(~np.isnan(measure))
    worst = known[np.argsort(-measure[known], kind="stable")]
    random = np.random.default_rng(np.random.SeedSequence((campaign.seed, len(run))))
    sample = random.choice(run, min(keep.sample, len(run)), replace=False)
    picked = {*run[~success][: keep.failures], *run[worst][: keep.worst], *sample}
    return tuple(sorted(int(one) for one in picked))
