"""Run numbers of a plan to rows, one a run, the same bits however the runs are divided."""

import time
from collections.abc import Callable, Sequence
from itertools import groupby

import pyarrow as pa

from flighttune.campaign.flying.alone import fly_group, leader_of, plant_table
from flighttune.campaign.flying.claim import Claim, claims
from flighttune.campaign.flying.columns import row_schema
from flighttune.campaign.flying.kinematic_batch import batchable, fly_batch
from flighttune.campaign.flying.outcome import FlownRow, Outcome, expected_of, flat, misses
from flighttune.campaign.flying.row_table import row_table
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.errors import FlightTuneError, InputError
from flighttune.metrics import measures
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run

BLOCK = 256
"""Draws that are looked at together: their kinematic flights are flown as a batch."""

INVALID = "invalid"
"""Status of a run whose drawn values the scenario or an aircraft refuses."""

Begins = Callable[[int], None]
"""Told the run before a flight begins, or the first run before those of a batch do."""


def fly_runs(plan: Plan, runs: Sequence[int], *, begins: Begins | None = None) -> pa.Table:
    """Fly runs of a plan.

    Parameters
    ----------
    plan : Plan
    runs : sequence of int
        Which, each once.
    begins : callable, optional
        Told the run before each flight, and the first run before each batch of flights.

    Returns
    -------
    Table
        One row a run in order of `run`; its schema is `row_schema` of the plan. All of it but
        ``wall_s`` depends on the plan and the run alone, to the bit.

    Raises
    ------
    InputError
        If there is no such run, or one is named twice.
    PlantError
        If an aircraft cannot be built as it is, undispersed.

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
        tables.append(row_table(plan, _fly_block(plan, list(block), begins or _nobody)))
    return pa.concat_tables(tables).combine_chunks()


def fly_run(plan: Plan, run: int) -> Run:
    """Fly one run of a plan for its signals.

    Parameters
    ----------
    plan : Plan
    run : int

    Returns
    -------
    Run
        Its provenance has a scenario of this flight alone, gains as numbers, from which it can be
        flown again; see `flighttune.campaign.flying.refly`.

    Raises
    ------
    InputError, ScenarioError
        If there is no such run, or its draw is refused.
    PlantError
        If the aircraft cannot be built.
    """
    from flighttune.campaign.flying.refly import fly_again

    group = plan.group_of(run)
    if plan.gain_sets[group.gains] is None:
        return fly_group(plan, plan.scenario_of(plan.draw_of(run)), group)
    return fly_again(plan, run).run


def fallen_row(
    plan: Plan, run: int, status: str, reason: str, *, wall_s: float = float("nan")
) -> pa.Table:
    """The row of a run that nobody could finish.

    Parameters
    ----------
    plan : Plan
    run : int
    status : str
        ``crashed`` or ``timed_out``.
    reason : str
        A sentence.
    wall_s : float, s, optional
        How long was waited for it; null by default.

    Returns
    -------
    Table
        One row of the schema of the plan.
    """
    outcome = Outcome(status=status, reason=reason, missed=(f"{status}: {reason}",), wall_s=wall_s)
    try:
        scenario = plan.scenario_of(plan.draw_of(run))
    except FlightTuneError:
        scenario = None
    return row_table(plan, [FlownRow(run, scenario, outcome)])


def _nobody(_: int) -> None:
    pass


def _fly_block(plan: Plan, runs: list[int], begins: Begins) -> list[FlownRow]:
    begins(runs[0])
    promised = claims(plan)
    rows: dict[int, FlownRow] = {}
    batches: dict[Group, list[FlownRow]] = {}
    for draw, of_draw in groupby(runs, key=plan.draw_of):
        began = time.perf_counter()
        try:
            scenario = plan.scenario_of(draw)
        except FlightTuneError as error:
            took = time.perf_counter() - began
            rows.update({run: FlownRow(run, None, _refused(error, took)) for run in of_draw})
            continue
        led: dict[Group, Run] = {}
        for run in of_draw:
            group = plan.group_of(run)
            if plan.gain_sets[group.gains] is not None and batchable(
                scenario, plant_table(scenario, group.plant)
            ):
                batches.setdefault(group, []).append(FlownRow(run, scenario, None))
                continue
            begins(run)
            outcome = _fly_alone(plan, scenario, group, led, promised[group])
            rows[run] = FlownRow(run, scenario, outcome)
    for group, members in batches.items():
        begins(members[0].run)
        rows.update({row.run: row for row in _fly_together(plan, group, members, promised[group])})
    return [rows[run] for run in runs]


def _fly_alone(
    plan: Plan, scenario: Scenario, group: Group, led: dict[Group, Run], claim: Claim | None
) -> Outcome:
    """One flight; `led` holds those of the draw whose wind others replay."""
    began = time.perf_counter()
    leader = leader_of(scenario, group)
    try:
        if leader is not None and leader not in led:
            led[leader] = fly_group(plan, scenario, leader)
        run = fly_group(plan, scenario, group, led=None if leader is None else led[leader])
    except FlightTuneError as error:
        return _refused(error, time.perf_counter() - began)
    if scenario.windy and leader is None:
        led[group] = run
    measured = measures(run)
    tables = expected_of(scenario, group)
    return Outcome(
        status=run.status,
        reason=run.reason,
        measured=flat(measured),
        missed=misses(tables, run.status, run.reason, measured),
        certified=claim and claim.of_run(run),
        wall_s=time.perf_counter() - began,
    )


def _fly_together(
    plan: Plan, group: Group, members: list[FlownRow], claim: Claim | None
) -> list[FlownRow]:
    began = time.perf_counter()
    scenarios = [member.scenario for member in members if member.scenario is not None]
    gains = plan.gain_sets[group.gains]
    assert gains is not None
    flown = fly_batch(scenarios, gains, claim)
    each = (time.perf_counter() - began) / len(members)
    tables = expected_of(plan.scenario, group)
    return [
        member._replace(
            outcome=Outcome(
                status=one.status,
                reason=one.reason,
                measured=one.measured,
                missed=misses(tables, one.status, one.reason, one.measured),
                certified=one.certified,
                wall_s=each,
            )
            if one.status
            else _fly_alone(plan, scenario, group, {}, claim)
        )
        for member, scenario, one in zip(members, scenarios, flown, strict=True)
    ]


def _refused(error: FlightTuneError, wall_s: float) -> Outcome:
    reason = " ".join(str(error).split())
    return Outcome(status=INVALID, reason=reason, missed=(f"{INVALID}: {reason}",), wall_s=wall_s)
