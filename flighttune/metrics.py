"""Tracking measures of a run: those of the paper and the usual step measures."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.simulate.measures import (
    METRICS,
    NO_STEP,
    SETTLING_BAND,
    STEADY_FROM,
    ErrorMeasures,
    error_measures,
    step_measures,
)
from flighttune.simulate.run import Run
from flighttune.units import DEG

if TYPE_CHECKING:
    import pandas as pd

# `error_measures`, or the same compiled
Measure: TypeAlias = Callable[..., ErrorMeasures]

# Controlled quantity and the command that mostly moves it.
CHANNELS = {"chi": "phi", "gamma": "n_z"}

# Signals whose largest magnitude is a measure of a flight along a route.
OFF_ROUTE = ("cross_track", "height_err")

# Signals that the measures use.
AIRSPEED = "V"

# Names of the measures of the airspeed where it is a channel, and their units.
AIRSPEED_METRICS = {
    name.replace("_rad", "_mps"): unit.replace("rad", "m/s")
    for name, unit in {**METRICS, "effort_rms": "1", "peak_rad": "rad", "min_rad": "rad"}.items()
}

MEASURED = (
    *("V_ref", "V_err", "n_x_cmd", "n_x_limited"),
    *(f"{channel}_err" for channel in CHANNELS),
    *(f"{command}_{kind}" for command in CHANNELS.values() for kind in ("cmd", "limited")),
    "gamma_ref",
    "V_a",
    "n_z",
    "alpha",
    *OFF_ROUTE,
)

# Names of `flight_metrics` and their units.
FLIGHT_METRICS = {
    "V_a_dev_mps": "m/s",
    "n_z_min": "1",
    "n_z_max": "1",
    "alpha_max_rad": "rad",
    "cross_track_m": "m",
    "height_err_m": "m",
}

# Measures that say why a response does not settle; see `settling_measures`.
UNSETTLED = ("settling_band_rad", "late_rad")

# Measures of a linear loop and their units; see `loop_measures` of `flighttune.flight.models`.
LOOP_METRICS = {
    "R_K": "1/s",
    "I_K": "s^2",
    "E_K": "s^2",
    "gain_margin_dB": "dB",
    "phase_margin_rad": "rad",
    "delay_margin_s": "s",
    "disk_margin": "1",
    "roll_rate_rad_s": "rad/s",
}


def unit_of(subject: str, name: str) -> str:
    """Unit of a measure of ``chi``, ``gamma`` or ``flight``, as `measures` names them."""
    if subject == "flight":
        return FLIGHT_METRICS[name]
    if subject == AIRSPEED:
        return AIRSPEED_METRICS.get(name, "s")
    if name == "effort_rms":
        return "rad" if subject == "chi" else "1"
    return METRICS.get(name, "rad" if name.endswith("_rad") else "s")


def metric_tables(runs: Sequence[Run]) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """`channel_metrics` and `flight_metrics` of those runs that flew, by label.

    `channels`: index run and channel; empty without runs.
    """
    import pandas as pd

    flown = [run for run in runs if len(run.signals) > 1 and not run.provenance.log]
    channels = {run.label: channel_metrics(run) for run in flown}
    flights = {run.label: flight_metrics(run) for run in flown}
    return (
        pd.concat(channels, names=["run"]) if channels else pd.DataFrame(),
        pd.DataFrame.from_dict(flights, orient="index"),
    )


def channel_metrics(run: Run) -> "pd.DataFrame":
    r"""Tracking measures of a run, one row a channel.

    Parameters
    ----------
    run : Run
        A run with at least two samples.

    Returns
    -------
    DataFrame
        Index ``chi, gamma``; columns `METRICS`; NaN where a measure has no value.

    Notes
    -----
    With ``e`` the error (reference minus actual, course wrapped) over the time T flown, and the
    direction of travel opposite to the first error larger than 1e-6 rad:

    ITAE
        Integral of ``t |e|`` over [0, T] (trapezoidal rule), rad s^2.
    ITAE_mean
        ITAE / T, the paper's "average".
    MO_rad
        Maximum overshoot: the furthest the response goes beyond the reference, 0 if it does not.
        Where no error ever exceeds 1e-6 rad there is no direction and it is 0.
    PT_s
        Peak time: when the response is furthest in the direction of travel (with an overshoot, the
        time of its peak).
    MS_rad, ST_rad
        Mean and standard deviation (of the population) of ``e`` over the last quarter of the time.
    rise_s
        From 10 % to 90 % of the first error, first passage of each; NaN if 90 % is not reached or
        the first error is below 0.1 deg.
    settling_s
        Time after which ``|e|`` stays within 5 % of the first error; NaN if it never does, or the
        first error is below 0.1 deg.
    effort_rms
        Root mean square of the command minus what steady flight on the reference needs: 0 for roll,
        ``cos(gamma_ref)`` for load factor.
    saturation_s
        Time in which the command was held by a magnitude or rate limit.

    ITAE, PT, MO, MS and ST are those of arXiv 2411.13140, section 5.2, which names them in words.

    Examples
    --------
    >>> run = ft.fly(ft.load_scenario("paper_as_printed")).runs[0]
    >>> ft.channel_metrics(run)["ITAE"].round(1).to_dict()
    {'chi': 18.6, 'gamma': 8.1}
    """
    import pandas as pd

    columns = signal_arrays(run, MEASURED)
    rows = {channel: _channel_measures(run.t, columns, channel) for channel in CHANNELS}
    return pd.DataFrame.from_dict(rows, orient="index", dtype=float)


def measures(run: Run) -> dict[str, dict[str, float]]:
    """All measures of a run, as numbers.

    Returns ``chi`` and ``gamma``: `channel_metrics` and ``peak_rad``, the largest magnitude of the
    error; ``flight``: `flight_metrics`; and where the airspeed is a channel ``V``, of which
    ``min_mps`` is the lowest airspeed; its step measures count from the first change of its
    reference. A channel whose settling time the scenario bounds has its
    `settling_measures` too. Empty for a run of fewer than two samples, and for a log.
    """
    if len(run.signals) < 2 or run.provenance.log:
        return {}
    settling = settling_names(run.provenance.scenario.get("expect", ()))
    return measures_of(run.t, signal_arrays(run, MEASURED), settling)


def measures_of(
    t: FloatArray,
    columns: Mapping[str, FloatArray],
    settling: Mapping[str, Sequence[str]],
    measure: Measure = error_measures,
) -> dict[str, dict[str, float]]:
    """`measures` of two or more samples of signals; `settling` are `settling_names`."""
    channels = {
        channel: _channel_measures(t, columns, channel, measure)
        | {"peak_rad": float(np.max(np.abs(columns[f"{channel}_err"])))}
        | settling_measures(t, columns[f"{channel}_err"], settling.get(channel, ()))
        for channel in CHANNELS
    }
    measured = {**channels, "flight": _flight_measures(columns)}
    if "V_err" in columns:
        measured[AIRSPEED] = _airspeed_measures(t, columns, measure)
    return measured


def airspeed_metrics(run: Run) -> dict[str, float]:
    """Measures of the airspeed, as `AIRSPEED_METRICS`; empty where it is not a channel."""
    columns = signal_arrays(run, MEASURED)
    if "V_err" not in columns or len(run.signals) < 2:
        return {}
    return _airspeed_measures(run.t, columns, error_measures)


def _airspeed_measures(
    t: FloatArray, columns: Mapping[str, FloatArray], measure: Measure
) -> dict[str, float]:
    error, steady = columns["V_err"], np.sin(columns["gamma_ref"])
    values = measure(t, error, columns["n_x_cmd"] - steady, columns["n_x_limited"])._asdict()
    changed = np.flatnonzero(columns["V_ref"] != columns["V_ref"][0])
    if len(changed):  # before its reference changes, the airspeed is disturbed by all else
        after = slice(int(changed[0]), None)
        step = step_measures(t[after] - t[changed[0]], error[after])
        values |= dict(zip(("PT_s", "MO_rad", "rise_s", "settling_s"), step, strict=True))
    values |= {"peak_rad": float(np.max(np.abs(error))), "min_rad": float(np.min(columns["V_a"]))}
    return {name.replace("_rad", "_mps"): value for name, value in values.items()}


def stated_bounds(limits: Mapping[str, float]) -> dict[str, float]:
    """Bounds of a channel by measure; ``settling_s`` beside a ``band_deg`` is named for both."""
    band = f"settling_s within {limits.get('band_deg', 0.0):.12g} deg"
    return {
        band if name == "settling_s" and "band_deg" in limits else name: bound
        for name, bound in limits.items()
        if name != "band_deg"
    }


def settling_names(expect: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Names of `settling_measures` by channel, where ``[[expect]]`` bounds its settling time."""
    names: dict[str, list[str]] = {}
    for table in expect:
        bounds = (*table.get("at_most", {}).items(), *table.get("at_least", {}).items())
        for subject, limits in bounds:
            if "settling_s" in limits:
                banded = filter(settling_band, stated_bounds(limits))
                names[subject] = [*dict.fromkeys([*names.get(subject, UNSETTLED), *banded])]
    return names


def settling_band(name: str) -> float | None:
    """Band of a settling time, rad, from its name; None for 5 % of the change."""
    return float(name.split()[2]) * DEG if name.startswith("settling_s within") else None


def settling_measures(t: FloatArray, error: FloatArray, names: Sequence[str]) -> dict[str, float]:
    """Settling times within bands of their own, and why a response does not settle, by name.

    ``settling_band_rad`` is 5 % of the first error larger than 1e-6 rad, from which times count;
    ``late_rad`` is the largest error over the last quarter of the time. Empty without `names`.
    """
    if not names:
        return {}
    size, begin = np.abs(error), int(np.argmax(np.abs(error) > NO_STEP))
    values = {
        "settling_band_rad": SETTLING_BAND * float(size[begin]),
        "late_rad": float(size[t >= STEADY_FROM * t[-1]].max()),
    }
    after = np.append(t[begin:] - t[begin], np.nan)  # by the number of samples before
    for name in names:
        if (band := settling_band(name)) is not None:
            outside = np.flatnonzero(size[begin:] > band)
            values[name] = float(after[np.append(-1, outside)[-1] + 1])
    return values


def signal_arrays(run: Run, names: Sequence[str]) -> dict[str, FloatArray]:
    """The signals among `names` that a run has, as contiguous arrays.

    `names`: any of `SIGNAL_UNITS`.
    """
    there = [name for name in names if name in run.signals]
    # All at once: a column of a table takes as long as its measures.
    return dict(zip(there, np.ascontiguousarray(run.signals[there].to_numpy().T), strict=True))


def flight_metrics(run: Run) -> dict[str, float]:
    """Measures of the whole aircraft, as far as the plant shows it.

    Returns
    -------
    dict
        ``V_a_dev_mps``, the largest deviation of airspeed from the start; ``n_z_min``, ``n_z_max``;
        ``alpha_max_rad``, the largest magnitude of angle of attack, where the plant has one;
        ``cross_track_m`` and ``height_err_m``, the largest distance from a route to the side, from
        its start where the flight is behind it, and above or below it.

    Examples
    --------
    >>> run = ft.fly(ft.load_scenario("paper_as_printed")).runs[0]
    >>> sorted(ft.flight_metrics(run))
    ['V_a_dev_mps', 'n_z_max', 'n_z_min']
    """
    return _flight_measures(signal_arrays(run, MEASURED))


def _flight_measures(columns: Mapping[str, FloatArray]) -> dict[str, float]:
    V_a, n_z = columns["V_a"], columns["n_z"]
    values = {
        "V_a_dev_mps": float(np.max(np.abs(V_a - V_a[0]))),
        "n_z_min": float(np.min(n_z)),
        "n_z_max": float(np.max(n_z)),
    }
    if "alpha" in columns:
        values["alpha_max_rad"] = float(np.max(np.abs(columns["alpha"])))
    for name in OFF_ROUTE:
        if name in columns:
            values[f"{name}_m"] = float(np.max(np.abs(columns[name])))
    return values


def _channel_measures(
    t: FloatArray,
    columns: Mapping[str, FloatArray],
    channel: str,
    measure: Measure = error_measures,
) -> dict[str, float]:
    command = CHANNELS[channel]
    steady = np.cos(columns["gamma_ref"]) if command == "n_z" else 0.0
    return measure(
        t,
        columns[f"{channel}_err"],
        columns[f"{command}_cmd"] - steady,
        columns[f"{command}_limited"],
    )._asdict()
