"""A sentence of the paper, the comparisons it comes down to, and the verdict they give."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

import pandas as pd

from flighttune.paper.study import Study
from flighttune.present.numbers import number

Verdict: TypeAlias = Literal["reproduced", "partly", "not reproduced", "not checkable"]

VERDICTS: tuple[Verdict, ...] = ("reproduced", "partly", "not reproduced", "not checkable")


@dataclass(frozen=True, slots=True)
class Check:
    """One comparison."""

    what: str  # what is compared, with its unit
    expected: str | float  # what the paper says
    computed: str | float  # what comes out
    holds: bool  # whether the two agree


Checks: TypeAlias = Iterator[Check]


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A sentence of the paper."""

    id: str  # short name
    text: str  # what the paper says, shortened
    where: str  # its place in the paper
    # From a study to the comparisons; none where the claim cannot be checked
    checks: Callable[[Study], Iterable[Check]]
    missing: str = ""  # what would be needed where there are no comparisons

    def judge(self, study: Study) -> "Finding":
        """Make the comparisons with the numbers of a study."""
        return Finding(claim=self, checks=tuple(self.checks(study)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A claim with its comparisons made."""

    claim: Claim
    checks: tuple[Check, ...]

    @property
    def verdict(self) -> Verdict:
        """Reproduced where all comparisons agree, partly where some do."""
        agreeing = sum(check.holds for check in self.checks)
        if not self.checks:
            return "not checkable"
        if agreeing == len(self.checks):
            return "reproduced"
        return "partly" if agreeing else "not reproduced"

    @property
    def expected(self) -> dict[str, str | float]:
        """Value that the paper states for each quantity compared."""
        return {check.what: check.expected for check in self.checks}

    @property
    def computed(self) -> dict[str, str | float]:
        """Computed value of each quantity compared, or the reason for which there is none."""
        if not self.checks:
            return {"missing": self.claim.missing}
        return {check.what: check.computed for check in self.checks}


def uncheckable(_: Study) -> Checks:
    """No comparison at all."""
    return iter(())


def at_most(what: str, value: float, limit: float) -> Check:
    """`value` must not exceed `limit`."""
    return Check(what, f"≤ {limit:.4g}", value, value <= limit)


def at_least(what: str, value: float, limit: float, *, symbol: str = "") -> Check:
    """`value` must not be below `limit`, which may be named by a symbol."""
    name = f"{symbol} = " if symbol else ""
    return Check(what, f"≥ {name}{limit:.4g}", value, value >= limit)


def below(what: str, value: float, limit: float) -> Check:
    """`value` must be less than `limit`."""
    return Check(what, f"< {limit:.4g}", value, value < limit)


def printed_number(what: str, value: float, number: float, last_digit: float) -> Check:
    """`value` must be a printed number to one unit of its last digit."""
    return Check(what, number, value, abs(value - number) <= last_digit)


def all_steps(what: str, agreeing: int, count: int) -> Check:
    """Every step from one neighbour to the next must go the way that the paper says."""
    computed = f"{agreeing} of {count} steps"
    return Check(what, f"{count} of {count} steps", computed, agreeing == count)


def rising_steps(values: pd.Series) -> tuple[int, int]:
    """Number of neighbours at which a series rises, and of all neighbours."""
    change = values.diff().dropna()
    return int((change > 0.0).sum()), len(change)


def lower_with_higher_R_K(name: str, from_high_to_low: pd.Series) -> Check:
    """A measure must rise at every step from the highest R_K to the lowest."""
    return all_steps(f"{name} lower with higher R_K", *rising_steps(from_high_to_low))


def text_of(value: str | float) -> str:
    """An expected or computed value for a table: a number with five digits."""
    return value if isinstance(value, str) else number(value, ".5g")
