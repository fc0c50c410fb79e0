"""Fitted lags against responses that are known in closed form."""

import math

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim, tf2ss

import flighttune as ft
from flighttune.vehicles.identification import fit
from flighttune.vehicles.identification.fit import fitted_lag, lag_response
from flighttune.vehicles.plants.base import N_X_SIGNALS

DT = 0.02
T = np.arange(600) * DT
RECOVERED = 1e-4
"""Relative difference of a fitted parameter from the one that made the data."""


def commands(seed=2):
    """Steps of random height every 0.7 s."""
    heights = np.random.default_rng(seed).normal(size=20)
    return heights[(T / 0.7).astype(int)]


@pytest.mark.slow
def test_the_lag_that_made_the_data_is_found():
    commanded = commands()
    lag = ft.loop.InnerLag(order=2, natural_frequency=9.0, damping=0.5, delay=0.033)

    found, share = fitted_lag(T, commanded, lag_response(lag, DT, commanded, commanded[0]))

    assert found.order == lag.order
    assert found.natural_frequency == pytest.approx(lag.natural_frequency, rel=RECOVERED)
    assert found.delay == pytest.approx(lag.delay, rel=RECOVERED)
    assert found.damping == pytest.approx(lag.damping, rel=RECOVERED)
    assert share == pytest.approx(100.0, abs=1e-6)


@pytest.mark.parametrize(("order", "delay"), [(1, 0.02), (2, 0.0056), (3, 0.033)])
def test_a_lag_answers_held_commands_as_scipy_has_it(order, delay):
    """Delays are whole steps of 0.2 ms, over which SciPy's answer to held commands is exact."""
    lag = ft.loop.InnerLag(order=order, natural_frequency=6.0, damping=0.4, lag=0.15, delay=delay)
    poles = [1.0, 6.0] if order == 1 else [1.0, 2.0 * 0.4 * 6.0, 36.0]
    over = np.polymul(poles, [0.15, 1.0] if order == 3 else [1.0])
    commanded, fine, start = commands()[:150], 100, 0.7
    late = np.repeat(commanded - start, fine)
    late = np.concatenate([np.zeros(round(delay / DT * fine)), late])[: len(late)]
    system = cont2discrete(tf2ss([poles[-1]], over), DT / fine, "zoh")
    expected = start + dlsim(system, late[:, None])[1][::fine, 0]

    assert lag_response(lag, DT, commanded, start) == pytest.approx(expected, abs=1e-9)


def test_a_channel_that_was_not_commanded_shows_no_lag():
    still = np.ones(len(T))

    lag, share = fitted_lag(T, still, still)

    assert math.isnan(share)
    assert (lag.order, lag.natural_frequency) == (1, 10.0)  # which nothing uses
    assert fitted_lag(T, still, still, lag=ROLL)[0] is ROLL
    assert math.isnan(fitted_lag(T, still, still, lag=lag)[1])


ROLL = ft.loop.InnerLag(order=2, natural_frequency=7.0, damping=0.6, delay=0.02)


def limits(upper=(0.8, 2.5), rates=(1.2, 4.0)):
    """Roll from -0.6 and load factor from -1, so that roll has 0.6 and 1.5 of room about level."""
    return ft.loop.Limits(
        lower=[-0.6, -1.0], upper=[*upper], rate_lower=[-2.0, -3.0], rate_upper=[*rates]
    )


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"upper": (0.8, 1.0)}, r"`limits` must be finite and leave room .* got \[0\.6, 0\.0\]"),
        ({"upper": (0.8, math.inf)}, None),  # the other side ends it
        ({"rates": (0.0, 4.0)}, "`limits on rates` must be finite"),
    ],
)
def test_limits_without_room_about_level_flight_are_refused(bad, message):
    if message is None:
        room, rates = fit.command_room(limits(**bad))
        assert room == pytest.approx([0.4 * 0.6, 0.4 * 2.0])
        assert rates == pytest.approx([0.8 * 1.2, 0.8 * 3.0])
        return
    with pytest.raises(ft.InputError, match=message):
        fit.command_room(limits(**bad))


def test_an_excitation_that_ends_the_flight_is_halved_up_to_three_times():
    flights, changes = [], np.array([[1.0], [8.0], [2.0]])

    def fly(plant, condition, change):
        flights.append(change[0])
        stop = ft.loop.Stop("left_envelope", "too much") if change[0] > bound else None
        return (change[0],), (condition.V_a,), stop

    def respond():
        return fit.respond(ft.loop.PointMassPlant, ft.loop.FlightCondition(V_a=25.0), changes, fly)

    bound = 2.0
    commanded, measured = respond()
    assert commanded.tolist() == [[0.25], [2.0], [0.5]]
    assert measured.tolist() == [[25.0]] * 3
    assert flights == [1.0, 8.0, 0.5, 4.0, 0.25, 2.0, 0.5]
    bound = 0.9
    with pytest.raises(ft.loop.PlantError, match=r"even at 0\.125 of its size: too much"):
        respond()


class Thrusted:
    """A plant that shows what it is told, with a longitudinal load factor of 0.05 at its trim."""

    signals = ("chi", "gamma", "phi", "n_z", *N_X_SIGNALS)

    def __init__(self, least=-0.1, most=0.2, upper=0.15, rate=1.0):
        edges = {"lower": [-0.6, 0.0, -0.3], "upper": [0.6, 2.0, upper]}
        self.limits = ft.loop.Limits(
            **edges, rate_lower=[-2.0, -3.0, -rate], rate_upper=[2.0, 3.0, rate]
        )
        self.seen, self.commands = (0.7, 0.1, 0.3, 1.2, 0.05, least, most), []

    def start(self, condition):
        self.started = condition

    def observe(self):
        return self.seen

    def advance(self, *command):
        self.commands.append(command)
        return "stop"


@pytest.mark.parametrize(
    ("plant", "peak", "rate"),
    [
        # 40 % of the room to the limit, to full throttle and to closed throttle
        (Thrusted(), 0.4 * 0.10, 1.0),
        (Thrusted(most=0.12), 0.4 * 0.07, 1.0),
        (Thrusted(least=0.0), 0.4 * 0.05, 1.0),
        (Thrusted(least=-9.0, most=9.0, upper=9.0), 0.4 * 0.35, 1.0),
        # 2 per second without a limit
        (Thrusted(rate=math.inf), 0.4 * 0.10, 2.0),
        (Thrusted(rate=0.02), 0.4 * 0.10, 0.02),
    ],
)
def test_thrust_changes_within_the_room_that_the_throttle_leaves(plant, peak, rate):
    at = ft.loop.FlightCondition(V_a=25.0)

    changes, (lines,), check = fit.thrust_changes(plant, at, seed=3)

    assert plant.started is at
    (signal,) = changes.T
    fastest = np.abs(np.diff(signal, append=signal[0])).max() / 0.01
    assert max(np.abs(signal).max() / peak, fastest / rate) == pytest.approx(1.0)
    grid = np.geomspace(0.3, 20.0, 15) * 20.0 / math.tau
    assert lines.tolist() == sorted({*np.round(grid).astype(int).tolist()})
    assert check.shape == (1200, 1)
    assert np.abs(np.diff(check[:, 0])).max() / 0.01 == pytest.approx(rate)
    if rate >= 1.0:
        assert np.abs(check).max() == pytest.approx(0.8 * peak)


def test_thrust_without_room_is_no_excitation():
    with pytest.raises(ft.loop.PlantError, match=r"at 25 m/s, got -0\.3 to 0\.05 about"):
        fit.thrust_changes(Thrusted(upper=0.05), ft.loop.FlightCondition(V_a=25.0), seed=3)


def test_changes_are_flown_about_the_commands_that_hold_the_path_and_the_airspeed():
    plant, at = Thrusted(), ft.loop.FlightCondition(V_a=25.0, gamma=0.15)

    turn = fit.fly_turn(plant, at, (0.2, -0.4))
    thrust = fit.fly_thrust(plant, at, (0.03,))

    level = math.cos(0.1) / math.cos(0.3)
    assert turn == ((0.2, pytest.approx(level - 0.4)), (0.3, 1.2), "stop")
    assert thrust == ((pytest.approx(math.sin(0.1) + 0.03),), (0.05,), "stop")
    towards = math.cos(0.15) / math.cos(0.3) + 0.05
    assert plant.commands == [(*turn[0], 0.01), (0.0, pytest.approx(towards), 0.01, *thrust[0])]
