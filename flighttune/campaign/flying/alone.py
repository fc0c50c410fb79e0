"""Flights one by one: what a plan's groups fly in a draw, or undispersed."""

from collections.abc import Mapping

from flighttune.campaign.planning.plan import Group, Plan
from flighttune.flight import fly_alone
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import Scenario
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
    """Whose wind a group replays; None where it meets the wind by itself, or there is none.

    In wind the plants that are no aircraft replay, gain set by gain set, what the first aircraft of
    the scenario met.

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
        The flight of `leader_of`; flown first where it is needed and not given.

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
