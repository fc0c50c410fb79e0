"""Constants and conversions against those of SciPy (CODATA and the international yard)."""

import math

import pytest
from scipy import constants

from flighttune.base import units


def test_units_are_those_of_scipy():
    assert units.G_0 == constants.g
    assert pytest.approx(constants.foot, rel=1e-15) == units.FT
    assert pytest.approx(constants.knot, rel=1e-12) == units.KNOT
    assert pytest.approx(constants.pound_force, rel=1e-12) == units.LBF
    assert pytest.approx(constants.slug, rel=1e-12) == units.SLUG
    assert pytest.approx(constants.degree, rel=1e-15) == units.DEG
    assert units.DEG * units.DEG_PER_RAD == pytest.approx(1.0, rel=1e-15)
    assert units.G_PAPER == 9.81  # Table 1 of arXiv 2411.13140


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [(0.3, 0.3), (4.0, 4.0 - math.tau), (-4.0, math.tau - 4.0), (20.0, 20.0 - 3.0 * math.tau)],
)
def test_an_angle_is_wrapped_by_whole_turns(angle, wrapped):
    assert units.wrap_angle(angle) == pytest.approx(wrapped, abs=1e-12)
    assert units.wrap_angle(math.pi) == math.pi
    assert units.wrap_angle(-math.pi) == math.pi
