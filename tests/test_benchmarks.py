"""The benchmarks: the shipped aircraft they are about, and the slack of their times."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft
from flighttune.conformance import load_conformance
from flighttune.flight.outer_loop import gain_set

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


def benchmark(name):
    spec = spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_count_that_is_kept_is_about_the_shipped_aircraft():
    known = load_conformance(benchmark("bench_tube").LIGHT)
    scenario = ft.load_scenario("paper_identified")

    known.check(
        scenario, scenario.plant_table("jsbsim:aerosonde"), gain_set(scenario, "tuned_identified")
    )
    assert known.attempts[-1].outside == 0
    # That many flights miss an event of probability epsilon at most this often.
    assert (1.0 - known.epsilon) ** known.attempts[-1].flights <= 1.0 - known.confidence


@pytest.mark.slow
@pytest.mark.parametrize(("slower", "missed"), [(0.5, False), (1.2, False), (1.4, True)])
def test_a_batch_may_miss_its_time_by_the_slack_and_no_more(monkeypatch, slower, missed):
    batch = benchmark("bench_batch")
    flights = 7
    cost = slower * batch.SECONDS * flights / batch.MANY
    monkeypatch.setattr(batch, "timed", lambda work, _: (np.array([cost, cost]), work()))

    assert batch.against_single_run(flights, repeats=1) == missed
