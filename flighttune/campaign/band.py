"""Flights that are counted: a shape learned from some, and its scale counted on fresh ones."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

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
from flighttune.campaign.turn_back import room_of
from flighttune.claims.band import ROOM, Band, Residual, read_counted
from flighttune.claims.count import LOOK, fresh_flights
from flighttune.claims.counted import (
    DOUBLED,
    About,
    BandFlights,
    Counted,
    Of,
    Over,
    axis_of,
    wind_at_start,
)
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
from flighttune.errors import InputError
from flighttune.files.load import BAND, written
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.gaps.residual import RESIDUALS, ConformantModel, conformant_model, residuals_of
from flighttune.gaps.watch import (
    SignalModel,
    columns_of,
    dt_of,
    models_of,
    moments,
    residuals,
    taught,
    units_of,
)
from flighttune.metrics import OFF_ROUTE
from flighttune.planning.plan import Plan
from flighttune.planning.schema import Campaign
from flighttune.planning.source import Flights
from flighttune.planning.source import flights as flights_of_source
from flighttune.present.names import why_ended
from flighttune.references.follow import SAME_PLACE, RouteReference
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import ERRORS, SIGNAL_UNITS, Run

# Epsilon, confidence and flights to learn from by default.
EPSILON, CONFIDENCE, LEARN = 0.01, 0.999, 500

# Factors on the half-widths of `ROOM`: some metres of height more cost nothing, and the distance is
# bounded by nearly its quantile.
HEIGHT_ROOM = np.array([1.0, 2.0])

# Flights counted before the answer is first judged; then twice, four times ... as many.
BATCH = 24

# Numbers of flights named in the refusal of another one.
SHOWN = 3

# Rounding of times and distances, s and m.
SAME = 1e-9

# Difference of a shape that is learned again, as a share of its half-widths: other machines add up
# in another order.
SAME_SHAPE = 1e-6

# Keeps of a completed flight what is counted of it.
Probe: TypeAlias = partial[list[float]]

C = TypeVar("C", bound=Counted)

# Workers, or the address of a scheduler that has them, and who watches them.
By: TypeAlias = tuple[int | None, str | None, CampaignObserver | None]

# Extremes of a signal of a flight that is outside of any band.
LOST = [-np.inf, np.inf]

# Keys that must be the same in all flights: the windows of a band are the same samples in each.
TIME_AXIS = ("flight.duration_s", "controller.rate_hz")


def band(  # noqa: PLR0913 - each is a choice of the user, and has a default
    source: Flights | Scenario | Campaign | Plan | str | Path,
    *,
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
        A campaign (file, shipped name or folder), a scenario in which something is random or
        `start_deg` is given, or the file of any count: its flights are not flown again. It keeps
        what is counted more, and takes only another claim, `flights` and `out`.
    signals : iterable of str, optional
        Recorded signals to bound, by default chi_err and gamma_err, on a route cross_track and
        height_err.
    epsilon : float, 1, optional
        Accepted probability of leaving the band, by default 0.01, or the file's.
    confidence : float, 1, optional
        Confidence of the claim, 0 to 1, by default 0.999, or the file's.
    flights : int, optional
        Flights to count in all, by default as many as the claim needs with five of them outside
        (1640). The count in a file grows to 2, 4, 8 ... times as many as were planned.
    learn : int, optional
        Flights to learn the shape from, by default 500.
    predicted_from : {"wind"}, optional
        Put the band around a middle that is predicted from the wind of each flight.
    gains : str, optional
        Gain set by name or file, by default tuned_identified, else the first.
    plant : str, optional
        Label of the plant, by default the first aircraft, else the first.
    air : {"calm", "wind", "light", "moderate", "severe"}, optional
        Air of all flights, of those of the campaign, by default as it draws them.
    seed : int, optional
        Seed of the draws, by default the campaign's.
    start_deg : float, deg
        Half-width of the start range in course and path angle.
    changes : mapping of str to value, optional
        Values to set in the scenario, by dotted key.
    out : str or Path, optional
        File (.npz) to write, as its `save` does.
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
        random, or it is a mission, which `mission` counts.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> len(band.scores), band.outside
    (29, 5)
    """
    by = workers, scheduler, observer
    if kept := written(source, BAND):  # of any kind of count
        options = {"signals": signals, "learn": learn, "predicted_from": predicted_from}
        options |= {"gains": gains, "plant": plant, "air": air, "seed": seed is not None}
        for name, value in {**options, "start_deg": start_deg, "changes": changes}.items():
            if value:
                raise InputError(f"`{name}` must be absent for a band file, which has its own.")
        if flights is not None:
            with WorkerPool(*by) as pool:
                kept = count_more(kept, flights, pool)
            kept.save(str(source))  # whatever else is written: its readings are those of its file
            out = out or str(source)
        own = kept.about.epsilon, kept.about.confidence
        stated = epsilon, confidence
        counted = kept.claiming(*(x if y is None else y for x, y in zip(own, stated, strict=True)))
    else:
        flown = flights_of_source(source, changes=changes).starting(start_deg)
        if flown.mission is not None:
            raise InputError(
                f"{source}: flights of a mission must be counted with `flighttune mission`, in "
                "Python with `ft.mission`."
            )
        counted = counted_on(
            Band,
            drawn(flown, plant, gains, air, seed),
            place=flown.place,
            epsilon=EPSILON if epsilon is None else epsilon,
            confidence=CONFIDENCE if confidence is None else confidence,
            flights=flights,
            learn=LEARN if learn is None else learn,
            signals=signals,
            predicted_from=predicted_from,
            by=by,
        )
    if out is not None:
        counted.save(out)
    return counted


def residual(  # noqa: PLR0913 - as `band`
    source: Flights | Scenario | Campaign | Plan | str | Path,
    *,
    epsilon: float = EPSILON,
    confidence: float = CONFIDENCE,
    flights: int | None = None,
    learn: int = LEARN,
    gains: str | None = None,
    plant: str | None = None,
    air: str | None = None,
    seed: int | None = None,
    start_deg: float = 0.0,
    changes: Mapping[str, Any] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    observer: CampaignObserver | None = None,
) -> Residual:
    """Bound what the identified model of an aircraft misses, by counting flights: boxes of a tube.

    They are counted as a `band` is, from the same draws, and bound in place of recorded signals the
    rates of course and path angle (rad/s), roll and its change over a sample (rad), actual minus
    model.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, str or Path
        Flights as `flights` takes them, of an aircraft with an identified model.
    epsilon, confidence, flights, learn, gains, plant, air, seed, start_deg, changes : optional
        They have the meaning that they have for `band`.
    workers, scheduler, observer : optional
        They fly and watch as for `band`.

    Returns
    -------
    Residual
        The boxes for `tube`.

    Raises
    ------
    InputError, ScenarioError
        If `band` raises one, or an aircraft has no identified model.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10}
    >>> len(ft.residual("feasible", start_deg=2.0, **few).scores)
    29
    """
    stated = flights_of_source(source, changes=changes).starting(start_deg)
    plan, by = drawn(stated, plant, gains, air, seed), (workers, scheduler, observer)
    claim = {"epsilon": epsilon, "confidence": confidence, "flights": flights, "learn": learn}
    return counted_on(Residual, plan, place=stated.place, by=by, **claim)


def drawn(
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


def counted_on(
    kind: type[C],
    plan: Plan,
    *,
    place: str,
    epsilon: float,
    confidence: float,
    flights: int | None,
    learn: int,
    signals: Iterable[str] | None = None,
    predicted_from: Literal["wind"] | None = None,
    certain: Callable[[C], bool] | None = None,
    until_sure: bool = False,
    by: By,
) -> C:
    """A kind of count of the flights of a plan, of which the first are learned from.

    It ends before all are flown where the answer is `certain`.
    """
    check_at_least(MIN_LEARNED, learn=learn)
    plan = plan.with_runs(learn + fresh_flights(flights, epsilon, confidence))
    (group,), central = plan.groups, plan.campaign.central
    distribution = distribution_of(plan.campaign, group.plant)
    check_random(place, distribution, central)
    for key in {*TIME_AXIS} & {*plan.keys}:
        raise InputError(f"{place}: `{key}` must be the same in all flights of a band.")
    windy = predicted_from is not None
    if windy and not any(key.startswith("wind.") for key in distribution.dispersed):
        raise InputError(f"{place}: the wind must be drawn for `given` wind, got one wind.")
    models = models_of(_central_run(plan).signals) if kind.of == "monitor" else ()
    units = _units(plan, kind.of, signals, models)
    of = flights_of(plan, kind.of, len(units), plan.runs - learn)
    with WorkerPool(*by) as pool:
        pool.progress.budget = plan.runs
        models = models_taught(pool, plan, models, learn)
        probe = partial(_extremes, list(units), of.edges, windy, models or of.model)
        coefficients, half = _learned(pool, plan, probe, learn, kind.of, epsilon)
        about = About(
            of=kind.of,
            signals=units,
            coefficients=coefficients,
            half=half,
            predicted_from=predicted_from,
            plan=plan.as_dict(),
            learned=learn,
            epsilon=epsilon,
            confidence=confidence,
            until_sure=until_sure,
            models=models,
        )
        counted = kind(
            about=about,
            flights=of,
            extremes=np.zeros((0, *half.shape, 2), np.float32),
            wind=np.zeros((0, 2 * windy)),
        )
        numbers = range(LOOK, plan.runs, LOOK) if until_sure else (BATCH * DOUBLED).tolist()
        ends = [learn + n for n in numbers if certain and learn + n < plan.runs] + [plan.runs]
        for begin, end in pairwise([learn, *ends]):
            counted = counted.with_flights(
                *_flown(pool, plan, probe, range(begin, end), "counting")
            )
            if certain is not None and certain(counted):
                break
    endings = [x for x in pool.progress.endings if x["run"] >= learn]
    return replace(counted, endings=endings)


def _learned(
    pool: WorkerPool, plan: Plan, probe: Probe, learned: int, of: Of, epsilon: float
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and half-widths that follow from the first draws of a plan."""
    draws = range(learned // 2 if of == "monitor" else 0, learned)
    flights = _flown(pool, plan, partial(probe, anywhere=True), draws, "learning")
    try:
        coefficients, half = learned_shape(*flights, epsilon)
    except InputError as error:
        raise InputError(f"{error}{why_ended(pool.progress.endings)}") from error
    return coefficients, half * HEIGHT_ROOM if of == "turn_back" else half


def models_taught(
    pool: WorkerPool, plan: Plan, models: Sequence[SignalModel], learned: int
) -> tuple[SignalModel, ...]:
    """The models of a monitor with the weights of the first half of the flights learned from."""
    if not models:
        return ()
    probes = {"moments": partial(_moments, models)}
    rows = pool.in_order(plan, range(learned // 2), doing="learning", probes=probes)
    sizes = [len(model.terms) + 1 for model in models]
    cuts = np.cumsum([size * size for size in sizes])[:-1]
    flights = [np.split(np.array(row["moments"]), cuts) for row in rows if "moments" in row]
    if not flights:
        raise InputError(f"`learn` must have flights that are completed{why_ended(rows)}")
    squares = (
        [part.reshape(size, size) for part, size in zip(flight, sizes, strict=True)]
        for flight in flights
    )
    return taught(models, squares)


def _moments(models: Sequence[SignalModel], run: Run, _: Scenario) -> list[float]:
    return np.concatenate(
        [product.ravel() for product in moments(columns_of(models, run))]
    ).tolist()


def _central_run(plan: Plan) -> Run:
    return fly_group(plan, plan.campaign.central, plan.groups[0])


def _units(
    plan: Plan, of: Of, signals: Iterable[str] | None, models: Sequence[SignalModel]
) -> dict[str, str]:
    """Units of the signals of a kind, or of some recorded ones.

    These are by default the errors, or the distances from a route.
    """
    if of == "monitor":
        return units_of(models, SIGNAL_UNITS)
    if of is not None:
        return dict({"residual": RESIDUALS, "turn_back": ROOM}[of])
    run, default = _central_run(plan), OFF_ROUTE if plan.campaign.central.route else ERRORS
    names = list(dict.fromkeys(signals or default))
    for name in names:
        if name not in run.signals:
            recorded = ", ".join(map(str, run.signals.columns))
            raise InputError(f"`signal` must be one of {recorded}, got {name!r}.")
    return {name: run.units.get(name) or SIGNAL_UNITS.get(name, "") for name in names}


def flights_of(plan: Plan, of: Of, signals: int, flights: int) -> BandFlights:
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
    if of == "monitor":  # the largest of the whole flight
        edges = edges[[0, -1]]
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


def load_counted(path: str | Path) -> Counted:
    """Read a count; its windows, and the words for its flights, are those of its plan."""

    def of_plan(about: About) -> BandFlights:
        plan = plan_in(about)
        first = plan.runs - about.learned
        if not 1 <= first <= MAX_NUMBERS:
            raise InputError(f"`plan.runs` must be 1 to {MAX_NUMBERS} more than `learned`.")
        return flights_of(plan, about.of, len(about.signals), first)

    counted = read_counted(path, of_plan)
    if counted.about.until_sure and not counted.about.fences:
        raise InputError(f"{path}: `fences` must have the one that was counted until it was sure.")
    if len(counted.scores) < counted.first and not counted.decided:
        raise InputError(
            f"{path}: `plan.runs` must be the flights learned from and counted, "
            f"{counted.about.learned + len(counted.scores)}, where no answer was certain "
            f"before, got {counted.about.learned + counted.first}."
        )
    if counted.about.fences:
        check_one_path(plan_in(counted.about), counted.draws.tolist())
    return counted


def kept_band(source: object) -> Band | None:
    """The band itself or that in a file, None for another source; InputError for another count."""
    counted = source if isinstance(source, Band) else written(source, BAND)
    if not isinstance(counted, Band | None):
        raise InputError(
            f"{source}: must be the file of a band, got that of a {type(counted).__name__}."
        )
    return counted


def count_more(band: C, flights: int, pool: WorkerPool) -> C:
    """The count after `flights` draws of its campaign in all: an InputError refuses fewer."""
    counted = len(band.scores)
    most = MAX_NUMBERS // (2 * band.about.half.size)
    allowed = [n for n in (band.first * DOUBLED).tolist() if counted < n <= most]
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


def check_shape(band: Counted, pool: WorkerPool) -> None:
    """Fly the flights learned from again; an InputError refuses a shape that they do not give."""
    about, plan = band.about, plan_of(band)
    units = _units(plan, about.of, about.signals, about.models)
    if [*units.items()] != [*about.signals.items()]:
        raise InputError("`signals` must have the units of the flights.")
    epsilon, _ = about.planned or (about.epsilon, about.confidence)
    for model, again in zip(
        about.models, models_taught(pool, plan, about.models, about.learned), strict=True
    ):
        if not np.allclose(model.weights, again.weights, rtol=SAME_SHAPE, atol=0.0):
            raise InputError(f"`weights` of {model.name} must be those that its flights teach.")
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


def some_draws(band: Counted, flights: int) -> list[int]:
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


def differing(band: Counted, draws: Sequence[int], pool: WorkerPool) -> list[int]:
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
    model = about.models or flights.model
    return partial(_extremes, list(about.signals), flights.edges, windy, model)


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
    model: ConformantModel | tuple[SignalModel, ...] | None,
    run: Run,
    scenario: Scenario,
    *,
    anywhere: bool = False,
) -> list[float]:
    """Extremes of signals, or of residuals of a `model`, by window; then the wind at the start."""
    axis = axis_of(run)
    samples = np.searchsorted(axis, edges - SAME).clip(max=len(axis) - 1)
    samples[:-1] = samples[:-1].clip(max=len(axis) - 2)  # a window has a sample before its last
    if isinstance(model, tuple):
        flown = residuals(model, columns_of(model, run), dt_of(run))
    elif model is not None:
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
