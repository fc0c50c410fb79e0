"""The frontier against optima known from elsewhere and the paper's own gains."""

import numpy as np
import pytest
from commands import flighttune
from printed import MARKED

import flighttune as ft
from flighttune.control.tuning.tune import frontier

pytestmark = pytest.mark.slow


def test_without_stable_gains_only_the_marks_are_left(model):
    found = frontier(ft.loop.TuningProblem(model=model, K_fixed=np.ones((2, 4))), marked=MARKED)

    assert list(found.name) == list(MARKED)


@pytest.mark.parametrize("objective", ["E_K", "decay"])
def test_a_frontier_of_another_objective_is_refused(objective):
    changes = {"tuning.model": "identified", "tuning.objective": objective}

    with pytest.raises(ft.InputError, match=rf"`objective` .* got {objective}"):
        ft.frontier("mission", changes=changes)


def test_a_file_is_no_folder_for_a_frontier(tmp_path):
    _, err = flighttune("tune", "paper", "--frontier", "--out", tmp_path / "f.json", status=2)

    assert "f.json: `--out` must be a folder with --frontier" in err
