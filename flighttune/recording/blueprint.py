"""The layout a recording opens with: tabs of views, cameras that frame the flight, paused."""

import math
from collections.abc import Mapping, Sequence

import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.metrics import OFF_ROUTE
from flighttune.recording import entities, scene
from flighttune.recording.entities import OVERVIEW_TAB, PAGE_TAB, DrawnRun
from flighttune.recording.plots import Plot, value_range

ERRORS = ("chi_err", "gamma_err")  # plots on Overview
AIRSPEED = "V_a"  # a plot on Overview too, where a flight ended early

# Share of a tab's height, for a window of 1280 by 720, the smallest in which everything must fit.
READING = 0.05  # the line on how to read the picture

# Columns over rows of a grid of plots, nine make 3 rows of three; titles are cut in five columns.
COLUMNS_PER_ROW, MOST_COLUMNS = 1.36, 4

SIDE, MIDDLE = 0.23, 0.31  # shares of the width of Overview: the view from behind, the plots


def blueprint(
    flights: Sequence[DrawnRun],
    plots: Mapping[str, Sequence[Plot]],
    *,
    on_map: bool = False,
) -> rrb.Blueprint:
    """Lay out the runs that flew, with the plots of each tab; without runs only the page.

    `on_map` tells that latitude and longitude of the runs are known.
    """
    page = rrb.TextDocumentView(origin=entities.PAGE, name=PAGE_TAB)
    if not flights:
        return _layout([page])
    tabs = {
        OVERVIEW_TAB: _overview(flights, plots, on_map=on_map),
        **{name: _tab(tab_plots, flights) for name, tab_plots in plots.items()},
        PAGE_TAB: page,
    }
    return _layout([_below_sentence(name, tab) for name, tab in tabs.items()])


def _below_sentence(name: str, tab: rrb.Container | rrb.View) -> rrb.Container:
    """A tab below the sentence of what it shows."""
    sentence = rrb.TextDocumentView(origin=entities.reading(name), name="About", titlebar=False)
    # The line is on top: the viewer panics at a screenshot with an untitled view at its lower edge.
    return rrb.Vertical(sentence, tab, row_shares=[READING, 1.0 - READING], name=name)


def _overview(
    flights: Sequence[DrawnRun], plots: Mapping[str, Sequence[Plot]], *, on_map: bool
) -> rrb.Container:
    followed = leader(flights)
    whole = _scene_view("Paths and aircraft", scene.overview(flights), f"/{entities.WORLD}/**")
    chase = _scene_view(
        f"Behind {followed.number} {followed.run.provenance.gains_name}",
        scene.chase_eye(scene.drawn_scale(flights) * scene.span_of(followed.run)),
        f"/{entities.AIRCRAFT}/**",
        f"/{entities.GROUND}/**",
        origin=f"{entities.AIRCRAFT}/{followed.key}",
    )
    runs = [drawn_run.run for drawn_run in flights]
    errors = OFF_ROUTE if any("along" in run.signals for run in runs) else ERRORS
    signals = (*errors, *([AIRSPEED] if any(run.status != "completed" for run in runs) else []))
    by_signal = {plot.signal: plot for tab in plots.values() for plot in tab}
    beside = [by_signal[name] for name in signals if name in by_signal]
    maps = [rrb.MapView(origin=entities.MAP, name="OpenStreetMap")] if on_map else []
    legend = rrb.TextDocumentView(origin=entities.LEGEND, name="Runs")
    return rrb.Horizontal(
        rrb.Vertical(whole, *maps),
        rrb.Vertical(*(_plot(plot, flights, 1.0 / len(beside)) for plot in beside)),
        rrb.Vertical(chase, legend),
        column_shares=[1.0 - MIDDLE - SIDE, MIDDLE, SIDE],
    )


def leader(flights: Sequence[DrawnRun]) -> DrawnRun:
    """The run that the view follows: the first that ended early, else the last of the longest."""
    for drawn_run in flights:
        if drawn_run.run.status != "completed":
            return drawn_run
    return max(reversed(flights), key=lambda drawn_run: drawn_run.run.duration)


def _tab(plots: Sequence[Plot], flights: Sequence[DrawnRun]) -> rrb.Grid:
    """A grid of plots; two stand one above the other, on one time axis."""
    columns = (
        min(round(math.sqrt(COLUMNS_PER_ROW * len(plots))), MOST_COLUMNS) if len(plots) > 2 else 1
    )
    share = 1.0 / math.ceil(len(plots) / columns)
    return rrb.Grid(*(_plot(plot, flights, share) for plot in plots), grid_columns=columns)


def _plot(plot: Plot, flights: Sequence[DrawnRun], share: float) -> rrb.TimeSeriesView:
    span = value_range(plot, [drawn_run.run for drawn_run in flights], share=share)
    return rrb.TimeSeriesView(
        origin=f"{entities.PLOTS}/{plot.signal}",
        name=plot.heading,
        axis_x=rrb.TimeAxis(link=LinkAxis.LinkToGlobal),
        # Without a span the viewer chooses the range.
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        # A legend would cover small plots; the list on Overview names the runs.
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _layout(tabs: Sequence[rrb.Container | rrb.View]) -> rrb.Blueprint:
    """Tabs, with the panels of the viewer closed and nothing added by the viewer itself."""
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def _scene_view(
    name: str,
    eye: scene.Eye,
    *contents: str,
    origin: str = entities.WORLD,
) -> rrb.Spatial3DView:
    """A 3D view of entities from a camera, in the axes of `origin`."""
    return rrb.Spatial3DView(
        origin=origin,
        contents=contents,
        name=name,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=eye[0],
            look_target=eye[1],
            eye_up=(0.0, 0.0, -1.0),  # z of NED goes down
        ),
    )
