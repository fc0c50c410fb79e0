"""The layout a recording opens with: tabs of views, cameras that frame the flight, paused."""

from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TextLogColumns
from rerun.blueprint.components import LinkAxis
from rerun.blueprint.encodings import TextLogColumnKind

from flighttune.recording.cast import Member
from flighttune.recording.certificate_tab import TAB as CERTIFICATE_TAB
from flighttune.recording.certificate_tab import certificate_tab
from flighttune.recording.certified import Certified
from flighttune.recording.eigenvalue_tab import TAB as EIGENVALUES_TAB
from flighttune.recording.eigenvalue_tab import eigenvalue_tab
from flighttune.recording.frozen_loop import FrozenLoop
from flighttune.recording.geometry import (
    Eye,
    chase_eye,
    enlargement,
    flown,
    overview_eye,
    widest,
)
from flighttune.recording.lanes import CHANNELS
from flighttune.recording.names import (
    AIRCRAFT,
    CLAIMS,
    EVENTS,
    GROUND,
    PAGE,
    PHASES,
    PLOTS,
    RUNS,
    TIMELINE,
    WORLD,
)
from flighttune.recording.plots import COMMANDS_TAB, Plot, value_range
from flighttune.simulate.run import Run

PAGE_TAB = "Scenario and metrics"

FIRST_TAB_PLOTS = ("chi_err", "gamma_err")
"""Plots beside the scene."""

OVERVIEW_SHARES = (9, 8, 8, 7)
"""Heights of what stands beside the scene: camera, two errors, events."""

HEIGHT, HEADER, LANE = 780.0, 72.0, 24.0
"""Height of a tab in a window of 900, of a title with time axis, and of one lane; in points, for
sharing out."""


def blueprint(
    members: Sequence[Member],
    plots: Mapping[str, Sequence[Plot]],
    *,
    claims: Mapping[str, Certified] | None = None,
    loops: Mapping[str, FrozenLoop] | None = None,
    tab: str | None = None,
) -> rrb.Blueprint:
    """Lay out a recording.

    Parameters
    ----------
    members : sequence of Member
        Runs that flew; with none the page is all there is.
    plots : mapping
        Plots of each tab, see `flighttune.recording.plots.shown_plots`.
    claims, loops : mapping, optional
        Guarantees and frozen loops by key of the member; the tab of each is there if any are.
    tab : str, optional
        Tab to open with; the first one if not given.
    """
    page: rrb.Container | rrb.View = rrb.TextDocumentView(origin=PAGE, name=PAGE_TAB)
    tabs: list[rrb.Container | rrb.View] = []
    if members:
        tabs.append(_overview(members, plots))
        tabs += [_tab(name, shown, members) for name, shown in plots.items()]
        if claims:
            tabs.append(_certificates(members, claims))
        if loops:
            tabs.append(_with_runs(eigenvalue_tab(loops), len(members), name=EIGENVALUES_TAB))
        page = _with_runs(page, len(members), name=PAGE_TAB)
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
    span = widest(members)
    width = span * enlargement(points, span)
    longest = max(member.run.duration for member in members)
    leader = [member for member in members if member.run.duration == longest][-1]
    whole = _scene("Paths and aircraft", overview_eye(points, margin=width / 2.0), f"/{WORLD}/**")
    chase = _scene(
        f"Behind {leader.run.label}",
        chase_eye(width),
        f"/{AIRCRAFT}/**",
        f"/{GROUND}/**",
        origin=f"{AIRCRAFT}/{leader.key}",
    )
    beside = [plot for tab in plots.values() for plot in tab if plot.signal in FIRST_TAB_PLOTS]
    runs = [member.run for member in members]
    happened = rrb.TextLogView(
        origin=EVENTS,
        name="Events",
        columns=TextLogColumns(text_log_columns=[TextLogColumnKind.Body]),
    )
    return rrb.Horizontal(
        _with_runs(whole, len(members)),
        rrb.Vertical(
            chase, *(_plot(plot, runs) for plot in beside), happened, row_shares=OVERVIEW_SHARES
        ),
        column_shares=[4, 3],
        name="Overview",
    )


def _certificates(members: Sequence[Member], claims: Mapping[str, Certified]) -> rrb.Container:
    views = certificate_tab(members, claims)
    columns = 1 if len(views) == 1 else 2 if len(views) <= 4 else 3
    lanes = _lanes(
        CLAIMS, "Guarantee: holds, broken (red) or no claim (grey: limit or new reference)"
    )
    return rrb.Vertical(
        rrb.Grid(*views, grid_columns=columns),
        lanes,
        row_shares=_shares(len(members)),
        name=CERTIFICATE_TAB,
    )


def _scene(name: str, eye: Eye, *contents: str, origin: str = WORLD) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=origin,
        contents=contents,
        name=name,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye.position,
            look_target=eye.target,
            eye_up=(0.0, 0.0, -1.0),
        ),
    )


def _tab(name: str, plots: Sequence[Plot], members: Sequence[Member]) -> rrb.Container:
    lanes, runs = len(members), [member.run for member in members]
    views = [_plot(plot, runs) for plot in plots]
    if name == COMMANDS_TAB:
        inner = _shares(lanes)[0]
        columns = [
            rrb.Vertical(view, _phases(plot.signal), row_shares=_shares(lanes, inner, most=0.62))
            for view, plot in zip(views, plots, strict=True)
        ]
        return _with_runs(rrb.Horizontal(*columns), lanes, name=name)
    count = 5 if len(plots) > 12 else 4 if len(plots) > 6 else 3 if len(plots) in (3, 5, 6) else 2
    return _with_runs(rrb.Grid(*views, grid_columns=count), lanes, name=name)


def _with_runs(
    above: rrb.Container | rrb.View, lanes: int, *, name: str | None = None
) -> rrb.Container:
    """`above`, and below it the lanes that name the runs in their colours."""
    runs = _lanes(RUNS, "Runs: name and colour")
    return rrb.Vertical(above, runs, row_shares=_shares(lanes), name=name)


def _shares(lanes: int, height: float = HEIGHT, *, most: float = 0.45) -> tuple[float, float]:
    """Shares of `height` for what is above the lanes and for the lanes, `most` of it at most."""
    below = min(max(HEADER + LANE * lanes, height / 6.0), most * height)
    return height - below, below


def _plot(plot: Plot, runs: Sequence[Run]) -> rrb.TimeSeriesView:
    span = value_range(plot, runs)
    return rrb.TimeSeriesView(
        origin=f"{PLOTS}/{plot.signal}",
        name=plot.heading,
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _phases(command: str) -> rrb.StateTimelineView:
    return _lanes(f"{PHASES}/{command}", CHANNELS[command])


def _lanes(origin: str, name: str) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(
        origin=origin, name=name, time_view=rrb.TimeAxis(link=LinkAxis.LinkToGlobal)
    )
