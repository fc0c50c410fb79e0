"""Flown runs as a table: what was drawn, what came of it, and the indicators of the loop."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from flighttune.arrays import FloatArray
from flighttune.campaign.flying.columns import MEASURES, table_of
from flighttune.campaign.flying.outcome import FlownRow
from flighttune.campaign.planning.plan import Plan
from flighttune.control.closed_loop import closed_loop
from flighttune.control.linear_model import LinearModel
from flighttune.scenario.schema import Scenario
from flighttune.theory.indicators import indicators_batch


def row_table(plan: Plan, rows: Sequence[FlownRow]) -> pa.Table:
    """Flown runs as rows, in the order given; their schema is `row_schema` of the plan.

    Parameters
    ----------
    plan : Plan
    rows : sequence of FlownRow
        Each with its outcome.
    """
    draws = [plan.draw_of(row.run) for row in rows]
    groups = [plan.group_of(row.run) for row in rows]
    drawn = [plan.values_of(draw) for draw in draws]
    outcomes = [row.outcome for row in rows if row.outcome is not None]
    measured = np.array([outcome.measured for outcome in outcomes]).reshape(-1, len(MEASURES))
    R_K, I_K = _indicators(plan, rows)
    columns: dict[str, Any] = {
        "run": [row.run for row in rows],
        "draw": draws,
        "plant": [group.plant for group in groups],
        "gains": [group.gains for group in groups],
        "seed": [values["seed"] for values in drawn],
        **{key: [values[key] for values in drawn] for key in plan.keys},
        "status": [outcome.status for outcome in outcomes],
        "reason": [outcome.reason for outcome in outcomes],
        "success": [not outcome.missed for outcome in outcomes],
        "missed": ["; ".join(outcome.missed) for outcome in outcomes],
        **{name: measured[:, i] for i, name in enumerate(MEASURES)},
        "R_K": R_K,
        "I_K": I_K,
        "certified": [outcome.certified for outcome in outcomes],
        "wall_s": [outcome.wall_s for outcome in outcomes],
    }
    return table_of(plan, columns)


class _Loop(NamedTuple):
    """What the linear model of a draw depends on; all else of the scenario is not dispersed."""

    V_a: float
    gamma: float
    g: float
    rate_hz: float
    schedule: bool


def _indicators(plan: Plan, rows: Sequence[FlownRow]) -> tuple[FloatArray, FloatArray]:
    """R_K and I_K of the linear loop of each run, NaN where there are no gains or no scenario."""
    models: dict[_Loop, LinearModel] = {}
    loops: dict[tuple[_Loop, str], FloatArray] = {}
    keys: list[tuple[_Loop, str] | None] = []
    for row in rows:
        name = plan.group_of(row.run).gains
        gains = plan.gain_sets[name]
        if gains is None or row.scenario is None:
            keys.append(None)
            continue
        loop = _loop_of(row.scenario)
        if (loop, name) not in loops:
            if loop not in models:
                models[loop] = row.scenario.linear_model()
            loops[loop, name] = closed_loop(models[loop], gains)
        keys.append((loop, name))
    found = _of_loops(loops)
    table = np.array([found[key] if key else (np.nan, np.nan) for key in keys]).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _loop_of(scenario: Scenario) -> _Loop:
    flight, controller = scenario.flight, scenario.controller
    _, gamma = scenario.followed().sampled(np.zeros(1))
    return _Loop(
        flight.V_a_mps, float(gamma[0]), flight.g_mps2, controller.rate_hz, controller.schedule
    )


def _of_loops(
    loops: dict[tuple[_Loop, str], FloatArray],
) -> dict[tuple[_Loop, str], tuple[float, float]]:
    """R_K and I_K of each loop, those of one size at once."""
    found: dict[tuple[_Loop, str], tuple[float, float]] = {}
    for size in {A_K.shape for A_K in loops.values()}:
        alike = {key: A_K for key, A_K in loops.items() if A_K.shape == size}
        both = indicators_batch(np.array(list(alike.values())))
        found.update(
            zip(alike, zip(both.R_K.tolist(), both.I_K.tolist(), strict=True), strict=True)
        )
    return found
