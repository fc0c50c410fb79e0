"""The C library's functions over lanes, beside the library itself."""

import ctypes
import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import flighttune as ft
from flighttune.compiled import lifted

WIDTHS = 2, 4, 8
LIBRARY = ctypes.CDLL("libm.so.6")


def of_library(name, *numbers):
    function = getattr(LIBRARY, name)
    function.argtypes, function.restype = [ctypes.c_double] * len(numbers), ctypes.c_double
    return function(*numbers)


@pytest.fixture(scope="module", params=[2, pytest.param(4, marks=pytest.mark.slow), 8])
def over_lanes(request):
    """Each function that is lifted, for two rows of arguments, and the width of its lanes."""
    width = request.param
    made, loaded = {}, []
    found = lifted.lifted(width, lambda of: f"test of {of}")
    for name in found.names:
        library, (vectors, _) = lifted.loops(name, found.text, width)
        loaded.append(library)
        made[name] = vectors
    return made, width, loaded


def test_most_functions_of_a_step_are_lifted(over_lanes):
    made, _, _ = over_lanes
    assert {"sin", "cos", "atan2", "pow", "exp", "log"} <= {*made}


doubles = st.floats(width=64) | st.floats(-10.0, 10.0) | st.sampled_from([0.0, -0.0, math.inf])


@given(st.data())
def test_lanes_have_the_bits_of_the_library(over_lanes, data):
    made, width, _ = over_lanes
    x, y = (np.array(data.draw(st.lists(doubles, min_size=width, max_size=width))) for _ in "xy")

    for name, function in made.items():
        own = np.empty(width)
        function(x.ctypes.data, y.ctypes.data, own.ctypes.data, width)
        two = name in ("atan2", "pow")
        rows = zip(x.tolist(), y.tolist(), strict=True) if two else ((a,) for a in x.tolist())
        for given_, value in zip(rows, own.tolist(), strict=True):
            wanted = of_library(name, *given_)
            same = math.isnan(wanted) and math.isnan(value)
            assert same or value.hex() == wanted.hex(), (name, given_)


WITHOUT = """
import sys
sys.modules["capstone"] = None
import flighttune as ft
aircraft = ft.compiled.load("aerosonde")
state = aircraft.step(aircraft.trim(n=3, turbulence="light"), [0.2, 1.1], steps=200)
print(*(x.hex() for name in ("phi", "V_a", "alpha") for x in state[name].tolist()))
"""


@pytest.mark.slow
def test_without_the_decoder_flights_have_the_same_bits():
    found = subprocess.run(
        [sys.executable, "-c", WITHOUT], capture_output=True, text=True, check=True
    )
    aircraft = ft.compiled.load("aerosonde")
    state = aircraft.step(aircraft.trim(n=3, turbulence="light"), [0.2, 1.1], steps=200)

    own = [x.hex() for name in ("phi", "V_a", "alpha") for x in state[name].tolist()]
    assert found.stdout.split() == own
