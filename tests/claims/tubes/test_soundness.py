"""No flight leaves a tube: laws, plants, gains, limits and references as hypothesis finds them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up import made_up_scenario

import flighttune as ft
from flighttune.claims.tubes.enclosure import Settings
from flighttune.claims.tubes.exact import enclosure_of
from flighttune.claims.tubes.sample import start_set
from flighttune.claims.tubes.search import Search
from flighttune.claims.tubes.tube import stated_problem, tube_of
from flighttune.flight.conditions import lead_on, reference_of, start_condition
from flighttune.flight.loop.loop import simulate

DEG = math.pi / 180.0

FLIGHTS = 8
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


def tube(scenario, gains, *, for_ever=True, **flights):
    """The tube of a scenario's flights, with what follows its end or without, which is faster."""
    return tube_of(stated_problem(scenario, gains, **flights), for_ever=for_ever)


RAMP = {"shape": "ramp", "start_s": 0.2, "duration_s": 1.0, "roll_in_s": 0.3}
PLANNED = {"chi_deg": [RAMP | {"rate_dps": 12.0}], "gamma_deg": [RAMP | {"rate_dps": -4.0}]}

EXACT_PAPER = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
# Brakes for larger errors only.
BRAKING_LATE = {"name": "exact", "kind": "exact", "braking": 100.0}


def with_exact(scenario, plant, law="exact"):
    return ft.scenario_from(scenario.as_dict() | {"law": law, "plant": [plant]})


def manoeuvre(draw, reach_deg, path_deg=(-20.0, 30.0), **fixed):
    """A scenario whose course starts up to `reach_deg` off, with limits of any size."""
    drawn = {
        "chi_err_deg": st.floats(-reach_deg, reach_deg),
        "gamma_deg": st.floats(*path_deg),
        "gamma_ref_deg": st.floats(-20.0, 30.0),
        "roll_deg": st.floats(5.0, 60.0),
        "roll_dps": st.floats(5.0, 200.0),
        "n_z_max": st.floats(1.2, 3.0),
        "n_z_per_s": st.floats(0.3, 20.0),
        "rate_hz": st.sampled_from([20.0, 50.0, 100.0]),
        "anti_windup": st.sampled_from(["conditional", "none"]),
        "feed_forward": st.booleans(),
        "ramp_dps": st.one_of(st.none(), st.floats(-8.0, 8.0)),
    }
    return made_up(**{name: draw(values) for name, values in drawn.items()} | fixed)


def coupled(draw, own, cross, **more):
    K_P, K_I = (np.array([[draw(own), draw(cross)], [draw(cross), draw(own)]]) for _ in range(2))
    return ft.PIGains(K_P=K_P, K_I=K_I, **more)


@st.composite
def paper_problems(draw):
    scenario = manoeuvre(draw, 170.0, (-40.0, 50.0))
    return scenario, coupled(draw, st.floats(0.3, 4.0), st.floats(-0.8, 0.8))


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
    tables = manoeuvre(draw, 40.0).as_dict()
    reference = draw(st.sampled_from([tables["reference"], PLANNED]))
    tables |= {"plant": [draw(lagged_plants())], "reference": reference}
    return ft.scenario_from(tables), ft.PAPER_GAINS


@st.composite
def exact_problems(draw):
    plant = draw(st.one_of(st.just({"kind": "kinematic"}), lagged_plants()))
    scenario = with_exact(manoeuvre(draw, 8.0, feed_forward=True), plant, [BRAKING_LATE])
    share = st.floats(0.0, 0.9)
    fed = draw(st.one_of(st.just((0.0, 0.0)), st.tuples(share, share)))
    gains = coupled(
        draw,
        st.floats(0.3, 2.0),
        st.floats(-0.2, 0.2),
        inputs=("chi_dot", "gamma_dot"),
        feedback=fed,
    )
    return scenario, gains


def bang_bang(disturbance, held_s, rng):
    signs = rng.choice([-1.0, 1.0], (1000, 2))

    def at(t):
        chi, gamma = disturbance * signs[int(t / held_s + 1e-6)]
        return float(chi), float(gamma)

    return at


def disturbed_flight(problem, off=(0.0, 0.0), disturbance=None, plant=None):
    """Signals of a flight that starts so far off, and its start.

    It is on a plant of its own, or on the point mass with a disturbance over time.
    """
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
        plant
        or ft.loop.PointMassPlant(
            problem.lags or None,
            disturbance=disturbance,
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


def few_or_many(few, many):
    """A test with the number of its cases: a few with the others, and many in counts."""
    counts = pytest.param(few, marks=pytest.mark.slow), pytest.param(many, marks=pytest.mark.counts)
    return pytest.mark.parametrize("count", counts)


def check_cases(check, cases, count):
    """Check so many cases, with flights from a seed each, as hypothesis finds them."""
    settings(max_examples=count)(given(case=cases, seed=st.integers(0, 2**32 - 1))(check))()


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


def check(case, seed):
    rng = np.random.default_rng(seed)
    start, disturbance = rng.choice([0.0, 0.2, 2.0]) * DEG, rng.choice([0.0, 0.002, 0.02])
    problem = stated_problem(*case, start=start, disturbance=disturbance or None)
    found = tube_of(problem, attempts=FEW_PIECES, for_ever=False)
    assert all_stay(found, disturbance, rng)


@few_or_many(15, 850)
def test_no_flight_leaves_the_tube(count):
    check_cases(check, st.one_of(paper_problems(), lagged_problems(), exact_problems()), count)


def test_the_margin_between_samples_is_at_both_ends_of_an_interval():
    D, h, k = 0.02, 0.02, 5
    level = made_up(chi_err_deg=0.0, gamma_deg=0.0, gamma_ref_deg=0.0)
    problem = stated_problem(level, ft.PAPER_GAINS, disturbance=D)
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


@pytest.mark.soak
def test_where_the_exact_law_does_not_invert_the_reason_says_why():
    scenario = with_exact(made_up(gamma_deg=45.0), {"kind": "point_mass"})

    found = tube(scenario, EXACT_PAPER)

    assert found.status == "unbounded"
    assert "the vertical lift wanted can be at its floor" in found.reason


def test_the_exact_law_on_an_aircraft_is_refused_by_name():
    scenario = with_exact(made_up(), {"kind": "jsbsim", "aircraft": "aerosonde"})

    with pytest.raises(ft.InputError, match=r"exact law.*airspeed"):
        tube(scenario, EXACT_PAPER, plant="jsbsim:aerosonde")


LEVEL_TURN = {
    "plant[0].kind": "point_mass",
    "reference.shape": "feasible",
    "flight.gamma_deg": 0.0,
    "reference.gamma_deg": 0.0,
}
THREE_DIGITS = 5e-4
"""Half of the last digit in docs/exact_law.md, deg."""


# Each takes half a minute for figures of a page; the tests around it prove tubes of this kind.
@pytest.mark.counts
@pytest.mark.parametrize(
    ("name", "half_widths"),
    [
        ("exact:tuned_fed_back", (0.073, 0.076)),
        ("tuned_identified", (0.185, 0.180)),
        ("exact:tuned_identified", (0.111, 0.116)),
    ],
)
def test_the_level_turn_of_the_docs_has_the_half_widths_printed_there(name, half_widths):
    turn = ft.tube("exact_law", name, plant="point_mass", disturbance=0.002, changes=LEVEL_TURN)

    assert turn.bounds.half_widths[:, :2].max(axis=0) / DEG == pytest.approx(
        half_widths, abs=THREE_DIGITS
    )
