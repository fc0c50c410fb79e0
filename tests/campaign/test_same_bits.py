"""The same rows to the bit whoever flies them, and however the runs are divided."""

import pytest
from campaigns import dask_cluster, plan

from flighttune.campaign.dataset import dataset_hash
from flighttune.campaign.engine import run_campaign

RUNS = 48


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return plan(tmp_path_factory.mktemp("files"), runs=RUNS)


@pytest.fixture(scope="module")
def by_one(ours, tmp_path_factory):
    """Hash of what one worker made, in files of its own choice."""
    out = tmp_path_factory.mktemp("one")
    run_campaign(ours, out, workers=1)
    return dataset_hash(out)


@pytest.mark.parametrize("workers", [2, 4])
def test_any_number_of_workers_makes_the_same_rows(tmp_path, ours, by_one, workers):
    run_campaign(ours, tmp_path, workers=workers)

    assert dataset_hash(tmp_path) == by_one


def test_workers_of_a_scheduler_elsewhere_make_the_same_rows(tmp_path, ours, by_one):
    out = tmp_path / "out"
    with dask_cluster(tmp_path, workers=2) as (address, _):
        run_campaign(ours, out, scheduler=address)

    assert dataset_hash(out) == by_one
