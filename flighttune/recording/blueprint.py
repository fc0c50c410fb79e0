"""The layout a recording opens with: tabs of views, cameras that frame the flight, paused."""

from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.recording.cast import Member
from flighttune.recording.geometry import Eye, chase_eye, enlargement, flown, overview_eye
from flighttune.recording.mesh import SPAN
from flighttune.recording.names import (
    AIRCRAFT,
    PAGE,
    PHASES,
    PLOTS,
    TIMELINE,
    WORLD,
)
from flighttune.recording.plots import Plot

GRID_SPACING = 10.0
"""Smallest mesh of the ground grid, m."""

PLOTS_BESIDE = ("chi_err", "gamma_err")
"""Plots of the first tab."""


def blueprint(
    members: Sequence[Member], plots: Mapping[str, Sequence[Plot]], *, tab: str | None = None
) -> rrb.Blueprint:
    """Lay out a recording.

    Parameters
    ----------
    members : sequence of Member
        Runs that flew; with none the page is all there is.
    plots : mapping
        Plots of each tab, see `flighttune.recording.plots.shown_plots`.
    tab : str, optional
        Tab to open with; the first one if not given.
    """
    page = rrb.TextDocumentView(origin=PAGE, name="Scenario and metrics")
    tabs: list[rrb.Container | rrb.View] = []
    if members:
        tabs.append(_overview(members, plots))
    for name, shown in plots.items():
        tabs.append(_tab(name, shown))
    tabs.append(page)
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=tab or 0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def _overview(members: Sequence[Member], plots: Mapping[str, Sequence[Plot]]) -> rrb.Container:
    points = flown(members)
    width = SPAN * enlargement(points)
    leader = max(members, key=lambda member: (member.run.duration, len(member.run.signals.columns)))
    whole = _scene("Paths and aircraft", overview_eye(points, margin=width / 2.0))
    chase = _scene(
        f"Behind {leader.run.label}",
        chase_eye(width),
        origin=f"{AIRCRAFT}/{leader.key}",
    )
    beside = [plot for tab in plots.values() for plot in tab if plot.signal in PLOTS_BESIDE]
    return rrb.Horizontal(
        whole,
        rrb.Vertical(chase, *(_plot(plot, legend=k == 0) for k, plot in enumerate(beside))),
        column_shares=[3, 2],
        name="Overview",
    )


def _scene(name: str, eye: Eye, *, origin: str = WORLD) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=origin,
        contents=[f"/{WORLD}/**"],
        name=name,
        line_grid=rrb.LineGrid3D(spacing=GRID_SPACING),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position,
            look_target=eye.target,
            eye_up=(0.0, 0.0, -1.0),
        ),
    )


def _tab(name: str, plots: Sequence[Plot]) -> rrb.Container:
    views: list[rrb.View] = [_plot(plot, legend=k == 0) for k, plot in enumerate(plots)]
    columns = 4 if len(views) > 6 else 2 if len(views) > 2 else 1
    if name == "Commands and limits":
        views.append(_phases())
    return rrb.Grid(*views, grid_columns=columns, name=name)


def _plot(plot: Plot, *, legend: bool) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"{PLOTS}/{plot.signal}",
        name=plot.heading,
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        plot_legend=rrb.PlotLegend(visible=legend),
    )


def _phases() -> rrb.StateTimelineView:
    return rrb.StateTimelineView(
        origin=PHASES,
        name="Commands held by a limit",
        time_view=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
    )
