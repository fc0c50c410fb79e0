"""Commands about campaigns: many flights, on this machine or on a cluster."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.campaign_fly import fly
from flighttune.cli.campaign_progress import CampaignOnlooker, duration, rate
from flighttune.cli.campaign_report import report
from flighttune.cli.show import COULD_NOT_RUN, NO, JsonOption, fail, print_json, print_table, say
from flighttune.errors import CampaignError, OutputError

if TYPE_CHECKING:
    from flighttune.campaign.engine.estimate import Estimate
    from flighttune.campaign.engine.progress import CampaignOutcome
    from flighttune.campaign.planning.plan import Plan

INTERRUPTED = 130
KEPT = "what has been flown is kept, go on with the same command and --resume"

campaign = typer.Typer(
    name="campaign",
    no_args_is_help=True,
    help="Fly a scenario thousands of times, dispersed, on one machine or a cluster.",
)
campaign.command()(report)
campaign.command()(fly)


@campaign.command()
def run(
    file: Annotated[
        str, typer.Argument(metavar="CAMPAIGN", help="A campaign file, or a shipped one's name.")
    ],
    runs: Annotated[
        int | None, typer.Option(help="Flights in total; by default what the file says.", min=1)
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(help="Processes on this machine; by default one a core.", min=1),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Fly on the workers of a dask scheduler, tcp://HOST:PORT."
        ),
    ] = None,
    out: Annotated[
        str | None,
        typer.Option(help="Folder or URL of the dataset; by default runs/NAME."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Fly what is missing of the campaign in --out.")
    ] = False,
    until_halfwidth: Annotated[
        float | None,
        typer.Option(
            metavar="H",
            help="Stop once the 95 % interval of every group's rate of success is within +-H.",
        ),
    ] = None,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Show the plan, its cost and its room; keep nothing.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Fly the campaign CAMPAIGN into a dataset, one row a run.

    Flights that fail are results: the exit status is 0. It is 1 where --until-halfwidth was not
    reached, 2 where the campaign was cut short, 130 after Ctrl-C; --resume does what is missing.
    """
    from flighttune.campaign.engine.cluster import check_installed

    check_installed()
    folder = out if out is not None else str(Path("runs") / Path(file).stem)
    plan = _planned(file, runs, folder, resume=resume)
    if dry_run:
        _dry_run(plan, workers, as_json=as_json)
        return
    from flighttune.campaign.engine.engine import run_campaign

    onlooker = CampaignOnlooker()
    try:
        with onlooker.ends_at_ctrl_c(), onlooker.shown():
            done = run_campaign(
                plan,
                folder,
                workers=workers,
                scheduler=scheduler,
                resume=resume,
                until_halfwidth=until_halfwidth,
                onlooker=onlooker,
            )
    except (CampaignError, OutputError) as error:
        raise type(error)(f"{str(error).removesuffix('.')}; {KEPT}") from error
    if as_json:
        print_json(done.as_dict())
    else:
        _print_outcome(done)
    if done.interrupted:
        there = f"{done.runs} of {done.planned} runs are in {done.dataset}"
        fail(f"interrupted, {there}; go on with the same command and --resume", INTERRUPTED)
    if until_halfwidth is not None and not (done.halfwidth or 1.0) <= until_halfwidth:
        fail(
            f"the half width must be at most {until_halfwidth:g}, got {done.halfwidth:.3g} after "
            f"all {done.runs} runs; give more --runs",
            NO,
        )


def _planned(file: str, runs: int | None, folder: str, *, resume: bool) -> "Plan":
    """The plan of a file; a campaign that was made longer by --runs stays so when it is resumed."""
    from flighttune.campaign import load_campaign, plan_campaign

    plan = plan_campaign(load_campaign(file), runs=runs)
    if runs is None and resume:
        from flighttune.campaign.dataset.dataset import CAMPAIGN, open_dataset
        from flighttune.campaign.dataset.storage import Store

        if Store(folder).exists(CAMPAIGN):
            return plan.with_runs(max(plan.runs, open_dataset(folder).plan.runs))
    return plan


def _print_outcome(done: "CampaignOutcome") -> None:
    others = ", ".join(
        f"{count} {status.replace('_', ' ')}"
        for status, count in done.statuses.items()
        if status not in ("completed", "crashed")
    )
    say(
        f"{done.runs} runs: {done.completed} completed, {done.failed} failed"
        f"{others and f' ({others})'}, {done.crashed} crashed; {done.succeeded} met every demand"
    )
    say(
        f"flown now: {done.flown} in {duration(done.wall_s)}, {rate(done.rate_per_s)} a second"
        if done.flown
        else "nothing was missing"
    )
    if done.halfwidth is not None:
        say(f"half width of the rates of success: at most {done.halfwidth:.3g}")
    say(f"dataset: {done.dataset}   (look at it with: flighttune campaign report {done.dataset})")


def _dry_run(plan: "Plan", workers: int | None, *, as_json: bool) -> None:
    from flighttune.campaign.engine.cluster import cores
    from flighttune.campaign.engine.estimate import estimate

    cost = estimate(plan)
    if cost.fallen:
        fail(f"the first flights cannot be timed: {cost.fallen}", COULD_NOT_RUN)
    count = workers or cores()
    if as_json:
        print_json(_plan_json(plan, cost, count))
    else:
        _print_plan(plan, cost, count)


def _plan_json(plan: "Plan", cost: "Estimate", workers: int) -> dict[str, Any]:
    campaign = plan.campaign
    return {
        "title": campaign.title,
        "runs": plan.runs,
        "draws": plan.draws,
        "design": campaign.design,
        "seed": campaign.seed,
        "groups": [
            {"plant": group.plant, "gains": group.gains, "run_s": cost.group_s.get(group)}
            for group in plan.groups
        ],
        "disperse": [
            table.model_dump(mode="json", exclude_none=True) for table in campaign.disperse
        ],
        "keep": campaign.keep.model_dump(mode="json"),
        "time_limit_s": campaign.time_limit_s,
        "timed_runs": cost.timed,
        "core_s": cost.core_s,
        "workers": workers,
        "wall_s": cost.wall_s(workers),
        "rows_bytes": cost.rows_bytes,
        "signals_bytes": cost.signals_bytes,
    }


def _print_plan(plan: "Plan", cost: "Estimate", workers: int) -> None:
    campaign, groups = plan.campaign, len(plan.groups)
    print_table(
        f"{campaign.title}: {plan.runs} runs = {plan.draws} draws ({campaign.design}, seed "
        f"{campaign.seed}) by {groups} groups",
        ("plant", "gains", "s a run"),
        [(g.plant, g.gains, f"{cost.group_s.get(g, float('nan')):.2g}") for g in plan.groups],
    )
    rows = [
        (table.key, table.distribution, table.acts, _numbers(table)) for table in campaign.disperse
    ]
    print_table("dispersed", ("key", "distribution", "acts", "numbers"), rows)
    keep = campaign.keep
    say(
        f"signals kept: the first {keep.failures} failures, the worst {keep.worst} by "
        f"{keep.worst_by}, a sample of {keep.sample}; a run takes at most "
        f"{campaign.time_limit_s:g} s"
    )
    say(
        f"cost, from {cost.timed} runs flown now: {duration(cost.core_s)} of one core, "
        f"{duration(cost.wall_s(workers))} with {workers} workers"
    )
    say(f"room: {_size(cost.rows_bytes)} of rows, up to {_size(cost.signals_bytes)} of signals")


def _numbers(table: Any) -> str:
    given = table.model_dump(exclude_none=True, exclude={"key", "distribution", "acts"})
    return ", ".join(f"{name} {value}" for name, value in given.items())


def _size(count: int) -> str:
    return f"{count / 1e6:.3g} MB" if count < 1e9 else f"{count / 1e9:.3g} GB"
