"""The layout a recording opens with: tabs of views, cameras that frame the flight, paused."""

import math
from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.archetypes import TextLogColumns
from rerun.blueprint.encodings import TextLogColumnKind

from flighttune.recording import entities, geometry
from flighttune.recording.certificate_tab import TAB as CERTIFICATE_TAB
from flighttune.recording.certificate_tab import certificate_tab
from flighttune.recording.entities import DrawnRun
from flighttune.recording.plots import COMMANDS_TAB, WHY_TAB, Plot, value_range
from flighttune.recording.views import lanes_view, layout, scene_view, time_view
from flighttune.simulate.run import Run

PAGE_TAB = "Scenario and metrics"
FIRST_TABS = ("Overview", "Tracking", COMMANDS_TAB, WHY_TAB, CERTIFICATE_TAB)  # others follow
ERRORS = ("chi_err", "gamma_err")  # plots on Overview
AIRSPEED = "V_a"  # a plot on Overview too, where a flight ended early

# Shares of a tab's height, for a window of 1280 by 720, the smallest in which everything must fit.
READING = 0.05  # the line on how to read the picture
TABLE, TABLE_ROW, LONGEST_TABLE = 0.12, 0.037, 0.55  # the readout, without rows and at most
LANES, LANE, MOST_LANES = 0.1, 0.065, 0.6  # the lanes, without runs and at most below a view

SIDE, MIDDLE = 0.23, 0.31  # shares of the width: the column of lanes, the plots on Overview


def blueprint(drawn: Sequence[DrawnRun], plots: Mapping[str, Sequence[Plot]]) -> rrb.Blueprint:
    """Lay out the runs that flew, with the plots of each tab; without runs only the page."""
    page: rrb.Container | rrb.View = rrb.TextDocumentView(origin=entities.PAGE, name=PAGE_TAB)
    if not drawn:
        return layout([page])
    tabs = {"Overview": _overview(drawn, plots)}
    tabs |= {
        name: _beside_lanes(_tab(name, shown, drawn), drawn, name) for name, shown in plots.items()
    }
    if any(drawn_run.claim for drawn_run in drawn):
        tabs[CERTIFICATE_TAB] = _certificates(drawn)
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
    signals = (*ERRORS, *([AIRSPEED] if any(run.status != "completed" for run in runs) else []))
    by_signal = {plot.signal: plot for tab in plots.values() for plot in tab}
    beside = [by_signal[name] for name in signals if name in by_signal]
    rows = 1 + len({run.provenance.plant for run in runs}) + len(runs)
    table = min(TABLE + TABLE_ROW * rows, LONGEST_TABLE)
    lanes = LANES + LANE * len(drawn)
    scene: rrb.Container | rrb.View = whole
    right: rrb.Container | rrb.View = _lanes(drawn)
    if lanes > MOST_LANES:  # so many runs need the whole height
        scene = rrb.Horizontal(whole, chase, column_shares=[3, 2])
    else:
        # The view from behind is as wide as high, or a little wider, like the aircraft in it.
        lanes = max(lanes, 0.5)
        right = rrb.Vertical(chase, right, row_shares=[1.0 - lanes, lanes])
    now = rrb.TextDocumentView(origin=entities.NOW, name="Now")
    views = rrb.Horizontal(
        rrb.Vertical(scene, now, row_shares=[1.0 - table, table]),
        rrb.Vertical(*(_plot(plot, runs, 1.0 / len(beside)) for plot in beside)),
        right,
        column_shares=[1.0 - MIDDLE - SIDE, MIDDLE, SIDE],
    )
    reading = rrb.TextDocumentView(origin=entities.READING, name="How to read", titlebar=False)
    # On top: the viewer panics when a screenshot has a view without title at the lower edge.
    return rrb.Vertical(reading, views, row_shares=[READING, 1.0 - READING], name="Overview")


def leader(drawn: Sequence[DrawnRun]) -> DrawnRun:
    """The run that the view follows: the first that ended early, else the last of the longest."""
    early = [drawn_run for drawn_run in drawn if drawn_run.run.status != "completed"]
    longest = max(drawn_run.run.duration for drawn_run in drawn)
    longest_runs = (run for run in reversed(drawn) if run.run.duration == longest)
    return next(iter(early), None) or next(longest_runs)


def _certificates(drawn: Sequence[DrawnRun]) -> rrb.Container:
    views = certificate_tab(drawn)
    columns = 1 if len(views) == 1 else 2 if len(views) <= 4 else 3
    return _beside_lanes(rrb.Grid(*views, grid_columns=columns), drawn, CERTIFICATE_TAB)


def _tab(name: str, plots: Sequence[Plot], drawn: Sequence[DrawnRun]) -> rrb.Container:
    runs, count = [drawn_run.run for drawn_run in drawn], len(plots)
    if name == COMMANDS_TAB:
        return rrb.Vertical(
            *(_plot(plot, runs, 5.0 / 13.0) for plot in plots),
            _events(),
            row_shares=[5, 5, 3][-count - 1 :],
        )
    columns = 5 if count > 9 else 4 if count > 6 else 3 if count in (3, 5, 6) else min(count, 2)
    columns = 3 if name == WHY_TAB else columns
    share = 1.0 / math.ceil(count / columns)
    return rrb.Grid(*(_plot(plot, runs, share) for plot in plots), grid_columns=columns)


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


def _plot(plot: Plot, runs: Sequence[Run], share: float) -> rrb.TimeSeriesView:
    span = value_range(plot, runs, share=share)
    return time_view(f"{entities.PLOTS}/{plot.signal}", plot.heading, span)
