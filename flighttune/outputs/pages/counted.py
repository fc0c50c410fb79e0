"""The pages of counted claims: charts of bands, the map of a mission and the room to turn back."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.files.table import toml_text
from flighttune.base.signals import titles
from flighttune.base.units import shown_unit
from flighttune.base.words import quoted
from flighttune.claims.band import KEPT, Band
from flighttune.claims.counted import Counted, SignalBounds
from flighttune.claims.mission import kept_mission
from flighttune.claims.shape import predicted
from flighttune.claims.turn_back import TurnBack
from flighttune.claims.verify import stale_notes
from flighttune.outputs.answers.answer import Answer
from flighttune.outputs.answers.finding import headlines
from flighttune.outputs.answers.mission import LINES
from flighttune.outputs.drawing.chart import DASHED, DOTTED, HEIGHT, LONG, Chart
from flighttune.outputs.drawing.palette import HUES, LIMIT, NEUTRAL, PLANTS
from flighttune.outputs.pages import sheet
from flighttune.outputs.pages.charts import (
    APART,
    DISTANCE_AXIS,
    KM,
    draw_edges,
    draw_ends,
    draw_rings,
    heights,
    route_map,
)
from flighttune.outputs.pages.claim import Asked, Parts
from flighttune.outputs.pages.panels import TEXTS
from flighttune.routes.fence import read_fence
from flighttune.routes.maps import NOT_SEEN, ground_at, on_earth
from flighttune.routes.volumes import rings_around

# Minimum number of drawn flights inside the band, if there are enough.
MIN_DRAWN = 100

STRONG, LIGHT = (colour for colour, _ in HUES[0])

# Line styles of a map, distinct even without colours: the volumes around a route from inside out,
# and its fences in turn.
VOLUMES = (HUES[2][0][0], ""), (PLANTS[3][0], DASHED), (HUES[3][0][0], DOTTED)
FENCES = "", LONG, DASHED, DOTTED


def band_charts(band: SignalBounds) -> list[Chart]:
    """Each signal with the counted flights."""
    return [chart_of(band, i) for i in range(len(band.about.signals))]


def mission_charts(
    band: Band, room: TurnBack | None = None, terrain: str | Path | None = None
) -> list[Chart]:
    """Each signal with the counted flights; for a route, first a map and heights."""
    if band.flights.over != "along":
        return band_charts(band)
    return [_map(band, room), _heights(band, terrain), *band_charts(band)]


def chart_of(band: SignalBounds, i: int) -> Chart:
    """One signal: the band, and flights inside, outside and nearest to leaving it."""
    about = band.about
    name, si = list(about.signals.items())[i]
    (title, label), (_, factor) = titles(name, si), shown_unit(si)
    along, edges = band.flights.over == "along", band.flights.edges
    edges, axis = (edges / KM, DISTANCE_AXIS) if along else (edges, "t [s]")
    chart = Chart(title=title, x=axis, y=label, linked=True)
    flights = band.extremes[..., i, :].astype(float)
    middle = predicted(band.wind, about.coefficients)[..., i]
    if about.predicted_from:
        flights, middle = flights - middle[..., None], np.zeros_like(middle)
    # minimum and maximum of a window in turn
    flights = factor * flights.reshape(len(flights), -1)
    x = np.linspace(edges[0], edges[-1], flights.shape[1])
    low, high = (
        factor * np.repeat(middle[0] + sign * band.half_widths[:, i], 2) for sign in (-1.0, 1.0)
    )
    chart.band(x, low, high, NEUTRAL, name="counted band")
    for edge in (low, high):
        chart.line(x, edge, NEUTRAL, dash=DOTTED, width=1.2, hover=False)
    completed, within = np.isfinite(band.scores), band.scores <= band.scale
    inside, outside = (np.flatnonzero(completed & side) for side in (within, ~within))
    chosen = inside[:: max(1, len(inside) // MIN_DRAWN)]
    some = f", {len(chosen)} drawn" if len(chosen) < len(inside) else ""
    for drawn, colour, words, width in (
        (flights[chosen], LIGHT, f"{len(inside)} inside{some}", 0.5),
        (flights[outside], LIMIT, f"{len(outside)} outside", 0.9),
    ):
        if len(drawn):  # all flights as one line with gaps
            ys = np.pad(drawn, ((0, 0), (0, 1)), constant_values=np.nan).ravel()
            xs = np.tile(np.append(x, np.nan), len(drawn))
            chart.line(xs, ys, colour, name=words, width=width, most=len(xs), hover=False)
    if band.claims:
        nearest = flights[band.draws.tolist().index(band.nearest)]
        chart.line(x, nearest, STRONG, name=f"draw {band.nearest}, nearest to leaving")
    return chart


def _corridor(band: Band, signal: str, s: FloatArray) -> FloatArray | None:
    """The claim of a band about a signal at distances along the route, if any."""
    about = band.about
    if signal not in about.signals or not band.claims or about.predicted_from:
        return None
    bounds, i = band.bounds(s), list(about.signals).index(signal)
    return np.stack([bounds.low[:, i], bounds.high[:, i]])


def _map(band: Band, room: TurnBack | None) -> Chart:
    """The route from above with the claimed corridor, if any, and its fences."""
    path, origin, _ = band.flights.route.where
    s = path.points(APART)
    wind = band.flights.distribution.air_words.get("wind", "")
    chart = route_map(band.flights.central, path, s, _corridor(band, "cross_track", s), wind)

    fences = band.about.fences
    for number, tables in enumerate(fences, start=1):
        fence, name = read_fence(KEPT, origin, tables), f"fence {number}" * (len(fences) > 1)
        dash = FENCES[(number - 1) % len(FENCES)]
        draw_edges(chart, fence, name or "fence", dash)
        if (rows := band.inside(tables).nearest) and np.isfinite(rows[0]["margin_m"]):
            nearest = min(rows, key=lambda row: row["margin_m"])
            ((at, across, _),) = path.beside(np.array([nearest["along_m"]]))
            words = f"nearest to it: {nearest['margin_m']:.0f} m"
            chart.points(across, at, LIMIT, size=5.0, filled=False, name=words)
    if room is not None and room.claims and band.claims:
        for (name, volume), look in zip(room.volumes(band).items(), VOLUMES, strict=True):
            colour, dash = look
            draw_rings(chart, rings_around(path, volume.width), colour, name, dash, width=1.2)
    return chart


def _heights(band: Band, terrain: str | Path | None) -> Chart:
    """Height over the start along the route, in the band, with floor and ceiling of its fences."""
    path, origin, h_0 = band.flights.route.where
    s = path.points(APART)
    chart = heights(path, s, _corridor(band, "height_err", s), HEIGHT)
    chart.line(s / KM, np.interp(s, path.s, path.up), STRONG, name="planned")
    if terrain is not None:
        ground = ground_at(terrain, on_earth(path.beside(s), origin)) - h_0
        chart.line(s / KM, ground, NEUTRAL, name="ground")
    for tables in band.about.fences:
        draw_ends(chart, read_fence(KEPT, origin, tables), path)
    return chart


def _room(room: TurnBack) -> Chart:
    """Largest distances from the route and its height of each counted flight that turned back."""
    x, y = "largest distance from the route [m]", "largest difference of height [m]"
    chart = Chart(title="Room to turn back", x=x, y=y)
    flights, inside = room.extremes[:, 0, :, 1].astype(float), room.scores <= room.scale
    for some, colour, name in ((inside, LIGHT, "inside"), (~inside, LIMIT, "outside")):
        there = some & np.isfinite(room.scores)
        across, up = flights[there].T
        chart.points(across, up, colour, name=f"{there.sum()} {name}")
    if room.claims:
        far, high = room.room.from_route, room.room.height
        chart.line([0.0, far, far], [high, high, 0.0], NEUTRAL, dash=DOTTED, name="the room")
    return chart


def counted(claim: Counted, asked: Asked) -> Parts:
    """The page of a count: its flights, their scenario and their campaign."""
    return _counted(claim, claim.answer(asked.source))


def _counted(claim: Counted, answer: Answer) -> Parts:
    about, campaign, tables = claim.about, claim.about.plan["campaign"], [*answer.tables]
    if claim.flights.over == "along":
        tables += claim.flights.route.answer().tables
    return Parts(
        title=f"Count of flights titled {quoted(campaign['title'])}",
        sentences=[claim.sentence],
        notes=[note for note in (*stale_notes(claim), *answer.notes) if note != claim.sentence],
        tables=tables,
        changed=answer.changed,
        facts={
            "flights": f"{len(claim.scores)} counted, {about.learned} learned from",
            "flights lost": claim.lost,
            "seed": f"{campaign['seed']}",
        },
        texts={
            "scenario.toml": toml_text(claim.flights.scenario.as_dict()),
            "campaign.toml": toml_text(campaign),
        },
    )


def turned_back(claim: TurnBack, asked: Asked) -> Parts:
    """The page of a count of flights that turned back."""
    return replace(counted(claim, asked), charts=[_room(claim)])


def bounds(claim: SignalBounds, asked: Asked) -> Parts:
    """The page of bounds on signals, each with a chart."""
    parts, title = counted(claim, asked), quoted(claim.about.plan["campaign"]["title"])
    return replace(
        parts,
        title=f"Counted band of flights titled {title}",
        charts=band_charts(claim),
        notes=[*parts.notes, *how_to_read(claim)],
    )


def how_to_read(claim: SignalBounds) -> list[str]:
    """How to read the chart of a band."""
    return [TEXTS["band"], *([TEXTS["predicted"]] if claim.about.predicted_from else [])]


def band(claim: Band, asked: Asked) -> Parts:
    """The page of a band; on a route that of its mission, with the room to turn back."""
    if claim.flights.over != "along":
        parts = bounds(claim, asked)
        return replace(parts, sentences=[claim.sentence, *claim.said_of_fences])
    mission = asked.mission or kept_mission(claim, Path(asked.source))
    said, parts = mission.answer(), _counted(claim, claim.answer(asked.source))
    # The tables of the page have the conditions and the terms of the exits per flight hour.
    in_tables = {said.summary[-1], *(mission.per_hour.answer().summary if mission.per_hour else ())}
    top = max(LINES, len(headlines(said.findings)) + 1)
    others = [x for x in said.summary[top:] if x not in in_tables]
    notes, tables = [*parts.notes, claim.sentence, *claim.said_of_fences], [*parts.tables]
    notes += [NOT_SEEN] * (mission.terrain is None)
    if mission.room is not None:
        turning = mission.room.answer()
        notes += [mission.room.sentence, *(note for note in turning.notes if "--run" not in note)]
        tables.append(turning.tables[0])
    return replace(
        parts,
        title=f"Mission {quoted(claim.flights.scenario.title)}",
        heading="Map, heights and corridor",
        sentences=said.summary[:top],
        found=said.found,
        shown=said,
        changed=[*others, *said.changed],
        notes=[*notes, *how_to_read(claim)],
        tables=tables,
        below=sheet.volumes(mission),
        conditions=sheet.tables(mission),
        charts=mission_charts(claim, mission.room, mission.terrain),
    )
