"""Lags of roll and load factor from logs of real flights, scored on data that was not fitted."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Drawn
from flighttune.base.arrays import FloatArray, true_spans
from flighttune.base.errors import InputError
from flighttune.base.files.load import A_LOG, LOG, load_one, written
from flighttune.base.units import (
    DEG,
    DEG_PER_RAD,
    G_0,
    Metres,
    MetresPerSecond,
    Radians,
    RadiansPerSecond,
)
from flighttune.control.inner_loop import InnerLag, Order
from flighttune.flight.loop.run import Run
from flighttune.logs.checks import refuse_wrong
from flighttune.logs.log import Columns
from flighttune.vehicles.identification import file as model_file
from flighttune.vehicles.identification import fit
from flighttune.vehicles.identification.identify import AircraftIdentification, identify_aircraft
from flighttune.vehicles.plants.point_mass import turn_rates

CHANNELS: tuple[model_file.Channel, ...] = ("phi", "n_z")

# Minimum change of a command within a stretch that shows the response, rad and 1.
EXCITED = {"phi": 5.0 * DEG, "n_z": 0.1}

STRETCH_S = 5.0  # length of a stretch; errors of different stretches count as independent
SETTLED_S = 3.0  # time after a gap in which the response still depends on the flight before
MIN_STRETCHES = 4
SLOW = 0.5  # share of the median speed below which a vehicle counts as taking off or landing

HELD_S = 0.02  # hold time of commands, which is also the largest age of a sample

MEMORY_S = 0.1  # a residual is predicted over this time, and only the rest is fitted

CONFIDENCE = 0.95
CLEAR = 1.5  # standard errors by which one order must fit better to count as distinct
COARSE = 1.0  # rad: a lag with a larger frequency times sample time is invisible
WIDEST = 3.0  # an interval of the frequency with a larger ratio of its ends is useless
ALIKE = 1e-6  # squared share of a parameter's effect that must be independent of the others
STEP = 1e-4  # step of the parameters for the slopes of the response

MAX_DAMPING = 5.0
BOUNDS: fit.Bounds = (
    (math.log(0.2), 0.0, math.log(0.05), 0.0),
    (math.log(100.0), 1.0, math.log(MAX_DAMPING), 0.0),
)
UNITS = {"phi": DEG, "n_z": 1.0}
NAMES = {"phi": "roll", "n_z": "load-factor"}

# Limits and rate limit, deg and 1, of a channel that is not in the logs or never moves in them
UNSEEN = {"phi": ((-45.0, 45.0), 60.0), "n_z": ((0.5, 1.5), 2.0)}
STILL = 1e-6  # deg/s and 1/s: slopes of a signal that rests are rounding
SHOWN_S = 40.0


class Section(NamedTuple):
    """Samples without a gap, in which a vehicle flies."""

    run: int  # index of its log
    t: FloatArray  # s
    dt: float  # s
    commanded: FloatArray  # linear between samples
    measured: FloatArray
    stretch: FloatArray  # number of the stretch of each sample; NaN if the sample is not used

    def residual(self, lag: InnerLag) -> FloatArray:
        """Response of a lag minus that measured."""
        return response(lag, self.dt, self.commanded, float(self.measured[0])) - self.measured

    def fresh(self, lag: InnerLag, carried: float) -> FloatArray:
        """Residual without the share that is `carried` over from `MEMORY_S` earlier."""
        residual, count = self.residual(lag), max(1, round(MEMORY_S / self.dt))
        return np.append(residual[:count], residual[count:] - carried * residual[:-count])


class ChannelOfLogs(NamedTuple):
    """The lag of one channel."""

    lag: InnerLag
    fit_percent: float  # %: explained share of the variance in stretches that were not fitted
    by_log: tuple[float, ...]  # %: for each log, by the lag of the other logs; empty for one log
    # rad/s and s: intervals of natural frequency and delay; None with a reason
    frequency: tuple[float, float] | None
    delay: tuple[float, float] | None
    reason: str  # why there is no interval
    stretches: int
    sections: tuple[Section, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogIdentification(Drawn):
    """The response of an inner loop from logs."""

    # Content of a model file; None if a channel has no lag
    identified: model_file.IdentifiedAircraft | None
    # Lags by channel, with their intervals
    channels: Mapping[model_file.Channel, ChannelOfLogs]
    untold: Mapping[str, str]  # why a channel cannot be identified, by its name
    names: tuple[str, ...]  # names of the logs
    assumed: tuple[str, ...] = ()  # channels with an assumed bandwidth

    @property
    def title(self) -> str:
        """The logs in words."""
        first, *others = self.names
        return f"{first} and {len(others)} more" if others else first

    @property
    def missing(self) -> str:
        """Why there is no model, and the remedy; empty with a model."""
        if self.identified is not None:
            return ""
        name, reason = next(x for x in self.untold.items() if x[0] not in self.assumed)
        return f"{reason}; assume its bandwidth, --assume {name}=RAD_S, or give logs that show it"

    def save(self, path: str | Path | None = None) -> dict[str, Path | None]:
        """Write model and figure, by default to ``runs/identified``; nothing without a model."""
        if self.identified is None:
            return {"model": None, "figure": None}
        path = path or Path("runs") / "identified" / f"{self.names[0]}.json"
        return model_file.save_with_figure(self.identified, Path(path), self)


def identify(
    source: str | Path | Run,
    *logs: str | Path | Run,
    V_a: Sequence[MetresPerSecond] = (),
    gamma: Sequence[Radians] = (),
    h: Metres = 1000.0,
    seed: int = 0,
    columns: Columns = (),
    assume: Mapping[str, RadiansPerSecond] | None = None,
) -> AircraftIdentification | LogIdentification:
    """Identify the inner loop of an aircraft, by flying it or from logs of real flights.

    An aircraft flies multisines and a manoeuvre at every airspeed with every flight-path angle. The
    lags of a channel have the same order at all conditions, the order that fits them best together.

    Logs take seconds for minutes of flight. Lags are fitted to every stretch in which the command
    changes by 5 deg or 0.1 within 5 s. The score uses stretches that were not fitted: each log by
    the lag of the others, or every second stretch of one log. The intervals, at 95 %, come from the
    jackknife over stretches, to first order. If samples are too coarse for the lag, or if first and
    second order fit alike, there is a reason instead of an interval.

    Parameters
    ----------
    source : str, Path or Run
        A shipped aircraft or the folder of an aircraft; or the log of a real flight (.ulg, .bin,
        .tlog, .csv), ``@START:END`` for a part of it in s.
    logs : str, Path or Run
        Further logs of the same aircraft.
    V_a : sequence of float, m/s
        Airspeeds, by default the design airspeed of the inner loop. The first is the nominal
        airspeed.
    gamma : sequence of float, rad
        Flight-path angles, climb positive, by default level flight, or the glide of an aircraft
        without an engine. The first is the nominal angle.
    h : float, m
        Height above sea level.
    seed : int
        Seed of the excitation.
    columns : mapping or sequence
        Columns of the signals in the logs, as for `load_log`.
    assume : mapping of str to float, rad/s
        Bandwidth of a first-order lag of ``phi`` or ``n_z`` if the logs cannot identify it.

    Returns
    -------
    AircraftIdentification or LogIdentification
        Its `save` writes a model file and a figure. It lists conditions without steady flight, and
        channels that the logs cannot identify.

    Raises
    ------
    InputError, ScenarioError
        If there is no such aircraft, a condition lies outside its envelope, a column is not in a
        log, an assumed channel is not ``phi`` or ``n_z``, or a value does not suit the source.
    TrimError
        If there is no steady flight at any of the conditions.
    PlantError
        If the aircraft cannot be built or excited.
    RecordingError
        If a file is not the log of a flight.

    Examples
    --------
    >>> made = ft.identify("aerosonde", V_a=[25.0], gamma=[0.0])
    >>> made.identified.conditions[0].channels["phi"].fit_percent > 90.0
    True
    >>> import numpy as np, pandas
    >>> t = np.arange(3000) / 25.0
    >>> command, phi = 20.0 * np.sign(np.sin(0.5 * t)), np.zeros(3000)
    >>> for k in range(2999):
    ...     phi[k + 1] = command[k] + np.exp(-4.0 / 25.0) * (phi[k] - command[k])
    >>> table = {"t_s": t, "phi_deg": phi, "phi_cmd_deg": command, "v_north": 20.0, "v_east": 0.0}
    >>> pandas.DataFrame(table).to_csv("flight.csv", index=False)
    >>> found = ft.identify("flight.csv", assume={"n_z": 5.0})
    >>> round(found.channels["phi"].fit_percent)
    100
    >>> found.untold["n_z"]
    'the logs have no load-factor commands; its limits are assumed: 0.5 to 1.5, 2 per s'
    """
    if not isinstance(source, Run):
        source = written(source, LOG, columns=columns) or source
    if logs or isinstance(source, Run):
        if V_a or gamma:
            raise InputError(
                "`V_a` and `gamma` must be absent with a log, which is of its own flight."
            )
        return _identify_logs((source, *logs), columns, assume or {})
    if columns or assume:
        raise InputError("`columns` and `assume` must be absent with an aircraft, which is flown.")
    return identify_aircraft(source, V_a=V_a, gamma=gamma, h=h, seed=seed)


def _identify_logs(
    logs: Sequence[str | Path | Run], columns: Columns, assume: Mapping[str, float]
) -> LogIdentification:
    if set(assume) - set(CHANNELS):
        raise InputError(f"`assume` must name phi or n_z, got {', '.join(assume)}.")
    runs = [load_one(log, A_LOG, LOG, columns=columns) for log in logs]
    refuse_wrong(*runs)
    channels: dict[model_file.Channel, ChannelOfLogs] = {}
    untold: dict[str, str] = {}
    for name in CHANNELS:
        channel = _channel(runs, name)
        if isinstance(channel, str):
            (low, high), rate = UNSEEN[name]
            limits = f"; its limits are assumed: {low:g} to {high:g}, {rate:g} per s"
            unseen = _range(runs, name) is UNSEEN[name]
            untold[name] = channel + limits if unseen else channel
        else:
            channels[name] = channel
    names = tuple(dict.fromkeys(str(run.provenance.gains_name) for run in runs))
    identified = None
    if set(untold) <= set(assume):
        identified = _aircraft(runs, names, channels, assume)
    return LogIdentification(
        identified=identified, channels=channels, untold=untold, names=names, assumed=(*assume,)
    )


def speed_of(run: Run) -> FloatArray:
    """Airspeed, or ground speed without an airspeed, m/s."""
    return run.signals["V_a" if "V_a" in run.signals else "V_g"].to_numpy(dtype=float)


def flying(run: Run, *columns: FloatArray) -> npt.NDArray[np.bool_]:
    """Whether a vehicle flies at each sample, without take-off, landing and gaps of `columns`."""
    speed = speed_of(run)
    return np.isfinite([*columns, speed]).all(axis=0) & (speed > SLOW * np.nanmedian(speed))


def _sections(run: Run, number: int, name: model_file.Channel, first: int) -> Iterator[Section]:
    """Sections of a run, with stretches from `first` on."""
    measured, commanded = (run.signals[key].to_numpy(dtype=float) for key in (name, f"{name}_cmd"))
    dt = float(run.t[1] - run.t[0])
    wait, size = round(SETTLED_S / dt), round(STRETCH_S / dt)
    for begin, end in true_spans(flying(run, measured, commanded)):
        if end - begin < wait + size // 2:
            continue
        command, stretch = commanded[begin:end], np.full(end - begin, np.nan)
        for low in range(wait, end - begin - size // 2 + 1, size):
            piece = slice(low, low + size)
            if np.ptp(command[piece]) > EXCITED[name]:
                stretch[piece] = first
                first += 1
        if np.isfinite(stretch).any():
            yield Section(number, run.t[begin:end], dt, command, measured[begin:end], stretch)


def response(lag: InnerLag, dt: float, commanded: FloatArray, start: float) -> FloatArray:
    """Response of a lag, at rest at `start`, to commands that are held for about `HELD_S`."""
    # Control loops are faster than logs, so commands between samples are interpolated. Each command
    # is held from half its time before to half after, since a sample may have any age.
    parts, count = math.ceil(dt / HELD_S - 1e-6), len(commanded)
    held = np.interp(np.arange(parts * (count - 1) + 1) / parts, np.arange(count), commanded)
    return fit.lag_response(lag, 0.5 * dt / parts, np.repeat(held, 2)[1:], start)[:: 2 * parts]


# Mask of the fitted samples; None for all.
Side: TypeAlias = npt.NDArray[np.bool_] | None


class _Excited:
    """All sections of a channel, with their samples concatenated, and lags fitted to them."""

    def __init__(self, sections: Sequence[Section]) -> None:
        self.sections = sections
        self.stretch = np.concatenate([section.stretch for section in sections])
        self.used = np.isfinite(self.stretch)
        self.count = 1 + int(np.nanmax(self.stretch))
        self._carried = 0.0
        # Turbulence lasts, and the autopilot responds to it. Only the fresh part of a residual is
        # independent of the commands before it.
        self._carried = self._share_carried(self.fitted(2))

    def residual(self, lag: InnerLag) -> FloatArray:
        """Response of a lag minus that measured."""
        return np.concatenate([section.residual(lag) for section in self.sections])

    def fresh(self, lag: InnerLag) -> FloatArray:
        """Residual of a lag without the part carried over."""
        return np.concatenate([section.fresh(lag, self._carried) for section in self.sections])

    def _share_carried(self, lag: InnerLag) -> float:
        """Share of the residual of a lag that remains after `MEMORY_S`."""
        both = whole = 0.0
        for section in self.sections:
            used = np.isfinite(section.stretch)
            residual = section.residual(lag)
            both += float((residual - section.fresh(lag, 1.0))[used] @ residual[used])
            whole += float(residual[used] @ residual[used])
        return both / whole if whole > 0.0 else 0.0

    def fitted(self, order: Order, side: Side = None, damping: float = MAX_DAMPING) -> InnerLag:
        """The least-squares lag over stretches of one side, with at most the damping `damping`."""
        lower, (frequency, delay, _, after) = BOUNDS
        bounds = lower, (frequency, delay, math.log(damping), after)
        used = self.used if side is None else self.used & side
        return fit.best_lag(lambda lag: self.fresh(lag)[used], order, fit.TIME_STARTS, bounds)[0]

    def chosen(self) -> tuple[InnerLag, bool]:
        """The lag of the order that fits best, and whether the other order fits clearly worse."""

        def clear(worse: InnerLag, better: InnerLag) -> bool:
            gain = (self.fresh(worse) ** 2 - self.fresh(better) ** 2)[self.used]
            gains = np.bincount(self.stretch[self.used].astype(int), gain, minlength=self.count)
            return bool(gains.sum() > CLEAR * math.sqrt(self.count) * gains.std())

        first, second = (self.fitted(order) for order in (1, 2))
        if clear(first, second):
            return second, True
        # The second order approaches the first as damping grows, so only less damping is distinct.
        return first, clear(self.fitted(2, damping=1.0), first)

    def interval(self, lag: InnerLag) -> FloatArray:
        """Ends of the interval of each parameter of the lag, shape (2, parameters)."""
        centre, here = fit.parameters(lag), self.fresh(lag)
        steps = STEP * np.eye(len(centre))
        ahead = [self.fresh(fit.with_parameters(centre + step, lag.order)) for step in steps]
        jacobian = (np.column_stack(ahead) - here[:, None]) / STEP
        stretches = [self.stretch == number for number in range(self.count)]
        normal = np.array([jacobian[there].T @ jacobian[there] for there in stretches])
        slope = np.array([jacobian[there].T @ here[there] for there in stretches])
        return interval_of(centre, normal, slope, np.eye(len(centre))[1])


def _channel(runs: Sequence[Run], name: model_file.Channel) -> ChannelOfLogs | str:
    """The lag of a channel, or why the logs cannot identify it."""
    if not (there := [run for run in runs if {name, f"{name}_cmd"} <= set(run.signals)]):
        return f"the logs have no {NAMES[name]} commands"
    sections: list[Section] = []
    count = 0
    for number, run in enumerate(there):
        sections += _sections(run, number, name, count)
        count = 1 + int(max((np.nanmax(section.stretch) for section in sections), default=-1))
    if count < MIN_STRETCHES:
        least = f"{EXCITED[name] / UNITS[name]:g}"
        if name == "phi":
            least += " deg"
        return (
            f"{NAMES[name]} commands changed by more than {least} in {count} stretches of "
            f"{STRETCH_S:g} s without a gap, and must in {MIN_STRETCHES}"
        )
    excited = _Excited(sections)
    lag, distinct = excited.chosen()
    numbers = np.concatenate([np.full(len(section.t), section.run) for section in sections])
    measured = np.concatenate([section.measured for section in sections])
    logs = np.unique(numbers)
    sides = [numbers == log for log in logs]
    if len(logs) == 1:
        sides = [excited.stretch % 2 == fold for fold in (0, 1)]
    shares = []  # unexplained and total variance of every log, or of half the stretches of one
    for side in sides:
        missed = excited.residual(excited.fitted(lag.order, ~side))[side & excited.used]
        shares.append((float(np.sum(missed**2)), _variation(measured[side & excited.used])))
    total = sum(_variation(each.measured[np.isfinite(each.stretch)]) for each in sections)
    if not total > 0.0:
        return f"{NAMES[name]} rests while its commands change"
    low, high = excited.interval(lag)
    dt = max(section.dt for section in sections)
    width = float(high[0] - low[0])
    reason = _why_no_range(lag, dt, width, distinct=distinct)
    return ChannelOfLogs(
        lag=lag,
        fit_percent=100.0 * (1.0 - sum(missed for missed, _ in shares) / total),
        by_log=tuple(100.0 * (1.0 - missed / part) for missed, part in shares if len(logs) > 1),
        frequency=None if reason else (math.exp(low[0]), math.exp(high[0])),
        delay=None if reason else (max(0.0, float(low[1])), max(0.0, float(high[1]))),
        reason=reason,
        stretches=count,
        sections=tuple(sections),
    )


def _why_no_range(lag: InnerLag, dt: float, width: float, *, distinct: bool) -> str:
    """Why logs of this sample time (s) give no interval of a lag; empty if they do.

    `width`: logarithm of the ratio of the ends of the natural frequency's interval.
    """
    at_end = np.isclose(lag.natural_frequency, np.exp([edge[0] for edge in BOUNDS]), rtol=0.01)
    if at_end.any() or lag.delay > 0.99 * BOUNDS[1][1]:
        ends = f"{lag.natural_frequency:.3g} rad/s behind {lag.delay:.2g} s"
        return f"the best fit, {ends}, is at an end of its range"
    if dt * lag.natural_frequency > COARSE:
        return f"a sample every {dt:.2g} s is too coarse for {lag.natural_frequency:.3g} rad/s"
    if not distinct:
        return "first and second order fit alike"
    wide = f"its ends would differ by more than a factor of {WIDEST:g}"
    return wide if width > math.log(WIDEST) else ""


def _variation(values: FloatArray) -> float:
    """Sum of the squares of distances from the mean."""
    return float(np.sum((values - values.mean()) ** 2))


def interval_of(
    best: FloatArray, normal: FloatArray, slope: FloatArray, late: FloatArray
) -> FloatArray:
    """Ends of the interval of each of n parameters, shape (2, n), at `CONFIDENCE`.

    A jackknife over stretches, since errors of stretches are independent and errors of samples are
    not. It takes one Gauss-Newton step from `best` to all stretches but one, and Student's t with
    the effective number of stretches. `normal` and `slope`, shapes (stretches, n, n) and
    (stretches, n): sums over a stretch. `late`, shape (n,): change of each parameter if commands
    come one second later. Infinite for a parameter without an effect of its own.
    """
    from scipy.stats import t as student

    count, whole = len(normal), normal.sum(axis=0)
    tiny = np.finfo(float).tiny
    size = np.sqrt(np.maximum(np.diagonal(whole), tiny))
    effects, ways = np.linalg.eigh(whole / np.outer(size, size))
    alike = (np.abs(ways[:, effects < ALIKE]) > 0.1).any(axis=1)
    rest = whole - normal + (1e-12 * np.trace(whole) + tiny) * np.eye(len(whole))
    steps = np.linalg.solve(rest, (slope.sum(axis=0) - slope)[..., None])[..., 0]
    error = np.sqrt(count - 1) * steps.std(axis=0)
    information = np.diagonal(normal, axis1=1, axis2=2)
    shares = information / np.maximum(information.sum(axis=0), tiny)
    freedom = np.maximum(1.0, 1.0 / np.maximum((shares**2).sum(axis=0), 1.0 / count) - 1.0)
    # The age of command samples is one unknown number, uniform up to `HELD_S`.
    aged = 0.5 * CONFIDENCE * HELD_S * late
    width = np.hypot(student.ppf(0.5 + 0.5 * CONFIDENCE, freedom) * error, aged)
    width = np.where(alike, np.inf, width)
    return np.array([best - width, best + width])


def _aircraft(
    runs: Sequence[Run],
    names: tuple[str, ...],
    channels: Mapping[model_file.Channel, ChannelOfLogs],
    assume: Mapping[str, float],
) -> model_file.IdentifiedAircraft:
    """The content of a model file: lags, observed limits, and their source."""
    tables: dict[model_file.Channel, model_file.IdentifiedChannel] = {}
    lags: list[InnerLag] = []
    for name in CHANNELS:
        channel = channels.get(name)
        lag = channel.lag if channel else InnerLag(order=1, natural_frequency=assume[name])
        percent = channel.fit_percent if channel else 0.0
        residual = math.sqrt(max(0.0, 1.0 - percent / 100.0))
        tables[name] = model_file.IdentifiedChannel.of(lag, fit_percent=percent, residual=residual)
        lags.append(lag)
    speeds = np.concatenate([speed_of(run) for run in runs])
    heights = [run.signals["h"].to_numpy(dtype=float) for run in runs if "h" in run.signals]
    h = float(np.nanmedian(np.concatenate(heights))) if heights else 0.0
    V_a = float(np.nanmedian(speeds[speeds > SLOW * np.nanmedian(speeds)]))
    condition = model_file.IdentifiedCondition.model_construct(
        V_a=V_a, gamma=0.0, h=round(h, 1), channels=tables
    )
    ranges = {name: _range(runs, name) for name in CHANNELS}
    (phi, phi_rate), (n_z, n_z_rate) = ranges.values()
    missed = np.concatenate([_missed(run, lags) for run in runs])
    largest = dict(zip(("chi", "gamma"), missed.max(axis=0, initial=0.0).tolist(), strict=True))
    seen = {"phi_deg": phi, "phi_rate_dps": phi_rate, "n_z": n_z, "n_z_rate_per_s": n_z_rate}
    evidence = model_file.LogEvidence.model_construct(
        logs=names,
        assumed=tuple(name for name in CHANNELS if name not in channels),
        frequency_95_rad_s={n: c.frequency for n, c in channels.items() if c.frequency},
        delay_95_s={n: c.delay for n, c in channels.items() if c.delay},
        stretches={name: channel.stretches for name, channel in channels.items()},
        **seen,
        residual_rad_s=largest if len(missed) else None,
        residual_stretches=len(missed),
        limits_assumed=tuple(name for name in CHANNELS if ranges[name] is UNSEEN[name]),
    )
    return model_file.IdentifiedAircraft.model_construct(
        aircraft=names[0], conditions=(condition,), log=evidence
    )


def _missed(run: Run, lags: Sequence[InnerLag]) -> FloatArray:
    """Largest 1 s means of the residual rates in each stretch, shape (stretches, 2), rad/s.

    The exact point mass flies at the airspeed of the log.
    """
    names = ("phi_cmd", "n_z_cmd", "phi", "n_z", "chi", "gamma")
    if not set(names) <= set(run.signals):
        return np.zeros((0, 2))
    columns, V_a = run.signals[list(names)].to_numpy(dtype=float).T, speed_of(run)
    dt = float(run.t[1] - run.t[0])
    wait, size, span = (round(time / dt) for time in (SETTLED_S, STRETCH_S, 1.0))
    largest = [np.zeros((0, 2))]
    for begin, end in true_spans(flying(run, *columns)):
        if end - begin <= wait + size + span:
            continue
        piece = slice(begin, end)
        phi, n_z = (
            response(lag, dt, columns[i, piece], float(columns[i + 2, begin]))
            for i, lag in enumerate(lags)
        )
        gamma = columns[5, piece]
        rates = np.array(turn_rates(V_a[piece], gamma, phi, n_z, turn="exact", g=G_0))
        angles = np.array([np.unwrap(columns[4, piece]), gamma])
        turned = dt * (np.cumsum(rates, axis=1) - 0.5 * rates)  # trapezoidal rule, up to a constant
        missed = angles[:, span:] - angles[:, :-span] - (turned[:, span:] - turned[:, :-span])
        mean = np.abs(missed[:, wait:]) / (span * dt)
        count = mean.shape[1] // size
        largest.append(mean[:, : count * size].reshape(2, count, size).max(axis=2).T)
    return np.concatenate(largest)


def _range(runs: Sequence[Run], name: str) -> tuple[tuple[float, float], float]:
    """Observed range of a command, else of the response, and the fastest observed response.

    Both are those of `UNSEEN` for a channel that the logs do not have, or that never moves in them.
    """
    unit = DEG_PER_RAD if name == "phi" else 1.0
    values, rates = [np.zeros(0)], [np.zeros(0)]
    for run in runs:
        key = f"{name}_cmd" if f"{name}_cmd" in run.signals else name
        if key in run.signals and name in run.signals:
            values.append(unit * run.signals[key].dropna().to_numpy())
            change = np.gradient(run.signals[name].to_numpy(dtype=float), run.t)
            rates.append(np.abs(unit * change[np.isfinite(change)]))
    observed, moved = np.concatenate(values), np.concatenate(rates)
    if not (len(observed) and len(moved)) or (rate := float(np.percentile(moved, 99.0))) < STILL:
        return UNSEEN[name]
    low, high = np.percentile(observed, (0.5, 99.5))
    return (float(low), float(high)), rate
