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
@pytest.mark.parametrize(
    "lag",
    [
        ft.loop.InnerLag(order=1, natural_frequency=6.0, delay=0.07),
        ft.loop.InnerLag(order=2, natural_frequency=9.0, damping=0.5, delay=0.033),
    ],
    ids=["first order", "second order"],
)
def test_the_lag_that_made_the_data_is_found(lag):
    commanded = commands()

    found, share = fitted_lag(T, commanded, lag_response(lag, DT, commanded, commanded[0]))

    assert found.order == lag.order
    assert found.natural_frequency == pytest.approx(lag.natural_frequency, rel=RECOVERED)
    assert found.delay == pytest.approx(lag.delay, rel=RECOVERED)
    if lag.order == 2:
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


def test_noise_is_not_told_by_a_lag():
    lag, commanded = ft.loop.InnerLag(order=1, natural_frequency=6.0), commands()
    clean = lag_response(lag, DT, commanded, commanded[0])
    noise = np.random.default_rng(3).normal(scale=0.5 * np.std(clean), size=len(T))

    _, share = fitted_lag(T, commanded, clean + noise - noise[0], lag=lag)

    told = 100.0 * (1.0 - np.mean((noise - noise[0]) ** 2) / np.var(clean + noise))
    assert share == pytest.approx(told, abs=5.0)


def test_a_channel_that_was_not_commanded_shows_no_lag():
    still = np.ones(len(T))

    lag, share = fitted_lag(T, still, still)

    assert math.isnan(share)
    assert (lag.order, lag.natural_frequency) == (1, 10.0)  # which nothing uses
    assert fitted_lag(T, still, still, lag=ROLL)[0] is ROLL
    assert math.isnan(fitted_lag(T, still, still, lag=lag)[1])


ROLL = ft.loop.InnerLag(order=2, natural_frequency=7.0, damping=0.6, delay=0.02)
LIFT = ft.loop.InnerLag(order=1, natural_frequency=11.0, delay=0.05)
# Answers of the load factor to roll commands, and of roll to those of the load factor.
CROSS = 0.1, -0.05
# Every third multiple of the period for each channel, beside those of the other.
EACH = np.arange(6, 60, 6), np.arange(9, 63, 6)


def spectrum_of(lines, seed):
    """A periodic signal with these lines, of random phases."""
    found = np.zeros(fit.SAMPLES // 2 + 1, dtype=complex)
    found[lines] = np.exp(2j * np.pi * np.random.default_rng(seed).random(len(lines)))
    return found


@pytest.mark.parametrize("also", [0.0, 0.2])
def test_responses_of_channels_are_their_own_and_what_is_left_of_the_other(also):
    """Commands are held for a sample, and those of a channel may have lines of the other too."""
    first, second = (spectrum_of(lines, seed) for seed, lines in enumerate(EACH))
    second = second + also * first
    omega = 2.0 * np.pi * np.arange(len(first)) / fit.PERIOD
    s = 1j * np.maximum(omega, 1e-9)
    held = (1.0 - np.exp(-s * fit.DT)) / (s * fit.DT)
    answers = [
        held * (ROLL.response(omega) * first + CROSS[1] * second),
        held * (LIFT.response(omega) * second + CROSS[0] * first),
    ]
    signals = (
        np.fft.irfft(np.column_stack(x), fit.SAMPLES, axis=0) for x in ((first, second), answers)
    )

    roll, lift = fit.frequency_responses(tuple(signals), EACH)

    at_roll, at_lift = omega[EACH[0]], omega[EACH[1]]
    assert roll.omega == pytest.approx(at_roll)
    assert roll.own == pytest.approx(ROLL.response(at_roll) + also * CROSS[1], abs=1e-9)
    assert lift.own == pytest.approx(LIFT.response(at_lift), abs=1e-9)
    # what a channel answers to lines of its own command is interpolated between its lines
    assert roll.other[1:] == pytest.approx(np.full(len(at_roll) - 1, CROSS[0]), abs=2e-3)
    assert lift.other == pytest.approx(np.full(len(at_lift), CROSS[1]), abs=1e-9)


def test_one_channel_alone_has_no_other():
    first = spectrum_of(EACH[0], 0)[:, None]
    signal = np.fft.irfft(first, fit.SAMPLES, axis=0)

    (only,) = fit.frequency_responses((signal, 0.5 * signal), EACH[:1])

    assert only.other is None
    assert np.abs(only.own) == pytest.approx(0.5, rel=0.1)


def test_orders_of_lags_are_ranked_by_bayes_information_criterion():
    """Schwarz: N log(rss / N) + k log N, of 2 numbers a line and one parameter more for a delay."""
    omega = np.geomspace(0.5, 30.0, 25)
    noise = np.random.default_rng(1).normal(scale=0.01, size=(2, 25))
    response = fit.FrequencyResponse(
        omega=omega, own=ROLL.response(omega) + noise[0] + 1j * noise[1], other=None
    )

    found = fit.candidates(response)

    assert found[0].lag.order == 2
    assert found[0].lag.natural_frequency == pytest.approx(ROLL.natural_frequency, rel=0.02)
    assert sorted(lag.lag.order for lag in found) == [1, 2, 3]
    assert [lag.bic for lag in found] == sorted(lag.bic for lag in found)
    for lag in found:
        gap = np.abs(lag.lag.response(omega) - response.own)
        assert lag.residual == pytest.approx(math.sqrt(np.mean(gap**2)), rel=1e-6)
        bic = 50.0 * math.log(np.sum(gap**2) / 50.0) + (lag.lag.order + 1) * math.log(50.0)
        assert lag.bic == pytest.approx(bic, rel=1e-6)


def limits(upper=(0.8, 2.5), rates=(1.2, 4.0)):
    """Roll from -0.6 and load factor from -1, so that roll has 0.6 and 1.5 of room about level."""
    return ft.loop.Limits(
        lower=[-0.6, -1.0], upper=[*upper], rate_lower=[-2.0, -3.0], rate_upper=[*rates]
    )


def test_multisines_are_as_large_as_the_limits_allow_on_lines_of_their_own():
    """40 % of the room and 80 % of the slower rate: 0.24 and 0.6, 0.96 and 2.4 per second."""
    changes, lines = fit.multisines(limits(), seed=3)

    t = np.arange(2000) * 0.01
    assert changes.shape == (2000, 2)
    for signal, line, peak, rate in zip(changes.T, lines, (0.24, 0.6), (0.96, 2.4), strict=True):
        # from one sample to the next, the last one to the first
        used = max(
            np.abs(signal).max() / peak,
            np.abs(np.diff(signal, append=signal[0])).max() / 0.01 / rate,
        )
        assert used == pytest.approx(1.0)
        sizes = np.abs(np.fft.rfft(signal)) / (len(t) / 2)
        assert sizes[line] * np.sqrt(line) == pytest.approx(
            np.full(len(line), sizes[line[0]] * math.sqrt(line[0]))
        )
        assert np.delete(sizes, line).max() < 1e-12
    together = np.sort(np.concatenate(lines))
    # 0.3 to 20 rad/s are 1 to 64 periods in 20 s, interleaved
    assert (together[0], together[-1], len(together)) == (1, 64, len({*together.tolist()}))
    assert [x in lines[0] for x in together] == [i % 2 == 0 for i in range(len(together))]
    grid = np.geomspace(0.3, 20.0, 30) * 20.0 / math.tau
    assert np.abs(grid[:, None] - together).min(axis=1).max() <= 0.5
    assert not np.array_equal(changes, fit.multisines(limits(), seed=4)[0])


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


def test_the_manoeuvre_for_validation_is_3_2_1_1_steps_of_each_channel():
    """Units of 0.9 and 0.8 s from 1 and 2.3 s on, 80 % of the room as fast as the rates allow."""
    found = fit.check_manoeuvre(limits(rates=(1e3, 1e3)))

    t = np.arange(1200) * 0.01
    for signal, start, unit, size, rate in zip(
        found.T, (1.0, 2.3), (0.9, 0.8), (0.24, 0.6), (0.8 * 2.0, 0.8 * 3.0), strict=True
    ):
        units = (t - start) / unit
        levels = np.select(
            [units < 0, units < 3, units < 5, units < 6, units < 7], [0, 1, -1, 1, -1], 0
        )
        assert np.abs(np.diff(signal)).max() == pytest.approx(rate * 0.01)
        ahead = np.abs(np.diff(levels, prepend=0)).nonzero()[0]
        # half a second after each change it is reached
        reached = np.ones(len(t), dtype=bool)
        for k in ahead:
            reached[k : k + 50] = False
        assert signal[reached] == pytest.approx(0.8 * size * levels[reached], abs=1e-12)


def test_a_command_is_ramped_up_and_down_at_its_rate():
    found = fit.ramped(np.array([0.0, 0.03, 0.03, 0.03, -1.0, -1.0, 0.0]), 2.0)

    assert found == pytest.approx([0.0, 0.02, 0.03, 0.03, 0.01, -0.01, 0.0])


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


@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_lag_is_that_of_its_parameters(order):
    shape = {"damping": 0.4} if order > 1 else {}
    shape |= {"lag": 0.3} if order > 2 else {}
    lag = ft.loop.InnerLag(order=order, natural_frequency=6.0, delay=0.1, **shape)

    found = fit.parameters(lag)

    logs = [math.log(6.0), 0.1, math.log(0.4), math.log(0.3)][: order + 1]
    assert found == pytest.approx(logs)
    again = fit.with_parameters(found, order)
    assert fit.parameters(again) == pytest.approx(logs)
    assert again.order == order
    assert fit.with_parameters(found * [1.0, -1.0, 1.0, 1.0][: order + 1], order).delay == 0.0


@pytest.mark.parametrize(("other", "cross"), [(None, None), ([0.1j, -0.3, 0.2], 0.3)])
def test_the_channel_of_a_file_has_the_chosen_lag_and_the_best_that_is_simpler(other, cross):
    """The channel begins at rest, at 0.3 for a command of 0.5."""
    third = ft.loop.InnerLag(order=3, natural_frequency=6.0, damping=0.4, lag=0.15)
    commanded = 0.5 + commands() - commands()[0]
    channel = fit.ChannelIdentification(
        frequency=fit.FrequencyResponse(np.ones(3), np.ones(3), other and np.array(other)),
        candidates=tuple(fit.LagCandidate(lag, 0.02, 0.0) for lag in (third, ROLL, LIFT)),
        commanded=commanded,
        flown=0.3 + lag_response(third, fit.DT, commanded, 0.5) - 0.5,
    )

    table = channel.table

    assert channel.fit == pytest.approx(channel.flown, abs=1e-12)
    assert (table.lag, table.simpler.lag) == (third, ROLL)
    assert (table.fit_percent, table.residual) == pytest.approx((100.0, 0.02))
    assert table.cross == cross


def test_the_percentage_explained_is_of_the_variance():
    measured = np.array([1.0, 3.0, 1.0, 3.0])

    assert fit.fit_percent(measured, measured) == 100.0
    assert fit.fit_percent(measured, measured + 0.5) == 75.0  # a quarter of a variance of 1
    assert fit.fit_percent(measured, 2.0 * measured) == pytest.approx(100.0 * (1.0 - 5.0))
    assert fit.fit_percent(np.ones(3), np.ones(3)) == -math.inf


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
