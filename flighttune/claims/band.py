"""Kinds of counts: bands, residual signals, room to turn back, monitors; and their files."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flighttune.base.answers.answer import Answer, Table
from flighttune.base.answers.labels import columns, endings_table
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.endings import endings as counted_endings
from flighttune.base.endings import why_ended
from flighttune.base.errors import InputError, naming, printable
from flighttune.base.files import array, load
from flighttune.base.files.table import abridged, json_object, value_of
from flighttune.base.words import at_most, listed, number, pick
from flighttune.campaigns.statistics.count import supported_epsilon, sure
from flighttune.claims import counted
from flighttune.claims.monitor import Monitor
from flighttune.claims.shape import MAX_NUMBERS
from flighttune.flight.loop.run import SIGNAL_UNITS, Bounds, Run, RunClaim
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.flight.scenario.load import scenario_of
from flighttune.gaps.watch import MODELS
from flighttune.routes.fence import DISTANCE_SIGNS, read_fence, room_along
from flighttune.routes.follow import SAME_PLACE
from flighttune.routes.maps import Corridor, Volume, Where, areas_of
from flighttune.routes.turn_back_keys import BACK_S, TurnBackTable

# Rounding of the times of samples, s.
SAME_TIME = 1e-9

# Stands for the file of a fence that is kept with its band.
KEPT = Path("fence")

# Distance in samples, at the airspeed, by which positions may lie beyond the edges of a window.
OVERLAP_SAMPLES = 2.0

NEAREST_COLUMNS = columns("what margin_m side edge along_m stretch", of="fence")


# What is said of a new flight and a fence where it is sure whether flights stay inside.
SURE = {
    "yes": "leaves the fence with probability at most",
    "no": "is not certainly inside the fence with probability above",
    "": "",
}

# Part of the time whose largest half-width is printed too: flights have settled by then.
LAST_QUARTER = 0.75


class Fenced(NamedTuple):
    """The flights of a band that are not certainly inside a fence."""

    heights: str  # floor and ceiling of the fence in words
    outside: int
    epsilon: float  # probability of leaving the fence that the count supports
    supported: bool  # whether it is at most that of the band
    nearest: list[dict[str, Any]]  # of the completed flights, and of the band if it has a corridor
    sentence: str


def check_off_route(signals: Iterable[str], over: str = "along") -> None:
    """Refuse a band without the distances from a route."""
    if over != "along" or not {*OFF_ROUTE} <= {*signals}:
        raise InputError(
            f"the band must be of {' and '.join(OFF_ROUTE)} along a route, got one of "
            f"{', '.join(signals)} over {'time' if over == 'time' else 'the distance along it'}."
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SignalBounds(counted.Counted):
    """A count whose signals have a width: bounds that a new flight leaves with some probability."""

    rounding: ClassVar[float] = 0.0  # s or m, of the places of the bounds

    @property
    def half_widths(self) -> FloatArray:
        """Half the width of each window and signal, shape (windows, signals)."""
        return self.scale * self.about.half

    def bounds(self, t: FloatArray, wind: FloatArray | None = None) -> Bounds:
        """Bounds at the times `t` (s), or the distances along a route (m), in a `wind`, (2,)."""
        about = self.about
        if (about.predicted_from is None) != (wind is None):
            raise InputError(f"`wind` must be there for a band that is given it only, got {wind}.")
        window = np.searchsorted(self.flights.edges, np.add(t, self.rounding), side="right") - 1
        window = np.clip(window, 0, len(about.half) - 1)
        low, high = self._ends(np.zeros((1, 0)) if wind is None else np.reshape(wind, (1, 2)))
        return Bounds(np.asarray(t, dtype=float), low[window], high[window], tuple(about.signals))

    def _sizes(self) -> list[dict[str, float]]:
        edges, rows = self.flights.edges, []
        late = edges[:-1] >= LAST_QUARTER * edges[-1]
        for widths in self.half_widths.T:
            last = widths[late].max(initial=0.0)
            rows.append({"largest": widths.max(), "last_quarter": last, "end": widths[-1]})
        if self.about.predicted_from is None:
            bounds = self.bounds(edges[:-1])
            for row, low, high in zip(rows, bounds.low.T, bounds.high.T, strict=True):
                row |= {"low": low.min(), "high": high.max()}
        return rows

    @property
    def _notes(self) -> list[str]:
        note = "The band is around a middle that is predicted from the wind of each flight."
        return [note] if self.about.predicted_from else []


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residual(SignalBounds):
    """Bounds on what the identified model of an aircraft misses: what `tube` takes.

    They are of the rates of course and path angle (rad/s), and of roll and its change over a sample
    (rad), actual minus model.

    Attributes
    ----------
    about, flights, extremes, wind, endings, scores, scale : as of a `Band`

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> ft.residual("feasible", start_deg=2.0, **few).outside
    0
    """

    of: ClassVar[counted.Of] = "residual"
    # They last from a sample to the next, and have no window but that of its time.
    rounding: ClassVar[float] = SAME_TIME

    @property
    def _leaves(self) -> str:
        return "leaves the band of its residual signals"


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band(SignalBounds):
    """Bounds that a flight of a distribution leaves with a stated probability: a counted claim.

    Attributes
    ----------
    about : About
        Shape of the band, plan of its flights, and its claim.
    flights : BandFlights
        Distribution of the flights, and the windows over time or along a route.
    extremes : ndarray of float32, shape (N, windows, signals, 2)
        Lowest and highest value of each signal in each window of each flight that was counted, in
        SI; infinite where it was not completed.
    wind : ndarray, shape (N, 2) or (N, 0), m/s
        Wind at the start of each flight to the north and east, if the band is given it.
    endings : sequence of mapping
        ``run``, ``status`` and ``reason`` of the flights counted that did not complete, as they
        were flown; none of a file of version 0.3.0.
    scores : ndarray, shape (N,)
        Scale at which each flight is just inside.
    scale : float
        Factor on the half-widths; infinite if nothing is claimed.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> bounds = band.bounds([0.0, 1.0])
    >>> bounds.names, bounds.low.shape
    (('chi_err', 'gamma_err'), (2, 2))
    """

    @property
    def _leaves(self) -> str:
        knowing = ", around the middle that its wind predicts," if self.about.predicted_from else ""
        return f"leaves the band{knowing}"

    def with_fence(self, tables: dict[str, Any]) -> "Band":
        """The band with a fence whose GeoJSON is `tables`; one that it has is its last then."""
        others = tuple(fence for fence in self.about.fences if fence != tables)
        return replace(self, about=replace(self.about, fences=(*others, tables)))

    def corridor(self, where: Where | None = None) -> Corridor:
        """The corridor, in any wind, along its route; an InputError refuses another one, `where`.

        InputError also if it claims nothing, or bounds no distances from a route.
        """
        about, columns = self.about, self._off_route()
        if about.predicted_from or not self.claims:
            claim = "one around a prediction from the wind" if about.predicted_from else "no claim"
            raise InputError(f"the band must claim one corridor for all flights, got {claim}.")
        if where and where != self.flights.route.where:  # a path is planned once
            raise InputError("the band must be of this route and start, got one of another.")
        edges = self.flights.edges
        bounds, windows = self.bounds(edges[:-1]), np.column_stack([edges[:-1], edges[1:]])
        low, high = bounds.low[:, columns], bounds.high[:, columns]
        return Corridor(windows, low, high, printable(self.sentence))

    def inside(self, tables: dict[str, Any], file: Path = KEPT) -> Fenced:
        """Count the flights that are not certainly inside a fence, GeoJSON in `tables`.

        Its `file` is named where the fence is refused.
        """
        about, central = self.about, self.flights.central
        columns, (path, origin, _) = self._off_route(), self.flights.route.where
        fence = read_fence(file, origin, tables)
        away, completed = DISTANCE_SIGNS * self.extremes[:, :, columns], np.isfinite(self.scores)
        reaches = {"completed flights": away[completed].max(axis=0)} if completed.any() else {}
        if self.claims and not about.predicted_from:
            corridor = self.corridor()
            reaches["band"] = DISTANCE_SIGNS * np.stack([corridor.low, corridor.high], axis=-1)
        widest = max([0.0, *(float(reach[:, 0].max()) for reach in reaches.values())])
        overlap = OVERLAP_SAMPLES * max(central.airspeeds) / central.controller.rate_hz
        room = room_along(fence, path, self.flights.edges, widest=widest, overlap=overlap)
        # The limits to the sides are finite: flights that were not completed are outside.
        outside = int(np.sum(~(away <= room.limits).all(axis=(1, 2, 3))))
        flights, first = len(away), max(self.first, len(away))
        if flights == about.early and not outside:
            first = flights
        # A flight that was not flown counts as one outside.
        epsilon = supported_epsilon(outside + first - flights, first, about.confidence, about.early)
        said = f"{flights - outside} of {flights} fresh flights are certainly inside"
        claimed, leaves = flights == first, f"{SURE['yes']} {at_most(epsilon)}"
        not_yet, at_any = f", of {first} planned: more may be outside than a yes allows", ""
        if about.until_sure:
            answer = sure(outside, flights, about.epsilon, about.confidence)
            epsilon = about.epsilon if answer == "yes" else 1.0
            claimed, leaves = answer != "", f"{SURE[answer]} {number(about.epsilon)}"
            not_yet, at_any = ": neither yes nor no is sure", " at any number of flights"
        return Fenced(
            fence.heights,
            outside,
            epsilon,
            epsilon <= about.epsilon,
            [{"what": what, **room.nearest(reach)} for what, reach in reaches.items()],
            f"a new flight {leaves}, confidence {self.confidence:.10g}{self.shared}{at_any}: {said}"
            if claimed
            else f"{said}{not_yet}",
        )

    @property
    def _not_inside(self) -> list[int]:
        return [self.inside(areas).outside for areas in self.about.fences] or [self.not_completed]

    def _off_route(self) -> list[int]:
        """Where the distances from a route are among the signals."""
        check_off_route(self.about.signals, self.flights.over)
        return [list(self.about.signals).index(name) for name in OFF_ROUTE]

    @property
    def said_of_fences(self) -> list[str]:
        """The claim about each fence in which the flights were counted."""
        return [self.inside(fence).sentence for fence in self.about.fences]

    def on(self, run: Run) -> RunClaim:
        """The bounds of the signals at the samples of a run."""
        about, scenario = self.about, scenario_of(run)
        wind = np.array(counted.wind_at_start(scenario)) if about.predicted_from else None
        return RunClaim(
            kind=self.kind,
            title="counted band",
            sentence=self.sentence,
            bounds=self.bounds(counted.axis_of(run), wind),
            units=about.signals,
            fences=tuple(ring for ring, _ in areas_of(about.fences)),
        )

    def answer(self, file: str | Path = "FILE") -> Answer:
        """The half-widths of the band in a file and its claim; a failure if nothing is claimed.

        Along a route it has the length and the time too. The claim about its last fence, if any, is
        the verdict then, and a failure if the count does not support it.
        """
        answer = counted.Counted.answer(self, file)
        try:
            return self._along_route(answer) if self.flights.over == "along" else answer
        except InputError as error:
            return replace(answer, verdict="", failure=str(error))

    def _along_route(self, answer: Answer) -> Answer:
        """The answer with the route, and with the count of flights inside its last fence."""
        planned, values = self.flights.route, dict(answer.values)
        values["route"] = {**pick(planned, "conditions time"), "length_m": planned.length}
        changed = [*self.flights.scenario.notes, *planned.changed]
        answer = replace(answer, values=values, changed=changed, summary=self.summary())
        if not self.about.fences:
            return answer
        count = self.inside(self.about.fences[-1])
        values["fence"] = count._asdict()
        notes = [*answer.notes, answer.verdict or answer.failure]
        for nearest in count.nearest:
            if nearest["what"] == "band":
                within = "inside" if nearest["margin_m"] >= 0.0 else "not inside"
                notes.append(f"The band itself is {within} the fence.")
        notes.append(f"The fence has {count.heights}.")
        if self.not_completed:
            notes.append(f"Of the flights {self.lost}: they count as outside.")
        asked = f"{count.sentence}; {self.about.epsilon:g} was asked for"
        return replace(
            answer,
            tables=[*answer.tables, Table(NEAREST_COLUMNS, count.nearest, "fence")],
            notes=notes,
            verdict=count.sentence if count.supported else "",
            failure="" if count.supported else asked,
        )

    @property
    def too_many_lost(self) -> bool:
        """Whether more flights than a claim allows did not complete, or count as if so."""
        return self.not_completed > self.allowed

    def summary(self, room: "TurnBack | None" = None) -> list[str]:
        """The answer of a mission in four lines: whether, the odds, how wide, and for what."""
        about, flights, planned = self.about, len(self.scores), self.flights.route
        allowed = self.allowed
        fenced = self.inside(about.fences[-1]) if about.fences else None
        confidence = self.confidence - (0.0 if room is None else 1.0 - room.confidence)
        slower = planned.except_slopes
        sure = f"at a confidence of {confidence:.6g} for all that is said here"
        if self.too_many_lost:
            answer = f"No: of {flights} flights {self.lost}; at most {allowed} of {self.first} may."
            odds = f"They ended so:{why_ended(self.endings).removesuffix('.')}."
        elif fenced is None:
            answer = f"Yes: the mission can be flown{slower}. It has no fence to stay inside."
            odds = (
                f"A new flight leaves its corridor with a probability of at most {about.epsilon:g}"
            )
            odds += f", {sure}: {self.outside} of {flights} flights did."
        else:
            nearest = min(fenced.nearest, key=lambda row: row["margin_m"])
            margin, at = nearest["margin_m"], "on the {stretch}, {along_m:.0f} m along ({edge}, "
            at = f"{at}{{side}})".format(**nearest)
            slower += "," * bool(slower)
            answer = f"Yes: the mission can be flown{slower} and stays inside its fence."
            odds = "A new flight leaves the fence with a probability of at most "
            odds += (
                f"{at_most(fenced.epsilon)}, {sure}: {fenced.outside} of {flights} flights did. "
            )
            odds += f"Nearest to it, {margin:.1f} m, it comes {at}."
            if not fenced.supported:
                answer = f"No: {fenced.outside} of {flights} flights are not certainly inside the "
                answer += f"fence; at most {allowed} of {self.first} may be outside."
                odds = f"They come furthest out {at}: {max(-margin, 0.0):.1f} m, which is the room "
                odds += "that the fence lacks there; a lower airspeed or wind may do too."
                if flights < self.first and fenced.outside <= allowed:
                    answer = (
                        f"Not known: {flights} of {self.first} flights were flown; `flighttune "
                    )
                    answer += f"band FILE --flights {self.first}` flies the others."
        if about.until_sure and fenced and not fenced.supported:
            more = f"`flighttune band FILE --flights {2 * self.first}` may be enough"
            answer = f"No: {fenced.sentence}." if self.decided else f"Not known: {more}."
        wide = "No corridor is claimed."
        if self.claims and not about.predicted_from:
            claimed = self.corridor()
            beside, above = np.abs([claimed.low, claimed.high]).max(axis=(0, 1))
            wide = (
                f"The corridor is at most {at_most(beside, 3)} m wide to either side of the path, "
            )
            wide += f"and {at_most(above, 3)} m high above and below it."
        if room is not None:
            wide += f" {room.summary}"
        flown = self.flights.distribution.sentence(self.flights.flown).partition("; drawn")[0]
        return [answer, odds, wide, f"It holds for {flown}, over {planned.answer().verdict}."]


# Signals of flights that turn back, m, each the largest since they detected that they must: the
# horizontal distance from the route, in any direction, and that of height from where they detected.
ROOM = {"from_route": "m", "height": "m"}


class TurnRoom(NamedTuple):
    """Room that a flight needs which turns back, m: no width and no height of a volume."""

    from_route: float  # in any horizontal direction
    height: float  # above and below

    def around(self, geography: Volume, claim: str) -> Volume:
        """The volume with this room around a flight geography, down to the ground at most."""
        width, high = geography.width + self.from_route, geography.high + self.height
        return Volume(width, max(geography.low - self.height, 0.0), high, claim)


# How flights ended, in words of a sentence.
ENDED = {"no_trim": "without a steady flight at their start"}


# How flights that turn back begin where their route has slopes.
BEGUN = "begun in steady flight or, where there is none on a slope, in level flight before it"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TurnBack(counted.Counted):
    """A count of how far flights come that turn back at any place of their route."""

    of: ClassVar[counted.Of] = "turn_back"
    title: ClassVar[tuple[str, str]] = "room to turn back", "room_bounds"

    @property
    def room(self) -> TurnRoom:
        """Room that its flights need, rounded up to whole metres."""
        return TurnRoom(*np.ceil(self._ends(np.zeros((1, 0)))[1][0]).tolist())

    @property
    def summary(self) -> str:
        """The room in a line of a mission's answer, or why none is claimed."""
        if self.claims:
            begun = f" Its flights are {self.begun}." if self.begun else ""
            return f"Turning back takes {self.room.from_route:.0f} m beyond it.{begun}"
        ended = "".join(
            f", {row['count']} of them {ENDED.get(row['status'], row['status'].replace('_', ' '))}"
            for row in counted_endings(self.endings)
        )
        return (
            f"No room to turn back is claimed: of {len(self.scores)} flights that turn back "
            f"{self.lost}{ended}; at most {self.allowed} of {self.first} may."
        )

    @property
    def ended(self) -> Table:
        """How flights that turn back did not complete, beside those of the mission."""
        title = "flights that turn back and did not complete"
        return replace(endings_table(self.endings), title=title, name="turn_back_endings")

    @property
    def table(self) -> TurnBackTable:
        """How its flights turn back."""
        assert self.flights.central.turn_back is not None  # of the campaign that counts them
        return self.flights.central.turn_back

    @property
    def _leaves(self) -> str:
        begun = f", {self.begun}," if self.begun else ""
        return (
            f"that turns back{begun} goes further than {self.room.from_route:.0f} m beyond the "
            f"flight geography in any direction, or {self.room.height:.0f} m above or below it,"
        )

    @property
    def begun(self) -> str:
        """How flights begin on slopes, in words; empty without slopes, or of flighttune 0.4.0."""
        return BEGUN if self.table.or_level else ""

    def volumes(self, corridor: Band) -> dict[str, Volume]:
        """The volumes around the route that these flights turn back from."""
        if not (self.claims and isinstance(corridor, Band)):
            got = f"a {type(corridor).__name__}" if self.claims else "no claim of the room"
            raise InputError(f"volumes must be of a room and the band of its route, got {got}.")
        # The flight geography is as wide and high as the corridor, a band along the route, at its
        # widest. The contingency volume has the room to turn back around it, and the ground risk
        # buffer once more the height of that over ground.
        planned = corridor.flights.route
        path, h_0 = planned.reference.path, planned.where[2]
        along, north, east, _, _, h, V_a, *_ = self.table.columns
        route = *path.beside(along).T, np.interp(along, path.s, planned.reference.V)
        flown, others = (
            f"{of.plant} / {of.gains_name} along {length:.10g} m"
            for of, length in ((self.flights, along[-1]), (corridor.flights, path.length))
        )
        if flown != others or not np.allclose(route, (north, east, h - h_0, V_a), atol=SAME_PLACE):
            raise InputError(
                "both bands must be of one aircraft with the same gains and airspeeds on one "
                f"route, got {flown} and {others}."
            )
        claimed = corridor.corridor(planned.where)
        beside, above = np.abs([claimed.low, claimed.high]).max(axis=(0, 1)).tolist()
        heights = path.up[path.s <= path.length] + h_0 - corridor.flights.central.flight.ground_m
        low, high = max(float(heights.min()) - above, 0.0), float(heights.max()) + above
        geography = Volume(beside, low, high, claimed.claim)
        around = self.room.around(geography, printable(self.sentence))
        width, top = around.width + around.high, around.high
        return {
            "flight geography": geography,
            "contingency volume": around,
            "ground risk buffer": Volume(width, 0.0, top, "as wide as it is high"),
        }

    def _sizes(self) -> list[dict[str, float]]:
        return [{"high": size} for size in self.room]

    @property
    def _formula(self) -> float:
        central = self.flights.central
        return self.table.formula(max(central.airspeeds), central.flight.g_mps2)

    @property
    def _values(self) -> dict[str, Any]:
        sizes = {f"{key}_m": size for key, size in self.room._asdict().items() if self.claims}
        return {"room": {**sizes, "by_formula_m": self._formula}}

    @property
    def _notes(self) -> list[str]:
        table = self.table
        return [
            f"A turn of {table.turn_deg:g} deg to either side from any place of the route, "
            f"{table.reaction_s:g} s after detection, {table.bank_deg:g} deg of bank with a wind "
            f"of {table.wind(self.flights.central.flight.g_mps2):.3g} m/s from behind, until "
            f"{BACK_S:g} s after it; by formula {self._formula:.0f} m ahead in still air. No "
            "failure of engine, link or navigation is in it, and it is no risk class."
        ]


ARRAYS = {"band": array.TEXT, "extremes": array.SINGLE, "wind": array.FLOAT, "endings": array.TEXT}

# Kinds of counts.
KINDS = {kind.of: kind for kind in (Band, Residual, TurnBack, Monitor)}


def read_counted(
    path: str | Path, flights_of: Callable[[counted.About], counted.BandFlights]
) -> counted.Counted:
    """Read a count, and compute scores and scale; `flights_of` finds its flights from the plan."""
    load.sealed_bytes(Path(path), "band file", "count it again with flighttune band")
    size = 4 * MAX_NUMBERS + 2**24
    with naming(path):
        arrays = array.read_arrays(Path(path), "band", ARRAYS, size, size, ("extremes",))
        about = value_of(json_object(str(arrays.pop("band")), "`band`"), counted.About)
        endings = _endings_of(str(arrays.pop("endings", "{}")))
        if about.of == "turn_back" and about.signals != ROOM:
            raise InputError(
                f"`signals` must be {listed(list(ROOM))} of flights that turn back, got "
                f"{listed(list(about.signals))}: flighttune 0.3.0 counted the distance ahead, and "
                "flights went further to the side; count it with flighttune mission --turn-back."
            )
        flights = flights_of(about)
        _check(about, flights, arrays)
        n, planned = len(arrays["extremes"]), about.plan["runs"] - about.learned
        if about.early >= planned:
            raise InputError(f"`early` must be below the {planned} flights planned.")
        if n > planned and n not in planned * counted.DOUBLED:
            raise InputError(
                "`extremes` must be of as many flights as were planned, or of 2, 4, 8 ... times as "
                f"many, got {n} for {planned}."
            )
        band = KINDS[about.of](about=about, flights=flights, endings=endings, **arrays)
        if not {x["run"] for x in endings} <= {*band.draws[np.isinf(band.scores)].tolist()}:
            raise InputError("`endings` must be of draws counted that did not complete.")
    return band


def _endings_of(text: str) -> list[dict[str, Any]]:
    """How flights ended, by draw."""
    said, rows = json_object(text, "`endings`"), []
    for run, sentence in said.items():
        if not (run.isdecimal() and isinstance(sentence, str)):
            raise InputError("`endings` must have a sentence for each draw.")
        status, _, reason = sentence.partition(": ")
        rows.append({"run": int(run), "status": status, "reason": reason})
    return rows


def _check(about: counted.About, of: counted.BandFlights, arrays: dict[str, Any]) -> None:
    """Refuse a shape that cannot be one, and arrays of other windows than the plan has."""
    array.check_shapes("band", arrays, {"extremes": None, "wind": None})
    models, flights = about.models, len(arrays["extremes"])
    each = len(of.edges) - 1, len(about.signals)  # windows and signals
    by_wind = about.predicted_from
    learned = {"half": about.half, "coefficients": about.coefficients}
    shapes = {"half": each, "coefficients": (10 if by_wind else 1, *each)}
    shapes |= {"extremes": (flights, *each, 2), "wind": (flights, 2 if by_wind else 0)}
    array.check_shapes("band", learned | arrays, shapes)
    if not (about.half > 0.0).all():
        raise InputError("`half` must be positive.")
    for name, unit in about.signals.items():
        if unit != SIGNAL_UNITS.get(name, unit):
            raise InputError(
                f"`signals`: {name} must be in {SIGNAL_UNITS[name]}, got {abridged(unit)}."
            )
    watched = [*about.signals] if about.of == "monitor" else []
    if [x.name for x in models] != watched:
        raise InputError("`models` must be those of the `signals` of a monitor.")
    if any(len(x.weights) != len(x.terms) or replace(x, weights=()) not in MODELS for x in models):
        raise InputError(
            "`models` must be those that flighttune monitor counts, with a weight for each term."
        )
    low, high = np.moveaxis(arrays["extremes"], -1, 0)
    if not (low <= high).all():  # also catches NaN
        raise InputError("`extremes` must be lowest and highest values.")
