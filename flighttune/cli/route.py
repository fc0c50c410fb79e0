"""The command that plans a route before it is flown."""

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.show import pick
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, scenario_files
from flighttune.present.answer import Answer
from flighttune.present.tables import Column, Table, printable
from flighttune.units import DEG

if TYPE_CHECKING:
    from flighttune.references.follow import RouteReference
    from flighttune.scenario.schema import Scenario

# Aircraft that flies a file by default.
AIRCRAFT = "aerosonde"

ROUTE_COLUMNS = [
    Column("kind", "stretch"),
    Column("waypoint", "waypoint"),
    Column("start_m", "begins at", "m", ".0f"),
    Column("length_m", "length", "m", ".0f"),
    Column("course", "course", "deg", ".0f", 1.0 / DEG),
    Column("turn", "turn", "deg", ".0f", 1.0 / DEG),
    Column("radius_m", "radius", "m", ".0f"),
    Column("roll", "roll in still air", "deg", ".0f", 1.0 / DEG),
    Column("roll_downwind", "roll downwind", "deg", ".0f", 1.0 / DEG),
    Column("gamma", "path angle", "deg", ".1f", 1.0 / DEG),
    Column("time_s", "time in still air", "s", ".0f"),
]


def route(
    source: Annotated[
        str,
        Argument(
            metavar="SCENARIO|FILE",
            help="A scenario with a route, or a plan of QGroundControl (.plan) or GeoJSON.",
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
    out: Annotated[Path | None, Option(help="Path to write, .geojson or .kml.")] = None,
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
    from flighttune.campaign.fence import corridor_of
    from flighttune.files.whole import write_text
    from flighttune.references.follow import RouteReference
    from flighttune.references.maps import route_geojson, route_kml
    from flighttune.references.mission import OTHER_FILES, ROUTE_FILES
    from flighttune.scenario.load import load_scenario, route_scenario

    options.check_ending(out, ".geojson", ".kml")
    if band is not None and out is None:
        raise InputError("`--out` must be given with `--claim`.")
    if out is not None and out.exists() and Path(source).exists() and out.samefile(source):
        raise InputError(f"{out}: `--out` must be another file than the one that is read.")
    own = options.changes(settings)
    is_file = Path(source).suffix.lower() in ROUTE_FILES + OTHER_FILES
    if is_file:
        loaded = route_scenario(Path(source), aircraft or AIRCRAFT, skip=skip, changes=own)
    elif aircraft is not None or skip:
        raise InputError(f"{source}: `--aircraft` and `--skip` must be absent for a scenario.")
    else:
        loaded = load_scenario(source, changes=own)
    reference, table = loaded.followed(), loaded.route
    if table is None or not isinstance(reference, RouteReference):
        raise InputError(f"{source}: `route` must be given, got a reference over time.")
    if out is not None:
        where = reference.path, table.origin, loaded.flight.h_m
        written = route_kml if out.suffix.lower() == ".kml" else route_geojson
        corridor = None if band is None else corridor_of(load_band(band), where)
        write_text(out, written(where, printable(loaded.title), corridor))
    wind, assumed = table.wind_at(reference.V_a), " (assumed)"
    conditions = (
        f"airspeed {reference.V_a:g} m/s{assumed * (is_file and 'flight.V_a_mps' not in own)}, "
        f"turns for wind up to {wind:.3g} m/s{assumed * (table.wind_mps is None)}, "
        f"start {loaded.flight.h_m:g} m above sea level"
    )
    return replace(_planned(loaded, reference, wind, conditions), files={"route": out})


def _planned(
    scenario: "Scenario", reference: "RouteReference", wind: float, conditions: str
) -> Answer:
    """The stretches of a route, and how long it takes."""
    path, V_a, g = reference.path, reference.V_a, reference.g
    records = [
        {
            **pick(stretch, "kind waypoint turn gamma"),
            "course": stretch.course % math.tau,
            "start_m": stretch.start,
            "length_m": stretch.length,
            "radius_m": None if math.isinf(stretch.radius) else stretch.radius,
            "roll": math.atan(V_a**2 / (g * stretch.radius)),
            "roll_downwind": math.atan((V_a + wind) ** 2 / (g * stretch.radius)),
            "time_s": stretch.length / (V_a * math.cos(stretch.gamma)),
        }
        for stretch in path.stretches
    ]
    total = sum(record["time_s"] for record in records)
    longest = path.length / (V_a - wind) if wind < V_a else math.inf
    return Answer(
        values={"conditions": conditions, "length_m": path.length, "time_s": total}
        | {"stretches": records},
        tables=[Table(ROUTE_COLUMNS, records, f"{scenario.title}: {conditions}")],
        notes=scenario.notes,
        verdict=f"{path.length:.0f} m, {total:.0f} s in still air, at most {longest:.0f} s in a "
        f"wind of {wind:.3g} m/s",
    )
