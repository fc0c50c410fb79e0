"""Bands of campaigns: a shape learned from some flights, and its scale counted on fresh ones."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, check_at_least
from flighttune.campaign.counted_flights import (
    at_random,
    check_one_path,
    check_random,
    distribution_of,
    in_air,
    plan_in,
    plan_of,
)
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.engine.progress import CampaignObserver
from flighttune.campaign.flying.rows import fly_group
from flighttune.campaign.turn_back import room_of, turning_back
from flighttune.claims.band import (
    DOUBLED,
    About,
    Band,
    BandFlights,
    Over,
    axis_of,
    read_band,
    save_band,
    wind_at_start,
)
from flighttune.claims.count import flights_needed, fresh_flights
from flighttune.claims.fence import check_off_route
from flighttune.claims.shape import (
    MAX_NUMBERS,
    MAX_RESIDUAL_WINDOWS,
    MAX_WINDOWS,
    MIN_LEARNED,
    PART,
    Extremes,
    learned_shape,
    predicted,
    scores_of,
    window_edges,
    window_extremes,
)
from flighttune.claims.turn_room import ROOM
from flighttune.errors import InputError
from flighttune.files.load import BAND, written
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.flight.route import planned_route
from flighttune.gaps.residual import RESIDUALS, ConformantModel, conformant_model, residuals_of
from flighttune.metrics import OFF_ROUTE
from flighttune.planning.plan import Plan
from flighttune.planning.schema import Campaign
from flighttune.planning.source import Flights
from flighttune.planning.source import flights as flights_of_source
from flighttune.present.answer import pick
from flighttune.present.names import why_ended
from flighttune.references.fence import fence_tables, read_fence
from flighttune.references.follow import SAME_PLACE, RouteReference
from flighttune.scenario.schema import Scenario
from flighttune.simulate.bounds import ERRORS
from flighttune.simulate.run import SIGNAL_UNITS, Run

# Epsilon, confidence and flights to learn from by default, and for a mission, whose answer takes a
# minute on two cores; and of its flights those that may be outside.
CLAIM = {"epsilon": 0.01, "confidence": 0.999}, 500
MISSION = {"epsilon": 0.05, "confidence": 0.95}, 15
MISSION_OUTSIDE = 1

# Flights that turn back to learn from by default, and factors on the half-widths of `ROOM`: some
# metres of height more cost nothing, and the distance is bounded by nearly its quantile.
LEARN_TURNS, HEIGHT_ROOM = 60, np.array([1.0, 2.0])

# Numbers of flights named in the refusal of another one.
SHOWN = 3

# Rounding of times and distances, s and m.
SAME = 1e-9

# Difference of a shape that is learned again, as a share of its half-widths: other machines add up
# in another order.
SAME_SHAPE = 1e-6

# Keeps of a completed flight what is counted of it.
Probe: TypeAlias = partial[list[float]]

# Extremes of a signal of a flight that is outside of any band.
LOST = [-np.inf, np.inf]

# Keys that must be the same in all flights: the windows of a band are the same samples in each.
TIME_AXIS = ("flight.duration_s", "controller.rate_hz")


def band(  # noqa: PLR0913 - each is a choice of the user, and has a default
    source: Flights | Scenario | Campaign | Plan | str | Path,
    *,
    of: Literal["residual"] | None = None,
    signals: Iterable[str] | None = None,
    epsilon: float | None = None,
    confidence: float | None = None,
    flights: int | None = None,
    learn: int | None = None,
    predicted_from: Literal["wind"] | None = None,
    gains: str | None = None,
    plant: str | None = None,
    air: str | None = None,
    seed: int | None = None,
    start_deg: float = 0.0,
    changes: Mapping[str, Any] | None = None,
    aircraft: str | None = None,
    like: str | None = None,
    skip: bool = False,
    turn_back: str | float | None = None,
    fences: Sequence[str | Path] = (),
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    observer: CampaignObserver | None = None,
) -> Band:
    """Bound signals by counting flights: a new one leaves the band with at most a probability.

    The shape is learned from some flights, and its scale counted on fresh ones, which come after
    them in the draws. All are random and independent, whatever the design of the campaign. The
    claim holds for all signals at all times, for any law, plant and weather. By default 2140
    flights are flown, on two cores 25 of 45 s a second.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, str or Path
        What `flights` takes; or the file of a band, of which only the claim, the number of flights,
        fences and `out` are read: none of its flights is flown again. More flights and fences are
        kept in it.
    of : {"residual"}, optional
        Bound what the identified model of an aircraft misses, which `tube` takes, in place of
        recorded signals: rates of course and path angle (rad/s), roll and its change over a sample
        (rad), actual minus model.
    signals : iterable of str, optional
        Recorded signals, by default both errors, on a route the distances from it.
    epsilon, confidence : float, 1, optional
        Probability and confidence of the claim, by default 0.01 and 0.999, of a mission 0.05 and
        0.95.
    flights : int, optional
        Number to count, by default as many as the claim needs with five of them outside (1640), of
        a mission with one (93); of the file of a band 2, 4, 8 ... times as many as were planned.
    learn : int, optional
        Number to learn the shape from, by default 500, of a mission 15.
    predicted_from : {"wind"}, optional
        Put the band around a middle that is predicted from the wind of each flight.
    gains : str, optional
        Gain set by name or file, by default tuned_identified, else the first.
    plant : str, optional
        Label, by default the first aircraft, else the first plant.
    air : {"calm", "wind", "light", "moderate", "severe"}, optional
        Air of all flights, of those that the campaign has; by default drawn as in the campaign.
    seed : int, optional
        Seed of the draws, by default the campaign's.
    start_deg : float, deg
        Half-width of the range of starts of a scenario in course and path angle.
    changes : mapping of str to value, optional
        Values to set in the scenario, by dotted key.
    aircraft, like : str, optional
        Of a mission: the aircraft, by default ``aerosonde``, and the campaign whose air and
        dispersions its flights have, by default light turbulence, wind to 8 m/s and those of the
        aircraft.
    skip : bool
        Leave out commands of a mission that have no place.
    turn_back : str or float, deg, optional
        Count how far flights come that turn back at any place of their route, in place of recorded
        signals: 180 deg of course at this bank, or a whole turn with ``circle:BANK``. A flight
        finds that it must, goes on for 1 s, and rolls in; ``band.room`` has the bounds.
    fences : sequence of str or Path
        Plans, KML or GeoJSON with the areas to stay in and out of, by default a plan itself: count
        the flights along a route that are certainly inside, too.
    out : str or Path, optional
        File (.npz) to write, as its `save` does, before and after flights inside are counted.
    workers : int, optional
        Processes that fly on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    observer : CampaignObserver, optional
        Receives the progress; may stop the flights.

    Returns
    -------
    Band
        It claims nothing if too many flights were not completed.

    Raises
    ------
    InputError, ScenarioError
        If source, gains, plant or a signal are not there, the claim needs more flights, nothing is
        random, or an aircraft has no identified model.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> len(band.scores), band.outside
    (29, 5)
    """
    file = None if out is None else Path(out)
    by = workers, scheduler, observer
    claim: dict[str, Any] = {"epsilon": epsilon, "confidence": confidence}
    claim = {name: value for name, value in claim.items() if value is not None}
    read: dict[str, Any] = {"aircraft": aircraft, "like": like, "skip": skip, "changes": changes}
    of_source = {**read, "plant": plant, "gains": gains, "start_deg": start_deg}
    of_file = written(source, BAND)
    stated = (
        None if isinstance(of_file, Band) else flights_of_source(source, **read).starting(start_deg)
    )
    areas, fence = _areas(fences, stated) if turn_back is None else ({}, Path())
    if isinstance(of_file, Band):
        counting = {"of": of, "signals": signals, "predicted_from": predicted_from, "air": air}
        counting["turn_back"] = turn_back
        options = {**of_source, **counting, "learn": learn, "seed": seed is not None}
        for name in (name for name, value in options.items() if value):
            raise InputError(f"`{name}` must be absent for a band file, which has its own.")
        file, kept = Path(str(source)), of_file
        if areas:  # refuse it before a flight
            draws = kept.draws_of(flights or len(kept.scores)).tolist()
            _check_fence(plan_of(kept), draws, areas, fence, kept.about.signals)
        if flights is not None:
            out = out or file
            with WorkerPool(*by) as pool:
                kept = count_more(kept, flights, pool)
    else:
        assert stated is not None  # it is no band
        default, default_learn = CLAIM if stated.mission is None else MISSION
        default_learn = default_learn if turn_back is None else LEARN_TURNS
        claim, learn = default | claim, default_learn if learn is None else learn
        check_at_least(MIN_LEARNED, learn=learn)
        flights = _fresh(flights, stated, claim)
        bounded = _bounded(of, turn_back, any((signals, predicted_from, fences)))
        plan = _drawn(stated, plant, gains, air, seed)
        if turn_back is not None:
            plan = turning_back(plan, turn_back)
        plan = plan.with_runs(learn + flights)
        if areas:  # refuse it before a flight
            _check_fence(plan, range(plan.runs), areas, fence, signals or OFF_ROUTE)
        of_band = {"of": bounded, "predicted_from": predicted_from, "learned": learn, **claim}
        kept = _counted(stated.place, plan, signals, of_band, by)
    if file is not None and flights is not None:
        save_band(kept, file)  # whatever else is written: its readings are those of its file
    if areas:
        kept = kept.with_fence(areas)
        kept.inside(areas, fence)  # refuses it before it is kept
        if file is not None:
            save_band(kept, file)
    counted = kept.claiming(**pick(kept.about, "epsilon confidence") | claim)
    if out is not None:
        save_band(counted, out)
    return counted


def _fresh(flights: int | None, stated: Flights, claim: dict[str, Any]) -> int:
    """The number of flights to count; of a mission by default with one outside."""
    if stated.mission is not None and flights is None:
        flights = flights_needed(**claim, outside=MISSION_OUTSIDE)
    return fresh_flights(flights, **claim)


def _bounded(of: str | None, turn_back: str | float | None, others: bool) -> str | None:
    """The kind of signals bounded in place of recorded ones; refuse what goes with these alone."""
    kind = of if turn_back is None else "turn_back"
    if kind and (others or (of and turn_back is not None)):
        raise InputError(
            f"`signals`, `given` and `fences` must be absent for {kind.replace('_', ' ')} signals."
        )
    return kind


def _areas(fences: Sequence[str | Path], stated: Flights | None) -> tuple[dict[str, Any], Path]:
    """The areas of some fences, by default of a plan's own, and the files that have them."""
    files = [*map(Path, fences or (() if stated is None else stated.fences))]
    areas = fence_tables(files) if files else {}
    if fences and not areas:
        raise InputError(f"{files[0]}: must have a Polygon or circle for a fence, got none.")
    return areas, Path(", ".join(map(str, files)))


def _check_fence(
    plan: Plan, runs: Sequence[int], areas: dict[str, Any], file: Path, signals: Iterable[str]
) -> None:
    """Refuse a fence in which some runs of a plan, and their signals, cannot be counted."""
    check_off_route(signals)
    _, origin, _ = planned_route(plan.campaign.central).where
    read_fence(file, origin, areas)
    check_one_path(plan, runs)


def _drawn(
    stated: Flights, plant: str | None, gains: str | None, air: str | None, seed: int | None
) -> Plan:
    """Independent draws of one group of flights, by default of the first aircraft, in an air."""
    plan = stated.plan(plant=plant, gains=gains, kind="jsbsim")
    labels = (table.label for table in plan.scenario.aircraft)
    group = plan.chosen_group(
        plant or next(labels, None), gains if gains in plan.gain_sets else None
    )
    campaign = at_random(plan.campaign if air is None else in_air(plan.campaign, air))
    if seed is not None:
        campaign = campaign.model_copy(update={"seed": seed})
    return replace(plan.of_group(group), campaign=campaign)


def _counted(
    source: str,
    plan: Plan,
    signals: Iterable[str] | None,
    of_band: dict[str, Any],
    by: tuple[int | None, str | None, CampaignObserver | None],
) -> Band:
    """The band of the flights of a plan, of which the first are learned from."""
    (group,), central, learned = plan.groups, plan.campaign.central, of_band["learned"]
    distribution = distribution_of(plan.campaign, group.plant)
    check_random(source, distribution, central)
    for key in {*TIME_AXIS} & {*plan.keys}:
        raise InputError(f"{source}: `{key}` must be the same in all flights of a band.")
    of, windy = of_band["of"], of_band["predicted_from"] is not None
    if windy and not any(key.startswith("wind.") for key in distribution.dispersed):
        raise InputError(f"{source}: the wind must be drawn for `given` wind, got one wind.")
    units = _units(plan, of, signals)
    flights = flights_of(plan, of, len(units), plan.runs - learned)
    probe = partial(_extremes, list(units), flights.edges, windy, flights.model)
    with WorkerPool(*by) as pool:
        pool.progress.budget = plan.runs
        coefficients, half = _learned(pool, plan, probe, learned, of, of_band["epsilon"])
        extremes, wind = _flown(pool, plan, probe, range(learned, plan.runs), "counting")
    shape = {"signals": units, "coefficients": coefficients, "half": half, "plan": plan.as_dict()}
    endings = [x for x in pool.progress.endings if x["run"] >= learned]
    about = About(**shape, **of_band)
    return Band(about=about, flights=flights, extremes=extremes, wind=wind, endings=endings)


def _learned(
    pool: WorkerPool, plan: Plan, probe: Probe, learned: int, of: str | None, epsilon: float
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and half-widths that follow from the first draws of a plan."""
    flights = _flown(pool, plan, partial(probe, anywhere=True), range(learned), "learning")
    try:
        coefficients, half = learned_shape(*flights, epsilon)
    except InputError as error:
        raise InputError(f"{error}{why_ended(pool.progress.endings)}") from error
    return coefficients, half * HEIGHT_ROOM if of == "turn_back" else half


def _units(plan: Plan, of: str | None, signals: Iterable[str] | None) -> dict[str, str]:
    """Units of the signals of a kind, or of some recorded ones.

    These are by default the errors, or the distances from a route.
    """
    if of is not None:
        return dict({"residual": RESIDUALS, "turn_back": ROOM}[of])
    central = plan.campaign.central
    run, default = fly_group(plan, central, plan.groups[0]), OFF_ROUTE if central.route else ERRORS
    names = list(dict.fromkeys(signals or default))
    for name in names:
        if name not in run.signals:
            recorded = ", ".join(map(str, run.signals.columns))
            raise InputError(f"`signal` must be one of {recorded}, got {name!r}.")
    return {name: run.units.get(name) or SIGNAL_UNITS.get(name, "") for name in names}


def flights_of(
    plan: Plan, of: Literal["residual", "turn_back"] | None, signals: int, flights: int
) -> BandFlights:
    """The flights of a plan, of which so many are counted first, in windows of so many signals."""
    (group,), central = plan.groups, plan.campaign.central
    over: Over = "time"
    length, per_unit = central.flight.duration_s, central.controller.rate_hz
    if of == "residual":
        central.check_over_time("a band of residual signals")
    most = MAX_RESIDUAL_WINDOWS if of == "residual" else MAX_WINDOWS
    followed, gains = reference_of(central), plan.gain_sets[group.gains]
    assert gains is not None  # of the group that was chosen
    if isinstance(followed, RouteReference):
        over, length, per_unit = "along", math.ceil(followed.path.length), 1.0
    edges = window_edges(round(length * per_unit) + 1, flights, signals, most=most)
    if of == "turn_back":  # the largest after detection
        assert central.turn_back is not None  # its signals are of such flights
        edges = np.array([math.ceil(central.turn_back.detected_s * per_unit), edges[-1]])
    return BandFlights(
        over=over,
        edges=edges / per_unit,
        distribution=distribution_of(plan.campaign, group.plant),
        scenario=plan.scenario,
        central=central,
        plant=group.plant,
        gains_name=group.gains,
        gains=gains,
        aircraft=plan.aircraft,
        model=conformant_model(plan.scenario, group.plant) if of == "residual" else None,
    )


def load_band(path: str | Path) -> Band:
    """Read a band; its windows, and the words for its flights, are those of its plan."""

    def of_plan(about: About) -> BandFlights:
        plan = plan_in(about)
        first = plan.runs - about.learned
        check_at_least(1, runs=first)
        return flights_of(plan, about.of, len(about.signals), first)

    band = read_band(path, of_plan)
    if band.about.fences:
        check_one_path(plan_in(band.about), band.draws.tolist())
    return band


def count_more(band: Band, flights: int, pool: WorkerPool) -> Band:
    """The band after `flights` draws of its campaign in all: an InputError refuses fewer."""
    counted = len(band.scores)
    most = MAX_NUMBERS // (2 * band.about.half.size)
    allowed = [n for n in (counted * DOUBLED[1:]).tolist() if n <= most]
    if flights not in allowed:
        raise InputError(
            f"`flights` must be one of the numbers fixed when the count was planned, "
            f"{', '.join(map(str, allowed[:SHOWN]))} ..., got {flights}: a number chosen after "
            "looking at a count would make its confidence false."
        )
    runs = band.draws_of(flights)[counted:].tolist()
    plan = plan_of(band).with_runs(runs[-1] + 1)
    more = _flown(pool, plan, _probe(band.about, band.flights), runs, "counting")
    return band.with_flights(*more, pool.progress.endings)


def check_shape(band: Band, pool: WorkerPool) -> None:
    """Fly the flights learned from again; an InputError refuses a shape that they do not give."""
    about, plan = band.about, plan_of(band)
    if [*_units(plan, about.of, about.signals).items()] != [*about.signals.items()]:
        raise InputError("`signals` must have the units of the flights.")
    epsilon, _ = about.planned or (about.epsilon, about.confidence)
    probe = _probe(about, band.flights)
    coefficients, half = _learned(pool, plan, probe, about.learned, about.of, epsilon)
    moved = predicted(band.wind, coefficients - about.coefficients)
    for name, off in (("half", half - about.half), ("coefficients", moved)):
        if not (np.abs(off) <= SAME_SHAPE * half).all():
            raise InputError(
                f"`{name}` must follow from the {about.learned} flights learned from, which were "
                "flown again and give others; count the band again if it was read at another "
                "`epsilon` by flighttune 0.3.0."
            )


def some_draws(band: Band, flights: int) -> list[int]:
    """Some of the counted draws at random, and some of those that repeat another to the bit."""
    counted = len(band.scores)
    if not 1 <= flights <= counted:
        raise InputError(f"`count` must be 1 to the {counted} counted, got {flights}.")
    # Flights that are equal to the bit may be copies: so many of those are chosen too.
    rng, rows = np.random.default_rng(), band.extremes.reshape(counted, -1)
    _, first = np.unique(rows, axis=0, return_index=True)
    repeated = np.setdiff1d(np.flatnonzero(np.isfinite(band.scores)), first)
    kinds = np.arange(counted), repeated
    some = [rng.choice(kind, min(flights, len(kind)), replace=False) for kind in kinds]
    return band.draws[np.unique(np.concatenate(some))].tolist()


def differing(band: Band, draws: Sequence[int], pool: WorkerPool) -> list[int]:
    """The counted draws, in rising order, that differ by a bit when they are flown again."""
    chosen = np.searchsorted(band.draws, draws)
    probe = _probe(band.about, band.flights)
    again, wind = _flown(pool, plan_of(band), probe, draws, "counting again")
    differ = (again != band.extremes[chosen]).any(axis=(1, 2, 3))
    differ |= (wind != band.wind[chosen]).any(axis=1) & np.isfinite(band.scores[chosen])
    return [draw for draw, other in zip(draws, differ, strict=True) if other]


def score(about: About, flights: BandFlights, run: Run, scenario: Scenario) -> float:
    """Scale at which a flight is just inside a band."""
    extremes, wind = np.split(
        np.array(_probe(about, flights)(run, scenario)), [2 * about.half.size]
    )
    shape = 1, *about.half.shape, 2
    return float(scores_of(extremes.reshape(shape), wind[None], about.coefficients, about.half)[0])


def _probe(about: About, flights: BandFlights) -> Probe:
    """The function that keeps the extremes of each flight."""
    windy = about.predicted_from is not None
    return partial(_extremes, list(about.signals), flights.edges, windy, flights.model)


def _flown(
    pool: WorkerPool, plan: Plan, probe: Probe, runs: Sequence[int], doing: str
) -> tuple[Extremes, FloatArray]:
    """Extremes of some runs, and their wind where the probe has it."""
    signals, edges, windy, _ = probe.args
    shape = len(edges) - 1, len(signals), 2
    size = math.prod(shape)
    lost = LOST * (size // 2) + [0.0, 0.0] * windy
    extremes, winds = [], []
    for first in range(0, len(runs), PART):
        number = f", part {first // PART + 1} of {math.ceil(len(runs) / PART)}"
        phase = f"{doing}{number if len(runs) > PART else ''}"
        part = runs[first : first + PART]
        rows = pool.in_order(plan, part, doing=phase, probes={"extremes": probe})
        values = np.array([row.get("extremes", lost) for row in rows])
        extremes.append(values[:, :size].astype(np.float32).reshape(-1, *shape))
        winds.append(values[:, size:])
    return np.concatenate(extremes), np.concatenate(winds)


def _extremes(
    signals: list[str],
    edges: FloatArray,
    windy: bool,
    model: ConformantModel | None,
    run: Run,
    scenario: Scenario,
    *,
    anywhere: bool = False,
) -> list[float]:
    """Extremes of signals, or of residuals of a `model`, by window; then the wind at the start."""
    axis = axis_of(run)
    samples = np.searchsorted(axis, edges - SAME).clip(max=len(axis) - 1)
    samples[:-1] = samples[:-1].clip(max=len(axis) - 2)  # a window has a sample before its last
    if model is not None:
        flown = residuals_of(model, run, start_condition(scenario))  # from each sample to the next
    elif scenario.turn_back is not None and [*ROOM] == signals:
        flown = room_of(run, scenario.turn_back)
    else:
        flown = run.signals[signals].to_numpy()
    values = np.ravel(window_extremes(flown, samples)).tolist()
    route = reference_of(scenario)
    if (
        not anywhere
        and isinstance(route, RouteReference)
        and {*OFF_ROUTE} & {*signals}
        and route.displacement(run.signals) > SAME_PLACE
    ):
        values = LOST * (len(values) // 2)
    return [*values, *wind_at_start(scenario)] if windy else values
