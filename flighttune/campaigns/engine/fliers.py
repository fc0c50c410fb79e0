"""Who flies the runs of a plan, and who watches: one value, made where a verb begins."""

from dataclasses import dataclass
from typing import TypedDict

from flighttune.base.errors import InputError
from flighttune.campaigns.engine.progress import CampaignObserver


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

    def __post_init__(self) -> None:
        # imported here: the help of a command knows the keywords, and must not wait for NumPy
        from flighttune.base.arrays import check_at_least
        from flighttune.campaigns.engine.cluster import check_scheduler

        if self.workers is not None and self.scheduler is not None:
            raise InputError("`workers` must not be given with `scheduler`, which has its own.")
        check_at_least(1, workers=self.workers)
        if self.scheduler:
            check_scheduler(self.scheduler)
