"""No flight leaves a tube: laws, plants, gains, limits and references as hypothesis finds them."""

import math
from contextlib import nullcontext
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from fuzzing import check_cases, few_or_many
from hypothesis import strategies as st
from made_up_tubes import (
    BRAKING_LATE,
    DEG,
    EXACT_PAPER,
    FEW_PIECES,
    all_stay,
    disturbed_flight,
    tube,
    tube_scenario,
)
from scipy.integrate import solve_ivp

import flighttune as ft
from flighttune.claims.tubes import exact, sample
from flighttune.claims.tubes import tube as tubes
from flighttune.claims.tubes.forms import Quantity, combined
from flighttune.claims.tubes.interval import Interval, Unbounded
from flighttune.claims.tubes.search import Search

ROUNDING = 1e-12

RAMP = {"shape": "ramp", "start_s": 0.2, "duration_s": 1.0, "roll_in_s": 0.3}
PLANNED = {"chi_deg": [RAMP | {"rate_dps": 12.0}], "gamma_deg": [RAMP | {"rate_dps": -4.0}]}


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
    return tube_scenario(**{name: draw(values) for name, values in drawn.items()} | fixed)


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


def check(case, seed):
    rng = np.random.default_rng(seed)
    start, disturbance = rng.choice([0.0, 0.2, 2.0]) * DEG, rng.choice([0.0, 0.002, 0.02])
    problem = tubes.stated_problem(*case, start=start, disturbance=disturbance or None)
    found = tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False)
    assert all_stay(found, disturbance, rng)


@pytest.mark.soak
@few_or_many(10, 850)
def test_no_flight_leaves_the_tube(count):
    check_cases(check, st.one_of(paper_problems(), lagged_problems(), exact_problems()), count)


# deg: without a disturbance, a tube from one start is as wide as what is not followed exactly
NARROW_DEG = 0.03

LAGS = {"kind": "point_mass_lag", "roll_lag_rad_s": 8.0, "n_z_lag_rad_s": 6.0}


def brief(**changes):
    return tube_scenario(
        **{"chi_err_deg": 1.0, "gamma_deg": 2.0, "gamma_ref_deg": 0.0, "rate_hz": 25.0, **changes}
    )


def without_rates():
    tables = brief(chi_err_deg=60.0, roll_deg=20.0).as_dict()
    limits = {key: of for key, of in tables["limits"].items() if "rate" not in key}
    return ft.scenario_from(tables | {"limits": limits})


@pytest.mark.parametrize(
    ("scenario", "gains"),
    [
        *(
            pytest.param(
                ft.scenario_from(
                    brief(feed_forward=planned).as_dict() | {"plant": [plant], "reference": PLANNED}
                ),
                ft.PAPER_GAINS,
                id=f"rolled into, {plant['kind']}, {planned}",
            )
            for plant in (LAGS, {"kind": "kinematic"})
            for planned in (True, False)
        ),
        *(
            pytest.param(
                with_exact(
                    brief(chi_err_deg=0.5 if any(fed) else 6.0, anti_windup="none", roll_dps=10.0),
                    LAGS if any(fed) else {"kind": "point_mass"},  # which follows at once
                    [BRAKING_LATE],
                ),
                replace(EXACT_PAPER, feedback=fed),
                id=f"without anti-windup, {fed}",
            )
            for fed in ((0.0, 0.0), (0.5, 0.3))
        ),
        pytest.param(without_rates(), ft.PAPER_GAINS, id="without rate limits"),
    ],
)
def test_the_tube_of_one_flight_is_that_flight(scenario, gains):
    problem = tubes.stated_problem(scenario, gains)
    found = tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False)

    signals, _ = disturbed_flight(problem)

    assert found.status == "bounded"
    assert found.bounds.contain(signals)
    assert np.rad2deg(np.ptp(found.bounds.pairs[:, :2], axis=2)).max() < NARROW_DEG


def test_a_load_factor_at_its_rate_limit_does_not_follow_the_reference():
    # The row of the load factor is relative to the reference, whose cosine moves by 0.009 in each
    # sample. At its rate limit the command moves by 0.006 in a sample.
    tables = tube_scenario(chi_err_deg=0.5, gamma_deg=60.0, n_z_per_s=0.3).as_dict()
    ramp = {"shape": "ramp", "start_s": 0.1, "duration_s": 0.6, "rate_dps": -30.0}
    tables["reference"]["gamma_deg"] = [ramp]
    narrow = 1e-4
    problem = tubes.stated_problem(ft.scenario_from(tables), ft.PAPER_GAINS, start=narrow)
    found = tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False)

    signals, _ = disturbed_flight(problem, (narrow, -narrow))
    assert np.diff(signals["n_z_cmd"]).min() == pytest.approx(-0.3 / 50.0)
    assert found.bounds.contain(signals)


def test_the_margin_between_samples_is_at_both_ends_of_an_interval():
    D, h, k = 0.02, 0.02, 5
    level = tube_scenario(chi_err_deg=0.0, gamma_deg=0.0, gamma_ref_deg=0.0)
    problem = tubes.stated_problem(level, ft.PAPER_GAINS, disturbance=D)
    only_k = (np.arange(len(problem.t)) == k)[:, np.newaxis, np.newaxis]
    of_each = np.array([[1.0], [0.5]])
    loop = replace(problem.loop, boxes=problem.loop.boxes * only_k * of_each)
    starts = sample.start_set(loop, 0.0, sides=1, symbols=660)
    enclosure = exact.enclosure_of(loop, starts, Search(loop, tolerance=0.5, most=60))

    ranges = np.array([enclosure.sample(i)[0] for i in range(k + 3)])

    # The rate is anywhere within +-D from sample k on and zero after k + 1: course is off by D h at
    # k + 1. The margin of the interval is a quarter of h times 2 D. Margins of a flight that is not
    # disturbed are a thousandth of that.
    for i, part in enumerate((1.0, 0.5)):
        half_widths = 0.5 * np.ptp(ranges, axis=2)[k - 1 : k + 3, i]
        assert half_widths[0] < 0.01 * D * h
        assert half_widths[1:3] == pytest.approx([part * x * D * h for x in (0.5, 1.5)], rel=0.02)
        assert half_widths[3] < 1.1 * part * D * h


@pytest.mark.parametrize(("gamma_ref_deg", "D"), [(80.0, 0.02), (40.0, 0.2), (-60.0, 0.02)])
def test_a_disturbed_sample_is_as_wide_as_the_remainder_of_its_path_angle(gamma_ref_deg, D):
    steep = tube_scenario(
        chi_err_deg=0.0,
        gamma_deg=60.0,
        gamma_ref_deg=gamma_ref_deg,
        n_z_max=3.0,
        n_z_per_s=50.0,
        rate_hz=5.0,
        feed_forward=False,
    )
    problem = tubes.stated_problem(steep, ft.PAPER_GAINS, disturbance=D)
    loop = problem.loop
    enclosure = exact.enclosure_of(
        loop, sample.start_set(loop, 0.0, sides=1, symbols=660), Search(loop)
    )
    enclosure.sample(0)
    pieces = enclosure.pieces
    reached = pieces.plain_range(pieces.forms()[sample.GAMMA])

    # Bounds by hand, of sample h: |f| and |f'| bound the second derivative of the path angle.
    h, rate, gamma = 0.2, 9.81 / 25.0, 60.0 * DEG
    signals, _ = disturbed_flight(problem)
    n_z, phi = signals["n_z_cmd"][0], signals["phi_cmd"][0]
    f = rate * (n_z * math.cos(phi) - math.cos(gamma))
    Y = h * (abs(f) + D) * math.exp(rate * h)
    remainder = h * D + 0.5 * h**2 * rate * (rate * Y * (1.0 + 0.5 * Y) + D) + 0.5 * h * rate * Y**2
    assert 0.5 * np.ptp([reached.low, reached.high]) == pytest.approx(remainder, rel=1e-6)
    middle = gamma + h * f * (1.0 + 0.5 * h * rate * math.sin(gamma))
    assert reached.middle == pytest.approx(middle, abs=1e-9)

    # The path angle of a constant rate of disturbance, integrated by SciPy
    for off in (-D, D):
        flown = solve_ivp(
            lambda _, x, off=off: rate * (n_z * math.cos(phi) - np.cos(x)) + off,
            (0.0, h),
            [gamma],
            rtol=1e-12,
            atol=1e-12,
        )
        assert reached.low[0] < flown.y[0, -1] < reached.high[0]


@pytest.mark.parametrize("sides", [1, 2, 5])
def test_the_pieces_of_the_starts_cover_all_of_them_and_little_more(sides):
    within, problem = 0.3 * DEG, tubes.stated_problem(tube_scenario(), ft.PAPER_GAINS)
    pieces = sample.start_set(problem.loop, within, sides=sides, symbols=120)
    centre = np.array(problem.loop.start[:2])
    state = [form.widened(0.0) for form in pieces.forms()[:2]]
    low, high = (
        np.array([getattr(pieces.plain_range(x), end) for x in state]).T - centre
        for end in ("low", "high")
    )

    starts = np.random.default_rng(1).uniform(-within, within, (500, 2))
    starts[:2] = [within, within], [-within, within]
    inside = ((low <= starts[:, None]) & (starts[:, None] <= high)).all(axis=2)

    assert inside.any(axis=1).all()
    assert np.abs([low, high]).max() < within * (1.0 + 1e-6)
    assert (high - low).max() < 2.0 * within / sides * (1.0 + 1e-6)


@pytest.mark.parametrize(
    ("across", "lift", "brake", "said"),
    [
        # level and vertical lift of two pieces, of which the second alone is not inverted
        ([0.1, 0.1], [1.0, 0.0], math.inf, "at its floor"),
        ([0.1, 3.0], [1.0, 2.0], math.inf, "more than the largest load factor"),
        ([0.1, 1.9], [1.0, 1e-2], math.inf, "next to 90 deg"),
        ([0.1, 0.1], [1.0, 1.0], 0.0, "brakes"),
        # one end of a lift is enough
        ([0.1, 0.1], [1.0, (0.0, 1.0)], math.inf, "at its floor"),
        ([0.1, (-3.0, 0.1)], [1.0, 2.0], math.inf, "more than the largest load factor"),
        ([0.1, 0.8], [1.0, (0.5, 2.4)], math.inf, "more than the largest load factor"),
        ([0.1, 3.0], [1.0, (0.5, 1.3)], math.inf, "more than the largest load factor"),
        ([0.1, (-1.9, 0.1)], [1.0, 1e-2], math.inf, "next to 90 deg"),
        ([0.1, 1.9], [1.0, (1e-2, 0.5)], math.inf, "next to 90 deg"),
        # beyond 2.5 together, but enough for the vertical lift at the largest roll, 60 deg
        ([0.1, 3.0], [1.0, 1.0], math.inf, None),
        ([0.1, 3.0], [1.0, 1.3], math.inf, "more than the largest load factor"),
    ],
)
@pytest.mark.parametrize("roll_deg", [[-60.0, 60.0], [-60.0, 20.0], [-20.0, 60.0]])
def test_one_piece_beyond_what_the_exact_law_inverts_stops_the_tube(
    across, lift, brake, said, roll_deg
):
    tables = tube_scenario(n_z_max=2.5).as_dict()
    tables["limits"]["phi_deg"] = roll_deg
    scenario = with_exact(ft.scenario_from(tables), {"kind": "kinematic"})
    loop = tubes.stated_problem(scenario, EXACT_PAPER, start=0.1 * DEG).loop
    enclosure = exact.enclosure_of(
        loop, sample.start_set(loop, 0.1 * DEG, sides=1, symbols=660), Search(loop)
    )
    enclosure._law = enclosure._law._replace(lift_floor=1e-3, brake=brake)
    errors = enclosure._errors(0, enclosure.pieces.forms())
    a, b = (
        Interval(np.array([np.min(x) for x in of]) - 1e-9, np.array([np.max(x) for x in of]) + 1e-9)
        for of in (across, lift)
    )

    with nullcontext() if said is None else pytest.raises(Unbounded, match=said):
        enclosure._check_plain(errors, a, b)


@pytest.mark.parametrize(
    ("error", "off", "feedback"),
    [
        ("course", {"chi_err_deg": 8.0, "gamma_deg": 15.0}, (0.0, 0.0)),
        ("course", {"chi_err_deg": 8.0, "gamma_deg": 15.0}, (0.5, 0.3)),
        ("path-angle", {"chi_err_deg": 0.0, "gamma_deg": 5.0}, (0.0, 0.0)),
    ],
)
def test_a_law_that_brakes_is_not_taken_to_invert(error, off, feedback):
    """It brakes where roll and load factor could not end a turn or a climb at their rate limits."""
    i = ("course", "path-angle").index(error)
    limit, largest = [(30.0 * DEG, 8.0 * DEG), (1.0, 10.0 * DEG)][i]
    K_P = EXACT_PAPER.K_P[i, i]
    critical = K_P * largest * 25.0 / 9.81 * K_P / (2.0 * limit)
    for braking in (0.99 * critical, 1.01 * critical):
        law = {"name": "exact", "kind": "exact", "braking": braking, "brakes_turns": i == 0}
        plant = LAGS if any(feedback) else {"kind": "kinematic"}
        scenario = with_exact(tube_scenario(**off, duration_s=0.04), plant, [law])
        problem = tubes.stated_problem(scenario, replace(EXACT_PAPER, feedback=feedback))
        found = tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False)
        signals, _ = disturbed_flight(problem)

        brakes = f"the {error} error can be so large that the law brakes from t = 0.00 s on"
        assert found.reason == (brakes if braking < critical else "")
        assert found.bounds.contain(signals)


@pytest.mark.parametrize(
    ("excess", "reached"),
    [((-1.0, -0.5), (1.3, 1.3)), ((0.5, 1.0), (1.0, 1.0)), ((-1.0, 0.5), (1.0, 1.3))],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_integral_that_a_limit_may_hold_is_held_or_moved_on_and_no_wider(excess, reached, sign):
    """From 1, by an increment of 0.3, where commands are free, limited, and on both sides."""
    scenario = with_exact(tube_scenario(), {"kind": "kinematic"})
    loop = tubes.stated_problem(scenario, EXACT_PAPER, start=0.1 * DEG).loop
    enclosure = exact.enclosure_of(
        loop, sample.start_set(loop, 0.1 * DEG, sides=1, symbols=660), Search(loop)
    )
    enclosure._sides = {(0, 1.0): np.array([exact.OPEN])}
    row, *_ = enclosure.pieces.forms()
    integral, increment = (combined((0.0, row), shift=sign * x) for x in (1.0, 0.3))
    over = {1.0: Quantity(row, Interval(*np.transpose([excess])))}

    after, _ = enclosure._integrated(
        0, [sample.Channel(row, increment, over[1.0].values, over)], integral
    )

    ends = enclosure._range(after)
    found = sorted((sign * ends.low.item(), sign * ends.high.item()))
    assert found == pytest.approx(reached, rel=ROUNDING)


def enclosure_with(sides, feedback=(0.0, 0.0), pieces=1):
    """An enclosure of the exact law whose flights are known to be on these sides of limits."""
    scenario = with_exact(tube_scenario(), LAGS)
    gains = replace(EXACT_PAPER, feedback=feedback)
    loop = tubes.stated_problem(scenario, gains, start=0.1 * DEG).loop
    starts = sample.start_set(loop, 0.1 * DEG, sides=pieces, symbols=660)
    found = exact.enclosure_of(loop, starts, Search(loop))
    found._sides = {limit: np.atleast_1d(side) for limit, side in sides.items()}
    return found


def ranging(enclosure, low, high, row=0):
    """A form between two numbers, by the symbol of the course or path angle, and its values."""
    start = enclosure.pieces.forms()[(sample.CHI, sample.GAMMA)[row]]
    scale = 0.5 * (high - low) / start.coefficients[0, 1 + row]
    form = combined((scale, start), shift=0.5 * (low + high) - scale * start.coefficients[0, 0])
    return Quantity(form, Interval(np.array([low]), np.array([high])))


# Rounding of sums of values up to 1: far less than the sides of a limit overlap
FLOATS = 1e-15

BARELY = 0.5 * exact.OVERLAP


@pytest.mark.parametrize("command", [0, 1, 2, 3])
@pytest.mark.parametrize(
    ("side", "excess", "reached"),
    [
        # what is left of rounding beyond the side on which flights are known to be
        (exact.LIMITED, (-exact.OVERLAP, 0.5), (1.0, 1.0)),
        (exact.FREE, (-0.5, exact.OVERLAP), (1.3, 1.3)),
        # a flight so near the limit may be on either side
        (exact.OPEN, (-1.0, -BARELY), (1.0, 1.3)),
        (exact.OPEN, (BARELY, 1.0), (1.0, 1.3)),
    ],
)
def test_a_limit_of_any_command_holds_the_integral_of_its_channel(command, side, excess, reached):
    """One command, expected or fed back, may be limited above; all others are free."""
    sides = {(i, end): exact.OPEN for i in range(4) for end in (1.0, -1.0)} | {(command, 1.0): side}
    enclosure = enclosure_with(sides, feedback=(0.5, 0.3))
    own, far = command // 2, ranging(enclosure, -1.0, -0.5)
    increments = [ranging(enclosure, x, x).form for x in (0.3 if own == 0 else 0.7, 9.0) * 2]
    increments[2] = ranging(enclosure, *(2 * [0.3 if own else 0.7])).form
    channels = [
        sample.Channel(far.form, increment, far.values, {1.0: far, -1.0: far})
        for increment in increments
    ]
    channels[command].excesses[1.0] = ranging(enclosure, *excess)

    integral = ranging(enclosure, 1.0, 1.0).form
    after, held = enclosure._integrated(own, channels, integral)
    other, other_held = enclosure._integrated(1 - own, channels, integral)

    ends = enclosure._range(after)
    assert [ends.low.item(), ends.high.item()] == pytest.approx(reached, rel=1e-9)
    assert held == (side != exact.FREE)
    ends = enclosure._range(other)
    assert [ends.low.item(), ends.high.item()] == pytest.approx([1.7, 1.7], rel=1e-9)
    assert not other_held


@pytest.mark.parametrize("slope", [-0.5, 0.3, 1.7])
@pytest.mark.parametrize(
    ("above", "below"),
    [
        (exact.LIMITED, exact.FREE),
        (exact.FREE, exact.LIMITED),
        (exact.FREE, exact.FREE),
        (exact.OPEN, exact.OPEN),
    ],
)
def test_what_limits_hold_back_is_enclosed_beyond_their_sides_too(above, below, slope):
    """A flight may exceed its side by rounding; slopes may be any."""
    enclosure = enclosure_with({(0, 1.0): above, (0, -1.0): below})
    enclosure.plan.slope = lambda values: np.full_like(values.low, slope)
    reach = {
        exact.LIMITED: (-exact.OVERLAP, 0.4),
        exact.FREE: (-0.4, exact.OVERLAP),
        exact.OPEN: (-0.4, 0.4),
    }
    over = {1.0: ranging(enclosure, *reach[above]), -1.0: ranging(enclosure, *reach[below], row=1)}
    channel = sample.Channel(over[1.0].form, over[1.0].form, over[1.0].values, over)

    held = enclosure._held_back(0, channel)

    xi = np.array([*product([-1.0, 0.0, 1.0], repeat=2)])
    expected = 0.0
    for side, excess in over.items():
        Y = excess.form.coefficients[0, 0] + xi @ excess.form.coefficients[0, 1:3]
        expected = expected + side * np.maximum(Y, 0.0)
    line = held.coefficients[0, 0] + xi @ held.coefficients[0, 1:3]
    assert np.abs(expected - line).max() <= held.err[0] + FLOATS


def test_a_split_at_a_limit_says_on_which_side_flights_are_and_another_says_nothing():
    """The second and the last of four pieces are split, the last at another value."""
    others = {
        (i, side): [exact.FREE, exact.LIMITED, exact.OPEN, exact.FREE]
        for i in (0, 1)
        for side in (1.0, -1.0)
    }
    enclosure = enclosure_with(others | {(0, 1.0): 4 * [exact.OPEN]}, pieces=2)
    row = enclosure.pieces.forms()[sample.CHI]
    values = enclosure.pieces.plain_range(row)
    centre = values.middle
    excess = Quantity(combined((1.0, row), shift=-centre), values - centre)
    channel = sample.Channel(row, row, values, {1.0: excess, -1.0: excess})
    chosen, splits = np.array([False, True, False, True]), np.array([0.0, 0.0, 0.0, 1e-5])

    enclosure._split((0, 1.0, chosen, splits, np.zeros(4, dtype=int)), [channel])

    assert enclosure._sides[0, 1.0].tolist() == [
        exact.OPEN,
        exact.FREE,
        exact.OPEN,
        exact.OPEN,
        exact.LIMITED,
        exact.OPEN,
    ]
    # The halves overlap by rounding; multipliers have single precision.
    ranges = enclosure._range(enclosure.pieces.forms()[sample.CHI])
    ends = (ranges.high[[1, 3]], ranges.low[[4, 5]]) - centre[[1, 3]]
    assert ends[0] == pytest.approx([exact.OVERLAP, 1e-5 + exact.OVERLAP], abs=0.4 * exact.OVERLAP)
    assert ends[1] == pytest.approx([-exact.OVERLAP, 1e-5 - exact.OVERLAP], abs=0.4 * exact.OVERLAP)
    for limit in ((0, -1.0), (1, 1.0), (1, -1.0)):
        assert enclosure._sides[limit].tolist() == [
            exact.FREE,
            exact.LIMITED,
            exact.OPEN,
            exact.FREE,
            exact.LIMITED,
            exact.FREE,
        ]
    enclosure._keep(np.array([False, True, False, False, True, True]))
    assert enclosure._sides[0, 1.0].tolist() == [exact.FREE, exact.LIMITED, exact.OPEN]
    assert enclosure._sides[1, 1.0].tolist() == [exact.LIMITED, exact.LIMITED, exact.FREE]
    known = {
        end: enclosure._on_its_side(0, 1.0, Quantity(row, Interval(-np.ones(3), np.ones(3))), end)
        for end in (0.0, exact.OVERLAP)
    }
    for beyond, values in known.items():
        assert values.low.tolist() == [-1.0, -beyond, -1.0]
        assert values.high.tolist() == [beyond, 1.0, 1.0]


@pytest.mark.parametrize(("chi", "turned"), [(0.5, 0.0), (7.0, 1.0), (-12.0, -2.0)])
def test_course_errors_of_each_piece_are_within_half_a_turn(chi, turned):
    enclosure = enclosure_with({}, pieces=2)
    state = enclosure.pieces.forms()
    centres = state[sample.CHI].coefficients[:, 0].copy()
    chi_ref = enclosure.loop.reference[0, 0]
    state[sample.CHI] = combined((1.0, state[sample.CHI]), shift=chi - centres + chi_ref)

    error = enclosure._errors(0, state)[0].coefficients[:, 0]
    assert error == pytest.approx(np.full(4, turned * math.tau - chi))
    # One piece reaches half a turn, on either side.
    for half in (math.pi, -math.pi):
        near = np.array([0.0, 0.0, half * (1.0 - 1e-5), 0.0])
        far = combined((1.0, state[sample.CHI]), shift=near - chi)
        with pytest.raises(Unbounded, match="half a turn"):
            enclosure._errors(0, [far, *state[1:]])


def test_what_is_seen_beyond_the_roll_of_the_lag_stays_in_its_box_and_its_change():
    enclosure = enclosure_with({})
    loop = enclosure.loop
    beyond, change = (-0.02, 0.03), (-0.002, 0.001)
    rows = np.tile([beyond, change], (len(loop.boxes), 1, 1))
    loop = replace(loop, boxes=np.concatenate([loop.boxes, rows], axis=1))
    seen = exact.enclosure_of(loop, sample.start_set(loop, 0.0, sides=1, symbols=660), Search(loop))

    roll = seen._seen(seen.pieces.forms()).values
    assert [roll.low.item(), roll.high.item()] == pytest.approx(beyond, rel=1e-6)
    for widest in (beyond, np.add(beyond, change)):
        row = seen.pieces.plain_range(seen.pieces.forms()[-1])
        assert [row.low.item(), row.high.item()] == pytest.approx(widest, rel=1e-6)
        seen.sample(0)


def test_a_path_steeper_than_85_deg_is_not_enclosed_with_the_exact_point_mass():
    steep = tube_scenario(gamma_deg=85.5, gamma_ref_deg=85.5, duration_s=0.04).as_dict()
    problem = tubes.stated_problem(
        ft.scenario_from(steep | {"plant": [{"kind": "point_mass"}]}), ft.PAPER_GAINS
    )

    found = tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False)

    assert "the flight-path angle cannot be kept inside 85 deg from t = 0.00 s on" in found.reason


@pytest.mark.soak
def test_where_the_exact_law_does_not_invert_the_reason_says_why():
    scenario = with_exact(tube_scenario(gamma_deg=45.0), {"kind": "point_mass"})

    found = tube(scenario, EXACT_PAPER)

    assert found.status == "unbounded"
    assert "the vertical lift wanted can be at its floor" in found.reason


def test_the_exact_law_on_an_aircraft_is_refused_by_name():
    scenario = with_exact(tube_scenario(), {"kind": "jsbsim", "aircraft": "aerosonde"})

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
        ("exact:tuned_fed_back", (0.069, 0.076)),
        ("tuned_identified", (0.185, 0.180)),
        ("exact:tuned_identified", (0.111, 0.116)),
    ],
)
def test_the_level_turn_of_the_docs_has_the_half_widths_printed_there(name, half_widths):
    turn = ft.tube("exact_law", name, plant="point_mass", disturbance=0.002, changes=LEVEL_TURN)

    assert turn.bounds.half_widths[:, :2].max(axis=0) / DEG == pytest.approx(
        half_widths, abs=THREE_DIGITS
    )
