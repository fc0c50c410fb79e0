"""References and disturbances at times whose value is plain."""

import math
import re

import numpy as np
import pytest
from made_up import scenario_tables

import flighttune as ft


def test_an_airspeed_may_go_up_and_down_and_back():
    tables = scenario_tables(
        reference={"V_mps": [
            {"shape": "doublet", "start_s": 2.0, "width_s": 3.0, "amplitude_mps": 1.5},
            {"shape": "ramp", "start_s": 10.0, "duration_s": 4.0, "rate_mps2": -0.5},
        ]},
        limits={"n_x": [-0.3, 0.3]}, plant=[{"kind": "point_mass"}], gains=["tuned"],
    )  # fmt: skip
    jump = [{"shape": "step", "start_s": 0.5, "change_mps": 2.0}]
    faster = ft.scenario_from(tables | {"reference": tables["reference"] | {"V_mps": jump}})
    assert faster.reference.airspeeds(faster.flight) == pytest.approx((25.0, 27.0))
    assert faster.reference.steepest(faster.flight) == (0.0, 0.0)
    scenario = ft.scenario_from(tables)
    reference = scenario.stated_reference
    assert scenario.reference.airspeeds(scenario.flight) == pytest.approx((23.0, 26.5))
    assert not scenario.reference.batched

    V, V_dot = reference.airspeed(np.array([0.0, 2.0, 4.9, 5.0, 7.9, 8.0, 12.0, 20.0]))

    assert V == pytest.approx([25.0, 26.5, 26.5, 23.5, 23.5, 25.0, 24.0, 23.0])
    assert V_dot == pytest.approx([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.5, 0.0])


def test_segments_of_course_and_path_angle_add_to_the_start_of_the_flight():
    """From 5 deg a step of 4, a ramp of 2 deg/s and a doublet; down 3 deg from a climb of 1."""
    tables = scenario_tables(
        flight={"V_a_mps": 25.0, "chi_deg": 5.0, "gamma_deg": 1.0, "duration_s": 20.0},
        reference={
            "chi_deg": [
                {"shape": "step", "change_deg": 4.0},
                {"shape": "ramp", "start_s": 2.0, "duration_s": 3.0, "rate_dps": 2.0},
                {"shape": "doublet", "start_s": 8.0, "width_s": 1.5, "amplitude_deg": 7.0},
            ],
            "gamma_deg": [{"shape": "doublet", "width_s": 2.0, "amplitude_deg": -3.0}],
        },
    )
    scenario = ft.scenario_from(tables)

    t = np.array([0.0, 2.0, 3.0, 5.0, 7.9, 8.0, 9.4, 9.5, 10.9, 11.0, 20.0])
    chi, gamma = scenario.stated_reference.sampled(t)

    assert np.degrees(chi) == pytest.approx([9, 9, 11, 15, 15, 22, 22, 8, 8, 15, 15])
    assert np.degrees(gamma) == pytest.approx([-2, 4, 4, 1, 1, 1, 1, 1, 1, 1, 1])
    reference, flight = scenario.reference, scenario.flight
    time, steepest = reference.steepest(flight)
    assert steepest == pytest.approx(4.0)
    assert 2.0 <= time <= 4.0
    assert [key for key, _ in reference.segments] == ["chi_deg"] * 3 + ["gamma_deg"]
    assert (reference.batched, reference.ramps_in) == (True, [])


def test_the_steepest_path_angle_may_be_at_a_break_at_the_end_or_just_before_a_jump():
    def steepest(*segments, seconds=10.0):
        flight = {"V_a_mps": 25.0, "gamma_deg": 2.0, "duration_s": seconds}
        reference = {"chi_deg": 0.0, "gamma_deg": [*segments]}
        scenario = ft.scenario_from(scenario_tables(flight=flight, reference=reference))
        return scenario.reference.steepest(scenario.flight)

    ramp = {"shape": "ramp", "start_s": 1.0, "duration_s": 4.0, "rate_dps": -2.0}
    drop = {"shape": "step", "start_s": 3.0, "change_deg": 5.0}

    assert steepest(ramp) == (5.0, pytest.approx(-6.0))
    assert steepest(ramp | {"start_s": 3.0, "rate_dps": -0.5}) == (0.0, pytest.approx(2.0))
    assert steepest(ramp, seconds=4.0) == (4.0, pytest.approx(-4.0))
    time, angle = steepest(ramp | {"rate_dps": -3.0}, drop)
    assert (time, angle) == (5.0, pytest.approx(-5.0))
    time, angle = steepest(ramp | {"rate_dps": -3.0}, drop | {"change_deg": 9.0})
    assert (time, angle) == (pytest.approx(3.0), pytest.approx(5.0))
    time, angle = steepest(ramp | {"rate_dps": 3.0}, drop | {"change_deg": -20.0})
    assert (time, angle) == (3.0, pytest.approx(-12.0))
    time, angle = steepest(ramp | {"rate_dps": 4.0}, drop | {"change_deg": -11.0})
    assert (time, angle) == (pytest.approx(3.0), pytest.approx(10.0))
    assert time < 3.0


RAMP = {"shape": "ramp", "start_s": 0.5, "duration_s": 2.0, "rate_dps": 6.0, "roll_in_s": 0.6}
LAGGED = {"kind": "point_mass_lag", "roll_lag_rad_s": 5.0, "n_z_lag_rad_s": 8.0}


def told_to_a_law(made):
    """Times and references that a law of one's own is given on the first plant."""
    told = []

    class Listens:
        dt, signals = 0.02, {}

        def __init__(self, _):
            pass

        def start(self, condition):
            told.append([])

        def step(self, measured, reference, t):
            told[-1].append((t, reference))
            return 0.0, 1.0

    ft.fly(ft.scenario_from(made), laws={"own": Listens})
    return told[0]


@pytest.mark.parametrize(
    ("plant", "leads"),
    [({"kind": "kinematic"}, (0.0, 0.0)), (LAGGED | {"n_z_delay_s": 0.05}, (0.2, 0.175))],
)
def test_the_rates_of_a_ramp_that_rolls_in_lead_by_the_lags_and_half_a_sample(plant, leads):
    turn = {"chi_deg": [RAMP], "gamma_deg": [RAMP | {"rate_dps": -2.0}]}
    limits = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 40.0, "n_z": [0.5, 1.5]}
    limits |= {"n_z_rate_per_s": 1.0}
    made = scenario_tables(flight={"duration_s": 1.5}, reference=turn, plant=[plant], limits=limits)

    told = [(t, ref.chi_dot, ref.gamma_dot) for t, ref in told_to_a_law(made)]
    t, *rates = np.array(told).T
    for found, rate, lead in zip(rates, (6.0, -2.0), leads, strict=True):
        share = np.clip((t + lead + 0.01 - 0.2) / 0.6, 0.0, 1.0)  # half of it before the ramp
        assert np.degrees(found) == pytest.approx(rate * share, abs=1e-9)


def test_a_ramp_that_rolls_in_too_fast_is_refused_with_the_time_that_suffices():
    """6 deg/s at 25 m/s take a lift of V/g times the rate, which roll reaches at its rate."""
    limits = {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 20.0, "n_z": [0.5, 1.5]}
    ramp = RAMP | {"roll_in_s": 0.1}
    made = scenario_tables(reference={"chi_deg": [ramp]}, limits=limits | {"n_z_rate_per_s": 1.0})
    least = math.radians(6.0) * 25.0 / 9.81 / math.radians(20.0)

    with pytest.raises(ft.InputError, match="`roll_in_s` must be at least") as refused:
        ft.fly(ft.scenario_from(made))
    (said,) = re.findall(r"at least ([\d.]+) s", str(refused.value))
    assert least <= float(said) < least + 0.001


@pytest.mark.parametrize(("V_a", "lift", "margin"), [(20.0, 0.64, None), (25.0, 1.0, 0.3)])
def test_a_feasible_reference_keeps_a_share_of_the_limits_of_its_aircraft(V_a, lift, margin):
    """Below the design airspeed of 25 m/s the largest load factor falls with its square."""
    change = {"chi_deg": 90.0, "gamma_deg": 25.0, "shape": "feasible"}
    plants = [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "aerosonde"}]
    made = scenario_tables(
        flight={"V_a_mps": V_a, "duration_s": 6.0},
        reference=change | ({} if margin is None else {"margin": margin}),
        plant=plants,
    )
    roll, n_z = ft.loop.JSBSimPlant("aerosonde").limits.upper
    share = 1.0 - (margin or 0.2)

    planned = np.array([reference.planned for _, reference in told_to_a_law(made)])

    assert planned[:, 0].max() == pytest.approx(share * roll, rel=1e-6)
    assert planned[:, 1].max() == pytest.approx(1.0 + share * (lift * n_z - 1.0), rel=1e-6)
    rates = np.abs(np.diff(planned, axis=0)).max(axis=0) / 0.02
    most = share * ft.loop.JSBSimPlant("aerosonde").limits.rate_upper
    assert (rates <= most * (1.0 + 1e-6)).all()
