"""What each part of an answer finds; the worst finding is the verdict.

A part that looks at something, such as a fence, a volume or a target, gives a `PartFinding`.
Headline, exit status and colour of an answer follow from all of them, so none is better than what
stands beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

# Met; met for what was asked, while something beside it is not; not settled; not met.
Found: TypeAlias = Literal["met", "reserve", "open", "not met"]

# From best to worst: how a headline begins, and the exit status.
KINDS: dict[Found, tuple[str, int]] = {
    "met": ("Yes: ", 0),
    "reserve": ("Yes, but ", 0),
    "open": ("Not known: ", 2),
    "not met": ("No: ", 1),
}
ORDER = [*KINDS]


@dataclass(frozen=True, slots=True, kw_only=True)
class PartFinding:
    """What a part of an answer finds."""

    found: Found
    sentence: str = ""  # for the top of the answer, without the beginning of a headline
    reason: str = ""  # one line on why it is not met
    begins: str = ""  # of the headline, if not as in `KINDS`
    state: int | None = None  # exit status, if not as in `KINDS`

    @property
    def rank(self) -> int:
        """Larger is worse."""
        return ORDER.index(self.found)

    @property
    def status(self) -> int:
        """Exit status of an answer of which it is the worst finding."""
        return KINDS[self.found][1] if self.state is None else self.state

    @property
    def headline(self) -> str:
        """The sentence with Yes or No before it."""
        return f"{self.begins or KINDS[self.found][0]}{self.sentence}"


def unmet(reason: str, state: int | None = None) -> list[PartFinding]:
    """A finding that is not met for this reason; none without a reason."""
    return [PartFinding(found="not met", reason=reason, state=state)] if reason else []


def worst_of(findings: Sequence[PartFinding]) -> PartFinding | None:
    """The worst finding, the first of equals; None without any."""
    return max(findings, key=lambda finding: finding.rank, default=None)


def headlines(findings: Sequence[PartFinding]) -> list[str]:
    """The sentences of findings, the worst first; the first says Yes or No for all of them."""
    worst, ordered = worst_of(findings), sorted(findings, key=lambda x: -x.rank)
    said = [finding for finding in ordered if finding.sentence]
    if worst is None or not said:
        return []
    first, *others = said
    lead = first.headline if first.rank == worst.rank else first.sentence
    return [_capital(lead), *(_capital(finding.sentence) for finding in others)]


def _capital(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"
