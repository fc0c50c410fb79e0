"""Fly a plan into a folder, here or on a cluster; forecast its flights, time and disk space."""

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Unpack

import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arrays import check_at_least
from flighttune.base.errors import (
    DifferenceError,
    InputError,
    OutputError,
    RecordingError,
    StoppedError,
)
from flighttune.base.files import code
from flighttune.base.files.load import CAMPAIGN
from flighttune.base.processors import cores
from flighttune.campaigns.dataset import (
    RUNS,
    Dataset,
    compiled_of,
    locked,
    open_dataset,
    parquet_bytes,
)
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.columns import table_of
from flighttune.campaigns.flying.compiled import CompiledFlights
from flighttune.campaigns.planning.knowing import Knowledge, knowing
from flighttune.campaigns.planning.plan import Group, Plan, plan_campaign
from flighttune.campaigns.planning.source import load_campaign
from flighttune.campaigns.statistics.count import looks
from flighttune.campaigns.statistics.findings import SUCCESS, Answers, answers
from flighttune.flight.fly import library_versions
from flighttune.flight.records.refly import other_libraries

# A timing that takes at least this long is accurate enough, s
ENOUGH_S = 0.25

# Growth factor of the number of runs between timings
MORE = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Forecast(Answering):
    """A plan with its expected cost."""

    plan: Plan
    cost: Mapping[str, Any]  # as in `_cost`; empty for a plan that runs a user's code


def forecast(plan: Plan, workers: int | None = None) -> Forecast:
    """Flights, dispersions, saved signals and cost of a plan, from a few flown runs."""
    # A forecast must not run other people's code.
    return Forecast(plan=plan, cost={} if plan.code else _cost(plan, workers or cores()))


def _cost(plan: Plan, workers: int) -> dict[str, Any]:
    """Fly a few runs of a plan in one process and estimate the cost of all runs."""
    size = min(len(plan.groups), plan.runs)
    with WorkerPool(Fliers(workers=1)) as pool:
        list(pool.rows(plan, range(size)))  # untimed: starts the process
        while True:
            began = time.perf_counter()
            rows = list(pool.rows(plan, range(size)))
            spent = time.perf_counter() - began
            if size == plan.runs or spent > ENOUGH_S:
                break
            size = min(size * MORE, plan.runs)
        sizes = [len(signals) for _, signals in pool.signals(plan, [0])]
    # The last timing has the most runs: kinematic flights take less time each in a larger batch.
    table, keep = table_of(plan, rows), plan.campaign.keep
    run_s = table.to_pandas().groupby(["plant", "gains"], sort=False)["wall_s"].mean()
    core_s = spent / size * plan.runs
    return {
        "groups": run_s.rename("run_s").reset_index().to_dict("records"),
        "timed_runs": size,
        "core_s": core_s,  # time of all runs on one core
        "workers": workers,
        "wall_s": core_s / workers,
        "rows_bytes": round(len(parquet_bytes(table)) / size * plan.runs),
        "signals_bytes": sum(sizes) * min(plan.runs, keep.failures + keep.worst + keep.sample),
    }


# Counts of the progress that the outcome also has
COUNTED = ("completed", "failed", "crashed", "succeeded", "flown")


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignOutcome(Answering):
    """State of a campaign after a command has flown or resumed it."""

    dataset: str  # folder, as the user gave it
    planned: int  # runs of the plan
    runs: int  # existing runs: completed + failed + crashed
    completed: int  # flown to their end
    failed: int  # runs that ended early, did not start, or took too long
    crashed: int  # runs that crashed their process
    succeeded: int  # runs that met every requirement
    statuses: dict[str, int]  # number of runs by status
    flown: int  # rows flown by this command
    kept: int  # runs with saved signals
    wall_s: float  # s, of this command
    rate_per_s: float  # 1/s, flown / wall_s
    groups: tuple[Group, ...]  # plants and gain sets that fly each draw
    by_group: list[dict[str, Any]]  # label of each group, and numbers of its runs as above
    endings: list[Mapping[str, Any]]  # run, status and reason of runs that are not completed
    # Whether the required share succeeds, by group: yes, no, or empty if it is not sure
    sure: Mapping[str, str] = field(default_factory=dict)
    until_sure: float | None = None  # required share of successful flights
    interrupted: bool = False  # stopped before its end
    assumed: tuple[str, ...] = ()  # assumptions of its scenario, one sentence each
    compiled: CompiledFlights = field(default_factory=CompiledFlights)


@code.flies
def run_campaign(
    campaign: Plan | str | Path,
    out: str | Path,
    *,
    runs: int | None = None,
    resume: bool = False,
    navigation: Knowledge | None = None,
    **by: Unpack[FlownBy],
) -> CampaignOutcome:
    """Fly a campaign, or the runs that are missing from it.

    Parameters
    ----------
    campaign : Plan, str or Path
        A campaign file, or the name of a shipped campaign.
    out : str or Path
        Folder of the rows. Only this process writes to it.
    runs : int, optional
        Flights in total, by default from the file.
    workers : int, optional
        Processes that fly on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    resume : bool
        Fly the runs that `out` lacks.
    navigation : {"exact", "rtk", "standard", "poor"}, optional
        What autopilots know of their motion: a grade of ``[navigation]``, by default that of the
        campaign, else along a route a standard receiver and inertial unit.
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
    DifferenceError
        If a compiled flight is not that of JSBSim. All compiled flights are removed from `out`.

    Examples
    --------
    >>> ft.run_campaign("first_campaign", "runs/first", runs=4).completed
    4
    """
    began, fliers = time.perf_counter(), Fliers(**by)
    if isinstance(campaign, Plan):
        if navigation is not None:
            raise InputError("`navigation` must be absent for a plan, which has its own.")
        plan = campaign
    else:
        plan = plan_campaign(knowing(load_campaign(campaign), navigation))
    if runs is not None:
        check_at_least(1, runs=runs)
        plan = plan.with_runs(runs)
    # A campaign whose runs are all there needs no scheduler.
    with WorkerPool(fliers, at_once=not Path(out).exists()) as pool, locked(Path(out)):
        dataset = _dataset(out, plan, resume=resume)
        dataset.clean()
        _count(dataset, pool)
        plan, sure, before = dataset.plan, {}, pool.progress.done
        interrupted = False
        try:
            sure = _fly(dataset, pool)
            dataset.keep_signals(pool.signals)
        except StoppedError:
            interrupted = True
        except DifferenceError as error:
            raise _without_compiled(dataset, before, error) from error
        dataset.clean()
    wall, progress = time.perf_counter() - began, pool.progress
    return CampaignOutcome(
        dataset=str(out),
        planned=plan.runs,
        runs=progress.done,
        **{name: getattr(progress, name) for name in COUNTED},
        statuses=dict(sorted(progress.statuses.items())),
        kept=len(dataset.kept),
        groups=plan.groups,
        by_group=_by_group(dataset, sorted(progress.statuses)),
        endings=progress.endings,
        sure=sure,
        until_sure=plan.campaign.until_sure,
        wall_s=wall,
        rate_per_s=progress.flown / wall,
        interrupted=interrupted,
        assumed=plan.scenario.assumptions,
        compiled=progress.compiled,
    )


def _without_compiled(dataset: Dataset, before: int, error: DifferenceError) -> DifferenceError:
    """The error of a campaign of so many runs before, after its compiled flights are removed."""
    with suppress(OutputError):  # the difference is what must be reported
        dataset.clean()
        if not before:
            dataset.remove_all()
            return error
        removed = dataset.remove_compiled()
        return DifferenceError(
            f"{error} {removed} runs in files with compiled flights were removed from "
            f"{dataset.folder}; --resume with --jsbsim flies them again."
        )
    return error


def _by_group(dataset: Dataset, statuses: Sequence[str]) -> list[dict[str, Any]]:
    """Numbers of runs of each plant and gain set, by status."""
    names, counts = ["plant", "gains", "status", SUCCESS], []
    rows = dataset.rows(names).to_pandas() if dataset.parts else pd.DataFrame(columns=names)
    for group in dataset.plan.groups:
        own = rows[(rows["plant"] == group.plant) & (rows["gains"] == group.gains)]
        ends = {status: int((own["status"] == status).sum()) for status in statuses}
        completed, crashed = (ends.pop(status, 0) for status in ("completed", "crashed"))
        counts.append(
            {"group": group.label, "runs": len(own), "completed": completed}
            | {"failed": sum(ends.values()), "crashed": crashed}
            | {"succeeded": int(own[SUCCESS].sum()), **ends}
        )
    return counts


def _dataset(out: str | Path, plan: Plan, *, resume: bool) -> Dataset:
    """The folder of a campaign with its ``campaign.json``, new or resumed."""
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
        if other := other_libraries(dataset.versions):
            raise InputError(f"{out}: was flown with other libraries: {other}.")
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


def _fly(dataset: Dataset, pool: WorkerPool) -> Answers:
    """Fly all missing runs, or until every group has an answer; returns the answers."""
    plan = dataset.plan
    if plan.campaign.until_sure is None:
        dataset.write_rows(pool.rows, plan.runs)
        return {}
    sure = {}
    pool.progress.planned = plan.runs
    for draws in looks(plan.draws):
        # The runs at each check must not depend on the progress of an earlier command.
        end = min(draws * len(plan.groups), plan.runs)
        dataset.write_rows(pool.rows, end)
        rows = dataset.rows(["plant", "gains", SUCCESS]).to_pandas()
        sure = answers(rows[rows["run"] < end], plan)
        if all(sure.values()):
            break
    pool.progress.planned = 0
    return sure


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
            pool.progress.compiled += compiled_of(rows)
