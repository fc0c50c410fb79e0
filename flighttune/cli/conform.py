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
from flighttune.cli.show import INTERRUPTED, NO, emit, fail, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Table
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.campaign.conform import ConformSettings
    from flighttune.conformance import Conformance

RATE_COLUMNS = columns(
    "channel low_rad_s high_rad_s widest_rad_s narrowest_rad_s last_error_low_deg "
    "last_error_high_deg"
)
COUNT_COLUMNS = columns("learned counted widened flights outside")


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
    out: Annotated[Path | None, Option("--out", help="JSON file to write.")] = None,
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
    seed: Annotated[
        int | None, Option(help="Seed of the draws [default: the campaign's].", min=0)
    ] = None,
    recount: Annotated[
        Path | None,
        Option(
            help="Conformance file made of the same source: fly as many new flights with another "
            "seed [default: the next one] and count those that leave its boxes."
        ),
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> None:
    """Learn bounds (boxes) on the part of an aircraft's rates that its identified model misses.

    The model is the exact point mass behind the identified lag. The boxes are fitted to the
    campaign's flights and tested on new random ones. Exit status 1 if flights leave them in every
    attempt, or any flight in a recount.
    """
    if (out is None) == (recount is None):
        raise InputError("`--out` must be given, or `--recount` in its place.")
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
        seed=seed,
    )
    if out is None:
        _recount(source, recount, settings, workers, scheduler)
        return
    with campaign_pool(workers, scheduler) as pool:
        conformance = learn_and_count(source, settings, pool)
    if conformance is None:
        fail(f"{source}: interrupted, nothing is written", INTERRUPTED)
    if conformance.holds:
        save_conformance(conformance, out)
    emit(_answer(conformance, out))
    if not conformance.holds:
        fail(f"{source}: {conformance.sentence}; nothing is written", NO)


def _recount(
    source: str,
    path: Path | None,
    settings: "ConformSettings",
    workers: int | None,
    scheduler: str | None,
) -> None:
    """Count new flights against the boxes of a file."""
    from flighttune.campaign.conform import recount
    from flighttune.conformance import load_conformance

    boxes = load_conformance(path or "")
    with campaign_pool(workers, scheduler) as pool:
        attempt = recount(source, boxes, settings, pool)
    if attempt is None:
        fail(f"{source}: interrupted", INTERRUPTED)
    verdict = f"{path}: {attempt.outside} of {attempt.flights} new flights left the boxes"
    status = "flights_outside" if attempt.outside else "counted"
    emit(Answer(values={"status": status, **pick(attempt, "flights outside")}, verdict=verdict))
    if attempt.outside:
        fail(verdict, NO)


def _answer(conformance: "Conformance", out: Path) -> Answer:
    from flighttune.conformance.file import conformance_tables

    low, high = conformance.boxes.low, conformance.boxes.high
    rates = [
        {
            "channel": name,
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
    counts = [asdict(attempt) | {"flights": attempt.flights} for attempt in conformance.attempts]
    return Answer(
        values={
            **conformance_tables(conformance),
            "status": "counted" if conformance.holds else "flights_outside",
            "air": conformance.distribution.air,
        },
        tables=[
            Table(
                title=f"{conformance.aircraft}, {conformance.gains_name}: residual rates",
                columns=RATE_COLUMNS,
                records=rates,
            ),
            Table(title="counts of new flights", columns=COUNT_COLUMNS, records=counts),
        ],
        verdict=conformance.sentence if conformance.holds else "",
        files={"out": out if conformance.holds else None},
    )
