"""The command that flies campaigns."""

from pathlib import Path
from typing import Annotated

from typer import Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display
from flighttune.errors import CampaignError, OutputError
from flighttune.present.answer import Answer

KEPT = "what has been flown is kept, go on with the same command and --resume"


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
    from flighttune.campaign.engine.engine import run_campaign
    from flighttune.campaign.engine.forecast import forecast
    from flighttune.campaign.planning.load import load_campaign
    from flighttune.campaign.planning.plan import plan_campaign

    folder = out or str(Path("runs") / Path(file).stem)
    campaign = load_campaign(file, changes=options.changes(settings), gains=gains or ())
    plan, file_of_plan = plan_campaign(campaign, runs=runs), Path(folder) / CAMPAIGN
    if resume and runs is None and file_of_plan.exists():
        # a campaign that was extended by --runs keeps its length
        plan = plan.with_runs(max(plan.runs, open_dataset(folder).plan.runs))
    if dry_run:
        return forecast(plan, workers).answer()
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
