"""What is in a recording, read back from the file, against what was flown."""

import re
import subprocess
import sys
import tomllib
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

import flighttune as ft

FLOAT32 = 1e-4
"""Positions are float32 in Rerun: 0.03 mm at 500 m, m."""
DEG = 180.0 / np.pi
G, V = 9.81, 25.0
KEYS = {
    "kinematic / paper": "kinematic_paper", "kinematic / K1": "kinematic_K1",
    "jsbsim:aerosonde / paper": "jsbsim_aerosonde_paper",
    "jsbsim:aerosonde / K1": "jsbsim_aerosonde_K1",
}  # fmt: skip
IN_DEGREES = (
    *("chi", "gamma", "phi", "phi_cmd", "chi_err", "gamma_err", "alpha"),
    *("theta", "elevator", "aileron", "rudder", "beta"),
)


class Contents:
    """Columns of a recording by entity: static ones, and those over time."""

    def __init__(self, path):
        reader = RrdReader(path)
        self.static, self.timed = {}, {}
        self.application = reader.recordings()[0].application_id
        self.identity = reader.recordings()[0].recording_id
        for chunk in reader.stream().to_chunks():
            batch = chunk.to_record_batch()
            into = self.static if chunk.is_static else self.timed
            columns = {name: batch.column(name) for name in batch.schema.names}
            into.setdefault(chunk.entity_path, {}).update(columns)
        stored = reader.stream(store=reader.blueprints()[0]).to_chunks()
        self.blueprint = [chunk.to_record_batch() for chunk in stored]

    def seconds(self, entity):
        times = self.timed[entity]["flight_time"].to_numpy(zero_copy_only=False)
        return times.astype(np.int64)

    def values(self, entity, component="Scalars:scalars"):
        return np.array(self.timed[entity][component].to_pylist())

    def still(self, entity, component):
        return self.static[entity][component].to_pylist()[0]

    def layout(self, component):
        return [
            value for batch in self.blueprint if component in batch.schema.names
            for value in batch.column(component).to_pylist()
        ]  # fmt: skip


def recorded(flown, folder, *, runs=None, **changes):
    """The recording of a flight, or of the same with other runs."""
    made = replace(flown, runs=tuple(flown.runs if runs is None else runs), **changes)
    return Contents(ft.record(made, folder).recording)


@pytest.fixture(scope="module")
def flown(results):
    return results.of("flown")


@pytest.fixture(scope="module")
def contents(flown, tmp_path_factory):
    return recorded(flown, tmp_path_factory.mktemp("recorded"))


def test_every_plot_holds_the_signals_of_every_run_at_its_nanoseconds(contents, flown):
    plots = {path.split("/")[2] for path in contents.timed if path.startswith("/plots/")}
    assert {"chi", "gamma", "phi", "n_z", "chi_err", "V_a", "alpha", "step_chi"} <= plots
    for run in flown.runs:
        key = KEYS[run.label]
        wanted = [round(1e9 * t) for t in run.signals.index]
        assert contents.seconds(f"/world/aircraft/{key}/body").tolist() == wanted
        for plot in plots & {*run.signals}:
            entity = f"/plots/{plot}/{key}"
            shown = contents.values(entity)[:, 0]
            factor = DEG if plot in IN_DEGREES else 1.0
            values = run.signals[plot].to_numpy()
            if plot in IN_DEGREES or plot in ("n_z", "V_a", "h", "throttle", "V_g"):
                assert shown == pytest.approx(factor * values, nan_ok=True), plot
            assert contents.seconds(entity).tolist() == wanted


def test_references_limits_and_axes_are_drawn_once(contents):
    assert np.allclose(contents.values("/plots/chi/_reference"), 0.0)
    assert contents.values("/plots/phi/_limits").tolist() == [[-45.0, 45.0]] * 2
    assert contents.values("/plots/n_z/_limits").tolist() == [[-2.1, 2.1]] * 2
    assert contents.seconds("/plots/phi/_limits").tolist() == [0, 3_000_000_000]
    # a tenth beyond the longest flight
    assert contents.seconds("/plots/phi/_axis").tolist() == [0, 3_300_000_000]
    ranges = np.array([x[0] for x in contents.layout("ScalarAxis:range") if x])
    assert (ranges[:, 0] < ranges[:, 1]).all()
    assert any(low < -45.0 and high > 45.0 and high - low < 200.0 for low, high in ranges)


def test_derived_signals_add_up_to_what_the_law_leaves_out(contents, flown):
    """Parts of the rates of an aircraft, the step from the plant below, and distances."""
    runs = {run.label: run for run in flown.runs}
    for gains in ("paper", "K1"):
        law, craft = (runs[f"{plant} / {gains}"] for plant in ("kinematic", "jsbsim:aerosonde"))
        key, s = KEYS[craft.label], craft.signals
        rates = {
            "chi": G / V * np.tan(s["phi_cmd"].to_numpy()),
            "gamma": G / V * (s["n_z_cmd"] * np.cos(s["phi_cmd"]) - np.cos(s["gamma"])).to_numpy(),
        }
        for channel, rate in rates.items():
            total = sum(
                contents.values(f"/plots/{part}_{channel}/{key}")[:, 0]
                for part in ("lift", "lag", "rest")
            )
            actual = np.gradient(np.unwrap(s[channel].to_numpy()), craft.t)
            assert total == pytest.approx(DEG * (actual - rate), abs=1e-6)
            step = contents.values(f"/plots/step_{channel}/{key}")[:, 0]
            apart = s[channel].to_numpy() - law.signals[channel].to_numpy()
            assert step == pytest.approx(DEG * apart)
        ned = ["north", "east", "down"]
        distance = np.linalg.norm(s[ned].to_numpy() - law.signals[ned].to_numpy(), axis=1)
        assert contents.values(f"/plots/distance/{key}")[:, 0] == pytest.approx(distance)
        height = contents.values(f"/plots/h/{KEYS[law.label]}")[:, 0]
        assert height == pytest.approx(1000.0 - law.signals["down"].to_numpy())
        over_ground = contents.values(f"/plots/V_g/{KEYS[law.label]}")[:, 0]
        level = V * np.cos(law.signals["gamma"].to_numpy())
        assert over_ground[1:-1] == pytest.approx(level[1:-1], rel=2e-3)


def test_aircraft_are_where_they_flew_with_their_attitude_and_arrows(contents, flown):
    widths = set()
    for run in flown.runs:
        frame, s = f"/world/aircraft/{KEYS[run.label]}", run.signals
        moved = contents.values(frame, "Transform3D:translation")[:, 0]
        assert moved == pytest.approx(s[["north", "east", "down"]].to_numpy(), abs=FLOAT32)
        carried = contents.values(frame, "Transform3D:quaternion")[:, 0]
        turned = contents.values(f"{frame}/body", "Transform3D:quaternion")[:, 0]
        body = (Rotation.from_quat(carried) * Rotation.from_quat(turned)).as_matrix()
        pitch, heading = (
            s.get(a, s[b]).to_numpy() for a, b in (("theta", "gamma"), ("psi", "chi"))
        )
        nose = [np.cos(pitch) * np.cos(heading), np.cos(pitch) * np.sin(heading), -np.sin(pitch)]
        assert body[:, :, 0] == pytest.approx(np.transpose(nose), abs=1e-6)
        assert body[:, 2, 1] == pytest.approx(np.sin(s["phi"]) * np.cos(pitch), abs=1e-6)
        level = Rotation.from_quat(carried).apply([1.0, 0.0, 0.0])
        assert level == pytest.approx(
            np.column_stack([np.cos(s["chi"]), np.sin(s["chi"]), 0.0 * s["chi"]]), abs=1e-6
        )
        velocity = contents.values(f"{frame}/velocity", "Arrows3D:vectors")[:, 0]
        size = np.linalg.norm(velocity, axis=1)
        speed = s.get("V_g", s["V_a"]).to_numpy()
        assert size / size[0] == pytest.approx(speed / speed[0], rel=1e-4)
        reach = size[0] / speed[0] * s["V_a"].iloc[0]
        assert -velocity[:, 2] / size == pytest.approx(np.sin(s["gamma"]), abs=1e-5)
        widths.add(round(float(reach) / 0.9, 2))
        if run.provenance.aircraft:
            ((scale, *_),) = contents.still(f"{frame}/body", "InstancePoses3D:scales")
            assert scale * 2.9 == pytest.approx(reach / 0.9, rel=0.01)
    (width,) = widths  # a round number of spans, about a tenth of the flight
    everywhere = np.vstack([run.signals[["north", "east", "down"]] for run in flown.runs])
    extent = np.linalg.norm(np.ptp(everywhere, axis=0))
    span = width / round(width / 2.9)
    assert span == pytest.approx(2.9, rel=0.02)
    assert 0.04 * extent < width <= max(0.101 * extent, 1.01 * span)


def test_paths_lie_where_they_were_flown_above_their_shadows(contents, flown):
    lines = np.array(contents.still("/world/ground", "LineStrips3D:strips"))
    floor = lines[0, 0, 2]
    for number, run in enumerate(flown.runs, start=1):
        key, path = KEYS[run.label], run.signals[["north", "east", "down"]].to_numpy()
        pieces = contents.still(f"/world/paths/{key}", "LineStrips3D:strips")
        # the path of a law is dashed, with gaps as long as the dashes
        assert (len(pieces) == 1) == (run.provenance.aircraft is not None)
        assert pieces[0][0] == pytest.approx(path[0], abs=FLOAT32)
        if len(pieces) > 1:
            drawn = sum(len(piece) - 1 for piece in pieces)
            assert drawn == pytest.approx(0.5 * len(path), rel=0.1)
        assert pieces[-1][-1] == pytest.approx(path[-1], abs=0.8)
        shadow = contents.still(f"/world/shadows/{key}", "LineStrips3D:strips")[0]
        assert shadow[-1] == pytest.approx([*path[-1, :2], floor], abs=FLOAT32)
        assert contents.still(f"/world/paths/{key}/number", "Points3D:labels") == [str(number)]
        (at,) = contents.still(f"/world/paths/{key}/number", "Points3D:positions")
        assert at == pytest.approx(
            path[len(path) - 1 - (number - 1) * len(path) // 12], abs=FLOAT32
        )
    assert list(contents.still("/world", "ViewCoordinates:xyz")[0]) == [5, 3, 2]  # NED


def test_it_opens_paused_with_linked_axes_tabs_and_words(contents, flown, tmp_path):
    assert contents.layout("TimePanelBlueprint:play_state") == [[1]]
    assert contents.layout("TimePanelBlueprint:timeline") == [["flight_time"]]
    assert contents.layout("ViewportBlueprint:auto_views") == [[False]]
    assert {*map(tuple, contents.layout("TimeAxis:link"))} == {(2,)}
    tabs = {name for (name,) in contents.layout("ContainerBlueprint:display_name")}
    assert tabs >= {"Overview", "Tracking", "Aircraft and air", "Law", "Scenario and metrics"}
    assert contents.application == "flighttune-turn"
    assert recorded(flown, tmp_path).identity != contents.identity
    (page,) = contents.still("/page", "TextDocument:text")
    (text,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    assert tomllib.loads(text) == flown.runs[0].provenance.scenario
    rows = {}
    for line in page.splitlines():
        cells = [x.strip() for x in line.strip("|").split("|")]
        rows.setdefault(cells[0], cells[1:])
    for run in flown.runs:
        assert "3.00" in rows[run.label]
    for name, found in flown.indicators.items():
        numbers = [float(x) for x in rows[name][:3]]
        assert numbers == pytest.approx([found.R_K, found.I_K, found.E_K], rel=1e-3)
    (names,) = contents.still("/runs", "TextDocument:text")
    assert [line.partition(":")[0] for line in names.splitlines()[:4]] == [
        f"{n}. {run.label.split(':')[0]}" for n, run in enumerate(flown.runs, 1)
    ]


@pytest.mark.soak
def test_its_layout_is_active_before_its_data(flown, tmp_path):
    """While data stream in, the viewer makes a layout of its own, which no default replaces."""
    path = ft.record(flown, tmp_path).recording
    command = [sys.executable, "-m", "rerun", "rrd", "print", path]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    before, _, after = printed.partition("make_active: true")

    assert "/plots/" in after
    assert "/plots/" not in before


def test_what_ended_early_is_drawn_to_its_end_and_what_did_not_fly_is_not(flown, tmp_path):
    law, *_, craft = flown.runs
    cut = replace(craft, signals=craft.signals.loc[:2.0], status="left_envelope", reason="alpha")
    never = replace(law, signals=law.signals[:0], status="no_gains", reason="none")
    odd = law.signals.copy()
    odd.loc[odd.index[-3:], "north"] = np.nan
    turning = odd.assign(chi=(np.linspace(3.0, 3.4, len(odd)) + np.pi) % (2.0 * np.pi) - np.pi)
    named = replace(never.provenance, gains_name="strict")
    runs = [replace(law, signals=turning), cut, replace(never, provenance=named)]

    found = recorded(flown, tmp_path, runs=runs)

    assert found.seconds("/plots/chi/jsbsim_aerosonde_K1")[-1] == 2_000_000_000
    assert not [path for path in [*found.timed, *found.static] if "strict" in path]
    (names,) = found.still("/runs", "TextDocument:text")
    assert "left envelope: alpha" in names
    # a course through south has no jump, and a position that is no number is not in the scene
    shown = found.values("/plots/chi/kinematic_paper")[:, 0]
    assert shown == pytest.approx(DEG * np.linspace(3.0, 3.4, len(odd)))
    moved = found.values("/world/aircraft/kinematic_paper", "Transform3D:translation")
    assert len(moved) == len(odd) - 3
    assert np.isfinite(moved).all()
    chased = [str(x) for x in found.layout("ViewBlueprint:space_origin")]
    assert any("jsbsim_aerosonde_K1" in entity for entity in chased)  # the one that ended early


def test_what_sensors_showed_is_drawn_beside_the_signal_of_its_run(flown, tmp_path):
    law, *_, craft = flown.runs
    swing = np.sin(7.0 * craft.t)
    wrapped = (craft.signals["chi"] + 2.9 + np.pi) % (2.0 * np.pi) - np.pi
    signals = craft.signals.assign(
        chi=wrapped, chi_meas=wrapped + 0.02 * swing, V_a_meas=craft.signals["V_a"] + swing,
        wind_north=-3.0, wind_east=4.0, wind_down=0.0,
    )  # fmt: skip

    found = recorded(flown, tmp_path, runs=[law, replace(craft, signals=signals)])

    key = KEYS[craft.label]
    for signal, size in (("chi", 0.02 * DEG), ("V_a", 1.0)):
        measured = found.values(f"/plots/{signal}/_measured/{key}")[:, 0]
        true = found.values(f"/plots/{signal}/{key}")[:, 0]
        assert measured - true == pytest.approx(size * swing, abs=1e-9)
    assert not [path for path in found.timed if "_measured" in path and KEYS[law.label] in path]
    frame = f"/world/aircraft/{key}"
    wind = found.values(f"{frame}/wind", "Arrows3D:vectors")[:, 0]
    velocity = found.values(f"{frame}/velocity", "Arrows3D:vectors")[:, 0]
    scale = 4.0 * np.linalg.norm(velocity[0]) / craft.signals["V_a"].iloc[0]
    assert np.linalg.norm(wind, axis=1) == pytest.approx(5.0 * scale, rel=0.05)
    turned = Rotation.from_quat(found.values(frame, "Transform3D:quaternion")[:, 0]).apply(wind)
    assert np.degrees(np.arctan2(turned[:, 1], turned[:, 0])) == pytest.approx(
        np.degrees(np.arctan2(4.0, -3.0)), abs=0.01
    )


@pytest.mark.slow
def test_a_route_has_its_corridor_waypoints_and_a_map(results, tmp_path):
    """The corridor is the band to the right of the path and below it."""
    band = results.of("corridor")
    alone = {"plant": [{"kind": "kinematic"}]}
    scenario = ft.scenario_from(band.flights.scenario.as_dict() | alone)
    flown = ft.fly(scenario, "exact:paper")
    (run,) = flown.runs
    claim = band.on(run)
    found = recorded(flown, tmp_path, runs=[replace(run, claims=(claim,))])
    (key,) = {path.split("/")[3] for path in found.timed if path.startswith("/world/aircraft/")}
    walls = found.still(f"/world/route/corridor/{key}/walls", "Mesh3D:vertex_positions")
    corners = np.array(walls).reshape(-1, 4, 3)
    north, east, down = (corners[:, :, i] for i in range(3))
    first = np.abs(north.mean(axis=1) - 60.0).argmin()  # on the leg to the north
    rows = {row["signal"]: row for row in band.answer().tables[0].records}
    side, height = rows["cross_track"], rows["height_err"]
    assert side["low"] - 0.1 <= east[first].min() < 0.0 < east[first].max() <= side["high"] + 0.1
    assert (
        height["low"] - 0.1 <= down[first].min() < 0.0 < down[first].max() <= height["high"] + 0.1
    )
    marks = found.still("/world/route/waypoints", "Points3D:positions")
    assert np.array(marks)[:, :2] == pytest.approx(np.array([[0, 0], [300, 0], [300, 250]]))
    assert found.still("/world/route/waypoints", "Points3D:labels") == ["WP1", "WP2", "WP3"]
    points = np.array(found.still("/map/_waypoints", "GeoPoints:positions"))
    # At 47.4 deg a degree of longitude is 75.5 km on WGS 84, and one of latitude 111.18 km.
    assert points[0] == pytest.approx([47.4, 8.5])
    assert points[2] == pytest.approx([47.4 + 0.3 / 111.18, 8.5 + 0.25 / 75.5], abs=2e-6)
    bounds = found.values(f"/plots/cross_track/{key}_claim_0")
    assert np.nanmin(bounds[:, 0]) == pytest.approx(side["low"], abs=0.01)
    assert np.nanmax(bounds[:, 1]) == pytest.approx(side["high"], abs=0.01)


@pytest.mark.soak
def test_ten_minutes_are_drawn_with_every_peak_in_thirty_megabytes(flown, tmp_path):
    craft = flown.runs[-1]
    t = np.arange(30_001) * 0.02
    names = craft.signals.columns[:40]
    noise = 0.2 * np.random.default_rng(1).normal(size=(len(t), len(names)))  # incompressible
    signals = pd.DataFrame(noise, columns=names, index=pd.Index(t, name="t"))
    signals["V_a"] = 25.0
    signals["north"], signals["east"], signals["down"] = 20.0 * t, 5.0 * t, -t

    found = recorded(flown, tmp_path, runs=[replace(craft, signals=signals)])

    drawn = found.values(f"/plots/alpha/{KEYS[craft.label]}")[:, 0]
    alpha = DEG * signals["alpha"].to_numpy()
    assert (tmp_path / "flight.rrd").stat().st_size < 30e6
    assert 1000 < len(drawn) < 0.5 * len(t)
    assert (drawn.min(), drawn.max()) == pytest.approx((alpha.min(), alpha.max()))
