"""The count of flights that a benchmark keeps is about the shipped aircraft."""

from pathlib import Path

import flighttune as ft
from flighttune.conformance import load_conformance
from flighttune.flight.outer_loop import gain_set

LIGHT = Path(__file__).parents[1] / "benchmarks/light_turbulence.json"


def test_the_count_that_is_kept_is_about_the_shipped_aircraft():
    known = load_conformance(LIGHT)
    scenario = ft.load_scenario("paper_identified")

    known.check(
        scenario, scenario.plant_table("jsbsim:aerosonde"), gain_set(scenario, "tuned_identified")
    )
    assert known.attempts[-1].outside == 0
    # That many flights miss an event of probability epsilon at most this often.
    assert (1.0 - known.epsilon) ** known.attempts[-1].flights <= 1.0 - known.confidence
