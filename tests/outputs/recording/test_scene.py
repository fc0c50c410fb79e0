"""The scene, cameras and axes of a recording of flights whose path is made up, in numbers."""

import math
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_up import made_up_scenario

import flighttune as ft
from tests.outputs.recording.test_recorded import FLOAT32, recorded

SPAN = 2.9
"""Of the Aerosonde, m, as in tests/vehicles."""
TO_THE_FLIGHT, ELEVATION = math.radians(-120.0), math.radians(22.0)
"""Where the camera of the overview stands: to the left behind the flight, and above it."""
IN_VIEW = math.tan(math.radians(26.0)) * np.array([0.85, 1.0])
"""Half of what it sees at a distance of 1, to the sides and up."""


@pytest.fixture(scope="module")
def flown():
    flight = {"duration_s": 0.1, "h_m": 500.0}
    return ft.fly(made_up_scenario(flight=flight, limits={"phi_deg": [-30.0, 40.0]}))


def path(flown, to, n=1201, seconds=10.0, **more):
    """A run that flies straight from the start to a place: north, east and down, m."""
    share = np.linspace(0.0, 1.0, n)
    north, east, down = np.outer(to, share)
    level = {"chi": math.atan2(to[1], to[0]), "gamma": 0.0, "phi": 0.0, "V_a": 25.0}
    table = dict.fromkeys(flown.runs[0].signals.columns, 0.0)
    table |= {"north": north, "east": east, "down": down, **level, **more}
    index = pd.Index(seconds * share, name="t")
    return replace(flown.runs[0], signals=pd.DataFrame(table, index=index, dtype=float))


def below(value, steps):
    """The largest of these steps, times a power of ten, that is not above a value."""
    return max(m * 10.0**e for e in range(-3, 7) for m in steps if m * 10.0**e <= value)


def eyes(found, width):
    """Positions and targets of the two cameras, that behind an aircraft so wide first."""
    ends = [
        np.array([x[0] for x in found.layout(f"EyeControls3D:{name}") if x])
        for name in ("position", "look_target")
    ]
    order = np.argsort(np.linalg.norm(ends[1] - [0.3 * width, 0.0, 0.0], axis=1))
    return [(ends[0][i], ends[1][i]) for i in order]


ENDS = [(100.0, 0.0, 0.0), (-40.0, 700.0, -90.0), (-2000.0, -1000.0, 30.0), (0.3, 0.2, 0.0)]


@pytest.mark.parametrize("to", ENDS, ids=str)
def test_grid_aircraft_and_cameras_are_as_large_as_the_flight(flown, to, tmp_path):
    """The drawn aircraft is at most a tenth of the flight; the grid has twelve lines in two."""
    found = recorded(flown, tmp_path, runs=[path(flown, to)])

    (key,) = {x.split("/")[3] for x in found.timed if x.startswith("/world/aircraft/")}
    scale = max(1.0, below(np.linalg.norm(to) / 10.0 / SPAN, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    spacing = below(max(*np.abs(to[:2]), 1.0) / 6.0, (1.0, 2.0, 5.0))
    grid = np.array(found.still("/world/ground", "LineStrips3D:strips"))
    low, high = (grid.min(axis=(0, 1)), grid.max(axis=(0, 1)))
    for i in (0, 1):
        least = spacing * math.floor(min(to[i], 0.0) / spacing + 1e-9)
        most = max(spacing * math.ceil(max(to[i], 0.0) / spacing - 1e-9), least + 2.0 * spacing)
        assert (low[i], high[i]) == pytest.approx((least, most), abs=FLOAT32)
        across = grid[np.ptp(grid[:, :, i], axis=1) == 0.0][:, 0, i]
        lines = np.arange(round(least / spacing), round(most / spacing) + 1) * spacing
        assert across == pytest.approx(lines, abs=FLOAT32 * max(1.0, spacing))
    assert low[2] == high[2] == pytest.approx(max(to[2], 0.0) + spacing / 2.0, abs=FLOAT32)
    corner = grid[0, 0]
    axes = np.array(found.still("/world/ground/axes", "Arrows3D:vectors"))
    assert axes == pytest.approx(2.0 * spacing * np.eye(3)[:2], abs=FLOAT32)
    assert np.array(found.still("/world/ground/axes", "Arrows3D:origins")) == pytest.approx(
        np.array([corner, corner])
    )
    wing, body, tail, fin = map(
        np.array, found.still(f"/world/aircraft/{key}/body", "LineStrips3D:strips")
    )
    for outline, wide in ((wing, 1.0), (tail, 0.32)):  # a rectangle across the fuselage
        assert outline[0].tolist() == outline[-1].tolist()
        assert len({*outline[:, 0].tolist()}) == len({*outline[:, 1].tolist()}) == 2
        assert outline[:, 1].max() == -outline[:, 1].min() == pytest.approx(wide * scale * SPAN / 2)
    assert wing[:, 0].max() > 0.0 > wing[:, 0].min() > tail[:, 0].max()
    assert np.ptp(wing[:, 0]) / (scale * SPAN) == pytest.approx(0.14)
    assert np.ptp(tail[:, 0]) / (scale * SPAN) == pytest.approx(0.08)
    assert (wing[:, 0].max(), body[0, 0]) == pytest.approx(
        (0.1 * scale * SPAN, 0.35 * scale * SPAN)
    )
    assert body[1, 0] == tail[:, 0].min() == fin[:, 0].min() == pytest.approx(-0.42 * scale * SPAN)
    assert fin[0].tolist() == [tail[:, 0].max(), 0.0, 0.0]
    assert np.ptp(fin[:, 2]) == -fin[1, 2] == pytest.approx(0.13 * scale * SPAN)
    assert fin[2, 2] == 0.0

    (behind, ahead), (position, target) = eyes(found, scale * SPAN)
    assert behind / (scale * SPAN) == pytest.approx([-2.0, -0.9, -1.0], rel=1e-5)
    assert ahead / (scale * SPAN) == pytest.approx([0.3, 0.0, 0.0], abs=1e-6)
    points = np.vstack([np.outer([0.0, 1.0], to), *grid, corner + axes])
    ends = np.array([points.min(axis=0), points.max(axis=0)])
    assert target == pytest.approx(ends.mean(axis=0), rel=1e-5, abs=1e-3)
    north, east = (np.ptp(ends, axis=0) * np.where(ends.mean(axis=0) < 0.0, -1.0, 1.0))[:2]
    azimuth = math.atan2(east, north) + TO_THE_FLIGHT
    back = [math.cos(ELEVATION) * math.cos(azimuth), math.cos(ELEVATION) * math.sin(azimuth)]
    back = np.array([*back, -math.sin(ELEVATION)])
    distance = np.linalg.norm(position - target)
    assert (position - target) / distance == pytest.approx(back, abs=1e-4)
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    sides = np.abs((points - target) @ np.array([right, np.cross(right, back)]).T)
    away = distance - (points - target) @ back
    seen = (sides + scale * SPAN / 2.0) / (IN_VIEW * away[:, None])
    assert seen.max() == pytest.approx(1.0, abs=1e-3)  # it sees all, and stands no further away


def test_paths_of_laws_are_dashed_and_numbers_stand_apart(flown, tmp_path):
    runs = [
        replace(path(flown, (100.0, 50.0 * k, 0.0)), provenance=replace(
            flown.runs[0].provenance, gains_name=f"g{k}")) for k in range(3)
    ]  # fmt: skip
    found = recorded(flown, tmp_path, runs=runs)

    for k in range(3):
        pieces = found.still(f"/world/paths/kinematic_g{k}", "LineStrips3D:strips")
        edges = np.linspace(0, 1200, 120).astype(int)
        assert [len(x) for x in pieces] == [b - a + 1 for a, b in edges.reshape(-1, 2)]
        starts = np.array([piece[0] for piece in pieces])
        assert starts[:, 0] == pytest.approx(edges[::2] / 12.0, abs=FLOAT32)
        (at,) = found.still(f"/world/paths/kinematic_g{k}/number", "Points3D:positions")
        assert at[0] == pytest.approx((1200 - k * 1201 // 12) / 12.0, abs=FLOAT32)
    text = found.still("/how_to_read/Overview", "TextDocument:text")[0]
    numbers = [float(x) for x in re.findall(r"([\d.]+) (?:times|m\b)", text)]
    assert numbers == [3.0, 10.0]
    assert "**Hue:** gains" in text
    assert "dashed, outline" in text
    alone = recorded(flown, tmp_path / "one", runs=runs[:1])
    assert "**Colour:** plant" in alone.still("/how_to_read/Overview", "TextDocument:text")[0]


def test_arrows_of_long_flights_are_five_hundred_and_paths_four_thousand_points(flown, tmp_path):
    wind = {"wind_north": 3.0, "wind_east": -4.0, "wind_down": 1.0}
    run = path(flown, (1000.0, 0.0, 0.0), n=12_501, seconds=250.0, chi=0.5, **wind)

    found = recorded(flown, tmp_path, runs=[run])

    (frame,) = {x for x in found.timed if re.fullmatch(r"/world/aircraft/[^/]+", x)}
    arrows = found.values(f"{frame}/velocity", "Arrows3D:vectors")[:, 0]
    assert len(arrows) == 500
    assert found.seconds(f"{frame}/velocity")[[0, -1]].tolist() == [0, 250_000_000_000]
    size = np.linalg.norm(arrows, axis=1)
    reach = 0.9 * SPAN * below(1000.0 / 10.0 / SPAN, (1.0, 1.5, 2.0, 3.0, 5.0, 7.0))
    assert size == pytest.approx(reach, rel=1e-5)
    blown = found.values(f"{frame}/wind", "Arrows3D:vectors")[:, 0]
    across = (3.0 - 4.0j) * np.exp(-0.5j)  # in axes that turn with the course
    wanted = 4.0 * reach / 25.0 * np.array([across.real, across.imag, 1.0])
    assert blown == pytest.approx(np.tile(wanted, (500, 1)), rel=1e-4)
    moved = found.values(frame, "Transform3D:translation")
    assert len(moved) == 12_000
    shadow = found.still("/world/shadows/kinematic_paper", "LineStrips3D:strips")[0]
    assert len(shadow) == 4000
    for still in ({}, dict.fromkeys(wind, 0.9e-3)):
        calm = recorded(flown, tmp_path / f"calm{len(still)}", runs=[path(flown, ENDS[0], **still)])
        assert not [name for name in calm.timed if name.endswith("/wind")]
    lost = path(flown, ENDS[0], V_a=np.nan)
    none = recorded(flown, tmp_path / "lost", runs=[lost])
    assert not np.nan_to_num(none.values(f"{frame}/velocity", "Arrows3D:vectors")).any()


# What signals of a user's law lie between, on a tab of so many plots that each has few labels.
BETWEEN = [(0.0, 1.0), (-9.0, 9.0), (0.2, 0.9), (1.1, 1.9), (3.6, 9.4), (-0.4, 0.5), (2.06, 2.15)]
BETWEEN += [(-1.0, 0.0), (12.0, 29.0), (0.94, 1.05), (101.0, 109.0), (-130.0, -101.0), (0.0, 2e-7)]


def range_of(low, high, labels):
    """The axis of a plot with room for so many labels, of which two at least must be there."""
    step = 10.0 ** math.ceil(math.log10((high - low) / max(labels - 2.0, 2.0)))
    first, last = low, high
    while math.floor(last / step + 1e-12) - math.ceil(first / step - 1e-12) < 1:
        up = step * (math.floor(last / step + 1e-12) + 1.0)
        down = step * (math.ceil(first / step - 1e-12) - 1.0)
        first, last = (first, up) if up - last <= first - down + 1e-12 else (down, last)
    if last - first <= 2.2 * (high - low):
        low, high = first, last
    return low - 0.05 * (high - low), high + 0.05 * (high - low)


@pytest.mark.parametrize("count", [2, 30])
def test_axes_of_plots_hold_their_signals_and_two_labels(flown, count, tmp_path):
    between = [BETWEEN[i % len(BETWEEN)] for i in range(count)]
    swing = np.where(np.arange(1201) % 2, 1.0, 0.0)
    own = {f"x{i}": low + (high - low) * swing for i, (low, high) in enumerate(between)}
    run = replace(path(flown, ENDS[0], **own), units=dict.fromkeys(own, "m"))

    found = recorded(flown, tmp_path, runs=[run])

    columns = 1 if count == 2 else 4
    rows = math.ceil(count / columns)
    wanted = [range_of(*ends, 28.0 / rows) for ends in between if np.ptp(ends) > 1e-6]
    ranges = [x[0] for x in found.layout("ScalarAxis:range") if x]
    for ends in wanted:
        assert any(x == pytest.approx(ends, rel=1e-9) for x in ranges), ends
    names = {x[0] for x in found.layout("ViewBlueprint:display_name") if x}
    assert {f"x{i} [m]" for i in range(count)} <= names
    grids = [x[0] for x in found.layout("ContainerBlueprint:grid_columns") if x]
    assert max(grids) == (columns if count == 30 else max(grids))


def test_the_layout_gives_each_part_its_share(flown, tmp_path):
    found = recorded(flown, tmp_path, runs=[path(flown, ENDS[0], chi_err=0.1, gamma_err=0.2)])

    rows = [x for x in found.layout("ContainerBlueprint:row_shares") if x]
    assert {tuple(np.round(x, 6)) for x in rows} >= {(0.05, 0.95)}
    (across,) = [x for x in found.layout("ContainerBlueprint:col_shares") if x and len(x) == 3]
    assert across == pytest.approx([0.46, 0.31, 0.23])
    shown = found.layout("PlotLegend:visible")  # a legend would cover small plots
    assert shown
    assert not any(x[0] for x in shown if x)
    ups = [x[0] for x in found.layout("EyeControls3D:eye_up") if x]
    assert [list(x) for x in ups] == [[0.0, 0.0, -1.0]] * 2
    assert not any(x[0] for x in found.layout("ViewportBlueprint:auto_layout") if x)
    origins = {x[0] for x in found.layout("ViewBlueprint:space_origin") if x}
    assert {"/plots/chi_err", "/plots/gamma_err"} <= {f"/{x.strip('/')}" for x in origins}
    assert found.layout("ContainerBlueprint:active_tab") is not None
    assert [x[0] for x in found.layout("TimeAxis:link") if x]
    long = recorded(
        flown, tmp_path / "long", runs=[path(flown, ENDS[0], seconds=60.02, chi_err=0.1)]
    )
    # a shared axis would open with half a minute to each side
    assert not [x for x in long.layout("TimeAxis:link") if x and x[0] == 2]


def test_the_path_over_ground_has_a_height_and_a_speed(flown, tmp_path):
    """A climb of 3 m/s with 10 m/s over ground, from 500 m."""
    found = recorded(flown, tmp_path, runs=[path(flown, (60.0, 80.0, -30.0))])

    t = np.linspace(0.0, 10.0, 1201)
    assert found.values("/plots/h/kinematic_paper")[:, 0] == pytest.approx(500.0 + 3.0 * t)
    assert found.values("/plots/V_g/kinematic_paper")[:, 0] == pytest.approx(10.0)
    assert found.values("/plots/phi/_limits").tolist() == [[-30.0, 40.0]] * 2
