"""Attitude, cameras and the mesh against what they must do in space."""

import numpy as np
import pandas as pd
import pytest
from figures.aircraft_glb import MODEL, aircraft_mesh, write_glb
from scipy.spatial.transform import Rotation

from flighttune.outputs.recording import scene

ROUNDING = 1e-12
HALF_VIEW = np.tan(np.deg2rad(27.5))
"""Half the height of what the viewer's camera sees, at distance 1."""


def turned(quaternion, vector):
    return Rotation.from_quat(quaternion).apply(vector)  # x, y, z, w


@pytest.mark.parametrize(
    ("angles", "nose", "right_wing"),
    [
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        ((0.0, 0.0, 90.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)),
        ((0.0, 90.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
        ((90.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((90.0, 0.0, 180.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    ],
    ids=["level north", "level east", "straight up", "right wing down", "south, right wing down"],
)
def test_an_attitude_points_nose_and_wing_the_right_way(angles, nose, right_wing):
    phi, theta, psi = np.deg2rad(angles)
    signals = pd.DataFrame({"chi": [0.7], "phi": [phi], "theta": [theta], "psi": [psi]})

    def drawn(vector):
        return turned(scene.headings(signals)[0], turned(scene.attitudes(signals)[0], vector))

    assert drawn([1.0, 0.0, 0.0]) == pytest.approx(nose, abs=ROUNDING)
    assert drawn([0.0, 1.0, 0.0]) == pytest.approx(right_wing, abs=ROUNDING)


def test_a_plant_without_pitch_and_heading_is_drawn_along_its_path():
    signals = pd.DataFrame({"chi": [0.7], "gamma": [0.3], "phi": [0.5]})
    along = [np.cos(0.3) * np.cos(0.7), np.cos(0.3) * np.sin(0.7), -np.sin(0.3)]

    nose = turned(scene.attitudes(signals)[0], [1.0, 0.0, 0.0])

    assert turned(scene.headings(signals)[0], nose) == pytest.approx(along, abs=ROUNDING)


AROUND = np.linspace(0.0, 2.0 * np.pi, 80)
FLIGHTS = {
    "climb north": np.linspace([0.0, 0.0, 0.0], [400.0, 20.0, -150.0], 50),
    "descent west": np.linspace([0.0, 0.0, 0.0], [-10.0, -900.0, 120.0], 50),
    "circle": 60.0 * np.column_stack([np.sin(AROUND), np.cos(AROUND), 0.0 * AROUND]),
    "zoom": np.linspace([0.0, 0.0, 0.0], [30.0, 5.0, -400.0], 50),
    "half an hour": np.linspace([0.0, 0.0, 0.0], [45e3, 9e3, -800.0], 500),
}


@pytest.mark.parametrize("flight", FLIGHTS)
def test_the_overview_sees_every_point_and_stands_no_further_than_it_must(flight):
    points = FLIGHTS[flight]
    margin = 0.5 * scene.MODEL_SPAN * scene.enlargement(points, scene.MODEL_SPAN)

    position, target = scene.overview_eye(points, margin=margin)
    ahead = (target - position) / np.linalg.norm(target - position)
    right = np.cross(ahead, [0.0, 0.0, -1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, ahead)
    depth = (points - position) @ ahead
    seen = np.column_stack([(points - position) @ right, (points - position) @ up]) / depth[:, None]

    assert position[2] < target[2]
    assert depth.min() > 0.0
    seen /= scene.ASPECT, 1.0
    assert np.abs(seen).max() < HALF_VIEW
    assert np.ptp(seen, axis=0).max() > 0.55 * 2.0 * HALF_VIEW


def test_the_model_in_the_package_is_what_its_script_makes(tmp_path):
    mesh = aircraft_mesh()
    write_glb(mesh, tmp_path / "aircraft.glb")

    assert np.ptp(mesh.vertices[:, 1]) == pytest.approx(scene.MODEL_SPAN, abs=ROUNDING)
    assert (tmp_path / "aircraft.glb").read_bytes() == MODEL.read_bytes()
