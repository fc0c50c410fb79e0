"""The flights of a scenario as a value: runs, metrics, requirements checked, and advice."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG
from flighttune.control.theory.indicators import Indicators
from flighttune.control.tuning.result import TuningResult
from flighttune.flight import metrics
from flighttune.flight.entry import Entry, entry_of
from flighttune.flight.loop.measures import SETTLING_BAND, SMALLEST_STEP
from flighttune.flight.loop.run import Claim, Run, with_claims
from flighttune.flight.metrics import AIRSPEED, airspeed_metrics, metric_tables
from flighttune.flight.models import loop_measures
from flighttune.flight.requirement_keys import ExpectTable, in_rad
from flighttune.flight.scenario.schema import Scenario

Sense: TypeAlias = Literal["at_most", "at_least"]

# Measures by subject, from `flighttune.flight.metrics.measures`
Measured: TypeAlias = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundCheck:
    """A measure of a run against one bound of the scenario."""

    run: str  # Label of the run; empty if only one run is checked
    subject: str  # ``chi``, ``gamma``, ``flight`` or ``loop``
    # Key of the measure in the scenario; the ending ``_deg`` means degrees
    measure: str
    sense: Sense
    # Both in the unit of `measure`; the value is NaN if the run lacks it
    bound: float
    value: float
    why: str = ""  # Why a response did not settle before the last quarter of the flight
    flown: bool = True  # False for a run with the wrong end, which has no value to compare

    @property
    def beyond(self) -> float:
        """Distance of the value beyond the bound; NaN without a value."""
        return self.value - self.bound if self.sense == "at_most" else self.bound - self.value

    @property
    def margin(self) -> float:
        """`beyond` relative to the bound."""
        return self.beyond / (abs(self.bound) or 1.0)

    @property
    def met(self) -> bool:
        """Whether the value exists and keeps the bound."""
        return self.beyond <= 0.0  # NaN gives False

    @property
    def sentence(self) -> str:
        """Bound, value and difference in one clause."""
        wanted = f"{self.sense.replace('_', ' ')} {self.bound:g}"
        if math.isnan(self.value):
            got = "no value"
        else:
            got = f"{self.value:.4g}" + ("" if self.met else f" (missed by {self.beyond:.3g})")
        why = f": {self.why}" if self.why and not self.met else ""
        return f"{self.subject}.{self.measure} must be {wanted}, got {got}{why}"


class Counts(NamedTuple):
    """Numbers of requirements (bounds and ends) and of runs that fail."""

    requirements: int = 0
    met: int = 0
    not_flown: int = 0  # bounds of runs with the wrong end
    ended: int = 0  # runs with the wrong end, without a stated end
    strayed: int = 0  # completed runs that did not follow their reference to the end


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimCheck:
    """The claim of a scenario against its runs."""

    # Not tested if no ``[[expect]]`` is about these runs
    verdict: Literal["met", "not met", "not tested"]
    counts: tuple[Counts, ...]  # Numbers of each run
    bounds: tuple[BoundCheck, ...]  # Every bound, in the order of the runs
    # A sentence for each missed requirement: the run, the measure, its bound, the value and the
    # difference; or the end of the run
    missed: tuple[str, ...]
    # A sentence for each other run with a limited command at the end
    held: tuple[str, ...] = ()

    @property
    def total(self) -> Counts:
        """Requirements of all runs."""
        return Counts(*(sum(numbers) for numbers in zip(*self.counts, strict=True)))

    @property
    def lower(self) -> list[BoundCheck]:
        """Lower bounds on an error or time without an upper bound, which a poor flight meets."""
        return _lower(self.bounds)


def check_claim(scenario: Scenario, runs: Sequence[Run]) -> ClaimCheck:
    """Check every run against the ``[[expect]]`` tables of its scenario.

    A run whose gains no table covers has no requirements.
    """
    bounds: list[BoundCheck] = []
    sentences: list[str] = []
    counts: list[Counts] = []
    held: list[str] = []
    judged = {table.gains for table in scenario.expect} or {None}
    for run in runs:
        made_by, measured = run.provenance, {}
        own = metrics.measures(run)
        limits = [f"{run.label}: {words}" for words in metrics.limits_in_words(own)]
        if not judged & {None, made_by.gains_name}:  # it flies only for comparison
            held += limits
            counts.append(Counts())
            continue
        tables = scenario.expected(made_by.plant, made_by.gains_name)
        stated = any(table.status for table in tables)
        if flown := not _wrong_end(tables, run.status, run.reason):
            loop = bounded_loop(tables, entry_of(scenario, made_by.gains_name, made_by.gains))
            measured = {**own, **loop}
        checks = [replace(x, flown=flown) for x in bound_checks(tables, measured, run.label)]
        late = not_followed(tables, measured, calm=scenario.calm)
        misses = missed(tables, run.status, run.reason, measured, calm=scenario.calm)
        sentences += [f"{run.label}: {miss}" for miss in misses]
        held += [] if SWING in late else limits
        met = sum(check.met for check in checks) + int(stated and flown)
        not_flown, ended = (0, 0) if flown else (len(checks), int(not stated))
        n = len(checks) + int(stated)
        counts.append(Counts(n, met, not_flown, ended, int(bool(flown and late))))
        bounds += checks
    tested = any(count.requirements for count in counts)
    return ClaimCheck(
        verdict="not tested" if not tested else "not met" if sentences else "met",
        counts=tuple(counts),
        bounds=tuple(bounds),
        missed=tuple(sentences),
        held=tuple(held),
    )


def bounded_loop(tables: Sequence[ExpectTable], entry: Entry) -> Measured:
    """Measures of the linear loop of a gain set, as ``loop``, if a table bounds them."""
    bounds = (bounds for table in tables for bounds in (table.at_most, table.at_least))
    wanted = {in_rad(measure) for own in bounds for measure in own.get("loop", ())}
    if entry.gains is None or not wanted:
        return {}
    return {"loop": loop_measures(entry, wanted)}


def missed(
    tables: Sequence[ExpectTable], status: str, reason: str, measured: Measured, *, calm: bool
) -> tuple[str, ...]:
    """A sentence for each requirement of `tables` that a run, perhaps in calm air, misses."""
    if wrong_end := _wrong_end(tables, status, reason):
        return (wrong_end,)
    misses = [check.sentence for check in bound_checks(tables, measured) if not check.met]
    return tuple(filter(None, (*misses, not_followed(tables, measured, calm=calm))))


def _wrong_end(tables: Sequence[ExpectTable], status: str, reason: str) -> str:
    """Fault of a run's end; empty without a fault."""
    expected = [t.status for t in tables if t.status] or ["completed"]
    if status in expected:
        return ""
    wanted = "" if expected == ["completed"] else f", must be {' or '.join(expected)}"
    return f"{status}{wanted}: {reason or 'flown to its end'}"


# Words for a command that limits hold alternately from both sides.
SWING = "swings between its limits to the end"


def not_followed(tables: Sequence[ExpectTable], measured: Measured, *, calm: bool) -> str:
    """Why a completed run does not follow its reference steadily to the end; empty if it does."""
    # This is not checked without a bound, with another stated end, or for a channel with a lower
    # bound on an error or time, which a poor flight meets.
    swinging = {
        channel: values["held_magnitude"] + values["held_rate"]
        for channel, values in measured.items()
        if metrics.swings(values, calm=calm)
    }
    late = {
        channel: values["end_error"] / values["end_allowed"]
        for channel, values in measured.items()
        if not values.get("end_error", 0.0) <= values.get("end_allowed", 0.0)
    }
    bounds = [*bound_checks(tables, {})] if late or swinging else []
    for check in _lower(bounds):
        late.pop(check.subject, None)
        swinging.pop(check.subject, None)
    faulty = bounds and (late or swinging)
    if not faulty or any(x.status not in (None, "completed") for x in tables):
        return ""
    if swinging:
        channel = max(swinging, key=swinging.__getitem__)
        return (
            f"{metrics.COMMAND_OF[channel]}_cmd {SWING}: they must hold it in at most "
            f"{100.0 * metrics.HELD:.0f} % of the last quarter, got "
            f"{100.0 * swinging[channel]:.0f} %"
        )
    channel = max(late, key=late.__getitem__)
    per, unit = (1.0, "m/s") if channel == metrics.AIRSPEED else (DEG, "deg")
    mean, most = (measured[channel][name] / per for name in ("end_error", "end_allowed"))
    return (
        f"{channel} does not follow its reference to the end: the mean error there must be at most "
        f"{most:.3g} {unit}, got {mean:.3g}"
    )


def _lower(bounds: Sequence[BoundCheck]) -> list[BoundCheck]:
    """Lower bounds on an error or time of a channel without an upper bound."""
    above = {(x.run, x.subject, x.measure) for x in bounds if x.sense == "at_most"}
    return [
        x
        for x in bounds
        if x.subject in metrics.CHANNELS and (x.run, x.subject, x.measure) not in above
    ]


def bound_checks(
    tables: Sequence[ExpectTable], measured: Measured, run: str = ""
) -> Iterator[BoundCheck]:
    """Check the measures of a run against every bound of `tables`."""
    for table in tables:
        for sense in get_args(Sense):
            for subject, limits in getattr(table, sense).items():
                for name, bound in metrics.stated_bounds(subject, limits).items():
                    own, of_subject = in_rad(name), measured.get(subject, {})
                    value = of_subject.get(own, math.nan)
                    yield BoundCheck(
                        run=run,
                        subject=subject,
                        measure=name,
                        sense=sense,
                        bound=bound,
                        value=value if own == name else value / DEG,
                        why=_unsettled(name, of_subject),
                    )


def envelopes(run: Run, signal: str) -> Iterator[FloatArray]:
    """Bound of an error at each sample, SI, for every required envelope of a run."""
    origin = run.provenance
    for table in (ExpectTable(**tables) for tables in origin.scenario.get("expect", ())):
        for subject, limits in table.at_most.items():
            own, _ = metrics.ENVELOPES.get(subject, ("", ""))
            meant = own == signal and table.meant(origin.plant, origin.gains_name)
            for name in metrics.stated_bounds(subject, limits) if meant else ():
                if name.startswith(metrics.ENVELOPE):
                    yield metrics.envelope_bounds(
                        name, run.t, subject, metrics.signal_arrays(run, metrics.MEASURED)
                    )


def _unsettled(name: str, measured: Mapping[str, float]) -> str:
    """Why a response had not settled before the last quarter of its flight; else empty."""
    band, late = metrics.settling_band(name), measured.get("late_rad", 0.0)
    least = measured.get("settling_band_rad", math.inf) if band is None else band
    if not (name.startswith("settling_s") and late > least):
        return ""
    if band is None and least < SETTLING_BAND * SMALLEST_STEP:
        return "no change is commanded of which 5 % could be a band: state `band_deg` beside it"
    what = "the band" if band else "5 % of the change"
    left = f"errors in the last quarter of the flight reach {late / DEG:.2g} deg"
    return f"{what} is {least / DEG:.2g} deg, {left}"


@checked_class
@dataclass(frozen=True, eq=False)
class FlownScenario(Answering):
    """A scenario with its runs, indicators and metrics.

    Attributes
    ----------
    scenario : Scenario
    runs : tuple of Run
        Plant by plant, gain set by gain set.
    indicators : mapping of str to Indicators
        R_K, I_K and E_K on the linear model of the scenario, by name of the gain set.
    tuning : TuningResult or None
        Result of tuning the gains ``tuned``, if the scenario requests them.
    source : str
        The scenario with its changes, as arguments of a command.
    chosen : str
        The first gain set that replaces the scenario's, as arguments of a command.

    Examples
    --------
    >>> flown = ft.fly("paper_as_printed")
    >>> flown.claim.verdict, flown["kinematic / paper"].status
    ('met', 'completed')
    """

    scenario: Scenario
    runs: tuple[Run, ...]
    indicators: Mapping[str, Indicators]
    tuning: TuningResult | None = None
    source: str = "SCENARIO"
    chosen: str = ""

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """`channel_metrics` of every flown run; index (run, channel)."""
        return metric_tables(self.runs)[0]

    @cached_property
    def flight(self) -> pd.DataFrame:
        """`flight_metrics` of every flown run; index run."""
        return metric_tables(self.runs)[1]

    def __getitem__(self, label: str) -> Run:
        return next(run for run in self.runs if run.label == label)

    @cached_property
    def claim(self) -> ClaimCheck:
        """The runs against the ``[[expect]]`` tables of the scenario."""
        return check_claim(self.scenario, self.runs)

    def within(self, *claims: Claim) -> "FlownScenario":
        """The flights with claims about them; InputError if a claim covers none."""
        return replace(self, runs=with_claims(self.runs, claims))

    def records(self, files: Mapping[str, Path]) -> list[dict[str, Any]]:
        """End and measures of each run; `files`: files of signals by label."""
        return [
            {
                "plant": run.provenance.plant,
                "gains": run.provenance.gains_name,
                "status": run.status,
                "reason": run.reason,
                "duration_s": run.duration,
                "signals": files.get(run.label),
                "metrics": self.metrics_of(run),
                "at_limits": metrics.at_limits(run),
            }
            for run in self.runs
        ]

    def metrics_of(self, run: Run) -> dict[str, dict[str, float]]:
        """Measures of one run as numbers: ``chi``, ``gamma`` and ``flight``; empty if not flown."""
        if run.label not in self.flight.index:
            return {}
        channels = self.metrics.loc[run.label].to_dict(orient="index")
        airspeed = {AIRSPEED: measured} if (measured := airspeed_metrics(run)) else {}
        return {**channels, **airspeed, "flight": self.flight.loc[run.label].to_dict()}
