"""The exact law against the point mass that it inverts, its limits one by one, and its feedback."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from forging import Opened
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve

import flighttune as ft

G = 9.81
ROUNDING = 1e-12
DT = 0.02


def rates(K_P, K_I=(0.0, 0.0)):
    return ft.PIGains.from_lists(np.diag(K_P), np.diag(K_I), law="exact")


GAINS = rates((1.4, 1.2), (0.7, 0.6))
MODEL, _ = ft.loop.ExactLaw(GAINS, dt=DT).linear()


def limits(phi=math.inf, n_z=(-math.inf, math.inf), rate=(math.inf, math.inf)):
    rate, (lower, upper) = np.array(rate), zip((-phi, phi), n_z, strict=True)
    return ft.loop.Limits(lower=lower, upper=upper, rate_lower=-rate, rate_upper=rate)


def seen(chi=0.0, gamma=0.0, V_a=25.0, *, phi=0.0, wind=None, **more):
    return ft.loop.Measured(chi, gamma, V_a, phi, 1.0, 1000.0, (0.0, 0.0, 0.0), wind, **more)


def command(law, measured, reference, samples=1):
    law.start(ft.loop.FlightCondition(V_a=measured.V_a))
    for k in range(samples):
        found = law.step(measured, reference, k * DT)
    return found[0], found[1]


@pytest.mark.parametrize("seed", range(20))
def test_commands_give_the_point_mass_the_rates_wanted(seed):
    rng = np.random.default_rng(seed)
    V_a, gamma = rng.uniform(15.0, 250.0), rng.uniform(-1.2, 1.2)
    e, rate = rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.03, 0.03, 2)
    here, wanted = seen(0.3, gamma, V_a), ft.loop.ReferenceSample(0.3 + e[0], gamma + e[1], *rate)
    lift = V_a * (rate[1] + 1.2 * e[1]) / G + math.cos(gamma)

    phi, n_z = command(ft.loop.ExactLaw(GAINS, dt=DT, lift_floor=1e-6), here, wanted)

    flown = np.array([n_z * math.sin(phi) / math.cos(gamma), n_z * math.cos(phi) - math.cos(gamma)])
    flown *= G / V_a
    if lift > 0.0:
        assert flown == pytest.approx(rate + np.array([1.4, 1.2]) * e, abs=ROUNDING)
    assert n_z * math.cos(phi) == pytest.approx(lift, abs=ROUNDING)


@pytest.mark.parametrize(("V_a", "gamma"), [(20.0, -0.4), (25.0, 0.2), (90.0, 0.9)])
def test_errors_are_those_of_one_linear_loop_at_every_condition(V_a, gamma):
    dt, e_0 = 0.002, np.array([0.3, -0.02])
    plant, law = ft.loop.PointMassPlant(), ft.loop.ExactLaw(GAINS, dt=dt)
    A_K, start = ft.loop.closed_loop(MODEL, GAINS), ft.loop.FlightCondition(V_a=V_a, gamma=gamma)
    plant.start(start)
    law.start(start)
    for k in range(1501):
        now = dict(zip(plant.signals, plant.observe(), strict=True))
        errors = e_0[0] - now["chi"], gamma + e_0[1] - now["gamma"]
        if k % 500 == 0:
            # s = (e', e); without integral at the start e' is that of the proportional part
            s = expm(A_K * k * dt) @ np.concatenate([-np.diag([1.4, 1.2]) @ e_0, e_0])
            assert errors == pytest.approx(s[2:], abs=2.0 * dt * np.abs(e_0).max())
        here = seen(now["chi"], now["gamma"], V_a)
        phi, n_z, *_ = law.step(here, ft.loop.ReferenceSample(e_0[0], gamma + e_0[1]), k * dt)
        assert plant.advance(phi, n_z, dt) is None


@pytest.mark.parametrize("wind", [(8.0, 0.0, 0.0), (-8.0, 3.0, 1.0), (0.0, 9.0, -1.0)])
def test_over_ground_too_lift_turns_at_the_rates_wanted(wind):
    """Newton over ground: lift stands across the velocity through the air, gravity down."""
    V_a, chi, gamma, rate = 25.0, 0.4, 0.1, 0.02
    u = np.array([np.cos(gamma) * np.cos(chi), np.cos(gamma) * np.sin(chi), -np.sin(gamma)])
    V_g = fsolve(lambda v: np.linalg.norm(v * u - wind) - V_a, V_a)[0]
    along = (V_g * u - wind) / V_a @ u
    here, turning = seen(chi, gamma, V_a, wind=wind), ft.loop.ReferenceSample(chi, gamma, rate)

    phi, n_z = command(ft.loop.ExactLaw(GAINS, dt=DT), here, turning)

    speed = V_g / max(along, 0.2)
    assert n_z * math.sin(phi) == pytest.approx(speed * math.cos(gamma) * rate / G, rel=1e-9)
    assert n_z * math.cos(phi) == pytest.approx(math.cos(gamma), rel=1e-9)


def test_where_no_heading_holds_a_course_the_turn_is_that_of_still_air():
    turning = ft.loop.ReferenceSample(0.0, 0.1, chi_dot=0.2)
    still, blown = (
        command(ft.loop.ExactLaw(GAINS, dt=DT), seen(gamma=0.1, wind=wind), turning)
        for wind in (None, (3.0, 40.0, 1.0))
    )

    assert still == blown


def test_where_roll_is_limited_the_load_factor_keeps_the_vertical():
    law = ft.loop.ExactLaw(GAINS, limits(phi=0.5), dt=DT)

    phi, n_z = command(law, seen(), ft.loop.ReferenceSample(1.0, 0.1))

    assert phi == 0.5
    assert n_z * math.cos(phi) == pytest.approx(1.0 + 25.0 * 1.2 * 0.1 / G, abs=ROUNDING)
    assert law.state.limited == [1, 0]


@pytest.mark.parametrize("e_gamma", [-0.4, -0.6])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_without_lift_roll_stays_on_the_side_of_the_turn(e_gamma, side):
    b = 1.0 + 25.0 * 1.2 * e_gamma / G
    a = 25.0 * 1.4 * 0.05 / G
    law = ft.loop.ExactLaw(rates((1.4, 1.2)), dt=DT, lift_floor=0.3, braking=None)

    phi, n_z = command(law, seen(), ft.loop.ReferenceSample(side * 0.05, e_gamma))

    assert b < 0.0
    assert phi == pytest.approx(side * math.atan2(a, 0.3), abs=ROUNDING)
    assert n_z * math.cos(phi) == pytest.approx(b, abs=ROUNDING)


@pytest.mark.parametrize("priority", ["gamma", "chi"])
def test_the_largest_load_factor_goes_to_what_has_priority(priority):
    a, b = 25.0 * 1.4 * 0.35 / G, 1.0 + 25.0 * 1.2 * 0.05 / G
    assert a < 1.5 < math.hypot(a, b)
    law = ft.loop.ExactLaw(GAINS, limits(n_z=(0.0, 1.5)), dt=DT, priority=priority)

    phi, n_z = command(law, seen(), ft.loop.ReferenceSample(0.35, 0.05))

    assert n_z == pytest.approx(1.5, abs=ROUNDING)
    if priority == "gamma":
        assert n_z * math.cos(phi) == pytest.approx(b, abs=ROUNDING)
    else:
        assert n_z * math.sin(phi) == pytest.approx(a, abs=ROUNDING)
    assert 0.0 < phi < math.pi / 2


@pytest.mark.parametrize("anti_windup", ["conditional", "back_calculation", "none"])
def test_integrators_stand_while_the_command_of_their_channel_is_limited(anti_windup):
    law = ft.loop.ExactLaw(GAINS, limits(phi=0.2), dt=DT, anti_windup=anti_windup)

    command(law, seen(), ft.loop.ReferenceSample(0.5, 0.02), samples=50)

    chi, gamma = law.state.integral
    assert gamma == pytest.approx(0.6 * 0.02 * 50 * DT, abs=ROUNDING)
    if anti_windup == "conditional":
        assert chi == 0.0
    elif anti_windup == "none":
        assert chi == pytest.approx(0.7 * 0.5 * 50 * DT, abs=ROUNDING)
    else:
        assert chi < 0.2 * 0.7 * 0.5 * 50 * DT  # led back to the rate that the limited roll gives


@pytest.mark.parametrize(("lift", "stands"), [(0.05, True), (0.15, False)])
def test_the_course_waits_while_the_lift_wanted_is_below_its_floor(lift, stands):
    law = ft.loop.ExactLaw(GAINS, dt=DT)
    rate = (lift - 1.0) * G / 25.0

    command(law, seen(), ft.loop.ReferenceSample(0.1, 0.0, 0.0, rate))

    assert law.state.integral[0] == pytest.approx(0.0 if stands else 0.7 * 0.1 * DT, abs=ROUNDING)


def test_back_calculation_of_the_climb_settles_where_the_excess_balances_the_error():
    """Beyond the largest load factor: V/g times the rate by which the integral is led back."""
    tracking, error = 0.8, 0.1
    law = ft.loop.ExactLaw(
        GAINS, limits(n_z=(-1.0, 1.02)), dt=DT, anti_windup="back_calculation", braking=None,
        tracking_time=tracking,
    )  # fmt: skip

    command(law, seen(), ft.loop.ReferenceSample(0.0, error), samples=2000)

    excess = law.state.u_unsat[1] - 1.02
    assert excess == pytest.approx(25.0 / G * 0.6 * error * tracking, rel=1e-9)


def test_back_calculation_in_a_turn_settles_where_the_lift_in_excess_balances_the_errors():
    """Lift wanted and lift of the limited commands, both in level and vertical parts."""
    tracking, chi, gamma, phi, n_z = 0.8, 0.3, -0.05, 0.3, 0.9
    law = ft.loop.ExactLaw(
        GAINS, limits(phi, n_z=(n_z, 2.0)), dt=DT, anti_windup="back_calculation", braking=None,
        tracking_time=tracking,
    )  # fmt: skip

    now, wanted = seen(gamma=0.2), ft.loop.ReferenceSample(chi, 0.2 + gamma)

    assert command(law, now, wanted, samples=4000) == (phi, n_z)

    roll, load = law.state.u_unsat
    upward = load * math.cos(phi)
    sideways = upward * math.tan(roll)
    excess = sideways - n_z * math.sin(phi), upward - n_z * math.cos(phi)
    rates_of_excess = 0.7 * chi * tracking, 0.6 * gamma * tracking
    assert excess[0] == pytest.approx(25.0 / G * math.cos(0.2) * rates_of_excess[0], rel=1e-9)
    assert excess[1] == pytest.approx(25.0 / G * rates_of_excess[1], rel=1e-9)


def test_a_steady_error_is_integrated_away_under_a_slow_rate_limit():
    """No lock: an increment larger than a rate-limited step does not stop its own integrator."""
    gains, slow = rates((0.0, 0.0), (5.0, 5.0)), limits(rate=(0.05, 0.05))
    law = ft.loop.ExactLaw(gains, slow, dt=DT, braking=None)

    phi, _ = command(law, seen(), ft.loop.ReferenceSample(0.3, 0.0), samples=500)

    assert phi > 0.2


def test_a_climb_that_the_rate_limit_could_not_take_back_is_not_asked_for():
    law = ft.loop.ExactLaw(rates((1.4, 2.0)), limits(rate=(9.0, 1.0)), dt=DT, braking=0.5)
    slow, fast = 0.05, 0.5

    command(law, seen(), ft.loop.ReferenceSample(0.0, slow))
    assert law.state.u_unsat[1] == pytest.approx(1.0 + 25.0 * 2.0 * slow / G, abs=ROUNDING)

    command(law, seen(), ft.loop.ReferenceSample(0.0, fast))
    caught = math.sqrt(2.0 * 0.5 * (G / 25.0) * 1.0 * fast)  # v^2 = 2 a s
    assert law.state.u_unsat[1] == pytest.approx(1.0 + 25.0 * caught / G, abs=ROUNDING)
    assert law.state.limited[1] == 2
    # It holds also while the command has arrived there.
    command(law, seen(), ft.loop.ReferenceSample(0.0, fast), samples=400)
    assert law.state.u[1] == law.state.u_unsat[1]
    assert law.state.limited[1] == 2


@pytest.mark.parametrize(("feedback", "stated"), [(0.0, True), (0.3, None), (0.3, False)])
def test_turns_are_braked_as_stated_or_where_roll_is_fed_back(feedback, stated):
    gains = ft.PIGains(
        K_P=np.diag([1.4, 2.0]),
        K_I=np.zeros((2, 2)),
        inputs=("chi_dot", "gamma_dot"),
        feedback=(feedback, 0.0),
    )
    law = ft.loop.ExactLaw(gains, limits(rate=(0.6, 9.0)), dt=DT, braking=0.5, brakes_turns=stated)
    error = 0.5

    command(law, seen(), ft.loop.ReferenceSample(error, 0.0))

    caught = math.sqrt(2.0 * 0.5 * (G / 25.0) * 0.6 * error)  # v^2 = 2 a s
    rate = 1.4 * error if stated is False else caught
    roll = math.atan(25.0 * rate / G)
    first = 0.6 * DT  # of which the roll command is capable in a sample
    assert law.state.u_unsat[0] == pytest.approx(roll + feedback * first, abs=ROUNDING)
    assert law.state.limited[0] == 2
    # a brake holds also while the command has arrived
    command(law, seen(), ft.loop.ReferenceSample(error, 0.0), samples=400)
    assert (law.state.limited[0] == 2) == (stated is not False)


@pytest.mark.parametrize(
    ("settings", "key"),
    [
        ({"dt": 0.0}, "dt"),
        ({"dt": DT, "braking": -1.0}, "braking"),
        ({"dt": DT, "priority": "both"}, "priority"),
        ({"dt": DT, "anti_windup": "clamp"}, "anti_windup"),
        ({"dt": DT, "gains": ft.PAPER_GAINS}, "gains"),
        ({"dt": DT, "limits": ft.loop.Limits.none(3)}, "limits"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(settings, key):
    with pytest.raises(ft.InputError, match=f"`{key}` must"):
        ft.loop.ExactLaw(**{"gains": GAINS} | settings)


SAME_MARGIN = 1e-6
K_P, K_I, FED = (1.5, 1.3), (0.8, 0.7), (0.5, 0.3)


def fed_back(feedback=FED):
    return ft.PIGains.from_lists(np.diag(K_P), np.diag(K_I), law="exact", feedback=feedback)


def lagged(*bandwidths):
    """The law's model behind a lag of first order in each command, 1/s."""
    A = np.block([[MODEL.A, MODEL.B], [np.zeros((2, 2)), -np.diag(bandwidths)]])
    B = np.vstack([np.zeros((2, 2)), np.diag(bandwidths)])
    C, states = np.eye(2, 4), (*MODEL.states, *MODEL.inputs)
    return replace(MODEL, A=A, B=B, C=C, states=states)


def test_poles_are_the_roots_of_the_characteristic_polynomial_written_by_hand():
    bandwidths = 4.0, 6.0
    # 1 + w/(s + w) (k + (1 + k) (K_P s + K_I) / s^2) = 0 in each channel
    by_hand = [
        np.roots([1.0, w * (1.0 + k), w * (1.0 + k) * p, w * (1.0 + k) * i])
        for w, k, p, i in zip(bandwidths, FED, K_P, K_I, strict=True)
    ]

    poles = np.sort_complex(np.linalg.eigvals(ft.loop.closed_loop(lagged(*bandwidths), fed_back())))

    assert poles == pytest.approx(np.sort_complex(np.concatenate(by_hand)), abs=1e-9)


@pytest.mark.parametrize("i", [0, 1])
def test_margins_are_those_of_the_frequency_response_at_the_commands(i):
    p, integral, k, w = K_P[i], K_I[i], FED[i], (4.0, 6.0)[i]

    def response(omega):
        s = 1j * omega
        return w / (s + w) * (k + (1.0 + k) * (p + integral / s) / s)

    made = ft.certify(lagged(4.0, 6.0), fed_back())
    (table,) = (x for x in made.answer().tables if x.name == "margins")

    crossover = brentq(lambda w: abs(response(w)) - 1.0, 0.5, 9.0, xtol=1e-13)
    phase = math.degrees(math.pi + np.angle(response(crossover)))
    assert table.records[i]["phase_margin_deg"] == pytest.approx(phase, rel=SAME_MARGIN)


def test_a_certificate_has_the_feedback_and_no_other_passes_for_it(tmp_path):
    model, file = lagged(4.0, 6.0), tmp_path / "fed.json"
    fed, plain = (ft.certify(model, fed_back(k)).certificate for k in (FED, (0.0, 0.0)))
    fed.save(file)

    kept = ft.load(file)

    assert kept.gains == fed_back()
    assert kept.verify().valid
    true_rate = -np.linalg.eigvals(ft.loop.closed_loop(model, fed_back())).real.max()
    assert fed.exact_rates[0].rate == pytest.approx(true_rate, rel=1e-2)
    plain.save(tmp_path / "plain.json")
    written = json.loads((tmp_path / "plain.json").read_text())["gains"]
    assert set(written) == {"K_P", "K_I", "inputs", "errors"}
    forged = Opened.of(file)
    forged.tables["gains"]["feedback"] = [0.0, 0.0]
    forged.write(file, anew=True)
    assert not ft.load(file).verify().valid


def held(roll, samples, *, chi=0.12, upper=(0.8, 2.0), **settings):
    """The law while roll and load factor stay at `roll` (rad) and 1, whatever it commands."""
    upper, rate = np.array(upper), np.array([0.5, 1.0])
    limits = ft.loop.Limits(lower=-upper, upper=upper, rate_lower=-rate, rate_upper=rate)
    law = ft.loop.ExactLaw(fed_back(), limits, dt=DT, **settings)
    law.start(ft.loop.FlightCondition(V_a=25.0))
    measured = seen(phi=roll)
    commands, integrals = [], []
    for k in range(samples):
        commands.append(law.step(measured, ft.loop.ReferenceSample(chi, 0.0), k * DT)[0])
        integrals.append(law.state.integral[0])
    return law, np.array(commands), np.array(integrals)


@pytest.mark.parametrize("anti_windup", ["conditional", "back_calculation"])
def test_the_feedback_winds_nothing_up_at_a_limit(anti_windup):
    """Roll stands in the way: with the feedback its command is at the limit, without it is not."""
    law, commands, integrals = held(-1.2, 600, anti_windup=anti_windup)

    assert np.abs(np.diff(commands)).max() <= 0.5 * DT + 1e-9
    assert commands.max() == 0.8
    assert law.state.limited[0] == 1
    # With back-calculation it ends where the error and what the limit takes are in balance.
    assert integrals.max() < (0.05 if anti_windup == "conditional" else 0.1)
    if anti_windup == "conditional":
        assert np.ptp(integrals[300:]) == 0.0


def test_a_command_without_a_limit_is_the_expected_one_and_what_roll_lacks():
    law, commands, _ = held(0.1, 100)
    expected = law.state.expected[0]

    assert commands[-1] == pytest.approx(expected + 0.5 * (expected - 0.1), abs=1e-9)


def test_a_turn_that_the_roll_rate_could_not_take_back_is_not_asked_for():
    """At half of 0.5 rad/s of roll a turn of 60 deg begins at sqrt(0.5 g/V e) rad/s."""
    law, *_ = held(0.0, 1, chi=1.0, upper=(1.5, 9.0))

    turn = math.sqrt(2.0 * 0.5 * 9.81 / 25.0 * 0.5 * 1.0)
    lacking = 0.5 * 0.5 * DT  # of the roll expected, a sample at its rate limit
    assert law.state.u_unsat[0] == pytest.approx(math.atan(25.0 * turn / 9.81) + lacking, abs=1e-9)
    assert law.state.integral[0] == 0.0


@pytest.mark.parametrize(
    ("made", "words"),
    [
        (lambda: ft.PIGains(K_P=np.eye(2), K_I=np.eye(2), feedback=FED), "`feedback` must be 0"),
        (lambda: ft.loop.command_gains(fed_back(), V_a=25.0), "`gains` must be flown by"),
    ],
    ids=["the paper's", "mapped"],
)
def test_gains_of_the_papers_law_have_none(made, words):
    with pytest.raises(ft.InputError, match=words):
        made()


def test_a_file_of_gains_keeps_the_feedback(tmp_path):
    file = tmp_path / "fed.json"
    fed_back().save(file)

    assert ft.load_gains(file) == fed_back()
    assert "feedback" not in fed_back((0.0, 0.0)).as_lists()
    file.write_text(json.dumps({**fed_back().as_lists(), "feedback": [1.5, 0.0]}))
    with pytest.raises(ft.ScenarioError, match=r"fed\.json: `feedback"):
        ft.load_gains(file)


def test_three_channels_command_the_rates_and_the_thrust_of_their_gains():
    """The rates are ref' + K_P e, lift is V cos(gamma) nu_chi / g, n_x sin(gamma) + V nu_V / g."""
    K_P = np.array([[1.4, 0.0, 0.3], [0.0, 1.2, 0.2], [0.1, 0.05, 0.5]])
    gains = ft.PIGains.from_lists(K_P, np.diag([0.7, 0.6, 0.4]), law="exact")
    here = seen(0.3, 0.05, 24.0, n_x=(0.1, -1.0, 1.0))
    reference = ft.loop.ReferenceSample(0.33, 0.08, 0.02, -0.01, V=25.0, V_dot=0.5)
    law = ft.loop.ExactLaw(gains, dt=DT)
    law.start(ft.loop.FlightCondition(V_a=24.0))

    phi, n_z, n_x, *_ = law.step(here, reference, 0.0)

    nu = np.array([0.02, -0.01, 0.5 / 25.0]) + K_P @ [0.03, 0.03, 1.0 / 25.0]
    side, lift = 24.0 * math.cos(0.05) * nu[0] / G, 24.0 * nu[1] / G + math.cos(0.05)
    assert (phi, n_z) == pytest.approx((math.atan2(side, lift), math.hypot(side, lift)), abs=1e-9)
    assert n_x == pytest.approx(math.sin(0.05) + 25.0 * nu[2] / G, abs=1e-9)


def test_a_brake_is_by_the_slower_of_both_rates():
    """The brake is twice its share of the rate, here up 2 and down 0.5 per second, or back."""
    both = []
    for down, up in ((-0.5, 2.0), (-2.0, 0.5)):
        bounds = ft.loop.Limits(
            lower=[-1.0, 0.0], upper=[1.0, 2.0], rate_lower=[-9.0, down], rate_upper=[9.0, up]
        )
        both.append(ft.loop.ExactLaw(GAINS, bounds, dt=DT, braking=0.25).law.brake)

    assert both == pytest.approx([2.0 * 0.25 * 0.5] * 2)
