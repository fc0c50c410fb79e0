"""One study and one reproduction for all tests of the paper: they take some seconds each."""

import pytest

from flighttune.outputs.paper.reproduce import reproduce
from flighttune.studies.paper.study import Study


@pytest.fixture(scope="session")
def study():
    """The paper's experiments with the printed gains."""
    return Study()


@pytest.fixture(scope="session")
def reproduction(study, tmp_path_factory):
    """Everything made, and the folder it is in."""
    folder = tmp_path_factory.mktemp("reproduced")
    return reproduce(out=folder, study=study), folder
