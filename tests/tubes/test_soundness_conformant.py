"""No flight of a conformant model whose residual rates are in its boxes leaves the tube."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import strategies as st

import flighttune as ft
from flighttune.campaign.counted_flights import plan_of
from flighttune.claims.shape import LEAST
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.gaps.residual import residual_rates
from flighttune.simulate.loop import simulate
from flighttune.tubes.problem import tube_problem
from flighttune.tubes.tube import tube_of
from tests.made_up_band import ROLL, ROLL_CHANGE, boxes_of, counted_boxes
from tests.tubes.test_aircraft import flight
from tests.tubes.test_soundness import FEW_PIECES, check_cases, few_or_many

FLIGHTS = 4
SAME = 1e-6
"""rad/s: the residual rates of a flight are found again to the error of integration."""

RATE = st.floats(-0.03, 0.03)
LAGS = [
    one.lags for name in ("aerosonde", "a4") for one in ft.loop.load_identified(name).conditions
]


class Disturbed(ft.loop.PointMassPlant):
    """The model under a disturbance that is constant over each sample, shape (samples, 2).

    Its controller sees `beyond` more roll at each sample.
    """

    def __init__(self, lags, rates, beyond, g):
        self._left, self._now = iter(rates.tolist()), (0.0, 0.0)
        self._beyond = iter(beyond.tolist())
        super().__init__(lags, disturbance=lambda _: self._now, g=g)

    def advance(self, *commands):
        self._now = tuple(next(self._left))
        return super().advance(*commands)

    def observe(self):
        chi, gamma, phi, *rest = super().observe()
        return (chi, gamma, phi + next(self._beyond), *rest)


def roll_beyond(samples, rng):
    """Goes to and fro in its box, as fast as its change may."""
    turns = np.repeat(rng.choice([-1.0, 1.0], samples), rng.choice([1, 5, 40]))[:samples]
    beyond = [rng.uniform(-ROLL, ROLL)]
    for turn in turns[1:]:
        beyond.append(float(np.clip(beyond[-1] + turn * ROLL_CHANGE, -ROLL, ROLL)))
    return np.array(beyond)


@st.composite
def conformant(draw):
    """A scenario of an aircraft, and its model with lags as identified and boxes made up."""
    scenario = flight(
        chi_err_deg=draw(st.floats(-40.0, 40.0)),
        gamma_deg=draw(st.floats(-20.0, 30.0)),
        gamma_ref_deg=draw(st.floats(-20.0, 30.0)),
        roll_dps=draw(st.floats(10.0, 60.0)),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        feed_forward=draw(st.booleans()),
        ramp_dps=draw(st.one_of(st.none(), st.floats(-8.0, 8.0))),
    )
    known = counted_boxes(scenario)
    windows = len(known.flights.edges) - 1
    ends = np.array(draw(st.lists(RATE, min_size=4, max_size=4))).reshape(2, 2)
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    alike = draw(st.sampled_from([1, 5, 25]))  # windows in a row with the same box
    scale = np.repeat(rng.random((2, windows, 2)), alike, axis=1)[:, :windows]
    scale = scale * np.sort(ends, axis=0)[:, None]
    rest = np.tile([ROLL, ROLL_CHANGE], (windows, 1))
    low, high = np.hstack([scale.min(axis=0), -rest]), np.hstack([scale.max(axis=0), rest])
    model = replace(known.flights.model, lags=draw(st.sampled_from(LAGS)))
    flights, centre = replace(known.flights, model=model), 0.5 * (low + high)
    half = np.maximum(0.5 * (high - low), LEAST)
    return scenario, boxes_of(plan_of(known), flights, centre, half)


def check_conformant(case, seed):
    scenario, known = case
    problem = tube_problem(scenario, ft.PAPER_GAINS, band=known)
    found = tube_of(problem, attempts=FEW_PIECES, for_ever=False)
    rng, condition, model = (
        np.random.default_rng(seed),
        start_condition(scenario),
        known.flights.model,
    )
    boxes = known.bounds(problem.t)
    low, high = boxes.low[:-1, :2], boxes.high[:-1, :2]
    for _ in range(FLIGHTS):
        share = rng.random(low.shape) if rng.random() < 0.5 else rng.choice([0.0, 1.0], low.shape)
        rates = low + share * (high - low)
        signals, _ = simulate(
            Disturbed(model.lags, rates, roll_beyond(len(problem.t), rng), scenario.flight.g_mps2),
            problem.controller(),
            reference_of(scenario),
            condition=condition,
            duration=scenario.flight.duration_s,
        )
        again = residual_rates(
            model,
            problem.controller().dt,
            signals[["chi", "gamma"]].to_numpy(),
            signals[["phi_cmd", "n_z_cmd"]].to_numpy(),
            (condition.phi, condition.n_z_start),
        )
        assert again == pytest.approx(rates, abs=SAME)
        assert found.bounds.contain(signals)


@few_or_many(5, 250)
def test_no_flight_in_the_boxes_leaves_the_tube(count):
    check_cases(check_conformant, conformant(), count)
