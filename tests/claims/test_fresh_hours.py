"""The bound per flight hour against fresh flights with faults drawn as declared."""

from dataclasses import replace

import numpy as np
import pytest
from made_up_hours import fence_around

import flighttune as ft
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.claims import counting
from flighttune.claims.hourly_flights import Ends
from flighttune.claims.leaving import Volume
from flighttune.claims.per_hour import count_per_hour
from flighttune.claims.rates_keys import RatesTable

# A straight route of 600 m, 20 to 36 s at 25 m/s in wind to 8 m/s.
STRAIGHT = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 600.0)]}

# Look-ahead of the guidance, s, and airspeed, m/s.
LOOK_AHEAD_S, V = 3.0, 25.0

# Ends of the strip, m north of the start, and its top, m above it.
ENDS, TOP = (-2000.0, 2600.0), 60.0

# Cases of the claim, those that may be wrong, and fresh hours of each.
CASES, WRONG, HOURS = 20, 1, 15.0


def straight_plan():
    stated = ft.flights("circuit_in_wind", changes=STRAIGHT).knowing("rtk")
    return counting.drawn(stated)


def strip(half):
    """A volume of a half-width in m around the route, far beyond its ends."""
    behind, ahead = ENDS
    corners = ((behind, -half), (ahead, -half), (ahead, half), (behind, half))
    return Volume(rings=(corners,), outside=(False,), low=None, high=TOP)


def fault(kind, flights, **keys):
    return {"kind": kind, "per_hour": 1.0, "source": "a test", "flights": flights, **keys}


def share_by_guidance(jump, half, window_s, time_s):
    """Share of flights that leave a strip after a jump of their position, from Follower's law.

    The distance e of the true path from the one that is flown shrinks by e' = -V sin(atan(e / L)).
    """
    rng, dt, L = np.random.default_rng(1), 0.05, V * LOOK_AHEAD_S
    side = jump * np.sin(rng.uniform(-np.pi, np.pi, 20_000))
    left_s = time_s - rng.uniform(0.0, window_s, len(side))
    beside, out = np.zeros_like(side), np.zeros(len(side), dtype=bool)
    for t in np.arange(0.0, time_s, dt):
        out |= (np.abs(beside) > half) & (t < left_s)
        beside += dt * V * np.sin(np.arctan((side - beside) / L))
    return out.mean()


@pytest.mark.soak
def test_a_jump_of_the_position_leaves_a_strip_as_often_as_the_guidance_says():
    flights, jump, half = 150, 100.0, 40.0
    stated = RatesTable.model_validate(
        {"flights": 20, "fault": [fault("receiver_jump", flights, jump_m=[jump - 0.1, jump + 0.1])]}
    )
    with WorkerPool(Fliers(workers=1)) as pool:
        ends = Ends(plan=straight_plan(), rates=stated, volume=strip(half), alarms=None)
        flown = ends.term(0, None, 24.0).flown(pool, range(flights), "counting")
    left = sum(x.left_s >= 0.0 for x in flown) / flights
    # Flights of 24 s in still air. Wind, and a jump along the route, change the time that is left:
    # the tolerance is three standard deviations of a count, and as much again.
    expected = share_by_guidance(jump, half, 24.0, 24.0)
    assert 0.2 < expected < 0.7
    assert left == pytest.approx(expected, abs=6.0 * np.sqrt(0.25 / flights))


@pytest.mark.counts
def test_the_rate_of_fresh_hours_lies_below_the_bound_in_19_of_20_cases():
    plan, cases = straight_plan(), []
    for case in range(CASES):
        rng = np.random.default_rng(case)
        half = float(rng.uniform(25.0, 80.0))
        stated = RatesTable.model_validate(
            {
                "flights": 500,
                "ending": {"kind": "cut", "fall_per_height": 0.0},
                "fault": [
                    fault("receiver_jump", 40, jump_m=[50.0, 150.0]),
                    fault("aileron_stuck", 40, ended_s=float(rng.uniform(1.0, 4.0))),
                    fault("elevator_stuck", 40),
                    fault("rudder_stuck", 40),
                ],
            }
        )
        seeded = plan.campaign.model_copy(update={"seed": 100 * case})
        bound = count_per_hour(
            replace(plan, campaign=seeded),
            stated,
            fence=fence_around(half, plan, ends=ENDS, top=TOP),
            confidence=0.95,
            fliers=Fliers(workers=2),
        ).bound
        rate = fresh_rate(plan, stated, strip(half), rng)
        cases.append((rate, bound.total))
    assert sum(rate <= most for rate, most in cases) >= CASES - WRONG, cases
    assert all(rate > 0.0 for rate, _ in cases)


def fresh_rate(plan, stated, volume, rng):
    """Exits per hour of fresh flights, each with its faults drawn as declared."""
    fresh = plan.campaign.model_copy(update={"seed": int(rng.integers(10**6, 10**8))})
    ends = Ends(plan=replace(plan, campaign=fresh), rates=stated, volume=volume, alarms=None)
    with WorkerPool(Fliers(workers=2)) as pool:
        healthy = ends.term(None, None, 0.0).flown(pool, range(60), "fresh, healthy")
        mean_s = np.mean([x.end_s for x in healthy])
        flights, left = HOURS * 3600.0 / mean_s, np.mean([x.left_s >= 0.0 for x in healthy])
        exits = flights * left
        window_s = max(x.end_s for x in healthy)
        for i, of_kind in enumerate(stated.fault):
            # A fault after the end of its flight changes nothing.
            faults = int(rng.poisson(flights * of_kind.per_hour * window_s / 3600.0))
            flown = ends.term(i, of_kind.ended_s, window_s).flown(pool, range(faults), "fresh")
            exits += sum(x.left_s >= 0.0 for x in flown) - faults * left
    return exits / HOURS
