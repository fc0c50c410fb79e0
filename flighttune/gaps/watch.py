"""Signals that a healthy flight makes expect, and how far another flight is from them.

Every signal that is expected is a sum of terms, each a product of other signals, with weights that
flights teach. Its residual is the signal minus this sum, both behind a lag; a residual beyond its
limit is an alarm.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.files.value import STRICT
from flighttune.simulate.run import Run

# Lag through which all terms go, s: a rate is what a signal has ahead of its own lag, over it.
LAG_S = 0.5

# Quantities of terms besides the signals themselves.
ANGLES = {"cos_phi": (np.cos, "phi"), "sin_phi": (np.sin, "phi"), "sin_gamma": (np.sin, "gamma")}

# Operation and factor of a term: a quantity, or the rate of a signal.
FACTOR = re.compile(r"([*/]?)(d\()?(\w+)\)?")


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalModel:
    """The expected value of a signal: the weighted sum of terms, in SI."""

    name: str
    target: str
    terms: tuple[str, ...]
    mean_s: float = 0.0  # lag of the residual itself, s
    weights: tuple[float, ...] = ()

    __pydantic_config__: ClassVar = STRICT

    @property
    def signals(self) -> set[str]:
        """Signals that it needs."""
        names = {x[3] for text in (self.target, *self.terms) for x in FACTOR.finditer(text)} - {"1"}
        return {ANGLES[name][1] if name in ANGLES else name for name in names}


def _model(name: str, target: str, terms: str, mean_s: float = 0.0) -> SignalModel:
    return SignalModel(name=name, target=target, terms=tuple(terms.split()), mean_s=mean_s)


# Of models of one name the first counts whose signals there are. In words: the airspeed is that
# commanded; the elevator carries lift at this dynamic pressure; throttle, less drag and less what
# accelerates, climbs; roll follows its command behind a lag; the nose turns with the roll.
_ELEVATOR = "1 n_z/V_a/V_a q/V_a"
MODELS = (
    _model("airspeed", "V_err", "1"),
    _model("airspeed", "V_a", "1"),
    _model("elevator", "elevator", _ELEVATOR),
    _model("trim", "elevator", _ELEVATOR, 5.0),
    _model("climb", "V_g*sin_gamma/V_a", "1 throttle n_z*n_z/V_a/V_a V_a*V_a d(V_a)"),
    _model("roll", "d(phi)", "1 phi_cmd phi"),
    _model("turn", "r", "1 sin_phi/V_a p"),
    _model("turn", "r", "1 sin_phi/V_g p"),
)


def models_of(signals: Collection[str]) -> tuple[SignalModel, ...]:
    """The models whose signals there are, one of each name."""
    there = [model for model in MODELS if model.signals <= {*signals}]
    return tuple({model.name: model for model in reversed(there)}.values())[::-1]


def lagged(values: FloatArray, dt: float, lag: float, start: float | None = None) -> FloatArray:
    """Values behind a first-order lag (s), sampled every `dt` (s), from `start` or the first."""
    from scipy.signal import lfilter

    if not lag:
        return values
    keep = float(np.exp(-dt / lag))
    before = values[0] if start is None else start
    lagging, _ = lfilter([1.0 - keep], [1.0, -keep], values, zi=[keep * before])
    return lagging


class _Terms:
    """Terms over the samples of a run; gaps of a log keep the value before them."""

    def __init__(self, run: Run) -> None:
        self.dt = run.duration / (len(run.signals) - 1)
        self._signals = run.signals
        self._known: dict[str, FloatArray] = {"1": np.ones(len(run.signals))}

    def _quantity(self, name: str) -> FloatArray:
        if name not in self._known:
            function, signal = ANGLES.get(name, (np.positive, name))
            self._known[name] = function(self._signals[signal].ffill().bfill().to_numpy(float))
        return self._known[name]

    def of(self, text: str) -> FloatArray:
        """Values of a term behind its lag, shape (n,)."""
        total, rates = np.ones(len(self._signals)), False
        for operation, rate, name in FACTOR.findall(text):
            factor = self._quantity(name)
            if rate:
                factor, rates = (factor - lagged(factor, self.dt, LAG_S)) / LAG_S, True
            total = total / factor if operation == "/" else total * factor
        return total if rates else lagged(total, self.dt, LAG_S)


def moments(models: Sequence[SignalModel], run: Run) -> list[FloatArray]:
    """Products of all terms and the target of each model, summed over a run."""
    terms, products = _Terms(run), []
    for model in models:
        columns = np.array([terms.of(text) for text in (*model.terms, model.target)])
        products.append(columns @ columns.T)
    return products


def taught(
    models: Sequence[SignalModel], flights: Iterable[Sequence[FloatArray]]
) -> tuple[SignalModel, ...]:
    """The models with the weights of least squares over flights, from their `moments`."""
    learned = []
    for model, *products in zip(models, *flights, strict=True):
        total = np.sum(products, axis=0)
        scale = np.sqrt(np.maximum(np.diag(total)[:-1], np.finfo(float).tiny))
        scaled = total[:-1, :-1] / np.outer(scale, scale)
        weights, *_ = np.linalg.lstsq(scaled, total[:-1, -1] / scale, rcond=1e-12)
        learned.append(replace(model, weights=tuple((weights / scale).tolist())))
    return tuple(learned)


def residuals(models: Sequence[SignalModel], run: Run) -> FloatArray:
    """The part of its target that each model misses over a run, shape (n, models)."""
    terms, columns = _Terms(run), []
    for model in models:
        missing = terms.of(model.target)
        for weight, text in zip(model.weights, model.terms, strict=True):
            missing = missing - weight * terms.of(text)
        columns.append(lagged(missing, terms.dt, model.mean_s, 0.0))
    return np.column_stack(columns)


class Alarm(NamedTuple):
    """When a flight is first outside of what is expected of it, and why."""

    at_s: float
    why: str  # name of the model


@dataclass(frozen=True, kw_only=True, eq=False)
class Watch:
    """Models and the limits of their residuals: a score above 1 is an alarm."""

    models: tuple[SignalModel, ...]
    middle: FloatArray  # (models,)
    half: FloatArray  # (models,)

    def scores(self, run: Run) -> FloatArray:
        """Distance of each residual from its middle over its limit, shape (n, models)."""
        return np.abs(residuals(self.models, run) - self.middle) / self.half

    def alarm(self, run: Run) -> Alarm | None:
        """The first alarm of a run; None if there is none."""
        scores = self.scores(run)
        above = np.flatnonzero(scores.max(axis=1) > 1.0)
        if not len(above):
            return None
        first = above[0]
        return Alarm(float(run.t[first] - run.t[0]), self.models[int(scores[first].argmax())].name)


def units_of(models: Sequence[SignalModel], units: Mapping[str, str]) -> dict[str, str]:
    """Unit of the residual of each model; those of rates are theirs over a second."""
    return {x.name: RESIDUAL_UNITS.get(x.name) or units.get(x.target, "") for x in models}


RESIDUAL_UNITS = {"climb": "1", "roll": "rad/s"}
