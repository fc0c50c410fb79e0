"""A lag sampled exactly, against the matrix exponential of SciPy and its own step response."""

from itertools import product

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import expm

import flighttune as ft
from flighttune.plants.lagged import LaggedChannel
from flighttune.tubes.dynamics import SampledLag
from flighttune.tubes.interval import Interval

DT = 0.02
ROUNDING = 1e-12
QUADRATURE = 1e-9

LAGS = [
    ft.loop.InnerLag(order=1, natural_frequency=6.0),
    ft.loop.InnerLag(order=2, natural_frequency=12.0, damping=0.6, delay=0.03),
    ft.loop.InnerLag(order=3, natural_frequency=9.0, damping=0.8, lag=0.1, delay=0.055),
]


@pytest.mark.parametrize("lag", LAGS)
def test_states_pass_as_by_the_matrix_exponential(lag):
    sampled = SampledLag.of(lag, DT)

    assert sampled.transition[:, :-2] == pytest.approx(expm(lag.undelayed[0] * DT), abs=ROUNDING)
    still = np.append(sampled.rest, [1.0, 1.0])
    assert sampled.transition @ still == pytest.approx(sampled.rest, abs=ROUNDING)
    assert sampled.mean @ still == pytest.approx(1.0, abs=ROUNDING)


@pytest.mark.parametrize("lag", LAGS)
def test_a_step_is_answered_as_in_flight_at_every_sample_and_on_average(lag):
    sampled, channel = SampledLag.of(lag, DT), LaggedChannel(lag, 0.0)
    given = [0.0] * (sampled.older + 1)
    state = np.zeros(sampled.order)
    for k in range(12):
        command = 1.0 if k < 5 else -0.5
        channel.order(k * DT, command)
        given.insert(0, command)
        inputs = np.array([*state, given[sampled.older + 1], given[sampled.older]])
        states, edges = sampled.transition @ inputs, sorted(channel.switches((k + 1) * DT))
        area, begin = 0.0, k * DT
        for end in (*edges, (k + 1) * DT):
            area += quad(channel.at, begin, end)[0]
            channel.move_to(end)
            begin = end
        assert states[0] == pytest.approx(channel.at((k + 1) * DT), abs=ROUNDING)
        assert sampled.mean @ inputs == pytest.approx(area / DT, abs=QUADRATURE)
        state = states


@pytest.mark.parametrize("lag", LAGS)
def test_values_within_a_sample_contain_the_response_and_little_more(lag):
    sampled = SampledLag.of(lag, DT)
    start = [Interval(np.array([-0.1]), np.array([0.1])) for _ in range(sampled.order)]
    command = Interval(np.array([0.9]), np.array([1.0]))

    A, B = lag.undelayed
    still = sampled.rest
    # At the end the response is the first row of exp(A h) times the distance from rest, plus rest.
    ends = [
        (still * u + expm(A * DT) @ (np.array(y) - still * u))[0]
        for u in (0.9, 1.0)
        for y in product((-0.1, 0.1), repeat=sampled.order)
    ]
    end = Interval(np.array([min(ends)]), np.array([max(ends)]))

    values = sampled.values_within(start, end, command, DT)

    rng = np.random.default_rng(5)
    for _ in range(200):
        y, u, t = rng.uniform(-0.1, 0.1, sampled.order), rng.uniform(0.9, 1.0), rng.uniform(0, DT)
        response = (still * u + expm(A * t) @ (y - still * u))[0]
        assert values.low[0] <= response <= values.high[0]
    assert values.high[0] - values.low[0] <= 0.2 + 3.0 * DT * (np.abs(A[0]).sum() + B[0])
