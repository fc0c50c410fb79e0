"""No flight of the exact point mass leaves its tube, whatever law it has and lags it is behind."""

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

import flighttune as ft
from flighttune.control.gains import RATES
from flighttune.flight.conditions import lead_on, reference_of, start_condition
from flighttune.simulate.loop import simulate
from flighttune.tubes.problem import tube_problem
from flighttune.tubes.tube import tube_of
from tests.tubes.test_soundness import FEW_PIECES, check_cases, few_or_many, made_up

DEG = math.pi / 180.0

PATH_DEG = st.floats(-20.0, 30.0)
RAMP_DPS = st.one_of(st.none(), st.floats(-8.0, 8.0))
RAMP = {"shape": "ramp", "start_s": 0.2, "duration_s": 1.0, "roll_in_s": 0.3}
PLANNED = {"chi_deg": [RAMP | {"rate_dps": 12.0}], "gamma_deg": [RAMP | {"rate_dps": -4.0}]}
START_DEG, DISTURBANCE = st.sampled_from([0.0, 0.5]), st.sampled_from([0.0, 0.01])


@st.composite
def lagged_plants(draw):
    if draw(st.booleans()):
        return {"kind": "point_mass"}
    plant = {"kind": "point_mass_lag"}
    for channel in ("roll", "n_z"):
        plant[f"{channel}_lag_rad_s"] = draw(st.floats(3.0, 15.0))
        plant[f"{channel}_delay_s"] = draw(st.sampled_from([0.0, 0.01, 0.02, 0.055]))
        if draw(st.booleans()):
            plant[f"{channel}_damping"] = draw(st.floats(0.4, 1.5))
    return plant


@st.composite
def lagged_problems(draw):
    scenario = made_up(
        chi_err_deg=draw(st.floats(-40.0, 40.0)),
        gamma_deg=draw(PATH_DEG),
        gamma_ref_deg=draw(PATH_DEG),
        roll_dps=draw(st.floats(10.0, 200.0)),
        rate_hz=draw(st.sampled_from([20.0, 50.0])),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        feed_forward=draw(st.booleans()),
        ramp_dps=draw(RAMP_DPS),
    )
    reference = draw(st.sampled_from([scenario.as_dict()["reference"], PLANNED]))
    tables = {"plant": [draw(lagged_plants())], "reference": reference}
    scenario = ft.scenario_from({**scenario.as_dict(), **tables})
    return scenario, ft.PAPER_GAINS, draw(START_DEG) * DEG, draw(DISTURBANCE)


@st.composite
def exact_problems(draw):
    scenario = made_up(
        chi_err_deg=draw(st.floats(-8.0, 8.0)),
        gamma_deg=draw(PATH_DEG),
        gamma_ref_deg=draw(PATH_DEG),
        roll_deg=draw(st.floats(5.0, 60.0)),
        roll_dps=draw(st.floats(10.0, 200.0)),
        n_z_max=draw(st.floats(1.3, 3.0)),
        n_z_per_s=draw(st.floats(0.3, 20.0)),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        ramp_dps=draw(RAMP_DPS),
    )
    # So that the law brakes for larger errors only.
    law = {"name": "exact", "kind": "exact", "braking": 100.0}
    plant = draw(st.one_of(st.just({"kind": "kinematic"}), lagged_plants()))
    scenario = ft.scenario_from(scenario.as_dict() | {"law": [law], "plant": [plant]})
    rate, cross = st.floats(0.3, 2.0), st.floats(-0.2, 0.2)
    K_P, K_I = (np.array([[draw(rate), draw(cross)], [draw(cross), draw(rate)]]) for _ in range(2))
    fed = draw(st.one_of(st.just((0.0, 0.0)), st.tuples(st.floats(0.0, 0.9), st.floats(0.0, 0.9))))
    gains = ft.PIGains(K_P=K_P, K_I=K_I, inputs=RATES, feedback=fed)
    return scenario, gains, draw(START_DEG) * DEG, draw(DISTURBANCE)


def bang_bang(disturbance, dt, rng):
    signs = rng.choice([-1.0, 1.0], (1000, 2))

    def at(t):
        chi, gamma = disturbance * signs[int(t / (5 * dt) + 1e-6)]
        return float(chi), float(gamma)

    return at


def disturbed_flight(problem, off, disturbance, rng):
    """Signals of a flight that starts so far off, disturbed bang-bang, and its start."""
    scenario, condition = problem.scenario, start_condition(problem.scenario)
    start = replace(condition, chi=condition.chi + off[0], gamma=condition.gamma + off[1])
    controller, expected = problem.controller(), []
    step = controller.step

    def noted(*sample):
        command = step(*sample)
        expected.append(list(controller.state.expected))
        return command

    controller.step = noted
    signals, _ = simulate(
        ft.loop.PointMassPlant(
            problem.lags or None,
            disturbance=bang_bang(disturbance, problem.controller().dt, rng),
            turn="exact" if problem.loop.exact else "paper",
            g=scenario.flight.g_mps2,
        ),
        controller,
        reference_of(scenario),
        condition=start,
        duration=scenario.flight.duration_s,
        lead=lead_on(scenario, scenario.plant[0]),
    )
    signals.attrs["expected"] = expected
    return signals, start


def check_point_mass(case, seed):
    """No flight from the edge of the starts leaves the tube, however it is disturbed."""
    scenario, gains, start, disturbance = case
    problem = tube_problem(scenario, gains, start=start, disturbance=disturbance or None)
    found = tube_of(problem, attempts=FEW_PIECES, for_ever=False)
    rng = np.random.default_rng(seed)
    for off in start * rng.choice([-1.0, 1.0], (4, 2)):
        assert found.bounds.contain(disturbed_flight(problem, off, disturbance, rng)[0])


@few_or_many(10, 450)
def test_no_flight_of_the_exact_point_mass_leaves_its_tube(count):
    check_cases(check_point_mass, st.one_of(lagged_problems(), exact_problems()), count)
