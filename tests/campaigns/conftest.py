"""One cluster for the tests of a module that do no harm to it: even idle it takes time."""

import pytest
from flown_campaigns import dask_cluster


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """Address of a real scheduler with a worker of one thread."""
    with dask_cluster(tmp_path_factory.mktemp("cluster"), threads=1) as (address, _):
        yield address
