"""The page of a claim with charts of a tube or a band, and plots of claims and flights."""

import hashlib
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.answers.answer import Answer, facts_table
from flighttune.base.answers.chart import DASHED, DOTTED, HEIGHT, LONG, Chart, Sheet, dashes
from flighttune.base.answers.frame import Report, Section, write_answer
from flighttune.base.answers.palette import HUES, LIMIT, NEUTRAL, PLANTS
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.table import toml_text
from flighttune.base.files.whole import current
from flighttune.base.names import shown_unit
from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import quoted
from flighttune.claims.band import KEPT, Band, SignalBounds, TurnBack
from flighttune.claims.counted import Counted
from flighttune.claims.monitor import LogMonitor
from flighttune.claims.shape import predicted
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.verify import AnyClaim, stale_notes
from flighttune.control.certificates.certificate import Certificate
from flighttune.flight.flown import FlownScenario
from flighttune.flight.loop.run import Run
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.pages.charts import APART, DISTANCE_AXIS, KM, heights, route_map
from flighttune.outputs.pages.panels import ERRORS, SIGNALS, TEXTS, errors, flown_signals, titles
from flighttune.routes.fence import read_fence
from flighttune.routes.maps import NOT_SEEN, ground_at, on_earth, rings_around

# Fewest flights drawn inside the band, if so many are.
MIN_DRAWN = 100

STRONG, LIGHT = (colour for colour, _ in HUES[0])

# Lines of a map, each with a look of its own, also without colours: the volumes around a route from
# inside out, and its fences in turn.
VOLUMES = (HUES[2][0][0], ""), (PLANTS[3][0], DASHED), (HUES[3][0][0], DOTTED)
FENCES = "", LONG, DASHED, DOTTED


def band_charts(
    band: SignalBounds, room: TurnBack | None = None, terrain: str | Path | None = None
) -> list[Chart]:
    """Each signal with the flights that were counted; on a route its map and heights first."""
    charts = [_chart(band, i) for i in range(len(band.about.signals))]
    if not (isinstance(band, Band) and band.flights.over == "along"):
        return charts
    return [_map(band, room), _heights(band, terrain), *charts]


def _chart(band: SignalBounds, i: int) -> Chart:
    """One signal: the band, and flights in it, outside of it and nearest to leaving it."""
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
    # both extremes of a window, one after the other
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
    for drawn, colour, words, width in (
        (flights[chosen], LIGHT, f"{len(chosen)} of {len(inside)} inside", 0.5),
        (flights[outside], LIMIT, f"{len(outside)} outside", 0.9),
    ):
        if len(drawn):  # all as one line that is broken between them
            ys = np.pad(drawn, ((0, 0), (0, 1)), constant_values=np.nan).ravel()
            xs = np.tile(np.append(x, np.nan), len(drawn))
            chart.line(xs, ys, colour, name=words, width=width, most=len(xs), hover=False)
    if band.claims:
        nearest = flights[band.draws.tolist().index(band.nearest)]
        chart.line(x, nearest, STRONG, name=f"draw {band.nearest}, nearest to leaving")
    return chart


def _corridor(band: Band, signal: str, s: FloatArray) -> FloatArray | None:
    """The claim of a band about a signal at distances along the route, if it has one."""
    about = band.about
    if signal not in about.signals or not band.claims or about.predicted_from:
        return None
    bounds, i = band.bounds(s), list(about.signals).index(signal)
    return np.stack([bounds.low[:, i], bounds.high[:, i]])


def _map(band: Band, room: TurnBack | None) -> Chart:
    """The route from above with the corridor that the band claims, if it does, and its fences."""
    path, origin, _ = band.flights.route.where
    s = path.points(APART)
    wind = band.flights.distribution.air_words.get("wind", "")
    chart = route_map(band.flights.central, path, s, _corridor(band, "cross_track", s), wind)

    def rings(lines: Iterable[FloatArray], colour: str, name: str, dash: str, **more: Any) -> None:
        """Lines of north and east as one that is broken between them."""
        north, east = np.vstack([part for x in lines for part in (x, [[np.nan, np.nan]])]).T
        chart.line(east, north, colour, name=name, dash=dash, most=len(north), hover=False, **more)

    fences = band.about.fences
    for number, tables in enumerate(fences, start=1):
        fence, name = read_fence(KEPT, origin, tables), f"fence {number}" * (len(fences) > 1)
        dash = FENCES[(number - 1) % len(FENCES)]
        rings(np.stack([fence.start, fence.end], axis=1), LIMIT, name or "fence", dash)
        if (rows := band.inside(tables).nearest) and np.isfinite(rows[0]["margin_m"]):
            nearest = min(rows, key=lambda row: row["margin_m"])
            ((at, across, _),) = path.beside(np.array([nearest["along_m"]]))
            words = f"nearest to it: {nearest['margin_m']:.0f} m"
            chart.points(across, at, LIMIT, size=5.0, filled=False, name=words)
    if room is not None and room.claims and band.claims:
        for (name, volume), look in zip(room.volumes(band).items(), VOLUMES, strict=True):
            colour, dash = look
            rings(rings_around(path, volume.width), colour, name, dash, width=1.2)
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
        fence = read_fence(KEPT, origin, tables)
        for height, name, dash in ((fence.high, "ceiling", ""), (fence.low, "floor", DASHED)):
            if np.isfinite(height):
                ends = [0.0, path.length / KM]
                chart.line(ends, [height, height], LIMIT, name=name, dash=dash)
    return chart


def _room(room: TurnBack) -> Chart:
    """How far from the route and from its height each counted flight came that turned back."""
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


def write_claim_page(
    claim: AnyClaim,
    source: str,
    path: str | Path,
    room: TurnBack | None = None,
    terrain: str | Path | None = None,
    said: Answer | None = None,
) -> Report:
    """Write one self-contained page about the claim in the file `source`.

    Its map has the volumes in which flights turn back in their `room`. `said` is the answer of a
    mission, whose lines stand on the page in place of those of its band.
    """
    answer = claim.answer(source) if isinstance(claim, Counted) else claim.answer()
    facts = {
        "file": source,
        "its SHA-256": hashlib.sha256(current(Path(source)).read_bytes()).hexdigest(),
    }
    sentences, notes, charts = [claim.sentence], [*stale_notes(claim), *answer.notes], []
    title, texts, tables = "Bound on R_K", {}, [*answer.tables]
    if isinstance(claim, Certificate):
        title = "Certificate"
    elif isinstance(claim, LogMonitor):
        title = "Monitor of logs"
    elif isinstance(claim, Tube):
        problem, settings, charts = claim.problem, claim.settings, tube_charts(claim)
        title = f"Tube: {problem.scenario.title}"
        texts["scenario.toml"] = toml_text(problem.scenario.as_dict())
        facts["law"] = problem.law.name
        facts["settings"] = f"{settings.symbols} symbols, {settings.most} pieces at most"
    elif isinstance(claim, Counted):
        about, kind = claim.about, "Count"
        campaign, on_route = about.plan["campaign"], claim.flights.over == "along"
        texts["scenario.toml"] = toml_text(claim.flights.scenario.as_dict())
        texts["campaign.toml"] = toml_text(campaign)
        facts["flights"] = f"{len(claim.scores)} counted, {about.learned} learned from"
        facts["flights lost"] = claim.lost
        facts["seed"] = f"{campaign['seed']}"
        notes = [note for note in notes if note != claim.sentence]
        if isinstance(claim, SignalBounds):
            charts, kind = band_charts(claim, room, terrain), "Counted band"
        elif isinstance(claim, TurnBack):
            charts = [_room(claim)]
        title = f"{kind} of flights titled {quoted(campaign['title'])}"
        if on_route:
            tables += claim.flights.route.answer().tables
        if isinstance(claim, Band):
            sentences += claim.said_of_fences
        if isinstance(claim, Band) and on_route:
            notes, sentences = [*notes, *sentences], (said or answer).summary
            title = f"Mission {quoted(campaign['title'])}"
            notes += [NOT_SEEN] * (terrain is None)
        if room is not None:
            turning = room.answer()
            notes += [room.sentence, *(note for note in turning.notes if "--run" not in note)]
            tables.append(turning.tables[0])
        if isinstance(claim, SignalBounds):
            notes += [TEXTS["band"], *([TEXTS["predicted"]] if about.predicted_from else [])]
    drawn = [table for table in tables if table.name == "dispersions"]
    others = [table for table in tables if table.name != "dispersions"]
    page = write_answer(
        path,
        title=title,
        summary=sentences,
        parts={
            "responses": Section(note=(said or answer).changed, charts=charts),
            "flown": Section(tables=drawn),
            "claim": Section(note=notes, tables=others),
        },
        provenance=facts_table("Provenance", facts),
        commands=f"flighttune verify {source}",
        texts=texts,
    )
    return replace(page, shown=claim.answer())


def tube_charts(tube: Tube) -> list[Chart]:
    """Both errors: the bounds of every flight."""
    charts, t = [], tube.bounds.t
    for signal in (name for name in ERRORS if name in tube.bounds.names):
        title, label = SIGNALS[signal]
        chart = Chart(title=title, y=label, x_range=(0.0, float(t[-1])), linked=True)
        chart.level(0.0, NEUTRAL, dash="")
        low, high = DEG_PER_RAD * tube.bounds.of([signal]).pairs[:, 0].T
        chart.band(t, low, high, STRONG, name="tube")
        for edge in (low, high):
            chart.line(t, edge, STRONG, width=1.2)
        charts.append(chart)
    return charts


def plot(value: FlownScenario | Run | Iterable[Run] | SignalBounds | Tube) -> Sheet:
    """Draw flights or what is claimed of them.

    Parameters
    ----------
    value : FlownScenario, Run or iterable of Run; Band or Residual; Tube
        Flights: both errors, roll and load factor over time, with their limits and claims. A band:
        each signal with the flights that were counted, on a route its map before them. A tube: the
        bounds of both errors.

    Returns
    -------
    Sheet
        Angles in degrees; a notebook shows it, ``save`` writes an SVG file.

    Raises
    ------
    InputError
        If no run has flown.

    Examples
    --------
    >>> ft.plot(ft.fly(ft.load_scenario("paper_as_printed"))).save("flight.svg")
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> ft.plot(band).save("band.svg")
    """
    if isinstance(value, SignalBounds | Tube):
        charts = tube_charts(value) if isinstance(value, Tube) else band_charts(value)
        return Sheet(charts=charts)
    runs = value.runs if isinstance(value, FlownScenario) else value
    runs = (runs,) if isinstance(runs, Run) else tuple(runs)
    styles = run_styles(runs)
    if not (flights := [(run, styles[run.label]) for run in runs if len(run.signals) > 1]):
        raise InputError("`value` must have a run that flew, got none.")
    charts = [*errors(flights), *flown_signals(flights)]
    for chart in charts:
        chart.legend = [(run.label, style.colour, dashes(style)) for run, style in flights]
    return Sheet(charts=charts)
