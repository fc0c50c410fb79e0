"""Single flights: of a plan's groups, undispersed or in a draw, and of one run flown again."""

from collections.abc import Mapping
from typing import Any

from flighttune.campaign.planning.plan import Group, Plan
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.flight.flown import FlownScenario
from flighttune.flight.fly import Progress, fly, fly_alone
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run


def wind_source(scenario: Scenario, group: Group) -> Group | None:
    """The group whose wind a group replays; None for an aircraft, or in still air.

    In wind, the plants that are not aircraft replay the wind that the scenario's first aircraft met
    with the same gains.
    """
    source = scenario.wind_source
    if source is None or scenario.plant_table(group.plant).aircraft is not None:
        return None
    return Group(source.label, group.gains)


def fly_group(
    plan: Plan, scenario: Scenario, group: Group, wind_runs: dict[Group, Run] | None = None
) -> Run:
    """One flight: a group of a plan in the scenario of a draw, or in the undispersed one.

    `wind_runs` are flights of aircraft in the same scenario, whose wind other plants replay. The
    flight that is needed is flown first where it is missing, and added. PlantError if an aircraft
    cannot be built.
    """
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
    tables.pop("verifies", None)  # a claim of the undispersed flight
    tables["expect"] = scenario.expected(group.plant, group.gains)
    return scenario_from(tables)


def fly_again(plan: Plan, run: int, *, progress: Progress | None = None) -> FlownScenario:
    """Fly a single run of a plan under the label of its group.

    The aircraft whose wind the run replays is flown too.
    """
    return fly(scenario_of_run(plan, run), progress=progress)
