"""Ranges of the numbers in files: each end is valid, and what is beyond it is refused."""

import math

import pytest
from pydantic import TypeAdapter, ValidationError

from flighttune.base import quantities as q

BEYOND = 1e-6  # relative, or of a range that ends at 0

# Lowest and highest value of each quantity, as releases have had them.
RANGES = {
    "Airspeed": (1.0, 1000.0), "Wind": (-200.0, 200.0), "WindSpeed": (0.0, 200.0),
    "Height": (-500.0, 30_000.0), "Instant": (0.0, 1e6), "Course": (-3600.0, 3600.0),
    "Inclination": (-89.0, 89.0), "Angle": (-180.0, 180.0), "AngularSpread": (0.0, 180.0),
    "AngularRate": (-1e4, 1e4), "LoadFactor": (-50.0, 50.0), "Gravity": (0.1, 100.0),
    "Bandwidth": (0.05, 200.0), "Damping": (0.05, 5.0), "TimeConstant": (1e-3, 1e4),
    "Delay": (0.0, 2.0), "Oscillation": (0.0, 1000.0), "OscillationRate": (-1e4, 1e4),
    "Factor": (0.01, 100.0), "Shift": (-10.0, 10.0), "Length": (0.1, 1e5), "Gain": (-1e6, 1e6),
    "Scale": (1e-6, 1e6),
}  # fmt: skip

# Above zero, up to these.
POSITIVE = {"Positive": math.inf, "Duration": 1e6, "PositiveRate": 1e4, "PositiveGain": 1e6}


def valid(name, value):
    try:
        return TypeAdapter(getattr(q, name)).validate_python(value) == value
    except ValidationError:
        return False


@pytest.mark.parametrize("name", RANGES)
def test_a_quantity_has_its_range(name):
    for end, outwards in zip(RANGES[name], (-1.0, 1.0), strict=True):
        assert valid(name, end)
        assert not valid(name, end + outwards * BEYOND * max(abs(end), 1e-3))
    assert not valid(name, math.nan)


@pytest.mark.parametrize("name", POSITIVE)
def test_a_positive_quantity_is_above_zero(name):
    assert valid(name, 1e-9)
    assert not valid(name, 0.0)
    assert valid(name, min(POSITIVE[name], 1e300))
    assert not valid(name, POSITIVE[name] * (1.0 + BEYOND))


@pytest.mark.parametrize(
    ("name", "ends", "good"),
    [
        ("Airspeeds", (10.0, 20.0), True),
        ("Airspeeds", (20.0, 10.0), False),
        ("Airspeeds", (10.0, 10.0), False),
        ("Airspeeds", (0.5, 10.0), False),
        ("Inclinations", (-10.0, 90.0), False),
        ("LoadFactors", (-1.0, 2.0, 3.0), False),
        ("AngularRates", (-30.0, 60.0), True),
    ],
)
def test_a_range_rises_within_its_quantity(name, ends, good):
    assert valid(name, ends) == good


@pytest.mark.parametrize(
    ("path", "good"),
    [
        ("a" * 80, True), ("a" * 81, False), ("a" * 81 + "/b", True), ("a" * 256 + "/b", False),
        ("é" * 41, False), ("a\0b", False),
    ],
)  # fmt: skip
def test_a_name_is_one_that_file_systems_have(path, good):
    assert valid("PathName", path) == good
