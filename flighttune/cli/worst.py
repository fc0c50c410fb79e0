"""The command that searches for the worst flight of a stated set."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from flighttune.cli.campaign import SchedulerOption, WorkersOption
from flighttune.cli.options import campaign_names, check_ending, scenario_names
from flighttune.cli.progress import campaign_pool
from flighttune.cli.show import INTERRUPTED, emit, fail, pick
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.numbers import number
from flighttune.present.tables import Column, Table

if TYPE_CHECKING:
    from flighttune.campaign.worst import RareMiss

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
RARE_COLUMNS = [
    Column("probability", "probability", ends=("low", "high")),
    *columns("flights levels"),
]


def worst(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENARIO|CAMPAIGN",
            help="A campaign (file, shipped name or folder), whose dispersions are searched, or a "
            "scenario with --start-deg or --disturbance.",
            autocompletion=lambda: scenario_names() + campaign_names(),
        ),
    ],
    budget: Annotated[int, Option(help="Maximum number of flights.")] = 2000,
    metric: Annotated[
        str | None,
        Option(
            help="Metric to maximise: a column of a campaign's rows, such as chi.ITAE, or margin, "
            "the largest excess over a requirement relative to its bound [default: margin if there "
            "are requirements]."
        ),
    ] = None,
    gains: Annotated[
        str | None, Option(help="Gain set [default: tuned_identified, else the first].")
    ] = None,
    plant: Annotated[
        str | None, Option(help="Label of the plant as `fly` prints it [default: the first].")
    ] = None,
    completed: Annotated[
        bool, Option("--completed", help="Consider only flights that reach their end time.")
    ] = False,
    start_deg: Annotated[
        float, Option(help="Largest deviation from a scenario's start, course and path angle, deg.")
    ] = 0.0,
    disturbance: Annotated[
        float,
        Option(
            help="Largest disturbance of a scenario's two rates, rad/s: switched where the "
            "sensitivity of an error changes its sign, or a square wave."
        ),
    ] = 0.0,
    rare: Annotated[
        bool, Option("--rare", help="Estimate the probability of a miss by subset simulation.")
    ] = False,
    threshold: Annotated[
        float, Option(help="Value of the metric at which --rare counts a miss.")
    ] = 0.0,
    seed: Annotated[int, Option(help="Seed of the search.", min=0)] = 1,
    tube: Annotated[
        Path | None,
        Option(
            help="Signals of a tube (Parquet): search for the flight that comes closest to its "
            "bounds, and print how many times wider the tube is."
        ),
    ] = None,
    out: Annotated[
        Path | None, Option(help="Scenario to write [default: runs/NAME-worst.toml].")
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Search dispersions and disturbances for the flight with the smallest margin.

    Writes that flight as a scenario for `flighttune fly`.
    """
    check_ending(out, ".toml")
    from flighttune.campaign.worst import RareMiss, WorstSettings, find_worst, rare_miss
    from flighttune.flight.fly import fly
    from flighttune.table_file import toml_text
    from flighttune.tube.store import read_bounds, write_worst
    from flighttune.whole_file import write_text

    bounds = None if tube is None else read_bounds(tube)
    settings = WorstSettings(
        budget=budget,
        metric=metric,
        tube=bounds,
        gains=gains,
        plant=plant,
        completed=completed,
        start_deg=start_deg,
        disturbance=disturbance,
        seed=seed,
    )
    with campaign_pool(workers, scheduler) as pool:
        if rare:
            search = rare_miss(source, settings, pool, threshold=threshold)
        else:
            search = find_worst(source, settings, pool)
    if search is None:
        fail(f"{source}: interrupted, nothing is written", INTERRUPTED)
    if isinstance(search, RareMiss):
        emit(_rare(search))
        return
    flight, written = search, out or Path("runs") / f"{Path(source).stem}-worst.toml"
    write_text(written, toml_text(flight.scenario.as_dict()))
    values = {
        **pick(flight, "metric value first flights family distance radius status missed drawn"),
        **pick(flight.group, "plant gains"),
        "ratio": None,
        "ratio_of_search": None,
    }
    if tube is not None and bounds is not None and flight.reach is not None:
        run = fly(flight.scenario).runs[0]
        values["ratio"] = bounds.ratios(run)
        write_worst(tube, run, values["ratio"])
        values["ratio_of_search"] = {
            channel: 1.0 / share if share else math.inf  # no flight came to its end
            for channel, share in zip(("chi", "gamma"), flight.reach.tolist(), strict=True)
        }
    drawn = [
        # A seed is no quantity: all its digits are needed to fly it again.
        {"key": key, "value": value if isinstance(value, float) else str(value)}
        for key, value in flight.drawn.items()
    ]
    title = f"worst {flight.metric} in {flight.flights} flights"
    emit(
        Answer(
            values=values,
            tables=[
                Table(title=title, columns=WORST_COLUMNS, records=[values]),
                Table(title="drawn", columns=columns("key value"), records=drawn),
            ],
            verdict=flight.missed or "no requirement is missed",
            files={"scenario": written},
        )
    )


def _rare(miss: "RareMiss") -> Answer:
    values = pick(miss, "metric threshold probability low high variation levels flights")
    event = f"P({miss.metric} >= {number(miss.threshold)})"
    return Answer(
        values=values,
        tables=[Table(title=event, columns=RARE_COLUMNS, records=[values])],
        verdict=""
        if miss.probability
        else f"{event} is below the end of its interval: the levels reached "
        f"{number(miss.levels[-1])}; give more --budget",
    )
