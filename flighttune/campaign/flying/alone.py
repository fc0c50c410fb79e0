"""Single flights of a plan's groups, in the scenario of a draw or undispersed."""

from collections.abc import Collection

from flighttune.campaign.planning.plan import Group, Plan
from flighttune.flight.fly import fly_alone
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
    source = wind_source(scenario, group)
    if source is not None and source not in wind_runs:
        fly_group(plan, scenario, source, wind_runs)
    table, gains = scenario.plant_table(group.plant), plan.gain_sets[group.gains]
    wind_run = None if source is None else wind_runs[source]
    run = fly_alone(scenario, table, gains, group.gains, wind_run=wind_run)
    if scenario.windy and source is None:
        wind_runs[group] = run
    return run


def nominal_flights(plan: Plan, groups: Collection[Group] | None = None) -> dict[Group, Run]:
    """The undispersed flight of every group of a plan, or of some; PlantError as `fly_group`."""
    wind_runs: dict[Group, Run] = {}
    wanted = plan.groups if groups is None else groups
    return {group: fly_group(plan, plan.scenario, group, wind_runs) for group in wanted}
