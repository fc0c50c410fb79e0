"""Points of a design: the same wherever a chunk begins, and as good as their name says."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

import flighttune as ft
from flighttune.campaigns.planning import draws
from flighttune.campaigns.planning.schema import CorrelationTable

KEYS = ["flight.V_a_mps", "flight.chi_deg", "wind.speed_mps"]
DESIGNS = ["random", "latin_hypercube", "sobol"]
CHANCE = 1e-3
"""Smallest p-value that a fixed seed may have."""


def points(design, first=0, end=64, keys=KEYS, seed=4, of=64):
    return draws.unit_points(design, keys, seed=seed, first=first, end=end, points=of)


@pytest.mark.slow
@pytest.mark.parametrize("design", DESIGNS)
@settings(max_examples=30)
@given(cuts=st.lists(st.integers(0, 64), max_size=4), seed=st.integers(0, 2**31 - 1))
def test_chunks_of_any_size_make_up_the_whole(design, cuts, seed):
    edges = [0, *sorted(cuts), 64]
    chunks = [points(design, a, b, seed=seed) for a, b in pairwise(edges)]

    assert np.array_equal(np.concatenate(chunks), points(design, seed=seed))


@pytest.mark.parametrize("design", ["random", "sobol"])
def test_points_do_not_depend_on_how_many_there_are(design):
    assert np.array_equal(points(design, of=64), points(design, of=1000))


@pytest.mark.parametrize("design", DESIGNS)
def test_every_coordinate_is_uniform_and_independent_of_the_others(design):
    u = points(design, end=2048, of=2048)

    for column in u.T:
        assert stats.kstest(column, "uniform").pvalue > CHANCE
    ranks = np.asarray(stats.spearmanr(u).statistic)
    assert np.abs(ranks - np.eye(3)).max() < 0.08  # 3.5 standard errors of independent columns


def test_a_latin_hypercube_has_one_point_in_every_stratum():
    u = points("latin_hypercube", end=50, of=50)

    for column in u.T:
        assert sorted((column * 50).astype(int).tolist()) == list(range(50))


def test_sobol_points_are_those_of_scipy():
    engine = qmc.Sobol(3, bits=32, rng=np.random.default_rng(np.random.SeedSequence(4)))
    known = engine.random_base2(6)

    assert np.array_equal(points("sobol"), known)
    assert np.array_equal(points("sobol", 17, 40), known[17:40])


def test_seeds_depend_on_the_draw_alone_and_fit_a_scenario():
    seeds = draws.run_seeds(7, 0, 1000)

    assert np.array_equal(draws.run_seeds(7, 300, 400), seeds[300:400])
    assert seeds.min() >= 0
    assert seeds.max() <= 2**31 - 3
    assert len(set(seeds.tolist())) == 1000
    assert not np.any(draws.run_seeds(8, 0, 1000) == seeds)


@pytest.mark.parametrize("rank", [-0.9, -0.3, 0.5, 0.95])
def test_correlated_keys_have_the_rank_correlation_asked_for(rank):
    u = points("sobol", end=4096)
    table = CorrelationTable(keys=[KEYS[2], KEYS[0]], rank=rank)
    mixed = draws.correlated(u, KEYS, [table])

    assert stats.spearmanr(mixed[:, 0], mixed[:, 2]).statistic == pytest.approx(rank, abs=0.01)
    assert np.array_equal(mixed[:, 1], u[:, 1])
    for column in mixed.T:
        assert stats.kstest(column, "uniform").pvalue > CHANCE


def test_correlations_that_contradict_each_other_are_refused():
    pairs = [(KEYS[0], KEYS[1], 0.9), (KEYS[1], KEYS[2], 0.9), (KEYS[0], KEYS[2], -0.9)]
    tables = [CorrelationTable(keys=[a, b], rank=rank) for a, b, rank in pairs]

    with pytest.raises(ft.InputError, match=r"`rank` .* eigenvalue -"):
        draws.copula_factor(tables)
