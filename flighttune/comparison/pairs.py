"""Two runs of one manoeuvre: which belong together, which is better, how far apart they flew."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.comparison.source import Source
from flighttune.metrics import (
    FLIGHT_METRICS,
    METRICS,
    channel_metrics,
    flight_metrics,
    unit_of,
)
from flighttune.scenario.load import leaves
from flighttune.simulate.run import Run

Better: TypeAlias = Literal["a", "b", "same", ""]
BetterIf: TypeAlias = Literal["low", "near zero", "neither"]

BETTER_IF: dict[str, BetterIf] = {
    **dict.fromkeys((*METRICS, *FLIGHT_METRICS), "low"),
    **dict.fromkeys(("PT_s", "n_z_min", "n_z_max"), "neither"),
    "MS_rad": "near zero",
}
"""Better direction of each metric. A time that is never reached is worse than any other."""

NEVER = ("rise_s", "settling_s")
"""Metrics whose missing value means that it was never reached."""


FLIGHT = "flight"
"""Channel of the measures of the whole aircraft."""

EQUAL = 1e-12
"""Relative difference up to which neither is better."""

Row: TypeAlias = dict[str, Any]

MANOEUVRE = ("V_a_mps", "h_m", "chi_deg", "gamma_deg", "phi_deg", "n_z", "duration_s")
"""Keys of ``[flight]`` that belong to the manoeuvre, as does all of ``[reference]``."""

DESCRIPTION = ("title", "verifies", "source", "gains", "plant", "reference")
"""Keys that are text, or are compared elsewhere."""

FEWEST_SAMPLES = 2


def paired(a: Sequence[Run], b: Sequence[Run]) -> list[tuple[Run, Run]]:
    """Pair the runs of two sources.

    Returns one run each: those two. Else those of equal label; failing that, those of equal plant
    if both sides have a single gain set, or of equal gains if both have a single plant. Empty where
    nothing fits.
    """
    if len(a) == len(b) == 1:
        return [(a[0], b[0])]
    for key, rest in (("label", None), ("plant", "gains_name"), ("gains_name", "plant")):
        if rest and any(len({getattr(r.provenance, rest) for r in side}) > 1 for side in (a, b)):
            continue
        partners = {_key(run, key): run for run in b}
        matched = [(run, partners[_key(run, key)]) for run in a if _key(run, key) in partners]
        if matched:
            return matched
    return []


def _key(run: Run, name: str) -> str:
    return run.label if name == "label" else getattr(run.provenance, name)


def why_not(a: Source, b: Source, pairs: Sequence[tuple[Run, Run]]) -> str:
    """Why two sources cannot be compared, in one sentence; empty where they can.

    `pairs` is the result of `paired` for their runs.
    """
    between = f"{a.name} and {b.name}"
    for source, other in ((a, b), (b, a)):
        several = not source.chosen and len(source.gain_sets) > 1
        if several and set(source.gain_sets) != set(other.gain_sets):
            choices = ", ".join(f"{source.name}@{gains}" for gains in source.gain_sets)
            return f"{between}: {source.name} has several gain sets, name one of {choices}."
    if not pairs:
        labels = " | ".join(", ".join(run.label for run in side.runs) for side in (a, b))
        return f"{between}: a run must have a partner of the same plant or gains, got {labels}."
    for pair in pairs:
        for source, run in zip((a, b), pair, strict=True):
            if len(run.signals) < FEWEST_SAMPLES:
                return f"{source.name}: {run.label} must have flown, got {run.status}: {run.reason}"
        aircraft = [run.provenance.aircraft for run in pair]
        if all(aircraft) and aircraft[0] != aircraft[1]:
            return f"{between}: the aircraft must be the same, got {aircraft[0]} and {aircraft[1]}."
        flown = [manoeuvre(run) for run in pair]
        different = _changes(*flown)
        if different:
            key, (value, got) = next(iter(different.items()))
            return f"{between}: the manoeuvre must be the same, `{key}` is {value} and {got}."
    return ""


def manoeuvre(run: Run) -> dict[str, Any]:
    """Manoeuvre of a run: start, length and reference, as in the scenario.

    Gains, plant, limits, controller, weather and gravity of the law are not part of it: a
    comparison is about their effect.
    """
    scenario = run.provenance.scenario
    flight = {key: value for key, value in scenario["flight"].items() if key in MANOEUVRE}
    return dict(leaves({"flight": flight, "reference": scenario["reference"]}))


def differences(a: Run, b: Run) -> dict[str, tuple[Any, Any]]:
    """Settings of the scenarios of two runs that are not the same, by dotted key."""

    def settings(run: Run) -> dict[str, Any]:
        scenario = run.provenance.scenario.items()
        return dict(leaves({key: value for key, value in scenario if key not in DESCRIPTION}))

    return _changes(settings(a), settings(b))


def _changes(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    return {key: (a.get(key), b.get(key)) for key in sorted({*a, *b}) if a.get(key) != b.get(key)}


def until(run: Run, end: float) -> Run:
    """The part of a run up to `end`, s."""
    return run if run.duration <= end else replace(run, signals=run.signals.loc[:end])


def metric_rows(a: Run, b: Run) -> list[Row]:
    """Metrics of two runs side by side.

    Both runs have at least two samples and last equally long. Returns ``channel`` (chi, gamma or
    flight), ``name``, ``unit``, ``a``, ``b``, ``diff`` (b minus a) and ``better`` (a, b, same, or
    empty where neither direction is better); chi and gamma first. A measure that one plant does not
    have is left out.
    """
    rows = []
    both = [channel_metrics(run) for run in (a, b)]
    for channel in both[0].index:
        for name in METRICS:
            values = [float(metrics.at[channel, name]) for metrics in both]
            rows.append(_row(str(channel), name, *values))
    first, second = flight_metrics(a), flight_metrics(b)
    return rows + [
        _row(FLIGHT, name, first[name], second[name]) for name in first if name in second
    ]


def better(name: str, a: float, b: float) -> Better:
    """Better of two values of a metric: ``a``, ``b``, ``same``, or empty if there is none."""
    wanted = BETTER_IF[name]
    if wanted == "neither":
        return ""
    if name in NEVER:
        a, b = (math.inf if math.isnan(value) else value for value in (a, b))
    elif math.isnan(a) or math.isnan(b):
        return ""
    if wanted == "near zero":
        a, b = abs(a), abs(b)
    if math.isclose(a, b, rel_tol=EQUAL):
        return "same"
    return "a" if a < b else "b"


def largest_distance(a: Run, b: Run) -> tuple[float, float]:
    """Largest distance of two runs at the same time after the start.

    `distance`, `time` (m and s): over the time both flew, at the samples of both; positions between
    samples are linear.
    """
    t_a, t_b = a.t, b.t
    t = np.union1d(t_a, t_b)
    t = t[t <= min(t_a[-1], t_b[-1])]
    apart = [
        np.interp(t, t_b, b.signals[axis].to_numpy())
        - np.interp(t, t_a, a.signals[axis].to_numpy())
        for axis in ("north", "east", "down")
    ]
    distance = np.sqrt(np.sum(np.square(apart), axis=0))
    at = int(np.argmax(distance))
    return float(distance[at]), float(t[at])


def _row(channel: str, name: str, a: float, b: float) -> Row:
    return {
        "channel": channel,
        "name": name,
        "unit": unit_of(channel, name),
        "a": a,
        "b": b,
        "diff": b - a,
        "better": better(name, a, b),
    }
