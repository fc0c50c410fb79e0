"""The command that counts bands of campaigns, and answers about them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_pool, pick, progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns, shown_unit
from flighttune.present.tables import Column, Table, number
from flighttune.shipped import campaign_files, scenario_files

if TYPE_CHECKING:
    from flighttune.guarantee.band import Band
    from flighttune.simulate.run import Run

WIDTH_COLUMNS = [
    Column("signal", "signal"),
    Column("largest", "largest half-width", digits=".2f"),
    Column("last_quarter", "in the last quarter", digits=".2f"),
    Column("end", "at the end", digits=".2f"),
    Column("low", "lowest bound", digits=".2f"),
    Column("high", "highest bound", digits=".2f"),
    Column("unit", "unit"),
]

# Part of the time whose largest half-width is printed too: flights have settled by then.
LAST_QUARTER = 0.75

# Options that `planned` takes.
PLANNED = ("gains", "plant", "start_deg", "changes")

NEAREST_COLUMNS = [
    Column("what", "nearest to the fence"),
    Column("margin_m", "margin", "m", "z.2f"),
    Column("side", "side"),
    Column("edge", "edge"),
    Column("along_m", "along", "m", ".0f"),
    Column("stretch", "stretch"),
]


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
    gains: options.CampaignGainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first aircraft, else the first")] = None,
    signal: Annotated[
        list[str] | None,
        Option(
            help="Recorded signal to bound; repeatable [default: chi_err and gamma_err, on a route "
            "cross_track and height_err]."
        ),
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
    start_deg: options.StartOption = 0.0,
    seed: options.SeedOption = None,
    recount: Annotated[
        int | None,
        Option(
            help="Fly so many of the flights in FILE again, and compare them to the bit.", min=1
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            help="Band file (.npz) to write [default: runs/NAME-band.npz; FILE with --flights].",
        ),
    ] = None,
    fence: Annotated[
        Path | None,
        Option(
            help="GeoJSON polygon: bound the probability that a flight along a route leaves it, "
            "and find where flights come nearest."
        ),
    ] = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> Answer:
    """Count the band that a flight of a campaign leaves with at most a stated probability.

    Its shape is learned from some flights, and its scale counted on fresh ones: it holds for all
    signals at all times, for any law, plant and weather. Exit status 1 if too many flights did not
    complete for any claim, or a flight of a recount differs. With a fence it is 1 only if the count
    does not support that a flight leaves it with a probability of at most epsilon.
    """
    options.check_ending(out, ".npz")
    if fence is not None and recount is not None:
        raise InputError("`recount` must be absent with a fence.")
    from flighttune.campaign.band import count_band, count_more, plan_of
    from flighttune.campaign.band import recount as count_again
    from flighttune.campaign.fence import fence_of
    from flighttune.campaign.stated_set import planned
    from flighttune.guarantee.band import load_band, save_band

    claim = _stated(epsilon=epsilon, confidence=confidence)
    of_source = _stated(
        signals=signal,
        learn=learn,
        predicted_from=predicted_from,
        gains=gains,
        plant=plant,
        start_deg=start_deg or None,
        seed=seed,
        changes=options.changes(settings) or None,
    )
    if Path(source).suffix != ".npz":
        if recount is not None:
            raise InputError("`recount` must be absent for anything but a band file.")
        if fence is not None:  # refuse it before a flight
            own = {key: of_source[key] for key in of_source if key in PLANNED}
            fence_of(planned(source, **own), fence, signal)
        with campaign_pool(workers, scheduler) as pool:
            counted = count_band(source, pool, flights=flights, **claim, **of_source)
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    else:
        for name in of_source:
            raise InputError(f"`{name}` must be absent for a band file, which has its own.")
        counted = load_band(source)
        if fence is not None and flights is not None:  # refuse it before a flight
            fence_of(plan_of(counted), fence, counted.about.signals)
        with campaign_pool(workers, scheduler) as pool:
            if recount is not None:
                differ = count_again(counted, recount, pool)
                says = f"{source}: {len(differ)} of {recount} flights flown again differ"
                answer = Answer(values={"flights": recount, "differ": differ}, verdict=says)
                return replace(answer, failure=f"{says}: {differ}" if differ else "")
            if flights is not None:
                counted, out = count_more(counted, flights, pool), out or Path(source)
        counted = counted.claiming(**{**pick(counted.about, "epsilon confidence"), **claim})
    if out is not None:
        save_band(counted, out)
    file = out or source
    answer = band_answer(counted, file)
    if fence is not None:
        answer = fence_answer(counted, fence, answer)
    page = [f"A page with its flights: flighttune report {file}"]
    return replace(answer, notes=[*answer.notes, *page], files={"band": out})


def band_around(runs: "Sequence[Run]", file: Path | None) -> tuple["list[Run]", Answer]:
    """The runs with the band of a file around them, and its part of the answer of a command."""
    from flighttune.guarantee.bounds import band_notes, inside_bands

    if file is None:
        return list(runs), Answer(notes=band_notes(runs))
    from flighttune.campaign.band import around
    from flighttune.guarantee.band import load_band

    counted = load_band(file)
    try:
        drawn = around(counted, runs)
    except InputError as error:
        raise InputError(f"{file}: {error}") from error
    values = {"file": str(file), "inside": inside_bands(drawn), **band_answer(counted).values}
    return drawn, Answer(values={"band": values}, notes=band_notes(drawn))


def fly_draw(file: Path, draw: int, out: Path | None) -> Answer:
    """Fly a draw of the band in a file again, and record it with the band around it."""
    from flighttune.campaign.band import plan_of
    from flighttune.campaign.flying.alone import fly_again
    from flighttune.guarantee.band import load_band
    from flighttune.recording.record import record

    counted, name = load_band(file), f"{file.stem}-run-{draw}"
    plan = plan_of(counted)
    with progress_bar() as progress:
        flown = fly_again(plan, draw, progress=progress)
    run = flown[plan.group_of(draw).label]
    runs, around = list(flown.runs), Answer(notes=[f"{run.label}: {run.outcome}"])
    if run.status == "completed" and counted.about.scale is not None:
        runs, around = band_around(runs, file)
    files = record(replace(flown, runs=tuple(runs)), out or Path("runs") / name, name=name)
    of_draw = plan.values_of(draw)
    drawn = [{"parameter": key, "value": of_draw[key]} for key in plan.keys]
    return Answer(
        values={
            "run": draw,
            **pick(run, "status reason"),
            "signals": files.signals,
            **around.values,
        },
        tables=[Table(columns("parameter value"), drawn, f"draw {draw}: {run.label}")],
        notes=[*around.notes, "A band keeps no row of a flight to compare it with."],
        files={"recording": files.recording},
    )


def band_page(file: str, out: Path) -> Answer:
    """Write the page of the band in a file."""
    from flighttune.guarantee.band import load_band
    from flighttune.report.band import write_band_page

    counted = load_band(file)
    answer = band_answer(counted, file)
    page = write_band_page(counted, file, out, answer.tables, answer.notes)
    return replace(answer, files={"report": page.path})


def _stated(**given: Any) -> dict[str, Any]:
    """The options that were stated."""
    return {name: value for name, value in given.items() if value is not None}


def band_answer(counted: "Band", file: str | Path = "FILE") -> Answer:
    """The half-widths of a band in a file and its claim; a failure if nothing is claimed."""
    about, claims = counted.about, counted.about.scale is not None
    records = []
    for (name, unit), widths in zip(about.signals.items(), counted.half_widths.T, strict=True):
        shown, factor = shown_unit(unit)
        late = about.edges[:-1] >= LAST_QUARTER * about.edges[-1]
        ends = {"largest": widths.max(), "last_quarter": widths[late].max(), "end": widths[-1]}
        if not about.predicted_from:
            bounds = counted.bounds(about.edges[:-1])
            at = bounds.names.index(name)
            ends |= {"low": bounds.low[:, at].min(), "high": bounds.high[:, at].max()}
        in_unit = {key: float(width) * factor for key, width in ends.items()}
        records.append({"signal": name, **in_unit, "unit": shown})
    notes = []
    if about.predicted_from:
        notes.append("The band is around a middle that is predicted from the wind of each flight.")
    if claims:
        notes.append(
            f"Of the flights inside, draw {counted.nearest} (seed {about.plan['campaign']['seed']})"
            f" is nearest to leaving: flighttune campaign fly {file} --run {counted.nearest}"
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


def fence_answer(counted: "Band", file: Path, answer: Answer) -> Answer:
    """The answer of a band with whether its flights stay inside a fence; a failure if not."""
    from flighttune.campaign.fence import count_inside

    count, flights = count_inside(counted, file), len(counted.scores)
    said = [
        f"The band itself is {'inside' if nearest['margin_m'] >= 0.0 else 'not inside'} the fence."
        for nearest in count.nearest
        if nearest["what"] == "band"
    ]
    sentence = (
        f"of {flights} fresh flights {flights - count.outside} are certainly inside the fence: a "
        f"new flight leaves it with probability at most {number(count.epsilon)}, confidence "
        f"{counted.confidence:.10g}"
    )
    return replace(
        answer,
        values={**answer.values, "fence": count._asdict()},
        tables=[*answer.tables, Table(NEAREST_COLUMNS, count.nearest, "fence")],
        notes=[*answer.notes, answer.verdict or answer.failure, *said],
        verdict=sentence if count.supported else "",
        failure="" if count.supported else f"{sentence}; {counted.about.epsilon:g} was asked for",
    )
