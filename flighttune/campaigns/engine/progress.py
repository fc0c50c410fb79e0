"""Progress of a campaign, and the observer that receives it."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from flighttune.base.words import duration, rate
from flighttune.campaigns.flying.compiled import CompiledFlights, compiled_in


@dataclass(slots=True, kw_only=True)
class CampaignProgress:
    """Progress of a campaign or a search, updated by its pool."""

    doing: str = "starting"  # flying, keeping signals, ...
    stage: str = ""  # words before `doing`, if a command counts several times
    runs: int = 0  # requested runs
    statuses: Counter[str] = field(default_factory=Counter)  # of the runs that are there
    succeeded: int = 0  # of the runs that are there
    # ``run``, ``status`` and ``reason`` of runs that were not completed, in all phases
    endings: list[Mapping[str, Any]] = field(default_factory=list)
    compiled: CompiledFlights = field(default_factory=CompiledFlights)  # in all phases
    flown: int = 0  # rows flown by this pool, in all phases
    budget: int = 0  # maximum number of rows in all phases of a search or count; else 0
    planned: int = 0  # maximum runs of a campaign that may end earlier; else 0
    workers: int = 1  # number of parallel tasks; 0 without a worker
    began: float | None = None  # s: performance counter at the start of the first flight

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
        """Existing runs: completed, crashed and failed."""
        return self.statuses.total()

    @property
    def completed(self) -> int:
        """Runs that flew to their end."""
        return self.statuses["completed"]

    @property
    def crashed(self) -> int:
        """Runs that crashed their process."""
        return self.statuses["crashed"]

    @property
    def failed(self) -> int:
        """All other runs, which ended early, did not start, or took too long."""
        return self.done - self.completed - self.crashed

    @property
    def rate_per_s(self) -> float:
        """Rows flown per second; 0 before the first row."""
        if self.began is None or not self.flown:
            return 0.0
        return self.flown / (time.perf_counter() - self.began)

    @property
    def left_s(self) -> float | None:
        """Time left at this rate, s, at most for a search; None before the first row."""
        done, runs = self.part
        return max(runs - done, 0) / self.rate_per_s if self.flown else None

    @property
    def part(self) -> tuple[int, int]:
        """Existing and requested runs; of all phases if there is a budget."""
        if self.budget:
            return self.flown, self.budget
        return self.done, self.planned or self.runs

    @property
    def sentence(self) -> str:
        """Numbers of runs that are done, left and failed."""
        # a search, or a campaign that flies until it is sure, may end earlier
        most = "at most " if self.planned or self.doing == "searching" else ""
        done, runs = self.part
        parts = [f"{self.stage}{self.doing}: {done} of {most}{runs} runs"]
        if self.rate_per_s:
            parts.append(f"{rate(self.rate_per_s)} a second")
        if not self.workers:
            parts.append("no worker is there")
        elif self.left_s is not None and (self.budget or self.doing == "flying"):
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

    stopped = False  # set to True to stop; flown runs are kept

    def see(self, progress: CampaignProgress) -> None:
        """Report the progress of the campaign."""

    def hear(self, sentence: str) -> None:
        """Report an unusual event."""
