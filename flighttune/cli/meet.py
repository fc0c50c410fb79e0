"""The command that finds gains which meet requirements, by flying them."""

import shlex
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

from typer import Option

from flighttune.cli import options
from flighttune.cli.gains import save_answer
from flighttune.cli.show import campaign_display
from flighttune.present.answer import Answer


def meet(
    scenario: options.ScenarioArgument,
    also: Annotated[
        list[str] | None, Option(metavar="SCENARIO", help="Another scenario to meet as well.")
    ] = None,
    start: Annotated[
        str | None,
        Option(
            metavar="NAME|FILE",
            help="Gains to start from [default: the best of the tuned ones and the scenario's].",
        ),
    ] = None,
    budget: Annotated[
        int | None,
        Option(min=1, help="Maximum number of flights [default: 600, or 6000 with a campaign]."),
    ] = None,
    metric: Annotated[
        str,
        Option(
            help="What to minimise once all requirements are met by 20 %: ITAE or a column of "
            "campaign rows; or margin, which maximises the margin further."
        ),
    ] = "ITAE",
    campaign: Annotated[
        str | None,
        Option(
            metavar="CAMPAIGN",
            help="Campaign that disperses the scenario; the share of flights that succeed is "
            "maximised.",
        ),
    ] = None,
    success: Annotated[
        float, Option(help="Share of the flights of a campaign that must succeed.")
    ] = 0.95,
    page: Annotated[Path | None, Option(help="HTML page to write, with all candidates.")] = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
    out: options.GainsFileOption = None,
) -> Answer:
    """Find gains with which flights of SCENARIO meet its [[expect]], by flying candidates.

    Exit status 1 if none are found; the nearest are printed.
    """
    options.check_ending(out, ".json")
    options.check_ending(page, ".html", option="--page")
    from flighttune.campaign.meet import meet as search

    with campaign_display() as observer:
        meeting = search(
            scenario,
            also=also or (),
            start=start,
            budget=budget,
            metric=metric,
            campaign=campaign,
            success=success,
            changes=options.changes(settings),
            workers=workers,
            scheduler=scheduler,
            observer=observer,
        )
    answer = replace(meeting.answer(), files={"out": out, "page": page})
    if out is not None:  # before the page: a fault in it must not lose the search
        save_answer(out, answer)
    if page is not None:
        from flighttune.reports.meet import write_meet_page

        passed = [("also", name) for name in also or ()]
        passed += [("start", start), ("budget", budget), ("metric", metric)]
        passed += [("campaign", campaign), ("success", success if campaign else None)]
        words = chain(*((f"--{key}", str(value)) for key, value in passed if value is not None))
        command = f"flighttune meet {options.repeated(scenario, settings)} {shlex.join(words)}"
        write_meet_page(page, meeting, command)
    return answer
