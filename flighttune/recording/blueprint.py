"""The layout a recording opens with: tabs of views, cameras that frame the flight, paused."""

from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TextLogColumns
from rerun.blueprint.encodings import TextLogColumnKind

from flighttune.guarantee.flight_check import FlightCheck
from flighttune.recording import entities, geometry
from flighttune.recording.certificate_tab import TAB as CERTIFICATE_TAB
from flighttune.recording.certificate_tab import certificate_tab
from flighttune.recording.eigenvalue_tab import TAB as EIGENVALUES_TAB
from flighttune.recording.eigenvalue_tab import FrozenLoop, eigenvalue_tab
from flighttune.recording.entities import DrawnRun
from flighttune.recording.lanes import CHANNELS
from flighttune.recording.plots import COMMANDS_TAB, Plot, value_range
from flighttune.recording.views import lanes_view, layout, scene_view, time_view
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
    drawn: Sequence[DrawnRun],
    plots: Mapping[str, Sequence[Plot]],
    *,
    claims: Mapping[str, FlightCheck] | None = None,
    loops: Mapping[str, FrozenLoop] | None = None,
) -> rrb.Blueprint:
    """Lay out a recording.

    Parameters
    ----------
    drawn : sequence of DrawnRun
        Runs that flew; with none the page is all there is.
    plots : mapping
        Plots of each tab, see `flighttune.recording.plots.shown_plots`.
    claims, loops : mapping, optional
        Guarantees and frozen loops by key of the run; the tab of each is there if any are.
    """
    page: rrb.Container | rrb.View = rrb.TextDocumentView(origin=entities.PAGE, name=PAGE_TAB)
    tabs: list[rrb.Container | rrb.View] = []
    if drawn:
        tabs.append(_overview(drawn, plots))
        tabs += [_tab(name, shown, drawn) for name, shown in plots.items()]
        if claims:
            tabs.append(_certificates(drawn, claims))
        if loops:
            tabs.append(_with_runs(eigenvalue_tab(loops), len(drawn), name=EIGENVALUES_TAB))
        page = _with_runs(page, len(drawn), name=PAGE_TAB)
    tabs.append(page)
    return layout(tabs)


def _overview(drawn: Sequence[DrawnRun], plots: Mapping[str, Sequence[Plot]]) -> rrb.Container:
    points = geometry.all_positions(drawn)
    span = geometry.widest(drawn)
    width = span * geometry.enlargement(points, span)
    longest = max(drawn_run.run.duration for drawn_run in drawn)
    leader = [drawn_run for drawn_run in drawn if drawn_run.run.duration == longest][-1]
    whole = scene_view(
        "Paths and aircraft",
        geometry.overview_eye(points, margin=width / 2.0),
        f"/{entities.WORLD}/**",
    )
    chase = scene_view(
        f"Behind {leader.run.label}",
        geometry.chase_eye(width),
        f"/{entities.AIRCRAFT}/**",
        f"/{entities.GROUND}/**",
        origin=f"{entities.AIRCRAFT}/{leader.key}",
    )
    beside = [plot for tab in plots.values() for plot in tab if plot.signal in FIRST_TAB_PLOTS]
    runs = [drawn_run.run for drawn_run in drawn]
    happened = rrb.TextLogView(
        origin=entities.EVENTS,
        name="Events",
        columns=TextLogColumns(text_log_columns=[TextLogColumnKind.Body]),
    )
    return rrb.Horizontal(
        _with_runs(whole, len(drawn)),
        rrb.Vertical(
            chase, *(_plot(plot, runs) for plot in beside), happened, row_shares=OVERVIEW_SHARES
        ),
        column_shares=[4, 3],
        name="Overview",
    )


def _certificates(drawn: Sequence[DrawnRun], claims: Mapping[str, FlightCheck]) -> rrb.Container:
    views = certificate_tab(drawn, claims)
    columns = 1 if len(views) == 1 else 2 if len(views) <= 4 else 3
    lanes = lanes_view(
        entities.CLAIMS, "Guarantee: holds, broken (red) or no claim (grey: limit or new reference)"
    )
    return rrb.Vertical(
        rrb.Grid(*views, grid_columns=columns),
        lanes,
        row_shares=_shares(len(drawn)),
        name=CERTIFICATE_TAB,
    )


def _tab(name: str, plots: Sequence[Plot], drawn: Sequence[DrawnRun]) -> rrb.Container:
    lanes, runs = len(drawn), [drawn_run.run for drawn_run in drawn]
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
    runs = lanes_view(entities.RUNS, "Runs: name and colour")
    return rrb.Vertical(above, runs, row_shares=_shares(lanes), name=name)


def _shares(lanes: int, height: float = HEIGHT, *, most: float = 0.45) -> tuple[float, float]:
    """Shares of `height` for what is above the lanes and for the lanes, `most` of it at most."""
    below = min(max(HEADER + LANE * lanes, height / 6.0), most * height)
    return height - below, below


def _plot(plot: Plot, runs: Sequence[Run]) -> rrb.TimeSeriesView:
    return time_view(f"{entities.PLOTS}/{plot.signal}", plot.heading, value_range(plot, runs))


def _phases(command: str) -> rrb.StateTimelineView:
    return lanes_view(f"{entities.PHASES}/{command}", CHANNELS[command])
