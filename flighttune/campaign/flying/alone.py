"""Single flights: of a plan's groups, undispersed or in a draw, and of one run flown again."""

from collections.abc import Mapping
from typing import Any

from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.flight.flown import FlownScenario
from flighttune.flight.fly import Progress, fly, fly_alone
from flighttune.planning.plan import Group, Plan
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import GainsTable
from flighttune.simulate.run import Run


def wind_source(scenario: Scenario, group: Group) -> Group | None:
    """The aircraft's group whose wind a group replays; None for an aircraft, or in still air."""
    source = scenario.wind_source
    if source is None or scenario.plant_table(group.plant).aircraft is not None:
        return None
    return Group(source.label, group.gains)


def fly_group(
    plan: Plan, scenario: Scenario, group: Group, wind_runs: dict[Group, Run] | None = None
) -> Run:
    """One flight: a group of a plan in a scenario; `wind_runs` have the wind that others replay."""
    wind_runs = {} if wind_runs is None else wind_runs
    source, wind_run = wind_source(scenario, group), None
    if source is not None:
        wind_run = wind_runs.get(source) or fly_group(plan, scenario, source, wind_runs)
    table, gains = scenario.plant_table(group.plant), plan.gain_sets[group.gains]
    run = fly_alone(scenario, table, gains, group.gains, wind_run=wind_run)
    if scenario.windy and source is None:
        wind_runs[group] = run
    return run


def scenario_of_run(plan: Plan, run: int, drawn: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario of one run of a plan, which `fly` flies to the same bits: gains are numbers."""
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
            f"`gains` must be there to fly, got none for {group.gains}: its tuning was infeasible."
        )
    name = split_name(group.gains)[1]
    tuned_for = {x.name: x.tuned_for for x in scenario.gains if isinstance(x, GainsTable)}
    tables["gains"] = [{"name": name, **gains.as_lists(), "tuned_for": tuned_for.get(name)}]
    tables["title"] = f"{scenario.title}, run {run}"
    tables.pop("verifies", None)  # a claim of the undispersed flight
    tables["expect"] = scenario.expected(group.plant, group.gains)
    return scenario_from(tables)


def fly_again(plan: Plan, run: int, *, progress: Progress | None = None) -> FlownScenario:
    """Fly one run of a plan again, and the aircraft whose wind it replays."""
    return fly(scenario_of_run(plan, run), progress=progress)
