"""A sentence of the paper, the comparisons it comes down to, and the verdict they give."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import pandas as pd

from flighttune.paper.study import Study

Verdict: TypeAlias = Literal["reproduced", "partly", "not reproduced", "not checkable"]

VERDICTS: tuple[Verdict, ...] = ("reproduced", "partly", "not reproduced", "not checkable")


@dataclass(frozen=True, slots=True)
class Check:
    """One comparison.

    Attributes
    ----------
    what : str
        What is compared, with its unit.
    expected : str or float
        What the paper says.
    computed : str or float
        What comes out.
    holds : bool
        Whether the two agree.
    """

    what: str
    expected: str | float
    computed: str | float
    holds: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """A checkable sentence.

    Attributes
    ----------
    id : str
        Short name.
    text : str
        What the paper says, shortened.
    where : str
        Where it stands.
    checks : callable
        From a study to the comparisons; none where the claim cannot be checked.
    missing : str
        What would be needed where there are no comparisons.
    """

    id: str
    text: str
    where: str
    checks: Callable[[Study], Iterable[Check]]
    missing: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A claim with its comparisons made.

    Attributes
    ----------
    claim : Claim
    checks : tuple of Check
    """

    claim: Claim
    checks: tuple[Check, ...]

    @property
    def verdict(self) -> Verdict:
        """All comparisons agree, some, none; or there are none."""
        held = sum(check.holds for check in self.checks)
        if not self.checks:
            return "not checkable"
        if held == len(self.checks):
            return "reproduced"
        return "partly" if held else "not reproduced"

    @property
    def expected(self) -> dict[str, str | float]:
        """What the paper says of each thing compared."""
        return {check.what: check.expected for check in self.checks}

    @property
    def computed(self) -> dict[str, str | float]:
        """What comes out for each thing compared; what is missing where nothing can be."""
        if not self.checks:
            return {"missing": self.claim.missing}
        return {check.what: check.computed for check in self.checks}


def judged(claim: Claim, study: Study) -> Finding:
    """The claim held against a study."""
    return Finding(claim=claim, checks=tuple(claim.checks(study)))


def nothing(_: Study) -> tuple[Check, ...]:
    """The comparisons of a claim that cannot be checked."""
    return ()


def at_most(what: str, value: float, limit: float) -> Check:
    """`value` must not exceed `limit`."""
    return Check(what, f"≤ {limit:.4g}", value, value <= limit)


def at_least(what: str, value: float, limit: float) -> Check:
    """`value` must not be below `limit`."""
    return Check(what, f"≥ {limit:.4g}", value, value >= limit)


def printed_number(what: str, value: float, number: float, last_digit: float) -> Check:
    """`value` must be a printed number to one unit of its last digit."""
    return Check(what, number, value, abs(value - number) <= last_digit)


def steps(values: pd.Series) -> tuple[int, int]:
    """Number of neighbours at which a series rises, and of all neighbours."""
    change = values.diff().dropna()
    return int((change > 0.0).sum()), len(change)


def lower_with_higher_R_K(what: str, from_high_to_low: pd.Series) -> Check:
    """A measure must rise at every step from the highest R_K to the lowest."""
    rising, count = steps(from_high_to_low)
    return Check(what, f"{count} of {count} steps", f"{rising} of {count} steps", rising == count)
