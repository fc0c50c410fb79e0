"""What is in a recording, read back from the file, against what was put in."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from flighttune.outputs.drawing.chart import MOST
from flighttune.outputs.recording import entities, plots
from flighttune.outputs.recording.record import write_recording

FLOAT32_POSITION = 1e-4
"""Positions are float32 in Rerun: 0.03 mm at 500 m, m."""

FLOAT32_ROTATION = 1e-6
"""Entries of a rotation matrix from a float32 quaternion, 1."""

DEGREES = 180.0 / np.pi
LARGEST = 30e6
"""Bytes of 600 s at 50 Hz with 40 signals."""


class Contents:
    """Columns of a recording by entity: static ones, and those over time."""

    def __init__(self, path):
        reader = RrdReader(path)
        self.static, self.timed = {}, {}
        self.application = reader.recordings()[0].application_id
        self.identity = reader.recordings()[0].recording_id
        for chunk in reader.stream().to_chunks():
            batch = chunk.to_record_batch()
            columns = {name: batch.column(name) for name in batch.schema.names}
            into = self.static if chunk.is_static else self.timed
            into.setdefault(chunk.entity_path, {}).update(columns)
        self.blueprint = [
            chunk.to_record_batch()
            for chunk in reader.stream(store=reader.blueprints()[0]).to_chunks()
        ]

    def nanoseconds(self, entity):
        return self.timed[entity][entities.TIMELINE].to_numpy(zero_copy_only=False).astype(np.int64)

    def values(self, entity, component="Scalars:scalars"):
        return np.array(self.timed[entity][component].to_pylist())


@pytest.fixture(scope="module")
def contents(recording):
    return Contents(recording)


KEYS = ("kinematic_paper", "jsbsim_aerosonde_paper", "kinematic_tuned", "jsbsim_aerosonde_tuned")


@pytest.mark.slow
def test_times_are_exact_to_the_nanosecond(contents, four_runs):
    for key, run in zip(KEYS, four_runs, strict=True):
        wanted = [round(1e9 * t) for t in run.signals.index]

        assert contents.nanoseconds(f"/plots/V_a/{key}").tolist() == wanted
        assert contents.nanoseconds(f"/world/aircraft/{key}/body").tolist() == wanted


@pytest.mark.parametrize(
    "plot", [p for tab in plots.TABS.values() for p in tab], ids=lambda p: p.signal
)
def test_every_plot_holds_the_signals_of_every_run_that_has_them(contents, four_runs, plot):
    drawn = entities.runs_to_draw(four_runs)
    for key, one in zip(KEYS, plots.with_derived(drawn), strict=True):
        run = one.run
        entity = f"/plots/{plot.signal}/{key}"
        if plot.signal not in run.signals or plot.signal.startswith("wind") or "d_" in plot.signal:
            assert entity not in contents.timed
            continue
        wanted = run.signals[list(plot.signals)].to_numpy()
        factor = DEGREES if "deg" in plot.heading else 1.0

        assert np.array_equal(contents.values(entity), wanted * factor, equal_nan=True)


def test_reference_and_limits_are_drawn_once(contents):
    assert np.allclose(contents.values("/plots/chi/_reference"), 60.0, rtol=0.0, atol=1e-12)
    assert contents.values("/plots/phi/_limits").tolist() == [[-45.0, 45.0]] * 2
    assert contents.values("/plots/n_z/_limits").tolist() == [[0.0, 2.0]] * 2
    assert contents.nanoseconds("/plots/phi/_limits").tolist() == [0, 20_000_000_000]
    # a tenth beyond the longest flight
    assert contents.nanoseconds("/plots/phi/_axis").tolist() == [0, 22_000_000_000]


def test_a_course_through_south_has_no_jump(four_runs, tmp_path):
    run = four_runs[0]
    turning = run.signals.copy()
    turning["chi"] = (np.linspace(3.0, 3.4, len(turning)) + np.pi) % (2.0 * np.pi) - np.pi
    path = tmp_path / "turn.rrd"
    write_recording([replace(run, signals=turning)], path, page="", title="Turn")
    drawn = Contents(path).values("/plots/chi/kinematic_paper")

    assert np.ptp(turning["chi"]) > 6.0
    assert np.allclose(drawn[:, 0], np.rad2deg(np.linspace(3.0, 3.4, len(turning))))


def test_aircraft_are_where_they_flew_with_their_attitude(contents, four_runs):
    for key, run in zip(KEYS, four_runs, strict=True):
        frame = f"/world/aircraft/{key}"
        moved = contents.values(frame, "Transform3D:translation")[:, 0]
        carried = contents.values(frame, "Transform3D:quaternion")[:, 0]
        turned = contents.values(f"{frame}/body", "Transform3D:quaternion")[:, 0]
        at = run.signals.iloc[123]
        outer, inner = (Rotation.from_quat(x[123]).as_matrix() for x in (carried, turned))
        body = outer @ inner
        pitch, heading = at.get("theta", at["gamma"]), at.get("psi", at["chi"])
        nose = [np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)]
        right_wing_down = np.sin(at["phi"]) * np.cos(pitch)

        flown = run.signals[["north", "east", "down"]].to_numpy()
        assert np.allclose(moved, flown, rtol=0.0, atol=FLOAT32_POSITION)
        assert np.allclose(body[:, 0], nose, rtol=0.0, atol=FLOAT32_ROTATION)
        assert body[2, 1] == pytest.approx(right_wing_down, abs=FLOAT32_ROTATION)


def test_paths_lie_where_they_were_flown_with_their_shadows_and_numbers(contents, four_runs):
    (lines,) = contents.static["/world/ground"]["LineStrips3D:strips"].to_pylist()
    floor = lines[0][0][2]
    for number, (key, run) in enumerate(zip(KEYS, four_runs, strict=True), start=1):
        flown = run.signals[["north", "east", "down"]].to_numpy()
        assert floor > flown[:, 2].max()
        (pieces,) = contents.static[f"/world/paths/{key}"]["LineStrips3D:strips"].to_pylist()
        # the path of a law is dashed
        assert (len(pieces) == 1) == (run.provenance.aircraft is not None)
        assert pieces[0][0] == pytest.approx(flown[0], abs=FLOAT32_POSITION)
        assert pieces[-1][-1] == pytest.approx(flown[-1], abs=FLOAT32_POSITION)
        shadow = contents.static[f"/world/shadows/{key}"]["LineStrips3D:strips"].to_pylist()[0][0]
        assert shadow[-1] == pytest.approx([*flown[-1, :2], floor], abs=FLOAT32_POSITION)
        name = contents.static[f"/world/paths/{key}/number"]
        assert name["Points3D:labels"].to_pylist() == [[str(number)]]
        ((at,),) = name["Points3D:positions"].to_pylist()
        back = len(flown) - 1 - (number - 1) * len(flown) // 12
        assert at == pytest.approx(flown[back], abs=FLOAT32_POSITION)


def test_world_axes_are_north_east_down(contents):
    forward_right_down = contents.static["/world"]["ViewCoordinates:xyz"].to_pylist()[0][0]

    assert list(forward_right_down) == [5, 3, 2]


def test_a_run_is_drawn_as_far_as_it_flew_and_on_the_page_that_the_caller_wrote(contents):
    assert contents.nanoseconds("/plots/chi/jsbsim_aerosonde_bold")[-1] == 7_000_000_000
    assert not [path for path in [*contents.timed, *contents.static] if "strict" in path]
    assert contents.static["/page"]["TextDocument:text"].to_pylist() == [["# Page\n"]]
    ((names,),) = contents.static["/runs"]["TextDocument:text"].to_pylist()
    assert names.splitlines()[0] == "1. kinematic / paper: light blue, completed"
    assert "5. jsbsim:aerosonde / bold: green, left envelope: alpha 16.3 deg" in names


def blueprint_values(contents, component):
    return [
        value
        for batch in contents.blueprint
        if component in batch.schema.names
        for value in batch.column(component).to_pylist()
    ]


def test_it_opens_paused_with_linked_time_axes_and_nothing_added_by_the_viewer(contents):
    assert blueprint_values(contents, "TimePanelBlueprint:play_state") == [[1]]
    assert blueprint_values(contents, "TimePanelBlueprint:timeline") == [[entities.TIMELINE]]
    assert blueprint_values(contents, "ViewportBlueprint:auto_views") == [[False]]
    assert set(map(tuple, blueprint_values(contents, "TimeAxis:link"))) == {(2,)}


@pytest.mark.slow
def test_its_layout_is_active_before_its_data(recording):
    """While data stream in, the viewer makes a layout of its own, which no default replaces."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", recording]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    before, _, after = printed.partition("make_active: true")

    assert "/plots/" in after
    assert "/plots/" not in before


@pytest.mark.slow
def test_tabs_are_those_that_have_something_to_show(contents, four_runs, in_sinusoid, tmp_path):
    write_recording([*four_runs, in_sinusoid], tmp_path / "windy.rrd", page="", title="Flight")
    other = Contents(tmp_path / "windy.rrd")
    calm, windy = (
        {name for (name,) in blueprint_values(c, "ContainerBlueprint:display_name")}
        for c in (contents, other)
    )

    assert calm >= {"Overview", "Tracking", "Aircraft and air", "Law", "Scenario and metrics"}
    assert windy == calm
    drawn = {path.split("/")[2] for path in other.timed if path.startswith("/plots/")}
    assert drawn - {
        path.split("/")[2] for path in contents.timed if path.startswith("/plots/")
    } == {"d_chi"}
    # Both can be open in one viewer.
    assert other.identity != contents.identity
    assert other.application == contents.application == "flighttune-flight"


def test_a_position_that_is_no_number_does_not_reach_the_scene(four_runs, tmp_path):
    odd = four_runs[0].signals.copy()
    odd.loc[odd.index[-3:], "north"] = np.nan
    write_recording([replace(four_runs[0], signals=odd)], tmp_path / "odd.rrd", page="", title="x")
    scene = Contents(tmp_path / "odd.rrd")

    moved = scene.values("/world/aircraft/kinematic_paper", "Transform3D:translation")
    assert len(moved) == len(odd) - 3
    assert np.isfinite(moved).all()


def test_what_sensors_showed_is_drawn_faintly_below_the_run_beside_its_signal(
    four_runs, sensed, tmp_path
):
    write_recording([four_runs[0], sensed], tmp_path / "sensed.rrd", page="", title="Sensed")
    found, key = Contents(tmp_path / "sensed.rrd"), KEYS[3]

    for signal, factor in (("chi", DEGREES), ("gamma", DEGREES), ("V_a", 1.0)):
        path = f"/plots/{signal}/_measured/{key}"
        true = found.values(f"/plots/{signal}/{key}")[:, 0]
        error = (sensed.signals[f"{signal}_meas"] - sensed.signals[signal]).to_numpy()
        assert np.allclose(found.values(path)[:, 0] - true, error * factor, rtol=0.0, atol=1e-9)
        (name,) = found.static[path]["SeriesLines:names"].to_pylist()[0]
        assert name == f"{sensed.label}, {signal}_meas"
        assert sorted([path, f"/plots/{signal}/{key}"])[0] == path  # in this order it is drawn
    assert np.ptp(sensed.signals["chi"]) > 6.0  # through south, without a jump in the line
    assert np.ptp(found.values(f"/plots/chi/_measured/{key}")) < 180.0
    assert not [path for path in found.timed if "_measured" in path and KEYS[0] in path]


@pytest.mark.slow
def test_ten_minutes_are_drawn_with_every_peak_in_thirty_megabytes(four_runs, tmp_path):
    t = np.arange(30_001) * 0.02
    names = four_runs[-1].signals.columns[:40]
    noise = 0.2 * np.random.default_rng(1).normal(size=(len(t), len(names)))  # incompressible
    signals = pd.DataFrame(noise, columns=names, index=pd.Index(t, name="t"))
    signals["V_a"] = 25.0
    signals["north"], signals["east"], signals["down"] = 20.0 * t, 5.0 * t, -t
    path = tmp_path / "long.rrd"

    write_recording([replace(four_runs[0], signals=signals)], path, page="# Long\n", title="Long")

    drawn = Contents(path).values("/plots/alpha/kinematic_paper")[:, 0]
    alpha = np.rad2deg(signals["alpha"].to_numpy())
    assert path.stat().st_size < LARGEST
    assert MOST <= len(drawn) <= 1.1 * MOST
    assert drawn.min() == alpha.min()
    assert drawn.max() == alpha.max()
