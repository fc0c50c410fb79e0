"""Why the printed problem is infeasible, held against tuning at the factors diagnosed."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.tuning.tune import diagnosis
from tests.control.tuning.conftest import relaxed

pytestmark = pytest.mark.slow

BELOW, ABOVE = 0.999, 1.001


@pytest.fixture(scope="module")
def printed_diagnosis(printed):
    return diagnosis(printed)


@pytest.mark.soak
def test_the_printed_problem_needs_between_5_5_and_6_times_its_limits(printed, printed_diagnosis):
    factor = printed_diagnosis.common_factor

    assert 5.5 < factor < 6.0
    assert ft.tune(relaxed(printed, ABOVE * factor)).status == "optimal"
    assert ft.tune(relaxed(printed, BELOW * factor)).status == "infeasible"
    assert printed_diagnosis.binding == ("phi_rate_min",)


@pytest.mark.soak
def test_a_start_on_the_other_side_needs_the_same_factor_on_the_opposite_bounds(
    printed, printed_diagnosis
):
    mirrored = diagnosis(replace(printed, x_0=-printed.x_0))

    assert mirrored.common_factor == pytest.approx(printed_diagnosis.common_factor, rel=1e-6)
    assert mirrored.binding == ("phi_rate_max",)


def test_the_extremes_within_the_printed_limits_are_the_known_ones(printed_diagnosis):
    assert printed_diagnosis.smallest_I_K == pytest.approx(67.15, abs=5e-3)
    assert printed_diagnosis.largest_R_K == pytest.approx(0.2649, abs=5e-5)


def test_the_roll_rate_limit_is_the_one_worth_relaxing(printed, printed_diagnosis):
    worst = printed_diagnosis.limits[0]

    assert worst["name"] == "phi_rate"
    assert worst["use"] == pytest.approx(printed_diagnosis.common_factor, rel=1e-6)
    dropped = ft.tune(relaxed(printed, 1.0, 1.0, np.inf, 1.0))
    assert dropped.smallest_I_K == pytest.approx(worst["smallest_I_K_without"], rel=1e-6)
    names = [one["name"] for one in printed_diagnosis.limits]
    assert sorted(names) == ["n_z", "n_z_rate", "phi", "phi_rate"]
    assert all(limit["factor_alone"] == np.inf for limit in printed_diagnosis.limits)


@pytest.mark.soak
def test_a_single_limit_in_the_way_has_a_factor_of_its_own(printed):
    found = diagnosis(relaxed(printed, 20.0, 20.0, 1.0, 20.0))

    worst = found.limits[0]
    assert worst["name"] == "phi_rate"
    assert worst["factor_alone"] == pytest.approx(found.common_factor, rel=1e-6)


@pytest.mark.soak
def test_without_limits_there_is_no_factor(model):
    unlimited = diagnosis(ft.loop.TuningProblem(model=model, I_star=5.0))
    assert (unlimited.common_factor, unlimited.limits) == (0.0, ())
    hopeless = diagnosis(ft.loop.TuningProblem(model=model, I_star=4.0))
    assert hopeless.common_factor == np.inf
    assert hopeless.gains is None
