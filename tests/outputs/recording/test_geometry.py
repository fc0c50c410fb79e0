"""Attitude, cameras and the mesh against what they must do in space."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from figures.aircraft_glb import MODEL, aircraft_mesh, write_glb
from made_up import made_up_run
from scipy.spatial.transform import Rotation

from flighttune.outputs.recording import entities, scene

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


@pytest.mark.parametrize(
    ("value", "steps", "below"),
    [
        (0.0, scene.ROUND, 1.0), (0.09, scene.ROUND, 0.05), (1.0, scene.ROUND, 1.0),
        (4.99, scene.ROUND, 2.0), (5.0, scene.ROUND, 5.0), (99.0, scene.ROUND, 50.0),
        (6.9, scene.FINELY_ROUND, 5.0), (7.0, scene.FINELY_ROUND, 7.0),
        (190.0, scene.FINELY_ROUND, 150.0),
    ],
)  # fmt: skip
def test_a_round_number_is_the_largest_that_is_not_above(value, steps, below):
    assert scene.round_below(value, steps) == pytest.approx(below)


@pytest.mark.parametrize(("size", "factor"), [(10.0, 1.0), (100.0, 3.0), (1000.0, 30.0)])
def test_aircraft_are_drawn_a_tenth_as_wide_as_their_flight(size, factor):
    """A tenth of 100 m is 3.4 spans of 2.9 m; the round factor below is 3."""
    points = np.array([[0.0, 0.0, 0.0], [0.6 * size, 0.0, -0.8 * size]])

    assert scene.enlargement(points, 2.9) == pytest.approx(factor)


def test_the_ground_has_lines_around_the_flight_and_lies_below_it():
    """A flight of 290 m has lines at most 48 m apart; the round spacing below is 20 m."""
    points = np.array([[3.0, -25.0, -90.0], [293.0, 5.0, -30.0]])

    lines, spacing = scene.ground_grid(points)

    assert spacing == pytest.approx(20.0)
    ends = np.array(lines)
    assert (ends[..., 2] == -20.0).all()
    assert ends[..., 0].min() == 0.0
    assert ends[..., 0].max() == pytest.approx(300.0)
    assert (ends[..., 1].min(), ends[..., 1].max()) == pytest.approx((-40.0, 20.0))
    assert len(lines) == 16 + 4
    still, spacing = scene.ground_grid(np.zeros((2, 3)))  # room for the axes
    assert spacing == pytest.approx(0.1)
    assert np.ptp(np.array(still)[..., 0]) == pytest.approx(0.2)


def test_dashes_have_gaps_as_long_as_they_are():
    path = np.column_stack([np.arange(1200.0), np.zeros(1200), np.zeros(1200)])

    pieces = scene.dashes(path)

    assert len(pieces) == 60
    drawn = sum(piece[-1, 0] - piece[0, 0] for piece in pieces)
    gaps = sum(b[0, 0] - a[-1, 0] for a, b in pairwise(pieces))
    assert drawn == pytest.approx(gaps, rel=0.05)
    assert (pieces[0][0, 0], pieces[-1][-1, 0]) == (0.0, 1199.0)
    assert scene.dashes(path[:1]) == []


@pytest.mark.parametrize(
    ("columns", "length"),
    [({"V_a": 20.0}, 20.0), ({"V_a": 20.0, "V_g": 25.0}, 25.0), ({"V_g": 25.0}, 20.0)],
)
def test_arrows_are_along_the_path_in_axes_that_turn_with_it(columns, length):
    """At 20 m/s, as at the start, an arrow is 0.9 of the width; a wind is drawn 4 times as long."""
    chi, gamma = 0.7, 0.2
    still = {"chi": chi, "gamma": gamma, "phi": 0.0, **columns}
    windy = still | {"wind_north": -3.0, "wind_east": 4.0, "wind_down": 1.0}

    def arrows(signals):
        run = made_up_run({name: [x, x] for name, x in signals.items()}, [0.0, 0.1])
        return scene._arrows(run, run.signals, 10.0)

    found = arrows(windy)
    size = 9.0 * length / 20.0
    assert found["velocity"][1] == pytest.approx([size * np.cos(gamma), 0.0, -size * np.sin(gamma)])
    scale = 4.0 * 9.0 / columns.get("V_a", 25.0)
    ahead, right = [np.cos(chi), np.sin(chi)], [-np.sin(chi), np.cos(chi)]
    expected = scale * np.array([np.dot([-3.0, 4.0], ahead), np.dot([-3.0, 4.0], right), 1.0])
    assert found["wind"][0] == pytest.approx(expected)
    assert {*arrows(still)} == {"velocity"}
    nothing = arrows(still | {"V_a": 0.0})
    assert (nothing["velocity"] == 0.0).all()


def test_an_aircraft_is_as_wide_as_its_own_else_that_of_its_scenario_else_the_model():
    """The wings of a Cessna 172 span 10.9 m, those of an Aerosonde 2.9 m."""
    plants = {"plant": [{"kind": "kinematic"}, {"kind": "jsbsim", "aircraft": "c172p"}]}
    runs = [
        made_up_run({}, [], plant=plant, scenario=scenario)
        for plant, scenario in (
            ("jsbsim:aerosonde", plants), ("kinematic", plants), ("kinematic", {}),
            ("jsbsim:nobodys", {}),
        )
    ]  # fmt: skip

    spans = [scene.span_of(run) for run in runs]

    assert spans == pytest.approx([2.9, 10.9, scene.MODEL_SPAN, scene.MODEL_SPAN], rel=0.02)


def test_positions_of_all_runs_are_those_that_are_numbers():
    runs = [
        made_up_run({"north": [0.0, x], "east": [1.0, 2.0], "down": [3.0, y]}, [0.0, 0.1])
        for x, y in ((5.0, 6.0), (np.nan, 6.0), (5.0, np.inf))
    ]
    drawn = entities.runs_to_draw(runs)

    assert scene.all_positions(drawn).tolist() == [
        [0.0, 1.0, 3.0], [5.0, 2.0, 6.0], [0.0, 1.0, 3.0], [0.0, 1.0, 3.0]
    ]  # fmt: skip
    assert [one.number for one in drawn] == [1, 2, 3]
    assert len({one.key for one in drawn}) == 3
