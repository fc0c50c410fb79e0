"""Monitors of flights: false alarms counted in healthy flights, or limits learned from logs."""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.endings import why_ended
from flighttune.base.errors import InputError, naming
from flighttune.base.files.array import TEXT, read_arrays, write_sealed
from flighttune.base.files.load import sealed_bytes
from flighttune.base.files.table import STRICT, json_object, tables_of, value_of
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.base.words import listed, number
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.rows import fly_group
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.about import About, Of
from flighttune.claims.counted import Counted, flown_by
from flighttune.claims.measured import SAME, Measured
from flighttune.claims.shape import MIN_LEARNED
from flighttune.control.theory.exact import Check, Verification
from flighttune.flight.entry import Entry
from flighttune.flight.loop.run import SCORE, Alarm, Bounds, Kind, Run, RunClaim
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps import watch as watching
from flighttune.logs.checks import refuse_wrong

MIN_LOGS = 3
# Unjudged beginning of a log, s: an autopilot that takes over has a transient.
SETTLED_S = 8.0
# Maximum share of a log's samples in another log: above it, one log is part of the other.
SHARED = 0.9
DIGITS = 12  # rounding of these samples, since interpolation between samples rounds
SMALLEST = 1e-12  # minimum limit (SI) and score, so that rounding is not an alarm

# Keys of a scenario that simulate a failure.
FAULTS = "plant.airframe.fault", "plant.throttle_max"

HELD = (
    "Weights, limits and scores follow from the moments and the largest residuals in the file, and "
    "the logs differ. That these are those of different healthy flights is only seen with the "
    "logs: `flighttune verify FILE --log LOG`, for each of them."
)
NOT_HELD = (
    "not checked: the file, of flighttune 0.4.0, does not hold what its weights, limits and scores "
    "follow from; `--log LOG`, for each of its logs, finds them again"
)


class Watching(Answering):
    """A monitor as a claim about runs: the running maximum of the score, above 1 after an alarm."""

    __slots__ = ()

    @property
    def sentence(self) -> str:
        """The claim in words."""
        raise NotImplementedError

    @property
    def watches(self) -> tuple[watching.Watch, ...]:
        """Models and limits; all of them must alarm."""
        raise NotImplementedError

    def alarm(self, run: Run) -> Alarm | None:
        """First time and reason of an alarm in a run; None without an alarm."""
        alarms = [alarm for watch in self.watches if (alarm := watch.alarm(run)) is not None]
        return max(alarms) if len(alarms) == len(self.watches) else None

    def why_not(self, run: Run) -> str:
        """Why the monitor cannot score a run; empty if the run has the watched signals."""
        if SCORE in run.signals:
            return "another monitor has scored it"
        needed = watching.signals_of(self.watches[0].models)
        lacking = [name for name in needed if name not in run.signals]
        return f"it must have {', '.join(lacking)} to be watched" if lacking else ""

    def not_about(self, run: Run) -> str:
        """Why the claim does not cover a scored run; empty if it does."""
        raise NotImplementedError

    def not_counted(self, entry: Entry) -> str:
        """First difference of a scenario's flights from the counted ones; logs are of none."""
        del entry
        return ""

    def on(self, run: Run) -> RunClaim:
        """The score of a run with the watched signals, at most 1 without an alarm."""
        no_claim, score = self.not_about(run), watching.score_so_far(self.watches, run)
        score = np.concatenate([np.zeros(len(run.signals) - len(score)), score])  # unjudged
        limit = np.ones((len(score), 1))
        return RunClaim(
            kind="counted",
            title="limit of the monitor",
            sentence=self.sentence,
            bounds=Bounds(run.t, np.zeros_like(limit), limit, (SCORE,)),
            units={SCORE: SIGNAL_UNITS[SCORE]},
            signals={SCORE: score},
            alarm=None if no_claim else self.alarm(run),
            no_claim=no_claim,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchedSignals(Measured):
    """Residuals of a flight's signals from their values predicted by healthy flights."""

    # One half teaches the weights, the other the limits.
    min_learned: ClassVar[int] = 2 * MIN_LEARNED

    @classmethod
    def chosen(cls, plan: Plan, signals: Iterable[str] | None) -> Self:
        """Residuals of the models whose signals exist in the flight at the median."""
        del signals
        run = fly_group(plan, plan.campaign.central, plan.groups[0])
        return cls._by(watching.models_of(run.signals))

    @classmethod
    def of(cls, about: About, scenario: Scenario, plant: str) -> Self:
        """Residuals from a file, if their models can be counted."""
        del scenario, plant
        if [x.name for x in about.models] != [*about.signals]:
            raise InputError("`models` must be those of the `signals` of a monitor.")
        for x in about.models:
            if len(x.weights) != len(x.terms) or replace(x, weights=()) not in watching.MODELS:
                raise InputError(
                    "`models` must be those that flighttune monitor counts, with a weight for each "
                    "term."
                )
        return cls(units=about.signals, models=about.models)

    @classmethod
    def _by(cls, models: tuple[watching.SignalModel, ...]) -> Self:
        return cls(units=watching.units_of(models, SIGNAL_UNITS), models=models)

    @property
    def room(self) -> Floats:
        """Factors on the learned limits."""
        return np.array([model.room for model in self.models])

    def values(self, run: Run, scenario: Scenario) -> FloatArray:
        """The residuals of a run, shape (samples, signals)."""
        del scenario
        columns = watching.columns_of(self.models, run)
        return watching.residuals(self.models, columns, watching.dt_of(run))

    def windows(
        self, central: Scenario, samples: int, flights: int, per_unit: float
    ) -> npt.NDArray[np.integer]:
        """One window, the whole flight."""
        del central, flights, per_unit
        return np.array([0, samples - 1])

    def teaching(self, learned: int) -> int:
        """The first half of the learning flights."""
        return learned // 2

    def taught(self, pool: WorkerPool, plan: Plan, learned: int) -> Self:
        """The residuals with weights taught by the first half of the flights."""
        probes, runs = {"moments": partial(_moments, self.models)}, range(self.teaching(learned))
        rows = pool.in_order(plan, runs, doing="learning", probes=probes)
        flights = [_products(self.models, row["moments"]) for row in rows if "moments" in row]
        if not flights:
            raise InputError(f"`learn` must have flights that are completed{why_ended(rows)}")
        return replace(self, models=watching.taught(self.models, flights))

    def check(self, pool: WorkerPool, plan: Plan, learned: int) -> None:
        """Refuse units and weights that differ from the flights of a plan."""
        if [*self._by(self.models).units.items()] != [*self.units.items()]:
            raise InputError("`signals` must have the units of the flights.")
        again = self.taught(pool, plan, learned).models
        for model, other in zip(self.models, again, strict=True):
            if not np.allclose(model.weights, other.weights, rtol=SAME, atol=0.0):
                raise InputError(f"`weights` of {model.name} must be those that its flights teach.")


def _products(models: Sequence[watching.SignalModel], moments: npt.ArrayLike) -> list[FloatArray]:
    """Products of the terms and target of each model, from one row of numbers."""
    sizes = [len(model.terms) + 1 for model in models]
    parts = np.split(np.asarray(moments), np.cumsum(np.square(sizes))[:-1])
    return [part.reshape(size, size) for part, size in zip(parts, sizes, strict=True)]


def _moments(models: Sequence[watching.SignalModel], run: Run, _: Scenario) -> list[float]:
    return np.concatenate(
        [x.ravel() for x in watching.moments(watching.columns_of(models, run))]
    ).tolist()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Monitor(Counted, Watching):
    """An alarm with a bounded probability in healthy flights: a counted claim.

    Its score is the running maximum of the distance between a flight's signals and their values
    expected from healthy flights, divided by the counted limits.

    Attributes
    ----------
    about, flights, extremes, wind, navigation, endings, compiled, scores, scale : as in a `Band`
        For one window.
    watch : Watch
        The models and their limits; its `scores` and `alarm` take a run.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "flights": 7, "workers": 1}
    >>> monitor = ft.monitor("level_turn", start_deg=2.0, **few)
    >>> len(monitor.scores), monitor.outside
    (7, 0)
    """

    of: ClassVar[Of] = "monitor"
    measures: ClassVar[type[Measured]] = WatchedSignals
    title: ClassVar[tuple[str, str]] = "what is expected, and limits of what is missing", "limits"
    unlike: ClassVar[tuple[str, ...]] = FAULTS

    @property
    def watch(self) -> watching.Watch:
        """The models and the limits of their residuals; InputError without a claim."""
        if not self.claims:
            raise InputError("a monitor must claim a rate of false alarms to watch flights.")
        low, high = self._ends(np.zeros((1, 0)))
        middle, half = 0.5 * (low + high)[0], self.scale * self.about.half[0]
        return watching.Watch(models=self.about.models, middle=middle, half=half)

    @property
    def watches(self) -> tuple[watching.Watch, ...]:
        """Its single watch; a `LogMonitor` has several."""
        return (self.watch,)

    def why_not(self, run: Run) -> str:
        """Why the monitor cannot score a run; it covers only its own plant, law and gains."""
        log = run.provenance.log
        otherwise = "" if log else self.flights.flown_otherwise(*flown_by(run))
        return otherwise or Watching.why_not(self, run)

    def not_about(self, run: Run) -> str:
        """First difference of a run from the counted flights, apart from faults."""
        if run.provenance.log:
            return "it is the log of a real flight, counted on simulated ones"
        return Counted.not_about(self, run)

    def not_counted(self, entry: Entry) -> str:
        """First difference of a scenario's flights from the counted ones, apart from faults."""
        label = entry.plant.label if entry.plant.aircraft else "no aircraft"
        otherwise = self.flights.flown_otherwise(label, entry.name, entry.gains)
        return otherwise or self.flights.not_counted(entry.scenario, label, entry.name, self.unlike)

    @property
    def _leaves(self) -> str:
        return "without a fault raises an alarm"

    def sizes(self) -> list[dict[str, float]]:
        low, high = (ends[0] for ends in self._ends(np.zeros((1, 0))))
        return [{"low": a, "high": b} for a, b in zip(low, high, strict=True)]

    @property
    def own_values(self) -> dict[str, Any]:
        return {"models": [asdict(model) for model in self.about.models]}

    @property
    def own_notes(self) -> list[str]:
        models = self.about.models
        return [
            f"Expected are {listed([f'{x.name} ({x.target})' for x in models])}, from "
            f"{listed(watching.signals_of(models))} as recorded: "
            "surfaces and throttle are positions, and sensors err only as [sensors] says. A flight "
            "that did not complete counts as an alarm. How often faults are found is not in the "
            "claim."
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthyLog:
    """A log with models and limits from all other logs, and its score by them."""

    name: str
    seconds: float  # number of judged samples
    models: tuple[watching.SignalModel, ...]
    limits: tuple[float, ...]  # largest residual of each model in other logs, with its room
    score: float  # largest ratio of a residual of this log to its limit
    why: str  # model of this residual
    # Basis from which `verify` computes the numbers above again; empty in files of flighttune
    # 0.4.0.
    digest: str = ""  # SHA-256 of the judged signals
    moments: tuple[tuple[float, ...], ...] = ()  # products of terms and target of each model
    peaks: tuple[tuple[float, ...], ...] = ()  # largest residual of each log and model

    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True, slots=True, kw_only=True)
class LogMonitor(Watching):
    """An alarm with a bounded probability in healthy flights like the logs.

    Every log is left out once: the other logs teach models and limits, which score it. A flight
    alarms when its score exceeds the largest of these scores by the models of every left-out log.

    Attributes
    ----------
    logs : tuple of HealthyLog
        The learning logs.

    Notes
    -----
    At most one of n + 1 flights can be above all others in this way: if two were, each would score
    higher than the other by the models of the remaining n - 1. If the flights are exchangeable, the
    new flight is this one with a probability of at most 1/(n + 1): the jackknife-minmax of [1]_,
    Theorem 2, for the largest score. The kinds of models and their `room` were chosen on flights of
    the ALFA data, for which the claim is therefore optimistic.

    References
    ----------
    .. [1] R. F. Barber, E. J. Candes, A. Ramdas and R. J. Tibshirani, "Predictive inference with
       the jackknife+", Annals of Statistics 49 (2021).
    """

    logs: tuple[HealthyLog, ...]

    kind: ClassVar[Kind] = "counted"

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune monitor 1"
    UNITS: ClassVar[Mapping[str, str]] = {"seconds": "s", "limits": "SI"}

    def __post_init__(self) -> None:
        names = [[model.name for model in log.models] for log in self.logs]
        if len(names) < MIN_LOGS or not names[0] or any(each != names[0] for each in names):
            raise InputError(f"`logs` must be at least {MIN_LOGS}, with the same models.")
        for log in self.logs:
            sizes = [len(model.weights) == len(model.terms) for model in log.models]
            if any(replace(model, weights=()) not in watching.OF_LOGS for model in log.models):
                raise InputError("`models` must be those that flighttune monitor takes of logs.")
            if not (all(sizes) and len(log.limits) == len(sizes) and min(log.limits) > 0.0):
                raise InputError("`logs` must have a weight for each term, and positive limits.")

    @property
    def names(self) -> set[str]:
        """Names of the logs."""
        return {log.name for log in self.logs}

    @property
    def distinct(self) -> int:
        """Number of different logs; logs that teach the others the same count once."""
        taught = {tuple(model.weights for model in log.models) for log in self.logs}
        digests = {log.digest for log in self.logs}
        return len(taught) if "" in digests else min(len(taught), len(digests))

    @property
    def epsilon(self) -> float:
        """Largest probability of a false alarm in a flight, averaged over sets of logs."""
        return 1.0 / (self.distinct + 1)

    def verify(self, runs: Sequence[Run] = ()) -> Verification:
        """Compute weights, limits and scores again, from the file's content or its logs."""
        if (n := self.distinct) < len(self.logs):
            reason = f"`logs` must be of different flights, got {n} among {len(self.logs)}"
            return Verification(valid=False, reason=reason)
        by_logs = self._checks_of(runs) if runs else []
        if any(log.peaks for log in self.logs):
            held = Verification.of([*by_logs, *self._checks()])
            return held if runs else replace(held, notes=(HELD,))
        if not runs:
            return Verification(valid=False, reason=NOT_HELD, checked=False)
        return Verification.of(by_logs)

    def _checks(self) -> list[Check]:
        """Whether weights, limits and scores follow from the moments and residuals in the file."""
        try:
            moments = np.array([np.concatenate(log.moments) for log in self.logs])
            peaks = np.array([log.peaks for log in self.logs])
        except ValueError:  # the logs have different numbers of moments
            moments = peaks = np.zeros(0)
        models = self.logs[0].models
        n, wanted = len(self.logs), sum((len(model.terms) + 1) ** 2 for model in models)
        if moments.shape != (n, wanted) or peaks.shape != (n, n, len(models)):
            return [Check(name="numbers of logs and models", margin=-1.0, exact=False)]
        products = [_products(models, log) for log in moments]
        checks = _agree(self.logs, _learned(models, products, peaks))
        # The largest residual is at least its root mean square, known from the moments of a model
        # without a filter, whose first term is 1.
        plain = [i for i, x in enumerate(models) if not x.filtered]
        for i, log in enumerate(self.logs):
            for m in plain:
                weights = np.array([*np.negative(log.models[m].weights), 1.0])
                squares = [weights @ of[m] @ weights / of[m][0, 0] for of in products]
                least = np.sqrt(np.maximum(squares, 0.0)) * (1.0 - SAME)
                short = float((peaks[i, :, m] - least).min())
                if short < -SMALLEST:
                    checks.append(
                        Check(name=f"largest residuals of {log.name}", margin=short, exact=False)
                    )
        return checks

    def _checks_of(self, runs: Sequence[Run]) -> list[Check]:
        """Checks that the monitor belongs to these logs."""
        again = monitor_of_logs(runs).logs
        place = {log.digest: log for log in again}
        if "" not in {log.digest for log in self.logs}:
            lacking = [log.name for log in self.logs if log.digest not in place]
            if lacking or len(again) != len(self.logs):
                return [
                    Check(
                        name=f"same {len(self.logs)} logs",
                        margin=-float(len(lacking) or 1),
                        exact=False,
                    )
                ]
            again = tuple(place[log.digest] for log in self.logs)
        if [x.name for x in again[0].models] != [x.name for x in self.logs[0].models]:
            return [Check(name="same models", margin=-1.0, exact=False)]
        if len(again) != len(self.logs):
            return [Check(name=f"same {len(self.logs)} logs", margin=-1.0, exact=False)]
        return _agree(self.logs, again)

    def not_about(self, run: Run) -> str:
        """Why the claim does not cover a run: it is simulated, or one of the learning logs."""
        if not run.provenance.log:
            return "it is simulated, learned from logs of real flights"
        if run.provenance.gains_name in {log.name for log in self.logs if not log.digest}:
            return "it learned from a log of this name"
        known = {log.digest for log in self.logs}
        learned = _digest(self.logs[0].models, run) in known
        return "it learned from this log" if learned else ""

    @property
    def sentence(self) -> str:
        """The claim in words."""
        n = self.distinct
        return (
            f"a flight without a fault that is exchangeable with these {n} raises an alarm with "
            f"probability at most 1/{n + 1} = {number(self.epsilon)}, on average over such sets of "
            "logs"
        )

    @property
    def watches(self) -> tuple[watching.Watch, ...]:
        """Models and limits without each log in turn, scaled to the largest score."""
        scale = max(SMALLEST, *(log.score for log in self.logs))
        return tuple(
            watching.Watch(
                models=log.models,
                middle=np.zeros(len(log.limits)),
                half=scale * np.array(log.limits),
                from_s=SETTLED_S,
            )
            for log in self.logs
        )

    def save(self, path: str | Path) -> None:
        """Write the monitor with its SHA-256 (.npz), whole or not at all."""
        write_sealed(path, {"monitor": np.array(json.dumps(tables_of(self)))})


def load_monitor(path: str | Path) -> LogMonitor:
    """Read a monitor of logs; InputError names the file and the fault."""
    sealed_bytes(Path(path), "monitor", "make it again with flighttune monitor")
    with naming(path):
        arrays = read_arrays(Path(path), "monitor", {"monitor": TEXT})
        return value_of(json_object(str(arrays["monitor"]), "`monitor`"), LogMonitor)


def _overlap(run: Run, other: Run) -> bool:
    """Whether two logs share some seconds of a file: equal name, and roll within 0.01 rad."""
    first, second = ((run.provenance.log or {}), (other.provenance.log or {}))
    if not first or not second or first["file"] != second["file"]:
        return False
    t, times = run.t + first["from_s"], other.t + second["from_s"]
    there = (t > times[0]) & (t < times[-1])
    gap = np.interp(t, times, other.signals["phi"]) - run.signals["phi"].to_numpy()
    return bool(there.any() and np.nanmedian(np.abs(gap[there])) < 0.01)


def _nearest(signals: set[str]) -> str:
    """The residuals that lack the fewest signals, and these."""
    lacks = [(model.name, sorted(model.signals - signals)) for model in watching.OF_LOGS]
    least = min(len(names) for _, names in lacks)
    near = (f"{name} lacks {listed(names)}" for name, names in lacks if len(names) == least)
    return listed([*dict.fromkeys(near)])


def monitor_of_logs(runs: Sequence[Run]) -> LogMonitor:
    """A monitor learned from logs of healthy flights, or healthy parts of logs."""
    if len(runs) < MIN_LOGS:
        raise InputError(f"`logs` must be at least {MIN_LOGS} healthy flights, got {len(runs)}.")
    refuse_wrong(*runs)
    for run, other in combinations(runs, 2):
        if _overlap(run, other):
            raise InputError(
                f"`logs` must be of different flights, got {run.label} twice or parts that overlap."
            )
    for run in runs:
        if run.duration < 2.0 * SETTLED_S:
            raise InputError(
                f"{run.label}: must be at least {2.0 * SETTLED_S:g} s to learn from, got "
                f"{run.duration:.1f} s."
            )
    there = set.intersection(*({*map(str, run.signals)} for run in runs))
    models = watching.models_of(there, watching.OF_LOGS)
    if not models:
        raise InputError(
            f"the logs must have the signals of a residual, got logs in which {_nearest(there)}."
        )
    samples = [{*map(bytes, np.round(_used(models, run), DIGITS))} for run in runs]
    for (run, some), (other, others) in combinations(zip(runs, samples, strict=True), 2):
        if len(some & others) > SHARED * min(len(some), len(others)):
            raise InputError(
                f"`logs` must be of different flights, got the same samples in {run.label} and "
                f"{other.label}."
            )
    columns = [watching.columns_of(models, run, SETTLED_S) for run in runs]
    products = [watching.moments(each) for each in columns]
    peaks = np.array(
        [
            [
                np.abs(watching.residuals(without, each, watching.dt_of(run))).max(axis=0)
                for each, run in zip(columns, runs, strict=True)
            ]
            for without in _without_each(models, products)
        ]
    )
    logs = [
        replace(
            log,
            name=run.provenance.gains_name,
            seconds=run.duration - SETTLED_S,
            digest=_digest(models, run),
            moments=tuple(tuple(each.ravel().tolist()) for each in of_log),
        )
        for log, run, of_log in zip(_learned(models, products, peaks), runs, products, strict=True)
    ]
    return LogMonitor(logs=tuple(logs))


def _without_each(
    models: Sequence[watching.SignalModel], products: Sequence[Sequence[FloatArray]]
) -> list[tuple[watching.SignalModel, ...]]:
    """The models from all logs but one, for each left-out log."""
    logs = [*products]
    return [watching.taught(models, logs[:i] + logs[i + 1 :]) for i in range(len(logs))]


def _learned(
    models: Sequence[watching.SignalModel],
    products: Sequence[Sequence[FloatArray]],
    peaks: FloatArray,
) -> list[HealthyLog]:
    """Models, limits and score of each log, from the moments and largest residuals of all logs."""
    room, logs = np.array([model.room for model in models]), []
    for i, without in enumerate(_without_each(models, products)):
        limits = room * np.maximum(np.delete(peaks[i], i, axis=0).max(axis=0), SMALLEST)
        scores = peaks[i, i] / limits
        log = HealthyLog(
            name="",
            seconds=0.0,
            models=without,
            limits=tuple(limits.tolist()),
            score=float(scores.max()),
            why=models[int(scores.argmax())].name,
            peaks=tuple(map(tuple, peaks[i].tolist())),
        )
        logs.append(log)
    return logs


def _agree(stated: Sequence[HealthyLog], again: Sequence[HealthyLog]) -> list[Check]:
    """Checks that weights, limits and scores of logs agree with their repeated computation."""
    checks = []
    for log, other in zip(stated, again, strict=True):
        for name, numbers in {
            "weights": [np.concatenate([x.weights for x in each.models]) for each in (log, other)],
            "limits": [np.array(each.limits) for each in (log, other)],
            "score": [np.array([each.score]) for each in (log, other)],
        }.items():
            off = np.abs(numbers[0] - numbers[1]) - SAME * np.abs(numbers[1]) - SMALLEST
            margin = -float(off.max())
            checks.append(Check(name=f"{name} of {log.name}", margin=margin, exact=margin >= 0.0))
        if log.why != other.why:
            checks.append(Check(name=f"model of the score of {log.name}", margin=-1.0, exact=False))
    return checks


def _used(models: Sequence[watching.SignalModel], run: Run) -> FloatArray:
    """The judged signals of a log, shape (samples, signals)."""
    names, first = watching.signals_of(models), round(SETTLED_S / watching.dt_of(run))
    return np.ascontiguousarray(run.signals[names].to_numpy(float)[first:], "<f8")


def _digest(models: Sequence[watching.SignalModel], run: Run) -> str:
    """SHA-256 of the judged signals of a log."""
    return hashlib.sha256(_used(models, run).tobytes()).hexdigest()
