"""The fastest reference within limits, against closed forms and a flight of its own model."""

import math
import time
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from made_up import scenario_tables
from scipy.integrate import solve_ivp

import flighttune as ft
from flighttune.flight import conditions
from flighttune.flight.load import check_scenario
from flighttune.flight.loop import loop
from flighttune.flight.loop.loop import simulate
from flighttune.routes import feasible

DEG = math.pi / 180.0

LAGS = (
    ft.loop.InnerLag(order=2, natural_frequency=9.0, damping=0.8, delay=0.03),
    ft.loop.InnerLag(order=1, natural_frequency=12.0, delay=0.013),
)
PAPER = feasible.Manoeuvre(
    V_a=25.0,
    g=9.81,
    start=(60.0 * DEG, 45.0 * DEG),
    end=(0.0, 15.0 * DEG),
    u_0=(0.0, math.cos(45.0 * DEG)),
    lower=(-36.0 * DEG, -1.48),
    upper=(36.0 * DEG, 1.88),
    rate_lower=(-24.0 * DEG, -0.8),
    rate_upper=(24.0 * DEG, 0.8),
    lags=LAGS,
    dt=0.02,
)
HUNDREDTH_DEG = 0.01 * DEG


@pytest.fixture(scope="module")
def found():
    return feasible.feasible_reference(PAPER)


def test_it_ends_where_it_shall_and_stays_there(found):
    t = np.array([found.duration + 5.0, 100.0])
    chi, gamma = found.sampled(t)

    assert chi == pytest.approx([0.0, 0.0], abs=HUNDREDTH_DEG)
    assert gamma == pytest.approx([15.0 * DEG] * 2, abs=HUNDREDTH_DEG)
    assert found.initial == PAPER.start
    assert found.commands(t) == pytest.approx(np.array([[0.0, math.cos(15.0 * DEG)]] * 2))


def test_commands_keep_every_limit(found):
    commands = found.commands(np.arange(0.0, 12.0, PAPER.dt))
    rates = np.diff(commands, axis=0) / PAPER.dt

    # The penalty of the plan is exact up to its tolerance.
    assert (commands >= np.array(PAPER.lower) - 1e-6).all()
    assert (commands <= np.array(PAPER.upper) + 1e-6).all()
    assert (rates >= np.array(PAPER.rate_lower) - 1e-4).all()
    assert (rates <= np.array(PAPER.rate_upper) + 1e-4).all()


def test_some_limit_is_met_nearly_all_the_time(found):
    """A plan that meets no limit for a while could be faster."""
    commands = found.commands(np.arange(0.0, found.duration, PAPER.dt))
    rates = np.abs(np.diff(commands, axis=0)) / PAPER.dt
    at_rate = rates > 0.98 * np.array(PAPER.rate_upper)
    at_stop = np.abs(commands[1:, 0]) > 0.98 * PAPER.upper[0]

    assert np.mean(at_rate.any(axis=1) | at_stop) > 0.9


@pytest.mark.parametrize("change_deg", [3.0, -6.0])
def test_a_change_of_path_angle_takes_as_long_as_the_rate_of_load_factor_says(change_deg):
    """Level enough for cos(gamma) = 1, the load factor is a triangle of slope r:
    ``change = (g/V) r (T/2)^2``."""
    half = 0.5 * change_deg * DEG
    pull = replace(PAPER, start=(0.0, -half), end=(0.0, half), u_0=(0.0, math.cos(half)), lags=None)

    triangle = 2.0 * math.sqrt(abs(change_deg) * DEG * 25.0 / (9.81 * 0.8))
    assert feasible.feasible_reference(pull).duration == pytest.approx(triangle, rel=0.01)


def test_the_point_mass_behind_the_lag_flies_it_without_the_help_of_feedback(found):
    controller = ft.loop.MimoPI(
        ft.PAPER_GAINS, ft.loop.Limits.none(2), dt=PAPER.dt, feed_forward=True
    )
    condition = ft.loop.FlightCondition(V_a=25.0, chi=60.0 * DEG, gamma=45.0 * DEG)
    plant = ft.loop.PointMassPlant(LAGS, g=9.81)

    signals, stop = simulate(plant, controller, found, condition=condition, duration=12.0)

    # After the last sample of the plan the reference stands: path angle drifts by far less.
    assert stop is None
    flown = signals.index <= found.duration
    assert signals.loc[flown, ["chi_err", "gamma_err"]].abs().max().max() < 1e-9
    assert signals[["chi_err", "gamma_err"]].abs().max().max() < HUNDREDTH_DEG


def test_the_shorter_way_round_is_flown():
    turn = replace(PAPER, start=(170.0 * DEG, 0.0), end=(-170.0 * DEG, 0.0), u_0=(0.0, 1.0))

    chi, _ = feasible.feasible_reference(turn).sampled(np.array([0.0, 60.0]))

    assert chi / DEG == pytest.approx([170.0, 190.0], abs=0.01)


def test_nothing_to_change_takes_no_time():
    still = replace(PAPER, end=PAPER.start)

    assert feasible.feasible_reference(still).duration < 0.5


TABLES = scenario_tables(
    flight={"chi_deg": 30.0, "duration_s": 10.0},
    reference={"shape": "feasible", "gamma_deg": 5.0, "margin": 0.1},
    limits={
        "phi_deg": [-30.0, 40.0], "phi_rate_dps": 20.0, "n_z": [0.0, 1.8], "n_z_rate_per_s": 1.0,
    },
    controller={"feed_forward": True},
    plant=[{"kind": "point_mass"}],
)  # fmt: skip


def changed(**tables):
    merged = {
        name: {**TABLES[name], **values} if isinstance(values, dict) else values
        for name, values in tables.items()
    }
    return {**TABLES, **merged}


def test_the_margin_is_taken_off_every_limit_about_level_flight():
    commands = conditions.reference_of(ft.scenario_from(TABLES)).commands(
        np.arange(0.0, 10.0, 0.02)
    )

    assert commands[:, 0].min() == pytest.approx(-27.0 * DEG, abs=1e-6)
    assert commands[:, 1].max() <= 1.0 + 0.9 * 0.8 + 1e-6


def test_below_the_design_speed_there_is_less_lift():
    slow = changed(flight={"V_a_mps": 20.0}, limits={"n_z": [-2.0, 2.0]})
    slow["plant"] = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    most = 1.0 + 0.9 * (2.1 * (20.0 / 25.0) ** 2 - 1.0)  # the Aerosonde has 2.1 at 25 m/s

    commands = conditions.reference_of(ft.scenario_from(slow)).commands(np.arange(0.0, 10.0, 0.02))

    assert commands[:, 1].max() <= most + 1e-6
    least = 1.0 - 0.9 * (2.1 * (20.0 / 25.0) ** 2 + 1.0)  # and -2.1
    limits = conditions.manoeuvre_of(ft.scenario_from(slow))
    assert (limits.lower[1], limits.upper[1]) == pytest.approx((least, most))
    assert (limits.lower[0], limits.upper[0]) == pytest.approx((-27.0 * DEG, 36.0 * DEG))


def test_a_change_begins_with_the_lift_that_its_roll_takes():
    banked = changed(flight={"phi_deg": 20.0}, reference={"gamma_from_deg": 4.0})

    found = conditions.manoeuvre_of(ft.scenario_from(banked))

    lift = math.cos(4.0 * DEG) / math.cos(20.0 * DEG)
    assert found.u_0 == pytest.approx((20.0 * DEG, lift))
    assert found.rate_lower == pytest.approx((-18.0 * DEG, -0.9))


def test_the_reference_may_begin_elsewhere_than_the_flight():
    scenario = ft.scenario_from(changed(reference={"chi_from_deg": 25.0, "gamma_from_deg": 1.0}))

    assert np.array(conditions.reference_of(scenario).initial) / DEG == pytest.approx([25.0, 1.0])


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"reference": {"shape": None}}, "`margin` of .reference. must be given with shape"),
        (
            {"reference": {"chi_deg": [{"shape": "step", "change_deg": 5.0}]}},
            "`chi_deg` of .reference. must be a number",
        ),
        ({"limits": {"phi_rate_dps": None}}, "`phi_rate_dps`"),
        ({"flight": {"phi_deg": 37.0}}, "`phi`.*begin"),
        ({"flight": {"n_z": 1.75}, "limits": {"n_z": [0.2, 1.8]}}, "`n_z`.*begin"),
        ({"limits": {"n_z": [1.2, 1.8]}}, "`n_z` must hold that of steady flight"),
        ({"limits": {"phi_deg": [0.0, 40.0]}}, "`phi`.*to the left.*got 0 deg"),
        ({"limits": {"phi_deg": [-4.5e-5, 40.0]}}, "`phi`.*to the left.*got 4.05e-05 deg"),
        ({"limits": {"phi_rate_dps": 1e-6}}, "within the limits in 200 s, got none"),
        (
            {"plant": [{"kind": "point_mass_lag", "roll_lag_rad_s": 0.05, "n_z_lag_rad_s": 5.0}]},
            "lag of the first plant must settle within 200 s .* got 240 s",
        ),
    ],
)
def test_what_cannot_be_is_one_line_and_takes_no_time(tables, message):
    began = time.process_time()
    with pytest.raises((ft.ScenarioError, ft.InputError), match=message) as raised:
        check_scenario(ft.scenario_from(changed(**tables)), "file.toml")

    assert "\n" not in str(raised.value)
    assert time.process_time() - began < 3.0  # without bounds: minutes


@pytest.mark.soak
def test_a_fast_controller_does_not_make_the_plan_slow(found):
    manoeuvre, began = replace(PAPER, dt=0.001), time.process_time()

    duration = feasible.feasible_reference(manoeuvre).duration

    assert duration == pytest.approx(found.duration, abs=0.01)
    assert time.process_time() - began < 4.0


def test_samples_are_held_or_joined_by_lines_and_nothing_changes_after_the_last():
    planned = np.array([[0.1, 1.0], [0.2, 1.1], [0.0, 0.9], [9.0, 9.0]])
    reference = feasible.FeasibleReference(
        duration=1.0, dt=0.5, chi=np.array([0.0, 0.1, 0.3]), gamma=np.array([0.2, 0.1, 0.1]),
        planned=planned[:3], g=9.81,
    )  # fmt: skip
    t = np.array([0.0, 0.25, 0.5 - 1e-9, 0.5, 0.75, 1.0, 1.5, 9.0])

    chi, gamma = reference.sampled(t)
    assert chi == pytest.approx([0.0, 0.05, 0.1, 0.1, 0.2, 0.3, 0.3, 0.3])
    assert gamma == pytest.approx([0.2, 0.15, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1])
    chi_dot, gamma_dot = reference.rates(t)
    assert chi_dot == pytest.approx([0.2, 0.2, 0.4, 0.4, 0.4, 0.0, 0.0, 0.0])
    assert gamma_dot == pytest.approx([-0.2, -0.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rows = [0, 0, 1, 1, 1, 2, 2, 2]  # rounding takes none back to the sample before
    assert reference.commands(t).tolist() == planned[rows].tolist()
    assert reference.initial == (0.0, 0.2)


@pytest.mark.parametrize(
    ("start", "end", "change"),
    [((3.0, 0.1), (-3.0, 0.3), (math.tau - 6.0, 0.2)), ((0.5, 0.3), (0.2, -0.1), (-0.3, -0.4))],
)
def test_a_change_is_the_shorter_way_round(start, end, change):
    assert replace(PAPER, start=start, end=end).change == pytest.approx(change)
    assert replace(PAPER, end=end).u_end == pytest.approx((0.0, math.cos(end[1])))


@pytest.mark.parametrize(
    ("lag", "rest"),
    [
        ({"order": 1, "natural_frequency": 4.0, "damping": 0.5, "delay": 0.1}, 0.1 + 12.0 / 4.0),
        ({"order": 2, "natural_frequency": 4.0, "damping": 0.5}, 12.0 / 2.0),
        ({"order": 2, "natural_frequency": 4.0, "damping": 2.0, "lag": 9.0}, 12.0 / 4.0),
        ({"order": 3, "natural_frequency": 4.0, "damping": 0.5, "lag": 0.3}, 12.0 * (0.5 + 0.3)),
    ],
)
def test_a_lag_rests_after_twelve_time_constants_of_its_slowest_poles(lag, rest):
    assert feasible._settling(ft.loop.InnerLag(**lag)) == pytest.approx(rest)


GENTLE = replace(PAPER, start=(1.0, 0.2), end=(0.0, 0.1), u_0=(0.0, math.cos(0.2)))


def drawn_plans(count=3):
    """Plans near the first one."""
    rng, plan = np.random.default_rng(4), feasible._first_plan(GENTLE)
    return plan * rng.uniform(0.9, 1.1, (count, len(plan)))


def at_knots(x, manoeuvre=GENTLE):
    """Roll and load factor of a plan at its knots."""
    phi, n_z = x[: feasible.KNOTS - 1], x[feasible.KNOTS - 1 : -1]
    ends = zip(manoeuvre.u_0, manoeuvre.u_end, strict=True)
    return [[first, *inner, last] for (first, last), inner in zip(ends, (phi, n_z), strict=True)]


# Error of 64 steps of the classical Runge-Kutta method in a change of some 8 s, rad.
INTEGRATION = 1e-6


def test_a_plan_misses_the_end_by_the_flight_of_the_exact_point_mass():
    plans = drawn_plans()

    missed = feasible._missed(GENTLE, plans)

    for x, found in zip(plans, missed, strict=True):
        knots, (phi, n_z) = np.linspace(0.0, x[-1], feasible.KNOTS + 1), at_knots(x)

        def rates(t, y, knots=knots, phi=phi, n_z=n_z):
            bank, lift = np.interp(t, knots, phi), np.interp(t, knots, n_z)
            turn = lift * math.sin(bank) / math.cos(y[1])
            return 9.81 / 25.0 * np.array([turn, lift * math.cos(bank) - math.cos(y[1])])

        y = np.array(GENTLE.start)
        for low, high in pairwise(knots):  # between kinks
            y = solve_ivp(rates, (low, high), y, rtol=1e-9, atol=1e-10).y[:, -1]
        assert found == pytest.approx(y - np.array(GENTLE.end), abs=INTEGRATION)


def test_the_rows_of_the_rate_limits_are_those_of_the_changes_between_knots():
    rows, bounds = feasible._rate_rows(replace(GENTLE, rate_lower=(-0.3, -0.7)))

    for x in drawn_plans():
        steps, excess = np.diff(at_knots(x)), rows @ x - bounds
        most = x[-1] / feasible.KNOTS * np.array([[0.3, 0.7], GENTLE.rate_upper])
        expected = [
            sign * steps[i] - most[side, i] for i in range(2) for side, sign in enumerate((-1, 1))
        ]
        assert excess == pytest.approx(np.concatenate(expected))


@pytest.mark.parametrize("feed_forward", [True, False])
def test_samples_in_compiled_code_follow_a_plan_as_the_plain_loop_does(
    found, monkeypatch, feed_forward
):
    """And tell their progress once a second."""
    pytest.importorskip("numba")
    tables, told = [], []
    for samples in (math.inf, 0):
        monkeypatch.setattr(loop, "COMPILED_FROM", samples)
        law = ft.loop.MimoPI(ft.PAPER_GAINS, dt=PAPER.dt, feed_forward=feed_forward)
        start = ft.loop.FlightCondition(V_a=25.0, chi=PAPER.start[0], gamma=PAPER.start[1])
        told.append([])
        flown, stop = loop.simulate(
            ft.loop.PointMassPlant(LAGS),
            law,
            found,
            condition=start,
            duration=4.0,
            progress=told[-1].append,
        )
        assert stop is None
        tables.append(flown)

    pd.testing.assert_frame_equal(*tables, check_exact=True)
    assert told[0] == told[1]
    assert np.diff(told[0]) == pytest.approx([1.0] * (len(told[0]) - 1))
    assert len(told[0]) == 5
