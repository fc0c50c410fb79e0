"""Check of flown runs against the requirements of their scenario."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Literal, TypeAlias

from flighttune.metrics import measures
from flighttune.present.names import METRIC_LABELS, SYMBOLS
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import Bounds, ExpectTable, in_rad
from flighttune.simulate.run import Run
from flighttune.units import DEG

MAX_BOUNDS = 4
"""Maximum number of bounds in a sentence; of more it names only the closest one."""

MAX_WORDS = 16
"""Maximum number of words of the short sentence."""

FIGURES = 3
"""Significant figures of a measured value, more where rounding would hide a miss."""

Sense: TypeAlias = Literal["at_most", "at_least"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundCheck:
    """A measure of a run against one bound of the scenario."""

    run: str  # Label of the run; empty where only one is checked
    subject: str  # ``chi``, ``gamma`` or ``flight``
    # Key of the measure as the scenario writes it; ``_deg`` in place of ``_rad`` is in degrees
    measure: str
    sense: Sense
    # Both in the unit of `measure`; the value is NaN where the run has none
    bound: float
    value: float

    @property
    def beyond(self) -> float:
        """Distance of the value beyond the bound; NaN without a value."""
        return self.value - self.bound if self.sense == "at_most" else self.bound - self.value

    @property
    def met(self) -> bool:
        """Whether there is a value and it keeps the bound."""
        return self.beyond <= 0.0

    @property
    def miss(self) -> str:
        """Bound, value and difference in one clause."""
        difference = f"missed by {self.beyond:.3g}"
        return (
            f"{self.subject}.{self.measure} must be {self.sense.replace('_', ' ')} {self.bound:g}, "
            f"got {self.value:.4g} "
            f"({difference if math.isfinite(self.beyond) else 'there is no value'})"
        )

    @property
    def inequality(self) -> str:
        """As in ``χ 7.92 <= 8.34``."""
        symbol = SYMBOLS.get(self.subject, "")
        if math.isnan(self.value):
            return f"{symbol} without a value".strip()
        kept, broken = ("<=", ">") if self.sense == "at_most" else (">=", "<")
        rounded = (f"{self.value:.{digits}g}" for digits in range(FIGURES, 18))
        # The fewest digits that still show on which side of the bound the value lies.
        text = next(text for text in rounded if replace(self, value=float(text)).met == self.met)
        return f"{symbol} {text} {kept if self.met else broken} {self.bound:g}".strip()


@dataclass(frozen=True, slots=True, kw_only=True)
class ClaimCheck:
    """The claim of a scenario against its runs."""

    # Not tested where no ``[[expect]]`` is about these runs and all were completed
    verdict: Literal["met", "not met", "not tested"]
    sentence: str  # The verdict with its numbers
    short: str  # The same, only counted where it would be long
    bounds: tuple[BoundCheck, ...]  # Every bound that was checked
    # A sentence for each requirement that a run does not meet: the run, the measure, its bound,
    # the value and by how much it missed
    missed: tuple[str, ...]


def check_claim(scenario: Scenario, runs: Sequence[Run]) -> ClaimCheck:
    """Check every run against the ``[[expect]]`` tables of its scenario.

    A run for which no table names a status must be completed.
    """
    bounds, missed, ends = [], [], []
    for run in runs:
        made_by = run.provenance
        tables = [t for t in scenario.expect if t.meant(made_by.plant, made_by.gains_name)]
        wrong_end = _wrong_end(tables, run.status, run.reason)
        if wrong_end:
            missed.append(f"{run.label}: {wrong_end}")
            continue
        ends += [f"{run.label} {run.status}" for t in tables if t.status][:1]
        bounded = any(t.at_most or t.at_least for t in tables)
        own = list(_bound_checks(tables, measures(run) if bounded else {}, run.label))
        bounds += own
        missed += [f"{run.label}: {check.miss}" for check in own if not check.met]
    verdict = "not met" if missed else "met" if bounds or ends else "not tested"
    expected = len(bounds) + len(ends) + len(missed) - sum(not check.met for check in bounds)
    counted = f"Claim {verdict}: {expected - len(missed)} of {expected} requirements"
    sentence = _sentence(verdict, counted, bounds, missed, ends)
    return ClaimCheck(
        verdict=verdict,
        sentence=sentence,
        short=sentence if len(sentence.split()) <= MAX_WORDS else counted,
        bounds=tuple(bounds),
        missed=tuple(missed),
    )


def missed(
    tables: Sequence[ExpectTable],
    status: str,
    reason: str,
    measured: Mapping[str, Mapping[str, float]],
) -> tuple[str, ...]:
    """Return a sentence for each requirement of `tables` that one run does not meet.

    A run for which no table names a status must be completed. `measured` is empty for a flight too
    short to have any measures.
    """
    wrong_end = _wrong_end(tables, status, reason)
    if wrong_end:
        return (wrong_end,)
    return tuple(check.miss for check in _bound_checks(tables, measured) if not check.met)


def _wrong_end(tables: Sequence[ExpectTable], status: str, reason: str) -> str:
    """Fault in the way a run ended; empty if there is none."""
    expected = [t.status for t in tables if t.status] or ["completed"]
    if status in expected:
        return ""
    wanted = "" if expected == ["completed"] else f", must be {' or '.join(expected)}"
    return f"{status}{wanted}: {reason or 'flown to its end'}"


def _bound_checks(
    tables: Sequence[ExpectTable], measured: Mapping[str, Mapping[str, float]], run: str = ""
) -> Iterator[BoundCheck]:
    for table in tables:
        senses: dict[Sense, Bounds] = {"at_most": table.at_most, "at_least": table.at_least}
        for sense, bounds in senses.items():
            for subject, limits in bounds.items():
                for name, bound in limits.items():
                    value = measured.get(subject, {}).get(in_rad(name), math.nan)
                    yield BoundCheck(
                        run=run,
                        subject=subject,
                        measure=name,
                        sense=sense,
                        bound=bound,
                        value=value / DEG if name.endswith("_deg") else value,
                    )


def _sentence(
    verdict: str,
    counted: str,
    bounds: Sequence[BoundCheck],
    missed: Sequence[str],
    ends: Sequence[str],
) -> str:
    if verdict == "not tested":
        return "Claim not tested: no [[expect]] is about these runs; all were completed"
    if missed and all(check.met for check in bounds):
        more = f" ({len(missed) - 1} more)" if missed[1:] else ""
        return f"Claim not met: {missed[0]}{more}"
    shown = [check for check in bounds if check.met == (verdict == "met")]
    head = f"Claim {verdict}"
    if len(shown) > MAX_BOUNDS:
        shown = [max(shown, key=_nearness)]
        closest = "closest to its bound" if verdict == "met" else "furthest off"
        head = f"{counted}; {closest}"
    return f"{head}: {'; '.join([*_clauses(shown), *ends])}"


def _clauses(bounds: Sequence[BoundCheck]) -> Iterator[str]:
    """Bounds of one measure together, the run behind them: ``ITAE χ 1 <= 2, γ 3 <= 4 (run)``."""
    for run, of_run in groupby(bounds, key=lambda check: check.run):
        parts = []
        for key, alike in groupby(of_run, key=lambda check: check.measure):
            label = METRIC_LABELS[in_rad(key)]
            unit = "rad" if key.endswith("_rad") else label.unit.replace("\u00a0", " ")
            values = ", ".join(check.inequality for check in alike)
            parts.append(f"{label.name} {values} {unit if unit != '1' else ''}".rstrip())
        yield f"{'; '.join(parts)} ({run})"


def _nearness(check: BoundCheck) -> float:
    """Margin relative to the bound; infinite if the run has no value."""
    if math.isnan(check.beyond):
        return math.inf
    return check.beyond / max(abs(check.bound), abs(check.value), 1e-12)
