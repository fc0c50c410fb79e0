"""Flights of a campaign that can be counted: independent draws, in one air, and in words."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flighttune.claims.counted import About, Counted, other_files
from flighttune.claims.distribution import AIRSPEEDS, Distribution, flown_values, spread
from flighttune.errors import InputError
from flighttune.flight.route import planned_route
from flighttune.planning.draws import dispersed_places
from flighttune.planning.load import campaign_on
from flighttune.planning.plan import Plan, aircraft_hashes, plan_from
from flighttune.planning.schema import Campaign, Choice, Design, Dispersion, Grid, Uniform
from flighttune.scenario.load import scenario_from, spelled
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import INTENSITIES

CALM, STEADY_WIND = "calm", "wind"

# Tables of a scenario that calm air and steady wind do not have.
DROPPED = {CALM: ("disturbance", "gust", "turbulence", "wind"), STEADY_WIND: ("gust", "turbulence")}

# Points of the unit interval at which a dispersed key counts as lowest and highest.
UNIT_ENDS = (1e-9, 1.0 - 1e-9)


def check_random(source: str, distribution: Distribution, central: Scenario) -> None:
    """Refuse flights of a source that are all the same."""
    drawn = any(len({*values}) > 1 for values in distribution.dispersed.values())
    if not (drawn or central.turbulence or central.sensors):
        raise InputError(
            f"{source}: `start_deg` must be given for a scenario in which nothing is random: all "
            "its flights are the same."
        )


def air_of(scenario: Scenario) -> str:
    """Class of a scenario's air: ``calm``, ``wind``, or the intensity of its turbulence."""
    if scenario.turbulence is not None:
        return scenario.turbulence.intensity or f"severity {scenario.turbulence.severity}"
    return STEADY_WIND if scenario.windy or scenario.disturbance is not None else CALM


def in_air(campaign: Campaign, air: str) -> Campaign:
    """A campaign with only the draws that fly in one class of air; in calm air without its wind."""
    nominal, central = campaign.nominal.as_dict(), campaign.central
    airs = {CALM, air_of(central), *((STEADY_WIND,) if central.wind else ())}
    if central.turbulence is not None and central.turbulence.intensity:
        airs |= set(INTENSITIES)
    if air not in airs:
        raise InputError(f"`air` must be one of {', '.join(sorted(airs))}, got {air!r}.")
    dropped = DROPPED.get(air, ("turbulence",) if air in INTENSITIES else ())
    tables = {name: table for name, table in nominal.items() if name not in dropped}
    disperse = [table for table in campaign.disperse if table.key.split(".")[0] not in dropped]
    if air in INTENSITIES:
        turbulence = central.model_dump(mode="json", exclude_none=True)["turbulence"]
        tables["turbulence"] = {**turbulence, "intensity": air}
    return rebuilt(campaign, disperse, scenario_from(tables), campaign.design)


def at_random(campaign: Campaign) -> Campaign:
    """The same campaign with independent draws; points of a grid become equally likely values."""
    disperse = [
        Choice(key=table.key, acts=table.acts, values=table.levels)
        if isinstance(table, Grid)
        else table
        for table in campaign.disperse
    ]
    return rebuilt(campaign, disperse, campaign.nominal, "random")


def rebuilt(
    campaign: Campaign, disperse: Sequence[Dispersion], nominal: Scenario, design: Design
) -> Campaign:
    """A campaign with other draws, correlated as far as their keys are there, and scenario."""
    gridded = any(isinstance(table, Grid) for table in disperse)
    keys = {table.key for table in disperse}
    changed = {
        "design": "random" if design == "grid" and not gridded else design,
        "disperse": disperse,
        "correlation": [
            correlation for correlation in campaign.correlation if keys >= set(correlation.keys)
        ],
    }
    return campaign_on(campaign.model_copy(update=changed), nominal, campaign.title)


def distribution_of(campaign: Campaign, plant: str) -> Distribution:
    """The keys with one value in all flights of a plant, and how all other keys are drawn."""
    position = [table.label for table in campaign.nominal.plant].index(plant)
    # A table that is only there because one of its keys is drawn has its other keys too.
    nominal, fixed = (
        flown_values(scenario, scenario.plant[position])
        for scenario in (campaign.nominal, campaign.central)
    )
    places = dispersed_places(campaign.disperse, campaign.nominal, campaign.title)
    dispersed: dict[str, list[Any]] = {}
    disperse: list[dict[str, Any]] = []
    for table in campaign.disperse:
        plant_places = [
            place for place in places[table.key] if place[0] != "plant" or place[1] == position
        ]
        for place in plant_places:
            key = spelled(("plant", *place[2:]) if place[0] == "plant" else place)
            fixed.pop(key, None)
            dispersed[key] = _range(table, nominal.get(key))
        disperse += [table.model_dump(mode="json")] * bool(plant_places)
    correlation = campaign.model_dump(mode="json", include={"correlation"})
    ends = [end for key, values in dispersed.items() if key.endswith(AIRSPEEDS) for end in values]
    airspeeds = spread([*campaign.central.airspeeds, *ends], "m/s")
    return Distribution(
        title=campaign.title,
        airspeeds=airspeeds if ends else campaign.central.airspeed_words,
        air=air_of(campaign.central),
        fixed=fixed,
        dispersed=dispersed,
        disperse=disperse,
        **correlation,
    )


def _range(table: Dispersion, own: Any) -> list[Any]:
    if isinstance(table, Choice):
        values = [value for value in table.values if value == value]
        if any(isinstance(value, str) for value in values):
            return values
        ends = [min(values), max(values)]
    elif isinstance(table, Uniform):
        ends = [table.lower, table.upper]
    else:
        ends = table.at(np.array(UNIT_ENDS)).tolist()
    if table.acts == "sets":
        return ends
    if own is None:
        raise InputError(f"`acts` of `{table.key}` must be sets: the scenario states no value.")
    if table.acts == "adds":
        return [own + value for value in ends]
    return sorted(own * value for value in ends)


def plan_of(band: Counted) -> Plan:
    """The plan of a count; InputError if the files of an aircraft have changed since."""
    plan = plan_in(band.about)
    if plan.aircraft != aircraft_hashes(plan.scenario):
        raise other_files(plan.aircraft)
    return plan.with_runs(int(band.draws[-1]) + 1)


def plan_in(about: About) -> Plan:
    """The plan in the file of a band; its scenario at the median is computed again."""
    try:
        plan = plan_from(about.plan, "`plan`")
        campaign = campaign_on(plan.campaign, plan.scenario, "`plan`")
        (group,) = plan.groups
        plan.chosen_group(group.plant, group.gains)  # refuses gains that are not there
        if not isinstance(plan.runs, int) or "seed" not in about.plan["campaign"]:
            raise InputError("`plan` must be that of a campaign, with its seed and whole `runs`.")
    except InputError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise InputError("`plan` must be that of a campaign.") from error
    return replace(plan, campaign=campaign)


def check_one_path(plan: Plan, runs: Iterable[int]) -> None:
    """Refuse a fence for runs that do not all fly one path from one start."""
    path, origin, _ = planned_route(plan.campaign.central).where
    for run in runs:  # the same path is planned once
        if planned_route(plan.scenario_of(run)).where[:2] != (path, origin):
            raise InputError(f"a fence must have one path and start for all, got draw {run}.")
