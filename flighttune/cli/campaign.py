"""Commands about campaigns: fly them, report on them, fly a run again, tune by flying."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option, Typer

from flighttune.cli.command import add_command
from flighttune.cli.gain_sets import gains_json, gains_table, write_json
from flighttune.cli.options import (
    GainsFileOption,
    campaign_names,
    check_ending,
    out_folder,
)
from flighttune.cli.progress import campaign_display, campaign_pool, duration, progress_bar, rate
from flighttune.cli.show import INTERRUPTED, NO, emit, fail, pick, table, tell
from flighttune.errors import CampaignError, OutputError, RecordingError
from flighttune.present.names import metric_label
from flighttune.present.numbers import MISSING, percent, percent_interval
from flighttune.present.tables import Table

if TYPE_CHECKING:
    from flighttune.campaign.choice.robust import CandidateResult, RobustChoice
    from flighttune.campaign.dataset import Dataset
    from flighttune.campaign.engine.cost import CampaignCost
    from flighttune.campaign.engine.progress import CampaignOutcome
    from flighttune.campaign.planning.plan import Plan
    from flighttune.campaign.statistics.findings import Findings
    from flighttune.campaign.statistics.intervals import Estimate

KEPT = "what has been flown is kept, go on with the same command and --resume"
CRASHED = ("crashed", "timed_out")
"""Such a run has no measures to compare, and it may crash or hang here as it did there."""

OF_BEST = (
    *("name", "K_P", "K_I", "R_K", "I_K"),
    *("value", "interval", "success", "success_interval"),
)
"""Keys of the chosen candidate that stand at the top of the JSON object of `tune`."""

CANDIDATE_COLUMNS = (
    *("gains", "I_K [s²]", "R_K [1/s]", "draws"),
    *("succeed [%]", "percentile", "behind", "best"),
)

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
    from flighttune.report.campaign.as_json import findings_json
    from flighttune.report.campaign.page import write_campaign_report

    found = findings(load_flights(folder), method=interval, confidence=confidence)
    if out is None and Path(folder).is_dir():
        out = Path(folder) / "report.html"
    page = None if out is None else write_campaign_report(found, out).path
    answer = {**findings_json(found), "sha256": dataset_hash(folder), "page": page}
    emit(answer, _findings_text(found, page))


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
    answer = {
        "run": run,
        "plant": row["plant"],
        "gains": row["gains"],
        **pick(flown, "status reason"),
        "equal": not differences,
        "differences": [
            {"column": one.what, "in_row": one.recorded, "flown": one.reflown}
            for one in differences
        ],
        "versions": {key: {"campaign": then, "now": now} for key, (then, now) in versions.items()},
        "row": row,
        **pick(files, "recording signals"),
    }

    def text() -> Iterator[str]:
        yield f"run {run}: {row['plant']} / {row['gains']}, draw {row['draw']}"
        for key in dataset.plan.keys:
            yield f"  {key} = {row[key]!r}"
        ended = f"{row['status']}: {row['reason']}" if row["reason"] else row["status"]
        yield f"row: {ended}; {row['missed'] or 'a success'}"
        yield from (one.sentence for one in differences)
        if not differences:
            yield "flown again: status and every measure equal to the bit"
        for library, (then, now) in versions.items():
            yield f"{library}: {then} in the campaign, {now} now"
        yield f"recording: {files.recording}   (open it with: flighttune view {files.recording})"

    emit(answer, text())
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
    from flighttune.campaign.engine.cost import campaign_cost
    from flighttune.campaign.engine.engine import run_campaign
    from flighttune.simulate.batch import cores

    folder = out or str(Path("runs") / Path(file).stem)
    plan = _planned(file, runs, folder, resume=resume)
    if dry_run:
        cost, count = campaign_cost(plan), workers or cores()
        emit(_plan_json(plan, cost, count), _plan_text(plan, cost, count))
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
    emit(done.as_dict(), _outcome_text(done))
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
    from flighttune.campaign.choice.robust import METRICS, RobustSettings, tune_robust
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
        found = tune_robust(loaded, settings, pool)
    answer = _choice_json(found, file)
    written = out if found.status == "chosen" else None
    if written is not None:
        write_json(written, answer)
    emit(answer, _choice_text(found, loaded.title, written))
    if found.status != "chosen":
        fail(f"{file}: {found.reason}", INTERRUPTED if found.status == "interrupted" else NO)


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


def _findings_text(found: "Findings", page: Path | None) -> Iterator[Table | str]:
    from flighttune.report.campaign.headline import headline
    from flighttune.report.campaign.page import notes
    from flighttune.report.campaign.words import with_interval

    label = None if found.measure is None else metric_label(found.measure)
    rows = []
    for one in found.groups:
        spread, certified = one.measures.get(found.measure or ""), one.certified
        rows.append(
            (
                one.group.label,
                str(one.n),
                percent_interval(one.success.value, one.success.lo, one.success.hi),
                *(
                    MISSING
                    if spread is None
                    else with_interval(spread.percentiles[p], label.factor)
                    for p in ("p50", "p95")
                    if label
                ),
                MISSING if certified is None else percent(certified.of_all.value),
            )
        )
    measured = ("median", "95 %") if label else ()
    title = found.flights.plan.campaign.title
    yield table(
        f"{title}: {label.heading}" if label else title,
        ("group", "flights", "succeed [%]", *measured, "set held [%]"),
        rows,
        highest=["succeed [%]"],
    )
    yield from notes(found)
    success, *others = headline(found)
    yield from success.sentences[len(found.groups) :]
    for answer in others:
        yield f"{answer.question} {answer.short}"
        for sentence in answer.sentences:
            yield f"  {sentence}"
    if page is not None:
        yield f"page: {page}   (one file, it opens without a network)"


def _row(dataset: "Dataset", run: int) -> dict[str, Any]:
    for part in dataset.parts:
        if part.span.first <= run < part.span.end:
            return dataset.read_part(part).slice(run - part.span.first, 1).to_pylist()[0]
    raise RecordingError(
        f"{dataset.folder}: `run` must be one that was flown, got {run} of {dataset.plan.runs}."
    )


def _planned(file: str, runs: int | None, folder: str, *, resume: bool) -> "Plan":
    """The plan of a file; a campaign that was made longer by --runs stays so when it is resumed."""
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.campaign.planning.plan import plan_campaign

    plan = plan_campaign(load_campaign(file), runs=runs)
    if runs is None and resume:
        from flighttune.campaign.dataset import CAMPAIGN, open_dataset

        if (Path(folder) / CAMPAIGN).exists():
            return plan.with_runs(max(plan.runs, open_dataset(folder).plan.runs))
    return plan


def _outcome_text(done: "CampaignOutcome") -> Iterator[str]:
    others = ", ".join(
        f"{count} {status.replace('_', ' ')}"
        for status, count in done.statuses.items()
        if status not in ("completed", "crashed")
    )
    yield (
        f"{done.runs} runs: {done.completed} completed, {done.failed} failed"
        f"{others and f' ({others})'}, {done.crashed} crashed; "
        f"{done.succeeded} met every requirement"
    )
    yield (
        f"flown now: {done.flown} in {duration(done.wall_s)}, {rate(done.rate_per_s)} a second"
        if done.flown
        else "nothing was missing"
    )
    if done.halfwidth is not None:
        yield f"half width of the success rates: at most {done.halfwidth:.3g}"
    yield f"dataset: {done.dataset}   (look at it with: flighttune campaign report {done.dataset})"


def _plan_json(plan: "Plan", cost: "CampaignCost", workers: int) -> dict[str, Any]:
    campaign = plan.campaign
    return {
        "title": campaign.title,
        **pick(plan, "runs draws"),
        **pick(campaign, "design seed"),
        "groups": [
            {"plant": group.plant, "gains": group.gains, "run_s": cost.group_s.get(group)}
            for group in plan.groups
        ],
        "disperse": [one.model_dump(mode="json", exclude_none=True) for one in campaign.disperse],
        "keep": campaign.keep.model_dump(mode="json"),
        "time_limit_s": campaign.time_limit_s,
        "timed_runs": cost.timed,
        "core_s": cost.core_s,
        "workers": workers,
        "wall_s": cost.wall_s(workers),
        **pick(cost, "rows_bytes signals_bytes"),
    }


def _plan_text(plan: "Plan", cost: "CampaignCost", workers: int) -> Iterator[Table | str]:
    campaign, keep = plan.campaign, plan.campaign.keep
    yield table(
        f"{campaign.title}: {plan.runs} runs = {plan.draws} draws ({campaign.design}, seed "
        f"{campaign.seed}) by {len(plan.groups)} groups",
        ("plant", "gains", "s a run"),
        [(g.plant, g.gains, f"{cost.group_s.get(g, math.nan):.2g}") for g in plan.groups],
    )
    rows = []
    for one in campaign.disperse:
        given = one.model_dump(exclude_none=True, exclude={"key", "distribution", "acts"})
        numbers = ", ".join(f"{name} {value}" for name, value in given.items())
        rows.append((one.key, one.distribution, one.acts, numbers))
    yield table("dispersed", ("key", "distribution", "acts", "numbers"), rows)
    yield (
        f"signals kept: the first {keep.failures} failures, the worst {keep.worst} by "
        f"{keep.worst_by}, a sample of {keep.sample}; a run takes at most "
        f"{campaign.time_limit_s:g} s"
    )
    yield (
        f"cost, from {cost.timed} runs flown now: {duration(cost.core_s)} of one core, "
        f"{duration(cost.wall_s(workers))} with {workers} workers"
    )
    rows_size, signals_size = _size(cost.rows_bytes), _size(cost.signals_bytes)
    yield f"disk space: {rows_size} of rows, up to {signals_size} of signals"


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count < 1e9 else f"{count / 1e9:.3g} GB"


def _choice_json(found: "RobustChoice", file: str) -> dict[str, Any]:
    best = {} if found.best is None else _result_json(found.best)
    return {
        **pick(found, "status reason"),
        "campaign": file,
        **{key: best.get(key) for key in OF_BEST},
        **pick(found, "metrics percentile p_best loss draws flights"),
        "candidates": [_result_json(one) for one in found.candidates],
        "beside": [_result_json(one) for one in found.baselines],
    }


def _result_json(one: "CandidateResult") -> dict[str, Any]:
    return {
        "name": one.candidate.name,
        **gains_json(one.candidate.gains),
        **pick(one.candidate, "R_K I_K"),
        "draws": one.draws,
        **_estimate_json("value", one.percentile, "interval"),
        **_estimate_json("success", one.success),
        **pick(one, "p_best dropped"),
        **_estimate_json("behind", one.behind),
    }


def _estimate_json(key: str, one: "Estimate", interval: str = "") -> dict[str, Any]:
    return {key: one.value, interval or f"{key}_interval": [one.lo, one.hi]}


def _choice_text(found: "RobustChoice", title: str, out: Path | None) -> Iterator[Table | str]:
    best = found.best
    if best is None:
        return
    of = f"{found.percentile:g}th percentile of {' + '.join(found.metrics)}"
    rows = [_row_of(one) for one in (*found.candidates, *found.baselines)]
    yield table(f"{title}: {of}", CANDIDATE_COLUMNS, rows, lowest=["percentile"])
    yield gains_table(f"{found.status}: {best.candidate.name}", best.candidate.gains)
    yield (
        f"{of}: {best.percentile.value:.4g} (95 % interval {_range(best.percentile)}); "
        f"{100.0 * best.success.value:.1f} % of {best.draws} draws succeed "
        f"({_range(best.success.scaled(100.0), '.1f')} %)"
    )
    yield (
        f"the best of {len(found.candidates)} candidates with probability {found.p_best:.2f}; "
        f"expected loss to the true best {found.loss:.2g}; {found.flights} flights"
    )
    for one in found.baselines:
        behind = one.behind
        more = "more" if behind.value >= 0.0 else "less"
        chance = "" if behind.lo > 0.0 or behind.hi < 0.0 else ", which may be chance"
        yield (
            f"the campaign's own {one.candidate.name} has {abs(behind.value):.3g} {more} "
            f"({_range(behind, '.3g')}){chance}"
        )
    if out is not None:
        yield f"gains: {out}"


def _row_of(one: "CandidateResult") -> tuple[str, ...]:
    behind = f"{one.behind.value:.3g} ({_range(one.behind, '.3g')})"
    return (
        one.candidate.name,
        f"{one.candidate.I_K:.5g}",
        f"{one.candidate.R_K:.4f}",
        str(one.draws),
        f"{100.0 * one.success.value:.1f}",
        f"{one.percentile.value:.4g} ({_range(one.percentile)})",
        "dropped" if one.dropped else behind,
        "-" if math.isnan(one.p_best) else f"{one.p_best:.3f}",
    )


def _range(one: "Estimate", form: str = ".4g") -> str:
    return f"{one.lo:{form}} to {one.hi:{form}}"
