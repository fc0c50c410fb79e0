"""Room to turn back: flights that turn back at any place of a route, and how far they come."""

import math
from dataclasses import replace

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError
from flighttune.flight.conditions import limits_on
from flighttune.flight.route import planned_route
from flighttune.planning.load import campaign_on
from flighttune.planning.plan import Plan
from flighttune.planning.schema import Choice, Uniform
from flighttune.scenario.load import scenario_from
from flighttune.scenario.turn_back import DETECTED_S, rate_of
from flighttune.simulate.run import Run
from flighttune.units import DEG

# Distance between the places of a route that are known to its flights, m.
APART = 20.0

# Turns by their names, deg.
TURNS = {"reversal": 180.0, "circle": 360.0}


def turning_back(plan: Plan, stated: str | float) -> Plan:
    """The flights of a plan as they turn back: at any place of their route, to either side.

    `stated` is the bank in deg, after ``circle:`` for a whole turn.
    """
    kind, _, bank = str(stated).rpartition(":")
    try:
        bank_deg, turn_deg = float(bank), TURNS[kind or "reversal"]
    except (ValueError, KeyError):
        raise InputError(
            f"`turn_back` must be a bank in deg, or circle:BANK, got {stated!r}."
        ) from None
    nominal, campaign = plan.scenario, plan.campaign
    planned = planned_route(campaign.central)
    path, V_a, g = planned.reference.path, planned.reference.V_a, planned.reference.g
    limits = limits_on(nominal, nominal.plant)
    phi, phi_rate = (
        min(float(upper[0]), -float(lower[0])) / DEG
        for lower, upper in (
            (limits.lower, limits.upper),
            (limits.rate_lower, limits.rate_upper),
        )
    )
    if not 1.0 <= bank_deg <= phi:
        raise InputError(f"`turn_back` must be a bank of 1 to {phi:g} deg, got {bank_deg:g}.")
    for key in plan.keys:
        if key.startswith("route.") or key in ("flight.chi_deg", "flight.gamma_deg", "flight.h_m"):
            raise InputError(f"`{key}` must be the same in all flights that turn back.")
    s = path.points(APART)
    north_east_up = path.beside(s)
    turn_rate = np.interp(s, path.s, path.curvature) * V_a / DEG
    gamma = np.arctan(np.interp(s, path.s, path.slope))
    places = {
        "along_m": s,
        "chi_deg": np.interp(s, path.s, path.course) / DEG,
        "gamma_deg": gamma / DEG,
        "h_m": planned.where[2] + north_east_up[:, 2],
        "rate_dps": turn_rate * np.cos(gamma),
    }
    rate = rate_of(bank_deg * DEG, V_a + planned.wind, g)
    listed = zip(*(column.tolist() for column in places.values()), strict=True)
    table = {
        "bank_deg": bank_deg,
        "turn_deg": turn_deg,
        "rate_dps": rate,
        "roll_rate_dps": phi_rate,
        "place": [dict(zip(places, place, strict=True)) for place in listed],
    }
    tables = nominal.as_dict() | {"turn_back": table, "expect": []}
    del tables["route"]
    if planned.reference.holds_airspeed:
        tables["reference"] = {"V_mps": V_a}
        tables["flight"]["V_a_mps"] = V_a  # the largest of the route
    drawn = [
        *campaign.disperse,
        Uniform(key="turn_back.at_m", lower=0.0, upper=path.length),
        Choice(key="turn_back.side", values=[-1, 1]),
    ]
    title = f"{campaign.title}, turning back"
    changed = campaign.model_copy(update={"disperse": drawn, "success": [], "title": title})
    scenario = scenario_from(tables)
    return replace(plan, campaign=campaign_on(changed, scenario, title))


def room_of(run: Run) -> FloatArray:
    """How far a flight came from where it detected, shape (samples, 2), as in `ROOM` of bands."""
    north, east, down, chi = run.signals[["north", "east", "down", "chi"]].to_numpy().T
    i = int(np.searchsorted(run.t, DETECTED_S))
    ahead = (north - north[i]) * math.cos(chi[i]) + (east - east[i]) * math.sin(chi[i])
    room = np.column_stack([ahead, np.abs(down - down[i])])
    room[:i] = 0.0
    return np.maximum.accumulate(room)
