"""Bands whose flights are made up: their extremes, and a plan that could be flown."""

import numpy as np
from dispersed import plan_of
from made_up import made_up_scenario

import flighttune as ft
from flighttune.claims.about import About
from flighttune.claims.band import RecordedSignals
from flighttune.claims.counted import BandFlights
from flighttune.claims.counted_flights import flights_of
from flighttune.claims.distribution import Distribution
from flighttune.claims.residual import ResidualSignals
from flighttune.gaps.residual import RESIDUALS

# Half width of the boxes, rad/s: the Aerosonde leaves over a tenth of it in gentle flight.
WIDE = float(np.float32(0.05))

# Half widths, rad: its roll is off that of its model by up to 0.75 deg, 0.04 deg more a sample.
ROLL, ROLL_CHANGE = (float(np.float32(half)) for half in (0.02, 0.002))

# 5 of 259 may lie outside at these
EPSILON, CONFIDENCE, FLIGHTS, LEARNED = 0.05, 0.99, 259, 10


def band_flights(edges, over="time", title="made up", central=None):
    """Flights of the law that end in these windows."""
    distribution = Distribution(
        title=title, airspeeds="25 m/s", air="calm", fixed={"flight.V_a_mps": 25.0}, dispersed={},
        disperse=[], correlation=[],
    )  # fmt: skip
    return BandFlights(
        measured=RecordedSignals(units={}), over=over, edges=edges, distribution=distribution,
        scenario=made_up_scenario(), central=central or made_up_scenario(),
        plant="kinematic", gains_name="paper", gains=ft.PAPER_GAINS, aircraft={},
    )  # fmt: skip


def counted_boxes(scenario, half_width=WIDE, roll=ROLL, *disperse):
    """A band of residual signals about zero of the flights of a scenario with the paper's gains.

    Its boxes are as wide as one of its flights, which five others leave, one of them infinitely.
    """
    halves = [half_width, half_width, roll, ROLL_CHANGE]
    plan = plan_of(scenario.as_dict(), *disperse, runs=LEARNED + FLIGHTS, gains=["paper"])
    flights = flights_of(plan, ResidualSignals.chosen(plan, None), FLIGHTS)
    half = np.tile(halves, (len(flights.edges) - 1, 1))
    scores = np.concatenate([np.linspace(0.0, 1.0, FLIGHTS - 5), [2.0, 2.0, 3.0, 4.0, np.inf]])
    return boxes_of(plan, flights, np.zeros_like(half), half, scores)


def boxes_of(plan, flights, centre, half, scores=(1.0,) * FLIGHTS):
    """A band of residual signals whose flights have these scores, all at the same time."""
    away = np.array([-1.0, 1.0]) * np.asarray(scores)[:, None, None, None] * half[..., None]
    about = About(
        of="residual",
        signals=dict(RESIDUALS),
        coefficients=centre[None],
        half=half,
        predicted_from=None,
        plan=plan.as_dict(),
        learned=LEARNED,
        epsilon=EPSILON,
        confidence=CONFIDENCE,
    )
    extremes = (centre[..., None] + away).astype(np.float32)
    return ft.Residual(
        about=about, flights=flights, extremes=extremes, wind=np.zeros((len(extremes), 0))
    )
