"""Rates over boxes of lags and delays: against dense grids and flights, and not to be forged."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from forging import Opened

import flighttune as ft
from flighttune.control.certificates import lag_box

# Relative distance between a proven rate and the least over the points of a grid.
ACCURACY = 2e-6

# Relative difference of seconds in a file of six digits.
OF_FILE = 1e-5

# Rate of any gains with which the box of the twelve conditions was counted by hand, and about it:
# whole lags of 0.13 to 0.22 s, without the delay apart.
COUNTED, ABOUT = 0.9, 0.1

IDENTIFIED = {"tuning.model": "identified"}

# The gains of the largest R_K of the exact law on the identified Aerosonde, as tune prints them.
GAINS = ft.PIGains(
    K_P=np.diag([1.526, 1.429]), K_I=np.diag([0.861, 0.764]), inputs=("chi_dot", "gamma_dot")
)


def loop(gains, lag, delay, a, b):
    """States e, xi, y and, with a delay, what is delayed, as the equations read."""
    K_P, K_I, k = gains
    u = np.array([(1.0 + k) * K_P, (1.0 + k) * K_I, -k, 0.0])
    e, _, y, z = np.eye(4)
    if not delay:
        return np.array([a * e - b * y, e, (u - y) / lag])[:, :3]
    return np.array([a * e - b * y, e, (2.0 * z - u - y) / lag, 2.0 * (u - z) / delay])


@cache
def behind_lags():
    return ft.certify("mission", GAINS, lag=(0.2, 0.6)).certificate


@cache
def over_conditions():
    return ft.certify("mission", GAINS, envelope=True, changes=IDENTIFIED).certificate


DECOUPLED = ft.PIGains(K_P=np.diag([2.2, 2.5]), K_I=1.2 * np.eye(2))
LATE = {"tuning.sample_delay": True, "controller.rate_hz": 10.0}
CLIMB = 9.81 / 25.0 * np.sin(np.pi / 12.0)  # a of the paper's law in its climb, 1/s


@pytest.mark.soak
@pytest.mark.parametrize(
    ("scenario", "gains", "changes", "half", "a", "b"),
    [
        ("mission", replace(GAINS, feedback=(0.4, 0.3)), LATE, 0.025, (0.0, 0.0), 1.0),
        ("paper", DECOUPLED, LATE, 0.025, (0.0, CLIMB), 9.81 / 25.0),
    ],
)
def test_the_box_of_an_assumed_lag_has_the_least_rate_of_its_lags(
    scenario, gains, changes, half, a, b
):
    """By the characteristic polynomial of a channel with its lag and the section of its delay."""
    made = ft.certify(scenario, gains, lag=(0.2, 0.5), changes=changes)
    s = np.poly1d([1.0, 0.0])

    for i, box in enumerate(made.certificate.boxes):
        K_P, K_I, k = map(float, (gains.K_P[i, i], gains.K_I[i, i], gains.feedback[i]))
        ahead, behind = np.poly1d([-half, 1.0]), np.poly1d([half, 1.0])
        inner = [np.poly1d([lag, 1.0]) * behind + k * ahead for lag in np.linspace(0.2, 0.5, 301)]
        outer = b * ahead * (1.0 + k) * np.poly1d([K_P, K_I])
        least = min(-((s - a[i]) * s * x + outer).roots.real.max() for x in inner)
        assert box.rate == pytest.approx(least, rel=ACCURACY)
        assert 0.5 * box.rate < box.norm_rate <= box.rate
        assert (box.lag, box.delay) == ((0.2, 0.5), (2.0 * half, 2.0 * half))
        assert (*box.a, *box.b) == pytest.approx((a[i], a[i], b, b))
        # the norm decays at both ends of the lag, in the units in which b is one
        for lag in box.lag:
            A = loop((b * K_P, b * K_I, k), lag, 2.0 * half, a[i], 1.0)
            flow = box.Q @ A + A.T @ box.Q + 2.0 * box.norm_rate * box.Q
            assert np.linalg.eigvalsh(flow)[-1] < 0.0 < np.linalg.eigvalsh(box.Q)[0]


@pytest.mark.slow
def test_the_box_of_an_identified_aircraft_has_the_lags_and_delays_of_all_conditions():
    model, certificate = ft.loop.load_identified("aerosonde"), over_conditions()

    for box, name in zip(certificate.boxes, ("phi", "n_z"), strict=True):
        lags = [condition.channels[name].lag for condition in model.conditions]
        # Of a lag of third order: 2 z / w and the time constant of its real pole.
        seconds = [2.0 * x.damping / x.natural_frequency + x.lag for x in lags]
        delays = [x.delay + 0.01 for x in lags]  # and half a sample at 50 Hz
        assert box.lag == pytest.approx((min(seconds), max(seconds)), rel=OF_FILE)
        assert box.delay == pytest.approx((min(delays), max(delays)), rel=OF_FILE)
        assert box.rate == pytest.approx(COUNTED, abs=ABOUT)
        assert box.norm_rate > 0.99 * box.rate


@pytest.mark.slow
def test_the_identified_models_themselves_are_as_fast_as_their_box():
    certificate = over_conditions()

    loops = [ft.loop.closed_loop(model, GAINS) for model in certificate.models]
    slowest = min(-np.linalg.eigvals(loop).real.max() for loop in loops)

    assert len(loops) == 12
    assert min(box.rate for box in certificate.boxes) <= slowest
    assert any(f"decay at {slowest:.4g} 1/s" in note for note in certificate.answer().notes)


@pytest.mark.slow
def test_a_file_with_boxes_is_valid_and_says_both_rates(tmp_path):
    certificate = behind_lags()
    certificate.save(tmp_path / "proof.json")

    verified = ft.verify(tmp_path / "proof.json")

    assert verified.valid
    for box in certificate.boxes:
        assert f"of 0.2..0.6 s decays at {box.rate:.6g} 1/s" in verified.claim.sentence
        assert f"in a norm at {box.norm_rate:.6g} 1/s" in verified.claim.sentence
    assert any("does not enclose" in note for note in verified.answer().notes)


FORGERIES = {
    "a wider range of the lag": lambda box: {"lag": (0.2, 0.605)},
    "a faster rate": lambda box: {"rate": 1.0001 * box["rate"]},
    "a faster norm": lambda box: {"norm_rate": 1.02 * box["norm_rate"]},
    "another norm": lambda box: {"Q": (np.array(box["Q"]) + 0.1 * np.eye(3)).tolist()},
    "another law": lambda box: {"b": [0.9, 0.9]},
    # of a law with b = 1, at a rate so slow that it holds over either range
    "a slower law": lambda _: {"b": [0.5, 0.9], "rate": 1e-3, "norm_rate": None, "Q": None},
    "a law that turns more": lambda _: {
        "b": [1.1, 1.5],
        "rate": 1e-3,
        "norm_rate": None,
        "Q": None,
    },
    "a law that diverges": lambda box: {"a": [0.0, 0.05]},
    "a delay": lambda box: {"delay": [0.05, 0.1], "norm_rate": None, "Q": None},
}


@pytest.fixture
def tables(tmp_path):
    behind_lags().save(tmp_path / "proof.json")
    return json.loads((tmp_path / "proof.json").read_text())


@pytest.mark.parametrize("forgery", FORGERIES)
def test_a_forged_box_in_a_file_is_not_valid(forgery, tables, tmp_path):
    tables["boxes"][0] |= FORGERIES[forgery](tables["boxes"][0])
    Opened(tables, {}, "", b"").write(tmp_path / "proof.json", anew=True)

    verified = ft.verify(tmp_path / "proof.json")

    assert not verified.valid
    assert "box" in verified.reason


def test_every_field_of_a_box_has_a_forgery(tables):
    box = tables["boxes"][0]

    assert {*box} == {key for forgery in FORGERIES.values() for key in forgery(box)}


def test_boxes_are_of_the_gains_and_of_every_channel_of_their_certificate():
    certificate = behind_lags()
    faster = replace(GAINS, K_I=1.1 * GAINS.K_I)

    assert not ft.verify(replace(certificate, gains=faster)).valid
    assert not ft.verify(replace(certificate, boxes=certificate.boxes[:1])).valid


def test_a_lag_that_makes_a_channel_unstable_refuses_the_certificate():
    certification = ft.certify("mission", GAINS, lag=[(0.2, 0.6), (0.2, 2.5)])

    assert certification.status == "refused"
    assert "gamma: its loop is not proven to be stable" in certification.reason
    assert certification.answer().failure


@pytest.mark.parametrize("lag", [(0.6, 0.2), (0.0, 0.2), (0.1, 0.2, 0.3), [(0.1, 0.2)] * 3])
def test_a_range_of_lags_that_is_none_is_refused(lag):
    with pytest.raises(ft.InputError, match="`lag` must be"):
        ft.certify("mission", GAINS, lag=lag)


def test_coupled_channels_have_no_box():
    certification = ft.certify("paper", "paper", lag=(0.1, 0.2))

    assert certification.status == "refused"
    assert "couple the channels" in certification.reason


@pytest.mark.slow
def test_gains_tuned_for_a_range_of_lags_have_the_largest_rate_of_all_gains():
    """The poles of lag s^3 + s^2 + K_P s + K_I add up to 1 / lag, whatever the gains."""
    tuned = ft.tune("mission", lag=[(0.3, 0.3), (0.2, 0.4)], starts=1)

    for i, lags in enumerate([(0.3,), (0.2, 0.4)]):
        K_P, K_I = tuned.gains.K_P[i, i], tuned.gains.K_I[i, i]
        rates = [-np.roots([lag, 1.0, K_P, K_I]).real.max() for lag in lags]
        assert min(rates) == pytest.approx(1.0 / (3.0 * max(lags)), rel=0.01)
    assert tuned.gains.feedback == (0.0, 0.0)


@pytest.mark.parametrize(
    "stated", [{"lag": (0.2, 0.6)}, {"changes": {"tuning.lag_s": [0.2, 0.6]}}], ids=str
)
def test_a_range_of_lags_is_tuned_for_at_one_condition(stated):
    with pytest.raises(ft.InputError, match="`lag` must be absent"):
        ft.tune("paper", envelope=True, **stated)


A_BOX = lag_box.LagBox((0.1, 0.3), (0.05, 0.05), (-0.1, 0.2), (0.4, 0.4), rate=0.5)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"lag": (0.3, 0.1)}, "a range inside 0.0001:60, its low end first, got 0.3:0.1"),
        ({"lag": (0.0, 0.1)}, "`lag` must be a range"),
        ({"lag": (0.1, 60.1)}, "`lag` must be a range"),
        ({"delay": (-0.1, 0.1)}, "`delay` must be a range inside 0:60"),
        ({"delay": (0.0, 0.1)}, "`delay` must be above 0 or 0 alone, got 0:0.1"),
        ({"a": (-61.0, 0.0)}, "`a` must be a range inside -60:60"),
        ({"b": (0.0, 1.0)}, "`b` must be a range inside 1e-06:1e"),
        ({"rate": 0.0}, "`rate` must be positive"),
        ({"norm_rate": 0.1}, "`norm_rate` and `Q` must be given together"),
        ({"norm_rate": 0.1, "Q": np.eye(3)}, r"`Q` must have shape \(4, 4\)"),
        ({"norm_rate": 0.1, "Q": np.eye(4), "delay": (0.0, 0.0)}, r"`Q` must have shape \(3, 3\)"),
    ],
)  # fmt: skip
def test_a_box_with_a_bad_range_is_refused_by_the_name_of_its_range(change, says):
    with pytest.raises(ft.InputError, match=says):
        replace(A_BOX, **change)


def test_a_box_says_its_ranges_and_its_rates():
    wide = replace(A_BOX, norm_rate=0.25, Q=np.diag([1.0, 4.0, 25.0, 9.0]))
    fixed = replace(A_BOX, a=(0.0, 0.0), delay=(0.0, 0.0))

    law = ", in e' = a e - b y with a -0.1..0.2 and b 0.4"
    assert wide.place == f"behind a first-order lag of 0.1..0.3 s and a delay of 0.05 s{law}"
    assert fixed.place == "behind a first-order lag of 0.1..0.3 s"
    assert wide.sentence("chi") == (
        f"chi {wide.place} decays at 0.5 1/s if that is constant, and in a norm at 0.25 1/s, with "
        "a growth of at most 5, if it changes in these ranges at will"
    )
    assert fixed.sentence("chi").endswith("and at no proven rate if it changes")
    assert (wide.growth, fixed.growth) == (pytest.approx(5.0), None)
    said = wide.values("chi")
    assert (said["lag_s"], said["lag"], said["delay"]) == ([0.1, 0.3], "0.1..0.3", "0.05")
    assert (said["error"], said["rate"], said["norm_rate"]) == ("chi", 0.5, 0.25)
