"""References and disturbances at times whose value is plain."""

import math
from dataclasses import replace

import numpy as np
import pytest
from made_up import scenario_tables
from scipy.integrate import quad

import flighttune as ft
from flighttune.flight.loop.disturbance import Sinusoid
from flighttune.routes.segments import Segment


def test_segments_add_to_the_start_value():
    reference = ft.loop.Reference(
        chi=1.0,
        gamma=0.0,
        chi_segments=(Segment(1.0, (0.0,), jumps=(0.5,)), Segment(2.0, (0.0, 2.0), rates=(0.25,))),
        gamma_segments=(Segment(1.0, (0.0, 1.0, 2.0), jumps=(0.1, -0.2, 0.1)),),
    )

    chi, gamma = reference.sampled(np.array([0.0, 0.99, 1.0, 2.0, 3.0, 4.0, 9.0]))

    assert chi == pytest.approx([1.0, 1.0, 1.5, 1.5, 1.75, 2.0, 2.0])
    assert gamma == pytest.approx([0.0, 0.0, 0.1, -0.1, 0.0, 0.0, 0.0])
    assert reference.sampled(3.0) == (1.75, 0.0)
    assert reference.rates(3.0) == (0.25, 0.0)


def test_each_rate_of_a_segment_counts_from_its_own_break():
    """2 s at 0.25, then 3 s at -0.5."""
    segment = Segment(1.0, (0.0, 2.0, 5.0), rates=(0.25, -0.5))

    t = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 9.0])

    assert segment(t) == pytest.approx([0.0, 0.25, 0.5, 0.0, -1.0, -1.0])
    assert segment.slope(t).tolist() == [0.25, 0.25, -0.5, -0.5, 0.0, 0.0]


ROLLED = Segment(2.0, (0.0, 4.0, 7.0), rates=(0.3, -0.1), roll_in=1.5)


def test_a_segment_says_when_its_shape_changes():
    """Half of the roll-in is before each break, half behind it."""
    assert ROLLED.times == (1.25, 2.75, 5.25, 6.75, 8.25, 9.75)
    assert Segment(2.0, (0.0, 4.0), rates=(0.3,)).times == (2.0, 6.0)


def test_a_rate_that_rolls_in_is_its_mean_over_that_time():
    """Expected: the mean of the plain ramp over 1.5 s about each time, by quadrature."""
    plain = lambda t: np.interp(t, [2.0, 6.0, 9.0], [0.0, 1.2, 0.9])  # noqa: E731
    t = np.linspace(0.0, 12.0, 97)
    means = [
        quad(plain, x - 0.75, x + 0.75, points=[2.0, 6.0, 9.0], epsabs=1e-13)[0] / 1.5
        for x in t.tolist()
    ]

    assert ROLLED(t) == pytest.approx(np.array(means), abs=1e-9)
    assert ROLLED.slope(t) == pytest.approx((plain(t + 0.75) - plain(t - 0.75)) / 1.5, abs=1e-12)
    assert ROLLED.times == (1.25, 2.75, 5.25, 6.75, 8.25, 9.75)
    assert replace(ROLLED, roll_in=0.0).times == (2.0, 6.0, 9.0)


def test_a_rate_holds_from_its_break_to_the_next_whatever_the_rounding():
    ramp = replace(ROLLED, roll_in=0.0)
    t = np.array([1.9, 2.0 - 1e-12, 5.9, 6.0 - 1e-12, 8.9, 9.0 - 1e-12])

    assert ramp.slope(t).tolist() == [0.0, 0.3, 0.3, -0.1, -0.1, 0.0]


def test_a_planned_reference_leads_each_channel_by_its_own_lag():
    path = Segment(1.0, (0.0, 2.0), rates=(0.2,))
    chi = replace(ROLLED, start=1.0)
    reference = ft.loop.Reference(
        chi=0.1, gamma=0.0, chi_segments=(chi, chi), gamma_segments=(path,), V=20.0,
        V_segments=(Segment(0.0, (0.0, 2.0), rates=(1.5,)), Segment(1.0, (0.0,), jumps=(-4.0,))),
    )  # fmt: skip
    t = np.array([0.8, 1.4, 2.9])

    chi_dot, gamma_dot = reference.rates(t, lead=(0.3, 0.7))

    assert reference.planned
    assert chi_dot == pytest.approx(2.0 * chi.slope(t + 0.3), abs=1e-15)
    assert gamma_dot == pytest.approx([0.2, 0.2, 0.0], abs=1e-15)
    V, V_dot = reference.airspeed(t)
    assert V == pytest.approx([21.2, 18.1, 19.0])
    assert V_dot == pytest.approx([1.5, 1.5, 0.0])
    assert replace(reference, chi_segments=(), gamma_segments=(path, chi)).planned
    stepping = replace(reference, chi_segments=())
    assert not stepping.planned
    assert stepping.rates(t, lead=(0.3, 0.7))[1] == pytest.approx([0.0, 0.2, 0.2])
    assert replace(reference, V=None).airspeed(t) is None


def test_the_initial_values_hold_what_starts_there():
    jump, ramp = Segment(0.0, (0.0,), jumps=(0.5,)), Segment(0.0, (0.0, 1.0), rates=(0.5,))
    for chi, gamma, initial in (
        ((jump,), (), (1.5, 0.2)), ((), (jump,), (1.0, 0.7)), ((ramp,), (ramp,), (1.0, 0.2)),
    ):  # fmt: skip
        reference = ft.loop.Reference(chi=1.0, gamma=0.2, chi_segments=chi, gamma_segments=gamma)
        assert reference.initial == pytest.approx(initial)


@pytest.mark.soak
@pytest.mark.parametrize("omegas", [(0.15, 0.15), (0.3, 1.1)])
def test_the_rate_bound_is_the_least_upper_bound_of_the_derivative(omegas):
    sinusoid = Sinusoid(
        chi_amplitude=0.1, chi_omega=omegas[0], gamma_amplitude=0.2, gamma_omega=omegas[1]
    )
    t = np.linspace(0.0, 2000.0, 400_001)
    d = np.array([sinusoid(time) for time in t.tolist()])

    largest = np.linalg.norm(np.gradient(d, t, axis=0)[1:-1], axis=1).max()

    assert largest <= sinusoid.rate_bound * (1.0 + 1e-9)
    assert largest == pytest.approx(sinusoid.rate_bound, rel=1e-3)


def test_the_papers_disturbance_has_the_rate_bound_of_its_table():
    sinusoid = Sinusoid(chi_amplitude=0.1, chi_omega=0.15, gamma_amplitude=0.1, gamma_omega=0.15)

    assert sinusoid.rate_bound == pytest.approx(0.015)
    assert sinusoid(0.0) == pytest.approx((0.0, 0.1))
    assert sinusoid(math.pi / 0.3) == pytest.approx((0.1, 0.0), abs=1e-12)


def test_a_square_wave_has_the_sign_of_the_sinusoid_and_its_amplitude():
    shape = {"chi_amplitude": 0.1, "chi_omega": 2.0, "chi_phase": 0.3, "gamma_amplitude": -0.2}
    sine, square = Sinusoid(**shape), Sinusoid(**shape, square=True)

    for t in np.linspace(0.0, 6.0, 50):
        assert square(t)[0] == math.copysign(0.1, math.sin(2.0 * t + 0.3))
        assert square(t)[1] == sine(t)[1] == -0.2  # a cosine that stands at 1
    assert square.rate_bound == math.inf
    assert Sinusoid(square=True).rate_bound == 0.0


def test_a_disturbance_with_switching_times_is_constant_between_them():
    switched = Sinusoid(chi_amplitude=0.1, chi_switches=(1.0, 3.0), gamma_amplitude=-0.2)

    d = [switched(t) for t in (0.0, 0.99, 1.0, 2.99, 3.0, 9.0)]

    assert [chi for chi, _ in d] == [0.1, 0.1, -0.1, -0.1, 0.1, 0.1]
    assert {gamma for _, gamma in d} == {-0.2}
    assert switched.rate_bound == math.inf
    assert Sinusoid(chi_amplitude=0.1, chi_switches=()).rate_bound == 0.0


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
