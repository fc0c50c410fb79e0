"""Roll and load factor fed back by the exact law: linear loop, limits, files of its gains."""

import json
import math

import numpy as np
import pytest
from scipy.optimize import brentq

import flighttune as ft
from flighttune.control.inner_loop import with_inner_loop
from flighttune.control.limits import MAGNITUDE_LIMITED
from flighttune.control.margins import channel_margins
from flighttune.files.table import tables_of

ROUNDING, SAME_MARGIN = 1e-9, 1e-6
DT = 0.02
K_P, K_I, FED = (1.5, 1.3), (0.8, 0.7), (0.5, 0.3)


def rates(feedback=FED):
    return ft.PIGains.from_lists(np.diag(K_P), np.diag(K_I), law="exact", feedback=feedback)


MODEL, _ = ft.loop.ExactLaw(rates(), dt=DT).linear()


def lagged(*bandwidths):
    lags = [ft.loop.InnerLag(order=1, natural_frequency=w) for w in bandwidths]
    return with_inner_loop(MODEL, lags)


def test_poles_are_the_roots_of_the_characteristic_polynomial_written_by_hand():
    bandwidths = 4.0, 6.0
    # 1 + w/(s + w) (k + (1 + k) (K_P s + K_I) / s^2) = 0 in each channel
    by_hand = [
        np.roots([1.0, w * (1.0 + k), w * (1.0 + k) * p, w * (1.0 + k) * i])
        for w, k, p, i in zip(bandwidths, FED, K_P, K_I, strict=True)
    ]

    poles = np.sort_complex(np.linalg.eigvals(ft.loop.closed_loop(lagged(*bandwidths), rates())))

    assert poles == pytest.approx(np.sort_complex(np.concatenate(by_hand)), abs=ROUNDING)


def test_a_loop_without_lag_is_the_same_with_feedback():
    plain, fed = (ft.loop.closed_loop(MODEL, rates(k)) for k in ((0.0, 0.0), FED))

    assert np.array_equal(plain, fed)


@pytest.mark.parametrize("i", [0, 1])
def test_margins_are_those_of_the_frequency_response_at_the_commands(i):
    lag = ft.loop.InnerLag(order=3, natural_frequency=7.0, damping=0.6, lag=0.05)
    p, integral, k = K_P[i], K_I[i], FED[i]

    def response(omega):
        s = 1j * omega
        G = 49.0 / (s * s + 8.4 * s + 49.0) / (1.0 + 0.05 * s)
        return G * (k + (1.0 + k) * (p + integral / s) / s)

    margins = channel_margins(with_inner_loop(MODEL, [lag, lag]), rates())[i]

    crossover = brentq(lambda w: abs(response(w)) - 1.0, 0.5, 6.0, xtol=1e-13)
    phase = math.pi + np.angle(response(crossover))
    turned = brentq(lambda w: response(w).imag, 5.0, 60.0, xtol=1e-13)
    assert margins.phase_margin == pytest.approx(phase, rel=SAME_MARGIN)
    assert margins.gain_increase == pytest.approx(1.0 / abs(response(turned)), rel=SAME_MARGIN)


def test_a_certificate_has_the_feedback_and_no_other_passes_for_it(tmp_path):
    model, file = lagged(4.0, 6.0), tmp_path / "fed.json"
    fed, plain = (ft.certify(model, rates(k)).certificate for k in (FED, (0.0, 0.0)))
    fed.save(file)

    kept = ft.load(file)

    assert kept.gains == rates()
    assert kept.verify().valid
    true_rate = -np.linalg.eigvals(ft.loop.closed_loop(model, rates())).real.max()
    assert fed.exact_rates[0].rate == pytest.approx(true_rate, rel=1e-2)
    assert set(tables_of(plain)["gains"]) == {"K_P", "K_I", "inputs", "errors"}
    tables = json.loads(file.read_text())
    tables["gains"]["feedback"] = [0.0, 0.0]
    file.write_text(json.dumps(tables))
    assert not ft.load(file).verify().valid


def held(roll, samples, *, chi=0.12, upper=(0.8, 2.0), **settings):
    """The law while roll and load factor stay at `roll` (rad) and 1, whatever it commands."""
    upper, rate = np.array(upper), np.array([0.5, 1.0])
    limits = ft.loop.Limits(lower=-upper, upper=upper, rate_lower=-rate, rate_upper=rate)
    law = ft.loop.ExactLaw(rates(), limits, dt=DT, **settings)
    law.start(ft.loop.FlightCondition(V_a=25.0))
    seen = ft.loop.Measured(0.0, 0.0, 25.0, roll, 1.0, 1000.0, (0.0, 0.0, 0.0), None)
    commands, integrals = [], []
    for k in range(samples):
        commands.append(law.step(seen, ft.loop.ReferenceSample(chi, 0.0), k * DT)[0])
        integrals.append(law.state.integral[0])
    return law, np.array(commands), np.array(integrals)


@pytest.mark.parametrize("anti_windup", ["conditional", "back_calculation"])
def test_the_feedback_winds_nothing_up_at_a_limit(anti_windup):
    """Roll stands in the way: with the feedback its command is at the limit, without it is not."""
    law, commands, integrals = held(-1.2, 600, anti_windup=anti_windup)

    assert np.abs(np.diff(commands)).max() <= 0.5 * DT + ROUNDING
    assert commands.max() == 0.8
    assert law.state.limited[0] == MAGNITUDE_LIMITED
    # With back-calculation it ends where the error and what the limit takes are in balance.
    assert integrals.max() < (0.05 if anti_windup == "conditional" else 0.1)
    if anti_windup == "conditional":
        assert np.ptp(integrals[300:]) == 0.0


def test_a_command_without_a_limit_is_the_expected_one_and_what_roll_lacks():
    law, commands, _ = held(0.1, 100)
    expected = law.state.expected[0]

    assert commands[-1] == pytest.approx(expected + 0.5 * (expected - 0.1), abs=ROUNDING)


def test_a_turn_that_the_roll_rate_could_not_take_back_is_not_asked_for():
    """At half of 0.5 rad/s of roll a turn of 60 deg begins at sqrt(0.5 g/V e) rad/s."""
    law, *_ = held(0.0, 1, chi=1.0, upper=(1.5, 9.0))

    turn = math.sqrt(2.0 * 0.5 * 9.81 / 25.0 * 0.5 * 1.0)
    lacking = 0.5 * 0.5 * DT  # of the roll expected, a sample at its rate limit
    assert law.state.u_unsat[0] == pytest.approx(math.atan(25.0 * turn / 9.81) + lacking, abs=1e-9)
    assert law.state.integral[0] == 0.0


@pytest.mark.parametrize("feedback", [(1.0, 0.0), (-0.1, 0.0), (math.nan, 0.0), (0.5,)])
def test_a_feedback_outside_its_range_is_refused(feedback):
    with pytest.raises(ft.InputError, match="`feedback` must be two numbers"):
        rates(feedback)


def test_gains_of_the_papers_law_have_none():
    with pytest.raises(ft.InputError, match="`feedback` must be 0 but"):
        ft.PIGains(K_P=np.eye(2), K_I=np.eye(2), feedback=FED)
    with pytest.raises(ft.InputError, match="`gains` must be flown by"):
        ft.loop.command_gains(rates(), V_a=25.0)


def test_a_file_of_gains_keeps_the_feedback(tmp_path):
    file = tmp_path / "fed.json"
    rates().save(file)

    assert ft.load_gains(file) == rates()
    assert "feedback" not in rates((0.0, 0.0)).as_lists()
    file.write_text(json.dumps({**rates().as_lists(), "feedback": [1.5, 0.0]}))
    with pytest.raises(ft.ScenarioError, match=r"fed\.json: `feedback"):
        ft.load_gains(file)
