"""Workers that fly the runs of a plan, and their observer, as one value made by each verb."""

from dataclasses import dataclass, replace
from typing import TypedDict

from flighttune.base.errors import InputError
from flighttune.base.processors import cores
from flighttune.campaigns.engine.progress import CampaignObserver

# Maximum number of processes for each core.
MOST_PER_CORE = 16


class FlownBy(TypedDict, total=False):
    """Keywords of each verb that flies many runs."""

    workers: int | None
    scheduler: str | None
    observer: CampaignObserver | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Fliers:
    """Processes of this machine, by default one per core, or the workers of a dask scheduler."""

    workers: int | None = None
    scheduler: str | None = None
    observer: CampaignObserver | None = None
    stage: str = ""  # which of several counts of one command they fly

    def __post_init__(self) -> None:
        # imported here: help pages need only the keywords, and must not wait for NumPy
        from flighttune.base.arrays import check_at_least
        from flighttune.campaigns.engine.cluster import check_scheduler

        if self.workers is not None and self.scheduler is not None:
            raise InputError("`workers` must not be given with `scheduler`, which has its own.")
        check_at_least(1, workers=self.workers)
        # Each worker is a process of about 200 MB, and all start at once.
        if (self.workers or 1) > (most := MOST_PER_CORE * cores()):
            raise InputError(
                f"`workers` must be at most {most}, {MOST_PER_CORE} for each core, got "
                f"{self.workers}."
            )
        if self.scheduler is not None:
            check_scheduler(self.scheduler)

    def at_stage(self, number: int, stages: int) -> "Fliers":
        """These, for one of several counts, from 1; a single count is no stage."""
        return replace(self, stage=f"stage {number} of {stages}, " if stages > 1 else "")
