"""Progress and outcome of a campaign, and the observer that is informed of them."""

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # the command line imports this module before anything heavy
    import pyarrow as pa


@dataclass(slots=True)
class Tally:
    """Statuses and successes of the runs that are there, counted."""

    statuses: Counter[str] = field(default_factory=Counter)
    succeeded: int = 0

    def add(self, rows: "pa.Table") -> None:
        """Count the rows of a table."""
        self.statuses.update(rows.column("status").to_pylist())
        self.succeeded += sum(rows.column("success").to_pylist())

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
    """How far a campaign is.

    Attributes
    ----------
    doing : str
        ``starting``, ``flying`` or ``keeping signals``.
    done, runs : int
        Runs that are there, of how many that are wanted.
    failed, crashed : int
        Of those there, as in `CampaignOutcome`.
    waiting : int
        Tasks handed out and not over.
    workers : int
        Tasks that can run at a time; 0 while there is no worker.
    rate_per_s : float, 1/s
        Runs a second since the workers are there; 0 before the first.
    left_s : float or None, s
        Time left at this rate; None while it is not known.
    """

    doing: str
    done: int
    runs: int
    failed: int = 0
    crashed: int = 0
    waiting: int = 0
    workers: int = 0
    rate_per_s: float = 0.0
    left_s: float | None = None


class CampaignObserver:
    """Receives the progress of a campaign, and may stop it; this one does neither.

    Attributes
    ----------
    stopped : bool
        Whether to stop; what has been flown stays.
    """

    stopped = False

    def see(self, progress: CampaignProgress) -> None:
        """How far the campaign is."""

    def hear(self, sentence: str) -> None:
        """Something out of the ordinary."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome:
    """What is there after a campaign was flown or resumed.

    Attributes
    ----------
    dataset : str
        Its folder, as it was given.
    planned : int
        Runs of the plan.
    runs : int
        Runs that are there: ``completed + failed + crashed``.
    completed : int
        Flown to their end.
    failed : int
        Ended early, never began, or took too long.
    crashed : int
        Ended the process that flew them.
    succeeded : int
        Met every requirement.
    statuses : mapping of str to int
        How many there are of each status.
    flown : int
        Rows that were flown this time.
    kept : int
        Runs whose signals are kept.
    wall_s : float, s
        Wall time of this time.
    rate_per_s : float, 1/s
        ``flown / wall_s``.
    halfwidth : float or None, 1
        Largest half width of the 95 % interval of a group's success rate, where one was asked for.
    interrupted : bool
        Whether it was stopped before its end.
    """

    dataset: str
    planned: int
    runs: int
    completed: int
    failed: int
    crashed: int
    succeeded: int
    statuses: dict[str, int]
    flown: int
    kept: int
    wall_s: float
    rate_per_s: float
    halfwidth: float | None = None
    interrupted: bool = False
