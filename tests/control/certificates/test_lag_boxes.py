"""Rates over boxes of lags and delays: against dense grids and flights, and not to be forged."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from forging import Opened

import flighttune as ft
from flighttune.control.certificates import lag_box

# Relative distance between a proven rate and the least over the points of a grid: four digits.
FOUR_DIGITS = 5e-5

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


@cache
def behind_lags():
    return ft.certify("mission", GAINS, lag=(0.2, 0.6)).certificate


@cache
def over_conditions():
    return ft.certify("mission", GAINS, envelope=True, changes=IDENTIFIED).certificate


@pytest.mark.slow
def test_the_box_of_an_assumed_lag_has_the_least_rate_of_its_lags():
    fed = replace(GAINS, feedback=(0.4, 0.3))

    for i, box in enumerate(ft.certify("mission", fed, lag=(0.2, 0.6)).certificate.boxes):
        K_P, K_I, k = GAINS.K_P[i, i], GAINS.K_I[i, i], fed.feedback[i]
        least = min(
            -np.roots([lag, 1.0 + k, (1.0 + k) * K_P, (1.0 + k) * K_I]).real.max()
            for lag in np.linspace(0.2, 0.6, 2001)
        )
        assert box.rate == pytest.approx(least, rel=FOUR_DIGITS)
        assert 0.0 < box.norm_rate <= box.rate
        assert (box.lag, box.delay) == ((0.2, 0.6), (0.0, 0.0))


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


@pytest.mark.soak
def test_gains_tuned_for_a_range_of_lags_have_the_largest_rate_of_all_gains():
    # The three poles of lag s^3 + s^2 + K_P s + K_I add up to 1 / lag, whatever the gains.
    most = 1.0 / (3.0 * 0.6)

    tuned = ft.tune("mission", lag=(0.2, 0.6), starts=1)

    boxes = ft.certify("mission", tuned.gains, lag=(0.2, 0.6)).certificate.boxes
    assert all(0.99 * most < box.rate <= most for box in boxes)
    assert min(box.norm_rate for box in boxes) > max(box.rate for box in behind_lags().boxes)


@pytest.mark.parametrize(
    "stated", [{"lag": (0.2, 0.6)}, {"changes": {"tuning.lag_s": [0.2, 0.6]}}], ids=str
)
def test_a_range_of_lags_is_tuned_for_at_one_condition(stated):
    with pytest.raises(ft.InputError, match="`lag` must be absent"):
        ft.tune("paper", envelope=True, **stated)


# Relative excess over the same, by the part of the box between two points.
# Least share of the rate for constant lags that a norm has however they change: those of boxes
# over which R_K's gains were counted.
# K_P (1/s), K_I (1/s^2) and inner feedback of a channel of the exact law.
def loop(gains, lag, delay, a, b):
    """States e, xi, y and what is delayed, as the equations read."""
    K_P, K_I, k = gains
    u = np.array([(1.0 + k) * K_P, (1.0 + k) * K_I, -k, 0.0])
    e, _, y, z = np.eye(4)
    return np.array([a * e - b * y, e, (2.0 * z - u - y) / lag, 2.0 * (u - z) / delay])


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
