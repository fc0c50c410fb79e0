"""The page of a claim with charts of a tube or a band, and plots of claims and flights."""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.claims import AnyClaim, stale_notes
from flighttune.certificates.certificate import Certificate
from flighttune.claims.band import KEPT, Band, SignalBounds, TurnBack
from flighttune.claims.counted import Counted
from flighttune.claims.shape import predicted
from flighttune.errors import InputError
from flighttune.files.table import toml_text
from flighttune.flight.flown import FlownScenario
from flighttune.present.answer import facts_table, quoted
from flighttune.present.chart import DOTTED, Chart, Sheet, dashes
from flighttune.present.frame import Report, Section, write_answer
from flighttune.present.names import shown_unit
from flighttune.present.palette import HUES, LIMIT, NEUTRAL
from flighttune.references.fence import read_fence
from flighttune.references.maps import NOT_SEEN, ground_at, on_earth, rings_around
from flighttune.reports.charts import APART, DISTANCE_AXIS, KM, ROUTE_ERRORS, route_map
from flighttune.reports.panels import ERRORS, errors, flown_signals
from flighttune.simulate.run import Run, run_styles
from flighttune.tubes.enclosure import Tube
from flighttune.units import DEG_PER_RAD

# Fewest flights drawn inside the band, if so many are.
MIN_DRAWN = 100

STRONG, LIGHT = (colour for colour, _ in HUES[0])

# Titles and labels of signals; others have their names.
TITLES = {name: (title, label) for name, title, label in (*ERRORS, *ROUTE_ERRORS)}


def band_charts(
    band: SignalBounds, room: TurnBack | None = None, terrain: str | Path | None = None
) -> list[Chart]:
    """Each signal with the flights that were counted; on a route its map before them.

    `room`: of flights of the route that turn back. `terrain`: a file of heights of the ground.
    """
    charts = [_chart(band, i) for i in range(len(band.about.signals))]
    if not (isinstance(band, Band) and band.flights.over == "along"):
        return charts
    return [_map(band, room), _heights(band, terrain), *charts]


def _chart(band: SignalBounds, i: int) -> Chart:
    """One signal: the band, and flights in it, outside of it and nearest to leaving it."""
    about = band.about
    name, si = list(about.signals.items())[i]
    unit, factor = shown_unit(si)
    title, label = TITLES.get(name, (name, f"{name} [{unit}]"))
    edges, axis = band.flights.edges, "t [s]"
    if band.flights.over == "along":
        edges, axis = edges / KM, DISTANCE_AXIS
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
    chosen = inside[:: max(1, len(inside) // MIN_DRAWN)]
    _lines(chart, x, factor * flights[chosen], LIGHT, f"{len(chosen)} of {len(inside)} inside", 0.5)
    _lines(chart, x, factor * flights[outside], LIMIT, f"{len(outside)} outside", 0.9)
    if band.claims:
        nearest = factor * flights[band.draws.tolist().index(band.nearest)]
        chart.line(x, nearest, STRONG, name=f"draw {band.nearest}, nearest to leaving")
    return chart


def _map(band: Band, room: TurnBack | None) -> Chart:
    """The route from above with the corridor that the band claims, if it does, and its fences."""
    about, (path, origin, _) = band.about, band.flights.route.where
    s, sides = path.points(APART), None
    if "cross_track" in about.signals and band.claims and not about.predicted_from:
        bounds, i = band.bounds(s), list(about.signals).index("cross_track")
        sides = np.stack([bounds.low[:, i], bounds.high[:, i]])
    chart = route_map(band.flights.central, path, s, sides)
    for tables in about.fences:
        fence = read_fence(KEPT, origin, tables)
        ends = np.stack([fence.start, fence.end, np.full_like(fence.end, np.nan)], axis=1)
        north, east = ends.reshape(-1, 2).T
        chart.line(east, north, LIMIT, name="fence", most=len(north), hover=False)
        if (rows := band.inside(tables).nearest) and np.isfinite(rows[0]["margin_m"]):
            nearest = min(rows, key=lambda row: row["margin_m"])
            ((at, across, _),) = path.beside(np.array([nearest["along_m"]]))
            words = f"nearest to it: {nearest['margin_m']:.0f} m"
            chart.points(across, at, LIMIT, size=5.0, filled=False, name=words)
    if room is not None and room.claims and band.claims:
        for name, volume in room.volumes(band).items():
            breaks = [
                np.vstack([ring, [np.nan, np.nan]]) for ring in rings_around(path, volume.width)
            ]
            north, east = np.concatenate(breaks).T
            chart.line(east, north, NEUTRAL, name=name, most=len(north), hover=False)
    return chart


def _heights(band: Band, terrain: str | Path | None) -> Chart:
    """Height over the start along the route, in the band, with floor and ceiling of its fences."""
    about, (path, origin, h_0) = band.about, band.flights.route.where
    ends = 0.0, path.length / KM
    chart = Chart(title="Height over the start", x=DISTANCE_AXIS, y="h [m]", x_range=ends)
    s = path.points(APART)
    if "height_err" in about.signals and band.claims and not about.predicted_from:
        bounds, i = band.bounds(s), list(about.signals).index("height_err")
        high, low = (path.beside(s, below=x[:, i])[:, 2] for x in (bounds.low, bounds.high))
        chart.band(s / KM, low, high, NEUTRAL, name="corridor")
    chart.line(s / KM, np.interp(s, path.s, path.up), STRONG, name="planned")
    if terrain is not None:
        ground = ground_at(terrain, on_earth(path.beside(s), origin)) - h_0
        chart.line(s / KM, ground, NEUTRAL, name="ground")
    for tables in about.fences:
        fence = read_fence(KEPT, origin, tables)
        for height, name in ((fence.high, "ceiling"), (fence.low, "floor")):
            if np.isfinite(height):
                chart.line(np.array(ends), np.full(2, height), LIMIT, name=name)
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


def _lines(
    chart: Chart, x: FloatArray, flights: FloatArray, colour: str, name: str, width: float
) -> None:
    """A line for each flight, as one line that is broken between them."""
    if len(flights):
        gap = np.full((len(flights), 1), np.nan)
        ys = np.hstack([flights, gap]).ravel()
        xs = np.tile(np.append(x, np.nan), len(flights))
        chart.line(xs, ys, colour, name=name, width=width, most=len(xs), hover=False)


BAND_NOTE = "A line joins the lowest and the highest value of a counted flight in each window."
GIVEN = "The middle predicted from the wind of each flight is subtracted."


def write_claim_page(
    claim: AnyClaim,
    source: str,
    path: str | Path,
    room: TurnBack | None = None,
    terrain: str | Path | None = None,
    changed: Sequence[str] = (),
) -> Report:
    """Write one self-contained page about the claim in the file `source`.

    `room`: of the flights of the same route that turn back, whose volumes are drawn on its map.
    `terrain`: a file of heights of the ground, which are drawn. `changed`: sentences that stand
    above the charts, by default those of the claim's answer.
    """
    answer = claim.answer(source) if isinstance(claim, Counted) else claim.answer()
    facts = {"file": source, "its SHA-256": hashlib.sha256(Path(source).read_bytes()).hexdigest()}
    sentences, notes, charts = [claim.sentence], [*stale_notes(claim), *answer.notes], []
    tables = [*answer.tables]
    title, commands, scenario = "Bound on R_K", f"flighttune verify {source}", ""
    campaign = ""
    if isinstance(claim, Certificate):
        title = "Certificate"
    elif isinstance(claim, Tube):
        problem, settings, charts = claim.problem, claim.settings, tube_charts(claim)
        title, scenario = f"Tube: {problem.scenario.title}", toml_text(problem.scenario.as_dict())
        facts["law"] = problem.law.name
        facts["settings"] = f"{settings.symbols} symbols, {settings.most} pieces at most"
    elif isinstance(claim, Counted):
        about = claim.about
        kind = "Count"
        if isinstance(claim, SignalBounds):
            charts, kind = band_charts(claim, room, terrain), "Counted band"
        elif isinstance(claim, TurnBack):
            charts = [_room(claim)]
        title = f"{kind} of flights titled {quoted(about.plan['campaign']['title'])}"
        facts["flights"] = f"{len(claim.scores)} counted, {about.learned} learned from"
        facts["flights lost"] = claim.lost
        facts["seed"] = f"{about.plan['campaign']['seed']}"
        if claim.flights.over == "along":
            tables += claim.flights.route.answer().tables
        sentences += claim.said_of_fences if isinstance(claim, Band) else []
        notes = [note for note in notes if note != claim.sentence]
        if isinstance(claim, Band) and claim.flights.over == "along":
            notes, sentences = [*notes, *sentences], claim.summary(room)
            title = f"Mission {quoted(about.plan['campaign']['title'])}"
            notes += [NOT_SEEN] * (terrain is None)
        scenario = toml_text(claim.flights.scenario.as_dict())
        campaign = toml_text(about.plan["campaign"])
        if room is not None:
            turning = room.answer()
            notes.append(room.sentence)
            notes += [note for note in turning.notes if "--run" not in note]
            tables.append(turning.tables[0])
        if isinstance(claim, SignalBounds):
            notes += [BAND_NOTE, *([GIVEN] if about.predicted_from else [])]
    drawn, said = [x for x in tables if x.name == "dispersions"], changed or answer.changed
    others = [table for table in tables if table.name != "dispersions"]
    return write_answer(
        path,
        title=title,
        summary=sentences,
        parts={
            "responses": Section(note=" ".join(said), charts=charts, legend=False),
            "flown": Section(tables=drawn, legend=False),
            "claim": Section(note=" ".join(notes), tables=others, legend=False),
        },
        provenance=facts_table("Provenance", facts),
        commands=commands,
        texts={"scenario.toml": scenario, "campaign.toml": campaign},
    )


def tube_charts(tube: Tube) -> list[Chart]:
    """Both errors: the bounds of every flight."""
    charts, bounds = [], tube.bounds
    for i, (_, title, unit) in enumerate(ERRORS):
        chart = Chart(title=title, y=unit, x_range=(0.0, float(bounds.t[-1])), linked=True)
        chart.level(0.0, NEUTRAL, dash="")
        low, high = bounds.low[:, i] * DEG_PER_RAD, bounds.high[:, i] * DEG_PER_RAD
        chart.band(bounds.t, low, high, STRONG, name="tube")
        for edge in (low, high):
            chart.line(bounds.t, edge, STRONG, width=1.2)
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
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10}
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
