"""Fly a plan into a folder, here or on a cluster; runs that have a row are not repeated."""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from flighttune.arrays import check_at_least
from flighttune.campaign.dataset import (
    CAMPAIGN,
    RUNS,
    Dataset,
    locked,
    missing,
    open_dataset,
    runs_to_keep,
    signals_path,
)
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.engine.progress import CampaignObserver
from flighttune.errors import InputError, RecordingError, StoppedError
from flighttune.flight.fly import library_versions
from flighttune.planning.load import load_campaign
from flighttune.planning.plan import Plan, draws_in_words, plan_campaign
from flighttune.present.answer import Answer, Answering, pick
from flighttune.present.names import columns, duration, rate
from flighttune.present.reasons import endings_table
from flighttune.present.tables import Table
from flighttune.records.refly import changed_versions

# Counts of the progress that the outcome has too
COUNTED = ("completed", "failed", "crashed", "succeeded", "flown")


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome(Answering):
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
    groups: int  # plants and gain sets that fly each draw
    endings: list[Mapping[str, Any]]  # run, status and reason of those that are not completed
    interrupted: bool = False  # stopped before its end

    def answer(self) -> Answer:
        """Flights by their status, and the time they took; status 130 if they were interrupted."""
        counts = pick(self, "runs completed failed crashed succeeded")
        counts |= {key: n for key, n in self.statuses.items() if key not in counts}
        notes = [f"{self.runs} flights = {draws_in_words(self.runs, self.groups)}"]
        if self.flown:
            speed = f"{rate(self.rate_per_s)} a second"
            notes.append(f"flown now: {self.flown} in {duration(self.wall_s)}, {speed}")
        else:
            notes.append("nothing was missing")
        interrupted = (
            f"interrupted, {self.runs} of {self.planned} runs are in {self.dataset}; go on with "
            "the same command and --resume"
        )
        return Answer(
            values={
                key: value
                for key, value in asdict(self).items()
                if key not in ("dataset", "groups", "endings")
            },
            tables=[Table(columns(" ".join(counts)), [counts]), endings_table(self.endings)],
            notes=notes,
            files={"dataset": self.dataset},
            failure=interrupted if self.interrupted else "",
            status=130,
        )


def run_campaign(
    campaign: Plan | str | Path,
    out: str | Path,
    *,
    runs: int | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    observer: CampaignObserver | None = None,
) -> CampaignOutcome:
    """Fly a campaign, or the runs that are missing from it.

    Parameters
    ----------
    campaign : Plan, str or Path
        A plan, a campaign file, or the name of a shipped one.
    out : str or Path
        Folder of the rows. Only this process writes.
    runs : int, optional
        Total number of flights; by default that of the plan or file.
    workers : int, optional
        Processes that fly on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    resume : bool
        Continue the campaign in `out`, if there is one.
    observer : CampaignObserver, optional
        Receives the progress; may stop the campaign.

    Returns
    -------
    CampaignOutcome
        Runs that failed are rows like any other.

    Raises
    ------
    InputError
        If the campaign cannot be read; if `out` holds another campaign, or is in use; if
        dask.distributed is not installed.
    OutputError
        If `out` cannot be written, e.g. on a full disk. Files already written are complete.
    CampaignError
        If the cluster is gone. Files already written are complete.

    Examples
    --------
    >>> ft.run_campaign("first_campaign", "runs/first", runs=4).completed
    4
    """
    began = time.perf_counter()
    plan = campaign if isinstance(campaign, Plan) else plan_campaign(load_campaign(campaign))
    if runs is not None:
        check_at_least(1, runs=runs)
        plan = plan.with_runs(runs)
    with WorkerPool(workers, scheduler, observer) as pool, locked(Path(out)):
        dataset = _dataset(out, plan, resume=resume)
        dataset.clean()
        _count(dataset, pool)
        plan = dataset.plan
        gaps = missing((part.runs for part in dataset.parts), plan.runs)
        interrupted = False
        try:
            dataset.write_rows(pool.rows(plan, chain.from_iterable(gaps)), gaps)
            _keep_signals(dataset, pool)
        except StoppedError:
            interrupted = True
        dataset.clean()
    wall, progress = time.perf_counter() - began, pool.progress
    return CampaignOutcome(
        dataset=str(out),
        planned=plan.runs,
        runs=progress.done,
        **{name: getattr(progress, name) for name in COUNTED},
        statuses=dict(sorted(progress.statuses.items())),
        kept=len(dataset.kept),
        groups=len(plan.groups),
        endings=progress.endings,
        wall_s=wall,
        rate_per_s=progress.flown / wall,
        interrupted=interrupted,
    )


def _keep_signals(dataset: Dataset, pool: WorkerPool) -> None:
    """Keep the signals of `runs_to_keep` and no others."""
    wanted, present = set(runs_to_keep(dataset)), set(dataset.kept)
    for run in present - wanted:
        dataset.remove(signals_path(run))
    for run, signals in pool.signals(dataset.plan, sorted(wanted - present)):
        dataset.write_signals(run, signals)


def _dataset(out: str | Path, plan: Plan, *, resume: bool) -> Dataset:
    """The folder of a campaign with its ``campaign.json``, new or to be resumed."""
    folder, versions = Path(out), library_versions()
    if (folder / CAMPAIGN).exists():
        dataset = open_dataset(out)
        was, now = dataset.plan.runs, plan.runs
        if not resume:
            raise InputError(
                f"{out}: must not hold a campaign, got one of {was} runs; go on with it by "
                "--resume, or give another --out."
            )
        plan = plan.with_tuned_gains_of(dataset.plan)
        if changed := dataset.plan.with_runs(now).differences(plan):
            raise InputError(f"{out}: holds another campaign: {'; '.join(changed)}.")
        if other := changed_versions(dict.fromkeys(versions, "absent") | dataset.versions):
            changes = [f"{name}: was {then}, is {now}" for name, (then, now) in other.items()]
            raise InputError(f"{out}: was flown with other libraries: {'; '.join(changes)}.")
        if now < was or (now > was and not plan.extendable):
            design = plan.campaign.design
            may = "can only grow" if plan.extendable else f"must stay with {design} draws"
            raise InputError(f"{out}: `runs` of a campaign {may}, was {was}, is {now}.")
        if now == was:
            return dataset
    elif any((folder / RUNS).glob("*")):
        raise InputError(f"{out}: must be empty, got {RUNS}/ without {CAMPAIGN}.")
    dataset = Dataset(out, plan, versions)
    dataset.write_plan()
    return dataset


def _count(dataset: Dataset, pool: WorkerPool) -> None:
    """Count the rows on disk; a damaged file is removed, so that its runs are flown again."""
    for part in dataset.parts:
        try:
            rows = dataset.read_part(part, ["run", "status", "success", "reason"])
        except RecordingError as error:
            pool.observer.hear(str(error))
            dataset.remove(part.path)
        else:
            pool.progress.add(rows.to_pylist())
