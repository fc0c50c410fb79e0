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


def about_of(**fields):
    """What the file of a count states, of one signal in one window where nothing else is given."""
    half = fields.get("half", np.ones((1, 1)))
    usual = {
        "signals": {"h": "m"}, "coefficients": np.zeros((1, *half.shape)), "half": half,
        "predicted_from": None, "learned": LEARNED, "epsilon": EPSILON, "confidence": CONFIDENCE,
    }  # fmt: skip
    return About(**{**usual, **fields})


def count_of(kind, plan, measured, half, scores, middle=0.0, flights=None, **about):
    """A count of flights that come so many half-widths to either side of a middle."""
    flights = flights or flights_of(plan, measured, len(scores))
    shape = len(flights.edges) - 1, len(measured.units)
    half, middle = (np.array(np.broadcast_to(values, shape)) for values in (half, middle))
    stated = {
        "of": kind.of, "signals": dict(measured.units), "half": half, "coefficients": middle[None],
        "plan": plan.as_dict(), **about,
    }  # fmt: skip
    away = np.array([-1.0, 1.0]) * np.asarray(scores)[:, None, None, None] * half[..., None]
    extremes, wind = (middle[..., None] + away).astype(np.float32), np.zeros((len(scores), 0))
    return kind(about=about_of(**stated), flights=flights, extremes=extremes, wind=wind)


def scores_of(largest):
    """Half-widths of 259 flights: five are outside, one of them infinitely, the others within."""
    return np.concatenate([np.linspace(0.0, largest, FLIGHTS - 5), [2.0, 2.0, 3.0, 4.0, np.inf]])


def plan_of_paper(scenario, *disperse):
    """The plan of those that a made-up count learns from and counts, with the paper's gains."""
    return plan_of(scenario.as_dict(), *disperse, runs=LEARNED + FLIGHTS, gains=["paper"])


def counted_boxes(scenario, half_width=WIDE, roll=ROLL, *disperse):
    """A band of residual signals about zero of the flights of a scenario with the paper's gains.

    Its boxes are as wide as one of its flights, which five others leave, one of them infinitely.
    """
    plan, half = plan_of_paper(scenario, *disperse), [half_width, half_width, roll, ROLL_CHANGE]
    return count_of(ft.Residual, plan, ResidualSignals.chosen(plan, None), half, scores_of(1.0))


def boxes_of(plan, flights, centre, half):
    """A band of residual signals whose flights all come as far as its boxes."""
    scores = np.ones(FLIGHTS)
    return count_of(ft.Residual, plan, flights.measured, half, scores, centre, flights)
