"""One cluster for all tests that need workers but do no harm to them."""

import pytest
from campaigns import dask_cluster


@pytest.fixture(scope="session")
def address(tmp_path_factory):
    """Address of a real scheduler with a worker of two threads."""
    with dask_cluster(tmp_path_factory.mktemp("cluster"), threads=2) as (address, _):
        yield address
