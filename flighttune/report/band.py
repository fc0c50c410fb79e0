"""The page of a counted band: its signals with the flights that were counted, and its claim."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.guarantee.band import Band, predicted
from flighttune.present.chart import DOTTED, Chart
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.names import shown_unit
from flighttune.present.palette import HUES, LIMIT, NEUTRAL
from flighttune.present.tables import Table, facts_table
from flighttune.report.panels import ERRORS
from flighttune.report.route_charts import DISTANCE_AXIS, KM, ROUTE_ERRORS

# Fewest flights drawn inside the band, if so many are.
MIN_DRAWN = 100

(STRONG, _), (LIGHT, _) = HUES[0]

# Titles and labels of signals; others have their names.
TITLES = {name: (title, label) for name, title, label in (*ERRORS, *ROUTE_ERRORS)}

NOTE = "A line joins the lowest and the highest value of a counted flight in each window."
GIVEN = "The middle predicted from the wind of each flight is subtracted."


def write_band_page(
    band: Band, source: str, path: str | Path, tables: Sequence[Table], notes: Sequence[str]
) -> Report:
    """Write one self-contained page about the band in the file `source`.

    Raises OutputError if the file cannot be written.
    """
    about = band.about
    facts = {
        "band": source,
        "flights": f"{len(band.scores)} counted, {about.learned} learned from",
        "flights not completed": f"{band.not_completed}",
        "seed": f"{about.plan['campaign']['seed']}",
    }
    note = " ".join([NOTE, *([GIVEN] if about.predicted_from else []), *notes])
    charts = [_chart(band, i) for i in range(len(about.signals))]
    return write_page(
        Path(path),
        page_template("flighttune.report", "commands.html.jinja"),
        summary=(f"{band.sentence[:1].upper()}{band.sentence[1:]}.",),
        sections=[Section(note=note, charts=charts, tables=tables)],
        title=f"Counted band: {about.plan['campaign']['title']}",
        provenance=facts_table("Provenance", facts),
        commands=f"flighttune verify {source}\nflighttune band {source} --recount 20",
    )


def _chart(band: Band, i: int) -> Chart:
    """One signal: the band, and flights in it, outside of it and nearest to leaving it."""
    about = band.about
    name, si = list(about.signals.items())[i]
    unit, factor = shown_unit(si)
    title, label = TITLES.get(name, (name, f"{name} [{unit}]"))
    edges, axis = about.edges, "t [s]"
    if about.over == "along":
        edges, axis = about.edges / KM, DISTANCE_AXIS
    chart = Chart(title=title, x=axis, y=label, linked=True)
    flights = band.extremes[..., i, :].astype(float)
    middle = predicted(band.wind, about.coefficients)[..., i]
    if about.predicted_from:
        flights, middle = flights - middle[..., None], np.zeros_like(middle)
    # both extremes of a window, one after the other
    flights = flights.reshape(len(flights), -1)
    x = np.linspace(edges[0], edges[-1], flights.shape[1])
    low, high = (
        factor * np.repeat(middle[0] + sign * band.half_widths[:, i], 2) for sign in (-1.0, 1.0)
    )
    chart.band(x, low, high, NEUTRAL, name="counted band")
    for edge in (low, high):
        chart.line(x, edge, NEUTRAL, dash=DOTTED, width=1.2, hover=False)
    completed, within = np.isfinite(band.scores), band.scores <= band.scale
    inside, outside = (np.flatnonzero(completed & side) for side in (within, ~within))
    shown = inside[:: max(1, len(inside) // MIN_DRAWN)]
    _lines(chart, x, factor * flights[shown], LIGHT, f"{len(shown)} of {len(inside)} inside", 0.5)
    _lines(chart, x, factor * flights[outside], LIMIT, f"{len(outside)} outside", 0.9)
    if about.scale is not None:
        nearest = factor * flights[band.nearest - about.learned]
        chart.line(x, nearest, STRONG, name=f"draw {band.nearest}, nearest to leaving")
    return chart


def _lines(
    chart: Chart, x: FloatArray, flights: FloatArray, colour: str, name: str, width: float
) -> None:
    """A line for each flight, as one line that is broken between them."""
    if len(flights):
        gap = np.full((len(flights), 1), np.nan)
        ys = np.hstack([flights, gap]).ravel()
        xs = np.tile(np.append(x, np.nan), len(flights))
        chart.line(xs, ys, colour, name=name, width=width, most=len(xs), hover=False)
