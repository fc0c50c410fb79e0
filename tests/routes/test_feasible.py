"""The fastest change of course within limits: what cannot be is refused before any flight."""

import math
import time

import numpy as np
import pytest
from made_up import scenario_tables
from scipy.integrate import solve_ivp

import flighttune as ft

TABLES = scenario_tables(
    flight={"chi_deg": 30.0, "duration_s": 10.0},
    reference={"shape": "feasible", "gamma_deg": 5.0, "margin": 0.1},
    limits={
        "phi_deg": [-30.0, 40.0], "phi_rate_dps": 20.0, "n_z": [0.0, 1.8], "n_z_rate_per_s": 1.0,
    },
    controller={"feed_forward": True},
    plant=[{"kind": "point_mass"}],
)  # fmt: skip
LAG = {"kind": "point_mass_lag", "roll_lag_rad_s": 0.05, "n_z_lag_rad_s": 5.0}


def changed(**tables):
    return {
        **TABLES,
        **{name: {**TABLES[name], **x} if isinstance(x, dict) else x for name, x in tables.items()},
    }


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"flight": {"phi_deg": 37.0}}, "`phi`.*begin"),
        ({"flight": {"n_z": 1.75}, "limits": {"n_z": [0.2, 1.8]}}, "`n_z`.*begin"),
        ({"limits": {"n_z": [1.2, 1.8]}}, "`n_z` must hold that of steady flight"),
        ({"limits": {"phi_deg": [0.0, 40.0]}}, "`phi`.*to the left.*got 0 deg"),
        ({"limits": {"phi_deg": [-4.5e-5, 40.0]}}, "`phi`.*to the left.*got 4.05e-05 deg"),
        ({"flight": {"chi_deg": -30.0}, "limits": {"phi_deg": [-30.0, 4.5e-5]}},
         "`phi`.*to the right, so that the turn of 30 deg .*got 4.05e-05 deg"),
        ({"limits": {"phi_rate_dps": 1e-6}}, "within the limits in 200 s, got none"),
        ({"plant": [LAG]}, "lag of the first plant must settle within 200 s .* got 240 s"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_one_line_and_takes_no_time(tables, message):
    began = time.process_time()
    with pytest.raises(ft.InputError, match=message) as raised:
        ft.fly(ft.scenario_from(changed(**tables)), gains=["paper"])

    assert "\n" not in str(raised.value)
    assert time.process_time() - began < 3.0  # without bounds: minutes


def searched(**tables):
    """The reference that the laws of a flight are given."""
    seen = []

    class Looks:
        dt, signals = 0.02, {}

        def __init__(self, setup):
            seen.append(setup.reference)

        def start(self, condition):
            pass

        def step(self, m, reference, t):
            return 0.0, math.cos(m.gamma)

    ft.fly(ft.scenario_from(changed(**tables)), laws={"looks": Looks})
    return seen[0]


SHORT = {"duration_s": 0.1}
LAGS = {"kind": "point_mass_lag", "roll_lag_rad_s": 5.0, "n_z_lag_rad_s": 8.0}


@pytest.mark.parametrize(
    ("flight", "plant", "end"),
    [
        ({}, None, (0.0, 5.0)),
        ({"chi_deg": -160.0, "gamma_deg": 4.0}, None, (150.0, -3.0)),  # the shorter way round
        ({"chi_deg": 0.0, "phi_deg": 10.0, "n_z": 1.1}, None, (60.0, 0.0)),
        ({}, LAGS, (0.0, 5.0)),
    ],
)
def test_a_searched_reference_is_a_flight_of_the_point_mass_within_its_limits(flight, plant, end):
    """The point mass by SciPy, under the planned commands; a margin of a tenth of each limit."""
    asked = {"chi_deg": end[0], "gamma_deg": end[1]}
    found = searched(
        flight=SHORT | flight, reference=asked, **({"plant": [plant]} if plant else {})
    )
    planned, dt, lags = found.planned, found.dt, (5.0, 8.0) if plant else ()

    chi, gamma = (
        math.radians(flight.get(key, x)) for key, x in (("chi_deg", 30), ("gamma_deg", 0))
    )
    begun = [
        chi,
        gamma,
        math.radians(flight.get("phi_deg", 0.0)),
        flight.get("n_z", math.cos(gamma)),
    ]

    def rates(t, x):
        phi, n_z = command = planned[min(int(t / dt + 1e-9), len(planned) - 1)]
        slower = [w * (c - y) for w, c, y in zip(lags, command, x[2:], strict=True)] if lags else ()
        phi, n_z = x[2:] if lags else (phi, n_z)
        per_g = 9.81 / 25.0
        turn = per_g * n_z * math.sin(phi) / math.cos(x[1])
        return [turn, per_g * (n_z * math.cos(phi) - math.cos(x[1])), *(slower or (0.0, 0.0))]

    at = dt * np.arange(len(found.chi))
    flown = solve_ivp(rates, (0.0, at[-1]), begun, t_eval=at, max_step=0.5 * dt, rtol=1e-8).y
    assert found.chi == pytest.approx(flown[0], abs=2e-3)
    assert found.gamma == pytest.approx(flown[1], abs=2e-3)
    # it ends there, at rest, after a time in which the commands have become steady
    turned = math.remainder(found.chi[-1] - math.radians(end[0]), math.tau)
    assert [turned, found.gamma[-1] - math.radians(end[1])] == pytest.approx([0.0, 0.0], abs=1e-4)
    assert found.initial == pytest.approx((chi, gamma))
    after = at > found.duration
    steady = [0.0, math.cos(math.radians(end[1]))]
    assert planned[after] == pytest.approx(np.tile(steady, (after.sum(), 1)), abs=1e-9)
    assert 0.0 <= at[-1] - found.duration - 12.0 * (1.0 / 5.0 if lags else 0.0) <= dt
    # by the middles of samples: commands and their rates, of which some are at their limits
    low, high = (math.radians(-27.0), 0.1), (math.radians(36.0), 1.72)
    assert np.clip(planned, low, high) == pytest.approx(planned, abs=1e-9)
    fastest = np.abs(np.diff(planned, axis=0)).max(axis=0) / dt
    assert fastest[0] == pytest.approx(math.radians(18.0), rel=0.02)
    assert fastest[1] <= 0.9 * (1.0 + 0.02)


def test_a_reference_is_read_between_its_samples_and_held_after_them():
    found = searched(flight=SHORT)
    dt, last = found.dt, len(found.chi) - 1
    t = np.array([0.0, 2.5 * dt, 7.0 * dt, 1e3])

    chi, gamma = found.sampled(t)
    for values, samples in ((chi, found.chi), (gamma, found.gamma)):
        expected = [samples[0], 0.5 * (samples[2] + samples[3]), samples[7], samples[-1]]
        assert values == pytest.approx(expected)
    for rate, samples in zip(found.rates(t), (found.chi, found.gamma), strict=True):
        expected = [(samples[i + 1] - samples[i]) / dt for i in (0, 2, 7)]
        assert rate == pytest.approx([*expected, 0.0])
    assert found.rates(np.array([(last - 0.5) * dt]))[0] == pytest.approx(
        (found.chi[-1] - found.chi[-2]) / dt
    )
    assert found.commands(t) == pytest.approx(found.planned[[0, 2, 7, -1]])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turn_takes_the_time_of_a_trapezium_of_roll_or_a_little_less(side):
    """Level flight at 18 deg/s up to 36 deg and back; lift for it may dip a little."""
    most, rate = 0.9 * math.radians(40.0), 0.9 * math.radians(20.0)
    n_z = 1.0 + (1.0 / math.cos(most) - 1.0) / 0.9
    found = searched(
        flight=SHORT | {"chi_deg": 0.0},
        reference={"chi_deg": side * 60.0, "gamma_deg": 0.0},
        limits={"phi_deg": [-40.0, 40.0], "n_z": [0.9, n_z]},
    )

    rolling = -2.0 * math.log(math.cos(most)) / rate * 9.81 / 25.0  # both ways
    held = (math.radians(60.0) - rolling) / (9.81 / 25.0 * math.tan(most))
    level = 2.0 * most / rate + held
    assert 0.93 * level < found.duration < 1.005 * level
    assert side * found.planned[:, 0].sum() > 0.0
    assert np.abs(found.planned[:, 0]).max() == pytest.approx(most, rel=1e-3)


def test_the_margin_is_taken_off_every_limit():
    """A flight of the law follows it, and rolls to nine tenths of the limit."""
    scenario = ft.scenario_from(changed(flight={"duration_s": 6.0}))

    signals = ft.fly(scenario, gains=["paper"]).runs[0].signals

    assert signals[["chi_err", "gamma_err"]].abs().max().max() < 0.02
    assert signals["phi"].min() == pytest.approx(-0.4712, abs=0.01)  # 0.9 of 30 deg
