"""Counts of recorded signals: bands, and flights inside a fence."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from flighttune.base.answers.answer import Answer, Table
from flighttune.base.answers.labels import columns
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.endings import why_ended
from flighttune.base.errors import InputError, printable
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.base.words import at_most, pick
from flighttune.campaigns.flying.rows import fly_group
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.counted import Counted, SignalBounds, axis_of, wind_at_start
from flighttune.claims.measured import Measured
from flighttune.flight.conditions import reference_of
from flighttune.flight.loop.run import ERRORS, Run, RunClaim
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.fence import DISTANCE_SIGNS, read_fence, room_along
from flighttune.routes.follow import SAME_PLACE, RouteReference
from flighttune.routes.maps import Corridor, Where, areas_of

# Stands for the file of a fence that is kept with its band.
KEPT = Path("fence")

# Distance in samples, at the airspeed, by which positions may lie beyond the edges of a window.
OVERLAP_SAMPLES = 2.0

NEAREST_COLUMNS = columns("what margin_m side edge along_m stretch", of="fence")


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


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedSignals(Measured):
    """Signals that runs record."""

    @classmethod
    def chosen(cls, plan: Plan, signals: Iterable[str] | None) -> Self:
        """Those of these names, by default the errors, on a route the distances from it."""
        central, names = plan.campaign.central, dict.fromkeys(signals or ())
        if not names:  # all runs have them, so that no flight need say it
            off = OFF_ROUTE if central.route else ERRORS
            return cls(units={name: SIGNAL_UNITS[name] for name in off})
        run = fly_group(plan, central, plan.groups[0])
        for name in names:
            if name not in run.signals:
                if run.reason and not len(run.signals):
                    why = run.reason.removesuffix(".")
                    raise InputError(
                        f"The flight at the median of what is drawn must start: {why}."
                    )
                recorded = ", ".join(map(str, run.signals.columns))
                raise InputError(f"`signal` must be one of {recorded}, got {name!r}.")
        return cls(units={x: run.units.get(x) or SIGNAL_UNITS.get(x, "") for x in names})

    def values(self, run: Run, scenario: Scenario) -> FloatArray:
        """The signals of a run, shape (samples, signals)."""
        del scenario
        return run.signals[[*self.units]].to_numpy()

    def lost(self, run: Run, scenario: Scenario) -> bool:
        """Whether a flight is behind its start or blown back: its distances are wrong then."""
        route = reference_of(scenario)
        if not (isinstance(route, RouteReference) and {*OFF_ROUTE} & {*self.units}):
            return False
        return route.displacement(run.signals) > SAME_PLACE


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

    measures: ClassVar[type[Measured]] = RecordedSignals

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
        flights, ending = len(away), self.ending
        supported = ending.supported(outside, flights)
        said = f"{flights - outside} of {flights} fresh flights are certainly inside"
        sure = f"confidence {self.confidence:.10g}{self.shared.words}{ending.words}"
        claim = f"a new flight {supported.claim}, {sure}: {said}" if supported.claim else ""
        return Fenced(
            heights=fence.heights,
            outside=outside,
            epsilon=supported.epsilon,
            supported=supported.epsilon <= about.epsilon,
            nearest=[{"what": what, **room.nearest(reach)} for what, reach in reaches.items()],
            sentence=claim or f"{said}{supported.lacks}",
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
        wind = np.array(wind_at_start(scenario)) if about.predicted_from else None
        return RunClaim(
            kind=self.kind,
            title="counted band",
            sentence=self.sentence,
            bounds=self.bounds(axis_of(run), wind),
            units=about.signals,
            fences=tuple(ring for ring, _ in areas_of(about.fences)),
        )

    def answer(self, file: str | Path = "FILE") -> Answer:
        """The half-widths of the band in a file and its claim; a failure if nothing is claimed.

        Along a route it has the length and the time too. The claim about its last fence, if any, is
        the verdict then, and a failure if the count does not support it.
        """
        answer = Counted.answer(self, file)
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

    def summary(self, room: Counted | None = None, room_words: str = "") -> list[str]:
        """The answer of a mission in four lines: whether, the odds, how wide, and for what.

        The room to turn back, if it was counted, shares the confidence.
        """
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
        wide += f" {room_words}" if room_words else ""
        flown = self.flights.distribution.sentence(self.flights.flown).partition("; drawn")[0]
        return [answer, odds, wide, f"It holds for {flown}, over {planned.answer().verdict}."]
