"""The layout a recording opens with: tabs of views, cameras that frame the flight, paused."""

import math
from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TextLogColumns
from rerun.blueprint.encodings import TextLogColumnKind

from flighttune.recording import entities, geometry
from flighttune.recording.certificate_tab import TAB as CERTIFICATE_TAB
from flighttune.recording.certificate_tab import certificate_tab
from flighttune.recording.eigenvalue_tab import TAB as EIGENVALUES_TAB
from flighttune.recording.eigenvalue_tab import FrozenLoop, eigenvalue_tab
from flighttune.recording.entities import DrawnRun
from flighttune.recording.plots import COMMANDS_TAB, WHY_TAB, Plot, value_range
from flighttune.recording.views import lanes_view, layout, scene_view, time_view
from flighttune.simulate.run import Run

PAGE_TAB = "Scenario and metrics"

FIRST_TABS = ("Overview", "Tracking", COMMANDS_TAB, WHY_TAB, CERTIFICATE_TAB)
"""In this order; the others follow."""

ERRORS = ("chi_err", "gamma_err")
"""Plots on Overview."""

AIRSPEED = "V_a"
"""Plot on Overview too, where a flight ended early."""

HEIGHT = 620.0
"""Height of a tab in a window of 720 points, the smallest in which everything must fit."""

ABOVE_AXIS = 50.0
"""Height of the title of a plot and of the labels of its time axis, points."""

LANE, ABOVE_LANES = 40.0, 62.0
"""Height of a lane with its name, and of what is around all lanes, points."""

LINE, AROUND_READOUT = 23.0, 72.0
"""Height of a row of the readout, and of what is around it, points."""

READING = 30.0
"""Height of the line on how to read the picture, points."""

SIDE = 0.23
"""Width of the column of lanes as a part of the window."""


def blueprint(
    drawn: Sequence[DrawnRun],
    plots: Mapping[str, Sequence[Plot]],
    loops: Mapping[str, FrozenLoop],
) -> rrb.Blueprint:
    """Lay out a recording.

    Parameters
    ----------
    drawn : sequence of DrawnRun
        Runs that flew; without any, only the page is shown.
    plots : mapping
        Plots of each tab, see `flighttune.recording.plots.shown_plots`.
    loops : mapping of str to FrozenLoop
        By key of the run; they have a tab if there are any, as claims have.
    """
    page: rrb.Container | rrb.View = rrb.TextDocumentView(origin=entities.PAGE, name=PAGE_TAB)
    if not drawn:
        return layout([page])
    tabs = {"Overview": _overview(drawn, plots)}
    tabs |= {
        name: _beside_lanes(_tab(name, shown, drawn), drawn, name) for name, shown in plots.items()
    }
    if any(drawn_run.claim for drawn_run in drawn):
        tabs[CERTIFICATE_TAB] = _certificates(drawn)
    if loops:
        tabs[EIGENVALUES_TAB] = _beside_lanes(eigenvalue_tab(loops), drawn, EIGENVALUES_TAB)
    tabs[PAGE_TAB] = _beside_lanes(page, drawn, PAGE_TAB)
    first = [name for name in FIRST_TABS if name in tabs]
    return layout([tabs[name] for name in dict.fromkeys([*first, *tabs])])


def _overview(drawn: Sequence[DrawnRun], plots: Mapping[str, Sequence[Plot]]) -> rrb.Container:
    width = geometry.drawn_width(drawn)
    followed = leader(drawn)
    whole = scene_view(
        "Paths and aircraft",
        geometry.overview_eye(geometry.all_to_see(drawn), margin=width / 2.0),
        f"/{entities.WORLD}/**",
    )
    chase = scene_view(
        f"Behind {followed.number} {followed.run.provenance.gains_name}",
        geometry.chase_eye(width * geometry.span_of(followed.run) / geometry.widest(drawn)),
        f"/{entities.AIRCRAFT}/**",
        f"/{entities.GROUND}/**",
        origin=f"{entities.AIRCRAFT}/{followed.key}",
    )
    runs = [drawn_run.run for drawn_run in drawn]
    wanted = (*ERRORS, *([AIRSPEED] if any(run.status != "completed" for run in runs) else []))
    found = {plot.signal: plot for tab in plots.values() for plot in tab}
    beside = [found[name] for name in wanted if name in found]
    height = HEIGHT / max(len(beside), 1) - ABOVE_AXIS
    plants = {run.provenance.plant for run in runs}
    text = min(AROUND_READOUT + LINE * (1 + len(plants) + len(runs)), 0.55 * HEIGHT)
    scene: rrb.Container | rrb.View = whole
    right: rrb.Container | rrb.View = _lanes(drawn)
    lanes = ABOVE_LANES + LANE * len(drawn)
    if lanes > 0.6 * HEIGHT:  # the names of so many runs need the whole side
        scene = rrb.Horizontal(whole, chase, column_shares=[3, 2])
    else:
        # The view from behind is as wide as high, or a little wider, like the aircraft in it.
        lanes = max(lanes, 0.5 * HEIGHT)
        right = rrb.Vertical(chase, right, row_shares=[HEIGHT - lanes, lanes])
    now = rrb.TextDocumentView(origin=entities.NOW, name="Now")
    views = rrb.Horizontal(
        rrb.Vertical(scene, now, row_shares=[HEIGHT - text, text]),
        rrb.Vertical(*(_plot(plot, runs, height) for plot in beside)),
        right,
        column_shares=[1.0 - SIDE - 0.31, 0.31, SIDE],
    )
    reading = rrb.TextDocumentView(origin=entities.READING, name="How to read", titlebar=False)
    # On top: the viewer panics when a screenshot has a view without title at the lower edge.
    return rrb.Vertical(reading, views, row_shares=[READING, HEIGHT - READING], name="Overview")


def leader(drawn: Sequence[DrawnRun]) -> DrawnRun:
    """The run that the view follows: the first that ended early, else the last of the longest."""
    early = [drawn_run for drawn_run in drawn if drawn_run.run.status != "completed"]
    longest = max(drawn_run.run.duration for drawn_run in drawn)
    return [*early, *(one for one in reversed(drawn) if one.run.duration == longest)][0]


def _certificates(drawn: Sequence[DrawnRun]) -> rrb.Container:
    views = certificate_tab(drawn)
    columns = 1 if len(views) == 1 else 2 if len(views) <= 4 else 3
    return _beside_lanes(rrb.Grid(*views, grid_columns=columns), drawn, CERTIFICATE_TAB)


def _tab(name: str, plots: Sequence[Plot], drawn: Sequence[DrawnRun]) -> rrb.Container:
    runs, count = [drawn_run.run for drawn_run in drawn], len(plots)
    if name == COMMANDS_TAB:
        height = 5.0 / 13.0 * HEIGHT - ABOVE_AXIS
        return rrb.Vertical(
            *(_plot(plot, runs, height) for plot in plots),
            _events(),
            row_shares=[5, 5, 3][-count - 1 :],
        )
    columns = 5 if count > 9 else 4 if count > 6 else 3 if count in (3, 5, 6) else min(count, 2)
    columns = 3 if name == WHY_TAB else columns
    height = HEIGHT / math.ceil(count / columns) - ABOVE_AXIS
    return rrb.Grid(*(_plot(plot, runs, height) for plot in plots), grid_columns=columns)


def _events() -> rrb.TextLogView:
    return rrb.TextLogView(
        origin=entities.EVENTS,
        name="Events",
        columns=TextLogColumns(text_log_columns=[TextLogColumnKind.Body]),
    )


def _beside_lanes(
    shown: rrb.Container | rrb.View, drawn: Sequence[DrawnRun], name: str
) -> rrb.Container:
    """`shown`, and beside it the lanes, which name the runs in their colours."""
    return rrb.Horizontal(shown, _lanes(drawn), column_shares=[1.0 - SIDE, SIDE], name=name)


def _lanes(drawn: Sequence[DrawnRun]) -> rrb.StateTimelineView:
    names = [entities.lane_name(drawn_run, len(drawn)) for drawn_run in drawn]
    return lanes_view("Runs: limits, guarantee", names)


def _plot(plot: Plot, runs: Sequence[Run], height: float) -> rrb.TimeSeriesView:
    span = value_range(plot, runs, height=height)
    return time_view(f"{entities.PLOTS}/{plot.signal}", plot.heading, span)
