"""The frontier against optima known from elsewhere and the paper's own gains."""

import numpy as np
import pytest
from commands import flighttune
from printed import MARKED

import flighttune as ft
from flighttune.control.certificates.bound import optimal_channel
from flighttune.control.tuning.tune import frontier

pytestmark = pytest.mark.slow

HALF_LAST_DIGIT = 5e-5


@pytest.fixture(scope="module")
def paper_frontier(model):
    return frontier(ft.loop.TuningProblem(model=model), points=12, marked=MARKED)


@pytest.mark.soak
def test_none_of_the_papers_gains_lie_above_the_frontier(paper_frontier):
    line = paper_frontier[paper_frontier.name == "frontier"]
    marks = paper_frontier[paper_frontier.name != "frontier"]

    reachable = np.interp(marks.I_K, line.I_K, line.R_K)

    assert list(marks.name) == list(MARKED)
    assert (marks.R_K.to_numpy() < reachable).all()
    assert line.I_K.max() >= marks.I_K.max()


def test_the_frontier_rises_from_the_smallest_i_k(paper_frontier):
    line = paper_frontier[paper_frontier.name == "frontier"]

    assert line.I_K.iloc[0] == pytest.approx(4.8503, abs=HALF_LAST_DIGIT)
    assert (np.diff(line.R_K) > 0.0).all()
    assert (line.I_K <= line.I_star * (1.0 + 1e-12)).all()
    marks = paper_frontier[paper_frontier.name != "frontier"]
    assert len(line) == 12
    assert line.I_star.iloc[-1] == pytest.approx(max(3.0 * line.I_K.iloc[0], marks.I_K.max()))
    assert (np.diff(line.I_star, 2) > 0.0).all()  # closest at the smallest
    assert (line.active == "").all()  # without limits I_K alone binds


def test_a_point_of_the_frontier_is_the_known_optimum(model):
    line = frontier(ft.loop.TuningProblem(model=model), points=2)

    known = optimal_channel(line.I_star.iloc[-1])
    assert line.R_K.iloc[-1] == pytest.approx(known.R_K, abs=1e-5)


def test_without_stable_gains_only_the_marks_are_left(model):
    found = frontier(ft.loop.TuningProblem(model=model, K_fixed=np.ones((2, 4))), marked=MARKED)

    assert list(found.name) == list(MARKED)


@pytest.mark.parametrize("objective", ["E_K", "decay"])
def test_a_frontier_of_another_objective_is_refused(objective):
    changes = {"tuning.model": "identified", "tuning.objective": objective}

    with pytest.raises(ft.InputError, match=rf"`objective` .* got {objective}"):
        ft.frontier("mission", changes=changes)


def test_a_frontier_has_two_points_or_more(model):
    with pytest.raises(ft.InputError, match="`points` must be at least 2"):
        frontier(ft.loop.TuningProblem(model=model), points=1)


def test_a_file_is_no_folder_for_a_frontier(tmp_path):
    _, err = flighttune("tune", "paper", "--frontier", "--out", tmp_path / "f.json", status=2)

    assert "f.json: `--out` must be a folder with --frontier" in err


@pytest.mark.slow
def test_the_frontier_of_a_scenario_has_its_gains_and_the_papers():
    table = ft.frontier("paper", points=2).table

    assert set(table["name"]) == {"frontier", "paper", "tuned", *(f"K{i}" for i in range(1, 7))}
