"""Gains of the inner loop against the published coefficients that they are made of."""

import math
import re
import shutil

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT
from scipy.integrate import solve_ivp

import flighttune as ft

V, RHO, G = 25.0, 1.11164, 9.80665
MASS, JX, JY, JZ, JXZ = 11.0, 0.8244, 1.135, 1.759, 0.1204
S, B, C, CG_AFT = 0.55, 2.8956, 0.18994, 0.05888
W, Q_S = MASS * G, 0.5 * RHO * V**2 * S
SPAN = B / (2.0 * V)
DRAG = 0.043 + 0.0232 * (W / Q_S) ** 2
ALPHA = (W / Q_S - 0.23) / 5.61
ROLL, ROLL_ERROR, N_Z, SPEED = 6.0, 15.0, 11.5, 2.0  # rad/s: [design] of its aircraft.toml


def lateral(C_l, C_n, C_Y=0.0):
    """Roll and yaw acceleration of the coefficients, the side force ahead of the CG."""
    L, N = Q_S * B * C_l, Q_S * (B * C_n + C_Y * CG_AFT)
    turn = JX * JZ - JXZ**2
    return (JZ * L + JXZ * N) / turn, (JXZ * L + JX * N) / turn


P, R = lateral(-0.51 * SPAN, -0.069 * SPAN), lateral(0.25 * SPAN, -0.095 * SPAN)
BETA, SIDE = lateral(-0.13, 0.073, -0.83 - DRAG), (-0.83 - DRAG) * Q_S / W
AILERON, RUDDER = lateral(0.17, -0.011, 0.075), lateral(0.0024, -0.069, 0.19)
PITCH, LEVER = Q_S * C / JY, CG_AFT / C
N_ALPHA, N_E = 5.61 * Q_S / W, 0.13 * Q_S / W
M_ALPHA, M_E = (-2.74 + 5.61 * LEVER) * PITCH, (-0.99 + 0.13 * LEVER) * PITCH
M_Q = -38.21 * C / (2.0 * V) * PITCH


@pytest.fixture(scope="module")
def designed():
    return ft.design("aerosonde")


@pytest.fixture(scope="module")
def gains(designed):
    return designed.gains.gains


@pytest.fixture
def changed(tmp_path):
    """The gains of an Aerosonde with changes of its model or file."""

    def changed(*changes):
        folder = tmp_path / "aircraft"
        shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", folder, dirs_exist_ok=True)
        for name, pattern, new in changes:
            text, count = re.subn(pattern, new, (folder / name).read_text(), count=1)
            assert count, pattern
            (folder / name).write_text(text)
        return ft.design(folder)

    return changed


XML, TOML = "aerosonde.xml", "aircraft.toml"


def test_roll_gains_place_the_poles_of_the_roll_error(gains):
    """e'' + (damping + effect k_d) e' + effect k_p e = 0, at 0.9 of critical damping."""
    effect, damping = AILERON[0], -P[0]

    assert gains["roll/model-rad_sec"] == ROLL
    assert gains["roll/k_p"] == pytest.approx(ROLL_ERROR**2 / effect, rel=0.01)
    assert gains["roll/k_i"] == pytest.approx(0.1 * ROLL * gains["roll/k_p"], rel=1e-3)
    assert damping + effect * gains["roll/k_d"] == pytest.approx(1.8 * ROLL_ERROR, rel=0.01)
    assert gains["roll/k_ff"] == pytest.approx(damping / effect, rel=0.01)


def test_gains_of_the_airspeed_are_those_of_the_thrust(gains):
    thrust = 120.0 / MASS

    assert gains["speed/k_gamma"] == pytest.approx(G / thrust, rel=0.01)
    assert gains["speed/k_p"] == pytest.approx(SPEED / thrust, rel=0.01)
    assert gains["speed/k_i"] == pytest.approx(0.25 * SPEED**2 / thrust, rel=0.01)
    assert gains["V_a-design-mps"] == V


def test_pitch_gains_make_the_load_factor_follow_a_step_as_two_equal_poles_do(gains):
    k_p, k_i, k_q, model = (gains[f"pitch/{x}"] for x in ("k_p", "k_i", "k_q", "model-rad_sec"))

    def load(alpha, elevator):
        return N_ALPHA * alpha + N_E * elevator

    def rates(_, x):
        alpha, q, elevator, asked, integral = x
        off = asked - load(alpha, elevator)
        # The rate of pitch that the load factor asked for takes is not damped.
        command = k_q * (q - G / V * asked) - k_p * off - k_i * integral
        turned = M_ALPHA * alpha + M_Q * q + M_E * elevator
        return (
            q - G / V * load(alpha, elevator), turned, 25.0 * (command - elevator),
            model * (1.0 - asked), off,
        )  # fmt: skip

    t = np.linspace(0.0, 2.0, 101)
    found = solve_ivp(rates, (0.0, 2.0), np.zeros(5), t_eval=t, rtol=1e-8, atol=1e-10).y

    response, two_poles = load(found[0], found[2]), 1.0 - (1.0 + N_Z * t) * np.exp(-N_Z * t)
    settling = t >= 0.4  # the elevator is behind its actuator, and first pushes the other way
    assert response[settling] == pytest.approx(two_poles[settling], abs=0.04)
    assert response.max() <= 1.05
    assert t[response >= 0.9][0] <= 0.8
    assert model == 20.0  # twice the bandwidth, at most


def test_the_rudder_balances_a_roll_and_damps_sideslip(gains):
    """Rolling at p without sideslip: r = alpha p + g/V phi, so r' = g/V p, by the coefficients."""
    law = gains["yaw/k_ff"] + gains["yaw/k_r"] * ALPHA
    yaw = P[1] + R[1] * ALPHA + gains["roll/k_ff"] * AILERON[1] + law * RUDDER[1]
    assert yaw == pytest.approx(G / V, abs=0.04)

    # beta' = (g/V) n_y - r, in turns of the path, and r' = N_beta beta + (N_r + N_rudder k_r) r
    goal = 0.7 * math.sqrt(BETA[1])
    modes = np.linalg.eigvals(
        [[G / V * SIDE, -1.0], [BETA[1], R[1] + RUDDER[1] * gains["yaw/k_r"]]]
    )
    damped = -modes.real.mean()
    assert damped == pytest.approx(goal, rel=0.03) or gains["yaw/k_r"] == 0.0 < goal < damped
    # n_y goes to zero at 1 rad/s, and three quarters of it at once
    integral = 1.0 / abs(SIDE * RUDDER[1] / BETA[1])
    assert gains["yaw/k_i"] == pytest.approx(integral, rel=0.03)
    assert gains["yaw/k_p"] == pytest.approx(0.75 * integral, rel=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("C_n_beta", [0.0283, 0.2])
def test_an_airframe_gets_weathercock_stability_and_damping_from_the_rudder(C_n_beta, changed):
    gains = changed((XML, "> 0.073 <", f"> {C_n_beta} <")).gains.gains

    weathercock = lateral(-0.13, C_n_beta, -0.83 - DRAG)[1]
    lacking = max(0.0, 1.0 - weathercock)
    stiff = weathercock + lacking
    own = 0.75 * stiff / abs(SIDE * RUDDER[1]) + lacking / abs(SIDE * RUDDER[1])
    if stiff > 1.0:
        k_r = (1.4 * math.sqrt(stiff) + R[1] + SIDE * G / V) / -RUDDER[1]
        assert gains["yaw/k_r"] == pytest.approx(max(0.0, k_r), rel=0.03, abs=1e-3)
    # The share that the delays of actuator and accelerometer leave stable.
    share = gains["yaw/k_i"] * abs(SIDE * RUDDER[1]) / stiff
    assert 0.02 < share <= 1.03
    assert gains["yaw/k_p"] == pytest.approx(share * own, rel=0.05)


@pytest.mark.slow
def test_by_default_the_roll_error_is_as_stiff_as_the_roll_is_fast(changed):
    gains = changed((TOML, "roll_error_rad_s = .*", "")).gains.gains

    assert math.sqrt(AILERON[0] * gains["roll/k_p"]) == pytest.approx(12.5, rel=0.01)


FASTER = [
    (TOML, "roll_t90_s .*", "roll_t90_s = 0.2", "phi +30 deg at 20 m/s: t90 must be at most 0.2 s"),
    (TOML, "n_z_overshoot .*", "n_z_overshoot = 1e-6", "n_z "),
]


@pytest.mark.slow
@pytest.mark.parametrize(("file", "old", "new", "words"), FASTER)
def test_a_design_that_is_missed_says_its_step_and_what_it_reached(changed, file, old, new, words):
    designed = changed((file, old, new))

    assert words in designed.missed
    assert "nothing is written" in designed.missed
    (first, *_) = [step for step in designed.steps if not step.met]
    assert first.name in designed.missed
    assert f"got {first.t90:.2f} s and {100.0 * first.overshoot:.1f} %" in designed.missed


def test_an_aircraft_is_shown_rolling_and_in_a_pull_up_and_a_push_over(designed):
    steps = designed.steps

    assert [step.V_a for step in steps] == [20.0] * 3 + [25.0] * 3 + [30.0] * 3
    for roll, pull, push in (steps[:3], steps[3:6], steps[6:]):
        assert [step.channel for step in (roll, pull, push)] == ["phi", "n_z", "n_z"]
        assert pull.size == -push.size > 0.0
        ends = [step.signals[step.channel][-1] for step in (roll, pull, push)]
        expected = roll.size, 1.0 + pull.size, 1.0 + push.size
        assert ends == pytest.approx(expected, abs=0.05)
    for step in steps:
        y = step.signals[step.channel]
        share = (y - y[0]) / step.size
        assert step.t90 == step.signals["t"][np.argmax(share >= 0.9)]
        assert step.overshoot == pytest.approx(max(0.0, share.max() - 1.0))
        size = f"{math.degrees(step.size):+.0f} deg" if step.channel == "phi" else f"{step.size:+g}"
        assert step.name == f"{step.channel} {size} at {step.V_a:g} m/s"
        assert step.met
    assert designed.missed == ""


def test_a_design_is_that_of_the_file(gains):
    shipped = ft.loop.JSBSimPlant("aerosonde").config.gains

    assert gains == pytest.approx(shipped.gains, rel=4e-3)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["c172p", "a4"])
def test_so_are_those_of_others(name):
    designed, shipped = ft.design(name), ft.loop.JSBSimPlant(name).config.gains

    assert designed.gains.gains == pytest.approx(shipped.gains, rel=4e-3)
    assert designed.missed == ""


REFUSED = [
    (XML, r'(Cn_dr"> <value>) -0.069', r"\1 0.069", r"r_dot by rudder"),
    (TOML, r"(?s)\[design\].*", "", "`design` must be given"),
]


@pytest.mark.parametrize(("file", "old", "new", "words"), REFUSED)
def test_what_cannot_be_designed_is_refused(changed, file, old, new, words):
    with pytest.raises(ft.FlightTuneError, match=words):
        changed((file, old, new))


@pytest.mark.slow
def test_the_gyroscopic_moment_of_a_heavy_propeller_is_made_up_for(changed):
    """28 lbf ft s of angular momentum; the moments of pitch and yaw cancel."""
    momentum, changes = 28.0, []
    for axis, size, rate in (("PITCH", momentum, "r"), ("YAW", -momentum, "q")):
        moment = f"<property>velocities/{rate}-rad_sec</property><value>{size}</value>"
        function = f'<function name="g/{rate}"><product>{moment}</product></function>'
        changes.append((XML, f'<axis name="{axis}">', f'<axis name="{axis}">{function}'))

    gains = changed(*changes).gains.gains

    pitch, yaw = momentum * 1.35582 / JY, -momentum * 1.35582 * JX / (JX * JZ - JXZ**2)
    assert gains["pitch/k_r"] == pytest.approx(-pitch / M_E, rel=0.02)
    assert gains["yaw/k_q"] == pytest.approx(-yaw / RUDDER[1], rel=0.02)


def test_gains_of_yaw_are_zero_without_a_rudder_and_none_is_gyroscopic_without_a_propeller(gains):
    rudderless = ft.design("x8").gains.gains

    assert {value for name, value in rudderless.items() if name.startswith("yaw/")} == {0.0}
    assert not {"pitch/k_r", "yaw/k_q"} & {*gains, *rudderless}
