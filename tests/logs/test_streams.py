"""Streams of a log at their own rates become attitudes, commands and samples at one rate."""

from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flighttune.logs import streams

NEXT_TO_ZERO = 1e-3
"""Error of angles (rad) where a part w that the log lacks is so small that its sign is open."""


def turn_with_a_reversal(count=400):
    """Roll, pitch and yaw (rad): a circle and a half to the right, then as far to the left."""
    t = np.linspace(0.0, 60.0, count)
    psi = 3.0 * np.pi * np.sin(np.pi * t / 60.0)
    return t, 0.7 * np.cos(np.pi * t / 60.0), 0.2 * np.sin(0.3 * t), psi


@pytest.mark.parametrize("parts", ["wxyz", "xyz"])
@pytest.mark.parametrize(("name", "ending"), [("q", ""), ("q_enu", ""), ("q_cmd", "_cmd")])
def test_angles_of_a_quaternion_are_those_of_its_rotation(name, ending, parts):
    t, phi, theta, psi = turn_with_a_reversal()
    enu = name == "q_enu"
    turns = (0.5 * np.pi - psi, -theta, phi) if enu else (psi, theta, phi)
    x, y, z, w = Rotation.from_euler("ZYX", np.column_stack(turns)).as_quat(canonical=False).T
    values = {"w": w, "x": x, "y": y, "z": z}
    raw = {f"{name}_{part}": (t, values[part]) for part in parts}
    raw |= {"v_north": (t, 25.0 * np.cos(psi)), "v_east": (t, 25.0 * np.sin(psi))}

    streams.with_angles(raw)

    assert not any(key.startswith("q") for key in raw)
    for key, expected in (("phi", phi), ("theta", theta), ("psi", psi)):
        times, found = raw[f"{key}{ending}"]
        assert (times == t).all()
        assert np.abs(np.exp(1j * found) - np.exp(1j * expected)).max() < NEXT_TO_ZERO


@pytest.mark.parametrize("seed", range(30))
def test_signs_of_w_are_those_that_cost_least_of_all(seed):
    """Noses off the course, and turns between samples: of 2^3 ways, those of a search of all."""
    rng, n = np.random.default_rng(seed), 3
    parts = rng.standard_normal((n, 4))
    w, *vector = (parts / np.linalg.norm(parts, axis=1, keepdims=True)).T
    vector, course = np.column_stack(vector), rng.uniform(-np.pi, np.pi, n)

    def cost(signs):
        q = Rotation.from_quat(np.column_stack([vector, signs * w]))
        off = 1.0 - np.cos(q.as_euler("ZYX")[:, 0] - course)
        inner = np.sum(q.as_quat(canonical=False)[1:] * q.as_quat(canonical=False)[:-1], axis=1)
        return np.sum(off) + streams.SMOOTH * np.sum(1.0 - np.abs(inner))

    found = streams._signs(w, vector, course)

    assert cost(found) == pytest.approx(min(cost(np.array(x)) for x in product((1, -1), repeat=n)))


def test_a_command_is_the_last_measured_value_plus_its_error():
    raw = {
        "phi": (np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.2, 0.4])),
        "phi_err": (np.array([0.5, 1.0, 2.9, 3.5]), np.array([1.0, 1.0, -0.3, 0.2])),
    }

    streams._with_commands("a log", raw)

    t, commanded = raw["phi_cmd"]
    there = np.isfinite(commanded)
    assert t[there].tolist() == [1.0, 2.9, 3.5]  # none before the first measured value
    assert commanded[there] == pytest.approx([1.1, -0.1, 0.6])
    assert "phi_err" not in raw


@pytest.mark.parametrize(
    ("period", "expected"),
    [
        # of t^2 at 0.5, 0.75, 1 and 1.25 s, and at 1.5, 1.75, 2 and 2.25 s
        (0.25, [0.84375, 3.59375]),
        (0.75, [1.125, 4.125]),
    ],
)
def test_a_faster_stream_is_averaged_and_a_slower_one_interpolated(period, expected):
    times = np.arange(0.0, 3.1, period)

    assert streams._between(np.array([1.0, 2.0]), times, times**2, 1.0) == pytest.approx(expected)


def test_modes_and_states_last_until_the_last_attitude_from_the_first_one():
    attitude = np.arange(100.0, 161.0), np.zeros(61)
    raw = {
        "phi": attitude,
        "mode": (np.array([95.0, 130.0]), np.array([2.0, 3.0])),
        "armed": (np.array([90.0, 110.0, 140.0]), np.array([0.0, 1.0, 0.0])),
    }

    listed, said = streams.phases("a log", raw, {"2": "AUTO"}, {"armed": [1.0, 1.0]})

    assert listed == [("armed", 10.0, 40.0), ("AUTO", 0.0, 30.0), ("mode 3", 30.0, 60.0)]
    assert said == []
    assert raw == {"phi": attitude}


def test_a_state_that_does_not_end_lasts_until_the_last_attitude():
    raw = {"phi": (np.array([100.0, 160.0]), np.zeros(2)), "armed": (np.array([110.0]), np.ones(1))}

    assert streams.phases("a log", raw, {}, {"armed": [1.0, 1.0]})[0] == [("armed", 10.0, 60.0)]
