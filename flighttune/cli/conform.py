"""The command that learns boxes of an aircraft's residual rates, and counts new flights."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Option

from flighttune.cli.campaign import SchedulerOption, WorkersOption
from flighttune.cli.options import (
    AircraftPlantOption,
    aircraft_names,
    campaign_names,
    check_ending,
    scenario_names,
)
from flighttune.cli.progress import campaign_pool
from flighttune.cli.show import INTERRUPTED, NO, emit, fail
from flighttune.present.answer import Answer
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Table
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.conformance import Conformance

RATE_COLUMNS = columns(
    "rate low_rad_s high_rad_s widest_rad_s narrowest_rad_s last_error_low_deg last_error_high_deg"
)
COUNT_COLUMNS = columns("count learned widened outside counted")


def conform(
    source: Annotated[
        str,
        typer.Argument(
            metavar="CAMPAIGN|SCENARIO|AIRCRAFT",
            help="Folder of a campaign, a campaign file or the name of a shipped one; a scenario "
            "with --start-deg; or an aircraft, which is flown from random starts on random "
            "references.",
            autocompletion=lambda: campaign_names() + scenario_names() + aircraft_names(),
        ),
    ],
    out: Annotated[Path, Option("--out", help="JSON file to write.")],
    epsilon: Annotated[
        float, Option(help="Accepted probability of leaving the boxes, 0 to 1.")
    ] = 0.01,
    confidence: Annotated[float, Option(help="Confidence of the claim, 0 to 1.")] = 0.999,
    attempts: Annotated[
        int, Option(help="Maximum number of counts; the confidence is split between them.", min=1)
    ] = 3,
    gains: Annotated[
        str | None,
        Option(help="Gain set of the campaign [default: tuned_identified, else its first]."),
    ] = None,
    plant: AircraftPlantOption = None,
    air: Annotated[
        str | None,
        Option(
            help="Air to fly in: calm, wind, light, moderate or severe [default: the campaign's "
            "likeliest]."
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
    start_deg: Annotated[
        float,
        Option(help="Largest deviation from a scenario's start, course and path angle, deg."),
    ] = 0.0,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Learn bounds (boxes) on the part of an aircraft's rates that its identified model misses.

    The model is the exact point mass behind the identified lag. The boxes are fitted to the
    campaign's flights and tested on new random ones. Exit status 1 if flights leave them in every
    attempt.
    """
    check_ending(out, ".json")
    from flighttune.campaign.conform import ConformSettings
    from flighttune.campaign.conform import conform as learn_and_count
    from flighttune.conformance import save_conformance

    settings = ConformSettings(
        epsilon=epsilon,
        confidence=confidence,
        attempts=attempts,
        gains=gains,
        plant=plant,
        air=air,
        over=boxes,
        window=window,
        start_deg=start_deg,
    )
    with campaign_pool(workers, scheduler) as pool:
        found = learn_and_count(source, settings, pool)
    if found is None:
        fail(f"{source}: interrupted, nothing is written", INTERRUPTED)
    if found.holds:
        save_conformance(found, out)
    emit(_answer(found, out))
    if not found.holds:
        fail(f"{source}: {found.sentence}; nothing is written", NO)


def _answer(found: "Conformance", out: Path) -> Answer:
    low, high = found.boxes.low, found.boxes.high
    rates = [
        {
            "rate": name,
            "low_rad_s": float(low[:, i].min()),
            "high_rad_s": float(high[:, i].max()),
            "widest_rad_s": float((high - low)[:, i].max()),
            "narrowest_rad_s": float((high - low)[:, i].min()),
            # the last two columns of the boxes are the errors
            "last_error_low_deg": float(low[-1, i - 2]) / DEG,
            "last_error_high_deg": float(high[-1, i - 2]) / DEG,
        }
        for i, name in enumerate(CHANNEL_SYMBOLS)
    ]
    counts = [{"count": k, **asdict(attempt)} for k, attempt in enumerate(found.attempts, 1)]
    return Answer(
        values={
            **found.as_dict(),
            "status": "counted" if found.holds else "flights_outside",
            "air": found.air,
        },
        tables=[
            Table(
                title=f"{found.aircraft}, {found.gains_name}: residual rates",
                columns=RATE_COLUMNS,
                records=rates,
            ),
            Table(title="counts of new flights", columns=COUNT_COLUMNS, records=counts),
        ],
        verdict=found.sentence if found.holds else "",
        files={"out": out if found.holds else None},
    )
