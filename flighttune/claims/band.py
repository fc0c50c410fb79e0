"""Counts of recorded signals: bands, and flights inside a fence."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, printable
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.base.words import confidence_text
from flighttune.campaigns.flying.rows import fly_group
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.counted import SignalBounds, axis_of, wind_at_start
from flighttune.claims.measured import Measured
from flighttune.claims.shape import parts
from flighttune.flight.conditions import reference_of
from flighttune.flight.loop.run import ERRORS, Run, RunClaim
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes.fence import DISTANCE_SIGNS, Fence, Room, read_fence, room_along
from flighttune.routes.follow import SAME_PLACE, RouteReference
from flighttune.routes.maps import Corridor, Where, areas_of

# Replaces the file name of a fence inside a band's file.
KEPT = Path("fence")

# `by_rtk` without any flight.
NO_FLIGHTS: FloatArray = np.zeros((0, 2))

# Distance, in samples at the airspeed, of positions beyond the edges of a window.
OVERLAP_SAMPLES = 2.0


class Fenced(NamedTuple):
    """Count of a band's flights that are not certainly inside a fence."""

    heights: str  # floor and ceiling of the fence in words
    outside: int
    epsilon: float  # supported probability of leaving the fence
    supported: bool  # whether this is at most the band's epsilon
    nearest: list[dict[str, Any]]  # of completed flights, and of a corridor
    sentence: str


def check_off_route(signals: Iterable[str], over: str = "along") -> None:
    """Refuse a band that does not bound the distances from a route."""
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
        """Signals by name; by default the errors, or the distances from a route."""
        central, names = plan.campaign.central, dict.fromkeys(signals or ())
        if not names:  # all runs have these, so no flight is needed to check
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
        # One by one: pandas takes longer for a list of names.
        return np.stack([run.signals[name].to_numpy() for name in self.units], axis=1)

    def lost(self, run: Run, scenario: Scenario) -> bool:
        """Whether a flight is behind its start or blown back, so that its distances are wrong."""
        route = reference_of(scenario)
        if not (isinstance(route, RouteReference) and {*OFF_ROUTE} & {*self.units}):
            return False
        return route.displacement(run.signals) > SAME_PLACE


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Band(SignalBounds):
    """Bounds that a new flight leaves with at most a stated probability: a counted claim.

    Attributes
    ----------
    about : About
        Shape of the band, plan of its flights, and its claim.
    flights : BandFlights
        Distribution of the flights, and the windows over time or along a route.
    extremes : ndarray of float32, shape (N, windows, signals, 2)
        Lowest and highest value of each signal in each window of each counted flight, in SI;
        infinite for a flight that was not completed.
    wind : ndarray, shape (N, 2) or (N, 0), m/s
        Wind at the start of each flight to the north and east, if the band uses it.
    navigation : ndarray, shape (N, 4) or (N, 0), m
        Largest errors of navigation of each flight along a route, beside it and in height, then
        its distances as the autopilot saw them, for 95 % of the time.
    by_rtk : ndarray, shape (n, 2) or (0, 2), m
        Largest distances from their route, beside it and in height, of learning flights that were
        flown by RTK as well.
    endings : sequence of mapping
        ``run``, ``status`` and ``reason`` of the counted flights that did not complete; empty for a
        file of version 0.3.0.
    compiled : CompiledFlights
        How many flights were compiled, and how many JSBSim flew, again or alone.
    scores : ndarray, shape (N,)
        Smallest scale at which each flight is inside.
    scale : float
        Factor on the half-widths; infinite without a claim.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> bounds = band.bounds([0.0, 1.0])
    >>> bounds.names, bounds.low.shape
    (('chi_err', 'gamma_err'), (2, 2))
    """

    by_rtk: FloatArray = field(default_factory=lambda: NO_FLIGHTS)

    measures: ClassVar[type[Measured]] = RecordedSignals
    beside_rtk: ClassVar[bool] = True

    @property
    def _leaves(self) -> str:
        knowing = ", around the middle that its wind predicts," if self.about.predicted_from else ""
        return f"leaves the band{knowing}"

    def with_fence(self, tables: dict[str, Any]) -> "Band":
        """The band with this fence (GeoJSON) added; a fence it already has moves to the end."""
        others = tuple(fence for fence in self.about.fences if fence != tables)
        return replace(self, about=replace(self.about, fences=(*others, tables)))

    def corridor(self, where: Where | None = None) -> Corridor:
        """The corridor, for any wind, along the route; else an InputError about `where`.

        InputError also without a claim, or without bounds on distances from a route.
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

    def inside(self, tables: Mapping[str, Any], file: Path = KEPT) -> Fenced:
        """Count the flights that are not certainly inside a fence, GeoJSON in `tables`.

        Messages name the `file` of the fence.
        """
        fence, room, reaches = self._room(tables, file)
        # The limits to the sides are finite, so flights that were not completed are outside.
        inside = [(x <= room.limits).all(axis=(1, 2, 3)) for x in self._away()]
        outside = len(self.scores) - sum(int(x.sum()) for x in inside)
        flights, ending = len(self.scores), self.ending
        supported = ending.supported(outside, flights)
        said = f"{flights - outside} of {flights} fresh flights are certainly inside"
        sure = f"confidence {confidence_text(self.confidence)}{self.shared.words}{ending.words}"
        claim = f"a new flight {supported.claim}, {sure}: {said}" if supported.claim else ""
        return Fenced(
            heights=fence.heights,
            outside=outside,
            epsilon=supported.epsilon,
            supported=supported.epsilon <= self.about.epsilon,
            nearest=[{"what": what, **room.nearest(reach)} for what, reach in reaches.items()],
            sentence=claim or f"{said}{supported.lacks}",
        )

    def _room(
        self, tables: Mapping[str, Any], file: Path
    ) -> tuple[Fence, Room, dict[str, FloatArray]]:
        """A fence, its room along the route, and how far flights and corridor reach."""
        central, (path, origin, _) = self.flights.central, self.flights.route.where
        fence = read_fence(file, origin, tables)
        farthest = [x.max(axis=0) for x in self._away(completed=True) if len(x)]
        reaches = {"completed flights": np.max(farthest, axis=0)} if farthest else {}
        if self.claims and not self.about.predicted_from:
            corridor = self.corridor()
            reaches["band"] = DISTANCE_SIGNS * np.stack([corridor.low, corridor.high], axis=-1)
        widest = max([0.0, *(float(reach[:, 0].max()) for reach in reaches.values())])
        overlap = OVERLAP_SAMPLES * max(central.airspeeds) / central.controller.rate_hz
        room = room_along(fence, path, self.flights.edges, widest=widest, overlap=overlap)
        return fence, room, reaches

    def _away(self, *, completed: bool = False) -> Iterator[FloatArray]:
        """Largest distances of some flights at a time from their route, (n, windows, 2, 2), m."""
        columns = self._off_route()
        for part in parts(len(self.scores)):
            extremes = self.extremes[part]
            if completed:
                extremes = extremes[np.isfinite(self.scores[part])]
            yield DISTANCE_SIGNS * extremes[:, :, columns]

    @property
    def nearness(self) -> list[FloatArray]:
        """How near each flight comes to leaving the band, and each fence."""
        rooms = [self._room(areas, KEPT)[1] for areas in self.about.fences]
        return [self.scores, *(self._beyond(room.limits) for room in rooms)]

    def _beyond(self, limits: FloatArray) -> FloatArray:
        """Largest distance of each flight beyond its limits, shape (N,), m; negative inside."""
        beyond = (np.nan_to_num(away - limits, nan=np.inf) for away in self._away())
        return np.concatenate([np.zeros(0), *(x.max(axis=(1, 2, 3)) for x in beyond)])

    @property
    def _not_inside(self) -> list[int]:
        return [self.inside(areas).outside for areas in self.about.fences] or [self.not_completed]

    def _off_route(self) -> list[int]:
        """Indices of the distances from a route among the signals."""
        check_off_route(self.about.signals, self.flights.over)
        return [list(self.about.signals).index(name) for name in OFF_ROUTE]

    @property
    def own_arrays(self) -> dict[str, FloatArray]:
        """The distances of flights by RTK, if there are any."""
        return {"by_rtk": self.by_rtk} if len(self.by_rtk) else {}

    @property
    def said_of_fences(self) -> list[str]:
        """The claim about each counted fence."""
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

    @property
    def too_many_lost(self) -> bool:
        """Whether more flights than a claim allows did not complete or count as incomplete."""
        return self.not_completed > self.allowed
