"""A plan flown into a folder by the workers of a cluster; what is there already is not flown."""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from flighttune.campaign.dataset.dataset import Dataset
from flighttune.campaign.dataset.kept import chosen
from flighttune.campaign.dataset.lock import held
from flighttune.campaign.dataset.spans import Chunks, Span, missing
from flighttune.campaign.dataset.storage import Store
from flighttune.campaign.engine.chunk_rows import chunk_rows
from flighttune.campaign.engine.cluster import cluster
from flighttune.campaign.engine.cluster_tasks import Workers
from flighttune.campaign.engine.dispatch import Task, dispatch
from flighttune.campaign.engine.looks import looks, widest
from flighttune.campaign.engine.progress import CampaignOutcome, CampaignProgress, Tally
from flighttune.campaign.engine.start import counted, started
from flighttune.campaign.engine.worker import FlownChunk, fly_chunk, fly_signals, stand_down
from flighttune.campaign.planning.plan import Plan


class Onlooker(Protocol):
    """Who looks on while a campaign is flown, and may stop it."""

    @property
    def stopped(self) -> bool:
        """Whether to stop; what has been flown stays."""
        ...

    def see(self, progress: CampaignProgress) -> None:
        """How far the campaign is."""
        ...

    def hear(self, sentence: str) -> None:
        """Something out of the ordinary."""
        ...


class _Nobody:
    stopped = False

    def see(self, progress: CampaignProgress) -> None:
        """Look away."""

    def hear(self, sentence: str) -> None:
        """Look away."""


def run_campaign(
    plan: Plan,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    until_halfwidth: float | None = None,
    onlooker: Onlooker | None = None,
) -> CampaignOutcome:
    """Fly a campaign, or what is missing of it.

    Parameters
    ----------
    plan : Plan
        What to fly.
    out : str or Path
        Folder of the rows: a local one, or any URL that fsspec knows. Only this process writes.
    workers : int, optional
        Processes on this machine; by default one a core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    resume : bool
        Fly on with the campaign in `out`, if there is one.
    until_halfwidth : float, optional, 1
        Stop as soon as the 95 % interval of every group's rate of success is that narrow.
    onlooker : Onlooker, optional
        Told how far the campaign is; may stop it.

    Returns
    -------
    CampaignOutcome
        Runs that failed are rows like any other.

    Raises
    ------
    InputError
        If `out` holds another campaign, or is in use; if dask.distributed is not installed.
    OutputError
        If `out` cannot be written: the disk may be full. What is there is whole.
    CampaignError
        If the cluster is gone. What is there is whole.
    """
    began = time.perf_counter()
    onlooker = onlooker or _Nobody()
    looked = list(looks(plan, until_halfwidth))
    halfwidth = None
    with cluster(workers, scheduler) as hire, held(store := Store(out)):
        dataset = started(store, plan, resume=resume)
        dataset.clean()
        flight = _Flight(dataset, counted(dataset, onlooker.hear), hire, onlooker)
        done = True
        for runs in looked:
            done = flight.fly(runs)
            if not done or until_halfwidth is None:
                break
            halfwidth = widest(dataset, runs)
            if halfwidth <= until_halfwidth:
                break
        done = done and flight.keep()
        dataset.clean()
    return flight.outcome(time.perf_counter() - began, halfwidth, interrupted=not done)


class _Flight:
    """A campaign in flight: its rows so far, and the workers once they are needed."""

    def __init__(
        self,
        dataset: Dataset,
        tally: Tally,
        hire: Callable[[], Workers],
        onlooker: Onlooker,
    ) -> None:
        self._dataset, self._tally = dataset, tally
        self._hire, self._onlooker = hire, onlooker
        self._before = tally.runs
        self._text = json.dumps(dataset.plan.as_dict())
        self._limit = dataset.plan.campaign.time_limit_s
        self._flying_since: float | None = None

    def fly(self, runs: int) -> bool:
        """Fly what is missing of the first `runs`; return whether all of it was."""
        plan = self._dataset.plan
        chunks = Chunks(missing(self._dataset.spans, runs), draw=len(plan.groups))
        fixed = (self._text, self._dataset.versions)

        def take(threads: int) -> Task | None:
            span = chunks.take(threads)
            return span and Task(span, fly_chunk, (*fixed, *span, self._limit))

        def over(span: Span, found: dict[str, Any]) -> None:
            chunk = FlownChunk(**found)
            rows = chunk_rows(self._dataset.plan, span, chunk)
            self._dataset.write_part(rows)
            self._tally.add(rows)
            if not chunk.fallen:
                chunks.learn(span, chunk.seconds)

        return not chunks.left or self._dispatch(take, over, "flying", runs)

    def keep(self) -> bool:
        """Keep the signals that the rows ask for; return whether all were."""
        wanted = chosen(self._dataset)
        there = self._dataset.kept
        for run in set(there) - set(wanted):
            self._dataset.remove_signals(run)
        left = sorted(set(wanted) - set(there), reverse=True)

        def take(_threads: int) -> Task | None:
            if not left:
                return None
            run = left.pop()
            return Task(run, fly_signals, (self._text, run, self._limit))

        def over(run: int, signals: bytes) -> None:
            if signals:
                self._dataset.write_signals(run, signals)
            else:
                self._onlooker.hear(f"run {run}: did not end when it was flown for its signals.")

        return not left or self._dispatch(take, over, "keeping signals", self._tally.runs)

    def outcome(
        self, wall: float, halfwidth: float | None, *, interrupted: bool
    ) -> CampaignOutcome:
        """What is there now."""
        tally = self._tally
        flown = tally.runs - self._before
        return CampaignOutcome(
            dataset=self._dataset.url,
            planned=self._dataset.plan.runs,
            runs=tally.runs,
            completed=tally.completed,
            failed=tally.failed,
            crashed=tally.crashed,
            succeeded=tally.succeeded,
            statuses=dict(sorted(tally.statuses.items())),
            flown=flown,
            kept=len(self._dataset.kept),
            wall_s=wall,
            rate_per_s=flown / wall,
            halfwidth=halfwidth,
            interrupted=interrupted,
        )

    def _dispatch(
        self,
        take: Callable[[int], Task | None],
        over: Callable[..., None],
        doing: str,
        runs: int,
    ) -> bool:
        if self._flying_since is None:
            self._see("starting", runs, 0, 0)
        workers = self._hire()
        self._flying_since = self._flying_since or time.perf_counter()
        all_done = dispatch(
            workers,
            take,
            over,
            look=lambda waiting, threads: self._see(doing, runs, waiting, threads),
            stopped=lambda: self._onlooker.stopped,
        )
        if not all_done:
            workers.stop(stand_down)
        return all_done

    def _see(self, doing: str, runs: int, waiting: int, threads: int) -> None:
        since, tally = self._flying_since, self._tally
        flown = tally.runs - self._before
        rate = flown / (time.perf_counter() - since) if since is not None and flown else 0.0
        self._onlooker.see(
            CampaignProgress(
                doing=doing,
                done=tally.runs,
                runs=runs,
                failed=tally.failed,
                crashed=tally.crashed,
                waiting=waiting,
                workers=threads,
                rate_per_s=rate,
                left_s=(runs - tally.runs) / rate if rate else None,
            )
        )
