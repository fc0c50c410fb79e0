"""Views and the frame around them, set up alike for recordings and live flights."""

from collections.abc import Sequence
from typing import Literal

import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.recording.entities import TIMELINE, WORLD
from flighttune.recording.geometry import Eye


def layout(
    tabs: Sequence[rrb.Container | rrb.View],
    *,
    timeline: str = TIMELINE,
    play_state: Literal["paused", "following"] = "paused",
) -> rrb.Blueprint:
    """Tabs, with the panels of the viewer closed and nothing added by the viewer itself."""
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state=play_state),
        auto_views=False,
        auto_layout=False,
    )


def time_view(
    origin: str, name: str, span: tuple[float, float] | None = None
) -> rrb.TimeSeriesView:
    """A plot over time; its axis `span` is found by the viewer where it is None."""
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(
            visible=False
        ),  # it would cover small plots; lanes name the runs
    )


def lanes_view(name: str, lanes: Sequence[str]) -> rrb.StateTimelineView:
    """Lanes over the same time axis as the plots; each is named after its whole path."""
    return rrb.StateTimelineView(
        name=name,
        contents=[f"/{lane}" for lane in lanes],
        time_view=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
    )


def scene_view(name: str, eye: Eye, *contents: str, origin: str = WORLD) -> rrb.Spatial3DView:
    """A 3D view of entities from a camera, in the axes of `origin`."""
    return rrb.Spatial3DView(
        origin=origin,
        contents=contents,
        name=name,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position,
            look_target=eye.target,
            eye_up=(0.0, 0.0, -1.0),  # z of NED goes down
        ),
    )
