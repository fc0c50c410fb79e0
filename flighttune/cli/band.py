"""Commands that bound flights: missions, bands, tubes, and the worst flight."""

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
            "random or --start-deg is given, or a band file: its flights are not flown again.",
            autocompletion=lambda: [*campaign_files(), *scenario_files()],
        ),
    ],
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
            "outside]; of FILE 2, 4, 8 ... times as many as were planned.",
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
    gains: options.CampaignGainsOption = None,
    plant: Annotated[str | None, options.plant_label("the first aircraft, else the first")] = None,
    air: Annotated[
        Literal["calm", "wind", "light", "moderate", "severe"] | None,
        Option(help="Air of all flights, of those of the campaign [default: as it draws them]."),
    ] = None,
    start_deg: options.StartOption = 0.0,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            help="Band file (.npz) to write [default: runs/NAME-band.npz; FILE with --flights].",
        ),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Bound signals by counting flights: a new one leaves the band with at most a probability.

    Its shape is learned from some flights, and its scale counted on fresh ones: it holds for all
    signals at all times, for any law, plant and weather. --set seed=N draws others. Exit status 1
    if too many flights did not complete for any claim.
    """
    options.check_ending(out, ".npz")
    from flighttune.campaign.band import band as count_band
    from flighttune.campaign.band import continued, load_counted
    from flighttune.files.load import BAND, kind_of

    changed, kept = options.changes(settings), kind_of(source) == BAND
    if not kept:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    of_flights = {
        "signals": signal,
        "learn": learn,
        "predicted_from": predicted_from,
        "gains": gains,
        "plant": plant,
        "air": air,
        "seed": options.seed_of(changed),
        "start_deg": start_deg,
        "changes": changed,
    }
    claim = {"flights": flights, "epsilon": epsilon, "confidence": confidence, "out": out}
    with campaign_display() as observer:
        if kept and not any(of_flights.values()):  # of any kind of count
            by = options.FLOWN_BY.get()
            flown_by = by["workers"], by["scheduler"], observer
            counted = continued(load_counted(source), source, **claim, by=flown_by)
        else:
            flown = {**of_flights, **options.FLOWN_BY.get()}
            counted = count_band(source, **claim, **flown, observer=observer)
    file = out or Path(source)
    answer = counted.answer(file)
    notes = [*answer.notes, f"A page with its flights: flighttune report {file}"]
    out = out or (Path(source) if flights is not None else None)
    return replace(answer, notes=notes, files={"band": out, "page": None})


def mission(
    source: Annotated[
        str,
        Argument(
            metavar="MISSION|SCENARIO|FILE",
            help="A mission (.plan, .waypoints, .kml, .geojson), a scenario or campaign with a "
            "route, or the band file of one: its flights are not flown again.",
            autocompletion=lambda: [*scenario_files(), *campaign_files()],
        ),
    ],
    aircraft: Annotated[
        str | None,
        Option(
            help="Aircraft that is to fly a mission, at an airspeed at which it is identified "
            "[default: aerosonde].",
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
    plan: Annotated[
        bool, Option("--plan", help="Plan the route alone: its legs, turns and times.")
    ] = False,
    fence: Annotated[
        list[Path] | None,
        Option(
            help="Plan, KML or GeoJSON with the areas to stay in and out of; repeatable [default: "
            "that of a .plan]."
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
    epsilon: Annotated[
        float | None,
        Option(help="Accepted probability of each claim [default: 0.05, or the file's]."),
    ] = None,
    confidence: Annotated[
        float | None,
        Option(help="Confidence of each claim, 0 to 1 [default: 0.95, or the file's]."),
    ] = None,
    flights: Annotated[
        int | None,
        Option(
            help="Flights to count [default: as many as the claim needs with one outside].", min=1
        ),
    ] = None,
    page: Annotated[
        Path | None, Option(help="Page (.html) to write, with a map, heights and the answer.")
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            help="Band file (.npz) to write [default: runs/NAME-band.npz]; with --plan the path, "
            ".plan, .kml or .geojson, that of FILE with its corridor.",
        ),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Plan a mission, fly it, and count whether it stays inside its fence.

    The answer has the corridor of its flights, the probability that a new one leaves the fence and
    where they come nearest to it. Exit status 1 if the count does not support a probability of at
    most epsilon; 2 if the mission cannot be flown.
    """
    from flighttune.campaign.mission import mission as count_mission
    from flighttune.campaign.mission import mission_plan
    from flighttune.files.load import BAND, kind_of
    from flighttune.reports.claim import write_claim_page

    changed = options.changes(settings)
    read = {"aircraft": aircraft, "skip": skip, "changes": changed}
    claim = {"epsilon": epsilon, "confidence": confidence, "flights": flights}
    counting = {"like": like, "fences": fence or (), "turn_back": turn_back, **claim}
    if plan:
        options.check_ending(out, ".geojson", ".kml", ".plan")
        for name in (name for name, value in {**counting, "page": page}.items() if value):
            raise InputError(f"`{name}` must be absent with --plan, which flies nothing.")
        return mission_plan(source, **read, out=out)
    options.check_ending(out, ".npz")
    options.check_ending(page, ".html", option="--page")
    if kind_of(source) != BAND:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    seed = options.seed_of(changed)
    with campaign_display() as observer:
        flown = {**read, **counting, **options.FLOWN_BY.get(), "seed": seed, "observer": observer}
        odds = count_mission(source, out=out, **flown)
    answer, file = odds.answer(), out or Path(source)
    if page is not None:
        write_claim_page(odds.band, str(file), page, odds.room)
        return replace(answer, files={**answer.files, "page": page})
    notes = [*answer.notes, f"A page with its flights: flighttune report {file}"]
    return replace(answer, notes=notes, files={**answer.files, "page": None})


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
        str | None,
        Option(
            metavar="FILE|CAMPAIGN",
            help="Boxes of an aircraft's residual signals: a file, or a campaign on whose flights "
            "they are counted [default: for an aircraft, counted on flights of SCENARIO from "
            "starts within --start-deg].",
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
    from flighttune.campaign.band import residual
    from flighttune.campaign.claims import load_residual
    from flighttune.campaign.tube import tube as enclose
    from flighttune.files.load import BAND, kind_of
    from flighttune.tubes.tube import largest_disturbance

    options.check_ending(out, ".npz")
    largest, base = disturbance == "largest", Path("runs") / Path(scenario).stem
    if largest and (boxes, out) != (None, None):
        raise InputError("`disturbance` must be a number with --boxes or --out, got largest.")
    flights = {"plant": plant, "start": start_deg * DEG, "changes": options.changes(settings)}
    counted, in_file = None, boxes is not None and kind_of(boxes) == BAND
    if boxes is not None:
        with campaign_display() as observer:
            by = options.FLOWN_BY.get()
            counted = (
                load_residual(boxes)
                if in_file
                else residual(boxes, gains=gains, **by, observer=observer)
            )
    with campaign_display() as observer, progress_bar() as progress:
        follow = None if progress is None else partial(progress, "tube")
        if largest:
            return largest_disturbance(scenario, gains, **flights, progress=follow).answer()
        bound = options.number(disturbance, "--disturbance")
        enclosure = enclose(
            scenario,
            gains,
            counted,
            disturbance=bound,
            **flights,
            progress=follow,
            observer=observer,
        )
    files: dict[str, Path | None] = {"proof": None}
    if enclosure.problem.band is not None and not in_file:
        files["boxes"] = Path(f"{base}-boxes.npz")
        enclosure.problem.band.save(files["boxes"])
    if enclosure.status == "bounded":
        files["proof"] = out or Path(f"{base}-tube.npz")
        enclosure.save(files["proof"])
    return replace(enclosure.answer(gains or ""), files=files)


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
            **options.FLOWN_BY.get(),
            observer=observer,
        )
    file = out or Path("runs") / f"{Path(source).stem}-worst.toml"
    flight.save(file)
    return replace(flight.answer(), files={"scenario": file})
