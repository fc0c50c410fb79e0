"""What the benchmarks say of their numbers: limits kept or not, and gains that do not exist."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def benchmark(name):
    spec = spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def batch():
    return benchmark("bench_batch")


@pytest.mark.parametrize(
    ("wall", "busy", "error", "says", "far"),
    [
        (400.0, 310.0, 2e-9, "equal or better accuracy by us)", False),
        (400.0, 310.0, 5e-10, "better accuracy by them)", False),
        (400.0, 310.0, 2e-9, "wall PASS, processor PASS", False),
        (100.0, 250.0, 2e-9, "wall FAIL, processor FAIL", False),
        (400.0, 229.0, 2e-9, "wall PASS, processor FAIL", True),
        (100.0, 100.0, 1e-3, "accuracy not comparable, no limit", False),
    ],
)
def test_only_processor_time_far_off_fails_and_only_where_accuracy_is_comparable(
    batch, capsys, wall, busy, error, says, far
):
    found = batch.judged_ratio("row", np.array([wall, busy]), error=error, ours=1e-9)

    printed = capsys.readouterr().out
    assert found == far
    assert says in printed
    assert f"error {error:.1e} rad, ours 1.0e-09 rad" in printed


@pytest.mark.parametrize(
    ("wall", "busy", "says", "far"),
    [
        (4.0, 3.5, "wall PASS, processor PASS", False),
        (14.0, 3.5, "wall FAIL, processor PASS", False),
        (14.0, 6.4, "wall FAIL, processor FAIL", False),
        (14.0, 6.6, "wall FAIL, processor FAIL", True),
    ],
)
def test_many_flights_have_five_seconds_and_a_loaded_machine_some_more(
    batch, capsys, wall, busy, says, far
):
    assert batch.judged_seconds(wall, busy) == far
    assert says in capsys.readouterr().out


def test_gains_that_are_not_feasible_have_no_R_K_to_show():
    spread_of_R_K = benchmark("bench_tuning").spread_of_R_K
    met, missed = (SimpleNamespace(status=s, R_K=0.5) for s in ("optimal", "infeasible"))

    assert spread_of_R_K([missed]) == {"R_K_worst": None, "R_K_best": None, "feasible": 0}
    assert spread_of_R_K([met, missed]) == {"R_K_worst": 0.5, "R_K_best": 0.5, "feasible": 1}


def test_every_weather_has_a_limit_of_its_own():
    jsbsim = benchmark("bench_jsbsim")

    assert jsbsim.HIGHEST_RATIO.keys() == jsbsim.WEATHER.keys()
