"""Gains and limits as values: equal by numbers and names, refused when they cannot be."""

from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft


def test_gains_are_equal_by_numbers_and_names():
    copy = ft.PIGains(K_P=ft.PAPER_GAINS.K_P.copy(), K_I=ft.PAPER_GAINS.K_I.copy())

    assert copy == ft.PAPER_GAINS
    assert hash(copy) == hash(ft.PAPER_GAINS)
    assert {ft.PAPER_GAINS: "paper"}[copy] == "paper"
    assert copy != ft.PAPER_GAINS.K_P.tolist()


@pytest.mark.parametrize("V_a", [18.0, 31.0])
def test_gains_of_one_law_become_those_of_the_other_and_return(V_a):
    """The paper's law turns by g/V times the roll command: chi' = g/V phi about level flight."""
    rates = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=V_a, g=9.81)

    assert rates.inputs == ("chi_dot", "gamma_dot")
    assert rates.K == pytest.approx(ft.PAPER_GAINS.K * 9.81 / V_a, rel=1e-15)
    again = ft.loop.command_gains(rates, V_a=V_a, g=9.81)
    assert again.inputs == ("phi", "n_z")
    assert again.K == pytest.approx(ft.PAPER_GAINS.K, rel=1e-15)
    assert ft.loop.rate_gains(rates, V_a=V_a) is rates


@pytest.mark.parametrize("law", ["paper", "exact"])
@pytest.mark.parametrize("channels", [2, 3])
def test_gains_are_written_and_read_with_law_and_channels(tmp_path, law, channels):
    K = np.arange(1.0, 1.0 + 2 * channels**2).reshape(2, channels, channels)
    fed = {"feedback": [0.3, 0.1]} if law == "exact" else {}
    file = tmp_path / "gains.json"

    gains = ft.PIGains.from_lists(*K.tolist(), law=law, **fed)
    gains.save(file)

    read = ft.load_gains(file)
    assert read == gains
    assert (read.law, read.airspeed) == (law, channels == 3)
    assert read.inputs[:2] == (("phi", "n_z") if law == "paper" else ("chi_dot", "gamma_dot"))
    assert read.errors == ("chi", "gamma", "V")[:channels]
    assert read.feedback == tuple(fed.get("feedback", (0.0, 0.0)))
    assert np.array([read.K_P, read.K_I]) == pytest.approx(K)


@pytest.mark.parametrize("feedback", [(1.0, 0.0), (0.0, 1.0), (-0.1, 0.0), (0.0, -0.1), (0.1,)])
def test_feedback_is_two_numbers_from_0_to_below_1(feedback):
    rates = ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0)
    with pytest.raises(ft.InputError, match="`feedback` must be two numbers from 0 to below 1"):
        replace(rates, feedback=feedback)


def test_gains_differ_by_the_last_bit_of_a_number_and_by_a_name():
    K_I = ft.PAPER_GAINS.K_I.copy()
    K_I[0, 1] = np.nextafter(K_I[0, 1], 1.0)

    assert replace(ft.PAPER_GAINS, K_I=K_I) != ft.PAPER_GAINS
    assert replace(ft.PAPER_GAINS, inputs=("phi", "alpha")) != ft.PAPER_GAINS


def test_a_zero_has_no_sign():
    zero = np.zeros((2, 2))
    plus, minus = (ft.PIGains(K_P=one, K_I=zero) for one in (zero, -zero))

    assert plus == minus
    assert hash(plus) == hash(minus)


ONE = np.ones(2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"upper": -ONE}, r"`lower` must be below `upper`, got \[-1\.0, -1\.0\]"),
        ({"upper": [np.nan, 1.0]}, r"`upper` must not be NaN"),
        ({"rate_lower": 0.5 * ONE}, r"rate ranges must hold zero"),
        ({"rate_upper": -0.5 * ONE}, r"rate ranges must hold zero"),
        ({"rate_upper": [1.0, -2.0]}, r"`rate_lower` must be below `rate_upper`"),
        ({"lower": [-1.0, 1.0]}, r"`lower` must be below `upper`, got \[-1\.0, 1\.0\]"),
        ({"upper": np.ones(3)}, r"must have one length"),
    ],
)
def test_limits_that_cannot_be_are_refused(change, message):
    fields = {"lower": -ONE, "upper": ONE, "rate_lower": -ONE, "rate_upper": ONE}
    with pytest.raises(ft.InputError, match=message):
        ft.loop.Limits(**{**fields, **change})


def test_limits_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        ft.loop.Limits.none(2).lower[0] = 3.0


# Range, and rate down and up, of one command, with a sample of 0.1 s.
STEEP = ft.loop.Limits(lower=[-1.0], upper=[3.0], rate_lower=[-2.0], rate_upper=[5.0])


@pytest.mark.parametrize(
    ("before", "wanted", "command", "limited"),
    [
        (0.0, 0.4, 0.4, 0),
        (0.0, -0.15, -0.15, 0),
        (0.0, 2.0, 0.5, 2),
        (0.0, -2.0, -0.2, 2),
        (2.7, 9.0, 3.0, 1),
        (-0.9, -9.0, -1.0, 1),
        # outside of the range it comes back at the rate
        (4.0, 9.0, 3.8, 1),
        (4.0, 0.0, 3.8, 2),
        (-2.0, -9.0, -1.5, 1),
        (-2.0, 0.0, -1.5, 2),
    ],
)
def test_a_command_keeps_the_range_and_rate_of_its_side(before, wanted, command, limited):
    limiter = ft.loop.CommandLimiter(STEEP, dt=0.1)
    limiter.start([before])

    assert limiter.limit(wanted) == pytest.approx((command,), abs=1e-12)
    assert limiter.limited == [limited]
    assert limiter.excess == pytest.approx((wanted - command,), abs=1e-12)
    limiter.start([0.0])
    assert limiter.limited == [0]
    for wrong in ([], [0.0, 0.0], [np.inf]):
        with pytest.raises(ft.InputError, match="`u` must be 1 finite numbers"):
            limiter.start(wrong)


def test_limits_that_hold_together_are_the_narrower_of_each():
    wide = ft.loop.Limits(lower=-2 * ONE, upper=[1.0, 5.0], rate_lower=-ONE, rate_upper=[9.0, 0.1])
    narrow = ft.loop.Limits(lower=-ONE, upper=2 * ONE, rate_lower=-2 * ONE, rate_upper=ONE)

    both = wide.within(narrow)

    assert both.lower.tolist() == [-1.0, -1.0]
    assert both.upper.tolist() == [1.0, 2.0]
    assert both.rate_lower.tolist() == [-1.0, -1.0]
    assert both.rate_upper.tolist() == [1.0, 0.1]
    assert wide.within(ft.loop.Limits.none(2)).upper.tolist() == wide.upper.tolist()


def test_the_weight_along_the_path_is_a_gain_of_one_g_of_the_papers_law():
    """``V' = g (n_x - sin(gamma))``: its n_x has sin(gamma_ref), the exact law's sin(gamma)."""
    K = np.arange(1.0, 19.0).reshape(2, 3, 3)
    gains = ft.PIGains.from_lists(*K.tolist(), law="paper")

    rates = ft.loop.rate_gains(gains, V_a=20.0, g=9.0)

    weight = np.zeros((3, 3))
    weight[2, 1] = 1.0
    assert rates.inputs == ("chi_dot", "gamma_dot", "V_dot")
    assert rates.K_P == pytest.approx(0.45 * (K[0] + weight))
    assert rates.K_I == pytest.approx(0.45 * K[1])
    assert ft.loop.command_gains(rates, V_a=20.0, g=9.0).K_P == pytest.approx(K[0])
    with pytest.raises(ft.InputError, match="`g` must be positive"):
        ft.loop.rate_gains(gains, V_a=20.0, g=0.0)
