"""Tracking measures of a run: the paper's measures and the usual step measures."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.signals import CHANNEL_SYMBOLS, COMMAND_OF, SIGNAL_UNITS, SUBJECTS
from flighttune.base.units import DEG, shown_unit
from flighttune.control.limits import FREE, MAGNITUDE_LIMITED, RATE_LIMITED
from flighttune.flight.loop.measures import (
    METRICS,
    SETTLING_BAND,
    SMALLEST_STEP,
    STEADY_FROM,
    ErrorMeasures,
    error_measures,
    moves,
    settling_time,
    step_measures,
)
from flighttune.flight.loop.run import Run

if TYPE_CHECKING:
    import pandas as pd

# `error_measures`, or its compiled form
Measure: TypeAlias = Callable[..., ErrorMeasures]
Columns: TypeAlias = Mapping[str, FloatArray]  # signals by name

# Controlled quantity and the command that mostly moves it; `COMMAND_OF` has the airspeed too.
CHANNELS = {channel: COMMAND_OF[channel] for channel in CHANNEL_SYMBOLS}

# Signals whose largest magnitude is a measure of a flight along a route.
OFF_ROUTE = ("cross_track", "height_err")

# Signals that the measures use.
AIRSPEED = "V"

# Names of the measures of the airspeed if it is a channel.
AIRSPEED_METRICS = tuple(name.replace("_rad", "_mps") for name in (*METRICS, "peak_rad", "min_rad"))


def _largest(values: FloatArray) -> float:
    return float(np.max(np.abs(values)))


# Measures of a flight by name: signal and measure.
FLIGHT_MEASURES: Mapping[str, tuple[str, Callable[[FloatArray], float]]] = {
    "V_a_dev_mps": ("V_a", lambda V_a: _largest(V_a - V_a[0])),
    "n_z_min": ("n_z", np.min),
    "n_z_max": ("n_z", np.max),
    "alpha_max_rad": ("alpha", _largest),
    **{f"{signal}_m": (signal, _largest) for signal in OFF_ROUTE},
}

# Names of `flight_metrics`.
FLIGHT_METRICS = tuple(FLIGHT_MEASURES)

MEASURED = (
    *("V_ref", "V_err"),
    *(f"{channel}_err" for channel in CHANNELS),
    *(
        f"{command}_{kind}"
        for command in COMMAND_OF.values()
        for kind in ("cmd", "unlimited", "limited")
    ),
    *(f"{channel}_ref" for channel in CHANNELS),
    "gamma_given",
    *dict.fromkeys(signal for signal, _ in FLIGHT_MEASURES.values()),
)

# A flight has followed a change to the end if the final error is within this share of it, or within
# the second number for course and path angle, rad.
FOLLOWED, ALWAYS_ALLOWED = 0.2, DEG

# A limited command is reported from this share of the last quarter of the time.
HELD = 0.5

# A command swings between its limits if they act alternately from both sides, in most samples or,
# in calm air, this number of times. A response that rolls in, rolls out and corrects has two
# changes; in turbulence a load factor with feedback has up to one in 5 samples.
SWINGS, IN_SAMPLES = 3, 0.5

# Tolerance for the time of an envelope's new bound, s.
ROUNDING_S = 1e-9

# Measures that tell why a response does not settle; see `settling_measures`.
UNSETTLED = ("settling_band_rad", "late_rad")

# Signal and unit of an error with an envelope over time, by subject in ``[[expect]]``.
ENVELOPES = {
    name: (subject.error, shown_unit(SIGNAL_UNITS[subject.error])[0])
    for name, subject in SUBJECTS.items()
}

# Beginning of the name of an envelope measure: ``error within 90 deg, 6 deg from 4 s``.
ENVELOPE = "error within "

# Measures of a linear loop; see `loop_measures` of `flighttune.flight.models`.
LOOP_METRICS = (
    *("R_K", "I_K", "E_K", "gain_margin_dB", "phase_margin_rad", "delay_margin_s"),
    *("disk_margin", "roll_rate_rad_s"),
)

# Measures that may be negative.
SIGNED = ("MS_rad", "MS_mps", "n_z_min", "n_z_max", *LOOP_METRICS)

# Units of measures by the endings of their names; for airspeeds m/s replaces rad.
UNIT_OF_END = {"ITAE": "rad s^2", "ITAE_mean": "rad s", "_rad": "rad", "_mps": "m/s", "_m": "m"}


def unit_of(subject: str, name: str) -> str:
    """Unit of a measure of ``chi``, ``gamma`` or ``flight``, by its name in `measures`."""
    if name == "effort_rms":
        return "rad" if subject == "chi" else "1"
    if name.startswith(("n_z_min", "n_z_max", ENVELOPE)):
        return "1"
    unit = next((unit for end, unit in UNIT_OF_END.items() if name.endswith(end)), "s")
    return unit.replace("rad", "m/s") if subject == AIRSPEED else unit


def metric_tables(runs: Sequence[Run]) -> "tuple[pd.DataFrame, pd.DataFrame]":
    """`channel_metrics` and `flight_metrics` of the runs that flew, by label."""
    import pandas as pd

    flown = [run for run in runs if len(run.signals) > 1 and not run.provenance.log]
    channels = {run.label: channel_metrics(run) for run in flown}
    return (
        pd.concat(channels, names=["run"]) if channels else pd.DataFrame(),
        pd.DataFrame.from_dict({run.label: flight_metrics(run) for run in flown}, orient="index"),
    )


def channel_metrics(run: Run) -> "pd.DataFrame":
    r"""Tracking measures of a run, one row for each channel.

    Parameters
    ----------
    run : Run
        A run with at least two samples.

    Returns
    -------
    DataFrame
        Index ``chi, gamma``; columns `METRICS`; NaN for a measure without a value.

    Notes
    -----
    With ``e`` the error (reference minus actual, course wrapped) over the flown time T, and the
    direction of travel opposite to the first error larger than 1e-6 rad:

    ITAE
        Integral of ``t |e|`` over [0, T] (trapezoidal rule), rad s^2.
    ITAE_mean
        ITAE / T, the paper's "average".
    MO_rad
        Maximum overshoot: largest distance of the response beyond the reference, else 0. Without an
        error above 1e-6 rad there is no direction, and it is 0.
    PT_s
        Peak time: time of the extreme response in the direction of travel (with an overshoot, of
        its peak).
    MS_rad, ST_rad
        Mean and standard deviation (of the population) of ``e`` over the last quarter of the time.
    rise_s
        From 10 % to 90 % of the first error, first passage of each; NaN if 90 % is not reached or
        the first error is below 0.1 deg.
    settling_s
        Time from the end of a commanded change until ``|e|`` stays within 5 % of the commanded
        change of the channel: the largest distance of its reference from the start of the flight. A
        step ends when it begins, and a flight that starts beside its reference is a step at t = 0.
        The time is 0 for a response within 5 % at the end of a ramp. For several changes it is the
        longest time, each at most until the next change. NaN if the flight ends outside, and on a
        route. Without a commanded change of at least 0.1 deg it is 0 if ``|e|`` stays within 0.005
        deg, else NaN.
    effort_rms
        Root mean square of the command minus its value in steady flight on the reference: 0 for
        roll, ``cos(gamma_ref)`` for load factor.
    saturation_s
        Time with the command at a magnitude or rate limit.

    ITAE, PT, MO, MS and ST follow arXiv 2411.13140, section 5.2, which defines them in words.

    Examples
    --------
    >>> run = ft.fly(ft.load_scenario("paper_as_printed")).runs[0]
    >>> ft.loop.channel_metrics(run)["ITAE"].round(1).to_dict()
    {'chi': 18.6, 'gamma': 8.1}
    """
    import pandas as pd

    columns = signal_arrays(run, MEASURED)
    rows = {channel: _channel_measures(run.t, columns, channel) for channel in CHANNELS}
    return pd.DataFrame.from_dict(rows, orient="index", dtype=float)[[*METRICS]]


def measures(run: Run) -> dict[str, dict[str, float]]:
    """All measures of a run, as numbers; empty for a log or fewer than two samples.

    ``chi`` and ``gamma``: `channel_metrics`, ``peak_rad``, the largest magnitude of the error, and
    the mean error at the end, ``end_error``, with ``end_allowed``, and `held_at_end`; ``flight``:
    `flight_metrics`; and ``V`` if the airspeed is a channel, with the lowest airspeed as
    ``min_mps``. Measures that only requirements use are included: `settling_measures`, and the
    largest ratio of an error to its envelope, also for ``cross_track`` and ``height_err``.
    """
    if len(run.signals) < 2 or run.provenance.log:
        return {}
    required = required_names(run.provenance.scenario.get("expect", ()))
    return measures_of(run.t, signal_arrays(run, MEASURED), required)


def measures_of(
    t: FloatArray,
    columns: Columns,
    required: Mapping[str, Sequence[str]],
    measure: Measure = error_measures,
) -> dict[str, dict[str, float]]:
    """`measures` of two or more samples of signals; `required` are `required_names`.

    A constant reference or airspeed may have one sample.
    """
    measured: dict[str, dict[str, float]] = {}
    for channel in CHANNELS:
        values = _channel_measures(t, columns, channel, measure)
        measured[channel] = {
            **{name: values[name] for name in (*METRICS, "peak_rad")},
            **_end_errors(t, columns, channel, values),
            **held_at_end(t, columns, CHANNELS[channel]),
            **settling_measures(t, columns, channel, values, required.get(channel, ())),
        }
    measured["flight"] = _flight_measures(columns)
    if "V_err" in columns:
        held = held_at_end(t, columns, COMMAND_OF[AIRSPEED])
        measured[AIRSPEED] = _airspeed_measures(t, columns, measure) | held
    for subject, names in required.items():
        for name in names:
            if name.startswith(ENVELOPE):
                ratios = columns[ENVELOPES[subject][0]] / envelope_bounds(name, t, subject, columns)
                measured.setdefault(subject, {})[name] = float(np.max(np.abs(ratios)))
    return measured


def envelope_bounds(name: str, t: FloatArray, subject: str, columns: Columns) -> FloatArray:
    """Bound of an error at each sample, shape of `t`, SI, of the measure `name` of a `subject`."""
    parts = [part.split() for part in name.removeprefix(ENVELOPE).split(", ")]
    times = [float(part[3]) if len(part) > 2 else 0.0 for part in parts]
    bounds = np.array([float(size) * (DEG if unit == "deg" else 1.0) for size, unit, *_ in parts])
    # Times count from the end of the channel's last reference change, and from the start of the
    # flight before the first change; during a change the first bound holds. Along a route, whose
    # guidance changes the reference all the time, they count from the start.
    changed = np.zeros_like(t)
    if OFF_ROUTE[0] not in columns:
        moved = moves(columns[f"{subject}_ref"])
        changed[moved] = t[moved]
    since = t - np.maximum.accumulate(changed)
    return bounds[np.searchsorted(times, since + ROUNDING_S, side="right") - 1]


def airspeed_metrics(run: Run) -> dict[str, float]:
    """Measures of the airspeed, as `AIRSPEED_METRICS`; empty if it is not a channel."""
    columns = signal_arrays(run, MEASURED)
    if "V_err" not in columns or len(run.signals) < 2:
        return {}
    return _airspeed_measures(run.t, columns, error_measures)


def _airspeed_measures(t: FloatArray, columns: Columns, measure: Measure) -> dict[str, float]:
    error, steady = columns["V_err"], np.sin(columns["gamma_ref"])
    effort, ref = columns["n_x_cmd"] - steady, columns["V_ref"]
    values = measure(t, ref, error, effort, columns["n_x_limited"])._asdict()
    changed = np.flatnonzero(ref != ref[0])
    if len(changed):  # before its reference changes, everything else disturbs the airspeed
        after = slice(int(changed[0]), None)
        step = step_measures(t[after] - t[changed[0]], error[after])
        values |= dict(zip(("PT_s", "MO_rad", "rise_s"), step, strict=True))
    values["min_rad"] = float(np.min(columns["V_a"]))
    own = {name.replace("_rad", "_mps"): value for name, value in values.items()}
    return {x: own[x] for x in AIRSPEED_METRICS} | _end_errors(t, columns, AIRSPEED, values)


def _end_errors(
    t: FloatArray, columns: Columns, channel: str, values: Mapping[str, float]
) -> dict[str, float]:
    """Magnitude of the mean error at the end, and its maximum for a flight that followed."""
    error, change = columns[f"{channel}_err"], values["change_rad"]
    least = 0.0 if channel == AIRSPEED else ALWAYS_ALLOWED
    # A flight either reaches the end of a route or does not.
    if OFF_ROUTE[0] in columns or max(change, least) < SMALLEST_STEP:
        return {}
    # The end is the last quarter of the time, whose mean error is MS_rad, or its part after the
    # last change of the reference.
    begin, mean = max(STEADY_FROM * t[-1], values["rest_s"]), values["MS_rad"]
    # If thrust is short, the path angle is compared with the reduced reference of the law.
    short_of_thrust = channel == "gamma" and "gamma_given" in columns
    if short_of_thrust:
        error = error + columns["gamma_given"] - columns["gamma_ref"]
    if short_of_thrust or begin > STEADY_FROM * t[-1]:
        mean = float(np.mean(error[t >= begin]))
    return {"end_error": abs(mean), "end_allowed": max(FOLLOWED * change, least)}


def held_at_end(t: FloatArray, columns: Columns, command: str) -> dict[str, float]:
    """Shares of limits that hold a command in more than half of the last quarter; else empty.

    ``held_magnitude`` and ``held_rate`` are the shares of the quarter at either limit. ``swings``
    counts the changes of the side from which limits hold the command, and ``swings_each`` is this
    number divided by the number of samples.
    """
    late = slice(int(np.searchsorted(t, STEADY_FROM * t[-1])), None)
    limited = columns[f"{command}_limited"][late]
    if np.count_nonzero(limited) <= HELD * len(limited):
        return {}
    u, wanted = columns[f"{command}_cmd"], columns[f"{command}_unlimited"]
    # A rate limit holds a command on the side of its motion; braking, which counts as a rate limit,
    # may leave no excess.
    moved = np.diff(u, prepend=u[0])[late]
    sides = np.sign(np.where(limited == RATE_LIMITED, moved, (wanted - u)[late]))
    sides = sides[(limited != FREE) & (sides != 0.0)]
    turns = float(np.count_nonzero(sides[1:] != sides[:-1]))
    return {
        "held_magnitude": float(np.mean(limited == MAGNITUDE_LIMITED)),
        "held_rate": float(np.mean(limited == RATE_LIMITED)),
        "swings": turns,
        "swings_each": turns / len(limited),
    }


def swings(values: Mapping[str, float], *, calm: bool) -> bool:
    """Whether a command swings between its limits to the end, from its channel's measures."""
    often = calm and values.get("swings", 0.0) >= SWINGS
    return often or values.get("swings_each", 0.0) > IN_SAMPLES


def at_limits(run: Run) -> dict[str, dict[str, float]]:
    """Shares of a flight, and of its last quarter, at the limits of each command."""
    t, signals = run.t, run.signals
    late = t >= STEADY_FROM * run.duration
    shares = {}
    for command in COMMAND_OF.values():
        if f"{command}_limited" in signals and len(t):
            limited = signals[f"{command}_limited"].to_numpy()
            kinds = {"magnitude": limited == MAGNITUDE_LIMITED, "rate": limited == RATE_LIMITED}
            shares[command] = {name: float(np.mean(at)) for name, at in kinds.items()}
            shares[command] |= {f"{x}_end": float(np.mean(at[late])) for x, at in kinds.items()}
    return shares


def limits_in_words(measured: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Limits that hold a command to the end, from `measures`, in words."""
    said = []
    for channel, values in measured.items():
        if "swings" in values:
            shares = {kind: 100.0 * values[f"held_{kind}"] for kind in ("magnitude", "rate")}
            each = [f"at its {kind} limit in {x:.0f} %" for kind, x in shares.items() if x]
            said.append(f"{COMMAND_OF[channel]}_cmd is {' and '.join(each)} of the last quarter")
    return said


def stated_bounds(subject: str, limits: Mapping[str, Any]) -> dict[str, float]:
    """Bounds of a subject by measure, with their band or envelope in the name."""
    bounds = {name: bound for name, bound in limits.items() if name not in ("band_deg", "within")}
    if "band_deg" in limits:
        bounds[f"settling_s within {limits['band_deg']:.12g} deg"] = bounds.pop("settling_s")
    if "within" in limits:
        unit = ENVELOPES[subject][1]
        rows = [f"{bound:.12g} {unit} from {time:.12g} s" for time, bound in limits["within"]]
        bounds[ENVELOPE + ", ".join(rows).replace(" from 0 s", "")] = 1.0
    return bounds


def required_names(expect: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Names of measures that only ``[[expect]]`` uses, by subject."""
    names: dict[str, list[str]] = {}
    for table in expect:
        bounds = (*table.get("at_most", {}).items(), *table.get("at_least", {}).items())
        for subject, limits in bounds:
            own = [name for name in stated_bounds(subject, limits) if " within " in name]
            settling = UNSETTLED if "settling_s" in limits else ()
            names[subject] = [*dict.fromkeys([*names.get(subject, ()), *settling, *own])]
    return names


def settling_band(name: str) -> float | None:
    """Band of a settling time, rad, from its name; None for 5 % of the change."""
    return float(name.split()[2]) * DEG if name.startswith("settling_s within") else None


def settling_measures(
    t: FloatArray, columns: Columns, channel: str, values: Mapping[str, float], names: Sequence[str]
) -> dict[str, float]:
    """Settling times within specific bands, and reasons for a response that does not settle."""
    if all(name.startswith(ENVELOPE) for name in names):
        return {}
    bands = {name: band for name in names if (band := settling_band(name)) is not None}
    ref, size = columns[f"{channel}_ref"], np.abs(columns[f"{channel}_err"])
    return {
        "settling_band_rad": SETTLING_BAND * values["change_rad"],
        "late_rad": values["late_rad"],
        **{name: settling_time(t, ref, size, band) for name, band in bands.items()},
    }


def signal_arrays(run: Run, names: Sequence[str]) -> dict[str, FloatArray]:
    """The signals among `names` that exist in a run, as contiguous arrays."""
    columns = run.signals.columns.tolist()
    places = {name: columns.index(name) for name in names if name in columns}
    # All together by position, since access by name takes as long as the measures.
    values = np.ascontiguousarray(run.signals.to_numpy().T[[*places.values()]])
    return dict(zip(places, values, strict=True))


def flight_metrics(run: Run) -> dict[str, float]:
    """Measures of the whole aircraft, as far as the plant has the signals.

    Returns
    -------
    dict
        ``V_a_dev_mps``, the largest deviation of airspeed from the start; ``n_z_min``, ``n_z_max``;
        ``alpha_max_rad``, the largest magnitude of the angle of attack, if the plant has one;
        ``cross_track_m`` and ``height_err_m``, the largest distances from a route to the side and
        above or below it; behind the start the distance from the start counts.

    Examples
    --------
    >>> run = ft.fly(ft.load_scenario("paper_as_printed")).runs[0]
    >>> sorted(ft.loop.flight_metrics(run))
    ['V_a_dev_mps', 'n_z_max', 'n_z_min']
    """
    return _flight_measures(signal_arrays(run, MEASURED))


def _flight_measures(columns: Columns) -> dict[str, float]:
    return {
        name: float(measure(columns[signal]))
        for name, (signal, measure) in FLIGHT_MEASURES.items()
        if signal in columns
    }


def _channel_measures(
    t: FloatArray, columns: Columns, channel: str, measure: Measure = error_measures
) -> dict[str, float]:
    command = CHANNELS[channel]
    effort, limited = columns[f"{command}_cmd"], columns[f"{command}_limited"]
    if command == "n_z":
        effort = effort - np.cos(columns["gamma_ref"])
    ref, error = columns[f"{channel}_ref"], columns[f"{channel}_err"]
    values = measure(t, ref, error, effort, limited)._asdict()
    # The guidance of a route commands small changes all the time.
    return values | ({"settling_s": math.nan} if OFF_ROUTE[0] in columns else {})
