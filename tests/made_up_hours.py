"""Claims per flight hour on a straight route of 300 m: made up, or flown."""

import numpy as np

import flighttune as ft
from flighttune.base.files import code
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.claims import counting
from flighttune.claims.hourly_flights import FlownTerm, hourly_plan
from flighttune.claims.per_hour import PerHour, count_per_hour, volume_of
from flighttune.claims.rates_keys import RatesTable
from flighttune.flight.route import planned_route
from flighttune.routes.maps import on_earth

SHORT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
FENCED = -100.0, 450.0
"""m north of the start: where the fence begins and ends."""

HEALTHY, FAULTY = 8, 6
WINDOW_S, AFTER_S = 14.0, 2.0


def short_plan(changes=SHORT):
    """Flights of the Aerosonde along the route, in light turbulence and wind."""
    return counting.drawn(ft.flights("circuit_in_wind", changes=changes).knowing(None))


def rates():
    """Engine failures, cut after two seconds."""
    fault = {"kind": "engine", "per_hour": 1e-3, "source": "made up", "flights": FAULTY}
    stated = {"flights": HEALTHY, "fault": [{**fault, "ended_s": AFTER_S}]}
    stated["ending"] = {"kind": "cut", "fall_per_height": 1.0}
    return RatesTable.model_validate(stated)


def fence_around(half, plan=None, ends=FENCED, top=None):
    """A fence of a half-width, m, around the route of a plan, as GeoJSON."""
    _, origin, _ = planned_route((plan or short_plan()).campaign.central).where
    corners = [
        (n, side * half) for n, side in zip((0, 0, 1, 1, 0), (-1, 1, 1, -1, -1), strict=True)
    ]
    ring = on_earth(np.array([(ends[n], e) for n, e in corners]), origin)[:, ::-1].tolist()
    shape = {"type": "Polygon", "coordinates": [ring]}
    return shape if top is None else {
        "type": "Feature", "geometry": shape, "properties": {"max_up_m": top},
    }  # fmt: skip


def made_up_hours(half):
    """A claim whose flights were not flown: two with a fault leave."""
    plan, inside = hourly_plan(short_plan()), (-1.0,) * HEALTHY
    fence, table = fence_around(half, plan), rates()
    healthy = FlownTerm(
        fault=None, ended_s=None, left_s=inside, end_s=(WINDOW_S,) * HEALTHY, ended_at_s=inside
    )
    left = (5.0, 6.0, *(-1.0,) * (FAULTY - 2))
    struck = FlownTerm(
        fault=0, ended_s=AFTER_S, left_s=left, end_s=(WINDOW_S,) * FAULTY, ended_at_s=left
    )
    return PerHour(
        rates=table.model_dump(mode="json", exclude_none=True), confidence=0.9,
        plan=plan.as_dict(), volume=volume_of(plan, fence, None), fence=fence,
        terms=(healthy, struck),
    )  # fmt: skip


def hours_flown(half):
    """A claim whose flights JSBSim flew."""
    plan = short_plan()
    with code.in_jsbsim():
        return count_per_hour(
            plan, rates(), fence=fence_around(half, plan), confidence=0.9, fliers=Fliers(workers=1)
        )
