"""The command that learns boxes of an aircraft's residual rates, and counts new flights."""

from collections.abc import Iterator
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
from flighttune.cli.show import INTERRUPTED, NO, emit, fail, table
from flighttune.errors import InputError
from flighttune.present.tables import Table
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.campaign.conform import ConformSettings
    from flighttune.conformance import Conformance


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
        int, Option(help="Attempts at most; they share the confidence.", min=1)
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
        found = learn_and_count(source, settings, pool)
    if found is None:
        fail(f"{source}: interrupted, nothing is written", INTERRUPTED)
    if found.holds:
        save_conformance(found, out)
    answer = {
        **found.as_dict(),
        "status": "counted" if found.holds else "flights_outside",
        "air": found.air,
        "out": out if found.holds else None,
    }
    emit(answer, _text(found, out))
    if not found.holds:
        fail(f"{source}: {found.sentence}; nothing is written", NO)


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

    known = load_conformance(path or "")
    with campaign_pool(workers, scheduler) as pool:
        attempt = recount(source, known, settings, pool)
    if attempt is None:
        fail(f"{source}: interrupted", INTERRUPTED)
    counts = f"{attempt.outside} of {attempt.flights} new flights left the boxes"
    answer = {
        "status": "flights_outside" if attempt.outside else "counted",
        "flights": attempt.flights,
        "outside": attempt.outside,
    }
    emit(answer, [f"{path}: {counts}"])
    if attempt.outside:
        fail(f"{path}: {counts}", NO)


def _text(found: "Conformance", out: Path) -> Iterator[Table | str]:
    low, high = found.boxes.low, found.boxes.high
    yield table(
        f"{found.aircraft}, {found.gains_name}: residual rates [rad/s]",
        ("rate", "lowest", "highest", "widest box", "narrowest box"),
        [
            (
                name,
                *(f"{value:+.4f}" for value in (low[:, i].min(), high[:, i].max())),
                *(f"{f((high - low)[:, i]):.4f}" for f in (max, min)),
            )
            for i, name in enumerate(("chi", "gamma"))
        ],
    )
    ends = zip(("chi", "gamma"), *(end[-1, -2:] / DEG for end in (low, high)), strict=True)
    errors = ", ".join(f"{name} {least:+.3g}..{most:+.3g} deg" for name, least, most in ends)
    yield f"errors in the last window: {errors}"
    for number, one in enumerate(found.attempts, 1):
        yield (
            f"count {number}: learned from draws {one.learned[0]} to {one.learned[1]}, widened by "
            f"{one.widened:.2f}, {one.outside} of {one.flights} fresh ones outside (draws "
            f"{one.counted[0]} to {one.counted[1]} of seed {found.seed})"
        )
    if found.holds:
        yield found.sentence
        yield f"conformance: {out}"
