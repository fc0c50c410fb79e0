"""The command that counts bands of campaigns, and answers about them."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display
from flighttune.files.shipped import aircraft_names, campaign_files, scenario_files
from flighttune.present.answer import Answer


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
    turn_back: Annotated[
        str | None,
        Option(
            metavar="[circle:]BANK_DEG",
            help="Count the room to turn back too, at this bank from any place of the route, and "
            "write flight geography, contingency volume and ground risk buffer.",
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
    from flighttune.files.seal import is_claim_file
    from flighttune.files.whole import write_text
    from flighttune.references.maps import volumes_geojson
    from flighttune.reports.claim import write_claim_page

    kept = is_claim_file(source)
    if not kept:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    same = {
        "epsilon": epsilon,
        "confidence": confidence,
        "gains": gains,
        "plant": plant,
        "air": air,
        "seed": seed,
        "changes": options.changes(settings),
        "aircraft": aircraft,
        "like": like,
        "skip": skip,
        "workers": workers,
        "scheduler": scheduler,
    }
    of_flights = {
        "of": of,
        "signals": signal,
        "flights": flights,
        "learn": learn,
        "predicted_from": predicted_from,
        "start_deg": start_deg,
        "fences": fence or (),
    }
    room, files = None, dict[str, Path]()
    with campaign_display() as observer:
        counted = count_band(source, out=out, observer=observer, **of_flights, **same)
        if turn_back is not None:
            place = Path(out or source).with_suffix("")
            files = {"room": Path(f"{place}-turn-back.npz"), "volumes": Path(f"{place}.geojson")}
            room = count_band(
                source, out=files["room"], observer=observer, turn_back=turn_back, **same
            )
    if kept and flights is not None:
        out = out or Path(source)
    file = out or Path(source)
    answer = counted.answer(file)
    if room is not None:
        where = counted.flights.route.where
        write_text(files["volumes"], volumes_geojson(where, room.volumes(counted)) + "\n")
        said = room.answer(files["room"])
        answer = replace(
            answer,
            values={**answer.values, "turn_back": said.values},
            tables=[*answer.tables, said.tables[0]],
            notes=[*answer.notes, *said.notes, said.verdict or said.failure],
        )
    notes = answer.notes
    if page is not None:
        write_claim_page(counted, str(file), page, room)
    else:
        notes = [*notes, f"A page with its flights: flighttune report {file}"]
    return replace(answer, notes=notes, files={"band": out, **files, "page": page})
