"""The command that counts bands of campaigns, and answers about them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display, campaign_pool, pick
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, campaign_files, scenario_files
from flighttune.present.answer import Answer

if TYPE_CHECKING:
    from flighttune.claims.band import Band

# Options that `planned` takes.
PLANNED = ("gains", "plant", "start_deg", "changes", "aircraft", "like", "skip")


def band(
    source: Annotated[
        str,
        Argument(
            metavar="CAMPAIGN|SCENARIO|FILE",
            help="A campaign (file, shipped name or folder), a scenario in which something is "
            "random or --start-deg is given, a mission (.plan, .waypoints, .kml, .geojson), or a "
            "band file: its flights are not flown again.",
            autocompletion=lambda: [*campaign_files(), *scenario_files()],
        ),
    ],
    gains: options.CampaignGainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first aircraft, else the first")] = None,
    of: Annotated[
        Literal["residual"] | None,
        Option(
            help="Bound what the identified model of an aircraft misses, which `tube` takes, in "
            "place of recorded signals."
        ),
    ] = None,
    signal: Annotated[
        list[str] | None,
        Option(
            help="Recorded signal to bound; repeatable [default: chi_err and gamma_err, on a route "
            "cross_track and height_err]."
        ),
    ] = None,
    epsilon: Annotated[
        float | None,
        Option(
            help="Accepted probability of leaving the band [default: 0.01, of a mission 0.05, or "
            "the file's]."
        ),
    ] = None,
    confidence: Annotated[
        float | None,
        Option(
            help="Confidence of the claim, 0 to 1 [default: 0.999, of a mission 0.95, or the "
            "file's]."
        ),
    ] = None,
    flights: Annotated[
        int | None,
        Option(
            help="Flights to count in all [default: as many as the claim needs with five of them "
            "outside, of a mission with one]; of FILE 2, 4, 8 ... times as many as were planned.",
            min=1,
        ),
    ] = None,
    learn: Annotated[
        int | None,
        Option(help="Flights to learn the shape from [default: 500, of a mission 15].", min=1),
    ] = None,
    predicted_from: Annotated[
        Literal["wind"] | None,
        Option(
            "--given", help="Put the band around a middle predicted from the wind of each flight."
        ),
    ] = None,
    air: Annotated[
        Literal["calm", "wind", "light", "moderate", "severe"] | None,
        Option(help="Air of all flights, of those of the campaign [default: as it draws them]."),
    ] = None,
    start_deg: options.StartOption = 0.0,
    seed: options.SeedOption = None,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            help="Band file (.npz) to write [default: runs/NAME-band.npz; FILE with --flights].",
        ),
    ] = None,
    fence: Annotated[
        list[Path] | None,
        Option(
            help="Plan, KML or GeoJSON with the areas to stay in and out of; repeatable: bound the "
            "probability that a flight along a route leaves them, and find where flights come "
            "nearest [default: that of a .plan]."
        ),
    ] = None,
    aircraft: Annotated[
        str | None,
        Option(
            help="Aircraft that is to fly a mission [default: aerosonde].",
            autocompletion=aircraft_names,
        ),
    ] = None,
    like: Annotated[
        str | None,
        Option(
            metavar="CAMPAIGN",
            help="Campaign whose air and dispersions the flights of a mission have [default: light "
            "turbulence, wind to 8 m/s and dispersions of the aircraft].",
            autocompletion=campaign_files,
        ),
    ] = None,
    skip: Annotated[
        bool, Option("--skip", help="Leave out commands of a mission that have no place.")
    ] = False,
    page: Annotated[
        Path | None, Option(help="Page (.html) to write, with a map, heights and the answer.")
    ] = None,
    settings: options.SetOption = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> Answer:
    """Bound signals by counting flights: a new one leaves the band with at most a probability.

    Its shape is learned from some flights, and its scale counted on fresh ones: it holds for all
    signals at all times, for any law, plant and weather. Exit status 1 if too many flights did not
    complete for any claim. With a fence it is 1 only if the count
    does not support that a flight leaves it with a probability of at most epsilon.
    """
    options.check_ending(out, ".npz")
    options.check_ending(page, ".html", option="--page")
    from flighttune.campaign.band import band as count_band
    from flighttune.campaign.band import count_more, load_band, plan_of
    from flighttune.campaign.claims import is_claim_file
    from flighttune.campaign.claims import save_claim as save
    from flighttune.campaign.fence import count_inside, fence_answer, fence_of, mission_answer
    from flighttune.campaign.stated_set import planned
    from flighttune.flight.route import is_mission

    areas, fences = _areas(source, fence or ())
    claim = _stated(epsilon=epsilon, confidence=confidence)
    of_source = _stated(
        of=of,
        signals=signal,
        learn=learn,
        predicted_from=predicted_from,
        gains=gains,
        plant=plant,
        air=air,
        start_deg=start_deg or None,
        seed=seed,
        changes=options.changes(settings) or None,
        aircraft=aircraft,
        like=like,
        skip=skip or None,
    )
    if not is_claim_file(source):
        if areas:  # refuse it before a flight
            own = {key: of_source[key] for key in of_source if key in PLANNED}
            fence_of(planned(source, **own), areas, fences, *signal or ())
        with campaign_display() as observer:
            by = {"workers": workers, "scheduler": scheduler, "observer": observer}
            kept = count_band(source, flights=flights, **claim, **of_source, **by)
        file = out = out or Path("runs") / f"{Path(source).stem}-band.npz"
        save(kept, file)
    else:
        for name in of_source:
            raise InputError(f"`{name}` must be absent for a band file, which has its own.")
        kept, file = load_band(source), Path(source)
        if areas and flights is not None:  # refuse it before a flight
            fence_of(plan_of(kept), areas, fences, *kept.about.signals)
        with campaign_pool(workers, scheduler) as pool:
            if flights is not None:
                kept, out = count_more(kept, flights, pool), out or file
                save(kept, file)  # whatever else is written: its readings are those of FILE
    if areas:
        kept = kept.with_fence(areas)
        count_inside(kept, kept.about.fences[-1], fences)  # refuses it before it is kept
        save(kept, file)
    counted = kept.claiming(**{**pick(kept.about, "epsilon confidence"), **claim})
    if out is not None:
        save(counted, out)
    file = out or file
    answer = counted.answer(file)
    if areas:
        answer = fence_answer(counted, answer)
    if is_mission(source):
        answer = mission_answer(counted, answer)
    return _paged(counted, answer, file, {"band": out, "page": page})


def _areas(source: str, stated: Sequence[Path]) -> tuple[dict[str, Any], Path]:
    """The areas of the fences that are stated, by default of a plan itself, and their files."""
    from flighttune.references.fence import fence_tables

    files = stated or [Path(source)] * source.lower().endswith(".plan")
    areas = fence_tables(files) if files else {}
    if stated and not areas:
        raise InputError(f"{stated[0]}: must have a Polygon or circle for a fence, got none.")
    return areas, Path(", ".join(map(str, files)))


def _paged(counted: "Band", answer: Answer, file: Path, files: Mapping[str, Path | None]) -> Answer:
    """The answer with its files; writes its page, or says how."""
    from flighttune.reports.claim import write_claim_page

    notes = answer.notes
    if (page := files["page"]) is not None:
        write_claim_page(counted, str(file), page)
    else:
        notes = [*notes, f"A page with its flights: flighttune report {file}"]
    return replace(answer, notes=notes, files=files)


def _stated(**given: Any) -> dict[str, Any]:
    """The options that were stated."""
    return {name: value for name, value in given.items() if value is not None}
