"""Bands of campaigns: a shape learned from some flights, and its scale counted on fresh ones."""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.aircraft.aircraft import files_hash
from flighttune.arrays import FloatArray, check_at_least
from flighttune.campaign.conform import at_random, check_random, distribution_of
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.flying.alone import fly_group
from flighttune.campaign.planning.plan import TUNING_ROUNDING, Plan, plan_from
from flighttune.campaign.stated_set import planned, rows_of
from flighttune.control.law import split_name
from flighttune.errors import InputError
from flighttune.guarantee.band import (
    MAX_NUMBERS,
    MIN_LEARNED,
    PART,
    About,
    Band,
    Extremes,
    learned_shape,
    scores_of,
    window_edges,
    window_extremes,
)
from flighttune.guarantee.bounds import ERRORS, along_route
from flighttune.guarantee.count import fresh_flights
from flighttune.metrics import OFF_ROUTE
from flighttune.routes.follow import RouteReference
from flighttune.scenario.load import scenario_from
from flighttune.scenario.places import leaves
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import BAND_ENDS, SIGNAL_UNITS, Run

# Rounding of times and distances, s and m.
SAME = 1e-9

# Keeps of a completed flight what is counted of it.
Probe: TypeAlias = partial[list[float]]

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
    distribution, central = distribution_of(plan, group.plant), campaign.central
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
    followed, over = central.followed(), "time"
    length, per_unit = central.flight.duration_s, central.controller.rate_hz
    if isinstance(followed, RouteReference):
        over, length, per_unit = "along", math.ceil(followed.path.length), 1.0
    edges = window_edges(round(length * per_unit) + 1, flights, len(signals)) / per_unit
    probe = partial(_extremes, signals, edges, predicted_from is not None)
    learned = _flown(pool, plan, probe, range(learn), "learning")
    coefficients, half = learned_shape(*learned, epsilon)
    about = About(
        signals={name: run.units.get(name) or SIGNAL_UNITS.get(name, "") for name in signals},
        over=over,
        edges=edges,
        coefficients=coefficients,
        half=half,
        predicted_from=predicted_from,
        distribution=f"{group.label} in {distribution.sentence}",
        plan=plan.as_dict(),
        learned=learn,
        readings=(),
        epsilon=epsilon,
        confidence=confidence,
        scale=None,
    )
    band = Band(about=about, extremes=learned[0][:0], wind=learned[1][:0])
    return band.with_flights(*_flown(pool, plan, probe, range(learn, plan.runs), "counting"))


def count_more(band: Band, flights: int, pool: WorkerPool) -> Band:
    """The band after more draws of its campaign were flown, `flights` in all, and it was read.

    Raises InputError if there are not more, or the files of an aircraft have changed.
    """
    about, counted = band.about, len(band.scores)
    most = MAX_NUMBERS // (2 * about.half.size)
    if not counted < flights <= most:
        raise InputError(
            f"`flights` must be more than the {counted} counted and at most {most}, got {flights}."
        )
    plan = plan_of(band).with_runs(about.learned + flights)
    runs = range(about.learned + counted, plan.runs)
    return band.with_flights(*_flown(pool, plan, _probe(band), runs, "counting"))


def recount(band: Band, flights: int, pool: WorkerPool) -> list[int]:
    """Fly some of the counted draws again; those whose extremes differ by a bit.

    Raises InputError as `plan_of` does, or if there are not so many flights.
    """
    about, counted = band.about, len(band.scores)
    if not 1 <= flights <= counted:
        raise InputError(f"`recount` must be 1 to the {counted} counted, got {flights}.")
    plan = plan_of(band)
    first, step = about.learned, counted // flights
    runs = range(first, first + step * flights, step)
    again, _ = _flown(pool, plan, _probe(band), runs, "counting again")
    differ = (again != band.extremes[::step][:flights]).any(axis=(1, 2, 3))
    return [run for run, other in zip(runs, differ, strict=True) if other]


def plan_of(band: Band) -> Plan:
    """The plan of a band; InputError if the files of an aircraft have changed since."""
    try:
        plan = plan_from(band.about.plan, "band")
    except (LookupError, TypeError, AttributeError) as error:
        raise InputError("`plan` must be that of a campaign.") from error
    for name, sha256 in plan.aircraft.items():
        if files_hash(name) != sha256:
            raise InputError(
                f"`{name}` must have the files that the band was flown with, got changed ones."
            )
    return plan.with_runs(band.about.learned + len(band.scores))


def around(band: Band, runs: Sequence[Run]) -> list[Run]:
    """The runs with the band as signals (`BAND_ENDS`), and its claim.

    A run has the band if it differs from the flights counted only in keys that they draw, whatever
    its value, and in its wind, gust, turbulence and disturbance. InputError if there is none, with
    what the first one differs in.
    """
    plan = plan_of(band)
    if band.about.scale is None:
        raise InputError("`band` must have a claim: too many of its flights were not completed.")
    if all(run.status != "completed" for run in runs):
        raise InputError("`run` must be completed to have a band.")
    scenarios = [scenario_from(dict(run.provenance.scenario)) for run in runs]
    other = [_other(plan, *of_run) for of_run in zip(runs, scenarios, strict=True)]
    if all(other):
        raise InputError(f"`band` must be of the same {other[0]} as the run.")
    drawn = []
    for run, scenario, differs in zip(runs, scenarios, other, strict=True):
        if differs:
            drawn.append(run)
            continue
        wind = np.array(_wind(scenario)) if band.about.predicted_from else None
        bounds = band.bounds(_axis(run), wind)
        named = replace(bounds, names=tuple(f"{name}_band" for name in bounds.names))
        of_band = {
            f"{name}{end}": unit for name, unit in band.about.signals.items() for end in BAND_ENDS
        }
        units = {**run.units, **of_band}
        drawn.append(replace(named.around(run), units=units, band=band.sentence))
    return drawn


def score(band: Band, run: Run, scenario: Scenario) -> float:
    """Scale at which a flight is just inside a band."""
    about = band.about
    extremes, wind = np.split(np.array(_probe(band)(run, scenario)), [2 * about.half.size])
    shape = 1, *about.half.shape, 2
    return float(scores_of(extremes.reshape(shape), wind[None], about.coefficients, about.half)[0])


def _other(plan: Plan, run: Run, scenario: Scenario) -> str:
    """What a run has other than the flights of a plan of one group; empty if it is one of them."""
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
    """What the flights of a plant share, whatever the air, by dotted key."""
    tables = scenario.as_dict()
    tables = {key: tables[key] for key in SHARED if key in tables}
    tables["plant"] = scenario.plant_table(plant).model_dump(mode="json", exclude_none=True)
    return dict(leaves(tables))


def _probe(band: Band) -> Probe:
    """The function that keeps the extremes of each flight."""
    about = band.about
    return partial(_extremes, list(about.signals), about.edges, about.predicted_from is not None)


def _flown(
    pool: WorkerPool, plan: Plan, probe: Probe, runs: range, doing: str
) -> tuple[Extremes, FloatArray]:
    """Extremes of some runs, and their wind where the probe has it."""
    signals, edges, windy = probe.args
    shape = len(edges) - 1, len(signals), 2
    size = math.prod(shape)
    lost = [-np.inf, np.inf] * (size // 2) + [0.0, 0.0] * windy
    extremes, winds = [], []
    for first in range(0, len(runs), PART):
        number = f", part {first // PART + 1} of {math.ceil(len(runs) / PART)}"
        said = f"{doing}{number if len(runs) > PART else ''}"
        part = runs[first : first + PART]
        rows = rows_of(pool, plan, said, runs=part, probes={"extremes": probe})
        values = np.array([own or lost for own in rows["extremes"].to_pylist()])
        extremes.append(values[:, :size].astype(np.float32).reshape(-1, *shape))
        winds.append(values[:, size:])
    return np.concatenate(extremes), np.concatenate(winds)


def _extremes(
    signals: list[str], edges: FloatArray, windy: bool, run: Run, scenario: Scenario
) -> list[float]:
    """Extremes of a flight, window by window; after them the north and east wind at its start."""
    axis = _axis(run)
    samples = np.searchsorted(axis, edges - SAME).clip(max=len(axis) - 1)
    samples[:-1] = samples[:-1].clip(max=len(axis) - 2)  # a window has a sample before its last
    values = np.ravel(window_extremes(run.signals[signals].to_numpy(), samples)).tolist()
    return [*values, *_wind(scenario)] if windy else values


def _axis(run: Run) -> FloatArray:
    """Time of each sample, or its distance along a route."""
    return along_route(run) if "along" in run.signals else run.t


def _wind(scenario: Scenario) -> Sequence[float]:
    """North and east wind at the start, m/s."""
    if scenario.wind is None:
        return 0.0, 0.0
    return scenario.wind.profile().at(scenario.flight.h_m)[:2]
