"""Band files that were edited and sealed again: each edit that changes a claim is refused."""

import math

import pytest
from counted_turns import forged
from flown_campaigns import flown_here
from scipy.stats import hypergeom

import flighttune as ft


def test_a_claim_other_than_that_planned_shares_its_confidence_and_its_shape(counted, tmp_path):
    """The shape is that of the planned epsilon: the scale of the last tenths of 10 flights."""
    other = counted.claiming(0.5, 0.9)
    other.save(tmp_path / "x.npz")
    hidden = forged(other, tmp_path / "y.npz", {"planned": None})
    with flown_here():
        shown, *_ = (ft.verify(path) for path in (tmp_path / "x.npz", hidden))

        assert shown.valid
        assert not ft.verify(hidden).valid
    assert other.confidence == pytest.approx(1.0 - 0.1 - 0.1)
    assert "0.8 (shared with the claim planned, 0.3 at 0.9)" in shown.claim.sentence
    assert other.claiming(0.3, 0.9).confidence == counted.confidence


def fields(tables, above=()):
    """Every value in tables with its place."""
    pairs = tables.items() if isinstance(tables, dict) else enumerate(tables)
    for key, value in pairs:
        if isinstance(value, dict | list):
            yield from fields(value, (*above, key))
        else:
            yield (*above, key), value


def test_the_chance_that_verify_misses_a_forgery_is_that_of_doubling_epsilon(counted, tmp_path):
    """Of N flights counted, K = epsilon N are forged, and n are flown again."""
    counted.save(tmp_path / "x.npz")
    with flown_here():
        note = " ".join(ft.verify(tmp_path / "x.npz", count=3).answer().notes)

    flights, epsilon = len(counted.scores), counted.about.epsilon
    forged_flights = math.ceil(epsilon * flights)
    assert f"forgery of {forged_flights} counted flights, which would double epsilon" in note
    missed = hypergeom.pmf(0, flights, forged_flights, 3)
    assert f"missed with probability {missed:.2g}." in note
