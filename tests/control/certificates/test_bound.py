"""The optimum of one channel against its Lyapunov equation and `tune`; the bound over all gains."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from fuzzing import slow
from printed import MODEL, lagged

import flighttune as ft
from flighttune.control.certificates import bound as bound_module
from flighttune.control.certificates.bound import (
    bound_rate,
    least_radius,
    optimal_channel,
    slowest_channel,
)

ROUNDING = 1e-9
SEARCHED = 1e-6  # an optimum found by a search is as good as one root


def channels(p, q):
    """A_K of single channels, shape (..., 2, 2)."""
    p, q = np.broadcast_arrays(p, q)
    ones, zeros = np.ones(p.shape), np.zeros(p.shape)
    return np.stack([np.stack([-p, -q], -1), np.stack([ones, zeros], -1)], -2)


@pytest.mark.parametrize("R_K", [0.2, 0.5, 0.9, 0.999])
def test_the_channel_has_the_indicators_it_states(R_K):
    channel = least_radius(R_K)

    measured = ft.loop.indicators(channels(channel.p, channel.q))

    assert measured.R_K == pytest.approx(R_K, rel=ROUNDING)
    assert measured.I_K == pytest.approx(channel.I_K, rel=ROUNDING)


def test_no_channel_of_a_fine_grid_is_better():
    p, q = np.meshgrid(*[np.geomspace(0.2, 20.0, 300)] * 2)

    measured = ft.loop.indicators_batch(channels(p, q))

    for I_star in (4.86, 8.0):
        best = measured.R_K[measured.I_K <= I_star].max()
        assert best == pytest.approx(optimal_channel(I_star).R_K, rel=0.02)
        assert best <= optimal_channel(I_star).R_K


def test_no_smaller_bound_can_be_met():
    least = slowest_channel()

    assert least.I_K == pytest.approx(4.8503, abs=1e-4)
    assert optimal_channel(0.9999 * least.I_K) is None
    assert optimal_channel(1.0001 * least.I_K).R_K == pytest.approx(least.R_K, abs=0.02)


@pytest.mark.soak
@pytest.mark.parametrize("I_star", np.geomspace(4.86, 60.0, 6))
def test_tune_finds_the_closed_optimum(I_star):
    found = ft.tune(ft.loop.TuningProblem(model=MODEL, I_star=I_star), starts=3)

    assert found.R_K == pytest.approx(optimal_channel(I_star).R_K, rel=SEARCHED)


def test_loops_of_any_size_satisfy_the_inequalities_of_the_proof():
    rng = np.random.default_rng(1)
    top = rng.standard_normal((4000, 3, 6)) - 2.0 * np.hstack([np.eye(3), np.eye(3)])
    lower = np.broadcast_to(np.hstack([np.eye(3), np.zeros((3, 3))]), top.shape)
    A = np.concatenate([top, lower], axis=1)
    A = A[ft.loop.indicators_batch(A).stable][:20]
    assert len(A) == 20
    for loop in A:
        W = np.linalg.inv(ft.loop.indicators(loop).Q)
        T = np.linalg.solve(loop, W)
        R, w = np.linalg.eigvalsh(W)[[0, -1]]
        sigma = np.linalg.svd(loop)[1][-1]
        scale = np.linalg.norm(T, 2) ** 2 + w**2
        square = (R + w) * W - R * w * np.eye(6) + sigma**2 * (T + T.T)

        assert T[:3] == pytest.approx(W[3:], abs=ROUNDING * scale)
        assert T.T @ T == pytest.approx(-(T + T.T), abs=ROUNDING * scale)
        assert np.linalg.eigvalsh(square)[0] >= -ROUNDING * scale
        assert max(R, sigma) <= 1.0


@pytest.mark.parametrize("I_star", [pytest.param(5.0, marks=pytest.mark.counts), *slow(20.0), 3.0])
def test_the_bound_is_proven_within_two_percent_of_the_optimum(tmp_path, I_star):
    bound = bound_rate(MODEL, I_star)
    bound.save(tmp_path / "bound.json")
    optimum = optimal_channel(I_star)

    assert ft.verify(tmp_path / "bound.json").valid
    if optimum is None:
        assert "none exist" in bound.sentence
        assert bound.R_bound * I_star == pytest.approx(1.0)
    else:
        assert optimum.R_K < bound.R_bound < 1.02 * optimum.R_K


@pytest.mark.parametrize(
    ("I_star", "R_bound", "none"), [(2.0, 0.6, False), (0.5, 1.5, True), (4.0, 0.25, True)]
)
def test_no_gains_exist_where_the_bound_times_i_star_is_at_most_one(bound, I_star, R_bound, none):
    # I_K >= 1 / R_K for all gains
    said = replace(bound, I_star=I_star, R_bound=R_bound).sentence

    assert ("none exist" in said) == none
    assert (f"R_K <= {R_bound:g}" in said) != none


def test_a_search_without_a_proof_ends(monkeypatch):
    monkeypatch.setattr(bound_module, "MAX_BOXES", 20)

    assert bound_module.no_faster_gains(20.0, 0.99 * optimal_channel(20.0).R_K) is None


@pytest.fixture(scope="module")
def bound():
    return bound_rate(MODEL, 20.0)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda x: {"boxes": x.boxes[1:], "multipliers": x.multipliers[1:]}, "boxes cover"),
        (lambda _: {"R_bound": 0.92}, "boxes cover"),
        (lambda x: {"multipliers": -x.multipliers}, "no gains in any"),
        (lambda x: {"multipliers": np.ones(x.multipliers.shape)}, "no gains in any"),
        (lambda _: {"I_star": 21.0}, "no gains in any"),
        (lambda x: {"boxes": np.vstack([np.zeros((1, 4)), x.boxes[1:]])}, "no gains in any"),
    ],
    ids=["box left out", "bound", "sign", "multipliers", "I_star", "box without a width"],
)
def test_a_changed_proof_is_refused(bound, change, reason):
    verified = replace(bound, **change(bound)).verify()

    assert not verified.valid
    assert reason in verified.reason


@pytest.mark.parametrize(
    ("boxes", "gap"),
    [
        # smallest and largest R_K, smallest and largest sigma, of R_K from 0.5 on
        ([(0.5, 1.0, 0.0, 1.0)], 0.0),
        ([(0.5, 1.0, 0.0, 0.875)], 0.125),
        ([(0.5, 1.0 - 2.0**-40, 0.0, 1.0)], 2.0**-40),
        ([(0.5, 1.0, 0.25, 1.0)], 0.25),
        ([(0.5, 0.75, 0.0, 1.0)], 0.25),
        ([(0.625, 1.0, 0.0, 1.0)], 0.125),
        ([(0.75, 1.0, 0.0, 1.0), (0.5, 0.625, 0.0, 1.0)], 0.125),
        ([(0.5, 0.75, 0.0, 1.0), (0.75, 1.0, 0.0, 0.5)], 0.25),
        ([(0.5, 0.75, 0.0, 1.0), (0.75, 1.0, 0.5, 1.0)], 0.25),
        # a box that lies within another
        ([(0.5, 0.875, 0.0, 1.0), (0.625, 0.75, 0.0, 1.0), (0.875, 1.0, 0.0, 1.0)], 0.0),
    ],
)
def test_boxes_cover_all_rates_above_the_bound_at_every_sigma(boxes, gap):
    boxes, numbers = np.array(boxes), np.ones((len(boxes), bound_module.NUMBERS))
    stated = bound_module.RateBound(I_star=20.0, R_bound=0.5, boxes=boxes, multipliers=numbers)

    cover = stated.verify().checks[0]

    assert (cover.margin, cover.exact) == (-gap, gap == 0.0)


def test_one_box_that_is_not_refuted_leaves_a_bound_unproven(bound):
    multipliers = bound.multipliers.copy()
    multipliers[-1] *= -1.0

    covered, refuted = replace(bound, multipliers=multipliers).verify().checks

    assert covered.exact
    assert (refuted.margin, refuted.exact) == (-1.0, False)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda _: {"I_star": -20.0}, "`I_star` must be positive"),
        (lambda _: {"R_bound": 0.0}, "`R_bound` must be positive"),
        (lambda x: {"multipliers": x.multipliers[1:]}, "`multipliers`"),
        (lambda x: {"boxes": x.boxes[:, :3]}, "`boxes`"),
    ],
)
def test_numbers_that_no_bound_has_are_refused(bound, change, name):
    with pytest.raises(ft.InputError, match=name):
        replace(bound, **change(bound))


def test_a_side_below_zero_proves_nothing_more(bound):
    boxes = bound.boxes.copy()
    boxes[boxes[:, 2] == 0.0, 2] = -9.0

    wider = replace(bound, boxes=boxes)

    assert wider.verify().checks[1].margin == bound.verify().checks[1].margin


@pytest.mark.parametrize(
    ("model", "I_star", "message"),
    [
        (lagged(2.0, 2.0), 5.0, "errors as its states"),
        (replace(MODEL, C=2.0 * MODEL.C), 5.0, "errors as its states, in plain units"),
        (MODEL, np.inf, "`I_star` must be finite"),
    ],
)
def test_a_bound_that_cannot_be_stated_is_refused(model, I_star, message):
    with pytest.raises(ft.InputError, match=message):
        bound_rate(model, I_star)


def test_states_are_plain_in_the_units_of_their_errors():
    assert bound_rate(MODEL, 3.0, np.array([2.0, 3.0, 2.0, 3.0])).verify().valid
    with pytest.raises(ft.InputError, match="in plain units"):
        bound_rate(MODEL, 3.0, np.array([2.0, 1.0, 1.0, 1.0]))


@pytest.mark.parametrize("seed", range(4))
def test_the_margin_of_a_box_is_that_of_its_worst_corner(seed):
    """The inequalities of `RateBound` at all W and T whose entries are at their bounds."""
    I_star, (R, R_high, sigma, sigma_high) = 5.0, (0.6, 0.7, 0.3, 0.4)
    rng = np.random.default_rng(seed)
    w, share, eye = I_star * R_high**2 * sigma_high, sigma**2, np.eye(2)
    roots = [rng.normal(size=(n, n)) for n in (2, 2, 2, 4)]
    X = [root @ root.T + np.eye(len(root)) for root in roots]
    sums = []
    for a, b, c, d, e in product(*[(-w, w)] * 3, *[(-2.0, 2.0)] * 2):
        W, T = np.array([[a, b], [b, c]]), np.array([[b, c], [d, e]])
        third = (R + w) / w * W - R * eye + share / w * (T + T.T)
        parts = W - R * eye, eye - W / w, third, np.block([[-T - T.T, T.T], [T, eye]])
        sums.append(sum(np.trace(x @ part) for x, part in zip(X, parts, strict=True)))

    numbers = np.concatenate([x[np.tril_indices(len(x))] for x in X])
    margin = bound_module._box_margin((R, R_high, sigma, sigma_high), numbers, I_star)
    assert float(margin) == pytest.approx(-max(sums), rel=ROUNDING)
