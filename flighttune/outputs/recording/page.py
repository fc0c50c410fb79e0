"""The first view of a recording: tabs of views, cameras that frame the flight, and text.

The text is Markdown: the page, a sentence for each tab, the names of the runs.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd
import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import LinkAxis

from flighttune.base.files.table import toml_text
from flighttune.base.signals import SYMBOLS
from flighttune.base.words import pick
from flighttune.control.theory.indicators import Indicators
from flighttune.flight.loop.run import Run
from flighttune.flight.metrics import OFF_ROUTE, metric_tables
from flighttune.outputs.answers.answer import Column, Table
from flighttune.outputs.answers.labels import METRIC_LABELS, columns
from flighttune.outputs.answers.run import claim_notes, priority_notes, run_styles
from flighttune.outputs.drawing.palette import hue_tells_gains
from flighttune.outputs.recording import entities, scene
from flighttune.outputs.recording.entities import DrawnRun
from flighttune.outputs.recording.plots import TEXTS, Plot, value_range
from flighttune.outputs.recording.scene import all_positions, drawn_scale, ground_grid

ERRORS = ("chi_err", "gamma_err")  # plots on Overview
AIRSPEED = "V_a"  # additional plot on Overview if a flight ended early

# Shares of a tab's height for a window of 1280 by 720, the smallest in which everything fits.
READING = 0.05  # the line that explains the picture

# Ratio of columns to rows of a grid of plots: nine make 3 by 3; five columns would cut titles.
COLUMNS_PER_ROW, MOST_COLUMNS = 1.36, 4

SHARED_AXIS_S = 60.0  # longest flight that a shared axis shows whole

SIDE, MIDDLE = 0.23, 0.31  # shares of the width of Overview: the view from behind, the plots


def blueprint(
    flights: Sequence[DrawnRun], plots: Mapping[str, Sequence[Plot]], *, on_map: bool = False
) -> rrb.Blueprint:
    """Layout of the runs that flew, with the plots of each tab; without runs only the page."""
    page = rrb.TextDocumentView(origin=entities.PAGE, name=entities.PAGE_TAB)
    tabs: list[rrb.Container | rrb.View] = [page]
    if flights:
        views = {
            entities.OVERVIEW_TAB: _overview(flights, plots, on_map=on_map),
            **{name: _tab(tab_plots, flights) for name, tab_plots in plots.items()},
            entities.PAGE_TAB: page,
        }
        tabs = [_below_sentence(name, view) for name, view in views.items()]
    # The viewer's panels are closed, and it adds no views itself.
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=entities.TIMELINE, play_state="paused"),
        auto_views=False,
        auto_layout=False,
    )


def _below_sentence(name: str, tab: rrb.Container | rrb.View) -> rrb.Container:
    """A tab below the sentence that explains it."""
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
    runs = [flight.run for flight in flights]
    errors = OFF_ROUTE if any("along" in run.signals for run in runs) else ERRORS
    signals = (*errors, *([AIRSPEED] if any(run.status != "completed" for run in runs) else []))
    by_signal = {plot.signal: plot for tab in plots.values() for plot in tab}
    beside = [by_signal[name] for name in signals if name in by_signal]
    maps = [rrb.MapView(origin=entities.MAP, name="OpenStreetMap")] if on_map else []
    return rrb.Horizontal(
        rrb.Vertical(whole, *maps),
        rrb.Vertical(*(_plot(plot, flights, 1.0 / len(beside)) for plot in beside)),
        rrb.Vertical(chase, rrb.TextDocumentView(origin=entities.LEGEND, name="Runs")),
        column_shares=[1.0 - MIDDLE - SIDE, MIDDLE, SIDE],
    )


def leader(flights: Sequence[DrawnRun]) -> DrawnRun:
    """The run that the view follows: the first that ended early, else the longest."""
    for drawn_run in flights:
        if drawn_run.run.status != "completed":
            return drawn_run
    return max(reversed(flights), key=lambda drawn_run: drawn_run.run.duration)


def _tab(plots: Sequence[Plot], flights: Sequence[DrawnRun]) -> rrb.Grid:
    """A grid of plots; two plots are stacked on one time axis."""
    columns = (
        min(round(math.sqrt(COLUMNS_PER_ROW * len(plots))), MOST_COLUMNS) if len(plots) > 2 else 1
    )
    share = 1.0 / math.ceil(len(plots) / columns)
    return rrb.Grid(*(_plot(plot, flights, share) for plot in plots), grid_columns=columns)


def _plot(plot: Plot, flights: Sequence[DrawnRun], share: float) -> rrb.TimeSeriesView:
    runs = [flight.run for flight in flights]
    longest, span = max(run.duration for run in runs), value_range(plot, runs, share=share)
    # Plots of short flights share one axis. For longer flights each plot has its own axis, because
    # the viewer opens a shared axis with only half a minute to each side of now.
    axis = rrb.TimeAxis(link=LinkAxis.LinkToGlobal)
    if longest > SHARED_AXIS_S:
        start, end = (rr.TimeRangeBoundary.absolute(seconds=s) for s in (0.0, longest))
        axis = rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end))
    return rrb.TimeSeriesView(
        origin=f"{entities.PLOTS}/{plot.signal}",
        name=plot.heading,
        axis_x=axis,
        # Without a span the viewer chooses the range.
        axis_y=None if span is None else rrb.ScalarAxis(range=span),
        # A legend would cover small plots; the list on Overview names the runs.
        plot_legend=rrb.PlotLegend(visible=False),
    )


def _scene_view(
    name: str, eye: scene.Eye, *contents: str, origin: str = entities.WORLD
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


ABOUT = {"verifies": "Verifies", "source": "Source"}

RUN_COLUMNS = [*columns("run colour"), Column("flown_s", "flown", "s", ".2f"), *columns("outcome")]
GAIN_COLUMNS = columns("gains R_K I_K E_K K_P K_I", of="gains_recorded")


def scenario_page(
    runs: Sequence[Run],
    *,
    scenario: Mapping[str, Any],
    indicators: Mapping[str, Indicators] | None = None,
) -> str:
    """The page of text in a recording, as Markdown; `indicators` by name of gain set."""
    metrics, flight = metric_tables(runs)
    parts = [f"# {scenario.get('title', 'Flight')}"]
    parts += [f"**{word}:** {scenario[key]}" for key, word in ABOUT.items() if scenario.get(key)]
    parts += ["## Runs", *_runs(runs), "## Gains", _gains(runs, indicators or {})]
    if len(metrics):
        labels = [f"{run}, {SYMBOLS.get(channel, channel)}" for run, channel in metrics.index]
        parts += ["## Tracking", _metrics("run, channel", labels, metrics)]
        parts += ["## Aircraft", _metrics("run", list(map(str, flight.index)), flight)]
    parts += ["## How to read it", TEXTS["how_to_read"]]
    parts += ["## Scenario", f"```toml\n{toml_text(scenario)}```"]
    if runs:
        first, seconds = runs[0].provenance, sum(run.provenance.wall_s for run in runs)
        versions = ", ".join(f"{name} {number}" for name, number in first.versions.items())
        parts.append(f"Seed {first.seed}; {versions}; flown in {seconds:.2f} s.")
    return "\n\n".join(parts) + "\n"


def _runs(runs: Sequence[Run]) -> list[str]:
    styles = run_styles(runs)
    records = [
        {
            "run": run.label,
            "colour": styles[run.label].name if len(run.signals) > 1 else "not drawn",
            "flown_s": run.duration,
            "outcome": run.outcome,
        }
        for run in runs
    ]
    notes = [*priority_notes(runs), *claim_notes(runs)]
    claims = [TEXTS["claims"], *notes] if notes else []
    return [Table(RUN_COLUMNS, records).markdown(), *claims]


def _gains(runs: Sequence[Run], indicators: Mapping[str, Indicators]) -> str:
    records = []
    for name, gains in {x.provenance.gains_name: x.provenance.gains for x in runs}.items():
        marks = pick(indicators[name], "R_K I_K E_K") if name in indicators else {}
        records.append({"gains": name, **marks, **(gains.as_lists() if gains else {})})
    return Table(GAIN_COLUMNS, records).markdown()


def _metrics(heading: str, labels: Sequence[str], metrics: pd.DataFrame) -> str:
    # the mean follows from ITAE, which is on the page, and the time flown
    names = [name for name in map(str, metrics) if name in METRIC_LABELS and name != "ITAE_mean"]
    layout = [Column(heading, heading), *columns(" ".join(names))]
    return Table(layout, metrics.assign(**{heading: labels}).to_dict(orient="records")).markdown()


def log_legends(stream: rr.RecordingStream, flights: Sequence[DrawnRun]) -> None:
    """Log the sentence of each tab, and the number and colour of each run."""
    texts = {entities.reading(tab): about["shows"] for tab, about in TEXTS["tabs"].items()}
    texts[entities.reading(entities.OVERVIEW_TAB)] += f" {reading_line(flights)}"
    texts[entities.LEGEND] = "".join(
        f"{flight.number}. {flight.run.label}: {flight.style.name}, {flight.run.outcome}\n"
        for flight in flights
    )
    for entity, text in texts.items():
        entities.log_still(stream, entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


def reading_line(flights: Sequence[DrawnRun]) -> str:
    """Legend of colours, lines and arrows as Markdown."""
    made_by = [drawn_run.run.provenance for drawn_run in flights]
    pairs = [(flight.plant, flight.gains_name) for flight in made_by]
    same = len({gains for _, gains in pairs}) == 1
    parts = ["**Colour:** plant" if same else "**Colour:** run"]
    if hue_tells_gains(pairs) and not same:
        parts = ["**Hue:** gains"]
    if any(flight.aircraft is None for flight in made_by):
        parts.append("**dashed, outline:** a law")
    claims = {claim.kind for drawn_run in flights for claim in drawn_run.run.claims}
    if "proven" in claims:
        parts.append("**thin around a signal:** proven tube")
    if "counted" in claims:
        parts.append("**dashed around a signal:** counted band")
    parts += [
        f"**aircraft:** {drawn_scale(flights):g} times their size",
        "**arrow:** velocity",
        f"**grid:** {ground_grid(all_positions(flights))[1]:g} m",
    ]
    return ", ".join(parts) + "."
