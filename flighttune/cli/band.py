"""The command that counts bands of campaigns, and answers about them."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from typer import Argument, Option

from flighttune.cli.options import (
    CampaignGainsOption,
    SchedulerOption,
    SetOption,
    StartOption,
    WorkersOption,
    changes,
    check_ending,
    plant_label,
)
from flighttune.cli.show import campaign_pool, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import shown_unit
from flighttune.present.tables import Column, Table
from flighttune.shipped import campaign_files, scenario_files

if TYPE_CHECKING:
    from flighttune.guarantee.band import Band

WIDTH_COLUMNS = [
    Column("signal", "signal"),
    Column("largest", "largest half-width", digits=".2f"),
    Column("last_quarter", "in the last quarter", digits=".2f"),
    Column("end", "at the end", digits=".2f"),
    Column("unit", "unit"),
]

# Part of the time whose largest half-width is printed too: flights have settled by then.
LAST_QUARTER = 0.75


def band(
    source: Annotated[
        str,
        Argument(
            metavar="CAMPAIGN|SCENARIO|FILE",
            help="A campaign (file, shipped name or folder), a scenario in which something is "
            "random or --start-deg is given, or a band file (.npz): its flights are not flown "
            "again.",
            autocompletion=lambda: [*campaign_files(), *scenario_files()],
        ),
    ],
    gains: CampaignGainsOption = None,
    plant: Annotated[str | None, plant_label("the first")] = None,
    signal: Annotated[
        list[str] | None,
        Option(help="Recorded signal to bound; repeatable [default: chi_err and gamma_err]."),
    ] = None,
    epsilon: Annotated[
        float | None,
        Option(help="Accepted probability of leaving the band [default: 0.01, or the file's]."),
    ] = None,
    confidence: Annotated[
        float | None,
        Option(help="Confidence of the claim, 0 to 1 [default: 0.999, or the file's]."),
    ] = None,
    flights: Annotated[
        int | None,
        Option(
            help="Flights to count in all [default: as many as the claim needs with five of them "
            "outside].",
            min=1,
        ),
    ] = None,
    learn: Annotated[
        int | None, Option(help="Flights to learn the shape from [default: 500].", min=1)
    ] = None,
    predicted_from: Annotated[
        Literal["wind"] | None,
        Option(
            "--given", help="Put the band around a middle predicted from the wind of each flight."
        ),
    ] = None,
    start_deg: StartOption = 0.0,
    seed: Annotated[
        int | None, Option(help="Seed of the draws [default: the campaign's].", min=0)
    ] = None,
    recount: Annotated[
        int | None,
        Option(
            help="Fly so many of the flights in FILE again, and compare them to the bit.", min=1
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Option("--out", help="Band file (.npz) to write [default: runs/NAME-band.npz, or FILE]."),
    ] = None,
    settings: SetOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
) -> Answer:
    """Count the band that a flight of a campaign leaves with at most a stated probability.

    Its shape is learned from some flights, and its scale counted on fresh ones: it holds for all
    signals at all times, for any law, plant and weather. Exit status 1 if too many flights did not
    complete for any claim, or a flight of a recount differs.
    """
    check_ending(out, ".npz")
    from flighttune.campaign.band import count_band, count_more
    from flighttune.campaign.band import recount as count_again
    from flighttune.guarantee.band import load_band, save_band

    of_source = {
        "gains": gains,
        "plant": plant,
        "signal": signal,
        "learn": learn,
        "given": predicted_from,
        "start-deg": start_deg or None,
        "seed": seed,
        "set": settings,
    }
    read = Path(source).suffix == ".npz"
    if not read:
        if recount is not None:
            raise InputError("`--recount` must be given for a band file only.")
        with campaign_pool(workers, scheduler) as pool:
            counted = count_band(
                source,
                pool,
                signals=signal or ("chi_err", "gamma_err"),
                epsilon=0.01 if epsilon is None else epsilon,
                confidence=0.999 if confidence is None else confidence,
                flights=flights,
                learn=500 if learn is None else learn,
                predicted_from=predicted_from,
                gains=gains,
                plant=plant,
                start_deg=start_deg,
                seed=seed,
                changes=changes(settings),
            )
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    else:
        for option, value in of_source.items():
            if value is not None:
                raise InputError(f"`--{option}` must be absent for a band file, which has its own.")
        counted = load_band(source)
        with campaign_pool(workers, scheduler) as pool:
            if recount is not None:
                return _recounted(source, recount, count_again(counted, recount, pool))
            if flights is not None:
                counted, out = count_more(counted, flights, pool), out or Path(source)
        about = counted.about
        counted = counted.claiming(
            about.epsilon if epsilon is None else epsilon,
            about.confidence if confidence is None else confidence,
        )
    if out is not None:
        save_band(counted, out)
    return replace(band_answer(counted), files={"band": out})


def _recounted(source: str, flights: int, differ: list[int]) -> Answer:
    """How many of the flights that were flown again are those of the file."""
    runs = ", ".join(map(str, differ))
    return Answer(
        values={"flights": flights, "differ": differ},
        verdict="" if differ else f"{flights} flights again: each is that of the file to the bit",
        failure=f"{source}: {len(differ)} of {flights} flights differ: {runs}." if differ else "",
    )


def band_answer(counted: "Band") -> Answer:
    """The half-widths of a band and its claim; a failure if nothing is claimed."""
    about, claims = counted.about, counted.about.scale is not None
    records = []
    for (name, unit), widths in zip(about.signals.items(), counted.half_widths.T, strict=True):
        shown, factor = shown_unit(unit)
        late = about.edges[:-1] >= LAST_QUARTER * about.edges[-1]
        ends = {"largest": widths.max(), "last_quarter": widths[late].max(), "end": widths[-1]}
        in_unit = {key: float(width) * factor for key, width in ends.items()}
        records.append({"signal": name, **in_unit, "unit": shown})
    notes = []
    if about.predicted_from:
        notes.append("The band is around a middle that is predicted from the wind of each flight.")
    if claims:
        notes.append(
            f"Of the flights inside, draw {counted.nearest} (seed {about.plan['campaign']['seed']})"
            " is nearest to leaving."
        )
    return Answer(
        values={
            "status": "claimed" if claims else "nothing_claimed",
            **pick(about, "epsilon scale predicted_from learned readings distribution"),
            **pick(counted, "confidence outside not_completed sentence"),
            "flights": len(counted.scores),
            "nearest_draw": counted.nearest if claims else None,
        },
        tables=[Table(WIDTH_COLUMNS, records if claims else [], "band", name="half_widths")],
        notes=notes,
        verdict=counted.sentence if claims else "",
        failure="" if claims else counted.sentence,
    )
