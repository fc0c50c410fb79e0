"""Bands of campaigns: a shape learned from some flights, and its scale counted on fresh ones."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, check_at_least
from flighttune.campaign.counted_flights import at_random, check_random, distribution_of, in_air
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.engine.progress import CampaignObserver
from flighttune.campaign.flying.alone import fly_group
from flighttune.campaign.planning.load import campaign_on
from flighttune.campaign.planning.plan import Plan, aircraft_hashes, plan_from
from flighttune.campaign.stated_set import planned
from flighttune.claims.band import (
    DOUBLED,
    About,
    Band,
    BandFlights,
    Over,
    axis_of,
    read_band,
    wind_at_start,
)
from flighttune.claims.count import flights_needed, fresh_flights
from flighttune.claims.shape import (
    MAX_NUMBERS,
    MAX_RESIDUAL_WINDOWS,
    MAX_WINDOWS,
    MIN_LEARNED,
    PART,
    Extremes,
    learned_shape,
    scores_of,
    window_edges,
    window_extremes,
)
from flighttune.errors import InputError
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.flight.route import is_mission
from flighttune.gaps.residual import RESIDUALS, ConformantModel, conformant_model, residuals_of
from flighttune.metrics import OFF_ROUTE
from flighttune.present.names import listed
from flighttune.references.follow import SAME_PLACE, RouteReference
from flighttune.scenario.schema import Scenario
from flighttune.simulate.bounds import ERRORS
from flighttune.simulate.run import SIGNAL_UNITS, Run

# Epsilon, confidence and flights to learn from by default, and for a mission, whose answer takes a
# minute on two cores; and of its flights those that may be outside.
CLAIM, MISSION, MISSION_OUTSIDE = (0.01, 0.999, 500), (0.05, 0.95, 15), 1

# Numbers of flights named in the refusal of another one.
SHOWN = 3

# Rounding of times and distances, s and m.
SAME = 1e-9

# Keeps of a completed flight what is counted of it.
Probe: TypeAlias = partial[list[float]]

# Extremes of a signal of a flight that is outside of any band.
LOST = [-np.inf, np.inf]

# Keys that must be the same in all flights: the windows of a band are the same samples in each.
TIME_AXIS = ("flight.duration_s", "controller.rate_hz")


def band(  # noqa: PLR0913 - each is a choice of the user, and has a default
    source: str | Path,
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
    source : str or Path
        Folder of a campaign, campaign or scenario file, or the name of a shipped one; or a mission.
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
        a mission with one (93).
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
    source = str(source)
    mission = is_mission(source)
    default_epsilon, default_confidence, default_learn = MISSION if mission else CLAIM
    epsilon = default_epsilon if epsilon is None else epsilon
    confidence = default_confidence if confidence is None else confidence
    learn = default_learn if learn is None else learn
    check_at_least(MIN_LEARNED, learn=learn)
    if mission and flights is None:
        flights = flights_needed(epsilon, confidence, MISSION_OUTSIDE)
    flights = fresh_flights(flights, epsilon, confidence)
    if of and (signals or predicted_from):
        raise InputError("`signals` and `given` must be absent for residual signals.")
    plan = planned(
        source,
        plant=plant,
        kind="jsbsim",
        gains=gains,
        start_deg=start_deg,
        changes=changes,
        aircraft=aircraft,
        like=like,
        skip=skip,
    )
    labels = (table.label for table in plan.scenario.aircraft)
    plant = plant or next(labels, None)
    group = plan.chosen_group(plant, gains if gains in plan.gain_sets else None)
    campaign = at_random(plan.campaign if air is None else in_air(plan.campaign, air))
    if seed is not None:
        campaign = campaign.model_copy(update={"seed": seed})
    plan = replace(plan.of_group(group), campaign=campaign, runs=learn + flights)
    distribution, central = distribution_of(campaign, group.plant), campaign.central
    check_random(source, distribution, central)
    for key in {*TIME_AXIS} & {*plan.keys}:
        raise InputError(f"{source}: `{key}` must be the same in all flights of a band.")
    if predicted_from and not any(key.startswith("wind.") for key in distribution.dispersed):
        raise InputError(f"{source}: the wind must be drawn for `given` wind, got one wind.")
    units = dict(RESIDUALS) if of else _recorded(plan, central, signals)
    counted = flights_of(plan, of, len(units), flights)
    probe = partial(
        _extremes, list(units), counted.edges, predicted_from is not None, counted.model
    )
    with WorkerPool(workers, scheduler, observer) as pool:
        learned = _flown(pool, plan, partial(probe, anywhere=True), range(learn), "learning")
        coefficients, half = learned_shape(*learned, epsilon)
        extremes, wind = _flown(pool, plan, probe, range(learn, plan.runs), "counting")
    about = About(
        of=of,
        signals=units,
        coefficients=coefficients,
        half=half,
        predicted_from=predicted_from,
        plan=plan.as_dict(),
        learned=learn,
        epsilon=epsilon,
        confidence=confidence,
    )
    return Band(about=about, flights=counted, extremes=extremes, wind=wind)


def _recorded(plan: Plan, central: Scenario, signals: Iterable[str] | None) -> dict[str, str]:
    """Units of some recorded signals; by default of the errors, or the distances from a route."""
    run, default = fly_group(plan, central, plan.groups[0]), OFF_ROUTE if central.route else ERRORS
    names = list(dict.fromkeys(signals or default))
    for name in names:
        if name not in run.signals:
            recorded = ", ".join(map(str, run.signals.columns))
            raise InputError(f"`signal` must be one of {recorded}, got {name!r}.")
    return {name: run.units.get(name) or SIGNAL_UNITS.get(name, "") for name in names}


def flights_of(
    plan: Plan, of: Literal["residual"] | None, signals: int, flights: int
) -> BandFlights:
    """The flights of a plan, of which so many are counted first, in windows of so many signals."""
    (group,), central = plan.groups, plan.campaign.central
    over: Over = "time"
    length, per_unit = central.flight.duration_s, central.controller.rate_hz
    if of:
        central.check_over_time("a band of residual signals")
    most = MAX_RESIDUAL_WINDOWS if of else MAX_WINDOWS
    followed, gains = reference_of(central), plan.gain_sets[group.gains]
    assert gains is not None  # of the group that was chosen
    if isinstance(followed, RouteReference):
        over, length, per_unit = "along", math.ceil(followed.path.length), 1.0
    return BandFlights(
        over=over,
        edges=window_edges(round(length * per_unit) + 1, flights, signals, most=most) / per_unit,
        distribution=distribution_of(plan.campaign, group.plant),
        scenario=plan.scenario,
        plant=group.plant,
        gains_name=group.gains,
        gains=gains,
        aircraft=plan.aircraft,
        model=conformant_model(plan.scenario, group.plant) if of else None,
    )


def load_band(path: str | Path) -> Band:
    """Read a band; its windows, and the words for its flights, are those of its plan."""

    def of_plan(about: About) -> BandFlights:
        plan = _plan(about)
        first = plan.runs - about.learned
        check_at_least(1, runs=first)
        return flights_of(plan, about.of, len(about.signals), first)

    return read_band(path, of_plan)


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
    return band.with_flights(
        *_flown(pool, plan, _probe(band.about, band.flights), runs, "counting")
    )


def recount(band: Band, flights: int, pool: WorkerPool) -> list[int]:
    """Fly some of the counted draws again, as `some_draws` chooses; those that differ by a bit."""
    return differing(band, some_draws(band, flights), pool)


def some_draws(band: Band, flights: int) -> list[int]:
    """Some of the counted draws at random, and some of those that repeat another to the bit."""
    counted = len(band.scores)
    if not 1 <= flights <= counted:
        raise InputError(f"`recount` must be 1 to the {counted} counted, got {flights}.")
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


def plan_of(band: Band) -> Plan:
    """The plan of a band; InputError if the files of an aircraft have changed since."""
    plan = _plan(band.about)
    if plan.aircraft != aircraft_hashes(plan.scenario):
        raise InputError(
            f"`{listed(list(plan.aircraft))}` must have the files that the band was flown with, "
            "got changed ones."
        )
    return plan.with_runs(int(band.draws[-1]) + 1)


def _plan(about: About) -> Plan:
    """The plan in the file of a band; its scenario at the median is computed again."""
    try:
        plan = plan_from(about.plan, "`plan`")
        campaign = campaign_on(plan.campaign, plan.scenario, "`plan`")
        (group,) = plan.groups
        plan.chosen_group(group.plant, group.gains)  # refuses gains that are not there
    except InputError:
        raise
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        raise InputError("`plan` must be that of a campaign.") from error
    return replace(plan, campaign=campaign)


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
    flown = (
        run.signals[signals].to_numpy()
        if model is None
        else residuals_of(model, run, start_condition(scenario))  # from each sample to the next
    )
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
