"""The bound on R_K over all gains: against tuned gains, its inequalities, and forged proofs."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pytest

import flighttune as ft

ROUNDING = 1e-9
NUMBERS = 19  # of the multipliers of a box: lower triangles of order 2, 2, 2 and 4


@cache
def proven(I_star):
    return ft.tune("paper", changes={"tuning.I_star": I_star}, starts=1, prove=True)


@pytest.fixture(scope="module")
def bound():
    return proven(20.0).bound


def test_no_channel_of_a_fine_grid_is_better_than_the_tuned_gains_or_the_bound():
    p, q = np.meshgrid(*[np.geomspace(0.2, 20.0, 200)] * 2)
    ones, zeros = np.ones(p.shape), np.zeros(p.shape)
    A = np.stack([np.stack([-p, -q], -1), np.stack([ones, zeros], -1)], -2)
    measured = ft.loop.indicators_batch(A)

    best = measured.R_K[measured.I_K <= 20.0].max()
    result = proven(20.0)

    assert best == pytest.approx(result.R_K, rel=0.02)
    assert best <= result.R_K * (1.0 + ROUNDING)
    assert result.R_K < result.bound.R_bound < 1.02 * result.R_K


def test_loops_of_any_size_satisfy_the_inequalities_of_the_proof():
    rng = np.random.default_rng(1)
    top = rng.standard_normal((4000, 3, 6)) - 2.0 * np.hstack([np.eye(3), np.eye(3)])
    lower = np.broadcast_to(np.hstack([np.eye(3), np.zeros((3, 3))]), top.shape)
    A = np.concatenate([top, lower], axis=1)
    A = A[ft.loop.indicators_batch(A).stable][:20]
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


def test_a_saved_bound_verifies_and_says_what_it_bounds(bound, tmp_path):
    bound.save(tmp_path / "bound.json")

    assert ft.verify(tmp_path / "bound.json").valid
    assert f"R_K <= {bound.R_bound:.6g}" in bound.sentence


@pytest.mark.soak
def test_where_no_gains_meet_the_bound_on_i_k_there_are_none_and_tuning_fails_for_it():
    none = proven(4.0)

    assert none.status == "infeasible"
    assert "`I_star` must be at least 4.85" in none.reason
    assert none.bound.verify().valid
    assert "none exist" in none.bound.sentence


@pytest.mark.parametrize(
    ("I_star", "R_bound", "none"), [(2.0, 0.6, False), (0.5, 1.5, True), (4.0, 0.25, True)]
)
def test_no_gains_exist_where_the_bound_times_i_star_is_at_most_one(bound, I_star, R_bound, none):
    said = replace(bound, I_star=I_star, R_bound=R_bound).sentence  # I_K >= 1 / R_K for all gains

    assert ("none exist" in said) == none


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda x: {"boxes": x.boxes[1:], "multipliers": x.multipliers[1:]}, "boxes cover"),
        (lambda _: {"R_bound": 0.92}, "boxes cover"),
        (lambda x: {"multipliers": -x.multipliers}, "no gains in any"),
        (lambda x: {"multipliers": x.multipliers * np.r_[-1.0, [1.0] * 18]}, "no gains in any"),
        (lambda x: {"multipliers": np.ones(x.multipliers.shape)}, "no gains in any"),
        (lambda _: {"I_star": 21.0}, "no gains in any"),
        (lambda x: {"boxes": np.vstack([np.zeros((1, 4)), x.boxes[1:]])}, "no gains in any"),
        (lambda x: {"multipliers": np.vstack([x.multipliers[:-1], -x.multipliers[-1:]])}, "any"),
    ],
)
def test_a_changed_proof_is_refused(bound, change, reason):
    verified = ft.verify(replace(bound, **change(bound))).verification

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
        ([(0.625, 1.0, 0.0, 1.0)], 0.125),
        ([(0.75, 1.0, 0.0, 1.0), (0.5, 0.625, 0.0, 1.0)], 0.125),
        ([(0.5, 0.75, 0.0, 1.0), (0.75, 1.0, 0.0, 0.5)], 0.25),
        # a box that lies within another
        ([(0.5, 0.875, 0.0, 1.0), (0.625, 0.75, 0.0, 1.0), (0.875, 1.0, 0.0, 1.0)], 0.0),
    ],
)
def test_boxes_cover_all_rates_above_the_bound_at_every_sigma(boxes, gap):
    numbers = np.ones((len(boxes), NUMBERS))
    stated = ft.RateBound(I_star=20.0, R_bound=0.5, boxes=np.array(boxes), multipliers=numbers)

    cover = stated.verify().checks[0]

    assert (cover.margin, cover.exact) == (-gap, gap == 0.0)


@pytest.mark.parametrize("seed", range(3))
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
    box = np.array([[R, R_high, sigma, sigma_high]])
    stated = ft.RateBound(I_star=I_star, R_bound=R, boxes=box, multipliers=numbers[None])
    assert stated.verify().checks[1].margin == pytest.approx(-max(sums), rel=ROUNDING)


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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tuning.lag_rad_s": [4.0, 8.0], "tuning.I_star": float("inf")}, "errors as its states"),
        ({"tuning.I_star": float("inf")}, "`I_star`"),
    ],
)
def test_a_bound_that_cannot_be_stated_is_refused(changes, message):
    with pytest.raises(ft.FlightTuneError, match=message):
        ft.tune("paper", changes=changes, starts=1, prove=True)
