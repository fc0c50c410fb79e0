"""Models of a healthy flight's signals, and the residuals of another flight.

The expected value of a signal is a weighted sum of terms, each a product of other signals; flights
teach the weights. The residual is the signal minus this sum, both behind a lag. A residual beyond
its limit is an alarm.
"""

import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.table import STRICT
from flighttune.base.units import G_0
from flighttune.flight.loop.run import Alarm, Run

# Filter time constant of all terms, s; a rate is (signal - filtered signal) / time constant.
LAG_S = 0.5

# Error of airspeed at which a throttle is nearly full or idle, m/s.
SLOW = 1.5


def _slow(V_err: FloatArray) -> FloatArray:
    """Opening of a throttle that holds airspeed: 0 far above the commanded airspeed, 1 below."""
    return 0.5 * (1.0 + np.tanh(V_err / SLOW))


def _excess(f_x: FloatArray, n_z: FloatArray, theta: FloatArray, gamma: FloatArray) -> FloatArray:
    """Thrust minus drag over weight: specific force along the path, wings level."""
    return f_x / G_0 - n_z * (np.sin(theta) - np.sin(gamma))


# Quantities of terms besides the signals themselves, and the signals that they need.
QUANTITIES: Mapping[str, tuple[Callable[..., FloatArray], str]] = {
    "cos_phi": (np.cos, "phi"),
    "sin_phi": (np.sin, "phi"),
    "sin_gamma": (np.sin, "gamma"),
    "slow": (_slow, "V_err"),
    "to_roll": (np.subtract, "phi_cmd phi"),
    "to_pitch": (np.subtract, "theta_cmd theta"),
    "excess": (_excess, "f_x n_z theta gamma"),
}

# Operation and factors of a term: a quantity, or the rate of a signal.
FACTOR = re.compile(r"([*/]?)(d\()?(\w+)\)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalModel:
    """The expected value of a signal: the weighted sum of terms, in SI."""

    name: str
    target: str
    terms: tuple[str, ...]
    mean_s: float = 0.0  # lag of the residual itself, s
    past_s: float = 0.0  # lag of its own past that is subtracted, s; 0: none
    room: float = 1.0  # factor on its limit, larger if healthy flights differ much
    loss: bool = False  # whether only values below the expected value count
    weights: tuple[float, ...] = ()

    __pydantic_config__: ClassVar = STRICT

    @property
    def filtered(self) -> bool:
        """Whether its residual has a filter of its own."""
        return bool(self.mean_s or self.past_s or self.loss)

    @property
    def signals(self) -> set[str]:
        """Signals that it needs."""
        names = {x[3] for text in (self.target, *self.terms) for x in FACTOR.finditer(text)} - {"1"}
        return {x for name in names for x in QUANTITIES.get(name, (None, name))[1].split()}


def _model(name: str, target: str, terms: str, **options: Any) -> SignalModel:
    return SignalModel(name=name, target=target, terms=tuple(terms.split()), **options)


# Of models with the same name, the first whose signals exist counts. In words: the airspeed equals
# its command; airspeed and ground speed change together; the elevator balances lift at the dynamic
# pressure; throttle less drag and acceleration gives climb; roll follows its command behind two
# lags; the nose turns with the roll. Mass, lift and trim differ from flight to flight, which would
# hide a change within a flight, so elevator and power are compared with their own past.
_ELEVATOR = "1 n_z/V_a/V_a q/V_a"
_CLIMB, _POWER = "V_g*sin_gamma/V_a", "1 throttle n_z*n_z/V_a/V_a V_a*V_a"
MODELS = (
    _model("airspeed", "V_err", "1"),
    _model("airspeed", "V_a", "1"),
    _model("speed change", "d(V_a)", "1 d(V_g)", room=1.1),
    _model("elevator", "elevator", _ELEVATOR, past_s=20.0),
    _model("trim", "elevator", _ELEVATOR, mean_s=5.0, room=1.2),
    _model("climb", _CLIMB, f"{_POWER} d(V_a)"),
    _model("power", _CLIMB, f"{_POWER} d(V_g)", past_s=3.0),
    _model("roll", "p", "1 phi_cmd phi d(p) d(phi_cmd)"),
    _model("turn", "r", "1 sin_phi/V_a p"),
    _model("turn", "r", "1 sin_phi/V_g p"),
)
# Models that come first for logs, whose sensors are coarser and whose commands jump: thrust exceeds
# drag if the flight is too slow, more so in a climb; there is no side force; the roll rate follows
# the roll error behind a lag, and the pitch rate the pitch error. Only a loss of thrust counts:
# thrust often exceeds its expected value, because the throttle opens for height too.
OF_LOGS = (
    _model("airspeed", "V_err", "1", room=1.5),
    _model("thrust", "slow*excess", "slow slow*sin_gamma", loss=True),
    _model("side force", "f_y", "1 phi"),
    _model("roll", "p", "1 to_roll d(p)", mean_s=4.0),
    _model("pitch", "d(theta)", "1 to_pitch", mean_s=4.0, room=1.2),
    _model("turn", "r", "1 sin_phi p"),
    *MODELS,
)


def signals_of(models: Iterable[SignalModel]) -> list[str]:
    """Signals that models need."""
    return sorted(set[str]().union(*(model.signals for model in models)))


def models_of(
    signals: Collection[str], models: Sequence[SignalModel] = MODELS
) -> tuple[SignalModel, ...]:
    """The models whose signals exist, one of each name."""
    there = [model for model in models if model.signals <= {*signals}]
    return tuple({model.name: model for model in reversed(there)}.values())[::-1]


def lagged(values: FloatArray, dt: float, lag: float, start: float | None = None) -> FloatArray:
    """Values behind a first-order lag (s), sampled every `dt` (s), with an initial value."""
    from scipy.signal import lfilter

    if not lag:
        return values
    keep = float(np.exp(-dt / lag))
    before = values[0] if start is None else start
    lagging, _ = lfilter([1.0 - keep], [1.0, -keep], values, zi=[keep * before])
    return lagging


def dt_of(run: Run) -> float:
    """Sample time of a run, s."""
    return run.duration / (len(run.signals) - 1)


@np.errstate(divide="ignore", invalid="ignore")
def columns_of(models: Sequence[SignalModel], run: Run, from_s: float = 0.0) -> list[FloatArray]:
    """The terms of each model, followed by its target, from a time on, each (terms + 1, n)."""
    if not run.duration > from_s:
        raise InputError(f"{run.label}: must be over {from_s:g} s long, got {run.duration:.1f} s.")
    dt, columns = dt_of(run), []
    # Terms use the measured values of sensors. Gaps of a log keep the value before them.
    quantities = {"1": np.ones(len(run.signals))}

    def quantity(name: str) -> FloatArray:
        if name not in quantities:
            function, signals = QUANTITIES.get(name, (np.positive, name))
            measured = (f"{x}_meas" if f"{x}_meas" in run.signals else x for x in signals.split())
            taken = (run.signals[x].ffill().bfill().to_numpy(float) for x in measured)
            quantities[name] = function(*taken)
        return quantities[name]

    def term(text: str) -> FloatArray:
        total, rates = quantities["1"], False
        for operation, rate, name in FACTOR.findall(text):
            factor = quantity(name)
            if rate:
                factor, rates = (factor - lagged(factor, dt, LAG_S)) / LAG_S, True
            total = total / factor if operation == "/" else total * factor
        return total if rates else lagged(total, dt, LAG_S)

    for model in models:
        column = np.array([term(text) for text in (*model.terms, model.target)])
        if not np.isfinite(column).all():
            raise InputError(
                f"{run.label}: {', '.join(sorted(model.signals))} must be finite, and an airspeed "
                "positive; LOG@airborne and LOG@START:END are parts of a log."
            )
        columns.append(column[:, round(from_s / dt) :])
    return columns


def moments(columns: Sequence[FloatArray]) -> list[FloatArray]:
    """Products of all terms and the target of each model, summed over the samples."""
    return [each @ each.T for each in columns]


def taught(
    models: Sequence[SignalModel], flights: Iterable[Sequence[FloatArray]]
) -> tuple[SignalModel, ...]:
    """The models with least-squares weights over flights, from their `moments`."""
    learned = []
    for model, *products in zip(models, *flights, strict=True):
        total = np.sum(products, axis=0)
        scale = np.sqrt(np.maximum(np.diag(total)[:-1], np.finfo(float).tiny))
        scaled = total[:-1, :-1] / np.outer(scale, scale)
        weights, *_ = np.linalg.lstsq(scaled, total[:-1, -1] / scale, rcond=1e-12)
        learned.append(replace(model, weights=tuple((weights / scale).tolist())))
    return tuple(learned)


def residuals(
    models: Sequence[SignalModel], columns: Sequence[FloatArray], dt: float
) -> FloatArray:
    """The residual of each model, shape (n, models)."""
    residual = []
    for model, each in zip(models, columns, strict=True):
        missing = each[-1] - np.array(model.weights) @ each[:-1]
        past = lagged(missing, dt, model.past_s) if model.past_s else 0.0
        missing = lagged(missing, dt, model.mean_s, 0.0) - past
        residual.append(np.minimum(missing, 0.0) if model.loss else missing)
    return np.column_stack(residual)


@dataclass(frozen=True, kw_only=True, eq=False)
class Watch:
    """Models and the limits of their residuals: a score above 1 is an alarm."""

    models: tuple[SignalModel, ...]
    middle: FloatArray  # (models,)
    half: FloatArray  # (models,)
    from_s: float = 0.0  # time before which nothing is judged

    def scores(self, run: Run) -> FloatArray:
        """Distance of each residual from its middle divided by its limit, shape (n, models)."""
        if lacking := [name for name in signals_of(self.models) if name not in run.signals]:
            raise InputError(f"{run.label}: must have {', '.join(lacking)} to be watched.")
        missing = residuals(self.models, columns_of(self.models, run, self.from_s), dt_of(run))
        return np.abs(missing - self.middle) / self.half

    def alarm(self, run: Run) -> Alarm | None:
        """The first alarm of a run; None if there is none."""
        scores = self.scores(run)
        above = np.flatnonzero(scores.max(axis=1) > 1.0)
        if not len(above):
            return None
        first = above[0]
        at_s = self.from_s + first * dt_of(run)
        return Alarm(float(at_s), self.models[int(scores[first].argmax())].name)


def score_so_far(watches: Sequence[Watch], run: Run) -> FloatArray:
    """Running maximum of the score at each judged sample, the smallest of all watches."""
    return np.min([np.maximum.accumulate(x.scores(run).max(axis=1)) for x in watches], axis=0)


def units_of(models: Sequence[SignalModel], units: Mapping[str, str]) -> dict[str, str]:
    """Unit of the residual of each model: the unit of its target, if it has no own."""
    return {x.name: RESIDUAL_UNITS.get(x.name) or units.get(x.target, "") for x in models}


RESIDUAL_UNITS = {"climb": "1", "power": "1", "speed change": "m/s²"}
