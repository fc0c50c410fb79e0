"""Single flights of a plan's groups, in the scenario of a draw or undispersed."""

from collections.abc import Mapping

from flighttune.campaign.planning.plan import Group, Plan
from flighttune.flight.fly import fly_alone
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import PlantTable
from flighttune.simulate.run import Run


def plant_table(scenario: Scenario, label: str) -> PlantTable:
    """The table of a plant.

    Parameters
    ----------
    scenario : Scenario
    label : str
        Of one of its plants.
    """
    return next(table for table in scenario.plant if table.label == label)


def leader_of(scenario: Scenario, group: Group) -> Group | None:
    """The group whose wind a group replays; None for an aircraft, or in still air.

    In wind, the plants that are not aircraft replay the wind that the scenario's first aircraft met
    with the same gains.

    Parameters
    ----------
    scenario : Scenario
        Of a draw, or the undispersed one.
    group : Group
    """
    if not scenario.windy or plant_table(scenario, group.plant).aircraft is not None:
        return None
    aircraft = (table for table in scenario.plant if table.aircraft is not None)
    first = next(aircraft, None)
    return None if first is None else Group(first.label, group.gains)


def fly_group(plan: Plan, scenario: Scenario, group: Group, *, led: Run | None = None) -> Run:
    """One flight: a group of a plan in the scenario of a draw.

    Parameters
    ----------
    plan : Plan
        With the gains.
    scenario : Scenario
        Of the draw, or the undispersed one.
    group : Group
    led : Run, optional
        The flight of `leader_of`; flown first if it is needed and not given.

    Raises
    ------
    PlantError
        If an aircraft cannot be built.
    """
    leader = leader_of(scenario, group)
    if leader is not None and led is None:
        led = fly_group(plan, scenario, leader)
    table = plant_table(scenario, group.plant)
    return fly_alone(scenario, table, plan.gain_sets[group.gains], group.gains, led=led)


def nominal_flights(plan: Plan) -> Mapping[Group, Run]:
    """The undispersed flight of every group of a plan.

    Parameters
    ----------
    plan : Plan

    Raises
    ------
    PlantError
        If an aircraft cannot be built.
    """
    flown: dict[Group, Run] = {}
    for group in plan.groups:
        leader = leader_of(plan.scenario, group)
        led = None if leader is None else flown.get(leader)
        flown[group] = fly_group(plan, plan.scenario, group, led=led)
    return flown
