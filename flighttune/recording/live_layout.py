"""What a viewer shows while a scenario is being flown: the scene behind the aircraft, and plots."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.arrays import FloatArray
from flighttune.palette import NEUTRAL, Look, rgb
from flighttune.recording.geometry import chase_eye
from flighttune.recording.mesh import aircraft_mesh
from flighttune.recording.names import AIRCRAFT, GROUND, PLOTS, REFERENCE, WORLD
from flighttune.recording.plots import DISPLAY
from flighttune.recording.scene import GROUND_COLOUR, paint
from flighttune.simulate.run import SIGNAL_UNITS

SESSION = "session_time"
"""Time flown since the first run began: the runs one after another."""

LIVE = f"{AIRCRAFT}/live"
"""Frame of the aircraft that flies now."""

SHOWN = {
    "chi": ("Course chi, reference grey", ("chi",)),
    "gamma": ("Path angle gamma, reference grey", ("gamma",)),
    "phi": ("Roll phi flown, command thin", ("phi", "phi_cmd")),
    "n_z": ("Load factor n_z flown, command thin", ("n_z", "n_z_cmd")),
    "V_a": ("Airspeed V_a", ("V_a",)),
}
"""Plots: title and signals, by the name of the folder."""

DRAWN_SPAN = 12.0
"""Width of the aircraft as drawn, m."""

GRID_LINES = 21
FAINT = 150


def live_blueprint() -> rrb.Blueprint:
    """One tab that follows the flight."""
    chase = rrb.Spatial3DView(
        origin=LIVE,
        contents=f"/{WORLD}/**",
        name="Behind the aircraft",
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=chase_eye(2.0 * DRAWN_SPAN).position,
            look_target=chase_eye(2.0 * DRAWN_SPAN).target,
            eye_up=(0.0, 0.0, -1.0),
        ),
    )
    plots = [
        rrb.TimeSeriesView(
            origin=f"{PLOTS}/{name}",
            name=f"{title} [{DISPLAY.get(SIGNAL_UNITS[name], (SIGNAL_UNITS[name],))[0]}]",
            axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, (title, _) in SHOWN.items()
    ]
    return rrb.Blueprint(
        rrb.Tabs(
            rrb.Horizontal(chase, rrb.Vertical(*plots), column_shares=[3, 2], name="Live"),
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=SESSION, play_state="following"),
        auto_views=False,
        auto_layout=False,
    )


def log_ground(stream: rr.RecordingStream, *, spacing: float) -> None:
    """Log world axes and a level grid about the start, `spacing` m apart and half of it below."""
    stream.log(WORLD, rr.ViewCoordinates.FRD, static=True)
    ends = np.array([-0.5, 0.5]) * (GRID_LINES - 1) * spacing
    lines = []
    for along in np.linspace(ends[0], ends[1], GRID_LINES):
        lines.append(np.array([[along, ends[0], spacing / 2.0], [along, ends[1], spacing / 2.0]]))
        lines.append(np.array([[ends[0], along, spacing / 2.0], [ends[1], along, spacing / 2.0]]))
    thin = rr.components.Radius.ui_points(0.5)
    stream.log(GROUND, rr.LineStrips3D(lines, radii=thin, colors=[GROUND_COLOUR]), static=True)


def move_ground(stream: rr.RecordingStream, position: FloatArray, *, spacing: float) -> None:
    """Keep the ground grid below an aircraft at `position` (NED, m) without shifting its lines."""
    snapped = np.round(position / spacing) * spacing
    stream.log(GROUND, rr.Transform3D(translation=snapped))


def log_styles(stream: rr.RecordingStream, keys: Sequence[str], looks: Sequence[Look]) -> None:
    """Log colours and widths of the lines of every run, and of the reference."""
    for name, (_, signals) in SHOWN.items():
        for key, look in zip(keys, looks, strict=True):
            style = rr.SeriesLines(
                colors=[(*look.rgb, 255), (*look.rgb, FAINT)][: len(signals)],
                widths=[look.width, 1.0][: len(signals)],
                names=[key, f"{key}, command"][: len(signals)],
            )
            stream.log(f"{PLOTS}/{name}/{key}", style, static=True)
        if name in ("chi", "gamma"):
            grey = rr.SeriesLines(colors=[rgb(NEUTRAL)], widths=[2.0], names=["reference"])
            stream.log(f"{PLOTS}/{name}/{REFERENCE}", grey, static=True)


def log_aircraft(stream: rr.RecordingStream, entity: str, look: Look, *, scale: float) -> None:
    """Log the aircraft in the colour of the run that flies from now on."""
    mesh = aircraft_mesh()
    shape = rr.Mesh3D(
        vertex_positions=mesh.vertices * scale,
        vertex_normals=mesh.normals,
        triangle_indices=mesh.triangles,
        vertex_colors=paint(mesh, look.rgb),
    )
    stream.log(entity, shape)
