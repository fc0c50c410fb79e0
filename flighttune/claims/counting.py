"""Counts of flights: a shape learned from some flights, its scale counted on others, and checks."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Literal, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, check_at_least
from flighttune.base.endings import why_ended
from flighttune.base.errors import InputError, keeping
from flighttune.base.files.load import BAND, written
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.knowing import knowing
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.source import Flights
from flighttune.claims import counted_flights
from flighttune.claims import shape as shapes
from flighttune.claims.about import About
from flighttune.claims.band import NO_FLIGHTS, Band
from flighttune.claims.counted import Counted, axis_of, wind_at_start
from flighttune.claims.ending import Ending
from flighttune.claims.known import NUMBERS, navigation_errors_of
from flighttune.claims.measured import SAME, Measured
from flighttune.claims.unfinished import Unfinished, written_at
from flighttune.flight.loop.run import Run
from flighttune.flight.metrics import OFF_ROUTE
from flighttune.flight.scenario.schema import Scenario

# Flights after those that decide a claim that JSBSim flies too. Within a tenth of the scale there
# are many, 126 of 750, and each takes as long as ten compiled ones.
NEXT = 2

# Number of flights flown together, whose numbers are there twice until they are in their places.
AT_A_TIME = 4096

# Numbers of flights that the refusal of another number lists.
SHOWN = 3

# Tolerance for the rounding of times and distances, s and m.
ROUNDING = 1e-9

C = TypeVar("C", bound=Counted)
F = TypeVar("F", bound=np.floating)

# Extremes, wind and navigation of some flights, as `Kept` has them.
Numbers: TypeAlias = tuple[shapes.Extremes, FloatArray, FloatArray]

# Extremes of a signal of a flight that is outside every band.
LOST = [-np.inf, np.inf]


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """Numbers that a worker keeps of a completed flight: extremes, wind, and navigation."""

    measured: Measured
    edges: FloatArray  # edges of the windows, s or m
    windy: bool  # whether the band uses the wind at the start
    navigated: bool = False  # whether flights along a route have errors of navigation
    anywhere: bool = False  # whether learning flights are exempt from `lost`

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the extremes: windows, signals, lowest and highest value."""
        return len(self.edges) - 1, len(self.measured.units), 2

    @property
    def lost(self) -> list[float]:
        """The numbers of a flight that was not completed."""
        others = 2 * self.windy + NUMBERS * self.navigated
        return LOST * (math.prod(self.shape) // 2) + [0.0] * others

    def parts(self, numbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Extremes, wind and navigation from the numbers of flights, shape (flights, numbers)."""
        ends = np.cumsum([math.prod(self.shape), 2 * self.windy])
        extremes, wind, navigation = np.split(numbers, ends, axis=1)
        return extremes.reshape(-1, *self.shape), wind, navigation

    def __call__(self, run: Run, scenario: Scenario) -> list[float]:
        """The numbers of a run."""
        axis = axis_of(run)
        samples = np.searchsorted(axis, self.edges - ROUNDING).clip(max=len(axis) - 1)
        # a window has at least one interval
        samples[:-1] = samples[:-1].clip(max=len(axis) - 2)
        flown = self.measured.values(run, scenario)
        values = np.ravel(shapes.window_extremes(flown, samples)).tolist()
        if not self.anywhere and self.measured.lost(run, scenario):
            values = LOST * (len(values) // 2)
        if self.windy:
            values = [*values, *wind_at_start(scenario)]
        if not (self.navigated and scenario.route):
            return values
        return [*values, *navigation_errors_of(run, scenario.route.look_ahead_s)]


def drawn(
    stated: Flights, plant: str | None = None, gains: str | None = None, air: str | None = None
) -> Plan:
    """Independent draws of one group, by default of the first aircraft, in one class of air."""
    plan = stated.plan(plant=plant, gains=gains, kind="jsbsim")
    labels = (table.label for table in plan.scenario.aircraft)
    group = plan.chosen_group(
        plant or next(labels, None), gains if gains in plan.gain_sets else None
    )
    campaign = counted_flights.at_random(
        plan.campaign if air is None else counted_flights.in_air(plan.campaign, air)
    )
    return replace(plan.of_group(group), campaign=campaign)


def counted_on(
    kind: type[C],
    plan: Plan,
    ending: Ending,
    *,
    place: str,
    learn: int,
    signals: Iterable[str] | None = None,
    predicted_from: Literal["wind"] | None = None,
    judged: Callable[[C], C] | None = None,
    unfinished: Unfinished | None = None,
    fliers: Fliers,
) -> C:
    """A count of the flights of a plan; it ends sooner if it is decided as `judged`."""
    check_at_least(kind.measures.min_learned, learn=learn)
    plan = plan.with_runs(learn + ending.flights)
    _check_flights(plan, place, windy=predicted_from is not None)
    measured = kind.measures.chosen(plan, signals)
    flights = counted_flights.flights_of(plan, measured, ending.flights)
    shape = len(flights.edges) - 1, len(measured.units)
    about = About(
        of=kind.of,
        signals=dict(measured.units),
        coefficients=np.zeros((1, *shape)),  # replaced once they are learned
        half=np.ones(shape),
        predicted_from=predicted_from,
        plan=plan.as_dict(),
        learned=learn,
        models=measured.models,
        **ending.stated,
    )
    with WorkerPool(fliers) as pool:
        pool.progress.budget = learn + ending.expected(0)
        measured = measured.taught(pool, plan, learn)
        kept = Kept(
            measured=measured,
            edges=flights.edges,
            windy=predicted_from is not None,
            navigated=flights.navigated,
        )
        coefficients, half = _learned(pool, plan, about, kept)
        learned = {"coefficients": coefficients, "half": half, "models": measured.models}
        counted = kind(
            about=replace(about, **learned),
            flights=replace(flights, measured=measured),
            extremes=np.zeros((0, *shape, 2), np.float32),
            wind=np.zeros((0, 2 * kept.windy)),
            navigation=np.zeros((0, NUMBERS * kept.navigated)),
        )
        counted = replace(counted, compiled=pool.progress.compiled)
        if kind.beside_rtk and ending.corridor:
            counted = replace(counted, by_rtk=_by_rtk(pool, plan, kept, learn))
        if unfinished is not None:
            counted = unfinished.begun(counted, pool.observer)
        with keeping(unfinished and unfinished.file):
            counted = _counted(counted, pool, partial(_flown, pool, plan, kept), judged, unfinished)
            _check_deciding(judged(counted) if judged else counted, pool)
    return replace(counted, compiled=pool.progress.compiled)


def _counted(
    counted: C,
    pool: WorkerPool,
    flown: Callable[[Sequence[int]], Numbers],
    judged: Callable[[C], C] | None,
    unfinished: Unfinished | None,
) -> C:
    """A count that goes on to its end, with the numbers of each run by `flown`."""
    ending, learned, begun = counted.ending, counted.about.learned, len(counted.scores)
    looks = ending.looks() if judged else []
    writes = written_at(ending.flights) if unfinished else []
    pool.progress.compiled, pool.progress.endings = counted.compiled, [*counted.endings]
    # All flights have their places from the beginning: arrays that are joined are there twice.
    places = (
        _with_places(counted.extremes, ending.flights),
        _with_places(counted.wind, ending.flights),
        _with_places(counted.navigation, ending.flights),
    )
    stops = sorted({*looks, *writes, ending.flights})
    for begin, end in pairwise([begun, *(n for n in stops if n > begun)]):
        pool.progress.budget = pool.progress.flown + ending.expected(begin) - begin
        for first in range(begin, end, AT_A_TIME):
            runs = range(learned + first, learned + min(first + AT_A_TIME, end))
            for array, more in zip(places, flown(runs), strict=True):
                array[first : first + len(runs)] = more
        extremes, wind, navigation = (array[:end] for array in places)
        counted = replace(
            counted,
            extremes=extremes,
            wind=wind,
            navigation=navigation,
            endings=sorted(pool.progress.endings, key=lambda x: x["run"]),
            compiled=pool.progress.compiled,
        )
        if judged is not None and end in looks and judged(counted).decided:
            break
        if unfinished is not None and end in writes:
            unfinished.write(counted)
    return counted


def _with_places(array: npt.NDArray[F], flights: int) -> npt.NDArray[F]:
    """An array with places for more flights; memory is taken only where numbers are written."""
    places = np.empty((flights, *array.shape[1:]), array.dtype)
    places[: len(array)] = array
    return places


def deciding(counted: Counted) -> list[int]:
    """Draws of the flights that decide a count, and of the next `NEXT` of each claim.

    A claim follows from the flights nearest to leaving, one more than may lie outside, as long as
    the others are farther inside: they set the scale, or are one too many.
    """
    decide = max(0, counted.allowed) + 1 + NEXT
    nearest = [np.argsort(-near, kind="stable")[:decide] for near in counted.nearness]
    return counted.draws[np.unique(nearest)].tolist()


def _check_deciding(counted: Counted, pool: WorkerPool) -> None:
    """Repeat in JSBSim what decides a count, where it is compiled.

    DifferenceError names the first signal that differs.
    """
    if len(counted.scores):
        pool.check_compiled(counted_flights.plan_of(counted), deciding(counted))


def _check_flights(plan: Plan, place: str, *, windy: bool) -> None:
    """Refuse flights that are all equal, differ in their samples, or share one wind."""
    (group,) = plan.groups
    distribution = counted_flights.distribution_of(plan.campaign, group.plant)
    counted_flights.check_random(place, distribution, plan.campaign.central)
    # The windows of a band contain the same samples in each flight.
    for key in {"flight.duration_s", "controller.rate_hz"} & {*plan.keys}:
        raise InputError(f"{place}: `{key}` must be the same in all flights of a band.")
    if windy and not any(key.startswith("wind.") for key in distribution.dispersed):
        raise InputError(f"{place}: the wind must be drawn for `given` wind, got one wind.")


def _learned(
    pool: WorkerPool, plan: Plan, about: About, kept: Kept
) -> tuple[FloatArray, FloatArray]:
    """Coefficients and half-widths learned from the first draws of a plan."""
    draws = range(kept.measured.teaching(about.learned), about.learned)
    flown = _flown(pool, plan, replace(kept, anywhere=True), draws, "learning")
    epsilon, _ = about.planned or (about.epsilon, about.confidence)
    try:
        coefficients, half = shapes.learned_shape(*flown[:2], epsilon)
    except InputError as error:
        raise InputError(f"{error}{why_ended(pool.progress.endings)}") from error
    return coefficients, half * kept.measured.room


def _by_rtk(pool: WorkerPool, plan: Plan, kept: Kept, flights: int) -> FloatArray:
    """Largest distances from the route of the first draws, flown by RTK: shape (flights, 2), m.

    None where another receiver has numbers of its own, or the place is known as well already.
    """
    table = plan.campaign.central.navigation if kept.navigated else None
    drawn = any(key.startswith("navigation.") for key in plan.keys)
    names = [*kept.measured.units]
    if table is None or table.grade == "rtk" or table.own_numbers or drawn:
        return NO_FLIGHTS
    if not {*OFF_ROUTE} <= {*names}:
        return NO_FLIGHTS
    columns = [names.index(name) for name in OFF_ROUTE]
    by_rtk = replace(plan, campaign=knowing(plan.campaign, "rtk"))
    compiled, pool.progress.budget = pool.progress.compiled, pool.progress.budget + flights
    extremes, *_ = _flown(pool, by_rtk, kept, range(flights), "flying by RTK")
    pool.progress.compiled = compiled
    largest = np.abs(extremes[:, :, columns]).max(axis=(1, 3)).astype(float)
    return largest[np.isfinite(largest).all(axis=1)]


def kept_band(source: object) -> Band | None:
    """A band or the band in a file; None for another source; InputError for another count."""
    counted = written(source, BAND) or source
    if isinstance(counted, Band):
        return counted
    if counted is source:
        return None
    raise InputError(
        f"{source}: must be the file of a band, got that of a {type(counted).__name__}."
    )


def count_more(band: C, flights: int, pool: WorkerPool) -> C:
    """The count continued to `flights` draws in total; InputError if it has more already."""
    counted, ending = len(band.scores), band.ending
    if flights == counted > ending.flights:  # the same command again
        pool.observer.hear(f"its {flights} flights are counted already: none is flown")
        return band
    most = shapes.MAX_NUMBERS // (2 * band.about.half.size)
    allowed = [n for n in ending.numbers.tolist() if counted < n <= most]
    if flights not in allowed:
        raise InputError(
            f"`flights` must be one of the numbers fixed when the count was planned, "
            f"{', '.join(map(str, allowed[:SHOWN]))} ..., got {flights}: a number chosen after "
            "looking at a count would make its confidence false."
        )
    runs = band.draws_of(flights)[counted:].tolist()
    plan = counted_flights.plan_of(band).with_runs(runs[-1] + 1)
    more = _flown(pool, plan, kept_of(band), runs)
    grown = band.with_flights(*more, pool.progress.endings)
    _check_deciding(grown, pool)
    return replace(grown, compiled=grown.compiled + pool.progress.compiled)


def kept_of(band: Counted) -> Kept:
    """The numbers to keep from the flights of a count."""
    return Kept(
        measured=band.measured,
        edges=band.flights.edges,
        windy=band.about.predicted_from is not None,
        navigated=bool(band.navigation.shape[1]),
    )


def check_shape(band: Counted, pool: WorkerPool) -> None:
    """Repeat the learning flights; InputError if they give another shape."""
    about, plan, kept = band.about, counted_flights.plan_of(band), kept_of(band)
    measured = about.kind.measures.of(about, plan.scenario, plan.groups[0].plant)
    measured.check(pool, plan, about.learned)
    coefficients, half = _learned(pool, plan, about, kept)
    moved = shapes.predicted(band.wind, coefficients - about.coefficients)
    for name, off in (("half", half - about.half), ("coefficients", moved)):
        if not (np.abs(off) <= SAME * half).all():
            raise InputError(
                f"`{name}` must follow from the {about.learned} flights learned from, which were "
                "flown again and give others; count the band again if it was read at another "
                "`epsilon` by flighttune 0.3.0."
            )


def some_draws(band: Counted, flights: int) -> list[int]:
    """Random counted draws, and some of the draws that repeat another draw to the bit."""
    counted = len(band.scores)
    if not 1 <= flights <= counted:
        raise InputError(f"`count` must be 1 to the {counted} counted, got {flights}.")
    # Flights that are equal to the bit may be copies, so the same number of them is chosen too.
    rng, rows = np.random.default_rng(), band.extremes.reshape(counted, -1)
    _, first = np.unique(rows, axis=0, return_index=True)
    kinds = np.arange(counted), np.setdiff1d(np.flatnonzero(np.isfinite(band.scores)), first)
    some = [rng.choice(kind, min(flights, len(kind)), replace=False) for kind in kinds]
    return band.draws[np.unique(np.concatenate(some))].tolist()


def differing(band: Counted, draws: Sequence[int], pool: WorkerPool) -> list[int]:
    """The counted draws, in rising order, whose repetition differs in any bit."""
    chosen = np.searchsorted(band.draws, draws)
    plan = counted_flights.plan_of(band)
    again, *others = _flown(pool, plan, kept_of(band), draws, "counting again")
    differ = (again != band.extremes[chosen]).any(axis=(1, 2, 3))
    for other, counted in zip(others, (band.wind, band.navigation), strict=True):
        differ |= (other != counted[chosen]).any(axis=1) & np.isfinite(band.scores[chosen])
    return [draw for draw, other in zip(draws, differ, strict=True) if other]


def score(kept: Kept, about: About, run: Run, scenario: Scenario) -> float:
    """Smallest scale at which a flight is inside a band."""
    extremes, wind, _ = kept.parts(np.array([kept(run, scenario)]))
    return float(shapes.scores_of(extremes, wind, about.coefficients, about.half)[0])


def _flown(
    pool: WorkerPool, plan: Plan, kept: Kept, runs: Sequence[int], doing: str = "counting"
) -> Numbers:
    """The numbers of some runs, in rising order of these."""
    lost = kept.parts(np.array([kept.lost]))
    extremes = np.repeat(lost[0].astype(np.float32), len(runs), axis=0)
    wind, navigation = (np.repeat(x, len(runs), axis=0) for x in lost[1:])
    places = {run: place for place, run in enumerate(sorted(runs))}
    # A row is not kept, as its numbers take ten times as much memory as in these arrays.
    for row in pool.rows(plan, runs, doing=doing, probes={"extremes": kept}):
        values = kept.parts(np.array([row.get("extremes", kept.lost)]))
        for array, (value,) in zip((extremes, wind, navigation), values, strict=True):
            array[places[row["run"]]] = value
    return extremes, wind, navigation
