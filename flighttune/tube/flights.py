"""Flights that a tube must contain."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import pandas as pd

from flighttune.flight.fly import plant_of
from flighttune.simulate.loop import simulate
from flighttune.tube.result import Tube


def flights_inside(tube: Tube) -> bool:
    """Whether the scenario's own flight and those from the corners of the starts are inside.

    A tube that is not bounded is compared as far as it goes.
    """
    return all(map(tube.contains, _flights(tube)))


def _flights(tube: Tube) -> Iterator[pd.DataFrame]:
    problem = tube.problem
    scenario, condition = problem.scenario, problem.scenario.condition
    table = scenario.plant_table(problem.plant)
    corners = {(0.0, 0.0), *product((-problem.start, problem.start), repeat=2)}
    for chi, gamma in sorted(corners):
        start = replace(condition, chi=condition.chi + chi, gamma=condition.gamma + gamma)
        signals, _ = simulate(
            plant_of(table, scenario),
            problem.controller(),
            scenario.followed(),
            condition=start,
            duration=scenario.flight.duration_s,
        )
        yield signals
