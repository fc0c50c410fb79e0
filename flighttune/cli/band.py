"""Commands that bound flights: bands, tubes, and the worst flight."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import campaign_display, progress_bar
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, campaign_files, scenario_files
from flighttune.present.answer import Answer
from flighttune.units import DEG


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
    from flighttune.campaign.turn_back import turning_back
    from flighttune.files.load import BAND, kind_of
    from flighttune.files.whole import write_text
    from flighttune.planning.source import flights as flights_of
    from flighttune.references.maps import volumes_geojson
    from flighttune.reports.claim import write_claim_page

    kept = kind_of(source) == BAND
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
    if turn_back is not None:  # refuse it before a flight
        if kept or of or signal or predicted_from:
            raise InputError(
                "`--turn-back` must be absent for a band file, and with --of, --signal and --given."
            )
        stated = {key: same[key] for key in ("changes", "aircraft", "like", "skip")}
        plan = flights_of(source, **stated).plan(plant=plant, gains=gains, kind="jsbsim")
        turning_back(plan, turn_back)
    with campaign_display() as observer:
        counted = count_band(source, out=out, observer=observer, **of_flights, **same)
        if turn_back is not None:
            place = Path(out or source).with_suffix("")
            files = {"room": Path(f"{place}-turn-back.npz")}
            room = count_band(
                source, out=files["room"], observer=observer, turn_back=turn_back, **same
            )
    if kept and flights is not None:
        out = out or Path(source)
    file = out or Path(source)
    answer = counted.answer(file)
    if room is not None:
        said = room.answer(files["room"])
        if room.claims and counted.claims:
            text = volumes_geojson(counted.flights.route.where, room.volumes(counted))
            files["volumes"] = Path(out or source).with_suffix(".geojson")
            write_text(files["volumes"], f"{text}\n")
        answer = replace(
            answer,
            values={**answer.values, "turn_back": said.values},
            tables=[*answer.tables, said.tables[0]],
            notes=[*answer.notes, *said.notes, said.verdict],
            failure=answer.failure or said.failure,
        )
    notes = answer.notes
    if page is not None:
        write_claim_page(counted, str(file), page, room)
    else:
        notes = [*notes, f"A page with its flights: flighttune report {file}"]
    return replace(answer, notes=notes, files={"band": out, **files, "page": page})


def tube(
    scenario: options.ScenarioArgument,
    gains: options.GainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first that is not an aircraft")] = None,
    start_deg: options.StartOption = 0.0,
    disturbance: Annotated[
        str | None,
        Option(
            metavar="RAD_S|largest",
            help="Bound on the disturbance of each rate, rad/s [default: the scenario's, or the "
            "residual of the logs of a model]; largest searches, to two digits, for the largest "
            "for which the set is bounded.",
        ),
    ] = None,
    boxes: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="File of `flighttune band --of residual`: bound its aircraft, with rates in it.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        Option("--out", help="Proof file (.npz) to write [default: runs/NAME-tube.npz]."),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time, or if a flight leaves it.
    """
    from flighttune.files.load import BAND, load_one
    from flighttune.tubes.tube import largest_disturbance
    from flighttune.tubes.tube import tube as enclose

    options.check_ending(out, ".npz")
    largest = disturbance == "largest"
    if largest and (boxes, out) != (None, None):
        raise InputError("`disturbance` must be a number with --boxes or --out, got largest.")
    flights = {"plant": plant, "start": start_deg * DEG, "changes": options.changes(settings)}
    with progress_bar() as progress:
        follow = None if progress is None else partial(progress, "tube")
        if largest:
            answer = largest_disturbance(scenario, gains, **flights, progress=follow).answer()
        else:
            enclosure = enclose(
                scenario,
                gains,
                None if boxes is None else load_one(boxes, "band file", BAND),
                disturbance=options.number(disturbance, "--disturbance"),
                progress=follow,
                **flights,
            )
            proof = None
            if enclosure.status == "bounded":
                proof = out or Path("runs") / f"{Path(scenario).stem}-tube.npz"
                enclosure.save(proof)
            answer = replace(enclosure.answer(gains or ""), files={"proof": proof})
    return answer


def worst(
    source: Annotated[
        str,
        Argument(
            metavar="SCENARIO|CAMPAIGN|FILE",
            help="A campaign (file, shipped name or folder), whose dispersions are searched, a "
            "scenario with --start-deg or --disturbance, or the file of a tube or band: its "
            "flights are searched for the one nearest to its edge.",
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
    claim: Annotated[
        Path | None,
        Option(
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

    Writes that flight as a scenario for `flighttune fly`. Exit status 1 if it leaves a tube that is
    proven for it.
    """
    options.check_ending(out, ".toml")
    from flighttune.campaign.worst import worst as search
    from flighttune.files.load import TUBE, load_one

    with campaign_display() as observer:
        flight = search(
            source,
            claim=None if claim is None else load_one(claim, "tube", TUBE),
            budget=budget,
            metric=metric,
            gains=gains,
            plant=plant,
            completed=completed,
            start_deg=start_deg,
            disturbance=disturbance,
            seed=seed,
            changes=options.changes(settings),
            workers=workers,
            scheduler=scheduler,
            observer=observer,
        )
    file = out or Path("runs") / f"{Path(source).stem}-worst.toml"
    flight.save(file)
    return replace(flight.answer(), files={"scenario": file})
