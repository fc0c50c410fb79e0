"""Missions whose flights are made up, and their plans."""

import math

import numpy as np
from made_up_band import count_of
from plans import item, plan_file, waypoint

import flighttune as ft
from flighttune.base.errors import StoppedError
from flighttune.base.files.code import JSBSIM
from flighttune.claims import counted_flights
from flighttune.claims.mission import LEARN
from flighttune.claims.turn_back import TurnBack

# Of a route that is flown in half of the time
HALF = (47.402, 8.503)
AREA = [[47.39, 8.49], [47.39, 8.53], [47.42, 8.53], [47.42, 8.49]]


def mission(path, area=AREA, *, corner=(47.404, 8.506)):
    """Take-off at 47.4 N, 445 m to the north and 450 m to the east, in an area."""
    lat, lon = corner
    fence = {"version": 2, "circles": [], "polygons": [{"inclusion": True, "polygon": area}]}
    return plan_file(
        path,
        item(22, 15, 0, 0, None, 47.4, 8.5, 60),
        item(178, 0, 26, -1, 0, 0, 0, 0, frame=2),
        waypoint(lat, 8.5, 70),
        waypoint(lat, lon, 70),
        geoFence=fence,
        rallyPoints={"points": [[47.401, 8.505, 70]], "version": 2},
    )


def made_up_flights(monkeypatch, lost_every=None, stopped_after=math.inf):
    """The runs that are counted, in place of flights; some of them do not complete.

    The numbers of a run are its own. So many counted flights may be flown before they are stopped.
    """
    counted = []

    def flown(pool, plan, kept, runs, doing="counting"):
        if doing == "counting" and len(counted) + len(runs) > stopped_after:
            raise StoppedError("stopped")
        shape = *kept.shape[:2], 1
        away = [np.random.default_rng([1, run]).uniform(0.1, 0.3, shape) for run in runs]
        extremes = (np.array(away) * [-1.0, 1.0]).astype(np.float32)
        if doing == "counting":
            counted.extend(runs)
            if lost_every:
                extremes[(np.array(runs) - LEARN) % lost_every == 0] = [-np.inf, np.inf]
        return extremes, np.zeros((len(runs), 0)), np.zeros((len(runs), 4 * kept.navigated))

    monkeypatch.setattr("flighttune.claims.counting._flown", flown)
    monkeypatch.setenv(JSBSIM, "1")  # flown again, they would be others
    return counted


def counted_mission(away=(5.0, 2.0), turned=(271.2, 3.4)):
    """A corridor and a room to turn back along a short route, with made-up distances (m)."""
    places = ((0.0, 0.0), (600.0, 0.0), (600.0, 500.0))
    changes = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in places]}
    flights = ft.flights("circuit", changes=changes).knowing("standard")
    plan = flights.plan(plant="kinematic", gains="paper").with_runs(17)

    def counted(kind, plan, away):
        few = {"epsilon": 0.3, "confidence": 0.9}
        measured = kind.measures.chosen(plan, None)
        return count_of(kind, plan.with_runs(17), measured, away, np.ones(7), **few)

    turning = counted_flights.turning_back(plan, 30.0)
    return plan, counted(ft.Band, plan, [*away]), counted(TurnBack, turning, [*turned])
