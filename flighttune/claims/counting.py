"""Counts of flights: a shape learned from some, its scale counted on fresh ones, and checks."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeAlias, TypeVar

import numpy as np

from flighttune.base.arrays import FloatArray, check_at_least
from flighttune.base.endings import why_ended
from flighttune.base.errors import InputError
from flighttune.base.files.load import BAND, written
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.engine.progress import CampaignObserver
from flighttune.campaigns.flying.rows import fly_group
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.source import Flights
from flighttune.campaigns.statistics.count import LOOK, fresh_flights
from flighttune.claims import counted as counts
from flighttune.claims import counted_flights
from flighttune.claims import shape as shapes
from flighttune.claims.band import ROOM, Band, read_counted
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.flight.loop.run import ERRORS, SIGNAL_UNITS, Run, given_way
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps import watch
from flighttune.gaps.residual import RESIDUALS, ConformantModel, conformant_model, residuals_of
from flighttune.routes.follow import SAME_PLACE, RouteReference

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

# Signals of the kinds of counts that are not recorded, with their units.
OWN_SIGNALS: Mapping[counts.Of, dict[str, str]] = {"residual": {**RESIDUALS}, "turn_back": ROOM}

# A function that keeps the numbers of a completed flight that are counted.
Probe: TypeAlias = partial[list[float]]

C = TypeVar("C", bound=counts.Counted)

# Workers, or the address of a scheduler that has them, and who watches them.
By: TypeAlias = tuple[int | None, str | None, CampaignObserver | None]

# Extremes of a signal of a flight that is outside of any band.
LOST = [-np.inf, np.inf]


def drawn(
    stated: Flights, plant: str | None, gains: str | None, air: str | None, seed: int | None
) -> Plan:
    """Independent draws of one group of flights, by default of the first aircraft, in an air."""
    plan = stated.plan(plant=plant, gains=gains, kind="jsbsim")
    labels = (table.label for table in plan.scenario.aircraft)
    group = plan.chosen_group(
        plant or next(labels, None), gains if gains in plan.gain_sets else None
    )
    campaign = counted_flights.at_random(
        plan.campaign if air is None else counted_flights.in_air(plan.campaign, air)
    )
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
    flights: int | tuple[int, int] | None,
    learn: int,
    signals: Iterable[str] | None = None,
    predicted_from: Literal["wind"] | None = None,
    certain: Callable[[C], bool] | None = None,
    until_sure: bool = False,
    by: By,
) -> C:
    """A kind of count of the flights of a plan; it ends sooner where the answer is `certain`."""
    # Half of the flights that a monitor learns from teach its weights, the others its limits.
    check_at_least(
        2 * shapes.MIN_LEARNED if kind.of == "monitor" else shapes.MIN_LEARNED, learn=learn
    )
    early, flights = flights if isinstance(flights, tuple) else (0, flights)
    plan = plan.with_runs(learn + fresh_flights(flights, epsilon, confidence))
    (group,) = plan.groups
    windy = predicted_from is not None
    distribution = counted_flights.distribution_of(plan.campaign, group.plant)
    counted_flights.check_random(place, distribution, plan.campaign.central)
    # The windows of a band are the same samples in each flight.
    for key in {"flight.duration_s", "controller.rate_hz"} & {*plan.keys}:
        raise InputError(f"{place}: `{key}` must be the same in all flights of a band.")
    if windy and not any(key.startswith("wind.") for key in distribution.dispersed):
        raise InputError(f"{place}: the wind must be drawn for `given` wind, got one wind.")
    units, models = _signals(plan, kind.of, signals)
    of = flights_of(plan, kind.of, len(units), plan.runs - learn)
    shape = len(of.edges) - 1, len(units)
    about = counts.About(
        of=kind.of,
        signals=units,
        coefficients=np.zeros((1, *shape)),  # until they are learned
        half=np.ones(shape),
        predicted_from=predicted_from,
        plan=plan.as_dict(),
        learned=learn,
        epsilon=epsilon,
        confidence=confidence,
        until_sure=until_sure,
        early=early,
        models=models,
    )
    with WorkerPool(*by) as pool:
        pool.progress.budget = learn + early if early else plan.runs
        about = replace(about, models=_taught(pool, plan, about))
        coefficients, half = _learned(pool, plan, about, of)
        counted = kind(
            about=replace(about, coefficients=coefficients, half=half),
            flights=of,
            extremes=np.zeros((0, *shape, 2), np.float32),
            wind=np.zeros((0, 2 if windy else 0)),
        )
        numbers = range(LOOK, plan.runs, LOOK) if until_sure else (BATCH * counts.DOUBLED).tolist()
        judged = sorted({*numbers, early} - {0}) if certain else []
        ends = [learn + n for n in judged if learn + n < plan.runs] + [plan.runs]
        for begin, end in pairwise([learn, *ends]):
            counted = counted.with_flights(*_flown(pool, plan, about, of, range(begin, end)))
            if certain is not None and certain(counted):
                break
            if end == learn + early:
                pool.progress.budget = plan.runs
    return replace(counted, endings=[x for x in pool.progress.endings if x["run"] >= learn])


def _learned(
    pool: WorkerPool, plan: Plan, about: counts.About, flights: counts.BandFlights
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and half-widths that follow from the first draws of a plan."""
    draws = range(about.learned // 2 if about.models else 0, about.learned)
    kept = _flown(pool, plan, about, flights, draws, "learning", anywhere=True)
    epsilon, _ = about.planned or (about.epsilon, about.confidence)
    try:
        coefficients, half = shapes.learned_shape(*kept, epsilon)
    except InputError as error:
        raise InputError(f"{error}{why_ended(pool.progress.endings)}") from error
    room = HEIGHT_ROOM if about.of == "turn_back" else [x.room for x in about.models] or 1.0
    return coefficients, half * room


def _taught(pool: WorkerPool, plan: Plan, about: counts.About) -> tuple[watch.SignalModel, ...]:
    """The models of a monitor with the weights of the first half of the flights learned from."""
    models = about.models
    if not models:
        return ()
    probes = {"moments": partial(_moments, models)}
    rows = pool.in_order(plan, range(about.learned // 2), doing="learning", probes=probes)
    sizes = [len(model.terms) + 1 for model in models]
    cuts = np.cumsum([size * size for size in sizes])[:-1]
    flights = [np.split(np.array(row["moments"]), cuts) for row in rows if "moments" in row]
    if not flights:
        raise InputError(f"`learn` must have flights that are completed{why_ended(rows)}")
    squares = (
        [part.reshape(size, size) for part, size in zip(flight, sizes, strict=True)]
        for flight in flights
    )
    return watch.taught(models, squares)


def _moments(models: Sequence[watch.SignalModel], run: Run, _: Scenario) -> list[float]:
    return np.concatenate(
        [x.ravel() for x in watch.moments(watch.columns_of(models, run))]
    ).tolist()


def _signals(
    plan: Plan, of: counts.Of, chosen: Iterable[str] | None
) -> tuple[dict[str, str], tuple[watch.SignalModel, ...]]:
    """Units of the signals of a kind, or of some recorded ones, and the models of a monitor."""
    if of in OWN_SIGNALS:
        return dict(OWN_SIGNALS[of]), ()
    if of is None and not chosen:  # all runs have them, so that no flight need say it
        names = OFF_ROUTE if plan.campaign.central.route else ERRORS
        return {name: SIGNAL_UNITS[name] for name in names}, ()
    run = fly_group(plan, plan.campaign.central, plan.groups[0])
    if of == "monitor":
        models = watch.models_of(run.signals)
        return watch.units_of(models, SIGNAL_UNITS), models
    names = dict.fromkeys(chosen or ())
    for name in names:
        if name not in run.signals:
            if run.reason and not len(run.signals):
                why = run.reason.removesuffix(".")
                raise InputError(f"The flight at the median of what is drawn must start: {why}.")
            recorded = ", ".join(map(str, run.signals.columns))
            raise InputError(f"`signal` must be one of {recorded}, got {name!r}.")
    return {name: run.units.get(name) or SIGNAL_UNITS.get(name, "") for name in names}, ()


def flights_of(plan: Plan, of: counts.Of, signals: int, flights: int) -> counts.BandFlights:
    """The flights of a plan, of which so many are counted first, in windows of so many signals."""
    (group,), central = plan.groups, plan.campaign.central
    over: counts.Over = "time"
    length, per_unit = central.flight.duration_s, central.controller.rate_hz
    if of == "residual":
        central.check_over_time("a band of residual signals")
    most = shapes.MAX_RESIDUAL_WINDOWS if of == "residual" else shapes.MAX_WINDOWS
    followed, gains = reference_of(central), plan.gain_sets[group.gains]
    assert gains is not None  # of the group that was chosen
    if isinstance(followed, RouteReference):
        over, length, per_unit = "along", math.ceil(followed.path.length), 1.0
    edges = shapes.window_edges(round(length * per_unit) + 1, flights, signals, most=most)
    if of == "turn_back":  # the largest after detection
        assert central.turn_back is not None  # its signals are of such flights
        edges = np.array([math.ceil(central.turn_back.detected_s * per_unit), edges[-1]])
    if of == "monitor":  # the largest of the whole flight
        edges = edges[[0, -1]]
    return counts.BandFlights(
        over=over,
        edges=edges / per_unit,
        distribution=counted_flights.distribution_of(plan.campaign, group.plant),
        scenario=plan.scenario,
        central=central,
        plant=group.plant,
        gains_name=group.gains,
        gains=gains,
        aircraft=plan.aircraft,
        model=conformant_model(plan.scenario, group.plant) if of == "residual" else None,
    )


def load_counted(path: str | Path) -> counts.Counted:
    """Read a count; its windows, and the words for its flights, are those of its plan."""

    def of_plan(about: counts.About) -> counts.BandFlights:
        plan = counted_flights.plan_in(about)
        first = plan.runs - about.learned
        if not 1 <= first <= shapes.MAX_NUMBERS:
            raise InputError(f"`plan.runs` must be 1 to {shapes.MAX_NUMBERS} more than `learned`.")
        return flights_of(plan, about.of, len(about.signals), first)

    counted = read_counted(path, of_plan)
    if counted.about.until_sure and not counted.about.fences:
        raise InputError(f"{path}: `fences` must have the one that was counted until it was sure.")
    flights, first = len(counted.scores), counted.first
    if flights < first and flights != counted.about.early and not counted.decided:
        raise InputError(
            f"{path}: `plan.runs` must be the flights learned from and counted, "
            f"{counted.about.learned + flights}, where no answer was certain before, got "
            f"{counted.about.learned + first}."
        )
    if counted.about.fences:
        counted_flights.check_one_path(
            counted_flights.plan_in(counted.about), counted.draws.tolist()
        )
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
    if flights == counted > band.first:  # the same command again
        pool.observer.hear(f"its {flights} flights are counted already: none is flown")
        return band
    most = shapes.MAX_NUMBERS // (2 * band.about.half.size)
    allowed = [n for n in (band.first * counts.DOUBLED).tolist() if counted < n <= most]
    if flights not in allowed:
        raise InputError(
            f"`flights` must be one of the numbers fixed when the count was planned, "
            f"{', '.join(map(str, allowed[:SHOWN]))} ..., got {flights}: a number chosen after "
            "looking at a count would make its confidence false."
        )
    runs = band.draws_of(flights)[counted:].tolist()
    plan = counted_flights.plan_of(band).with_runs(runs[-1] + 1)
    more = _flown(pool, plan, band.about, band.flights, runs)
    return band.with_flights(*more, pool.progress.endings)


def check_shape(band: counts.Counted, pool: WorkerPool) -> None:
    """Fly the flights learned from again; an InputError refuses a shape that they do not give."""
    about, plan = band.about, counted_flights.plan_of(band)
    models = about.models
    units = (
        watch.units_of(models, SIGNAL_UNITS)
        if models
        else _signals(plan, about.of, about.signals)[0]
    )
    if [*units.items()] != [*about.signals.items()]:
        raise InputError("`signals` must have the units of the flights.")
    for model, again in zip(models, _taught(pool, plan, about), strict=True):
        if not np.allclose(model.weights, again.weights, rtol=SAME_SHAPE, atol=0.0):
            raise InputError(f"`weights` of {model.name} must be those that its flights teach.")
    coefficients, half = _learned(pool, plan, about, band.flights)
    moved = shapes.predicted(band.wind, coefficients - about.coefficients)
    for name, off in (("half", half - about.half), ("coefficients", moved)):
        if not (np.abs(off) <= SAME_SHAPE * half).all():
            raise InputError(
                f"`{name}` must follow from the {about.learned} flights learned from, which were "
                "flown again and give others; count the band again if it was read at another "
                "`epsilon` by flighttune 0.3.0."
            )


def some_draws(band: counts.Counted, flights: int) -> list[int]:
    """Some of the counted draws at random, and some of those that repeat another to the bit."""
    counted = len(band.scores)
    if not 1 <= flights <= counted:
        raise InputError(f"`count` must be 1 to the {counted} counted, got {flights}.")
    # Flights that are equal to the bit may be copies: so many of those are chosen too.
    rng, rows = np.random.default_rng(), band.extremes.reshape(counted, -1)
    _, first = np.unique(rows, axis=0, return_index=True)
    kinds = np.arange(counted), np.setdiff1d(np.flatnonzero(np.isfinite(band.scores)), first)
    some = [rng.choice(kind, min(flights, len(kind)), replace=False) for kind in kinds]
    return band.draws[np.unique(np.concatenate(some))].tolist()


def differing(band: counts.Counted, draws: Sequence[int], pool: WorkerPool) -> list[int]:
    """The counted draws, in rising order, that differ by a bit when they are flown again."""
    chosen = np.searchsorted(band.draws, draws)
    again, wind = _flown(
        pool, counted_flights.plan_of(band), band.about, band.flights, draws, "counting again"
    )
    differ = (again != band.extremes[chosen]).any(axis=(1, 2, 3))
    differ |= (wind != band.wind[chosen]).any(axis=1) & np.isfinite(band.scores[chosen])
    return [draw for draw, other in zip(draws, differ, strict=True) if other]


def score(about: counts.About, flights: counts.BandFlights, run: Run, scenario: Scenario) -> float:
    """Scale at which a flight is just inside a band."""
    shape = (1, *about.half.shape, 2)
    extremes, wind = np.split(np.array(_probe(about, flights)(run, scenario)), [math.prod(shape)])
    return float(
        shapes.scores_of(extremes.reshape(shape), wind[None], about.coefficients, about.half)[0]
    )


def _probe(about: counts.About, flights: counts.BandFlights, anywhere: bool = False) -> Probe:
    """The function that keeps the extremes of each flight, `anywhere` or only at its places."""
    windy = about.predicted_from is not None
    model = about.models or flights.model
    return partial(_extremes, list(about.signals), flights.edges, windy, model, anywhere)


def _flown(
    pool: WorkerPool,
    plan: Plan,
    about: counts.About,
    flights: counts.BandFlights,
    runs: Sequence[int],
    doing: str = "counting",
    *,
    anywhere: bool = False,
) -> tuple[shapes.Extremes, FloatArray]:
    """Extremes of some runs, and their wind where the band is given it."""
    shape, probes = (*about.half.shape, 2), {"extremes": _probe(about, flights, anywhere)}
    lost = LOST * about.half.size
    if about.predicted_from is not None:
        lost += [0.0, 0.0]
    extremes, winds = [], []
    parts = range(0, len(runs), shapes.PART)
    for number, first in enumerate(parts, 1):
        phase = f"{doing}{f', part {number} of {len(parts)}' if len(parts) > 1 else ''}"
        rows = pool.in_order(plan, runs[first : first + shapes.PART], doing=phase, probes=probes)
        values = np.array([row.get("extremes", lost) for row in rows])
        extremes.append(values[:, : math.prod(shape)].astype(np.float32).reshape(-1, *shape))
        winds.append(values[:, math.prod(shape) :])
    return np.concatenate(extremes), np.concatenate(winds)


def _extremes(
    signals: list[str],
    edges: FloatArray,
    windy: bool,
    model: ConformantModel | tuple[watch.SignalModel, ...] | None,
    anywhere: bool,
    run: Run,
    scenario: Scenario,
) -> list[float]:
    """Extremes of signals, or of residuals of a `model`, by window; then the wind at the start."""
    axis = counts.axis_of(run)
    samples = np.searchsorted(axis, edges - SAME).clip(max=len(axis) - 1)
    samples[:-1] = samples[:-1].clip(max=len(axis) - 2)  # a window has a sample before its last
    if isinstance(model, tuple):
        flown = watch.residuals(model, watch.columns_of(model, run), watch.dt_of(run))
    elif model is not None:
        flown = residuals_of(model, run, start_condition(scenario))  # from each sample to the next
    elif scenario.turn_back is not None and [*ROOM] == signals:
        begun = scenario_of(run).turn_back  # it may have begun in level flight
        assert begun is not None  # as the scenario that it was drawn in
        flown = counted_flights.room_of(run, begun)
    else:
        flown = run.signals[signals].to_numpy()
    values = np.ravel(shapes.window_extremes(flown, samples)).tolist()
    route = reference_of(scenario)
    moved = route.displacement(run.signals) if isinstance(route, RouteReference) else 0.0
    # The distances along and off the route are wrong for a flight that is behind its start or blown
    # back. The conformant model knows no airspeed, so that a path angle that gives way is outside
    # it. Both count as outside any band. Flights that only teach the shape are exempt.
    elsewhere = bool({*OFF_ROUTE} & {*signals}) and moved > SAME_PLACE
    unlike = isinstance(model, ConformantModel) and given_way(run).any()
    if not anywhere and (elsewhere or unlike):
        values = LOST * (len(values) // 2)
    return [*values, *counts.wind_at_start(scenario)] if windy else values
