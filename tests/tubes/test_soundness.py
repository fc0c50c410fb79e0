"""No flight leaves a tube: gains, limits, references and rates as hypothesis finds them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up import made_up_scenario

import flighttune as ft
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.simulate.batch import fly_sampled
from flighttune.simulate.disturbance import Sinusoid
from flighttune.tubes.enclosure import Settings
from flighttune.tubes.exact import enclosure_of
from flighttune.tubes.problem import QUANTITIES, tube_problem
from flighttune.tubes.sample import start_set
from flighttune.tubes.search import Search
from flighttune.tubes.tube import tube_of

DEG = math.pi / 180.0

FLIGHTS = 64
FEW_PIECES = [Settings(sides=2, symbols=120, tolerance=0.5, most=6)]


def made_up(
    chi_err_deg=60.0,
    gamma_deg=45.0,
    gamma_ref_deg=15.0,
    roll_deg=45.0,
    roll_dps=30.0,
    n_z_max=2.1,
    n_z_per_s=1.0,
    rate_hz=50.0,
    duration_s=0.8,
    anti_windup="conditional",
    feed_forward=True,
    ramp_dps=None,
):
    gamma_ref = gamma_ref_deg
    if ramp_dps is not None:
        gamma_ref = [{"shape": "ramp", "start_s": 0.2, "rate_dps": ramp_dps, "duration_s": 1.0}]
    return made_up_scenario(
        flight={"chi_deg": chi_err_deg, "gamma_deg": gamma_deg, "duration_s": duration_s},
        reference={"gamma_deg": gamma_ref},
        limits={
            "phi_deg": [-roll_deg, roll_deg],
            "phi_rate_dps": roll_dps,
            "n_z": [-n_z_max, n_z_max],
            "n_z_rate_per_s": n_z_per_s,
        },
        controller={"rate_hz": rate_hz, "anti_windup": anti_windup, "feed_forward": feed_forward},
    )


def tube(scenario, gains, **flights):
    """The tube of a scenario's flights."""
    return tube_of(tube_problem(scenario, gains, **flights))


def flown(scenario, gains, start, disturbance, seed):
    """Signals of flights from random starts in the set, under random sinusoids within the bound."""
    rng = np.random.default_rng(seed)
    condition, dt = start_condition(scenario), 1.0 / scenario.controller.rate_hz
    t = np.arange(round(scenario.flight.duration_s / dt) + 1) * dt
    corners = rng.choice([-1.0, 1.0], (FLIGHTS, 2)) * rng.choice([1.0, rng.random()], (FLIGHTS, 2))
    sizes = disturbance * rng.choice([-1.0, 1.0], (FLIGHTS, 2))
    omegas = rng.choice([0.0, 0.5, 2.0, 20.0], (FLIGHTS, 2))
    controller = scenario.controller
    law = ft.loop.MimoPI(
        gains,
        scenario.limits.limits(),
        dt=dt,
        anti_windup=controller.anti_windup,
        feed_forward=controller.feed_forward,
    )
    return fly_sampled(
        [law] * FLIGHTS,
        [
            ft.loop.FlightCondition(
                V_a=condition.V_a, chi=condition.chi + start * a, gamma=condition.gamma + start * b
            )
            for a, b in corners
        ],
        np.stack(reference_of(scenario).sampled(t), axis=1)[None],
        duration=scenario.flight.duration_s,
        disturbances=[
            Sinusoid(chi_amplitude=a, chi_omega=u, gamma_amplitude=b, gamma_omega=v)
            for (a, b), (u, v) in zip(sizes, omegas, strict=True)
        ],
    )


def outside(found, result):
    """How far any flight is outside, rad and 1."""
    signals = np.stack([result.signal(name) for name in QUANTITIES], axis=2)[
        :, : len(found.bounds.t)
    ]
    low, high = found.bounds.low, found.bounds.high
    return float(np.nanmax(np.maximum(low - signals, signals - high)))


GAIN = st.floats(0.3, 4.0)
CROSS = st.floats(-0.8, 0.8)


@st.composite
def problems(draw):
    scenario = made_up(
        chi_err_deg=draw(st.floats(-170.0, 170.0)),
        gamma_deg=draw(st.floats(-40.0, 50.0)),
        gamma_ref_deg=draw(st.floats(-20.0, 30.0)),
        roll_deg=draw(st.floats(10.0, 60.0)),
        roll_dps=draw(st.floats(5.0, 200.0)),
        n_z_max=draw(st.floats(1.2, 3.0)),
        n_z_per_s=draw(st.floats(0.3, 20.0)),
        rate_hz=draw(st.sampled_from([20.0, 50.0, 100.0])),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        feed_forward=draw(st.booleans()),
        ramp_dps=draw(st.one_of(st.none(), st.floats(-8.0, 8.0))),
    )
    gains = ft.PIGains(
        K_P=np.array([[draw(GAIN), draw(CROSS)], [draw(CROSS), draw(GAIN)]]),
        K_I=np.array([[draw(GAIN), draw(CROSS)], [draw(CROSS), draw(GAIN)]]),
    )
    disturbance = draw(st.sampled_from([0.0, 0.002, 0.02]))
    start = draw(st.sampled_from([0.0, 0.2, 2.0])) * DEG
    return scenario, gains, start, disturbance


def few_or_many(few, many):
    """A test with the number of its cases: a few with the others, and many in counts."""
    counts = pytest.param(few, marks=pytest.mark.slow), pytest.param(many, marks=pytest.mark.counts)
    return pytest.mark.parametrize("count", counts)


def check_cases(check, cases, count):
    """Check so many cases, with flights from a seed each, as hypothesis finds them."""
    settings(max_examples=count)(given(case=cases, seed=st.integers(0, 2**32 - 1))(check))()


def check(case, seed):
    scenario, gains, start, disturbance = case
    problem = tube_problem(scenario, gains, start=start, disturbance=disturbance or None)
    found = tube_of(problem, attempts=FEW_PIECES, for_ever=False)
    if len(found.bounds.t):
        assert outside(found, flown(scenario, gains, start, disturbance, seed)) <= 0.0


@few_or_many(5, 400)
def test_no_flight_leaves_the_tube(count):
    check_cases(check, problems(), count)


def test_the_margin_between_samples_is_at_both_ends_of_an_interval():
    D, h, k = 0.02, 0.02, 5
    level = made_up(chi_err_deg=0.0, gamma_deg=0.0, gamma_ref_deg=0.0)
    problem = tube_problem(level, ft.PAPER_GAINS, disturbance=D)
    only_k = (np.arange(len(problem.t)) == k)[:, np.newaxis, np.newaxis]
    loop = replace(problem.loop, boxes=problem.loop.boxes * only_k)
    starts = start_set(loop, 0.0, sides=1, symbols=660)
    enclosure = enclosure_of(loop, starts, Search(loop, tolerance=0.5, most=60))

    ranges = np.array([enclosure.sample(i)[0] for i in range(k + 3)])

    # The rate is anywhere within +-D from sample k on and zero after k + 1: course is off by D h at
    # k + 1. The margin of the interval is a quarter of h times 2 D. Margins of a flight that is not
    # disturbed are a thousandth of that.
    half_widths = 0.5 * np.ptp(ranges, axis=2)[k - 1 : k + 3, 0]
    assert half_widths[0] < 0.01 * D * h
    assert half_widths[1:3] == pytest.approx([0.5 * D * h, 1.5 * D * h], rel=0.01)
    assert half_widths[3] < 1.1 * D * h
