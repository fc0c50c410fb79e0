"""Scenarios of tubes that are made up, flights inside their tubes, and tubes' files opened up."""

import json
import math
from dataclasses import replace

import numpy as np
from made_up import made_up_scenario

import flighttune as ft
from flighttune.base.files.array import write_sealed
from flighttune.claims.tubes import tube as tubes
from flighttune.claims.tubes.enclosure import Settings
from flighttune.flight import conditions
from flighttune.flight.loop.loop import simulate

DEG = math.pi / 180.0
FLIGHTS = 8
FEW_PIECES = [Settings(sides=2, symbols=120, tolerance=0.5, most=6)]
EXACT_PAPER = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
# Brakes for larger errors only.
BRAKING_LATE = {"name": "exact", "kind": "exact", "braking": 100.0}


def tube_scenario(
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
    """A turn and descent of the law that starts so far off, within limits of any size."""
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


def tube(scenario, gains, *, for_ever=True, **flights):
    """The tube of a scenario's flights, with what follows its end or without, which is faster."""
    return tubes.tube_of(tubes.stated_problem(scenario, gains, **flights), for_ever=for_ever)


def bang_bang(disturbance, held_s, rng):
    """A disturbance over time of full size, whose signs are drawn every `held_s`."""
    signs = rng.choice([-1.0, 1.0], (1000, 2))

    def at(t):
        chi, gamma = disturbance * signs[int(t / held_s + 1e-6)]
        return float(chi), float(gamma)

    return at


def disturbed_flight(problem, off=(0.0, 0.0), disturbance=None, plant=None):
    """Signals of a flight that starts so far off, and its start.

    It is on a plant of its own, or on the point mass with a disturbance over time.
    """
    scenario, condition = problem.scenario, conditions.start_condition(problem.scenario)
    start = replace(condition, chi=condition.chi + off[0], gamma=condition.gamma + off[1])
    controller, expected = problem.controller(), []
    step = controller.step

    def noted(*sample):
        command = step(*sample)
        expected.append(list(controller.state.expected))
        return command

    controller.step = noted
    signals, _ = simulate(
        plant
        or ft.loop.PointMassPlant(
            problem.lags or None,
            disturbance=disturbance,
            turn="exact" if problem.loop.exact else "paper",
            g=scenario.flight.g_mps2,
        ),
        controller,
        conditions.reference_of(scenario),
        condition=start,
        duration=scenario.flight.duration_s,
        lead=conditions.lead_on(scenario, scenario.plant[0]),
    )
    signals.attrs["expected"] = expected
    return signals, start


def all_stay(found, disturbance, rng):
    """Whether flights from inside or the edge of the starts stay in the tube, disturbed or not."""
    offs = rng.choice([-1.0, 1.0], (FLIGHTS, 2)) * rng.choice([1.0, rng.random()], (FLIGHTS, 2))
    dt = found.problem.controller().dt
    flights = [
        disturbed_flight(
            found.problem, off, bang_bang(disturbance, rng.choice([1, 5, 25]) * dt, rng)
        )
        for off in found.problem.start * offs
    ]
    return all(found.bounds.contain(signals) for signals, _ in flights)


def aircraft_scenario(**changes):
    """The same of the Aerosonde: level, 4 deg off its course."""
    values = {"feed_forward": False, "chi_err_deg": 4.0, "gamma_deg": 0.0, "gamma_ref_deg": 0.0}
    scenario = tube_scenario(**{**values, **changes}).as_dict()
    scenario["plant"] = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    return ft.scenario_from(scenario)


def arrays_of(path):
    with np.load(path) as arrays:
        return {name: arrays[name] for name in arrays.files}


def claim_of(path):
    return json.loads(str(arrays_of(path)["claim"]))


def rewritten(path, arrays, to=None, **claim):
    """The file with other arrays (None for none), other entries of the claim, and its seal anew."""
    content = arrays_of(path)
    content["claim"] = np.array(json.dumps({**claim_of(path), **claim}))
    content = {name: array for name, array in (content | arrays).items() if array is not None}
    write_sealed(to or path, content)
    return to or path
