"""The command that searches the worst flight."""

import math
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_pool
from flighttune.files.shipped import campaign_files, scenario_files
from flighttune.present.answer import Answer
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table

WORST_COLUMNS = [
    *columns("plant gains value"),
    Column("first", "worst of the first generation, drawn from the distribution"),
    Column("distance", "standard deviations from the median"),
    Column("radius", "of those that have 99.9 % of the distribution"),
    *columns("status"),
    Column("ratio.chi", "tube over flight χ"),
    Column("ratio.gamma", "tube over flight γ"),
    Column("ratio_of_search.chi", "over the widest flight of the search χ"),
    Column("ratio_of_search.gamma", "over the widest flight of the search γ"),
    Column("family", "disturbance"),
]


def worst(
    source: Annotated[
        str,
        Argument(
            metavar="SCENARIO|CAMPAIGN|FILE",
            help="A campaign (file, shipped name or folder), whose dispersions are searched, a "
            "scenario with --start-deg or --disturbance, or a band file (.npz): its flights are "
            "searched for the one nearest to its edge.",
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
    tube: Annotated[
        Path | None,
        Option(
            "--claim",
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

    Writes that flight as a scenario for `flighttune fly`.
    """
    options.check_ending(out, ".toml")
    from flighttune.campaign.worst import StatedSet, find_worst
    from flighttune.files.table import toml_text
    from flighttune.files.whole import write_text
    from flighttune.flight.fly import fly
    from flighttune.simulate.bounds import ERRORS
    from flighttune.tubes.proof import load_tube

    bounds = None if tube is None else load_tube(tube).bounds.of(ERRORS)
    with campaign_pool(workers, scheduler) as pool:
        searched = StatedSet(
            source,
            pool,
            metric=metric,
            tube=bounds,
            gains=gains,
            plant=plant,
            completed=completed,
            start_deg=start_deg,
            disturbance=disturbance,
            changes=options.changes(settings),
        )
        values, flight = find_worst(searched, budget=budget, seed=seed)
    written = out or Path("runs") / f"{Path(source).stem}-worst.toml"
    write_text(written, toml_text(flight.as_dict()))
    values |= {"ratio": None, "ratio_of_search": None}
    if tube is not None and bounds is not None:
        run = fly(flight).runs[0]
        values["ratio"] = bounds.ratios(run.signals)
        values["ratio_of_search"] = {
            channel: 1.0 / share if share else math.inf  # no flight came to its end
            for channel, share in zip(CHANNEL_SYMBOLS, searched.reach.tolist(), strict=True)
        }
    drawn = [
        # A seed is no quantity: all its digits are needed to fly it again.
        {"key": key, "value": value if isinstance(value, float) else str(value)}
        for key, value in values["drawn"].items()
    ]
    title = f"worst {values['metric']} in {values['flights']} flights"
    return Answer(
        values=values,
        tables=[
            Table(WORST_COLUMNS, [values], title),
            Table(columns("key value"), drawn, "drawn"),
        ],
        verdict=values["missed"] or "no requirement is missed",
        files={"scenario": written},
    )
