"""The same rows to the bit whoever flies them, and however the runs are divided."""

import pytest
from campaigns import SPEED, plan

from flighttune.campaign.dataset import Dataset, dataset_hash
from flighttune.campaign.engine.engine import run_campaign
from flighttune.campaign.flying.rows import fly_runs
from flighttune.flight.fly import library_versions

pytestmark = pytest.mark.slow  # real clusters, processes that are killed

RUNS = 32
KEYS = ("plant.airframe.mass_factor", "plant.airframe.actuator_lag_factor",
        "plant.airframe.coefficient_factors.Cm_alpha", "sensors.chi_noise_sd_deg",
        "sensors.V_a_noise_sd_mps")  # fmt: skip
UNIFORM = """
[[disperse]]
key = "{}"
distribution = "uniform"
lower = 0.95
upper = 1.05
""".format


@pytest.fixture(scope="module")
def ours(tmp_path_factory):
    return plan(
        tmp_path_factory.mktemp("files"), runs=RUNS, disperse=SPEED + "".join(map(UNIFORM, KEYS))
    )


@pytest.fixture(scope="module")
def by_one_process(ours, tmp_path_factory):
    """Hash of what this process makes, in a file of its own choice."""
    dataset = Dataset(tmp_path_factory.mktemp("one"), ours, library_versions())
    dataset.write_plan()
    dataset.write_part(fly_runs(ours, range(RUNS)))
    return dataset_hash(dataset.folder)


@pytest.mark.parametrize("workers", [1, 3])
def test_any_number_of_workers_makes_the_same_rows(tmp_path, ours, by_one_process, workers):
    run_campaign(ours, tmp_path, workers=workers)

    assert dataset_hash(tmp_path) == by_one_process


def test_workers_of_a_scheduler_elsewhere_make_the_same_rows(
    tmp_path, ours, by_one_process, address
):
    run_campaign(ours, tmp_path, scheduler=address)

    assert dataset_hash(tmp_path) == by_one_process
