"""Commands that bound flights: missions, bands, tubes, and the worst flight."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.options import Verb, of
from flighttune.cli.show import campaign_display, progress_bar
from flighttune.errors import InfeasibleError, InputError
from flighttune.present.answer import Answer


@of(
    "campaign.band:band",
    source={"metavar": "CAMPAIGN|SCENARIO|FILE", "autocompletion": options.to_fly},
    out="Band file (.npz) to write [default: runs/NAME-band.npz; FILE with --flights].",
)
def band(count_band: Verb, source: str, flights: int | None, out: Path | None) -> Answer:
    """Bound signals by counting flights: a new one leaves the band with at most a probability.

    Its shape is learned from some flights, and its scale counted on fresh ones: it holds for all
    signals at all times, for any law, plant and weather. --set seed=N draws others. Exit status 1
    if too many flights did not complete for any claim.
    """
    from flighttune.files.load import BAND, kind_of

    if kind_of(source) != BAND:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    file = out or Path(source)
    answer = count_band(out=out).answer(file)
    notes = [*answer.notes, f"A page with its flights: flighttune report {file}"]
    out = out or (Path(source) if flights is not None else None)
    return replace(answer, notes=notes, files={"band": out, "page": None})


@of(
    "campaign.band:monitor",
    source={"metavar": "CAMPAIGN|MISSION|SCENARIO|LOG", "autocompletion": options.to_fly},
    out="Monitor file (.npz) to write [default: runs/NAME-monitor.npz].",
)
def monitor(
    count_monitor: Verb,
    out: Path,
    logs: Annotated[
        list[str] | None, Argument(metavar="[LOG ...]", help="Further logs of healthy flights.")
    ] = None,
) -> Answer:
    """Count how often a monitor of flights raises a false alarm, or learn one from logs.

    It learns from healthy flights what to expect of signals that an autopilot has. --set seed=N
    draws others. Exit status 1 if too many flights did not complete for any claim.
    """
    from flighttune.claims.counted import Counted

    counted = count_monitor(*(logs or ()))
    answer = counted.answer(out) if isinstance(counted, Counted) else counted.answer()
    return replace(answer, files={"monitor": out})


@of(
    "campaign.mission:mission",
    source={"metavar": "MISSION|SCENARIO|FILE", "autocompletion": options.to_fly},
    turn_back={"metavar": "[circle:]BANK_DEG"},
    terrain={"metavar": "FILE"},
    page="Page (.html) to write, with a map, heights and the answer.",
    out="Band file to write, .npz [default: runs/NAME-band.npz for a new band]; with --plan the "
    "path, .plan, .kml or .geojson, that of FILE with its corridor.",
)
def mission(
    count_mission: Verb,
    source: str,
    changes: dict[str, Any],
    page: Path | None,
    out: Path | None,
    plan: Annotated[
        bool, Option("--plan", help="Plan the route alone: its legs, turns and times.")
    ] = False,
) -> Answer:
    """Plan a mission, fly it, and count whether it stays inside its fence.

    The answer has the corridor of its flights, the probability that a new one leaves the fence and
    where they come nearest to it. Exit status 1 if the planned path leaves the fence, or the count
    does not support a probability of at most epsilon; 2 if the mission cannot be flown.
    """
    from flighttune.campaign.mission import mission_plan
    from flighttune.files.load import BAND, kind_of
    from flighttune.reports.claim import write_claim_page

    settings = count_mission.keywords
    of_route = "fences", "aircraft", "terrain", "changes", "out"
    if plan:
        options.check_ending(out, ".geojson", ".kml", ".plan")
        for name in [x for x in settings if x not in of_route] + ["page"] * bool(page):
            raise InputError(f"`{name}` must be absent with --plan, which flies nothing.")
        return mission_plan(source, **settings)
    options.check_ending(out, ".npz")
    if kind_of(source) != BAND:
        out = out or Path("runs") / f"{Path(source).stem}-band.npz"
    try:
        odds = count_mission(out=out)
    except InfeasibleError:  # what is planned says why
        of_plan = {key: settings[key] for key in of_route[:3] if key in settings}
        return mission_plan(source, changes=changes, **of_plan)
    answer, file = odds.answer(), out or Path(source)
    if page is not None:
        write_claim_page(odds.band, str(file), page, odds.room, odds.terrain, answer.changed)
        return replace(answer, files={**answer.files, "page": page})
    notes = [*answer.notes, f"A page with its flights: flighttune report {file}"]
    return replace(answer, notes=notes, files={**answer.files, "page": None})


@of(
    "campaign.band:tube",
    out="Proof file (.npz) to write [default: runs/NAME-tube.npz where the set is bounded].",
)
def tube(
    enclose: Verb,
    scenario: str,
    gains: str | None,
    out: Path | None,
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
) -> Answer:
    """Enclose all flights of SCENARIO with one gain set, limits included; prove the bounds.

    Exit status 1 if the set cannot be bounded for the whole time, or if a flight leaves it.
    """
    from flighttune.campaign.band import residual
    from flighttune.campaign.claims import load_residual
    from flighttune.files.load import BAND, kind_of
    from flighttune.tubes.tube import largest_disturbance

    largest, base = disturbance == "largest", Path("runs") / Path(scenario).stem
    if largest and (boxes, out) != (None, None):
        raise InputError("`disturbance` must be a number with --boxes or --out, got largest.")
    counted = None
    in_file = boxes is not None and kind_of(boxes) == BAND
    if boxes is not None and not in_file:
        with campaign_display() as observer:
            counted = residual(boxes, gains=gains, **options.FLOWN_BY.get(), observer=observer)
    elif boxes is not None:
        counted = load_residual(boxes)
    with progress_bar() as progress:
        follow = None if progress is None else partial(progress, "tube")
        if largest:
            settings = {**enclose.keywords, "progress": follow}
            del settings["disturbance"]
            return largest_disturbance(scenario, **settings).answer()
        bound = options.number(disturbance, "--disturbance")
        enclosure = enclose(boxes=counted, disturbance=bound, progress=follow)
    files: dict[str, Path | None] = {"proof": None}
    if enclosure.problem.band is not None and not in_file:
        files["boxes"] = Path(f"{base}-boxes.npz")
        enclosure.problem.band.save(files["boxes"])
    if enclosure.status == "bounded":
        files["proof"] = out or Path(f"{base}-tube.npz")
        enclosure.save(files["proof"])
    return replace(enclosure.answer(gains or ""), files=files)


@of(
    "campaign.worst:worst",
    source={"metavar": "SCENARIO|CAMPAIGN|FILE", "autocompletion": options.to_fly},
    claim={"metavar": "FILE"},
    out="Scenario (.toml) to write [default: runs/NAME-worst.toml].",
)
def worst(search: Verb, out: Path) -> Answer:
    """Search dispersions and disturbances for the flight with the smallest margin.

    Writes that flight as a scenario for `flighttune fly`. Exit status 1 if it leaves a tube that is
    proven for it.
    """
    flight = search()
    flight.save(out)
    return replace(flight.answer(), files={"scenario": out})
