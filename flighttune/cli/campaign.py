"""The command that flies campaigns."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flighttune.cli import options
from flighttune.cli.show import (
    campaign_display,
    pick,
)
from flighttune.errors import CampaignError, OutputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

if TYPE_CHECKING:
    from flighttune.campaign.planning.plan import Plan

KEPT = "what has been flown is kept, go on with the same command and --resume"

COST_COLUMNS = [
    *columns("core_s workers wall_s"),
    Column("rows_bytes", "rows", "MB", factor=1e-6),
    Column("signals_bytes", "signals, at most", "MB", factor=1e-6),
]


def run(
    file: options.CampaignArgument,
    runs: Annotated[
        int | None, Option(help="Flights in total [default: the file's].", min=1)
    ] = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    out: Annotated[str | None, Option(help="Folder of the dataset [default: runs/NAME].")] = None,
    resume: Annotated[bool, Option("--resume", help="Fly the runs that --out lacks.")] = False,
    gains: options.GainSetsOption = None,
    settings: options.SetOption = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Show plan, time and disk space; write nothing.")
    ] = False,
) -> Answer:
    """Fly CAMPAIGN and write a dataset with one row per run.

    A flight that fails is a result: the exit status stays 0. It is 2 if the campaign was
    cut short, 130 after Ctrl-C; --resume flies the missing runs.
    """
    from flighttune.campaign.dataset import CAMPAIGN, open_dataset
    from flighttune.campaign.engine.engine import campaign_cost, run_campaign
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.campaign.planning.plan import plan_campaign
    from flighttune.simulate.batch import cores

    folder = out or str(Path("runs") / Path(file).stem)
    campaign = load_campaign(file, changes=options.changes(settings), gains=gains or ())
    plan, file_of_plan = plan_campaign(campaign, runs=runs), Path(folder) / CAMPAIGN
    if resume and runs is None and file_of_plan.exists():
        # a campaign that was extended by --runs keeps its length
        plan = plan.with_runs(max(plan.runs, open_dataset(folder).plan.runs))
    if dry_run:
        # An estimate flies a few runs, and a dry run shall not run code of somebody else.
        return _plan(plan, {} if plan.code else campaign_cost(plan, workers or cores()))
    try:
        with campaign_display() as observer:
            done = run_campaign(
                plan,
                folder,
                workers=workers,
                scheduler=scheduler,
                resume=resume,
                observer=observer,
            )
    except (CampaignError, OutputError) as error:
        if not file_of_plan.exists():
            raise
        raise type(error)(f"{str(error).removesuffix('.')}; {KEPT}") from error
    return done.answer()


def _plan(plan: "Plan", cost: dict[str, Any]) -> Answer:
    from flighttune.campaign.planning.plan import draws_in_words

    campaign, keep = plan.campaign, plan.campaign.keep
    disperse = [table.model_dump(mode="json", exclude_none=True) for table in campaign.disperse]
    counted = draws_in_words(plan.runs, len(plan.groups))
    keys = " ".join(dict.fromkeys(key for table in disperse for key in table))
    values = {
        "title": campaign.title,
        **pick(plan, "runs draws"),
        **pick(campaign, "design seed time_limit_s"),
        "disperse": disperse,
        "keep": keep.model_dump(mode="json"),
        **cost,
    }
    tables = [
        Table(columns("runs draws design seed time_limit_s"), [values], campaign.title),
        Table(columns(keys), disperse, "dispersed"),
    ]
    if cost:
        title = f"cost, from {cost['timed_runs']} runs flown now"
        tables.insert(1, Table(columns("plant gains run_s"), cost["groups"], "groups"))
        tables.append(Table(COST_COLUMNS, [values], title))
    return Answer(
        values=values,
        tables=tables,
        notes=[
            f"{plan.runs} flights = {counted}",
            f"signals kept: the first {keep.failures} failures, the worst {keep.worst} by "
            f"{keep.worst_by}, a sample of {keep.sample}",
            *(f"time and space are not estimated: that runs the code of {x}" for x in plan.code),
        ],
    )
