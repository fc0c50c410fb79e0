"""Repeat runs of recordings, campaigns and bands, and compare them to the bit."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import singledispatch
from pathlib import Path
from typing import Unpack

import numpy as np

from flighttune.base.errors import InputError, RecordingError, ScenarioError, naming
from flighttune.base.files import code
from flighttune.base.files.load import BAND, DATASET, RECORDING, load_one
from flighttune.campaigns.dataset import Dataset
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.rows import fly_again, row_differences
from flighttune.campaigns.planning.plan import Plan
from flighttune.claims.band import Band
from flighttune.claims.counted import Counted
from flighttune.claims.counted_flights import plan_of
from flighttune.claims.counting import differing, some_draws
from flighttune.flight.apart import Progress
from flighttune.flight.loop.run import Run
from flighttune.flight.own import LawMaker, PlantMaker, ask_to_fly
from flighttune.flight.records.parquet import Recording
from flighttune.flight.records.refly import (
    CheckedRun,
    Difference,
    Reflown,
    changed_versions,
    reflights,
)

# Default number of random runs of a campaign or band.
DRAWN = 5

FLOWN = "recording, its folder, the Parquet file of a run, the folder of a campaign, or a band"

OTHER_EXTREMES = Difference("extremes", None, "those of the band", "others")


@code.flies_again
def refly(
    source: str | Path | Recording | Dataset | Counted | Sequence[Run],
    run: int | None = None,
    *,
    count: int | None = None,
    run_code: bool = False,  # noqa: ARG001 - of the decorator
    laws: Mapping[str, LawMaker] | None = None,
    plants: Mapping[str, PlantMaker] | None = None,
    progress: Progress | None = None,
    **by: Unpack[FlownBy],
) -> Reflown:
    """Fly recorded runs, rows of a campaign or flights of a band again; compare them to the bit.

    A flight takes as long as in `fly`; one process per core flies the flights of a band.

    Parameters
    ----------
    source : str, Path, Recording, Dataset, Band or sequence of Run
        A recording, its folder or a Parquet file of one run: all runs are flown again, from the
        scenario and seed in them. The folder of a campaign, or the file of a band; or a result of
        `load`.
    run : int, optional
        Number of the run in a campaign (column `run`), or of the draw of a band; by default random
        runs.
    count : int, optional
        Number of random runs of a campaign or band, by default 5; not with `run`.
    run_code : bool
        Run the Python files that the runs name; without it such runs are refused.
    laws, plants : mapping of str to callable, optional
        As for `fly`, if recorded runs were flown with them.
    progress : callable, optional
        Called with the progress of each flight.
    workers, scheduler, observer : as for `band`
        They apply to flights of a band.

    Returns
    -------
    Reflown
        With `run` it also has the flight, with the band around it.

    Raises
    ------
    RecordingError
        If there are no such runs, they belong to several scenarios, or they were not flown by their
        scenario (a rung of a ladder, a figure of the paper).
    ScenarioError
        If a scenario from another version cannot be read, or its code may not run.
    InputError
        If `count` is given without random runs, a band has fewer flights, or the files of an
        aircraft have changed since.

    Examples
    --------
    >>> files = ft.record(ft.fly("paper_as_printed"), "runs/printed")
    >>> ft.refly("runs/printed").equal
    True
    """
    fliers = Fliers(**by)
    if count is not None and (run is not None or count < 1):
        got = f"{count} and run {run}" if run is not None else str(count)
        raise InputError(f"`count` must be at least 1, and absent with `run`, got {got}.")
    asked = _Asked(
        file=str(source) if isinstance(source, str | Path) else "",
        run=run,
        count=count,
        laws=laws,
        plants=plants,
        progress=progress,
        fliers=fliers,
    )
    return _again(load_one(source, FLOWN, RECORDING, DATASET, BAND), asked)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    """Arguments of `refly`, for any source."""

    file: str  # name of the file; empty for a value
    run: int | None
    count: int | None
    laws: Mapping[str, LawMaker] | None
    plants: Mapping[str, PlantMaker] | None
    progress: Progress | None
    fliers: Fliers


@singledispatch
def _again(runs: Sequence[Run], asked: _Asked) -> Reflown:
    """Repeat recorded runs, or random flights of a campaign or count."""
    return _all_again(runs, "the runs", asked)


@_again.register
def _of_recording(recording: Recording, asked: _Asked) -> Reflown:
    name = str(recording.path)
    try:
        again = _all_again(recording.runs, name, asked)
    except (RecordingError, ScenarioError) as error:
        raise RecordingError(f"{name}: {error}") from error
    return replace(again, missing=recording.missing)


@_again.register
def _of_campaign(dataset: Dataset, asked: _Asked) -> Reflown:
    name = str(dataset.folder)
    again = _drawn_again(dataset.plan, name, _rows_again(dataset, name, asked), asked)
    return replace(again, versions=changed_versions(dataset.versions))


@_again.register
def _of_count(counted: Counted, asked: _Asked) -> Reflown:
    name = asked.file or "the band"
    return _drawn_again(plan_of(counted), name, _draws_again(counted, name, asked), asked)


@_again.register
def _of_band(band: Band, asked: _Asked) -> Reflown:
    again = _of_count(band, asked)
    if again.flown is None or asked.run is None:
        return again
    flown = again.flown[plan_of(band).group_of(asked.run).label]
    return again if band.why_not(flown) else replace(again, flown=again.flown.within(band))


def _all_again(runs: Sequence[Run], name: str, asked: _Asked) -> Reflown:
    """Repeat all of some runs."""
    for key, value in {"run": asked.run, "count": asked.count}.items():
        if value is not None:
            raise InputError(f"{name}: `{key}` must be absent: all runs of a recording fly again.")
    checked = reflights(runs, laws=asked.laws, plants=asked.plants, progress=asked.progress)
    changed = [changed_versions(run.provenance.versions) for run in runs]
    versions = {key: pair for run in changed for key, pair in run.items()}
    return Reflown(source=name, runs=checked, versions=versions)


def _drawn_again(plan: Plan, name: str, checked: Iterator[CheckedRun], asked: _Asked) -> Reflown:
    """Check runs of a plan, and fly the run requested by number."""
    with naming(name, ScenarioError):
        ask_to_fly(plan.scenario, plan.flown)
    runs = tuple(checked)
    flown = None if asked.run is None else fly_again(plan, asked.run, progress=asked.progress)
    return Reflown(source=name, runs=runs, flown=flown)


def _rows_again(dataset: Dataset, name: str, asked: _Asked) -> Iterator[CheckedRun]:
    """Check rows of a campaign against repeated runs."""
    plan = dataset.plan
    if asked.run is not None:
        runs = [asked.run]
    else:
        rows = dataset.rows(["run", "status"]).to_pylist()
        # other runs may crash or hang this process
        numbers = [row["run"] for row in rows if row["status"] not in ("crashed", "timed_out")]
        drawn = np.random.default_rng().choice(
            numbers, min(asked.count or DRAWN, len(numbers)), replace=False
        )
        runs = sorted(drawn.tolist())
    for number in runs:
        if (part := next((part for part in dataset.parts if number in part.runs), None)) is None:
            raise RecordingError(
                f"{name}: `run` must be one that was flown, got {number} of {plan.runs}."
            )
        row = dataset.read_part(part).slice(part.runs.index(number), 1).to_pylist()[0]
        reason = row["reason"] or row["missed"]
        yield CheckedRun(
            name=f"run {number}: {row['plant']} / {row['gains']}, draw {row['draw']}",
            status=f"{row['status']}: {reason}" if reason else row["status"],
            differences=row_differences(plan, number, row),
            drawn={key: row[key] for key in (*plan.keys, "seed")},
        )


def _draws_again(band: Counted, name: str, asked: _Asked) -> Iterator[CheckedRun]:
    """Check the extremes of a band against repeated flights."""
    plan, run = plan_of(band), asked.run
    completed = dict(zip(band.draws, np.isfinite(band.scores), strict=True))
    if run is not None and run not in completed:
        first, last = band.draws[[0, -1]]
        raise InputError(f"{name}: `run` must be {first} to {last}, got {run}.")
    draws = some_draws(band, asked.count or DRAWN) if run is None else [run]
    with WorkerPool(asked.fliers) as pool:
        differ = differing(band, draws, pool)
    for draw in draws:
        yield CheckedRun(
            name=f"draw {draw}",
            status="completed" if completed[draw] else "not completed",
            differences=(OTHER_EXTREMES,) if draw in differ else (),
            drawn=plan.values_of(draw),
        )
