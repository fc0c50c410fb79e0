"""The command that searches the worst flight."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display
from flighttune.files.shipped import campaign_files, scenario_files
from flighttune.present.answer import Answer


def worst(
    source: Annotated[
        str,
        Argument(
            metavar="SCENARIO|CAMPAIGN|FILE",
            help="A campaign (file, shipped name or folder), whose dispersions are searched, a "
            "scenario with --start-deg or --disturbance, or the file of a tube or band: its "
            "flights are searched for the one nearest to its edge.",
            autocompletion=lambda: [*scenario_files(), *campaign_files()],
        ),
    ],
    budget: Annotated[int, Option(help="Maximum number of flights.")] = 2000,
    metric: Annotated[
        str | None,
        Option(
            help="Metric to maximise: a column of a campaign's rows, or margin, the largest excess "
            "over a requirement relative to its bound [default: margin if there are requirements, "
            "else chi.ITAE]."
        ),
    ] = None,
    gains: options.CampaignGainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first")] = None,
    completed: Annotated[
        bool, Option("--completed", help="Consider only completed flights.")
    ] = False,
    start_deg: options.StartOption = 0.0,
    disturbance: Annotated[
        float,
        Option(help="Largest disturbance of a scenario's two rates, rad/s: bang-bang or square."),
    ] = 0.0,
    seed: Annotated[int, Option(help="Seed of the search.", min=0)] = 1,
    claim: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of a tube: search for the flight closest to its bounds, and print how many "
            "times wider the tube is.",
        ),
    ] = None,
    out: Annotated[
        Path | None, Option(help="Scenario to write [default: runs/NAME-worst.toml].")
    ] = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> Answer:
    """Search dispersions and disturbances for the flight with the smallest margin.

    Writes that flight as a scenario for `flighttune fly`. Exit status 1 if it leaves a tube that is
    proven for it.
    """
    options.check_ending(out, ".toml")
    from flighttune.campaign.worst import worst as search
    from flighttune.files.table import toml_text
    from flighttune.files.whole import write_text
    from flighttune.tubes.proof import load_tube

    with campaign_display() as observer:
        flight = search(
            source,
            claim=None if claim is None else load_tube(claim),
            budget=budget,
            metric=metric,
            gains=gains,
            plant=plant,
            completed=completed,
            start_deg=start_deg,
            disturbance=disturbance,
            seed=seed,
            changes=options.changes(settings),
            workers=workers,
            scheduler=scheduler,
            observer=observer,
        )
    file = out or Path("runs") / f"{Path(source).stem}-worst.toml"
    write_text(file, toml_text(flight.scenario.as_dict()))
    return replace(flight.answer(), files={"scenario": file})
