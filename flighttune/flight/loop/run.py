"""A flown time history that cannot be changed afterwards, bounds, and the claims made of it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, NoReturn, Protocol, TypeAlias, runtime_checkable

import numpy as np
import pandas as pd

from flighttune.base.answering import SPEAKERS, function_for
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.control.gains import PIGains
from flighttune.control.law import Law, made_law, plain_laws, split_name
from flighttune.vehicles.plants.base import StopStatus, aircraft_of


class SignalTable(pd.DataFrame):
    """A DataFrame whose columns stay what they are; everything made from it is a plain one."""

    @property
    def _constructor(self) -> type[pd.DataFrame]:
        return pd.DataFrame

    def _refused(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError(
            "`signals` of a run must stay as they were flown; `run.signals.assign(...)` and "
            "`run.signals.copy()` make tables that can be changed"
        )

    __setitem__ = __delitem__ = insert = pop = _refused  # type: ignore[assignment]
    _update_inplace = _set_axis = _refused  # type: ignore[assignment]


RunStatus: TypeAlias = Literal["completed", "no_gains", "no_trim"] | StopStatus

ERRORS = ("chi_err", "gamma_err")

# Signal of a run that a monitor watches: its largest score so far, over the limit of an alarm
SCORE = "alarm_score"

# Half width (rad) below which bounds count as that wide: a tube may begin at a point
NARROWEST = 1e-9

# Tubes are proven, bands are counted.
Kind: TypeAlias = Literal["proven", "counted"]


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Lowest and highest values of m signals at n times."""

    t: FloatArray  # (n,), s
    # `low` and `high`: (n, m), in the units of the signals; NaN where nothing is claimed
    low: FloatArray
    high: FloatArray
    names: tuple[str, ...] = ERRORS

    @property
    def pairs(self) -> FloatArray:
        """Lower and upper bounds, shape (n, m, 2)."""
        return np.stack([self.low, self.high], axis=-1)

    @property
    def half_widths(self) -> FloatArray:
        """Half the distance between the bounds, shape (n, m)."""
        return 0.5 * (self.high - self.low)

    def of(self, names: Sequence[str]) -> "Bounds":
        """The bounds of some of the signals."""
        places = [self.names.index(name) for name in names]
        return Bounds(self.t, self.low[:, places], self.high[:, places], tuple(names))

    def lasting(self, t: FloatArray) -> "Bounds":
        """The bounds at the samples `t` of a flight, which they share; NaN where they end."""
        missing = np.full((max(len(t) - len(self.t), 0), len(self.names)), np.nan)
        low, high = (np.concatenate([end, missing])[: len(t)] for end in (self.low, self.high))
        return Bounds(t, low, high, self.names)

    def contain(self, signals: pd.DataFrame) -> bool:
        """Whether a flight with these signals is inside, as far as the bounds last."""
        values = np.column_stack([signals[name] for name in self.names])
        n = min(len(values), len(self.t))
        low, high = self.low[:n], self.high[:n]
        return bool(((values[:n] >= low) & (values[:n] <= high) | np.isnan(low)).all())

    def distances(self, signals: pd.DataFrame) -> FloatArray:
        """Distance of the signals of a flight from the middle of the bounds, shape (samples, m)."""
        middle, t = 0.5 * (self.low + self.high), signals.index.to_numpy(dtype=float)
        return np.column_stack(
            [
                np.abs(signals[name].to_numpy() - np.interp(t, self.t, column))
                for name, column in zip(self.names, middle.T, strict=True)
            ]
        )

    def share(self, signals: pd.DataFrame) -> float:
        """Largest share of the bounds that a flight uses; it leaves them beyond 1."""
        t = signals.index.to_numpy(dtype=float)
        widths = [np.interp(t, self.t, column) for column in self.half_widths.T]
        pointwise = self.distances(signals) / np.maximum(np.column_stack(widths), NARROWEST)
        largest = float(pointwise.max())
        # Inside, the share is the largest distance from the middle over the largest half width of
        # its signal: a share of the width at each time would be large at the start of every flight,
        # where a tube is narrow.
        return largest if largest > 1.0 else float(self.reach(signals).max())

    def reach(self, signals: pd.DataFrame) -> FloatArray:
        """Largest distance of a flight from the middle over the largest half width, shape (m,)."""
        half = np.maximum(self.half_widths.max(axis=0), NARROWEST)
        return self.distances(signals).max(axis=0) / half

    def ratios(self, signals: pd.DataFrame) -> dict[str, float]:
        """Largest half width over the largest distance of a flight from the middle, by channel."""
        ratios = self.half_widths.max(axis=0) / self.distances(signals).max(axis=0)
        names = [name.removesuffix("_err") for name in self.names]
        return dict(zip(names, ratios.tolist(), strict=True))


class Alarm(NamedTuple):
    """When a flight is first outside of what is expected of it, and why."""

    at_s: float
    why: str  # name of the model

    @property
    def sentence(self) -> str:
        """The alarm in words."""
        return f"Alarm at {self.at_s:.2f} s: the {self.why} differs from that of healthy flights."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunClaim:
    """A claim about flights, as one run that it covers has it."""

    kind: Kind
    title: str  # a few words, for legends
    sentence: str  # the claim in words
    bounds: Bounds  # of the signals that it is about, at the samples of the run
    units: Mapping[str, str]  # of these signals
    # rings of the fences that it is about, longitudes and latitudes, deg
    fences: tuple[list[list[float]], ...] = ()
    # Of a monitor: what it adds to the run, and when that alarms
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    alarm: Alarm | None = None
    no_claim: str = ""  # why it says nothing of this run, whose score alone it has

    def contains(self, signals: pd.DataFrame) -> bool:
        """Whether the flight with these signals is inside the bounds."""
        return self.bounds.contain(signals)

    def said(self, signals: pd.DataFrame) -> str:
        """Whether the flight with these signals is inside, or what alarms, in words."""
        if self.no_claim:
            return f"no claim about this flight: {self.no_claim}"
        if self.alarm is not None:
            return self.alarm.sentence
        return f"{'inside' if self.contains(signals) else 'outside'} the {self.title}."


# Path angle below the reference from which on the airspeed has priority, rad.
GIVEN_WAY = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Origin of a run: enough to fly it again to the same bits."""

    scenario: Mapping[str, Any]  # as it would be written in TOML
    plant: str  # its label: ``kinematic``, ``jsbsim:aerosonde``, ``jsbsim:aerosonde:heavy`` by name
    gains_name: str  # in the scenario
    gains: PIGains | None  # None where none were found
    seed: int
    versions: Mapping[str, str]  # of every library that shaped the numbers
    wall_s: float

    @property
    def law(self) -> Law:
        """The law flown; an InputError says that there is none of its kind."""
        tables = {table["name"]: table for table in self.scenario.get("law") or ()}
        (name, _), gains = self._split, self.gains
        table = tables.get(name) or {"kind": name if name in plain_laws() else "python"}
        law = made_law(**{**table, "name": name})
        if gains is not None and law.by_gains and gains.inputs[:2] != law.inputs:
            return made_law(gains.law)
        return law

    @property
    def listed(self) -> str:
        """Name of the gains without the law, as the scenario lists them."""
        return self._split[1]

    @property
    def _split(self) -> tuple[str, str]:
        laws = [table["name"] for table in self.scenario.get("law") or ()]
        return split_name(self.gains_name, laws)

    @property
    def log(self) -> Mapping[str, Any] | None:
        """Gaps and checks of the log of a real flight; None for a simulated one."""
        return self.scenario.get("log")

    @property
    def aircraft(self) -> str | None:
        """Aircraft flown, as its scenario names it; None for a plant that is none."""
        return aircraft_of(self.plant, self.scenario.get("plant") or ())


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """One flight of one gain set on one plant.

    Attributes
    ----------
    signals : DataFrame, indexed by `t` in s
        One column a signal, float64, SI and radians; `SIGNAL_UNITS` names the units. Columns can be
        neither added nor replaced nor taken away; a copy, or what `assign` returns, is free.
    status : str
        ``completed``, or why the flight ended early or never began.
    reason : str
        A sentence with time and numbers where `status` is not ``completed``.
    provenance : Provenance
        What made the run: `scenario`, `plant`, `gains_name`, `gains`, `seed`, `versions` of the
        libraries and `wall_s`.
    units : mapping of str to str
        Units of signals that `SIGNAL_UNITS` does not know: those of a user's own law.
    claims : tuple of RunClaim
        Tubes and bands around its signals, which bound flights like it.
    compiled : bool
        Whether the steps of JSBSim were flown by compiled code, with the same numbers.
    why_jsbsim : str
        Why JSBSim flew a flight that was to be compiled; empty for others.

    Examples
    --------
    >>> run = ft.fly(ft.load_scenario("paper_as_printed")).runs[0]
    >>> run.label, run.status, run.duration
    ('kinematic / paper', 'completed', 20.0)
    """

    signals: pd.DataFrame
    status: RunStatus
    reason: str
    provenance: Provenance = field(repr=False)
    units: Mapping[str, str] = field(default_factory=dict, repr=False)
    claims: tuple[RunClaim, ...] = field(default=(), repr=False)
    compiled: bool = field(default=False, repr=False)
    why_jsbsim: str = field(default="", repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "signals", SignalTable(self.signals))

    def __repr__(self) -> str:
        return f"Run {self.label}: {self.status}, {len(self.signals)} samples"

    @property
    def label(self) -> str:
        """``plant / gains``, the name of the run everywhere."""
        return f"{self.provenance.plant} / {self.provenance.gains_name}"

    @property
    def outcome(self) -> str:
        """Status, and the reason where there is one, as words."""
        return self.status.replace("_", " ") + (f": {self.reason}" if self.reason else "")

    @property
    def t(self) -> FloatArray:
        """Time of each sample, shape (n,), s."""
        return self.signals.index.to_numpy(dtype=float)

    @property
    def duration(self) -> float:
        """Time flown, s."""
        return float(self.signals.index[-1]) if len(self.signals) else 0.0

    def _repr_html_(self) -> str:
        return function_for(self, SPEAKERS)(self).html()


def renamed(run: Run, name: str) -> Run:
    """The run under another name of its gains, for pictures of several flights."""
    return replace(run, provenance=replace(run.provenance, gains_name=name))


def claims_around(claims: Sequence[RunClaim], signal: str) -> Iterator[tuple[RunClaim, FloatArray]]:
    """The claims that bound a signal, with its bounds, shape (2, samples) each."""
    for claim in claims:
        if signal in claim.bounds.names:
            yield claim, claim.bounds.pairs[:, claim.bounds.names.index(signal)].T


def along_route(run: Run) -> FloatArray:
    """Distance of each sample along the route, m; its nearest point may go back a little."""
    return np.maximum.accumulate(run.signals["along"].to_numpy())


def claimed_along(run: Run, signal: str, s: FloatArray) -> Iterator[FloatArray]:
    """Bounds claimed of a signal at distances along a route (m), shape (2, n) for each claim."""
    for _, ends in claims_around(run.claims, signal):
        yield np.array([np.interp(s, along_route(run), end) for end in ends])


def given_way(signals: pd.DataFrame) -> FloatArray:
    """What the airspeed took from the path angle at each sample of a flight, rad."""
    if "gamma_given" not in signals:
        return np.zeros(len(signals))
    less = (signals["gamma_ref"] - signals["gamma_given"]).to_numpy()
    return np.where(less > GIVEN_WAY, less, 0.0)


@runtime_checkable
class Claim(Protocol):
    """A claim about flights, which a tube proves or a band counts."""

    @property
    def sentence(self) -> str:
        """The claim in words, made from its content."""
        ...

    def why_not(self, run: Run) -> str:
        """Why the claim says nothing of a run; empty if it covers it."""
        ...

    def on(self, run: Run) -> RunClaim:
        """The claim at the samples of a run that it covers."""
        ...


def with_claims(runs: Sequence[Run], claims: Sequence[object]) -> tuple[Run, ...]:
    """The runs with the claims that cover them; an InputError says why one covers none."""
    for claim in claims:
        if not isinstance(claim, Claim):
            what = type(claim).__name__
            raise InputError(
                f"`claim` must bound flights, as a tube, a band or a monitor, got a {what}."
            )
        reasons = [claim.why_not(run) for run in runs]
        if all(reasons):
            why = "there is no run"
            if runs:
                why = f"{runs[0].label}: no claim about this flight: {reasons[0]}"
            raise InputError(f"`claim` must cover a run: {why}.")
        runs = [
            run if why else _with_claim(run, claim.on(run))
            for run, why in zip(runs, reasons, strict=True)
        ]
    return tuple(runs)


def _with_claim(run: Run, claim: RunClaim) -> Run:
    """The run with a claim, and with the signals that it adds."""
    signals = run.signals.assign(**claim.signals) if claim.signals else run.signals
    return replace(run, signals=signals, claims=(*run.claims, claim))
