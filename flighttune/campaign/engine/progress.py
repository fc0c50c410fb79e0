"""Progress and outcome of a campaign, and the observer that is informed of them."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Tally:
    """Statuses and successes of the runs that are there, counted."""

    statuses: Counter[str] = field(default_factory=Counter)
    succeeded: int = 0

    def add(self, statuses: Iterable[str], successes: Iterable[bool]) -> None:
        """Count rows by these columns of theirs."""
        self.statuses.update(statuses)
        self.succeeded += sum(successes)

    @property
    def runs(self) -> int:
        """All that are there."""
        return self.statuses.total()

    @property
    def completed(self) -> int:
        """Runs flown to their end."""
        return self.statuses["completed"]

    @property
    def crashed(self) -> int:
        """Runs that ended the process that flew them."""
        return self.statuses["crashed"]

    @property
    def failed(self) -> int:
        """All others: they ended early, never began, or took too long."""
        return self.runs - self.completed - self.crashed

    def counts(self) -> dict[str, Any]:
        """All counts by name, as `CampaignOutcome` has them."""
        names = ("runs", "completed", "failed", "crashed", "succeeded")
        counts = {name: getattr(self, name) for name in names}
        return {**counts, "statuses": dict(sorted(self.statuses.items()))}


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignProgress:
    """Progress of a campaign."""

    doing: str  # starting, flying, keeping signals, ...
    done: int  # runs that are there
    runs: int  # runs that are wanted
    failed: int = 0  # of those there, as in `CampaignOutcome`
    crashed: int = 0
    waiting: int = 0  # tasks handed out and not over
    workers: int = 0  # tasks that can run at a time; 0 while there is no worker
    rate_per_s: float = 0.0  # runs a second; 0 before the first
    left_s: float | None = None  # s at this rate; None before the first run


class CampaignObserver:
    """Receives the progress of a campaign, and may stop it; this one does neither."""

    stopped = False  # set to True to stop; what has been flown stays

    def see(self, progress: CampaignProgress) -> None:
        """Report the progress of the campaign."""

    def hear(self, sentence: str) -> None:
        """Report something out of the ordinary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome:
    """State of a campaign after it was flown or resumed."""

    dataset: str  # folder, as it was given
    planned: int  # runs of the plan
    runs: int  # runs that are there: completed + failed + crashed
    completed: int  # flown to their end
    failed: int  # ended early, never began, or took too long
    crashed: int  # ended the process that flew them
    succeeded: int  # met every requirement
    statuses: dict[str, int]  # number of runs by status
    flown: int  # rows that were flown this time
    kept: int  # runs whose signals are kept
    wall_s: float  # s, of this time
    rate_per_s: float  # 1/s, flown / wall_s
    halfwidth: float | None = None  # largest of the 95 % intervals of a group's success rate
    interrupted: bool = False  # stopped before its end
