"""Commands that decide by many flights: the worst one, counted boxes, gains tuned by flying."""

import math
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_pool
from flighttune.errors import InputError
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
RATE_COLUMNS = columns("channel low_rad_s high_rad_s widest_rad_s narrowest_rad_s last_rad_s")
COUNT_COLUMNS = columns("training flights outside scale")


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


def conform(
    source: Annotated[
        str,
        Argument(
            metavar="CAMPAIGN|SCENARIO",
            help="Folder of a campaign, a campaign file or the name of a shipped one; or a "
            "scenario with --start-deg.",
            autocompletion=lambda: [*campaign_files(), *scenario_files()],
        ),
    ],
    out: Annotated[Path | None, Option("--out", help="JSON file to write.")] = None,
    epsilon: Annotated[float, Option(help="Accepted probability of leaving the boxes.")] = 0.01,
    confidence: Annotated[float, Option(help="Confidence of the claim, 0 to 1.")] = 0.999,
    flights: Annotated[
        int | None,
        Option(
            help="Number of fresh flights [default: the fewest of which 5 may lie outside the "
            "boxes].",
            min=1,
        ),
    ] = None,
    gains: options.CampaignGainsOption = None,
    plant: options.AircraftPlantOption = None,
    air: Annotated[
        str | None,
        Option(
            help="Air: calm, wind, light, moderate or severe [default: the most likely air of the "
            "campaign]."
        ),
    ] = None,
    boxes: Annotated[
        Literal["time", "phase"] | None,
        Option(
            help="One box per window of time, or per window of the time since the reference last "
            "moved [default: time if all flights follow the same reference]."
        ),
    ] = None,
    window: Annotated[
        float, Option(help="Length of the windows of the boxes, s; shorter ones are narrower.")
    ] = 0.5,
    start_deg: options.StartOption = 0.0,
    seed: options.SeedOption = None,
    recount: Annotated[
        Path | None,
        Option(
            help="Conformance file made of the same source: fly as many new flights with another "
            "seed [default: the next one] and count those that leave its boxes."
        ),
    ] = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> Answer:
    """Learn bounds (boxes) on the part of an aircraft's rates that its identified model misses.

    The model is the exact point mass behind the identified lag. The shape of the boxes is learned
    from the campaign's flights; new random flights set its scale. Exit status 1 if so many flights
    of a recount leave the boxes that it refutes their claim.
    """
    if (out is None) == (recount is None):
        raise InputError("`--out` must be given, or `--recount` in its place.")
    options.check_ending(out, ".json")
    from flighttune.campaign.conform import ConformSettings
    from flighttune.campaign.conform import conform as conform_source
    from flighttune.campaign.conform import recount as count_again
    from flighttune.claims.boxes import LEAST_SHARE
    from flighttune.claims.conformance import conformance_tables, load_conformance, save_conformance

    claim = ConformSettings(
        epsilon=epsilon,
        confidence=confidence,
        flights=flights,
        gains=gains,
        plant=plant,
        air=air,
        over=boxes,
        window=window,
        start_deg=start_deg,
        seed=seed,
        changes=options.changes(settings),
    )
    with campaign_pool(workers, scheduler) as pool:
        if recount is not None:
            again = count_again(source, load_conformance(recount), claim, pool)
            sentence = (
                f"{recount}: {again['outside']} of {again['flights']} new flights left the boxes; "
                f"{again['refuting']} or more would refute its claim"
            )
            refuted = again["outside"] >= again["refuting"]
            return Answer(values=again, verdict=sentence, failure=sentence if refuted else "")
        counted = conform_source(source, claim, pool)
    assert out is not None
    save_conformance(counted, out)
    low, high = counted.boxes.low, counted.boxes.high
    rates = [
        {
            "channel": name,
            "low_rad_s": float(low[:, i].min()),
            "high_rad_s": float(high[:, i].max()),
            "widest_rad_s": float((high - low)[:, i].max()),
            "narrowest_rad_s": float((high - low)[:, i].min()),
            "last_rad_s": float(high[-1, i] - low[-1, i]),
        }
        for i, name in enumerate(CHANNEL_SYMBOLS)
    ]
    scale, outside = counted.counted
    count = {"flights": len(counted.all_scores), "outside": outside, "scale": scale}
    title = f"{counted.aircraft}, {counted.gains_name}: residual rates"
    return Answer(
        values={
            **conformance_tables(counted),
            **count,
        },
        tables=[
            Table(RATE_COLUMNS, rates, title),
            Table(COUNT_COLUMNS, [{"training": counted.training, **count}], "count of new flights"),
        ],
        notes=[
            f"No box is narrower than {LEAST_SHARE:g} times the widest of its rate: a narrowest or "
            "last box of that width is not measured."
        ],
        verdict=counted.sentence,
        files={"out": out},
    )
