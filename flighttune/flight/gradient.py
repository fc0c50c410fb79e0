"""Slopes of the measures of a flight with respect to its gains and numbers of its scenario."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.errors import InputError
from flighttune.base.files import code
from flighttune.base.units import DEG
from flighttune.control.gains import COMMANDS, PIGains
from flighttune.flight import metrics
from flighttune.flight.entry import Entry, entry_of
from flighttune.flight.fly import (
    aircraft_table,
    controller_on,
    difference,
    fly_alone,
    manoeuvre,
    plant_of,
)
from flighttune.flight.load import chosen_entry
from flighttune.flight.loop.aircraft import CEILING, CompiledAircraft, inside
from flighttune.flight.loop.batch import ARRIVED
from flighttune.flight.loop.loop import Flight
from flighttune.flight.loop.run import Run
from flighttune.flight.loop.slopes import Sampled, SlopedFlight, fly_with_slopes, sampled
from flighttune.flight.requirement_keys import in_rad
from flighttune.flight.scenario.load import places_of, scenario_from, value_at, with_values
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plants.base import OVER_GROUND

# Part of the keys of airframe factors. The step leaves out a factor of exactly 1, so a slope is
# taken at the next double.
AIRFRAME, OFF_NOMINAL = ".airframe.", 2.0**-52

# Fields of gains.
GAINS = ("K_P", "K_I", "feedback")

# Beginnings of the names of measures without a slope: they count samples, so they change in steps.
IN_SAMPLES = ("PT_s", "settling_s", "saturation_s", "held_", "swings")

# Keys of times that are rounded to samples; times of lags and filters are not rounded.
ON_SAMPLES = re.compile(r"(?<!rad)(?<!per)(?<!lag)(?<!time)(?<!constant)(?<!look_ahead)_s$|_hz$")

# Default measures where a scenario has no requirement.
BY_DEFAULT = ("chi.MO_deg", "gamma.MO_deg", "chi.ITAE", "gamma.ITAE")

# Relative half-width of the differences of start and law by a parameter. Laws are nearly linear in
# gains, and trims are accurate to 1e-9.
WIDTH = 1e-4

# Largest change of a signal when a measure is differentiated, rad, m or m/s; relative difference
# of the slopes on both sides above which the measure has a kink.
MOVE, KINK = 1e-6, 1e-3

# A slope below this share of measure over parameter is rounding.
ROUNDING = 1e-6


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gradient(Answering):
    """Slopes of the measures of one flight.

    Attributes
    ----------
    run : Run
        The flight.
    values : mapping of str to float
        Value of each measure, in the unit of its name.
    slopes : sequence of mapping
        ``measure``, ``parameter``, its ``value`` and the ``slope``, which is NaN at a kink of the
        measure; ``why`` then has the slopes on both sides.
    at_limits_s : float, s
        Time for which a limit holds a command.

    Examples
    --------
    >>> gradient = ft.gradient("exact_law", by=["K_P"], measures=["chi.ITAE"])
    >>> [row["parameter"] for row in gradient.slopes]
    ['K_P.phi.chi', 'K_P.n_z.gamma']
    """

    run: Run
    values: Mapping[str, float]
    slopes: Sequence[Mapping[str, Any]]
    at_limits_s: float


@code.flies
def gradient(
    scenario: Scenario | str | Path,
    *,
    by: Sequence[str] = (),
    measures: Sequence[str] = (),
    gains: PIGains | str | None = None,
    plant: str | None = None,
    changes: Mapping[str, Any] | None = None,
) -> Gradient:
    """Compute the slopes of measures of a flight with respect to gains and scenario numbers.

    Law, limits and aircraft are differentiated step by step in forward mode. A flight of 30 s takes
    about a second.

    Parameters
    ----------
    scenario : Scenario, str or Path
        A scenario with an aircraft whose step is compiled, its file, or the name of a shipped one.
    by : sequence of str, optional
        Parameters: ``K_P``, ``K_I`` or ``feedback`` for all of these gains that are not zero; one
        gain, such as ``K_P.phi.chi`` or ``feedback.n_z``; or a number of the scenario by its dotted
        key, such as ``plant.airframe.mass_factor``. By default all gains that are not zero.
    measures : sequence of str, optional
        Measures as [[expect]] names them, such as ``chi.MO_deg``. By default the bounded measures
        that have slopes, or else overshoot and ITAE of both channels.
    gains : PIGains or str, optional
        Gains, or a gain set by name or file; by default the first of the scenario.
    plant : str, optional
        Label of the aircraft, by default the first.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.

    Returns
    -------
    Gradient
        The flight and its slopes. The start is differentiated by differences of trims, the rest of
        the flight exactly. The samples at which limits hold a command are taken as fixed.

    Raises
    ------
    InputError, ScenarioError
        If a measure or a parameter is unknown or has no slope, the aircraft or the law is not
        compiled, or the flight does not last to its end.

    Examples
    --------
    >>> gradient = ft.gradient("exact_law", by=["plant.airframe.mass_factor"])
    >>> gradient.run.status, {row["parameter"] for row in gradient.slopes}
    ('completed', {'plant.airframe.mass_factor'})
    """
    chosen = chosen_entry(scenario, gains, changes)
    entry = replace(chosen, plant=aircraft_table(chosen.scenario, plant))
    if not entry.law.by_gains:
        raise InputError(f"`law` must be paper or exact to have slopes, got {entry.law.name}.")
    if code.jsbsim_flies():
        raise InputError(f"{code.JSBSIM} must be absent: slopes are those of compiled code.")
    names = measures or _bounded(entry.scenario)
    for name in names:
        _check_smooth(name)
    parameters = _parameters(entry, by or GAINS)
    for name, value in parameters.items():
        entry = _with(entry, name, value + OFF_NOMINAL * (AIRFRAME in name))
    run = fly_alone(entry, compiled=False)
    if run.status != "completed":
        raise InputError(f"{run.label}: the flight must be completed, got {run.outcome}")
    flight = _with_slopes(entry, parameters)
    _check_same(run, flight)
    measured = _measured(entry, run.signals)
    for name in names:
        if math.isnan(_value(name, measured)):
            known = ", ".join(x for x in measured if _smooth(x))
            raise InputError(
                f"`measures` must be of those that have a value in this flight, {known} (or _deg "
                f"in place of _rad), got {name}."
            )
    rows = [
        {"measure": name, "parameter": parameter, "value": value, **slope}
        for place, (parameter, value) in enumerate(parameters.items())
        for name, slope in zip(names, _slopes(entry, flight, place, names, value), strict=True)
    ]
    held = np.any([run.signals[f"{u}_limited"] != 0.0 for u in metrics.CHANNELS.values()], axis=0)
    return Gradient(
        run=run,
        values={name: _value(name, measured) for name in names},
        slopes=sorted(rows, key=lambda row: names.index(row["measure"])),
        at_limits_s=float(np.sum(held[:-1])) * float(run.t[1] - run.t[0]),
    )


def _bounded(scenario: Scenario) -> Sequence[str]:
    """Measures that a scenario bounds and that have slopes, or those by default."""
    names = [
        f"{subject}.{name}"
        for table in scenario.expect
        for bounds in (table.at_most, table.at_least)
        for subject, limits in bounds.items()
        for name in metrics.stated_bounds(subject, limits)
        if subject != "loop"
    ]
    return [*filter(_smooth, dict.fromkeys(names))] or BY_DEFAULT


def _smooth(name: str) -> bool:
    return not name.partition(".")[2].startswith(IN_SAMPLES)


def _check_smooth(name: str) -> None:
    """Refuse a measure that has no slope."""
    if name.startswith("loop."):
        raise InputError(
            f"`measures` must be of a flight, got {name}, a measure of the linear loop."
        )
    if not _smooth(name):
        raise InputError(
            f"`measures` must have slopes, got {name}, which counts samples and changes in steps."
        )


def _parameters(entry: Entry, by: Sequence[str]) -> dict[str, float]:
    """Value of each parameter."""
    found: dict[str, float] = {}
    known = _gains(entry.found_gains)
    for name in by:
        if name in GAINS:
            found |= {x: k for x, k in known.items() if k and x.startswith(f"{name}.")}
        elif name in known:
            found[name] = known[name]
        elif name.startswith(tuple(f"{x}." for x in GAINS)):
            raise InputError(f"`by` must be one of the gains {', '.join(known)}, got {name}.")
        else:
            found[name] = _number_at(entry.scenario, name)
    if not found:
        raise InputError(f"`by` must name a gain that is not zero, got {', '.join(by)}.")
    return found


def _gains(gains: PIGains) -> dict[str, float]:
    """Each gain by its name."""
    fed = zip(COMMANDS, gains.feedback, strict=True)
    return {
        **{
            f"{matrix}.{u}.{e}": float(getattr(gains, matrix)[i, j])
            for matrix in GAINS[:2]
            for i, u in enumerate(gains.inputs)
            for j, e in enumerate(gains.errors)
        },
        **{f"feedback.{u}": k for u, k in fed},
    }


def _with_gain(gains: PIGains, name: str, value: float) -> PIGains:
    """The gains with another value of one gain."""
    kind, *where = name.split(".")
    if kind == "feedback":
        fed = tuple(
            value if u == where[0] else k for u, k in zip(COMMANDS, gains.feedback, strict=True)
        )
        return replace(gains, feedback=fed)
    matrix = getattr(gains, kind).copy()
    matrix[gains.inputs.index(where[0]), gains.errors.index(where[1])] = value
    return replace(gains, **{kind: matrix})


def _number_at(scenario: Scenario, key: str) -> float:
    """The number at a key of a scenario; an absent number of the airframe is nominal."""
    if ON_SAMPLES.search(key):
        raise InputError(f"`by` must have slopes, got {key}, which is rounded to samples.")
    tables = scenario.as_dict()
    try:
        places = places_of(key, tables, 1.0)
    except InputError as error:
        raise InputError(f"`by` {key} {error}") from None
    values = [value_at(tables, place) for place in places]
    if all(x is None for x in values) and AIRFRAME in key:
        return 1.0 if "factor" in key else 0.0
    if not values or any(not isinstance(x, float) or x != values[0] for x in values):
        got = ", ".join("nothing" if x is None else repr(x) for x in values)
        raise InputError(
            f"`by` {key} must be one number of the scenario, and not a count, got {got}."
        )
    return values[0]


def _with(entry: Entry, name: str, value: float) -> Entry:
    """The entry with another value of a parameter."""
    if name.startswith(GAINS):
        return replace(entry, gains=_with_gain(entry.found_gains, name, value))
    tables = entry.scenario.as_dict()
    places = places_of(name, tables, value)
    changed = scenario_from(with_values(tables, [(place, value) for place in places]))
    return entry_of(changed, entry.name, entry.gains, entry.plant.label)


def _with_slopes(entry: Entry, parameters: Mapping[str, float]) -> SlopedFlight:
    """The flight of an entry with its slopes with respect to the parameters."""
    sides = {}
    for name, value in parameters.items():
        half = WIDTH * (abs(value) or 1.0)
        low, high = (_sampled(_with(entry, name, value + by)) for by in (-half, half))
        sides[name] = low, high, 2.0 * half
    flight = fly_with_slopes(_sampled(entry), sides)
    if flight.how != ARRIVED:
        raise InputError(
            f"{entry.label}: the flight must be compiled to have slopes, but only JSBSim flies "
            f"near the ground and above {CEILING:g} m."
        )
    return flight


def _sampled(entry: Entry) -> Sampled:
    """The flight of an entry after its start; an InputError if it is not compiled."""
    entry = entry.bound()
    scenario = entry.scenario
    plant = plant_of(entry.plant, scenario, compiled=True)
    aircraft, made = inside(plant, CompiledAircraft), manoeuvre(entry, plant, entry.plant.label)
    assert aircraft is not None  # `aircraft_table` found it
    controller, condition = controller_on(entry, plant), made["condition"]
    flight = Flight(plant, controller, lead=entry.lead, **made)
    aircraft.compiles = True
    plant.start(condition)
    controller.start(condition)
    why = aircraft.refused
    if not flight.law_compiles or OVER_GROUND[0] in plant.signals:
        why = "this law on this reference, or a path through the air, is not compiled"
    if why:
        raise InputError(f"{entry.label}: the flight must be compiled to have slopes, but {why}.")
    return sampled(flight, aircraft)


def _check_same(run: Run, flight: SlopedFlight) -> None:
    """Refuse slopes of a flight that does not equal JSBSim's to the bit."""
    if not run.signals.equals(flight.table(flight.rows.copy())):
        raise difference(
            run.label, "its signals differ from those of the flight with slopes", "it has no slopes"
        )


def _measured(entry: Entry, table: pd.DataFrame) -> dict[str, float]:
    """Finite measures of a table of signals, by the names of requirements."""
    columns = {x: table[x].to_numpy() for x in metrics.MEASURED if x in table}
    expect = [x.model_dump(exclude_defaults=True) for x in entry.scenario.expect]
    found = metrics.measures_of(table.index.to_numpy(), columns, metrics.required_names(expect))
    return {
        f"{subject}.{name}": value
        for subject, own in found.items()
        for name, value in own.items()
        if math.isfinite(value)
    }


def _value(name: str, measured: Mapping[str, float]) -> float:
    """A measure in the unit of its name; NaN if it has no value."""
    si = in_rad(name)
    return measured.get(si, math.nan) / (1.0 if si == name else DEG)


def _slopes(
    entry: Entry, flight: SlopedFlight, place: int, names: Sequence[str], parameter: float
) -> Iterator[dict[str, Any]]:
    """Slope of each measure with respect to one parameter, along the slopes of the signals."""
    slopes = flight.slopes[place]
    moves = flight.table(slopes.copy())
    size = float(np.abs(moves[[x for x in metrics.MEASURED if x in moves]].to_numpy()).max())
    if size == 0.0:
        yield from ({"slope": 0.0, "why": ""} for _ in names)
        return
    move = MOVE / size
    before, here, after = (
        _measured(entry, flight.table(flight.rows + way * move * slopes)) for way in (-1, 0, 1)
    )
    for name in names:
        low, middle, high = (_value(name, measured) for measured in (before, here, after))
        left, right = (middle - low) / move, (high - middle) / move
        least = ROUNDING * abs(middle) / (abs(parameter) or 1.0)
        kink = abs(right - left) > KINK * max(abs(right), abs(left)) + least
        why = f"a kink: {left:.4g} below and {right:.4g} above" if kink else ""
        yield {"slope": math.nan if kink else (high - low) / (2.0 * move), "why": why}
