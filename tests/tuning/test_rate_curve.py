"""Certified rates over envelopes that grow."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.tuning.envelope import rate_curve
from tests.tuning.test_tune_over_envelope import MODERATE, TRIM, TUNED, G

pytestmark = pytest.mark.slow

SOLVER = 1e-5


@pytest.fixture(scope="module")
def curves():
    return {
        name: rate_curve(gains, MODERATE, TRIM, g=G, up_to=1.2)
        for name, gains in (("paper", ft.PAPER_GAINS), ("tuned", TUNED))
    }


def test_a_curve_starts_at_the_trims_own_rate_and_falls(model, curves):
    for (_, rates), gains in zip(curves.values(), (ft.PAPER_GAINS, TUNED), strict=True):
        own = ft.indicators(ft.closed_loop(model, gains)).R_K
        assert rates[0] == pytest.approx(own, rel=SOLVER)
        assert (np.diff(rates) < 0.0).all()


def test_the_papers_curve_ends_before_the_envelope_and_the_tuned_one_goes_on(curves):
    (paper_factors, paper_rates), (tuned_factors, tuned_rates) = curves.values()

    assert 0.8 < paper_factors[-1] < 0.85
    assert paper_rates[-1] == 0.0
    assert tuned_factors[-1] == 1.2
    assert tuned_rates[-1] > 0.0
