"""Commands about campaigns: fly them, report on them, fly a run again, tune by flying."""

import math
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option, Typer

from flighttune.cli.command import add_command
from flighttune.cli.gain_sets import gains_table, gains_values, save_answer
from flighttune.cli.options import (
    GainsFileOption,
    campaign_names,
    check_ending,
    out_folder,
)
from flighttune.cli.progress import campaign_display, campaign_pool, duration, progress_bar, rate
from flighttune.cli.show import INTERRUPTED, NO, emit, fail, pick, tell
from flighttune.errors import CampaignError, OutputError, RecordingError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.numbers import percent
from flighttune.present.tables import Column, Table

if TYPE_CHECKING:
    from flighttune.campaign.choice import CandidateResult, RobustChoice, RobustSettings
    from flighttune.campaign.dataset import Dataset
    from flighttune.campaign.engine.progress import CampaignOutcome
    from flighttune.campaign.planning.plan import Plan
    from flighttune.campaign.statistics.intervals import Estimate

KEPT = "what has been flown is kept, go on with the same command and --resume"
CRASHED = ("crashed", "timed_out")
"""Statuses of runs without measures to compare, which may crash or hang again if flown here."""

OF_BEST = (
    *("name", "K_P", "K_I", "R_K", "I_K"),
    *("value", "interval", "success", "success_interval"),
)
"""Keys of the chosen candidate that stand at the top of the JSON object of `tune`."""

CANDIDATE_COLUMNS = [
    *columns("name I_K R_K draws"),
    Column("success", "succeed", "%", percent, ends=("success_interval.0", "success_interval.1")),
    Column("value", "percentile", ends=("interval.0", "interval.1")),
    Column("behind", "behind", ends=("behind_interval.0", "behind_interval.1")),
    Column("p_best", "probability to be the best"),
]
DIFFERENCE_COLUMNS = [
    *columns("column"),
    Column("in_row", "in the row", digits=".17g"),
    Column("flown", "flown", digits=".17g"),
]
COST_COLUMNS = [
    *columns("core_s workers wall_s"),
    Column("rows_bytes", "rows", "MB", factor=1e-6),
    Column("signals_bytes", "signals, at most", "MB", factor=1e-6),
]

CampaignArgument = Annotated[
    str,
    Argument(
        metavar="CAMPAIGN",
        help="A campaign file, or the name of a shipped one.",
        autocompletion=campaign_names,
    ),
]
WorkersOption = Annotated[
    int | None, Option(help="Processes on this machine [default: one per core].", min=1)
]
SchedulerOption = Annotated[
    str | None,
    Option(metavar="ADDRESS", help="Fly on the workers of a dask scheduler, tcp://HOST:PORT."),
]


def report(
    folder: Annotated[
        str, Argument(metavar="DIR", help="Folder of a campaign; it may still be running.")
    ],
    out: Annotated[
        Path | None,
        Option(
            "--out", "-o", help="HTML file to write [default: DIR/report.html, if DIR is local]."
        ),
    ] = None,
    interval: Annotated[
        Literal["wilson", "clopper-pearson"], Option(help="Confidence interval of rates.")
    ] = "wilson",
    confidence: Annotated[float, Option(help="Confidence of intervals, 0 to 1.")] = 0.95,
) -> None:
    """Report success rates with intervals, failures and influential parameters of a campaign.

    The page is one file and needs no network.
    """
    check_ending(out, ".html", ".htm")
    from flighttune.campaign.dataset import dataset_hash
    from flighttune.campaign.statistics.findings import findings
    from flighttune.campaign.statistics.flights import load_flights
    from flighttune.report.campaign import tables
    from flighttune.report.campaign.page import notes, summary, write_campaign_report

    made = findings(load_flights(folder), method=interval, confidence=confidence)
    if out is None and Path(folder).is_dir():
        out = Path(folder) / "report.html"
    page = None if out is None else write_campaign_report(made, out).path
    groups = made.values["groups"]
    emit(
        Answer(
            values={**made.values, "sha256": dataset_hash(folder)},
            tables=[
                tables.success_table(made, groups),
                tables.reasons_table(groups),
                tables.certified_table(groups),
                tables.paired_table(made),
            ],
            notes=[*summary(made), *notes(made)],
            files={"page": page},
        )
    )


def fly(
    folder: Annotated[str, Argument(metavar="DIR", help="Folder of a campaign.")],
    run: Annotated[int, Option(help="Number of the run, as in the column `run`.", min=0)],
    out: Annotated[Path | None, out_folder("runs/NAME-run-N")] = None,
) -> None:
    """Fly a run of the campaign in DIR again, record it and compare it with its row.

    Exit status 1 if they are not equal to the bit; every difference is listed.
    """
    from flighttune.campaign.dataset import open_dataset
    from flighttune.campaign.flying.refly import fly_again, row_differences
    from flighttune.flight.refly import changed_versions
    from flighttune.recording.record import record

    dataset = open_dataset(folder)
    row = _row(dataset, run)
    if row["status"] in CRASHED:
        tell(f"run {run} {row['status'].replace('_', ' ')} in the campaign: {row['reason']}")
    name = f"{Path(folder).name}-run-{run}"
    with progress_bar() as progress:
        again = fly_again(dataset.plan, run, progress=progress)
    flown = again[f"{row['plant']} / {row['gains']}"]
    files = record(again, out or Path("runs") / name, name=name)
    differences = row_differences(dataset.plan, run, row)
    versions = changed_versions(dataset.versions)
    changed = [
        {"column": change.what, "in_row": change.recorded, "flown": change.reflown}
        for change in differences
    ]
    drawn = [{"parameter": key, "value": row[key]} for key in dataset.plan.keys]
    ended = f"{row['status']}: {row['reason']}" if row["reason"] else row["status"]
    emit(
        Answer(
            values={
                "run": run,
                "plant": row["plant"],
                "gains": row["gains"],
                **pick(flown, "status reason"),
                "equal": not differences,
                "versions": {
                    key: {"campaign": then, "now": now} for key, (then, now) in versions.items()
                },
                "row": row,
                "signals": files.signals,
            },
            tables=[
                Table(
                    title=f"run {run}: {row['plant']} / {row['gains']}, draw {row['draw']}",
                    columns=columns("parameter value"),
                    records=drawn,
                ),
                Table(
                    title="differences",
                    name="differences",
                    columns=DIFFERENCE_COLUMNS,
                    records=changed,
                ),
            ],
            notes=[
                f"row: {ended}; {row['missed'] or 'a success'}",
                *(
                    f"{name}: {then} in the campaign, {now} now"
                    for name, (then, now) in versions.items()
                ),
            ],
            verdict="" if differences else "flown again: status and every measure equal to the bit",
            files={"recording": files.recording},
        )
    )
    if differences:
        fail(f"{folder}: run {run}: {differences[0].sentence}", NO)


def run(
    file: CampaignArgument,
    runs: Annotated[
        int | None, Option(help="Flights in total [default: as in the file].", min=1)
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    out: Annotated[str | None, Option(help="Folder of the dataset [default: runs/NAME].")] = None,
    resume: Annotated[
        bool, Option("--resume", help="Fly the missing runs of the campaign in --out.")
    ] = False,
    until_halfwidth: Annotated[
        float | None,
        Option(
            metavar="H",
            help="Stop once the 95 % interval of every group's success rate is within +-H.",
        ),
    ] = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Show the plan, its time and disk space; keep nothing.")
    ] = False,
) -> None:
    """Fly CAMPAIGN and write a dataset with one row per run.

    A flight that fails is a result: the exit status stays 0. It is 1 if --until-halfwidth was not
    reached, 2 if the campaign was cut short, 130 after Ctrl-C; --resume flies the missing runs.
    """
    from flighttune.campaign.dataset import CAMPAIGN
    from flighttune.campaign.engine.engine import campaign_cost, run_campaign
    from flighttune.simulate.batch import cores

    folder = out or str(Path("runs") / Path(file).stem)
    plan = _planned(file, runs, folder, resume=resume)
    if dry_run:
        emit(_plan(plan, campaign_cost(plan, workers or cores())))
        return
    try:
        with campaign_display() as observer:
            done = run_campaign(
                plan,
                folder,
                workers=workers,
                scheduler=scheduler,
                resume=resume,
                until_halfwidth=until_halfwidth,
                observer=observer,
            )
    except (CampaignError, OutputError) as error:
        if not (Path(folder) / CAMPAIGN).exists():
            raise
        raise type(error)(f"{str(error).removesuffix('.')}; {KEPT}") from error
    emit(_outcome(done))
    if done.interrupted:
        there = f"{done.runs} of {done.planned} runs are in {done.dataset}"
        fail(f"interrupted, {there}; go on with the same command and --resume", INTERRUPTED)
    if until_halfwidth is not None and not (done.halfwidth or 1.0) <= until_halfwidth:
        fail(
            f"the half width must be at most {until_halfwidth:g}, got {done.halfwidth:.3g} after "
            f"all {done.runs} runs; give more --runs",
            NO,
        )


def tune(
    file: CampaignArgument,
    metric: Annotated[
        list[str] | None,
        Option(
            help="Column of a campaign's rows to minimise; several are added up "
            "[default: chi.ITAE]."
        ),
    ] = None,
    percentile: Annotated[float, Option(help="Percentile of the metric to minimise.")] = 95.0,
    min_success: Annotated[
        float, Option(help="Share of the draws, 0 to 1, on which the gains must succeed.")
    ] = 0.0,
    candidates: Annotated[int, Option(min=2, max=200, help="Points of the frontier.")] = 12,
    draws: Annotated[
        int | None, Option(min=1, help="Draws to decide on [default: all of the campaign].")
    ] = None,
    plant: Annotated[
        list[str] | None,
        Option(help="Plant to fly [default: all]; the worst plant of a draw counts."),
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    out: GainsFileOption = None,
) -> None:
    """Choose gains on the frontier of CAMPAIGN's scenario by flying them on its draws.

    The gains with the lowest percentile of a metric are chosen; their probability of being the
    best of the candidates is given.
    """
    from flighttune.campaign.choice import METRICS, RobustSettings, tune_robust
    from flighttune.campaign.planning.load import load_campaign

    check_ending(out, ".json")
    settings = RobustSettings(
        metrics=tuple(metric) if metric else METRICS,
        percentile=percentile,
        least_success=min_success,
        candidates=candidates,
        draws=draws,
        plants=tuple(plant or ()),
    )
    loaded = load_campaign(file)
    with campaign_pool(workers, scheduler) as pool:
        choice = tune_robust(loaded, settings, pool)
    written = out if choice.status == "chosen" else None
    answer = _choice(choice, settings, file, loaded.title, written)
    if written is not None:
        save_answer(written, answer)
    emit(answer)
    if choice.status != "chosen":
        fail(f"{file}: {choice.reason}", INTERRUPTED if choice.status == "interrupted" else NO)


campaign = Typer(
    name="campaign",
    no_args_is_help=True,
    help="Fly a scenario thousands of times, dispersed, on one machine or a cluster.",
)
for function, doing, example in (
    (run, "planning", "flighttune campaign run first_campaign"),
    (report, "reporting", "flighttune campaign report runs/first_campaign"),
    (fly, "flying", "flighttune campaign fly runs/first_campaign --run 6"),
    (tune, "tuning", "flighttune campaign tune first_campaign --candidates 4 --draws 10"),
):
    add_command(campaign, function, doing=doing, example=example)


def _row(dataset: "Dataset", run: int) -> dict[str, Any]:
    for part in dataset.parts:
        if part.span.first <= run < part.span.end:
            return dataset.read_part(part).slice(run - part.span.first, 1).to_pylist()[0]
    raise RecordingError(
        f"{dataset.folder}: `run` must be one that was flown, got {run} of {dataset.plan.runs}."
    )


def _planned(file: str, runs: int | None, folder: str, *, resume: bool) -> "Plan":
    """The plan of a file; a campaign extended by --runs keeps its length when resumed."""
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.campaign.planning.plan import plan_campaign

    plan = plan_campaign(load_campaign(file), runs=runs)
    if runs is None and resume:
        from flighttune.campaign.dataset import CAMPAIGN, open_dataset

        if (Path(folder) / CAMPAIGN).exists():
            return plan.with_runs(max(plan.runs, open_dataset(folder).plan.runs))
    return plan


def _outcome(done: "CampaignOutcome") -> Answer:
    values = pick(done, " ".join(field.name for field in fields(done) if field.name != "dataset"))
    shown = {key: values[key] for key in ("runs", "completed", "failed", "crashed", "succeeded")}
    shown |= {key: n for key, n in done.statuses.items() if key not in shown}
    notes = [
        f"flown now: {done.flown} in {duration(done.wall_s)}, {rate(done.rate_per_s)} a second"
        if done.flown
        else "nothing was missing"
    ]
    if done.halfwidth is not None:
        notes.append(f"half width of the success rates: at most {done.halfwidth:.3g}")
    return Answer(
        values=values,
        tables=[Table(columns=columns(" ".join(shown)), records=[shown])],
        notes=notes,
        files={"dataset": done.dataset},
    )


def _plan(plan: "Plan", cost: dict[str, Any]) -> Answer:
    campaign, keep = plan.campaign, plan.campaign.keep
    disperse = [table.model_dump(mode="json", exclude_none=True) for table in campaign.disperse]
    named = ("key", "distribution", "acts")
    numbers = [
        ", ".join(f"{name} {value}" for name, value in table.items() if name not in named)
        for table in disperse
    ]
    dispersed = [table | {"numbers": own} for table, own in zip(disperse, numbers, strict=True)]
    values = {
        "title": campaign.title,
        **pick(plan, "runs draws"),
        **pick(campaign, "design seed time_limit_s"),
        "disperse": disperse,
        "keep": keep.model_dump(mode="json"),
        **cost,
    }
    terms = columns("runs draws design seed time_limit_s")
    return Answer(
        values=values,
        tables=[
            Table(title=campaign.title, columns=terms, records=[values]),
            Table(title="groups", columns=columns("plant gains run_s"), records=cost["groups"]),
            Table(
                title="dispersed",
                columns=columns("key distribution acts numbers"),
                records=dispersed,
            ),
            Table(
                title=f"cost, from {cost['timed_runs']} runs flown now",
                columns=COST_COLUMNS,
                records=[values],
            ),
        ],
        notes=[
            f"signals kept: the first {keep.failures} failures, the worst {keep.worst} by "
            f"{keep.worst_by}, a sample of {keep.sample}"
        ],
    )


def _choice(
    choice: "RobustChoice", settings: "RobustSettings", file: str, title: str, out: Path | None
) -> Answer:
    best = {} if choice.best is None else _candidate(choice.best)
    candidates = [_candidate(result) for result in choice.candidates]
    beside = [_candidate(result) for result in choice.baselines]
    values = {
        **pick(choice, "status reason"),
        "campaign": file,
        **{key: best.get(key) for key in OF_BEST},
        **pick(settings, "metrics percentile"),
        "p_best": best.get("p_best", math.nan),
        **pick(choice, "loss draws flights"),
        "candidates": candidates,
        "beside": beside,
    }
    if choice.best is None:
        return Answer(values=values)
    heading = f"{title}: {settings.percentile:g}th percentile of {' + '.join(settings.metrics)}"
    chosen = choice.best.candidate
    return Answer(
        values=values,
        tables=[
            Table(title=heading, columns=CANDIDATE_COLUMNS, records=[*candidates, *beside]),
            gains_table(f"{choice.status}: {chosen.name}", chosen.gains),
        ],
        verdict=f"{chosen.name} is the best of {len(candidates)} candidates with probability "
        f"{choice.best.p_best:.2f}; the expected loss to the true best is {choice.loss:.2g}.",
        files={"out": out},
    )


def _candidate(result: "CandidateResult") -> dict[str, Any]:
    return {
        "name": result.candidate.name,
        **gains_values(result.candidate.gains),
        **pick(result.candidate, "R_K I_K"),
        "draws": result.success.n,
        **_estimate("value", result.percentile, "interval"),
        **_estimate("success", result.success),
        "p_best": result.p_best,
        **_estimate("behind", result.behind),
    }


def _estimate(key: str, estimate: "Estimate", interval: str = "") -> dict[str, Any]:
    return {key: estimate.value, interval or f"{key}_interval": [estimate.lo, estimate.hi]}
