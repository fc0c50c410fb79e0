"""Flights of a campaign for a count: independent draws, in one air, or turning back."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
import scipy

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.campaigns.planning.draws import dispersed_places
from flighttune.campaigns.planning.plan import Plan, aircraft_hashes, plan_from
from flighttune.campaigns.planning.schema import Campaign, Choice, Dispersion, Grid, Uniform
from flighttune.campaigns.planning.source import campaign_on
from flighttune.claims.about import Over
from flighttune.claims.counted import BandFlights, Counted, other_files
from flighttune.claims.distribution import AIRSPEEDS, STARTS, Distribution, flown_values, spread
from flighttune.claims.measured import Measured
from flighttune.flight import conditions, route
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.load import scenario_from, spelled
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.follow import CHANGE_N_X, RouteReference
from flighttune.routes.turn_back_keys import DETECTED_S, TurnBackTable, rate_of
from flighttune.vehicles.weather_keys import INTENSITIES

CALM, STEADY_WIND = "calm", "wind"

# Tables of a scenario that calm air and steady wind lack.
DROPPED = {CALM: ("disturbance", "gust", "turbulence", "wind"), STEADY_WIND: ("gust", "turbulence")}

# Distance between the places of a route for its flights, m.
APART = 10.0

# Beginnings of keys on which the path and its start do not depend.
BESIDE_PATH = "plant.airframe.", "wind.", "gust.", "turbulence.", "sensors.", "navigation."

# Turns by their names, deg.
TURNS = {"reversal": 180.0, "circle": 360.0}


def check_random(source: str, distribution: Distribution, central: Scenario) -> None:
    """Refuse flights that are all equal."""
    drawn = any(len({*values}) > 1 for values in distribution.dispersed.values())
    if not (drawn or central.turbulence or central.sensors or central.navigation):
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
    """A campaign restricted to one class of air; in calm air without its wind."""
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
    return rebuilt(campaign, disperse, scenario_from(tables))


def at_random(campaign: Campaign) -> Campaign:
    """The campaign with independent draws; points of a grid become equally likely values."""
    disperse = [
        Choice(key=x.key, acts=x.acts, values=x.levels) if isinstance(x, Grid) else x
        for x in campaign.disperse
    ]
    return rebuilt(campaign.model_copy(update={"design": "random"}), disperse, campaign.nominal)


def rebuilt(campaign: Campaign, disperse: Sequence[Dispersion], nominal: Scenario) -> Campaign:
    """A campaign with other draws and scenario, with the correlations of the remaining keys."""
    keys, design = {table.key for table in disperse}, campaign.design
    if design == "grid" and not any(isinstance(table, Grid) for table in disperse):
        design = "random"
    correlation = [x for x in campaign.correlation if keys >= set(x.keys)]
    changed = {"design": design, "disperse": disperse, "correlation": correlation}
    return campaign_on(campaign.model_copy(update=changed), nominal, campaign.title)


def distribution_of(campaign: Campaign, plant: str) -> Distribution:
    """The keys with one value in all flights of a plant, and the draws of all other keys."""
    position = [table.label for table in campaign.nominal.plant].index(plant)
    # A table that exists only because one of its keys is drawn has its other keys too.
    nominal, fixed = (
        flown_values(scenario, scenario.plant[position])
        for scenario in (campaign.nominal, campaign.central)
    )
    places = dispersed_places(campaign.disperse, campaign.nominal, campaign.title)
    dispersed: dict[str, list[Any]] = {}
    disperse: list[dict[str, Any]] = []
    for table in campaign.disperse:
        own = [x for x in places[table.key] if x[0] != "plant" or x[1] == position]
        for place in own:
            key = spelled(("plant", *place[2:]) if place[0] == "plant" else place)
            fixed.pop(key, None)
            dispersed[key] = _range(table, nominal.get(key))
        disperse += [table.model_dump(mode="json")] * bool(own)
    ends = [end for key, values in dispersed.items() if key.endswith(AIRSPEEDS) for end in values]
    airspeeds = spread([*campaign.central.airspeeds, *ends], "m/s")
    return Distribution(
        title=campaign.title,
        airspeeds=airspeeds if ends else campaign.central.airspeed_words,
        air=air_of(campaign.central),
        fixed=fixed,
        dispersed=dispersed,
        disperse=disperse,
        **campaign.model_dump(mode="json", include={"correlation"}),
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
        ends = table.at(np.array([1e-9, 1.0 - 1e-9])).tolist()  # an end of an unbounded range
    if table.acts == "sets":
        return ends
    if own is None:
        raise InputError(f"`acts` of `{table.key}` must be sets: the scenario states no value.")
    if table.acts == "adds":
        return [own + value for value in ends]
    return sorted(own * value for value in ends)


def flights_of(plan: Plan, measured: Measured, flights: int) -> BandFlights:
    """The flights of a plan and their windows, for a first count of `flights`."""
    (group,), central = plan.groups, plan.campaign.central
    over: Over = "time"
    length, per_unit = central.flight.duration_s, central.controller.rate_hz
    followed, gains = conditions.reference_of(central), plan.gain_sets[group.gains]
    assert gains is not None  # of the chosen group
    if isinstance(followed, RouteReference):
        over, length, per_unit = "along", math.ceil(followed.path.length), 1.0
    samples = round(length * per_unit) + 1
    return BandFlights(
        measured=measured,
        over=over,
        edges=measured.windows(central, samples, flights, per_unit) / per_unit,
        distribution=distribution_of(plan.campaign, group.plant),
        scenario=plan.scenario,
        central=central,
        plant=group.plant,
        gains_name=group.gains,
        gains=gains,
        aircraft=plan.aircraft,
    )


def plan_of(band: Counted) -> Plan:
    """The plan of a count; InputError if the files of an aircraft have changed since then."""
    plan = plan_in(band.about.plan)
    if plan.aircraft != aircraft_hashes(plan.scenario):
        raise other_files(plan.aircraft)
    return plan.with_runs(int(band.draws[-1]) + 1)


def plan_in(tables: Mapping[str, Any]) -> Plan:
    """The plan in the file of a count; its scenario at the median is computed again."""
    try:
        plan = plan_from(tables, "`plan`")
        campaign = campaign_on(plan.campaign, plan.scenario, "`plan`")
        (group,) = plan.groups
        plan.chosen_group(group.plant, group.gains)  # this refuses unknown gains
        if not isinstance(plan.runs, int) or "seed" not in tables["campaign"]:
            raise InputError("`plan` must be that of a campaign, with its seed and whole `runs`.")
    except InputError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise InputError("`plan` must be that of a campaign.") from error
    return replace(plan, campaign=campaign)


def check_one_path(plan: Plan, runs: Iterable[int]) -> None:
    """Refuse a fence unless all runs fly the same path from the same start."""
    if all(key.startswith(BESIDE_PATH) for key in plan.keys):
        return
    path, origin, _ = route.planned_route(plan.campaign.central).where
    for run in runs:  # equal paths are planned once
        if route.planned_route(plan.scenario_of(run)).where[:2] != (path, origin):
            raise InputError(f"a fence must have one path and start for all, got draw {run}.")


def turning_back(plan: Plan, stated: str | float) -> Plan:
    """Flights that turn back with a bank (deg); ``circle:BANK`` means a whole turn."""
    kind, _, bank = str(stated).rpartition(":")
    try:
        bank_deg, turn_deg = float(bank), TURNS[kind or "reversal"]
    except (ValueError, KeyError):
        raise InputError(
            f"`turn_back` must be a bank in deg, or circle:BANK, got {stated!r}."
        ) from None
    nominal, campaign = plan.scenario, plan.campaign
    planned = route.planned_route(campaign.central)
    path, start_mps = planned.reference.path, nominal.flight.V_a_mps
    limits = conditions.limits_on(nominal, nominal.plant)
    phi = float(min(limits.upper[0], -limits.lower[0])) / DEG
    phi_rate = float(min(limits.rate_upper[0], -limits.rate_lower[0])) / DEG
    if not 1.0 <= bank_deg <= phi:
        raise InputError(f"`turn_back` must be a bank of 1 to {phi:g} deg, got {bank_deg:g}.")
    for key in plan.keys:
        if key.startswith("route.") or key == "flight.h_m":
            raise InputError(f"`{key}` must be the same in all flights that turn back.")
    places = _places(planned, bank_deg)
    change_mps = float(np.abs(places["V_a_mps"] - start_mps).max())
    table = {
        "bank_deg": bank_deg,
        "turn_deg": turn_deg,
        "detected_s": DETECTED_S + change_mps / (CHANGE_N_X * planned.reference.g),
        "roll_rate_dps": phi_rate,
        "place": pd.DataFrame(places).to_dict("records"),
    }
    # an aircraft may lack steady flight on a slope that it can fly
    if np.any(places["gamma_deg"]):
        table["or_level"] = True
    tables = nominal.as_dict() | {"turn_back": table, "expect": []}
    del tables["route"]
    if planned.reference.holds_airspeed:
        tables["reference"] = {"V_mps": start_mps}
    drawn = [
        # each flight begins on its route, in the route's direction
        *(table for table in campaign.disperse if table.key not in STARTS),
        Uniform(key="turn_back.at_m", lower=0.0, upper=path.length),
        Choice(key="turn_back.side", values=[-1, 1]),
    ]
    title = f"{campaign.title}, turning back"
    changed = campaign.model_copy(update={"success": [], "title": title})
    return replace(plan, campaign=rebuilt(changed, drawn, scenario_from(tables)))


def _places(planned: route.PlannedRoute, bank_deg: float) -> dict[str, FloatArray]:
    """The places where a flight may turn back, by key of ``[[turn_back.place]]``."""
    path, g = planned.reference.path, planned.reference.g
    s = path.points(APART)
    north, east, up = path.beside(s).T
    V_a = np.interp(s, path.s, planned.reference.V)
    gamma = np.arctan(np.interp(s, path.s, path.slope))
    return {
        "along_m": s,
        "north_m": north,
        "east_m": east,
        "chi_deg": np.interp(s, path.s, path.course) / DEG,
        "gamma_deg": gamma / DEG,
        "h_m": planned.where[2] + up,
        "V_a_mps": V_a,
        "rate_dps": np.interp(s, path.s, path.curvature) * V_a / DEG * np.cos(gamma),
        "back_dps": rate_of(bank_deg * DEG, V_a + planned.wind, g),
    }


def room_of(run: Run, turn_back: TurnBackTable) -> FloatArray:
    """Largest distances of a flight from its route since detection, shape (samples, 2), see `ROOM`.

    Samples begin `detected_s` before detection, even if the flight began earlier.
    """
    _, north, east, *_ = turn_back.columns
    position = run.signals[["north", "east", "down"]].to_numpy()
    i = int(np.searchsorted(run.t, turn_back.found_s))
    moved = position - position[i]
    places = scipy.spatial.cKDTree(np.column_stack([north, east]))
    # The place of detection is mapped to the route. The distance to the nearest place is never less
    # than the distance to the route.
    from_route, _ = places.query(moved[:, :2] + turn_back.here[1:3])
    room = np.column_stack([from_route, np.abs(moved[:, 2])])
    room[:i] = 0.0
    longer = i - int(np.searchsorted(run.t, turn_back.detected_s))
    return np.maximum.accumulate(room)[longer:]
