"""Two runs of one manoeuvre in numbers: metrics, which is better, and how far apart they flew."""

import math
from dataclasses import replace
from typing import Any, Literal, TypeAlias

import numpy as np

from flighttune.metrics import METRICS, channel_metrics, flight_metrics
from flighttune.simulate.run import Run

Better: TypeAlias = Literal["a", "b", "same", ""]
Wanted: TypeAlias = Literal["low", "near zero", "neither"]

WANTED: dict[str, Wanted] = {
    "ITAE": "low",
    "ITAE_mean": "low",
    "PT_s": "neither",
    "MO_rad": "low",
    "MS_rad": "near zero",
    "ST_rad": "low",
    "rise_s": "low",
    "settling_s": "low",
    "effort_rms": "low",
    "saturation_s": "low",
    "V_a_dev_mps": "low",
    "n_z_min": "neither",
    "n_z_max": "neither",
    "alpha_max_rad": "low",
}
"""What is better, of each metric. A time that is never reached is worse than any that is."""

NEVER = ("rise_s", "settling_s")
"""Metrics whose missing value means that it was never reached."""

FLIGHT_UNITS = {"V_a_dev_mps": "m/s", "n_z_min": "1", "n_z_max": "1", "alpha_max_rad": "rad"}

FLIGHT = "flight"
"""Channel of the measures of the whole aircraft."""

EQUAL = 1e-12
"""Relative difference up to which neither is better."""

Row: TypeAlias = dict[str, Any]


def until(run: Run, end: float) -> Run:
    """The part of a run up to `end`, s."""
    return run if run.duration <= end else replace(run, signals=run.signals.loc[:end])


def metric_rows(a: Run, b: Run) -> list[Row]:
    """Metrics of two runs beside each other.

    Parameters
    ----------
    a, b : Run
        Of at least two samples, flown for the same time.

    Returns
    -------
    list of dict
        ``channel`` (chi, gamma or flight), ``name``, ``unit``, ``a``, ``b``, ``diff`` (b minus a)
        and ``better`` (a, b, same, or empty where neither direction is better); chi and gamma
        first. A measure that one plant does not have is left out.
    """
    rows = []
    both = [channel_metrics(run) for run in (a, b)]
    for channel in both[0].index:
        for name in METRICS:
            values = [float(one.at[channel, name]) for one in both]
            rows.append(_row(str(channel), name, *values))
    first, second = flight_metrics(a), flight_metrics(b)
    return rows + [
        _row(FLIGHT, name, first[name], second[name]) for name in first if name in second
    ]


def better(name: str, a: float, b: float) -> Better:
    """Which of two values of a metric is better: ``a``, ``b``, ``same``, or empty for neither."""
    wanted = WANTED[name]
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
    """How far apart two runs are at the same time after the start, at most.

    Parameters
    ----------
    a, b : Run
        With positions.

    Returns
    -------
    distance, time : float, m and s
        Over the time both flew, at the samples of both; positions between samples are linear.
    """
    t_a, t_b = (run.signals.index.to_numpy(dtype=float) for run in (a, b))
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
        "unit": _unit(channel, name),
        "a": a,
        "b": b,
        "diff": b - a,
        "better": better(name, a, b),
    }


def _unit(channel: str, name: str) -> str:
    if channel == FLIGHT:
        return FLIGHT_UNITS[name]
    if name == "effort_rms":
        return "rad" if channel == "chi" else "1"
    return METRICS[name]
