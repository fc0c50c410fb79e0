"""Single runs of a plan flown again, as ``flighttune fly`` flies a scenario."""

from collections.abc import Mapping
from typing import Any

from flighttune.campaign.dataset import NOT_REPRODUCIBLE
from flighttune.campaign.flying.alone import wind_source
from flighttune.campaign.flying.rows import fly_runs
from flighttune.campaign.planning.plan import Plan
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.flight.fly import FlownScenario, Progress, fly
from flighttune.flight.refly import Difference
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario


def scenario_of_run(plan: Plan, run: int, drawn: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario of one run of a plan: its draw, its plant and its gains, these as numbers.

    `drawn` are values in place of those of its draw.
    Flown as any other it gives the flight of the run, to the bit. In wind it also has the aircraft
    whose wind the run replays.
    """
    if not 0 <= run < plan.runs:
        raise InputError(f"`run` must be 0 to {plan.runs - 1}, got {run}.")
    group, draw = plan.group_of(run), plan.draw_of(run)
    scenario = plan.dispersed(plan.values_of(draw) if drawn is None else drawn, draw)
    source = wind_source(scenario, group)
    flying = [group] if source is None else [source, group]
    tables = scenario.as_dict()
    labels = [table.label for table in scenario.plant]
    tables["plant"] = [tables["plant"][labels.index(table.plant)] for table in flying]
    if scenario.law is not None:
        tables["law"] = [scenario.law_table(group.gains).model_dump(exclude_none=True)]
    gains = plan.gain_sets[group.gains]
    if gains is None:
        raise InputError(
            f"`gains` must have been found to fly, got none for {group.gains}: its tuning problem "
            "is infeasible."
        )
    tables["gains"] = [{"name": split_name(group.gains)[1], **gains.as_lists()}]
    tables["title"] = f"{scenario.title}, run {run}"
    tables["expect"] = [
        table
        for table, expect in zip(tables["expect"], scenario.expect, strict=True)
        if expect.meant(group.plant, group.gains)
    ]
    return scenario_from(tables)


def fly_again(plan: Plan, run: int, *, progress: Progress | None = None) -> FlownScenario:
    """Fly a single run of a plan under the label of its group.

    The aircraft whose wind the run replays is flown too.
    """
    return fly(scenario_of_run(plan, run), progress=progress)


def row_differences(plan: Plan, run: int, row: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Every column in which a run that is flown again differs from its row, to the bit.

    It is flown as rows are: a kinematic flight of a batch and a single one differ by rounding.
    """
    again = fly_runs(plan, [run]).to_pylist()[0]
    return tuple(
        Difference(name, None, row[name], value)
        for name, value in again.items()
        # as text: zeros of either sign are two numbers, and NaN equals itself
        if name not in NOT_REPRODUCIBLE and repr(row[name]) != repr(value)
    )
