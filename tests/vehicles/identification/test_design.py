"""Derivatives of the airframe against its published coefficients, and gains made of them."""

import dataclasses
import math
import shutil

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT
from scipy.integrate import solve_ivp

import flighttune as ft
from flighttune.vehicles.identification import design as designs
from flighttune.vehicles.plants.jsbsim.bench import AirframeState
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

AEROSONDE = ft.loop.JSBSimPlant("aerosonde").config
V_A, RHO_1000 = 25.0, 1.11164
MASS, JX, JY, JZ, JXZ = 11.0, 0.8244, 1.135, 1.759, 0.1204
S, B, C = 0.55, 2.8956, 0.18994
WEIGHT = MASS * 9.80665
Q_S = 0.5 * RHO_1000 * V_A**2 * S
SETTLING = 4e-3
DUTCH_ROLL = 0.7  # of critical damping: docs of the design
"""Share by which gains move with the flow behind a propeller from evaluation to evaluation."""
MOMENTUM, FOOT_POUND = 28.0, 1.3558179
"""Angular momentum of a propeller, ft lbf s, and N m in a foot-pound."""
STEP_REACHED = 0.05
"""Rad of roll, and load factors of 1, at the end of a step."""
CG_AFT = 0.05888
DRAG = 0.043 + 0.0232 * (WEIGHT / Q_S) ** 2
"""In a sideslip it has a part along the wing."""


@pytest.fixture(scope="module")
def slopes():
    fdm = Fdm(AEROSONDE)
    return designs.Airframe.about(fdm, ft.loop.FlightCondition(V_a=V_A, h=1000.0))


def lateral(C_l, C_n, C_Y=0.0):
    """Roll and yaw acceleration of the published coefficients, the side force behind the CG."""
    L, N = Q_S * B * C_l, Q_S * (B * C_n + C_Y * CG_AFT)
    gamma = JX * JZ - JXZ**2
    return (JZ * L + JXZ * N) / gamma, (JXZ * L + JX * N) / gamma


@pytest.mark.parametrize(
    ("by", "coefficients"),
    [
        ("p", (-0.51 * B / (2 * V_A), -0.069 * B / (2 * V_A))),
        ("r", (0.25 * B / (2 * V_A), -0.095 * B / (2 * V_A))),
        ("beta", (-0.13, 0.073, -0.83 - DRAG)),
        ("aileron", (0.17, -0.011, 0.075)),
        ("rudder", (0.0024, -0.069, 0.19)),
    ],
)
def test_lateral_derivatives_are_those_of_the_coefficients(slopes, by, coefficients):
    p_dot, r_dot = lateral(*coefficients)

    assert slopes.of("p_dot", by) == pytest.approx(p_dot, rel=1e-3, abs=1e-2)
    assert slopes.of("r_dot", by) == pytest.approx(r_dot, rel=1e-3, abs=1e-2)


def test_longitudinal_derivatives_are_those_of_the_coefficients(slopes):
    pitch = Q_S * C / JY
    assert slopes.of("q_dot", "q") == pytest.approx(-38.21 * C / (2 * V_A) * pitch, rel=0.1)
    lever = CG_AFT / C
    assert slopes.of("q_dot", "alpha") == pytest.approx((-2.74 + 5.61 * lever) * pitch, rel=0.03)
    assert slopes.of("q_dot", "elevator") == pytest.approx((-0.99 + 0.13 * lever) * pitch, rel=5e-3)
    assert slopes.of("n_z", "alpha") == pytest.approx(5.61 * Q_S / WEIGHT, rel=0.02)
    assert slopes.of("n_y", "beta") == pytest.approx((-0.83 - DRAG) * Q_S / WEIGHT, rel=2e-3)
    assert slopes.of("u_dot", "throttle") == pytest.approx(120.0 / MASS, rel=2e-3)


def test_roll_gains_place_the_poles_of_the_roll_error(slopes):
    design = AEROSONDE.design
    gains = designs.inner_loop_gains(slopes, design)

    effect, damping = slopes.of("p_dot", "aileron"), -slopes.of("p_dot", "p")
    omega = math.sqrt(effect * gains["roll/k_p"])
    total = damping + effect * gains["roll/k_d"]
    assert omega == pytest.approx(design.roll_error)
    assert total == pytest.approx(2.0 * 0.9 * omega)
    assert gains["roll/k_ff"] * effect == pytest.approx(damping)

    by_default = designs.inner_loop_gains(slopes, design.model_copy(update={"roll_error": None}))
    stiffness = effect * by_default["roll/k_p"]
    assert math.sqrt(stiffness) == pytest.approx(min(2.3 * design.roll, 12.5))


def test_pitch_gains_make_the_load_factor_follow_a_step_as_two_equal_poles_do(slopes):
    gains, d, wanted = (
        designs.inner_loop_gains(slopes, AEROSONDE.design),
        slopes.of,
        AEROSONDE.design.n_z,
    )
    k_p, k_i, k_q, model = (gains[f"pitch/{x}"] for x in ("k_p", "k_i", "k_q", "model-rad_sec"))

    def load(alpha, elevator):
        return d("n_z", "alpha") * alpha + d("n_z", "elevator") * elevator

    def rates(_, x):
        alpha, q, elevator, asked, integral = x
        off = asked - load(alpha, elevator)
        # The rate of pitch that the load factor asked for takes is not damped.
        command = k_q * (q - 9.80665 / V_A * asked) - k_p * off - k_i * integral
        pitching = d("q_dot", "alpha") * alpha + d("q_dot", "q") * q
        return (
            q - 9.80665 / V_A * load(alpha, elevator),
            pitching + d("q_dot", "elevator") * elevator,
            25.0 * (command - elevator),
            model * (1.0 - asked),
            off,
        )

    t = np.linspace(0.0, 2.0, 101)
    found = solve_ivp(rates, (0.0, 2.0), np.zeros(5), t_eval=t, rtol=1e-8, atol=1e-10).y

    response, two_poles = load(found[0], found[2]), 1.0 - (1.0 + wanted * t) * np.exp(-wanted * t)
    settling = t >= 0.4  # the elevator is behind its actuator, and first pushes the other way
    assert response[settling] == pytest.approx(two_poles[settling], abs=0.04)
    assert response.max() <= 1.0 + AEROSONDE.design.n_z_overshoot
    assert t[response >= 0.9][0] <= AEROSONDE.design.n_z_t90


def test_the_rudder_feed_forward_balances_a_roll_without_sideslip(slopes):
    # Rolling at p without sideslip: r = alpha p + g/V phi, so r' = g/V p, by the coefficients.
    gains = designs.inner_loop_gains(slopes, AEROSONDE.design)
    alpha, span = slopes.trimmed.alpha, B / (2.0 * V_A)
    rolling = lateral(-0.51 * span + 0.25 * span * alpha, -0.069 * span - 0.095 * span * alpha)
    aileron, rudder = lateral(0.17, -0.011, 0.075), lateral(0.0024, -0.069, 0.19)

    law = gains["yaw/k_ff"] + gains["yaw/k_r"] * alpha
    yaw = rolling[1] + gains["roll/k_ff"] * aileron[1] + law * rudder[1]

    assert alpha == pytest.approx(math.radians(3.4), abs=math.radians(0.3))
    assert yaw == pytest.approx(9.80665 / V_A, abs=0.03)


def test_the_rudder_damps_sideslip_and_yaw_to_the_share_of_critical_that_is_stated(slopes):
    rows = {what: dict(row) for what, row in slopes.slopes.items()}
    rows["r_dot"]["beta"], rows["n_y"]["beta"] = 40.0, -3.0  # stiff, with much side force
    airframe = designs.Airframe(trimmed=slopes.trimmed, slopes=rows)

    k_r = designs.inner_loop_gains(airframe, AEROSONDE.design)["yaw/k_r"]

    # beta' = (g/V) n_y - r, in turns of the path, and r' = N_beta beta + (N_r + N_rudder k_r) r
    damped = rows["r_dot"]["r"] + rows["r_dot"]["rudder"] * k_r
    turn = 9.80665 / slopes.trimmed.V_a * rows["n_y"]["beta"]
    modes = np.linalg.eigvals([[turn, -1.0], [40.0, damped]])
    assert k_r > 0.0
    assert -modes.real.mean() == pytest.approx(DUTCH_ROLL * math.sqrt(40.0))


@pytest.mark.parametrize(
    ("weathercock", "of_both"), [(-1.0, 1.0), (0.0, 1.0), (0.5, 1.0), (1.2, 1.2), (4.0, 4.0)]
)
def test_an_airframe_without_weathercock_stability_gets_it_from_the_rudder(
    slopes, weathercock, of_both
):
    rows = {what: dict(row) for what, row in slopes.slopes.items()}
    rows["r_dot"]["beta"] = weathercock
    airframe = designs.Airframe(trimmed=slopes.trimmed, slopes=rows)

    gains = designs.inner_loop_gains(airframe, AEROSONDE.design)

    # The rudder follows k_p n_y, and n_y follows the sideslip: 1/s2 at least, and three quarters
    # more from the loop that takes n_y to zero at 1 rad/s.
    by_rudder = rows["r_dot"]["rudder"] * gains["yaw/k_p"] * rows["n_y"]["beta"]
    assert weathercock + by_rudder == pytest.approx(1.75 * of_both)


@pytest.mark.soak
@pytest.mark.parametrize("name", ["aerosonde", "c172p", "a4"])
def test_a_design_is_that_of_the_file_and_meets_what_it_asks_for(name):
    shipped = ft.loop.JSBSimPlant(name).config.gains

    designed = ft.design(name)

    assert designed.gains.gains == pytest.approx(shipped.gains, rel=SETTLING)
    assert designed.missed == ""


def test_a_rudder_that_turns_the_wrong_way_is_refused(slopes):
    backwards = {what: dict(row) for what, row in slopes.slopes.items()}
    backwards["r_dot"]["rudder"] *= -1.0

    with pytest.raises(ft.loop.PlantError, match=r"r_dot by rudder .* 20"):
        designs.inner_loop_gains(
            designs.Airframe(trimmed=AirframeState(V_a=V_A, alpha=0.05), slopes=backwards),
            AEROSONDE.design,
        )


@pytest.mark.soak
def test_the_gyroscopic_moment_of_a_heavy_propeller_is_made_up_for(tmp_path):
    folder = shutil.copytree(SHIPPED_AIRCRAFT / "aerosonde", tmp_path / "gyroscope")
    text = (folder / "aerosonde.xml").read_text()
    for axis, momentum, rate in (("PITCH", MOMENTUM, "r"), ("YAW", -MOMENTUM, "q")):
        moment = f"<property>velocities/{rate}-rad_sec</property><value>{momentum}</value>"
        function = f'<function name="g/{rate}"><product>{moment}</product></function>'
        text = text.replace(f'<axis name="{axis}">', f'<axis name="{axis}">{function}')
    (folder / "aerosonde.xml").write_text(text)

    designed = ft.design(folder)
    designed.save(folder)
    channels = ft.identify(folder).identified.conditions[0].channels
    gains = designed.gains.gains
    of = designs.Airframe.about(Fdm(designed.config), ft.loop.FlightCondition(V_a=V_A, h=1000.0)).of

    pitch, yaw = MOMENTUM * FOOT_POUND / JY, -MOMENTUM * FOOT_POUND * JX / (JX * JZ - JXZ**2)
    assert pitch + gains["pitch/k_r"] * of("q_dot", "elevator") == pytest.approx(0.0, abs=0.05)
    assert yaw + gains["yaw/k_q"] * of("r_dot", "rudder") == pytest.approx(0.0, abs=0.05)
    assert min(channel.fit_percent for channel in channels.values()) > 90.0


@pytest.mark.parametrize(("share", "sense"), [(1.01, 1.0), (1.01, -1.0), (0.99, 1.0)])
def test_a_gyroscope_that_is_faster_than_the_loops_is_made_up_for_by_both_surfaces(
    slopes, share, sense
):
    """Pitch and yaw turn into each other at the root of their product: 1.5 times the bandwidth."""
    rows = {what: dict(row) for what, row in slopes.slopes.items()}
    nutation = share * 1.5 * AEROSONDE.design.n_z
    rows["q_dot"]["r"], rows["r_dot"]["q"] = 2.0 * sense * nutation, -0.5 * sense * nutation
    airframe = designs.Airframe(trimmed=slopes.trimmed, slopes=rows)

    gains = designs.inner_loop_gains(airframe, AEROSONDE.design)

    if share < 1.0:
        assert not {"pitch/k_r", "yaw/k_q"} & gains.keys()
    else:
        by_elevator = gains["pitch/k_r"] * rows["q_dot"]["elevator"]
        by_rudder = gains["yaw/k_q"] * rows["r_dot"]["rudder"]
        assert rows["q_dot"]["r"] + by_elevator == pytest.approx(0.0, abs=1e-9)
        assert rows["r_dot"]["q"] + by_rudder == pytest.approx(0.0, abs=1e-9)


def test_without_a_design_table_there_is_nothing_to_design_for():
    config = AEROSONDE.model_copy(update={"design": None})

    with pytest.raises(ft.InputError, match=r"aircraft.toml: `design` must be given"):
        ft.design(config)
    assert designs.check_steps(config) == ()


def test_an_aircraft_is_shown_rolling_and_in_a_pull_up_and_a_push_over():
    config = AEROSONDE.model_copy(
        update={"design": AEROSONDE.design.model_copy(update={"V_a_shown": (V_A, 1.1 * V_A)})}
    )

    steps = designs.check_steps(config)

    assert [step.V_a for step in steps] == [V_A] * 3 + [1.1 * V_A] * 3
    for roll, pull, push in (steps[:3], steps[3:]):
        assert [step.channel for step in (roll, pull, push)] == ["phi", "n_z", "n_z"]
        assert pull.size == -push.size > 0.0
        ends = [step.signals[step.channel][-1] for step in (roll, pull, push)]
        expected = roll.size, 1.0 + pull.size, 1.0 + push.size
        assert ends == pytest.approx(expected, abs=STEP_REACHED)


def test_a_step_is_as_fast_and_as_well_damped_as_its_response_is():
    """A roll step down by 0.5 rad from 0.1 rad: 90 % is -0.35 rad."""
    response = designs.StepResponse(
        channel="phi", V_a=25.0, size=-0.5, ended="", t90_allowed=0.3, overshoot_allowed=0.2,
        signals={"t": np.arange(5) * 0.1, "phi": np.array([0.1, -0.1, -0.34, -0.36, -0.5])},
    )  # fmt: skip
    slow = dataclasses.replace(response, signals={"t": np.arange(2) * 0.1, "phi": np.zeros(2)})

    assert response.progress == pytest.approx([0.0, 0.4, 0.88, 0.92, 1.2])
    assert response.t90 == pytest.approx(0.3)
    assert response.overshoot == pytest.approx(0.2)
    assert (slow.t90, slow.overshoot) == (math.inf, 0.0)
    allowed = {"t90_allowed": 0.31, "overshoot_allowed": 0.21}
    met = dataclasses.replace(response, **allowed)
    missed = [
        dataclasses.replace(met, t90_allowed=0.29),
        dataclasses.replace(met, overshoot_allowed=0.19),
        dataclasses.replace(met, ended="too slow."),
    ]
    assert met.met
    assert not any(step.met for step in missed)
    assert met.name == "phi -28.6479 deg at 25 m/s"
    assert dataclasses.replace(met, channel="n_z", size=0.5).name == "n_z +0.5 at 25 m/s"

    of = [
        designs.DesignedAircraft(config=AEROSONDE, steps=(met, step), before={}).missed
        for step in (met, *missed)
    ]
    assert of == [
        "",
        f"{met.name}: t90 must be at most 0.29 s and the overshoot 21 %, got 0.30 s and 20.0 %; "
        "nothing is written",
        f"{met.name}: t90 must be at most 0.31 s and the overshoot 19 %, got 0.30 s and 20.0 %; "
        "nothing is written",
        f"{met.name}: t90 must be at most 0.31 s and the overshoot 21 %, got 0.30 s and 20.0 %: "
        "too slow.; nothing is written",
    ]
