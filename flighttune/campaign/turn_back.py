"""Room to turn back: flights that turn back at any place of a route, and how far they come."""

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from flighttune.arrays import FloatArray
from flighttune.campaign.counted_flights import rebuilt
from flighttune.claims.distribution import STARTS
from flighttune.errors import InputError
from flighttune.flight.conditions import limits_on
from flighttune.flight.route import planned_route
from flighttune.planning.plan import Plan
from flighttune.planning.schema import Choice, Uniform
from flighttune.references.follow import CHANGE_N_X
from flighttune.scenario.load import scenario_from
from flighttune.scenario.route import DETECTED_S, TurnBackTable, rate_of
from flighttune.simulate.run import Run
from flighttune.units import DEG

# Distance between the places of a route that are known to its flights, m.
APART = 10.0

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
    path, g = planned.reference.path, planned.reference.g
    limits = limits_on(nominal, nominal.plant)
    phi = float(min(limits.upper[0], -limits.lower[0])) / DEG
    phi_rate = float(min(limits.rate_upper[0], -limits.rate_lower[0])) / DEG
    if not 1.0 <= bank_deg <= phi:
        raise InputError(f"`turn_back` must be a bank of 1 to {phi:g} deg, got {bank_deg:g}.")
    for key in plan.keys:
        if key.startswith("route.") or key == "flight.h_m":
            raise InputError(f"`{key}` must be the same in all flights that turn back.")
    s = path.points(APART)
    north_east_up = path.beside(s)
    V_a = np.interp(s, path.s, planned.reference.V)
    turn_rate = np.interp(s, path.s, path.curvature) * V_a / DEG
    gamma = np.arctan(np.interp(s, path.s, path.slope))
    places = {
        "along_m": s,
        "north_m": north_east_up[:, 0],
        "east_m": north_east_up[:, 1],
        "chi_deg": np.interp(s, path.s, path.course) / DEG,
        "gamma_deg": gamma / DEG,
        "h_m": planned.where[2] + north_east_up[:, 2],
        "V_a_mps": V_a,
        "rate_dps": turn_rate * np.cos(gamma),
        "back_dps": rate_of(bank_deg * DEG, V_a + planned.wind, g),
    }
    start_mps = nominal.flight.V_a_mps
    table = {
        "bank_deg": bank_deg,
        "turn_deg": turn_deg,
        "detected_s": DETECTED_S + float(np.abs(V_a - start_mps).max()) / (CHANGE_N_X * g),
        "roll_rate_dps": phi_rate,
        "place": [
            dict(zip(places, row, strict=True)) for row in np.stack([*places.values()], 1).tolist()
        ],
    }
    tables = nominal.as_dict() | {"turn_back": table, "expect": []}
    del tables["route"]
    if planned.reference.holds_airspeed:
        tables["reference"] = {"V_mps": start_mps}
    drawn = [
        # each begins on its route, in its direction
        *(table for table in campaign.disperse if table.key not in STARTS),
        Uniform(key="turn_back.at_m", lower=0.0, upper=path.length),
        Choice(key="turn_back.side", values=[-1, 1]),
    ]
    title = f"{campaign.title}, turning back"
    changed = campaign.model_copy(update={"success": [], "title": title})
    scenario = scenario_from(tables)
    return replace(plan, campaign=rebuilt(changed, drawn, scenario, campaign.design))


def room_of(run: Run, turn_back: TurnBackTable) -> FloatArray:
    """How far a flight came from its route since it detected, shape (samples, 2), as in `ROOM`.

    Its place of detection is put where it is on the route. The distance is that to the nearest
    place, which is never less than that to the route.
    """
    _, north, east, *_ = turn_back.columns
    position = run.signals[["north", "east", "down"]].to_numpy()
    i = int(np.searchsorted(run.t, turn_back.detected_s))
    moved = position - position[i]
    places = cKDTree(np.column_stack([north, east]))
    from_route, _ = places.query(moved[:, :2] + turn_back.here[1:3])
    room = np.column_stack([from_route, np.abs(moved[:, 2])])
    room[:i] = 0.0
    return np.maximum.accumulate(room)
