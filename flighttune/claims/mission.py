"""Missions: planned, counted inside a fence, and with the room to turn back."""

import math
import os
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias, TypedDict, Unpack

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.errors import InfeasibleError, InputError, keeping, naming, printable
from flighttune.base.files import code
from flighttune.base.files.load import BAND, PER_HOUR, kind_of, load_one, written
from flighttune.base.files.whole import keep_on_error, remove_file, together, write_text
from flighttune.base.words import listed
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.forecast import Spread
from flighttune.campaigns.planning.knowing import Knowledge
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.schema import Campaign
from flighttune.campaigns.planning.source import Flights, in_forecast
from flighttune.campaigns.planning.source import flights as flights_of_source
from flighttune.claims import counted_flights, counting
from flighttune.claims.band import KEPT, Band, check_off_route
from flighttune.claims.ending import AnyTime, Ending, Fixed, each_of
from flighttune.claims.hourly_flights import check_rates
from flighttune.claims.leaving import SAME_M, Alarms, Around
from flighttune.claims.per_hour import PerHour, count_per_hour
from flighttune.claims.rates_keys import RatesTable, load_rates
from flighttune.claims.turn_back import TurnBack
from flighttune.claims.unfinished import Unfinished, unfinished_beside
from flighttune.flight.route import PlannedRoute, planned_route, route
from flighttune.flight.scenario.load import scenario_from, with_changes
from flighttune.flight.scenario.schema import Scenario
from flighttune.routes import maps
from flighttune.routes.fence import Beyond, Fence, fence_tables, own_fence, read_fence
from flighttune.routes.volumes import CONTINGENCY, GEOGRAPHY, VolumesMap, are_in

# Default epsilon, confidence and number of learning flights.
EPSILON, CONFIDENCE, LEARN = 0.01, 0.95, 30

# Number of learning flights that turn back.
LEARN_TURNS = 60

# Default number of flights that may lie outside, so that no single one decides the corridor.
OUTSIDE = 2

# Trial factors, in this order, on the airspeed and the wind for planned turns, with which flights
# that ended early are repeated.
WIND = "route.wind_mps"
FACTORS = {"flight.V_a_mps": (0.9, 1.1, 0.8, 1.2), WIND: (1.5, 2.0)}

# Volumes that a fence may bound, by the words of a user, and their key in a GeoJSON of a fence. The
# operational volume is flight geography and contingency volume together; its limit is that of the
# contingency volume (SORA 2.5, annex I).
FenceOf: TypeAlias = Literal["operational", "geography"]
OPERATIONAL: FenceOf = "operational"
BOUNDED: Mapping[str, str] = {OPERATIONAL: CONTINGENCY, "geography": GEOGRAPHY}
FENCE_OF = "fence_of"

# Words for the file of a monitor on board.
A_MONITOR = "monitor counted on flights of the aircraft (flighttune monitor MISSION)"

# Epsilon and confidence of a claim.
Odds: TypeAlias = tuple[float, float]

# Ending of the name of a file of exits per flight hour, after that of the band's file
HOURLY = "-per-hour.json"

# Words for a file of them that is alone
NO_COUNTS = "the files of its band and of its room to turn back are not beside it"

# Number of trial values for a path inside its fence, and the lowest airspeed as a share.
TRIED, SLOWEST = 8, 0.4


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissionOdds(Answering):
    """Counts of a mission: its corridor, flights inside its fence, and room to turn back.

    Attributes
    ----------
    band : Band
        The corridor; ``band.inside(fence)`` has the flights inside a fence.
    room : TurnBack or None
        The flights that turn back, if they were counted.
    files : mapping of str to Path or None
        The written files: ``band``, ``room``, and of the volumes ``volumes`` and ``kml``.
    file : Path or None
        The file of the band.
    terrain : Path or None
        The file of the terrain, if it was given.
    way : str
        A sentence on a change that lets the flights that ended early complete; else empty.
    per_hour : PerHour or None
        Exits per flight hour, if rates of faults were declared.
    refused : str
        Why a file of exits per flight hour beside the band is not used; else empty.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "flights": 7}
    >>> short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
    >>> odds = ft.mission("circuit_in_wind", changes=short, **few)
    >>> odds.room is None, [*odds.band.about.signals]
    (True, ['cross_track', 'height_err'])
    """

    band: Band
    room: TurnBack | None = None
    files: Mapping[str, Path | None]
    file: Path | None = None
    terrain: str | Path | None = None
    way: str = ""
    per_hour: PerHour | None = None
    refused: str = ""

    @property
    def beyond(self) -> list[tuple[int, str, Beyond]]:
        """How far each claimed volume is beyond each counted fence, by number of fence and name."""
        if self.room is None or not (self.room.claims and self.band.claims):
            return []
        path, origin, h_0 = self.band.flights.route.where
        start = h_0 - self.band.flights.central.flight.ground_m
        return [
            (number, name, beyond)
            for number, tables in enumerate(self.band.about.fences, start=1)
            for fence in [read_fence(KEPT, origin, tables)]
            for name, beyond in fence.beyond(path, self.room.volumes(self.band), start)
        ]

    def with_rate(self, per_hour: PerHour) -> "MissionOdds":
        """The answer with the exits per flight hour, written beside the file of the band."""
        files = dict(self.files)
        if self.file is not None:
            files["per_hour"] = per_hour_beside(self.file)
            per_hour.save(files["per_hour"])
        return replace(self, per_hour=per_hour, files=files)

    def with_room(self, room: TurnBack) -> "MissionOdds":
        """The answer with the room to turn back, written beside the file of the band."""
        files = dict(self.files)
        if self.file is not None:
            beside = FilesBeside.of(self.file)
            files["room"] = beside.room
            with together():
                room.save(beside.room)
                if room.claims and self.band.claims:
                    files |= {"volumes": beside.volumes, "kml": beside.kml}
                    ground = self.band.flights.central.flight.ground_m
                    around = self.band.flights.route.where, ground, room.volumes(self.band)
                    beside.write(VolumesMap(*around), self.band.flights.scenario.title)
                else:
                    beside.remove_volumes()
                    files = {name: files[name] for name in files if name not in ("volumes", "kml")}
        return replace(self, room=room, files=files)


def bounding(areas: dict[str, Any], fence_of: FenceOf | None, file: Path) -> dict[str, Any]:
    """A fence with the volume that it bounds, as given or as its file states it."""
    if not areas:
        if fence_of is not None:
            raise InputError("`fence_of` must be with a fence, got none.")
        return areas
    if fence_of is not None and fence_of != areas.get(FENCE_OF, OPERATIONAL):
        areas = {**areas, FENCE_OF: fence_of}
    if (stated := areas.get(FENCE_OF, OPERATIONAL)) not in BOUNDED:
        raise InputError(
            f"{file}: `{FENCE_OF}` must be one of {listed([*BOUNDED], 'or')}, got {stated!r}."
        )
    return areas


def bounded_by(areas: Mapping[str, Any]) -> str:
    """The volume that a fence bounds, by its name on a map."""
    return BOUNDED.get(areas.get(FENCE_OF, OPERATIONAL), CONTINGENCY)


class FilesBeside(NamedTuple):
    """Files of the room to turn back and of its volumes, beside the band's file."""

    room: Path
    volumes: Path
    kml: Path

    @classmethod
    def of(cls, band: Path) -> "FilesBeside":
        """The files beside that of a band."""
        maps_of_it = (band.with_suffix(ending) for ending in (".geojson", ".kml"))
        return cls(Path(f"{band.with_suffix('')}-turn-back.npz"), *maps_of_it)

    def write(self, volumes: VolumesMap, title: str) -> None:
        """Write the volumes."""
        write_text(self.volumes, volumes.geojson())
        write_text(self.kml, volumes.kml(printable(title)))

    def remove_volumes(self) -> None:
        """Remove the volumes of an earlier count."""
        for file in (self.volumes, self.kml):
            if file.exists() and are_in(file):
                remove_file(file)


def per_hour_beside(band: Path) -> Path:
    """File of the exits per flight hour, beside the band's file."""
    return Path(f"{band.with_suffix('')}{HOURLY}")


def _remove_beside(band: Path) -> None:
    """Remove what an earlier count wrote beside the file of a band that is written over."""
    beside, hourly = FilesBeside.of(band), per_hour_beside(band)
    if band.exists() and beside.room.exists() and kind_of(beside.room) == BAND:
        remove_file(beside.room)
        beside.remove_volumes()
    if hourly.exists() and kind_of(hourly) == PER_HOUR:
        remove_file(hourly)


def kept_mission(band: Band, file: Path) -> MissionOdds:
    """A band along a route, with what the files beside it have counted of the same mission."""
    beside, hourly = FilesBeside.of(file), per_hour_beside(file)
    files, room, rate, refused = {"band": file}, None, None, ""
    if beside.room.exists() and (other := written(beside.room, BAND)) is not None:
        with suppress(InputError):  # of another route, or nothing is claimed
            if other.about.kind is TurnBack and other.volumes(band):
                room, found = other, beside._asdict().items()
                files |= {key: kept for key, kept in found if kept.exists()}
    try:
        other = written(hourly, PER_HOUR) if hourly.exists() else None
        if other is not None and _of_one_mission(other.plan, band.about.plan):
            rate, files["per_hour"] = other, hourly
    except InputError as error:  # of an earlier version, or changed
        refused = str(error)
    return MissionOdds(band=band, room=room, files=files, file=file, per_hour=rate, refused=refused)


def _of_one_mission(*plans: Mapping[str, Any]) -> bool:
    """Whether plans differ in their seeds and numbers of flights alone."""
    one, other = (
        [plan["gains"], plan["aircraft"], plan["nominal"]["route"], {**plan["campaign"], "seed": 0}]
        for plan in plans
    )
    return one == other


@code.flies
def mission(  # noqa: PLR0913 - each is a choice of the user, and has a default
    source: Band | Flights | Scenario | Campaign | Plan | str | Path,
    *,
    fences: Sequence[Path | str] = (),
    fence_of: FenceOf | None = None,
    turn_back: str | float | None = None,
    rates: RatesTable | str | Path | None = None,
    epsilon: float | None = None,
    confidence: float | None = None,
    flights: int | None = None,
    until_sure: bool = False,
    aircraft: str | None = None,
    like: str | None = None,
    terrain: str | Path | None = None,
    navigation: Knowledge | None = None,
    wind: str | Path | None = None,
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    run_code: bool = False,  # noqa: ARG001 - of the decorator
    **by: Unpack[FlownBy],
) -> MissionOdds:
    """Count whether a mission stays inside its fence, and the room to turn back.

    Its flights are drawn, and their corridor is counted like a `band`, learned from 30 flights.

    Parameters
    ----------
    source : Band, Flights, Scenario, Campaign, Plan, str or Path
        A mission (.plan, .waypoints, .kml, .geojson), a scenario or campaign with a route, or a
        band file, whose flights are not flown again.
    fences : sequence of str or Path
        Plans, KML or GeoJSON with areas to stay in and out of, by default the mission's fence.
    fence_of : {"operational", "geography"}, optional
        Volume that the fence bounds: the operational volume, which is flight geography and
        contingency volume together, or the flight geography alone. By default what the file of the
        fence states (``fence_of`` of a GeoJSON), else the operational volume.
    turn_back : str or float, deg, optional
        Also count the room to turn back, and its volumes: flight geography, contingency volume and
        ground risk buffer. Flights turn back at any place of the route, by 180 deg of course at
        this bank, or by a whole turn with ``circle:BANK``. Each rolls in 1 s after it detects that
        it must turn.
    rates : RatesTable, str or Path, optional
        File (.toml) of declared rates of faults per flight hour: each fault is drawn at any time of
        the flight, and the exits from the fence, or from the contingency volume of `turn_back`, are
        bounded per flight hour at the `confidence`.
    epsilon : float, 1, optional
        Accepted probability of each claim, by default 0.01, or the file's.
    confidence : float, 1, optional
        Confidence of all claims together, 0 to 1, by default 0.95, or the file's.
    flights : int, optional
        Flights to count, by default enough for the claim with two of them outside (720 with a
        fence). The count ends sooner if a no is certain.
    until_sure : bool
        Count until it is sure whether a flight leaves the fence with a probability of at most
        epsilon, by a rule that is valid at any number of flights. It plans no number and no
        corridor: a clear yes takes 420 flights, a clear no 12. At most `flights` are flown, by
        default 1049.
    aircraft : str, optional
        Aircraft that flies a mission, at an airspeed at which it is identified, or file of an
        identified model (.json), which flies as its lags, by default aerosonde.
    like : str, optional
        Campaign with the air and dispersions for a mission, by default light turbulence, wind to 8
        m/s and the dispersions of the aircraft.
    terrain : str or Path, optional
        Raster of heights above sea level in m (GeoTIFF, .hgt) for the mission's heights above
        terrain. The answer then has the lowest place of path and corridor over the ground. Without
        it the terrain is not checked.
    navigation : {"exact", "rtk", "standard", "poor"}, optional
        What autopilots know of their motion: a grade of ``[navigation]``, by default that of the
        source, else along a route a standard receiver and inertial unit.
    wind : str or Path, optional
        Forecast of Open-Meteo (.json, .csv) or NetCDF (.nc, classic, u100 and v100 of a grid at
        heights over ground), also ``FILE@TIME`` or ``FILE@FROM/TO`` by its clock:
        each flight draws its wind from the forecast's range at the mission's heights over all
        members and these times, instead of 0 to 8 m/s from anywhere. Turns and times are planned
        for the largest wind of this range, if ``route.wind_mps`` is not among the `changes`.
    out : str or Path, optional
        File (.npz) of the band to write, as its `save` does; the other answers are written beside
        it. From 250 flights on each count writes those so far into a file ``...-unfinished``, with
        which the same command goes on if it was killed.
    seed, changes, run_code, workers, scheduler, observer : as for `band`

    Returns
    -------
    MissionOdds

    Raises
    ------
    InputError, ScenarioError
        If the mission cannot be flown, a fence cannot be counted, or flights cannot turn back.
    InfeasibleError
        If the planned path already leaves the fence; then no flight is flown.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "flights": 7}
    >>> short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 300.0)]}
    >>> ft.mission("circuit_in_wind", changes=short, **few).answer().values["flights"]
    7
    """
    fliers = Fliers(**by)
    of_flights = {"aircraft": aircraft, "like": like, "changes": changes}
    counted, written = counting.kept_band(source), None if out is None else Path(out)
    if counted is None:
        file = written
        flown = _NewFlights(
            source=source,
            settings={**of_flights, "terrain": terrain},
            navigation=navigation,
            wind=wind,
            seed=seed,
            flights=flights,
            until_sure=until_sure,
            unfinished=None if file is None else Unfinished.beside(file),
        )
    else:
        own_count = {"seed": seed is not None, "flights": flights, "until_sure": until_sure}
        _check_absent({**of_flights, **own_count, "navigation": navigation, "wind": wind})
        check_off_route(counted.about.signals, counted.flights.over)
        file = Path(source) if isinstance(source, str | Path) else written
        flown = _CountedFlights(band=counted)
    # What else is counted stands beside the band that is written.
    near = written or file
    if turn_back is not None and near is not None:
        _check_beside(near, source, *fences)
    # Before any flight, this refuses sources that cannot be counted and paths outside the fence.
    turning = None if turn_back is None else counted_flights.turning_back(flown.plan, turn_back)
    areas, fence = _asked_fence(
        fences, flown.fences, fence_of, alone=until_sure, turns=turning is not None
    )
    volume = turning is not None or (bool(areas) and bounded_by(areas) == CONTINGENCY)
    declared = _declared(rates, flown.plan, volume=volume)
    alarms = None if declared is None else _alarms(rates, declared, flown.plan)
    claims = 1 if until_sure else 1 + bool(areas) + (turning is not None)
    claim = flown.claim(epsilon, confidence, claims)
    flown.check_path(claim, areas, fence, terrain)
    hours = declared is not None
    stages = (counted is None) + (turning is not None) + hours
    first = fliers.at_stage(1, stages)
    with keeping(*_unfinished_of(file, near)), together():
        band = flown.count(claim, areas, first)
        if file is not None:
            flown.save(band, file)
        if areas:
            band = band.with_fence(areas)
            band.inside(areas, fence)  # this refuses it before it is saved
            if file is not None:
                band.save(file)
        band = band.claiming(*claim)
        if written is not None:
            if file is not None and file.absolute() != written.absolute():
                _remove_beside(written)
            band.save(written)
        way = flown.way_to_complete(band, first)
        files = {"band": written}
        odds = MissionOdds(band=band, files=files, file=near, terrain=terrain, way=way)
        if turning is not None:
            stage = fliers.at_stage(stages - hours, stages)
            odds = odds.with_room(_counted_room(turning, flown.place, claim, near, stage))
        if declared is not None:
            rate = count_per_hour(
                flown.plan,
                declared,
                **_volume_of(odds, areas),
                alarms=alarms,
                confidence=CONFIDENCE if confidence is None else confidence,
                unfinished=None if near is None else unfinished_beside(per_hour_beside(near)),
                fliers=fliers.at_stage(stages, stages),
            )
            odds = odds.with_rate(rate)
        return odds


def _unfinished_of(file: Path | None, near: Path | None) -> list[Path]:
    """The files of the unfinished counts of all stages: flights, room to turn back, and hours."""
    files = [] if file is None else [file]
    if near is not None:
        files += [FilesBeside.of(near).room, per_hour_beside(near)]
    return [unfinished_beside(x) for x in files]


def _declared(
    rates: RatesTable | str | Path | None, plan: Plan, *, volume: bool
) -> RatesTable | None:
    """The declared rates, checked against what is flown; InputError without a volume."""
    if rates is None:
        return None
    table = rates if isinstance(rates, RatesTable) else load_rates(rates)
    with naming("rates" if table is rates else str(rates)):
        check_rates(plan, table)
        if not volume:
            raise InputError(
                "rates per hour must be with a fence, or with `turn_back` for a contingency "
                "volume, got no volume to stay in."
            )
    return table


def _alarms(
    rates: RatesTable | str | Path | None, declared: RatesTable, plan: Plan
) -> Alarms | None:
    """The monitor of declared rates, beside their file; InputError if it is of other flights."""
    if declared.ending.monitor is None:
        return None
    folder = Path(rates).parent if isinstance(rates, str | Path) else Path()
    file = folder / declared.ending.monitor
    monitor, (group,) = load_one(file, A_MONITOR, BAND), plan.groups
    with naming(file):
        if (watch := getattr(monitor, "watch", None)) is None:
            raise InputError(f"`monitor` must be a {A_MONITOR}.")
        flown = monitor.flights
        otherwise = flown.flown_otherwise(*group, plan.gain_sets[group.gains])
        if otherwise or flown.aircraft != plan.aircraft:
            raise InputError(
                "`monitor` must be of the aircraft, law and gains of the mission: "
                f"{otherwise or 'the files of its aircraft are others'}."
            )
    return Alarms.of(watch)


class VolumeOf(TypedDict):
    """What the operational volume of a claim per flight hour is derived from."""

    fence: dict[str, Any] | None
    around: Around | None


def _volume_of(odds: MissionOdds, areas: dict[str, Any]) -> VolumeOf:
    """The operational volume: its fence, or else the contingency volume around the route."""
    if areas and bounded_by(areas) == CONTINGENCY:
        return {"fence": areas, "around": None}
    return {"fence": None, "around": around_of(odds)}


def around_of(odds: MissionOdds) -> Around:
    """The contingency volume of a mission; InputError if its counts claim none."""
    if odds.room is None or not (odds.room.claims and odds.band.claims):
        raise InputError("rates per hour must be with a volume, but none is claimed by its count.")
    volume = odds.room.volumes(odds.band)[CONTINGENCY]
    return Around(width_m=volume.width, high_m=volume.high)


def check_hours(hourly: PerHour, file: Path) -> str:
    """Compare a contingency volume with the counts beside its file; a note if there are none.

    InputError if they differ.
    """
    band = Path(f"{str(file).removesuffix(HOURLY)}.npz")
    beside = band, FilesBeside.of(band).room
    if not (str(file).endswith(HOURLY) and all(x.exists() for x in beside)):
        return f"The width and height of its volume are the maker's: {NO_COUNTS}."
    counts = [load_one(x, "band file", BAND) for x in beside]
    again = around_of(MissionOdds(band=counts[0], room=counts[1], files={}))
    stated = hourly.around
    if stated is None or not np.allclose(
        (stated.width_m, stated.high_m), (again.width_m, again.high_m), rtol=0.0, atol=SAME_M
    ):
        raise InputError(
            f"`around` must be the contingency volume of {band.name}, {again.width_m:.12g} m wide "
            f"to each side and {again.high_m:.12g} m high, got another one."
        )
    return ""


def _counted_room(
    turning: Plan, place: str, claim: Odds, file: Path | None, fliers: Fliers
) -> TurnBack:
    """Count the room that flights need to turn back; it is written beside the band's file."""
    unfinished = None if file is None else Unfinished.beside(FilesBeside.of(file).room)
    room = counting.counted_on(
        TurnBack,
        turning,
        Fixed.enough(None, *claim, outside=OUTSIDE),
        place=place,
        learn=LEARN_TURNS,
        judged=lambda turns: turns,
        unfinished=unfinished,
        fliers=fliers,
    )
    if unfinished is not None:
        unfinished.remove()
    return room


@dataclass(frozen=True, kw_only=True)
class _NewFlights:
    """New flights of a mission, to be drawn and counted."""

    source: Any  # source for `flights`
    settings: Mapping[str, Any]  # keywords for `flights`
    navigation: Knowledge | None
    wind: str | Path | None  # forecast
    seed: int | None
    flights: int | None  # number to count
    until_sure: bool
    unfinished: Unfinished | None = None

    @cached_property
    def stated(self) -> Flights:
        """The flights of the source."""
        stated = flights_of_source(self.source, **self.settings)
        own = WIND in (self.settings["changes"] or {})
        return stated.knowing(self.navigation).in_wind(self.wind, plans=not own)

    @cached_property
    def plan(self) -> Plan:
        """The plan of their independent draws."""
        return counting.drawn(self.stated).with_seed(self.seed)

    @property
    def place(self) -> str:
        """The source of the flights, for messages."""
        return self.stated.place

    @property
    def fences(self) -> Sequence[Path]:
        """Files of the mission that have fences."""
        return self.stated.fences

    def changed(self, key: str, value: float) -> "_NewFlights":
        """The flights with another value of a key."""
        changes = {**(self.settings["changes"] or {}), key: value}
        return replace(self, settings={**self.settings, "changes": changes})

    def claim(self, epsilon: float | None, confidence: float | None, claims: int) -> Odds:
        """Epsilon of each claim, and its share of the total confidence."""
        confidence = CONFIDENCE if confidence is None else confidence
        return EPSILON if epsilon is None else epsilon, each_of(claims, confidence)

    def ending(self, claim: Odds) -> Ending:
        """The rule that ends the count: when sure, or after a number of flights."""
        if self.until_sure:
            return AnyTime.enough(self.flights, *claim)
        return Fixed.enough(self.flights, *claim, outside=OUTSIDE)

    def check_path(
        self, claim: Odds, areas: dict[str, Any], fence: Path, terrain: str | Path | None
    ) -> None:
        """Refuse a path below the ground or outside its fence, and several paths."""
        planned, ending = planned_route(self.plan.campaign.central), self.ending(claim)
        if terrain and (low := maps.clearance(terrain, planned.where))["over_ground_m"] < 0.0:
            raise InfeasibleError(maps.clearance_words("The planned path", low))
        if areas:
            place = read_fence(fence, planned.where[1], areas)
            nearest = place.nearest(planned.reference.path)
            if nearest["leaves_m"] is not None:
                words = planned_inside(planned, place, nearest)
                raise InfeasibleError(f"{words[0].upper()}{words[1:]}")
            plan = self.plan.with_runs(LEARN + ending.flights)
            counted_flights.check_one_path(plan, range(plan.runs))

    def count(self, claim: Odds, areas: dict[str, Any], fliers: Fliers) -> Band:
        """Count the flights, until their answer about the fence `areas`, if any, is certain."""
        return counting.counted_on(
            Band,
            self.plan,
            self.ending(claim),
            place=self.place,
            learn=LEARN,
            judged=lambda band: band.with_fence(areas) if areas else band,
            unfinished=self.unfinished,
            fliers=fliers,
        )

    def save(self, band: Band, file: Path) -> None:
        """Save the count, and remove what an earlier count wrote beside it."""
        _remove_beside(file)
        keep_on_error(file)
        band.save(file)
        if self.unfinished is not None:
            self.unfinished.remove()

    def way_to_complete(self, band: Band, fliers: Fliers) -> str:
        """A sentence on a change that lets the flights that ended early complete; else empty."""
        lost = sorted(row["run"] for row in band.endings)
        if not (lost and band.too_many_lost):
            return ""
        now = self.plan.scenario.flight.V_a_mps, band.flights.route.wind
        tried = zip(FACTORS.items(), now, strict=True)
        with WorkerPool(fliers) as pool:
            for key, x in ((key, x * value) for (key, factors), value in tried for x in factors):
                value = float(f"{x:.3g}")
                # Route and aircraft may lack the key.
                with suppress(InfeasibleError, InputError):
                    other = self.changed(key, value).plan.with_runs(band.about.plan["runs"])
                    rows = pool.in_order(other, lost)
                    if all(row["status"] == "completed" for row in rows):
                        they = "it completes" if len(lost) == 1 else f"these {len(lost)} complete"
                        return f"With `--set {key}={value:g}` {they}."
        V_a, wind = (", ".join(f"{x:g}" for x in sorted(of)) for of in FACTORS.values())
        times = f"{V_a} times the airspeed, or with turns for {wind} times the wind"
        return f"They do not complete with {times}."


@dataclass(frozen=True, kw_only=True)
class _CountedFlights:
    """Flights of a mission from an earlier count, which are not flown again."""

    band: Band

    place: ClassVar[str] = "the band"
    fences: ClassVar[Sequence[Path]] = ()

    @cached_property
    def plan(self) -> Plan:
        """Their plan."""
        return counted_flights.plan_of(self.band)

    def claim(self, epsilon: float | None, confidence: float | None, claims: int) -> Odds:
        """Epsilon and confidence of each claim, by default the count's values."""
        del claims
        own = self.band.about
        epsilon = own.epsilon if epsilon is None else epsilon
        return epsilon, own.confidence if confidence is None else confidence

    def check_path(
        self, claim: Odds, areas: dict[str, Any], fence: Path, terrain: str | Path | None
    ) -> None:
        """Refuse a fence that the path begins outside, and several paths."""
        del claim, terrain
        if areas:
            planned = planned_route(self.plan.campaign.central)
            read_fence(fence, planned.where[1], areas).nearest(planned.reference.path)
            counted_flights.check_one_path(self.plan, self.band.draws.tolist())

    def count(self, claim: Odds, areas: dict[str, Any], fliers: Fliers) -> Band:
        """Their count."""
        del claim, areas, fliers
        return self.band

    def save(self, band: Band, file: Path) -> None:
        """Do nothing: the file is there."""

    def way_to_complete(self, band: Band, fliers: Fliers) -> str:
        """Empty, because no flight is repeated with a change."""
        del band, fliers
        return ""


def _check_absent(settings: Mapping[str, Any]) -> None:
    """Refuse settings that a band already has."""
    for name in (name for name, value in settings.items() if value):
        raise InputError(f"`{name}` must be absent for a band, which has its own.")


def _check_beside(band: Path, *given: object) -> None:
    """Refuse a band file whose volumes would overwrite an input file."""
    _, *volumes = FilesBeside.of(band)
    for file in (Path(x) for x in given if isinstance(x, str | Path)):
        if any(x.exists() and file.exists() and x.samefile(file) for x in volumes):
            raise InputError(f"{band}: the volumes beside it must not replace {file}.")


def _asked_fence(
    fences: Sequence[str | Path],
    own: Sequence[Path],
    fence_of: FenceOf | None,
    *,
    alone: bool,
    turns: bool,
) -> tuple[dict[str, Any], Path]:
    """The GeoJSON of the requested fence, and its file; empty without a fence."""
    files = [Path(fence) for fence in fences or own]
    areas = fence_tables(files, asked=bool(fences))
    if alone and (turns or not areas):
        got = "`turn_back`, which needs a corridor" if areas else "no fence"
        raise InputError(f"`until_sure` must be about a fence alone, got {got}.")
    place = Path(", ".join(map(str, files)))
    return bounding(areas, fence_of, place), place


def mission_plan(
    source: str | Path,
    *,
    fences: Sequence[str | Path] = (),
    terrain: str | Path | None = None,
    wind: str | Path | None = None,
    out: Path | None = None,
    **of_route: Any,
) -> "PlannedMission":
    """The route of a mission or scenario before any flight, also written to a given file.

    Its path is checked against `fences`, or against the mission's own fence, and planned for the
    forecast `wind`. The route of a band file is written with its corridor; `of_route` are further
    arguments of `route`.
    """
    if out is not None and os.path.exists(out) and os.path.exists(source) and out.samefile(source):
        raise InputError(f"{out}: `--out` must be another file than the one that is read.")
    if band := counting.kept_band(source):
        if wind is not None or any(of_route.values()):
            raise InputError("`aircraft`, `wind` and `changes` must be absent for a band file.")
        planned, corridor, shapes = band.flights.route, band.corridor(), [*band.about.fences]
    else:
        planned = route(source, terrain=terrain, **of_route)
        corridor, shapes = None, []
    spread = None
    if wind is not None:
        plans = WIND not in (of_route.get("changes") or {})
        scenario, spread = in_forecast(planned.scenario, wind, plans=plans)
        planned = planned_route(scenario)
    files = [*map(Path, fences)] or ([] if shapes else [*own_fence(Path(source))])
    shapes += [tables] if (tables := fence_tables(files, asked=bool(fences))) else []
    seen = over_ground(planned, terrain, band)
    places = [read_fence(files[0] if files else KEPT, planned.where[1], shape) for shape in shapes]
    nearest = [fence.nearest(planned.reference.path) for fence in places]
    said = [planned_inside(planned, *x) for x in zip(places, nearest, strict=True)]
    notes = [] if out is None else planned.save(out, corridor, shapes)
    outside = [x for x, near in zip(said, nearest, strict=True) if near["leaves_m"] is not None]
    return PlannedMission(
        route=planned,
        nearest=nearest,
        outside=outside,
        inside=[x for x in said if x not in outside],
        seen=seen,
        notes=notes,
        file=out,
        forecast=spread,
    )


class OverGround(NamedTuple):
    """The lowest places of a path, and of its corridor, over the ground."""

    values: Mapping[str, Any]
    changed: Sequence[str] = ()  # the places in words
    faults: Sequence[str] = ()  # places below the ground, which make the answer no
    notes: Sequence[str] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedMission(Answering):
    """The planned route of a mission, with its fences and the ground."""

    route: PlannedRoute
    nearest: Sequence[Mapping[str, Any]]  # the place of the path nearest to each fence
    outside: Sequence[str]  # sentences on fences that the path leaves
    inside: Sequence[str]  # sentences on fences that the path stays inside
    seen: OverGround
    notes: Sequence[str]  # notes from writing the file
    file: Path | None
    forecast: Spread | None = None  # of the wind


def over_ground(planned: PlannedRoute, terrain: str | Path | None, band: Band | None) -> OverGround:
    """Clearance of a path and its corridor over terrain."""
    if terrain is None:
        return OverGround({}, notes=[maps.NOT_SEEN])
    seen = {"path": maps.clearance(terrain, planned.where)}
    if band is not None and band.claims and not band.about.predicted_from:
        seen["corridor"] = maps.clearance(terrain, planned.where, band.corridor())
    faults, changed = [], []
    for subject, lowest in zip(("the planned path", "the corridor"), seen.values(), strict=False):
        words = maps.clearance_words(subject, lowest)
        if lowest["over_ground_m"] < 0.0:
            faults.append(words)
        else:
            changed.append(f"{words[0].upper()}{words[1:]}")
    return OverGround({"terrain": seen}, changed, faults)


def planned_inside(planned: PlannedRoute, fence: Fence, nearest: Mapping[str, Any]) -> str:
    """A sentence on whether a planned path stays inside a fence, and on changes that would help."""
    (path, origin, _), edge = planned.where, nearest["edge"]
    there = f"on the {nearest['stretch']}, {nearest['along_m']:.0f} m along"
    if nearest["leaves_m"] is None:
        return (
            f"the planned path stays inside the fence, nearest {there}: "
            f"{nearest['margin_m']:.1f} m, {nearest['side']} ({edge})."
        )
    leaves = nearest["leaves_m"]
    lat, lon = maps.on_earth(path.beside(np.array([leaves])), origin)[0]
    ways = _ways_inside(planned, fence, path.stretch_at(leaves).waypoint)
    return (
        f"the planned path leaves the fence on the {path.stretch_at(leaves).words}, "
        f"{leaves:.0f} m along, at {lat:.5f}, {lon:.5f}, and is up to "
        f"{-nearest['margin_m']:.1f} m outside ({edge}, {there}). {ways}"
    )


def _ways_inside(planned: PlannedRoute, fence: Fence, waypoint: int) -> str:
    """The largest airspeed, wind or circle radius with which a planned path would stay inside."""
    scenario, path = planned.scenario, planned.reference.path
    assert scenario.route is not None  # a path exists
    V, radius = scenario.flight.V_a_mps, scenario.route.waypoint[waypoint - 1].radius_m
    slowest = [SLOWEST * V, *(table.config.envelope.V_a[0] for table in scenario.aircraft)]
    ranges = {"flight.V_a_mps": (V, max(slowest)), WIND: (planned.wind, 0.0)}
    if radius is not None:
        ranges[f"route.waypoint[{waypoint - 1}].radius_m"] = radius, 0.0
    ways = []
    for key, ends in ranges.items():
        for value in np.linspace(*ends, TRIED).tolist()[1:]:
            with suppress(InputError):
                changed = with_changes(scenario.as_dict(), {key: value}, planned.conditions)
                other = planned_route(scenario_from(changed)).reference.path
                if fence.nearest(other)["leaves_m"] is None:
                    ways.append(f"`--set {key}={value:.3g}`")
                    break
    least = math.ceil(-fence.nearest(path)["margin_m"])
    return (
        f"It stays inside with {' or '.join(ways)}."
        if ways
        else f"No lower airspeed or wind does: the route or the fence must be moved by {least} m."
    )
