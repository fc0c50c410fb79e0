"""Bands of campaigns: a shape learned from some flights, and its scale counted on fresh ones."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray, check_at_least
from flighttune.campaign.conform import at_random, check_random, distribution_of
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.flying.alone import fly_group
from flighttune.campaign.planning.load import campaign_on
from flighttune.campaign.planning.plan import TUNING_ROUNDING, Plan, aircraft_hashes, plan_from
from flighttune.campaign.stated_set import planned
from flighttune.claims.band import (
    DOUBLED,
    MAX_NUMBERS,
    MIN_LEARNED,
    PART,
    About,
    Axis,
    Band,
    Extremes,
    learned_shape,
    read_band,
    scores_of,
    window_edges,
    window_extremes,
)
from flighttune.claims.count import fresh_flights
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.flight.conditions import reference_of
from flighttune.metrics import OFF_ROUTE
from flighttune.present.names import listed
from flighttune.references.follow import SAME_PLACE, RouteReference
from flighttune.scenario.places import leaves
from flighttune.scenario.schema import Scenario
from flighttune.simulate.bounds import ERRORS
from flighttune.simulate.run import SIGNAL_UNITS, Run, along_route

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

# Tables of a scenario that a run must share with the flights of a band drawn around it.
SHARED = ("flight", "reference", "route", "law", "limits", "controller", "sensors")


def count_band(
    source: str,
    pool: WorkerPool,
    *,
    signals: Iterable[str] | None = None,
    epsilon: float = 0.01,
    confidence: float = 0.999,
    flights: int | None = None,
    learn: int = 500,
    predicted_from: Literal["wind"] | None = None,
    gains: str | None = None,
    plant: str | None = None,
    seed: int | None = None,
    **about_scenario: Any,
) -> Band:
    """Learn the shape of a band from flights of a campaign or scenario, and count fresh ones.

    Draws are random and independent, whatever the design of the campaign; those counted come after
    those learned from. `source`, `gains`, `plant`, `start_deg` and `changes` are as for `planned`;
    `seed` replaces that of the campaign. The plant is by default the first aircraft, or the first
    plant if there is none. Raises InputError if the claim needs more `flights`, a
    signal is not recorded, or nothing is random. Raises StoppedError if the observer stopped it.
    """
    check_at_least(MIN_LEARNED, learn=learn)
    flights = fresh_flights(flights, epsilon, confidence)
    plan = planned(source, plant=plant, kind="jsbsim", gains=gains, **about_scenario)
    aircraft = (table.label for table in plan.scenario.plant if table.aircraft is not None)
    plant = plant or next(aircraft, None)
    group = plan.chosen_group(plant, gains if gains in plan.gain_sets else None)
    campaign = at_random(plan.campaign)
    if seed is not None:
        campaign = campaign.model_copy(update={"seed": seed})
    plan = replace(plan.of_group(group), campaign=campaign, runs=learn + flights)
    distribution, central = distribution_of(campaign, group.plant), campaign.central
    check_random(source, distribution, central)
    for key in {*TIME_AXIS} & {*plan.keys}:
        raise InputError(f"{source}: `{key}` must be the same in all flights of a band.")
    if predicted_from and not any(key.startswith("wind.") for key in distribution.dispersed):
        raise InputError(f"{source}: the wind must be drawn for `given` wind, got one wind.")
    run, default = fly_group(plan, central, group), OFF_ROUTE if central.route else ERRORS
    signals = list(dict.fromkeys(signals or default))
    for name in signals:
        if name not in run.signals:
            recorded = ", ".join(map(str, run.signals.columns))
            raise InputError(f"`signal` must be one of {recorded}, got {name!r}.")
    axis = _axis_of(plan, len(signals), flights)
    probe = partial(_extremes, signals, axis.edges, predicted_from is not None)
    learned = _flown(pool, plan, partial(probe, anywhere=True), range(learn), "learning")
    coefficients, half = learned_shape(*learned, epsilon)
    about = About(
        signals={name: run.units.get(name) or SIGNAL_UNITS.get(name, "") for name in signals},
        coefficients=coefficients,
        half=half,
        predicted_from=predicted_from,
        plan=plan.as_dict(),
        learned=learn,
        epsilon=epsilon,
        confidence=confidence,
    )
    extremes, wind = _flown(pool, plan, probe, range(learn, plan.runs), "counting")
    return Band(about=about, axis=axis, extremes=extremes, wind=wind)


def _axis_of(plan: Plan, signals: int, flights: int) -> Axis:
    """The axis of a band of so many signals, of which so many `flights` are to be counted first."""
    (group,), central = plan.groups, plan.campaign.central
    over, length, per_unit = "time", central.flight.duration_s, central.controller.rate_hz
    followed = reference_of(central)
    if isinstance(followed, RouteReference):
        over, length, per_unit = "along", math.ceil(followed.path.length), 1.0
    edges = window_edges(round(length * per_unit) + 1, flights, signals) / per_unit
    distribution = distribution_of(plan.campaign, group.plant)
    return Axis(
        over=over,
        edges=edges,
        distribution=distribution.sentence(group.label),
        flights=distribution.table(group.label),
    )


def load_band(path: str | Path) -> Band:
    """Read a band; its axis, and the words for its flights, are those of its plan.

    Raises InputError as `read_band` does, or if the plan is none of flights to count.
    """

    def windows(about: About) -> Axis:
        plan = _plan(about)
        first = plan.runs - about.learned
        check_at_least(1, runs=first)
        return _axis_of(plan, len(about.signals), first)

    return read_band(path, windows)


def count_more(band: Band, flights: int, pool: WorkerPool) -> Band:
    """The band after more draws of its campaign were flown, `flights` in all, and it was read.

    Raises InputError if there are not more, or the files of an aircraft have changed.
    """
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
    return band.with_flights(*_flown(pool, plan, _probe(band.about, band.axis), runs, "counting"))


def recount(band: Band, flights: int, pool: WorkerPool) -> list[int]:
    """Fly some of the counted draws again, as `some_draws` chooses; those that differ by a bit."""
    return differing(band, some_draws(band, flights), pool)


def some_draws(band: Band, flights: int) -> list[int]:
    """Some of the counted draws, chosen at random.

    Where flights are equal to the bit, so many of the repeated ones are chosen too: they may be
    copies. Raises InputError if there are not so many flights.
    """
    counted = len(band.scores)
    if not 1 <= flights <= counted:
        raise InputError(f"`recount` must be 1 to the {counted} counted, got {flights}.")
    rng, rows = np.random.default_rng(), band.extremes.reshape(counted, -1)
    _, first = np.unique(rows, axis=0, return_index=True)
    repeated = np.setdiff1d(np.flatnonzero(np.isfinite(band.scores)), first)
    kinds = np.arange(counted), repeated
    some = [rng.choice(kind, min(flights, len(kind)), replace=False) for kind in kinds]
    return band.draws[np.unique(np.concatenate(some))].tolist()


def differing(band: Band, draws: Sequence[int], pool: WorkerPool) -> list[int]:
    """Those of some counted draws, in rising order, that differ by a bit when flown again.

    Raises InputError as `plan_of` does.
    """
    chosen = np.searchsorted(band.draws, draws)
    probe = _probe(band.about, band.axis)
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


def score(about: About, axis: Axis, run: Run, scenario: Scenario) -> float:
    """Scale at which a flight is just inside a band."""
    extremes, wind = np.split(np.array(_probe(about, axis)(run, scenario)), [2 * about.half.size])
    shape = 1, *about.half.shape, 2
    return float(scores_of(extremes.reshape(shape), wind[None], about.coefficients, about.half)[0])


def difference(plan: Plan, run: Run, scenario: Scenario) -> str:
    """First key in which a run differs from the flights of a plan; empty if it is one of them."""
    (group,), made = plan.groups, run.provenance
    gains, flown = plan.gain_sets[group.gains], made.gains
    if run.status != "completed":
        return "status"
    if group.plant != made.plant:
        return "plant"
    if split_name(group.gains)[0] != split_name(made.gains_name)[0]:
        return "law"
    if gains is None or flown is None or not np.allclose(gains.K, flown.K, rtol=TUNING_ROUNDING):
        return "gains"
    counted, own = (_stated(of, group.plant) for of in (plan.scenario, scenario))
    drawn = {re.sub(r"\[.*?\]", "", key) for key in plan.keys}
    differ = (key for key in counted | own if counted.get(key) != own.get(key))
    return next((key for key in differ if key not in drawn), "")


def _stated(scenario: Scenario, plant: str) -> dict[str, Any]:
    """Values that all flights of a plant share, whatever the air, by dotted key."""
    tables = scenario.as_dict()
    tables = {key: tables[key] for key in SHARED if key in tables}
    tables["plant"] = scenario.plant_table(plant).model_dump(mode="json", exclude_none=True)
    return dict(leaves(tables))


def _probe(about: About, axis: Axis) -> Probe:
    """The function that keeps the extremes of each flight."""
    return partial(_extremes, list(about.signals), axis.edges, about.predicted_from is not None)


def _flown(
    pool: WorkerPool, plan: Plan, probe: Probe, runs: Sequence[int], doing: str
) -> tuple[Extremes, FloatArray]:
    """Extremes of some runs, and their wind where the probe has it."""
    signals, edges, windy = probe.args
    shape = len(edges) - 1, len(signals), 2
    size = math.prod(shape)
    lost = LOST * (size // 2) + [0.0, 0.0] * windy
    extremes, winds = [], []
    for first in range(0, len(runs), PART):
        number = f", part {first // PART + 1} of {math.ceil(len(runs) / PART)}"
        said = f"{doing}{number if len(runs) > PART else ''}"
        part = runs[first : first + PART]
        rows = pool.in_order(plan, part, doing=said, probes={"extremes": probe})
        values = np.array([row.get("extremes", lost) for row in rows])
        extremes.append(values[:, :size].astype(np.float32).reshape(-1, *shape))
        winds.append(values[:, size:])
    return np.concatenate(extremes), np.concatenate(winds)


def _extremes(
    signals: list[str],
    edges: FloatArray,
    windy: bool,
    run: Run,
    scenario: Scenario,
    *,
    anywhere: bool = False,
) -> list[float]:
    """Extremes of a flight, window by window; after them the north and east wind at its start.

    Those of distances from a route are infinite if they do not give the positions of the flight,
    unless it may be `anywhere`.
    """
    axis = axis_of(run)
    samples = np.searchsorted(axis, edges - SAME).clip(max=len(axis) - 1)
    samples[:-1] = samples[:-1].clip(max=len(axis) - 2)  # a window has a sample before its last
    values = np.ravel(window_extremes(run.signals[signals].to_numpy(), samples)).tolist()
    route = reference_of(scenario)
    if (
        not anywhere
        and isinstance(route, RouteReference)
        and {*OFF_ROUTE} & {*signals}
        and route.displacement(run.signals) > SAME_PLACE
    ):
        values = LOST * (len(values) // 2)
    return [*values, *wind_at_start(scenario)] if windy else values


def axis_of(run: Run) -> FloatArray:
    """Time of each sample, or its distance along a route."""
    return along_route(run) if "along" in run.signals else run.t


def wind_at_start(scenario: Scenario) -> Sequence[float]:
    """North and east wind at the start, m/s."""
    if scenario.wind is None:
        return 0.0, 0.0
    return scenario.wind.profile().at(scenario.flight.h_m)[:2]
