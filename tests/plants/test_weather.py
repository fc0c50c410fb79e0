"""Weather as a value: wind between levels, and its change in flight."""

import pytest

from flighttune.plants.weather import WindProfile

LEVELS = ((100.0, (0.0, 2.0, 0.0)), (300.0, (10.0, -2.0, 1.0)))


@pytest.mark.parametrize(
    ("h", "wind"),
    [
        (0.0, (0.0, 2.0, 0.0)),
        (100.0, (0.0, 2.0, 0.0)),
        (150.0, (2.5, 1.0, 0.25)),
        (300.0, (10.0, -2.0, 1.0)),
        (900.0, (10.0, -2.0, 1.0)),
    ],
)
def test_wind_is_linear_between_levels_and_constant_beyond(h, wind):
    assert WindProfile(LEVELS).at(h) == pytest.approx(wind)
