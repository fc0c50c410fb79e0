"""The command that plans a route before it is flown."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, scenario_files
from flighttune.present.answer import Answer


def route(
    source: Annotated[
        str,
        Argument(
            metavar="SCENARIO|FILE",
            help="A scenario with a route, or a mission: .plan, .waypoints, .kml or .geojson.",
            autocompletion=scenario_files,
        ),
    ],
    aircraft: Annotated[
        str | None,
        Option(
            help="Aircraft that is to fly a FILE, at an airspeed at which it is identified "
            "[default: aerosonde].",
            autocompletion=aircraft_names,
        ),
    ] = None,
    skip: Annotated[
        bool, Option("--skip", help="Leave out commands of a plan that have no place.")
    ] = False,
    out: Annotated[
        Path | None,
        Option(
            help="Path to write, .plan, .kml or .geojson [default with --claim: runs/NAME.geojson]."
        ),
    ] = None,
    band: Annotated[
        Path | None,
        Option(
            "--claim",
            metavar="FILE",
            help="Band file (.npz) of this route, whose corridor is written with the path.",
        ),
    ] = None,
    settings: options.SetOption = None,
) -> Answer:
    """Plan the route of SCENARIO or FILE: its legs, turns and times, or what cannot be flown."""
    from flighttune.campaign.band import load_band
    from flighttune.flight.route import route as plan_route
    from flighttune.references.fence import fence_tables

    if band is not None and out is None:
        out = Path("runs") / f"{Path(source).stem}.geojson"
    options.check_ending(out, ".geojson", ".kml", ".plan")
    if out is not None and out.exists() and Path(source).exists() and out.samefile(source):
        raise InputError(f"{out}: `--out` must be another file than the one that is read.")
    changed = options.changes(settings)
    planned = plan_route(source, aircraft=aircraft, skip=skip, changes=changed)
    if out is not None:
        counted = None if band is None else load_band(band)
        corridor = None if counted is None else counted.corridor(planned.where)
        own = fence_tables([Path(source)]) if source.lower().endswith(".plan") else {}
        fences = counted.about.fences if counted and counted.about.fences else [own] * bool(own)
        planned.save(out, corridor, fences)
    return replace(planned.answer(), files={"route": out})
