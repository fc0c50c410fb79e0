"""The frontier against optima known from elsewhere and the paper's own gains."""

import pytest
from commands import flighttune

import flighttune as ft

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("objective", ["E_K", "decay"])
def test_a_frontier_of_another_objective_is_refused(objective):
    changes = {"tuning.model": "identified", "tuning.objective": objective}

    with pytest.raises(ft.InputError, match=rf"`objective` .* got {objective}"):
        ft.frontier("mission", changes=changes)


def test_a_file_is_no_folder_for_a_frontier(tmp_path):
    _, err = flighttune("tune", "paper", "--frontier", "--out", tmp_path / "f.json", status=2)

    assert "f.json: `--out` must be a folder with --frontier" in err
