"""Progress of a campaign, and the observer that is informed of them."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from flighttune.base.words import duration, rate
from flighttune.campaigns.flying.compiled import CompiledFlights, compiled_in


@dataclass(slots=True, kw_only=True)
class CampaignProgress:
    """Progress of a campaign or a search, which the pool that flies it keeps up to date."""

    doing: str = "starting"  # flying, keeping signals, ...
    runs: int = 0  # runs that are wanted
    statuses: Counter[str] = field(default_factory=Counter)  # of the runs that are there
    succeeded: int = 0  # of the runs that are there
    # ``run``, ``status`` and ``reason`` of those of all phases that were not completed
    endings: list[Mapping[str, Any]] = field(default_factory=list)
    compiled: CompiledFlights = field(default_factory=CompiledFlights)  # of all phases
    flown: int = 0  # rows of all phases that were flown since the pool was made
    budget: int = 0  # most rows of all phases, where a search or count has several; else 0
    planned: int = 0  # runs of a campaign that may end before; else 0
    workers: int = 1  # tasks that can run at a time; 0 while there is no worker
    began: float | None = None  # s, of the performance counter, when the first flight began

    def add(self, rows: Sequence[Mapping[str, Any]]) -> None:
        """Count runs by their rows."""
        self.statuses.update(row["status"] for row in rows)
        self.succeeded += sum(row["success"] for row in rows)
        self.compiled += compiled_in(rows)
        self.endings += [
            {key: row[key] for key in ("run", "status", "reason")}
            for row in rows
            if row["status"] != "completed"
        ]

    @property
    def done(self) -> int:
        """Runs that are there: completed, crashed and failed ones."""
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
        return self.done - self.completed - self.crashed

    @property
    def rate_per_s(self) -> float:
        """Rows flown a second; 0 before the first one."""
        if self.began is None or not self.flown:
            return 0.0
        return self.flown / (time.perf_counter() - self.began)

    @property
    def left_s(self) -> float | None:
        """Time left at this rate, s, of a search at most; None before the first row."""
        done, runs = self.part
        return max(runs - done, 0) / self.rate_per_s if self.flown else None

    @property
    def part(self) -> tuple[int, int]:
        """Runs that are there, and those wanted: of all phases where there is a budget."""
        if self.budget:
            return self.flown, self.budget
        return self.done, self.planned or self.runs

    @property
    def sentence(self) -> str:
        """How many runs are done, left and failed."""
        # a search, or a campaign that flies until it is sure, may end before
        most = "at most " if self.planned or self.doing == "searching" else ""
        done, runs = self.part
        parts = [f"{self.doing}: {done} of {most}{runs} runs"]
        if self.rate_per_s:
            parts.append(f"{rate(self.rate_per_s)} a second")
        if self.left_s is not None and (self.budget or self.doing == "flying"):
            parts.append(f"{most}{duration(self.left_s)} left")
        for count, what in ((self.failed, "failed"), (self.crashed, "crashed")):
            if count:
                parts.append(f"{count} {what}")
        return ", ".join(parts)


class CampaignObserver:
    """Receives the progress of a campaign, and may stop it; this one does neither.

    Examples
    --------
    >>> class Seen(ft.CampaignObserver):
    ...     def see(self, progress):
    ...         self.runs = progress.runs
    >>> seen = Seen()
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "workers": 1}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", observer=seen, **few)
    >>> seen.runs
    7
    """

    stopped = False  # set to True to stop; what has been flown stays

    def see(self, progress: CampaignProgress) -> None:
        """Report the progress of the campaign."""

    def hear(self, sentence: str) -> None:
        """Report something out of the ordinary."""
