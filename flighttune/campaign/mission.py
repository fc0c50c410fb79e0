"""Missions: planned, counted inside their fence, and turned back from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from flighttune.campaign.band import By, counted_on, drawn, kept_band
from flighttune.campaign.counted_flights import check_one_path, plan_of
from flighttune.campaign.engine.progress import CampaignObserver
from flighttune.campaign.turn_back import turning_back
from flighttune.claims.band import Band, TurnBack
from flighttune.claims.count import flights_needed, fresh_flights
from flighttune.claims.fence import check_off_route
from flighttune.errors import InputError
from flighttune.files.whole import write_text
from flighttune.flight.route import planned_route, route
from flighttune.planning.plan import Plan
from flighttune.planning.schema import Campaign
from flighttune.planning.source import Flights
from flighttune.planning.source import flights as flights_of_source
from flighttune.present.answer import Answer, Answering
from flighttune.references.fence import fence_tables, read_fence
from flighttune.references.maps import volumes_geojson
from flighttune.scenario.schema import Scenario

# Epsilon, confidence and flights to learn from by default, whose answer takes a minute on two
# cores; and of the flights those that may be outside.
EPSILON, CONFIDENCE, LEARN, OUTSIDE = 0.05, 0.95, 15, 1

# Flights that turn back to learn from.
LEARN_TURNS = 60


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MissionOdds(Answering):
    """What was counted of a mission: its corridor, flights inside its fence, room to turn back.

    Attributes
    ----------
    band : Band
        The corridor; ``band.inside(fence)`` has the flights inside a fence.
    room : TurnBack or None
        The flights that turn back, if they were counted.
    files : mapping of str to Path or None
        The files written: ``band``, ``room`` and ``volumes``.
    file : Path or None
        The file of the band.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "flights": 7}
    >>> short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 600.0)]}
    >>> odds = ft.mission("circuit_in_wind", changes=short, **few)
    >>> odds.room is None, [*odds.band.about.signals]
    (True, ['cross_track', 'height_err'])
    """

    band: Band
    room: TurnBack | None = None
    files: Mapping[str, Path | None]
    file: Path | None = None

    def with_room(self, room: TurnBack) -> "MissionOdds":
        """The answer with the room to turn back, written beside the file of the band."""
        files = dict(self.files)
        if self.file is not None:
            files["room"] = Path(f"{self.file.with_suffix('')}-turn-back.npz")
            room.save(files["room"])
            if room.claims and self.band.claims:
                files["volumes"] = self.file.with_suffix(".geojson")
                text = volumes_geojson(self.band.flights.route.where, room.volumes(self.band))
                write_text(files["volumes"], f"{text}\n")
        return replace(self, room=room, files=files)

    def answer(self) -> Answer:
        """The answer of the band, with the room to turn back beside it; a failure if one fails."""
        answer, room = self.band.answer(self.file or "FILE"), self.room
        if room is None:
            return replace(answer, files=self.files)
        said = room.answer(self.files.get("room") or "FILE")
        return replace(
            answer,
            values={**answer.values, "turn_back": said.values},
            tables=[*answer.tables, said.tables[0]],
            notes=[*answer.notes, *said.notes, said.verdict],
            failure=answer.failure or said.failure,
            files=self.files,
        )


def mission(  # noqa: PLR0913 - each is a choice of the user, and has a default
    source: Band | Flights | Scenario | Campaign | Plan | str | Path,
    *,
    fences: Sequence[str | Path] = (),
    turn_back: str | float | None = None,
    epsilon: float | None = None,
    confidence: float | None = None,
    flights: int | None = None,
    aircraft: str | None = None,
    like: str | None = None,
    skip: bool = False,
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    observer: CampaignObserver | None = None,
) -> MissionOdds:
    """Count whether a mission stays inside its fence, and the room that it needs to turn back.

    Its flights are drawn, and their corridor is counted as a `band`: 15 are learned from.

    Parameters
    ----------
    source : Band, Flights, Scenario, Campaign, Plan, str or Path
        A mission (.plan, .waypoints, .kml, .geojson), a scenario or campaign with a route, or the
        band file of one: its flights are not flown again.
    fences : sequence of str or Path
        Plans, KML or GeoJSON with the areas to stay in and out of, by default that of a .plan.
    turn_back : str or float, deg, optional
        Count the room to turn back too, and its volumes: flight geography, contingency volume and
        ground risk buffer. Flights turn back at any place of the route, by 180 deg of course at
        this bank, or by a whole turn with ``circle:BANK``. A flight finds that it must, goes on for
        1 s, and rolls in.
    epsilon : float, 1, optional
        Accepted probability of each claim, by default 0.05, or the file's.
    confidence : float, 1, optional
        Confidence of each claim, 0 to 1, by default 0.95, or the file's.
    flights : int, optional
        Flights to count, by default as many as the claim needs with one of them outside (93).
    aircraft : str, optional
        Aircraft that flies a mission, at an airspeed at which it is identified, by default
        aerosonde.
    like : str, optional
        Campaign whose air and dispersions the flights of a mission have, by default light
        turbulence, wind to 8 m/s and the dispersions of the aircraft.
    skip : bool
        Leave out commands of a mission that have no place.
    seed : int, optional
        Seed of the draws, by default the campaign's.
    changes : mapping of str to value, optional
        Values to set in the scenario, by dotted key.
    out : str or Path, optional
        File (.npz) of the band to write, as its `save` does; the room and its volumes are written
        beside it.
    workers : int, optional
        Processes that fly on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    observer : CampaignObserver, optional
        Receives the progress; may stop the flights.

    Returns
    -------
    MissionOdds

    Raises
    ------
    InputError, ScenarioError
        If the mission cannot be flown, a fence not be counted, or flights not turn back.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "flights": 7}
    >>> short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 600.0)]}
    >>> ft.mission("circuit_in_wind", changes=short, **few).answer().values["flights"]
    7
    """
    by: By = (workers, scheduler, observer)
    of_flights = {"aircraft": aircraft, "like": like, "skip": skip, "changes": changes}
    file, kept = None if out is None else Path(out), kept_band(source)
    if kept is None:
        assert not isinstance(source, Band)
        epsilon = EPSILON if epsilon is None else epsilon
        confidence = CONFIDENCE if confidence is None else confidence
        stated = flights_of_source(source, **of_flights)
        plan, place, own = drawn(stated, None, None, None, seed), stated.place, stated.fences
        flights = fresh_flights(
            flights or flights_needed(epsilon, confidence, OUTSIDE), epsilon, confidence
        )
        draws: Sequence[int] = range(LEARN + flights)
        plan = plan.with_runs(len(draws))
    else:
        for name, value in {**of_flights, "seed": seed is not None, "flights": flights}.items():
            if value:
                raise InputError(f"`{name}` must be absent for a band, which has its own.")
        epsilon = kept.about.epsilon if epsilon is None else epsilon
        confidence = kept.about.confidence if confidence is None else confidence
        check_off_route(kept.about.signals, kept.flights.over)
        plan, place, own, draws = plan_of(kept), "the band", (), kept.draws.tolist()
        file = Path(source) if isinstance(source, str | Path) else file
    # What cannot be counted is refused before a flight.
    planned = planned_route(plan.campaign.central)
    turning = None if turn_back is None else turning_back(plan, turn_back)
    fence_files = [Path(fence) for fence in fences or own]
    areas, fence = fence_tables(fence_files), Path(", ".join(map(str, fence_files)))
    if fences and not areas:
        raise InputError(f"{fence_files[0]}: must have a Polygon or circle for a fence, got none.")
    if areas:
        read_fence(fence, planned.where[1], areas)
        check_one_path(plan, draws)
    count = partial(counted_on, place=place, epsilon=epsilon, confidence=confidence, by=by)
    band = kept or count(Band, plan=plan, flights=flights, learn=LEARN)
    if file is not None and kept is None:
        band.save(file)  # also where its fence is refused
    if areas:
        band = band.with_fence(areas)
        band.inside(areas, fence)  # refuses it before it is kept
        if file is not None:
            band.save(file)
    band = band.claiming(epsilon, confidence)
    if out is not None:
        band.save(out)
    odds = MissionOdds(band=band, files={"band": None if out is None else Path(out)}, file=file)
    if turning is None:
        return odds
    turns = flights_needed(epsilon, confidence, OUTSIDE)
    return odds.with_room(count(TurnBack, plan=turning, flights=turns, learn=LEARN_TURNS))


def mission_plan(
    source: str | Path,
    *,
    aircraft: str | None = None,
    skip: bool = False,
    changes: Mapping[str, Any] | None = None,
    out: Path | None = None,
) -> Answer:
    """The route of a mission or scenario before a flight, written to a file if one is stated.

    The route of a band file is written with its corridor. Raises InputError if the route cannot be
    flown, or `out` is the file that is read.
    """
    if out is not None and out.exists() and Path(source).exists() and out.samefile(source):
        raise InputError(f"{out}: `--out` must be another file than the one that is read.")
    if band := kept_band(source):
        if aircraft or skip or changes:
            raise InputError("`aircraft`, `skip` and `changes` must be absent for a band file.")
        planned, corridor, fences = band.flights.route, band.corridor(), band.about.fences
    else:
        planned = route(source, aircraft=aircraft, skip=skip, changes=changes)
        plan = str(source).lower().endswith(".plan")
        corridor, own = None, fence_tables([Path(source)]) if plan and out else {}
        if own:
            read_fence(Path(source), planned.where[1], own)  # or it is refused
        fences = (own,) if own else ()
    answer = planned.answer()
    notes = [] if out is None else planned.save(out, corridor, fences)
    return replace(answer, notes=[*answer.notes, *notes], files={"route": out})
