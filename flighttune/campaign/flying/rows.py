"""Fly runs of a plan into rows, one per run: the same bits however the runs are divided."""

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any

import numpy as np
import pyarrow as pa

from flighttune.arrays import FloatArray
from flighttune.campaign.flying.alone import fly_group
from flighttune.campaign.flying.claim import claims
from flighttune.campaign.flying.columns import RESIDUALS, TUBE_REACH, TUBE_SHARE, row_schema
from flighttune.campaign.flying.kinematic_batch import FlightResult, batchable, fly_batch
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.campaign.planning.schema import MEASURES
from flighttune.control.exact_law import acts_on_rates
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.errors import FlightTuneError, InputError
from flighttune.flight.expectations import missed
from flighttune.guarantee.ultimate_set import UltimateSet
from flighttune.metrics import measures
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run
from flighttune.theory.indicators import indicators_batch

BLOCK = 256
"""Draws of a block: its kinematic flights are flown as a batch."""

DRAWS_ALONE = 12
"""First draws, whose kinematic flights are flown one by one: a campaign of no more does without
compiled code, which takes as long to load as twenty such flights."""

SAMPLES = 4
"""Length, in samples, of the flights of `warm_up`."""

INVALID = "invalid"
"""Status of a run whose drawn values the scenario or an aircraft refuses."""

Begins = Callable[[int], None]
"""Called with the run before a flight begins, or with the first run before a batch begins."""

Outcome = Mapping[str, Any]
"""Columns of the row of a run from ``status`` on, except R_K and I_K."""


def fly_runs(plan: Plan, runs: Sequence[int], *, begins: Begins | None = None) -> pa.Table:
    """Fly runs of a plan.

    Parameters
    ----------
    plan : Plan
    runs : sequence of int
        Which, each once.
    begins : callable, optional
        Called with the run before each flight, with the first run before each batch.

    Returns
    -------
    Table
        One row per run in order of `run`; its schema is `row_schema` of the plan. All of it but
        ``wall_s`` depends only on the plan and the run, to the bit.

    Raises
    ------
    InputError
        If there is no such run, or one is named twice.
    PlantError
        If an undispersed aircraft cannot be built.

    Notes
    -----
    Whatever a draw makes of the scenario is the outcome of its runs: where the scenario or an
    aircraft refuses a drawn value, their status is ``invalid`` and the reason names the key.
    """
    wanted = sorted(runs)
    if wanted and not 0 <= wanted[0] <= wanted[-1] < plan.runs:
        raise InputError(f"`runs` must be 0 to {plan.runs - 1}, got {wanted[0]} to {wanted[-1]}.")
    if len(set(wanted)) < len(wanted):
        raise InputError("`runs` must name each run once.")
    tables = [row_schema(plan).empty_table()]
    for _, block in groupby(wanted, key=lambda run: plan.draw_of(run) // BLOCK):
        tables.append(_fly_block(plan, list(block), begins or (lambda _: None)))
    return pa.concat_tables(tables).combine_chunks()


def crashed_row(plan: Plan, run: int, status: str, reason: str) -> pa.Table:
    """The row of a run that ended the process that flew it, or took too long.

    Parameters
    ----------
    plan : Plan
    run : int
    status : str
        ``crashed`` or ``timed_out``.
    reason : str
        A sentence.

    Returns
    -------
    Table
        One row of the schema of the plan.
    """
    scenarios = {}
    with suppress(FlightTuneError):
        scenarios[run] = plan.scenario_of(plan.draw_of(run))
    return _table(plan, {run: _unflown(status, reason)}, scenarios)


def warm_up(plan: Plan) -> None:
    """Load and compile what flying a plan needs, before the time of its runs is taken.

    It flies the undispersed scenario of every group for a few samples, and makes the claims.

    Parameters
    ----------
    plan : Plan
        Its errors are ignored here: every run of the group reports them in its row.
    """
    scenario = plan.scenario
    short = scenario.flight.model_copy(update={"duration_s": SAMPLES / scenario.controller.rate_hz})
    scenario = scenario.model_copy(update={"flight": short})
    for group in plan.groups:
        gains = plan.gain_sets[group.gains]
        with suppress(FlightTuneError):
            law, _ = scenario.law_of(group.gains)
            table, many = scenario.plant_table(group.plant), plan.draws > _draws_alone(plan)
            if many and gains is not None and batchable(scenario, table, law):
                fly_batch([scenario], law, gains, None)
            fly_group(plan, scenario, group)
    with suppress(FlightTuneError):
        claims(plan)


def _draws_alone(plan: Plan) -> int:
    """How many draws are flown alone.

    None where draws are given: a search gives each of its generations to a plan of its own.
    """
    return DRAWS_ALONE if plan.given is None else 0


def _fly_block(plan: Plan, runs: list[int], begins: Begins) -> pa.Table:
    begins(runs[0])
    claim_of = claims(plan)
    scenarios: dict[int, Scenario] = {}
    outcomes: dict[int, Outcome] = {}
    batches: dict[Group, list[int]] = {}
    for draw, of_draw in groupby(runs, key=plan.draw_of):
        began = time.perf_counter()
        try:
            scenario = plan.scenario_of(draw)
        except FlightTuneError as error:
            outcomes.update(dict.fromkeys(of_draw, _refused(error, began)))
            continue
        wind_runs: dict[Group, Run] = {}
        for run in of_draw:
            group, scenarios[run] = plan.group_of(run), scenario
            table = scenario.plant_table(group.plant)
            law, _ = scenario.law_of(group.gains)
            known = plan.gain_sets[group.gains] is not None and plan.tube is None
            if draw >= _draws_alone(plan) and known and batchable(scenario, table, law):
                batches.setdefault(group, []).append(run)
                continue
            begins(run)
            outcomes[run] = _fly_alone(plan, scenario, group, wind_runs, claim_of[group])
    for group, members in batches.items():
        begins(members[0])
        of_batch = {run: scenarios[run] for run in members}
        outcomes.update(_fly_together(plan, group, of_batch, claim_of[group]))
    return _table(plan, {run: outcomes[run] for run in runs}, scenarios)


def _fly_alone(
    plan: Plan,
    scenario: Scenario,
    group: Group,
    wind_runs: dict[Group, Run],
    claim: UltimateSet | None,
) -> Outcome:
    """One flight; `wind_runs` as for `fly_group`."""
    began = time.perf_counter()
    try:
        run = fly_group(plan, scenario, group, wind_runs)
    except FlightTuneError as error:
        return _refused(error, began)
    result = FlightResult(
        run.status, run.reason, measures(run), None if claim is None else claim.outcome(run)
    )
    columns = dict(_outcome(scenario, group, result, time.perf_counter() - began))
    if run.status == "completed" and plan.residuals is not None:
        extremes = plan.residuals.of_flight(run, scenario.condition)
        columns |= zip(RESIDUALS, (one.ravel() for one in extremes), strict=True)
    if run.status == "completed" and plan.tube is not None:
        columns[TUBE_SHARE] = plan.tube.share(run)
        columns[TUBE_REACH] = plan.tube.reach(run)
    return columns


def _fly_together(
    plan: Plan, group: Group, scenarios: Mapping[int, Scenario], claim: UltimateSet | None
) -> dict[int, Outcome]:
    """Kinematic flights of one group in many draws."""
    began = time.perf_counter()
    gains = plan.gain_sets[group.gains]
    assert gains is not None
    law, _ = plan.scenario.law_of(group.gains)
    batch = fly_batch(list(scenarios.values()), law, gains, claim)
    each = (time.perf_counter() - began) / len(scenarios)
    return {
        run: _outcome(scenario, group, result, each)
        if result is not None
        else _fly_alone(plan, scenario, group, {}, claim)
        for (run, scenario), result in zip(scenarios.items(), batch, strict=True)
    }


def _outcome(scenario: Scenario, group: Group, result: FlightResult, wall_s: float) -> Outcome:
    tables = [table for table in scenario.expect if table.meant(group.plant, group.gains)]
    misses = missed(tables, result.status, result.reason, result.measured)
    columns = {
        f"{subject}.{name}": value
        for subject, values in result.measured.items()
        for name, value in values.items()
    }
    return {
        "status": result.status,
        "reason": result.reason,
        "success": not misses,
        "missed": "; ".join(misses),
        **columns,
        "certified": result.certified,
        "wall_s": wall_s,
    }


def _refused(error: FlightTuneError, began: float) -> Outcome:
    """The outcome of a run whose drawn values are refused."""
    outcome = _unflown(INVALID, " ".join(str(error).split()))
    return {**outcome, "wall_s": time.perf_counter() - began}


def _unflown(status: str, reason: str) -> Outcome:
    return {"status": status, "reason": reason, "success": False, "missed": f"{status}: {reason}"}


def _table(
    plan: Plan, outcomes: Mapping[int, Outcome], scenarios: Mapping[int, Scenario]
) -> pa.Table:
    """Rows of runs, in their order; `scenarios` has none of those that are refused."""
    indicators = _indicators(plan, list(outcomes), scenarios)
    rows = []
    for run, outcome in outcomes.items():
        draw, group = plan.draw_of(run), plan.group_of(run)
        R_K, I_K = indicators.get(run, (None, None))
        row = {"run": run, "draw": draw, "plant": group.plant, "gains": group.gains}
        measured = {name: _number(outcome.get(name)) for name in MEASURES}
        rows.append({**row, **plan.values_of(draw), **outcome, **measured, "R_K": R_K, "I_K": I_K})
    return pa.Table.from_pylist(rows, schema=row_schema(plan))


def _number(value: float | None) -> float | None:
    """The number, or None for NaN."""
    return value if value == value else None


def _indicators(
    plan: Plan, runs: Sequence[int], scenarios: Mapping[int, Scenario]
) -> dict[int, tuple[float | None, float | None]]:
    """R_K and I_K of the linear loop of each run that has gains and a scenario."""
    models: dict[tuple[float | str, ...], LinearModel] = {}
    loops: dict[tuple[float | str, ...], FloatArray] = {}
    keys: dict[int, tuple[float | str, ...]] = {}
    for run in runs:
        name = plan.group_of(run).gains
        gains = plan.gain_sets[name]
        if gains is None or run not in scenarios or scenarios[run].is_own_law(name):
            continue
        scenario = scenarios[run]
        flight, controller = scenario.flight, scenario.controller
        _, gamma = scenario.followed().initial
        # what the linear model of a draw depends on; all else in it is not dispersed
        at = (flight.V_a_mps, gamma, flight.g_mps2, controller.rate_hz, controller.schedule)
        model = (*at, gains.law)
        keys[run] = (*model, name)
        if keys[run] not in loops:
            if model not in models:
                models[model] = scenario.linear_model(rates=acts_on_rates(gains))
            loops[keys[run]] = closed_loop(models[model], gains)
    found: dict[tuple[float | str, ...], tuple[float | None, float | None]] = {}
    for size in {A_K.shape for A_K in loops.values()}:
        alike = {key: A_K for key, A_K in loops.items() if A_K.shape == size}
        both = indicators_batch(np.array(list(alike.values())))
        for key, R_K, I_K in zip(alike, both.R_K.tolist(), both.I_K.tolist(), strict=True):
            found[key] = _number(R_K), _number(I_K)
    return {run: found[key] for run, key in keys.items()}
