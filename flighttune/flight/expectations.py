"""Check of flown runs against the requirements of their scenario."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias, get_args

from flighttune import metrics
from flighttune.arrays import FloatArray
from flighttune.control.gains import PIGains
from flighttune.flight.models import loop_measures
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import ExpectTable, in_rad
from flighttune.simulate.measures import SETTLING_BAND, SMALLEST_STEP
from flighttune.simulate.run import Run
from flighttune.units import DEG

Sense: TypeAlias = Literal["at_most", "at_least"]

# Measures by subject, as of `flighttune.metrics.measures`
Measured: TypeAlias = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundCheck:
    """A measure of a run against one bound of the scenario."""

    run: str  # Label of the run; empty if only one run is checked
    subject: str  # ``chi``, ``gamma``, ``flight`` or ``loop``
    # Key of the measure as the scenario writes it; ``_deg`` in place of ``_rad`` is in degrees
    measure: str
    sense: Sense
    # Both in the unit of `measure`; the value is NaN if the run has none
    bound: float
    value: float
    why: str = ""  # Why a response did not settle before the last quarter of the flight
    flown: bool = True  # False for a run that did not end as it must: it has no value to compare

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
        """Whether there is a value and it keeps the bound."""
        return self.beyond <= 0.0  # False for NaN

    @property
    def sentence(self) -> str:
        """Bound, value and difference in one clause."""
        wanted = f"{self.sense.replace('_', ' ')} {self.bound:g}"
        if math.isnan(self.value):
            got = "nan (there is no value)"
        else:
            got = f"{self.value:.4g}" + ("" if self.met else f" (missed by {self.beyond:.3g})")
        why = f": {self.why}" if self.why and not self.met else ""
        return f"{self.subject}.{self.measure} must be {wanted}, got {got}{why}"


class Counts(NamedTuple):
    """Numbers of requirements: bounds, and runs whose end is stated or wrong."""

    requirements: int = 0
    met: int = 0
    not_flown: int = 0  # bounds of runs that did not end as they must, and such runs without any


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimCheck:
    """The claim of a scenario against its runs."""

    # Not tested if no ``[[expect]]`` is about these runs and all were completed
    verdict: Literal["met", "not met", "not tested"]
    counts: tuple[Counts, ...]  # Those of each run
    bounds: tuple[BoundCheck, ...]  # Every bound, in the order of the runs
    # A sentence for each requirement that a run does not meet: the run, the measure, its bound,
    # the value and by how much it missed; or how the run ended
    missed: tuple[str, ...]

    @property
    def total(self) -> Counts:
        """Requirements of all runs."""
        return Counts(*(sum(numbers) for numbers in zip(*self.counts, strict=True)))

    @property
    def lower(self) -> list[BoundCheck]:
        """Bounds below an error or time that has none above, which a poor flight meets."""
        return _lower(self.bounds)

    @property
    def short(self) -> str:
        """The verdict with the number of requirements that are met, missed and not flown."""
        if self.verdict == "not tested":
            return "Claim not tested: no [[expect]] is about these runs; all were completed"
        n, met, not_flown = self.total
        stated = f"{n} requirement{'s' if n > 1 else ''}"
        if self.verdict == "met":
            poor = len(self.lower)
            lower = f" ({poor} lower bound{'s' * (poor > 1)})" if poor else ""
            return f"Claim met: {met} of {stated}{lower}"
        counts = {"met": met, "missed": n - met - not_flown}
        counts |= {"not flown": not_flown} if not_flown else {}
        words = ", ".join(f"{number} {what}" for what, number in counts.items())
        return f"Claim not met: of {stated} {words}"

    @property
    def closest(self) -> str:
        """The bound that is met with the least to spare, of a claim that is met."""
        if self.verdict != "met" or not self.bounds:
            return ""
        tightest = max(self.bounds, key=lambda check: check.margin)
        poor = "a poor flight meets a lower bound; " if self.lower else ""
        return f"{poor}closest to its bound: {tightest.run}: {tightest.sentence}"

    @property
    def sentence(self) -> str:
        """The verdict with the first requirement that is missed, or with the tightest bound."""
        return "; ".join(filter(None, [self.short, *(self.missed[:1] or [self.closest])]))


def check_claim(scenario: Scenario, runs: Sequence[Run]) -> ClaimCheck:
    """Check every run against the ``[[expect]]`` tables of its scenario."""
    bounds: list[BoundCheck] = []
    sentences: list[str] = []
    counts: list[Counts] = []
    for run in runs:
        made_by, measured = run.provenance, {}
        tables = scenario.expected(made_by.plant, made_by.gains_name)
        stated = any(table.status for table in tables)
        if flown := not _wrong_end(tables, run.status, run.reason):
            loop = bounded_loop(tables, scenario, made_by.gains_name, made_by.gains)
            measured = {**metrics.measures(run), **loop}
        checks = [replace(x, flown=flown) for x in bound_checks(tables, measured, run.label)]
        late = not_followed(tables, measured)
        misses = missed(tables, run.status, run.reason, measured)
        sentences += [f"{run.label}: {miss}" for miss in misses]
        # A stated end is missed; without one and without bounds the run itself was not flown.
        end = stated or bool(late) or not (flown or checks)
        met = sum(check.met for check in checks) + int(stated and flown and not late)
        not_flown = 0 if flown else len(checks) or int(not stated)
        counts.append(Counts(len(checks) + int(end), met, not_flown))
        bounds += checks
    tested = any(count.requirements for count in counts)
    return ClaimCheck(
        verdict="not met" if sentences else "met" if tested else "not tested",
        counts=tuple(counts),
        bounds=tuple(bounds),
        missed=tuple(sentences),
    )


def bounded_loop(
    tables: Sequence[ExpectTable], scenario: Scenario, name: str, gains: PIGains | None
) -> Measured:
    """Measures of the linear loop of a gain set, as ``loop``, where a table bounds one."""
    bounds = (bounds for table in tables for bounds in (table.at_most, table.at_least))
    wanted = {in_rad(measure) for own in bounds for measure in own.get("loop", ())}
    if gains is None or not wanted:
        return {}
    return {"loop": loop_measures(scenario, name, gains, wanted)}


def missed(
    tables: Sequence[ExpectTable], status: str, reason: str, measured: Measured
) -> tuple[str, ...]:
    """Return a sentence for each requirement of `tables` that one run does not meet."""
    if wrong_end := _wrong_end(tables, status, reason):
        return (wrong_end,)
    misses = [check.sentence for check in bound_checks(tables, measured) if not check.met]
    return tuple(filter(None, (*misses, not_followed(tables, measured))))


def _wrong_end(tables: Sequence[ExpectTable], status: str, reason: str) -> str:
    """Fault in the way a run ended; empty if there is none."""
    expected = [t.status for t in tables if t.status] or ["completed"]
    if status in expected:
        return ""
    wanted = "" if expected == ["completed"] else f", must be {' or '.join(expected)}"
    return f"{status}{wanted}: {reason or 'flown to its end'}"


def not_followed(tables: Sequence[ExpectTable], measured: Measured) -> str:
    """Why a completed run does not follow its reference to the end; empty if it does."""
    # The question is not asked without a bound, where another end is stated, or of a channel with a
    # lower bound on an error or a time, which a poor flight meets.
    bounds = [*bound_checks(tables, {})]
    if not bounds or any(table.status not in (None, "completed") for table in tables):
        return ""
    poor = {check.subject for check in _lower(bounds)}
    shares = (
        (values["end_error"] / values["end_allowed"], channel)
        for channel, values in measured.items()
        if "end_error" in values and channel not in poor
    )
    share, channel = max(shares, default=(0.0, ""))
    if share <= 1.0:
        return ""
    per, unit = (1.0, "m/s") if channel == metrics.AIRSPEED else (DEG, "deg")
    mean, most = (measured[channel][name] / per for name in ("end_error", "end_allowed"))
    return (
        f"{channel} does not follow its reference to the end: the mean error there must be at most "
        f"{most:.3g} {unit}, got {mean:.3g}"
    )


def _lower(bounds: Sequence[BoundCheck]) -> list[BoundCheck]:
    """Bounds below an error or time of a channel that has none above."""
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
    """Bound of an error at each sample, SI, of every envelope that is required of a run."""
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
    """Why a response was not settled before the last quarter of its flight; else empty."""
    band, late = metrics.settling_band(name), measured.get("late_rad", 0.0)
    least = measured.get("settling_band_rad", math.inf) if band is None else band
    if not (name.startswith("settling_s") and late > least):
        return ""
    if band is None and least < SETTLING_BAND * SMALLEST_STEP:
        return "no change is commanded of which 5 % could be a band: state `band_deg` beside it"
    what = "the band" if band else "5 % of the change"
    left = f"errors in the last quarter of the flight reach {late / DEG:.2g} deg"
    return f"{what} is {least / DEG:.2g} deg, {left}"
