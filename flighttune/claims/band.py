"""Bands: bounds of signals over time, learned from some flights and counted on fresh ones."""

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt
from pydantic import Field

from flighttune.aircraft.aircraft import files_hash
from flighttune.arrays import FloatArray, check_between
from flighttune.claims.count import allowed_outside, counted_scale, supported_epsilon
from flighttune.claims.distribution import PLACE, Distribution
from flighttune.claims.fence import (
    KEPT,
    NEAREST_COLUMNS,
    OVERLAP_SAMPLES,
    FenceCount,
    check_off_route,
)
from flighttune.claims.shape import MAX_NUMBERS, MIN_LEARNED, Extremes, predicted, scores_of
from flighttune.claims.turn_room import ROOM, TurnRoom
from flighttune.control.gains import PIGains, gains_table
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.files.array import FLOAT, SINGLE, TEXT, check_shapes, read_arrays
from flighttune.files.seal import BLANK, seal, sealed_bytes
from flighttune.files.table import json_object
from flighttune.files.value import STRICT, tables_of, value_of
from flighttune.files.whole import whole_file
from flighttune.flight.route import PlannedRoute, planned_route
from flighttune.gaps.residual import ConformantModel
from flighttune.metrics import OFF_ROUTE
from flighttune.plants.base import plant_label
from flighttune.present.answer import (
    Answer,
    Answering,
    Column,
    Table,
    number,
    pick,
    printable,
    quoted,
)
from flighttune.present.names import endings_table, listed, shown_unit
from flighttune.references.fence import DISTANCE_SIGNS, read_fence, room_along
from flighttune.references.follow import SAME_PLACE
from flighttune.references.maps import Corridor, Volume, Where, areas_of
from flighttune.scenario.load import leaves, scenario_of
from flighttune.scenario.route import BACK_S
from flighttune.scenario.schema import Scenario
from flighttune.simulate.bounds import Bounds, Kind, RunClaim
from flighttune.simulate.run import SIGNAL_UNITS, Run, along_route

# Axis of the windows.
Over: TypeAlias = Literal["time", "along"]

Probability: TypeAlias = Annotated[float, Field(gt=0.0, lt=1.0)]

# Numbers of flights at which a count is read, over the first of them.
DOUBLED = 2 ** np.arange(31)

# Relative difference of gains below which they are the same: tuning repeats to 1e-9.
SAME_GAINS = 1e-6

# Rounding of the times of samples, s.
SAME_TIME = 1e-9

# Tables of a scenario that a run must share with the flights of a band drawn around it.
SHARED = ("flight", "reference", "route", "law", "limits", "controller", "sensors")

ARRAYS = {"band": TEXT, "extremes": SINGLE, "wind": FLOAT, "endings": TEXT}

WIDTH_COLUMNS = [
    Column("signal", "signal"),
    Column("largest", "largest half-width", digits=".3g"),
    Column("last_quarter", "in the last quarter", digits=".3g"),
    Column("end", "at the end", digits=".3g"),
    Column("low", "lowest bound", digits=".3g"),
    Column("high", "highest bound", digits=".3g"),
    Column("unit", "unit"),
]

# Part of the time whose largest half-width is printed too: flights have settled by then.
LAST_QUARTER = 0.75


@dataclass(frozen=True, slots=True, kw_only=True)
class About:
    """The shape of a band, the flights that it is about, and its claim."""

    # None for recorded signals; else the parts of a flight that the model of an aircraft misses, or
    # how far one comes that turns back
    of: Literal["residual", "turn_back"] | None = None
    signals: dict[str, str]  # units by name
    # (1 or 10, windows, signals): the middle of the band, by the terms of the wind
    coefficients: FloatArray
    half: FloatArray  # (windows, signals): half-width at scale 1
    predicted_from: Literal["wind"] | None  # what the middle is predicted from
    # of the campaign; its runs are the flights learned from, and those to be counted first
    plan: dict[str, Any]
    learned: Annotated[
        int, Field(ge=MIN_LEARNED, le=10**9)
    ]  # number of draws that the shape was learned from
    epsilon: float
    confidence: float  # of each claim at each number of flights
    fences: tuple[dict[str, Any], ...] = ()  # GeoJSON in which flights were counted
    # Epsilon and confidence that the count was planned with, where the claim has others
    planned: tuple[Probability, Probability] | None = None

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune band 2"
    UNITS: ClassVar[Mapping[str, str]] = {"half": "as in signals"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BandFlights:
    """The flights of a band and its windows: what follows from its plan, and is not in its file."""

    over: Over = "time"  # axis of the windows: time, or the distance along a route
    edges: FloatArray  # (windows + 1,), s or m
    distribution: Distribution
    scenario: Scenario  # as it is without what is drawn
    central: Scenario  # at the median of what is drawn
    plant: str  # label
    gains_name: str
    gains: PIGains
    aircraft: Mapping[str, str]  # SHA-256 of the files of each, by name or folder
    model: ConformantModel | None = None  # what residual signals are the residuals of

    @property
    def flown(self) -> str:
        """Plant and law in words, by their kinds."""
        table, law = self.scenario.plant_table(self.plant), self.scenario.law_table(self.gains_name)
        return f"{plant_label(table.kind, table.aircraft)} under the {law.kind} law"

    @property
    def sentence(self) -> str:
        """The flights in words; names that their maker chose are quoted as such."""
        names = {"flights": self.distribution.title, "gains": self.gains_name}
        if self.scenario.plant_table(self.plant).name:
            names["plant"] = self.plant
        said = listed([f"the {what} {quoted(name)}" for what, name in names.items()])
        return f"{self.distribution.sentence(self.flown)}; its maker calls {said}"

    @property
    def gains_notes(self) -> tuple[str, ...]:
        """A sentence if the gains were tuned for others."""
        return self.scenario.gains_notes(self.plant, self.gains_name)

    @property
    def changed(self) -> list[str]:
        """Aircraft whose files are no longer those that were flown."""
        return [name for name, digest in self.aircraft.items() if files_hash(name) != digest]

    @property
    def route(self) -> PlannedRoute:
        """The route that is flown; InputError if there is none, or an aircraft has changed."""
        if self.changed:
            raise other_files(self.changed)
        return planned_route(self.central)

    def difference(self, run: Run, scenario: Scenario) -> str:
        """First key in which a run differs from these flights; empty if it is one of them."""
        origin, flown = run.provenance, run.provenance.gains
        if run.status != "completed":
            return "status"
        if self.plant != origin.plant:
            return "plant"
        if split_name(self.gains_name)[0] != split_name(origin.gains_name)[0]:
            return "law"
        if flown is None or not np.allclose(self.gains.K, flown.K, rtol=SAME_GAINS):
            return "gains"
        if self.changed:
            return "aircraft files"
        # the one in the middle has tables that are only there because one of their keys is drawn
        scenarios = self.scenario, self.central, scenario
        counted, middle, flown_keys = (_stated(tables, self.plant) for tables in scenarios)
        drawn = {PLACE.sub("", key) for key in self.distribution.dispersed}
        allowed = {key: (counted.get(key), middle.get(key)) for key in counted | flown_keys}
        differ = (key for key, values in allowed.items() if flown_keys.get(key) not in values)
        return next((key for key in differ if key not in drawn), "")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band(Answering):
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
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "workers": 1}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> bounds = band.bounds([0.0, 1.0])
    >>> bounds.names, bounds.low.shape
    (('chi_err', 'gamma_err'), (2, 2))
    """

    about: About
    flights: BandFlights
    extremes: Extremes
    wind: FloatArray
    endings: Sequence[Mapping[str, Any]] = ()
    scores: FloatArray = field(init=False)
    scale: float = field(init=False)

    kind: ClassVar[Kind] = "counted"

    def __post_init__(self) -> None:
        about = self.about
        scores = scores_of(self.extremes, self.wind, about.coefficients, about.half)
        scale, _ = counted_scale(scores, about.epsilon, about.confidence)
        object.__setattr__(self, "scores", scores)
        object.__setattr__(self, "scale", scale)
        check_between(0.0, 1.0, confidence=self.confidence)

    @property
    def claims(self) -> bool:
        """Whether enough of its flights were completed."""
        return bool(np.isfinite(self.scale))

    @property
    def readings(self) -> tuple[int, ...]:
        """Numbers of flights at which it may have been read, which are fixed beforehand.

        The first is planned, and each is twice the one before.
        """
        numbers = self._first * DOUBLED
        return tuple(numbers[numbers <= len(self.extremes)].tolist())

    @property
    def _first(self) -> int:
        return self.about.plan["runs"] - self.about.learned

    @property
    def draws(self) -> npt.NDArray[np.int64]:
        """Draws of the flights counted."""
        return self.draws_of(len(self.extremes))

    def draws_of(self, flights: int) -> npt.NDArray[np.int64]:
        """Draws of so many flights.

        One draw is left out where the number planned is doubled: a count that was continued then
        has other flights than one planned so long, and cannot pass for it.
        """
        i = np.arange(flights)
        return self.about.learned + i + np.searchsorted(self._first * DOUBLED, i, side="right")

    @property
    def outside(self) -> int:
        """Number of counted flights outside."""
        return int(np.sum(self.scores > self.scale))

    @property
    def not_completed(self) -> int:
        """Number of counted flights that did not complete, or count as if they had not."""
        return int(np.isinf(self.scores).sum())

    @property
    def lost(self) -> str:
        """How many counted flights have infinite extremes, and why, in words."""
        off = " or flew behind their start or back along the route" * (self.flights.over == "along")
        return f"{self.not_completed} did not complete{off}"

    @property
    def confidence(self) -> float:
        """Confidence of all claims together: each spends its part of the error probability."""
        about = self.about
        spent = 1.0 - about.confidence + (1.0 - about.planned[1] if about.planned else 0.0)
        return 1.0 - len(self.readings) * (1 + len(about.fences)) * spent

    @property
    def half_widths(self) -> FloatArray:
        """Half the width of each window and signal, shape (windows, signals)."""
        return self.scale * self.about.half

    @property
    def room(self) -> TurnRoom:
        """Room that its flights need, which turn back, rounded up to whole metres."""
        return TurnRoom(*np.ceil(self.bounds(self.flights.edges[:1]).high[0]).tolist())

    def volumes(self, corridor: "Band") -> dict[str, Volume]:
        """The volumes around a route, where this band is of flights that turn back.

        The flight geography is as wide and high as the `corridor`, a band along the route, at its
        widest. The contingency volume has the room to turn back around it, and the ground risk
        buffer once more the height of that over ground.
        """
        turn_back, planned = self.flights.central.turn_back, corridor.flights.route
        if turn_back is None or not self.claims:
            raise InputError("the room to turn back must be claimed by a band of such flights.")
        path, h_0 = planned.reference.path, planned.where[2]
        along, north, east, _, _, h, V_a, *_ = turn_back.columns
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

    @property
    def nearest(self) -> int:
        """Draw of the flight inside that is nearest to leaving."""
        inside = np.where(self.scores <= self.scale, self.scores, -np.inf)
        return int(self.draws[np.argmax(inside)])

    @property
    def shared(self) -> str:
        """How many claims share the confidence, in words; empty for a single one."""
        fences, readings = len(self.about.fences), len(self.readings)
        claims = ["the band and its fence" if fences == 1 else f"the band and {fences} fences"]
        parts = claims * bool(fences) + [f"{readings} numbers of flights"] * (readings > 1)
        shared = [f"by {' at '.join(parts)}"] if parts else []
        if self.about.planned:
            epsilon, confidence = self.about.planned
            shared.append(f"with the claim planned, {epsilon:g} at {confidence:.10g}")
        return f" (shared {' and '.join(shared)})" if shared else ""

    @property
    def sentence(self) -> str:
        """The claim in words."""
        about, flights = self.about, len(self.scores)
        if not self.claims:
            allowed = allowed_outside(flights, about.epsilon, about.confidence)
            return (
                f"nothing is claimed: of {flights} fresh flights {self.lost}, and at most "
                f"{allowed} may. All are flights of {self.flights.sentence}"
            )
        of = " of its residual signals" if about.of else ""
        knowing = ", around the middle that its wind predicts," if about.predicted_from else ""
        leaves = f"leaves the band{of}{knowing}"
        if about.of == "turn_back":
            leaves = (
                f"that turns back goes further than {self.room.from_route:.0f} m beyond the flight "
                f"geography in any direction, or {self.room.height:.0f} m above or below it,"
            )
        return (
            f"a new flight {leaves} with probability at most "
            f"{number(about.epsilon)}, confidence {self.confidence:.10g}{self.shared}: "
            f"{self.outside} of {flights} fresh flights did. All are flights of "
            f"{self.flights.sentence}"
        )

    def claiming(self, epsilon: float, confidence: float) -> "Band":
        """The same count with another claim, which shares the confidence with that planned.

        InputError if its flights are too few.
        """
        planned = self.about.planned or (self.about.epsilon, self.about.confidence)
        claim: dict[str, Any] = {"epsilon": epsilon, "confidence": confidence}
        claim["planned"] = None if planned == (epsilon, confidence) else planned
        return replace(self, about=replace(self.about, **claim))

    def with_flights(
        self, extremes: Extremes, wind: FloatArray, endings: Sequence[Mapping[str, Any]] = ()
    ) -> "Band":
        """The band after more flights were counted."""
        kept = np.concatenate([self.extremes, extremes]), np.concatenate([self.wind, wind])
        all_endings = [*self.endings, *endings]
        return replace(self, extremes=kept[0], wind=kept[1], endings=all_endings)

    def with_fence(self, tables: dict[str, Any]) -> "Band":
        """The band with a fence whose GeoJSON is `tables`; one that it has is its last then."""
        others = tuple(fence for fence in self.about.fences if fence != tables)
        return replace(self, about=replace(self.about, fences=(*others, tables)))

    def bounds(self, t: FloatArray, wind: FloatArray | None = None) -> Bounds:
        """The band at the times `t` (s), or the distances along a route (m).

        `wind`, (2,), is the wind that it is given, if any.
        """
        about = self.about
        winds = np.zeros((1, 0)) if wind is None else np.reshape(wind, (1, 2))
        if (about.predicted_from is None) != (wind is None):
            raise InputError(f"`wind` must be there for a band that is given it only, got {wind}.")
        # Residual signals last from a sample to the next, and have no window but that of its time.
        rounding = SAME_TIME if about.of else 0.0
        window = np.searchsorted(self.flights.edges, np.add(t, rounding), side="right") - 1
        window = np.clip(window, 0, len(about.half) - 1)
        middle = predicted(winds, about.coefficients)[0]
        low, high = (middle + sign * self.half_widths for sign in (-1.0, 1.0))
        return Bounds(np.asarray(t, dtype=float), low[window], high[window], tuple(about.signals))

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

    def inside(self, tables: dict[str, Any], file: Path = KEPT) -> FenceCount:
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
        epsilon, flights = supported_epsilon(outside, len(away), about.confidence), len(away)
        return FenceCount(
            fence.heights,
            outside,
            epsilon,
            epsilon <= about.epsilon,
            [{"what": what, **room.nearest(reach)} for what, reach in reaches.items()],
            f"a new flight leaves the fence with probability at most {number(epsilon)}, confidence "
            f"{self.confidence:.10g}{self.shared}: {flights - outside} of {flights} fresh flights "
            "are certainly inside",
        )

    def _off_route(self) -> list[int]:
        """Where the distances from a route are among the signals."""
        check_off_route(self.about.signals, self.flights.over)
        return [list(self.about.signals).index(name) for name in OFF_ROUTE]

    def why_not(self, run: Run) -> str:
        """Why the band says nothing of a run; empty if its flights could have been this one.

        It may differ from them in keys that they draw, whatever its value, and in its wind, gust,
        turbulence and disturbance.
        """
        if not self.claims:
            return "nothing is claimed: too many of the flights counted were not completed"
        if self.about.of == "turn_back":
            return "it bounds how far a flight comes that turns back, and no recorded signal"
        if self.about.of:
            return (
                "it bounds what the model of an aircraft misses, and no recorded signal: "
                "`flighttune tube --boxes` takes it"
            )
        scenario = scenario_of(run)
        differs = self.flights.difference(run, scenario)
        return f"its {differs} must be that of the flights counted" if differs else ""

    def on(self, run: Run) -> RunClaim:
        """The bounds of the signals at the samples of a run."""
        about, scenario = self.about, scenario_of(run)
        wind = np.array(wind_at_start(scenario)) if about.predicted_from else None
        return RunClaim(
            kind=self.kind,
            title="counted band",
            sentence=self.sentence,
            bounds=self.bounds(axis_of(run), wind),
            units=about.signals,
            fences=tuple(ring for ring, _ in areas_of(about.fences)),
        )

    @property
    def sha256(self) -> str:
        """Hash of all that its file holds, however the file is packed."""
        digest = hashlib.sha256(json.dumps(tables_of(self.about), sort_keys=True).encode())
        for array in (self.extremes, self.wind):
            digest.update(array.tobytes())
        return digest.hexdigest()

    def save(self, path: str | Path) -> None:
        """Write the band with its SHA-256 (.npz)."""
        save_band(self, path)

    def answer(self, file: str | Path = "FILE") -> Answer:
        """The half-widths of the band in a file and its claim; a failure if nothing is claimed.

        Along a route it has the length and the time too. The claim about its last fence, if any, is
        the verdict then, and a failure if the count does not support it.
        """
        about, edges = self.about, self.flights.edges
        law, records = self.flights.scenario.law_table(self.flights.gains_name), []
        for (name, unit), widths in zip(about.signals.items(), self.half_widths.T, strict=True):
            shown, factor = shown_unit(unit)
            late = edges[:-1] >= LAST_QUARTER * edges[-1]
            ends = {
                "largest": widths.max(),
                "last_quarter": widths[late].max(initial=0.0),
                "end": widths[-1],
            }
            if about.of == "turn_back":
                ends = {"high": getattr(self.room, name)}
            elif not about.predicted_from:
                bounds = self.bounds(edges[:-1])
                column = bounds.names.index(name)
                ends |= {"low": bounds.low[:, column].min(), "high": bounds.high[:, column].max()}
            in_unit = {key: float(width) * factor for key, width in ends.items()}
            records.append({"signal": name, **in_unit, "unit": shown})
        notes, room = [*self.flights.gains_notes], {}
        if (turn_back := self.flights.central.turn_back) is not None and about.of:
            f = self.flights.central.flight
            formula = turn_back.formula(max(self.flights.central.airspeeds), f.g_mps2)
            sizes = {f"{key}_m": size for key, size in asdict(self.room).items() if self.claims}
            room["room"] = {**sizes, "by_formula_m": formula}
            notes.append(
                f"A turn of {turn_back.turn_deg:g} deg to either side from any place of the route, "
                f"{turn_back.reaction_s:g} s after detection, {turn_back.bank_deg:g} deg of bank "
                f"with a wind of {turn_back.wind(f.g_mps2):.3g} m/s from behind, until {BACK_S:g} "
                f"s after it; by formula {formula:.0f} m ahead in still air. No failure of engine, "
                "link or navigation is in it, and it is no risk class."
            )
        if about.predicted_from:
            notes.append(
                "The band is around a middle that is predicted from the wind of each flight."
            )
        if self.claims:
            seed = about.plan["campaign"]["seed"]
            notes.append(
                f"Of the flights inside, draw {self.nearest} (seed {seed}) is nearest to leaving: "
                f"flighttune verify {file} --run {self.nearest}"
            )
        turning = about.of == "turn_back"
        title, name = ("room to turn back", "room_bounds") if turning else ("band", "half_widths")
        answer = Answer(
            values={
                "status": "claimed" if self.claims else "nothing_claimed",
                **pick(about, "of epsilon predicted_from learned"),
                **pick(self, "scale readings confidence outside not_completed sentence"),
                "distribution": self.flights.sentence,
                "gains": self.flights.gains.as_lists(),
                "law": law.model_dump(mode="json", exclude_none=True),
                "flights": len(self.scores),
                "nearest_draw": self.nearest if self.claims else None,
                **room,
            },
            tables=[
                Table(WIDTH_COLUMNS, records if self.claims else [], title, name=name),
                self.flights.distribution.table(self.flights.flown),
                gains_table("gains", self.flights.gains),
                endings_table(self.endings),
            ],
            notes=notes,
            verdict=self.sentence if self.claims else "",
            failure="" if self.claims else self.sentence,
        )
        try:
            return self._along_route(answer) if self.flights.over == "along" else answer
        except InputError as error:
            return replace(answer, verdict="", failure=str(error))

    def _along_route(self, answer: Answer) -> Answer:
        """The answer with the route, and with the count of flights inside its last fence."""
        planned = self.flights.route
        plan, notes, values = planned.answer(), [*answer.notes], dict(answer.values)
        values["route"] = {**pick(planned, "conditions time"), "length_m": planned.length}
        flyable = [f"Flyable: {plan.verdict}; {planned.conditions}.", *plan.notes]
        answer = replace(answer, values=values, notes=[*flyable, *notes])
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


def other_files(aircraft: Iterable[str]) -> InputError:
    """The error about aircraft whose files have changed since the flights of a band."""
    return InputError(
        f"`{listed(list(aircraft))}` must have the files that the band was flown with, got changed "
        "ones."
    )


def _stated(scenario: Scenario, plant: str) -> dict[str, Any]:
    """Values that all flights of a plant share, whatever the air, by dotted key."""
    tables = scenario.as_dict()
    tables = {key: tables[key] for key in SHARED if key in tables}
    tables["plant"] = scenario.plant_table(plant).model_dump(mode="json", exclude_none=True)
    return dict(leaves(tables))


def axis_of(run: Run) -> FloatArray:
    """Time of each sample, or its distance along a route."""
    return along_route(run) if "along" in run.signals else run.t


def wind_at_start(scenario: Scenario) -> Sequence[float]:
    """North and east wind at the start, m/s."""
    if scenario.wind is None:
        return 0.0, 0.0
    return scenario.wind.profile().at(scenario.flight.h_m)[:2]


def save_band(band: Band, path: str | Path) -> None:
    """Write a band with its SHA-256, whole or not at all."""
    about = np.array(json.dumps(tables_of(band.about)))
    arrays = {"extremes": band.extremes, "wind": band.wind}
    if band.endings:
        said = {str(x["run"]): "{status}: {reason}".format(**x) for x in band.endings}
        arrays["endings"] = np.array(json.dumps(said))
    with whole_file(Path(path)) as part:
        with part.open("wb") as file:
            np.savez_compressed(file, band=about, **arrays)
        with ZipFile(part, "a") as archive:
            archive.comment = BLANK.encode()  # at the end of the file, and of no checksum of it
        part.write_bytes(seal(part.read_bytes()))


def read_band(path: str | Path, flights_of: Callable[[About], BandFlights]) -> Band:
    """Read a band, and compute its scores and scale; `flights_of` finds its flights from the plan.

    Raises InputError if the file cannot be read, is not as it was written, is no band, or claims
    what its flights do not support; the message names the file and what is wrong.
    """
    sealed_bytes(Path(path), "band file", "count it again with flighttune band")
    size = 4 * MAX_NUMBERS + 2**24
    try:
        arrays = read_arrays(Path(path), "band", ARRAYS, size, size, ("extremes",))
        about = value_of(json_object(str(arrays.pop("band")), "`band`"), About)
        endings = _endings_of(str(arrays.pop("endings", "{}")))
        if about.of == "turn_back" and about.signals != ROOM:
            raise InputError(
                f"`signals` must be {listed(list(ROOM))} of flights that turn back, got "
                f"{listed(list(about.signals))}: flighttune 0.3.0 counted the distance ahead, and "
                "flights went further to the side; count it again with flighttune band --turn-back."
            )
        flights = flights_of(about)
        _check(about, flights, arrays)
        counted, planned = len(arrays["extremes"]), about.plan["runs"] - about.learned
        if counted not in planned * DOUBLED:
            raise InputError(
                "`extremes` must be of as many flights as were planned, or of 2, 4, 8 ... times as "
                f"many, got {counted} for {planned}."
            )
        band = Band(about=about, flights=flights, endings=endings, **arrays)
        lost = band.draws[np.isinf(band.scores)].tolist()
        if not {x["run"] for x in endings} <= {*lost}:
            raise InputError("`endings` must be of draws counted that did not complete.")
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
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


def _check(about: About, of: BandFlights, arrays: dict[str, Any]) -> None:
    """Refuse a shape that cannot be one, and arrays of other windows than the plan has."""
    signals, windows = len(about.signals), len(of.edges) - 1
    for name, shape in (
        ("half", (windows, signals)),
        ("coefficients", (10 if about.predicted_from else 1, windows, signals)),
    ):
        if not signals or getattr(about, name).shape != shape:
            raise InputError(f"`{name}` must have shape {shape}.")
    if not (about.half > 0.0).all():
        raise InputError("`half` must be positive.")
    for name, unit in about.signals.items():
        if unit != SIGNAL_UNITS.get(name, unit):
            raise InputError(f"`signals`: {name} must be in {SIGNAL_UNITS[name]}, got {unit!r}.")
    flights = len(arrays["extremes"])
    shapes = {
        "extremes": (flights, windows, signals, 2),
        "wind": (flights, 2 if about.predicted_from else 0),
    }
    check_shapes("band", arrays, shapes)
    low, high = np.moveaxis(arrays["extremes"], -1, 0)
    if not (low <= high).all():  # also catches NaN
        raise InputError("`extremes` must be lowest and highest values.")
