"""Commands about an aircraft: adopt one, trim it, design and identify its inner loop."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.options import ColumnOption, check_ending, out_folder
from flighttune.cli.show import INTERRUPTED, fail, on_interrupt, quiet, tell
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, is_shipped
from flighttune.present.answer import Answer
from flighttune.units import DEG

AircraftArgument = Annotated[
    str,
    Argument(
        metavar="AIRCRAFT",
        help="A shipped aircraft, or the folder of one.",
        autocompletion=aircraft_names,
    ),
]
HeightOption = Annotated[float, Option("--h", help="Height above sea level in m.")]


def _airspeeds(default: str) -> Any:
    return Option("--V-a", help=f"Airspeed in m/s; repeatable [default: {default}].")


def _path_angles(default: str) -> Any:
    return Option("--gamma", help=f"Flight-path angle in deg; repeatable [default: {default}].")


def trim(
    aircraft: AircraftArgument,
    V_a: Annotated[list[float] | None, _airspeeds("six over the envelope")] = None,
    gamma: Annotated[list[float] | None, _path_angles("-10 to 45, or the glide")] = None,
    phi: Annotated[float, Option("--phi", help="Bank angle in deg.")] = 0.0,
    h: HeightOption = 1000.0,
    verbose: Annotated[
        bool, Option("--verbose", "-v", help="Print every condition, with angles and surfaces.")
    ] = False,
) -> Answer:
    """Trim AIRCRAFT over its envelope; where no trim exists, say why."""
    from flighttune.plants.jsbsim.trims import trim as trim_aircraft

    angles = [angle * DEG for angle in gamma] if gamma else None
    trims = trim_aircraft(aircraft, V_a=V_a or None, gamma=angles, phi=phi * DEG, h=h)
    return trims.answer(every_condition=verbose)


def design(
    aircraft: AircraftArgument,
    out: Annotated[
        Path | None, out_folder("the aircraft's own; required for a shipped one")
    ] = None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Print the gains; write no file and no figure.")
    ] = False,
) -> Answer:
    """Design the gains of AIRCRAFT's inner loop, check its step responses and write the gains."""
    from flighttune.aircraft.aircraft import load_aircraft
    from flighttune.identification.design import design as design_aircraft

    folder = load_aircraft(aircraft).folder
    if out is None and is_shipped(folder) and not dry_run:
        raise InputError(f"{aircraft}: --out must be given for an aircraft that is shipped.")
    designed = design_aircraft(aircraft)
    if dry_run or designed.missed:
        return replace(designed.answer(), files={"written": None, "figure": None})
    return replace(designed.answer(), files=designed.save(out or folder))


def identify(
    aircraft: Annotated[
        str,
        Argument(
            metavar="AIRCRAFT|LOG",
            help="A shipped aircraft, or the folder of one; or the log of a real flight (.ulg, "
            ".bin, .tlog, .csv), @START:END for a part of it in s.",
            autocompletion=aircraft_names,
        ),
    ],
    logs: Annotated[
        list[str] | None, Argument(metavar="[LOG...]", help="Further logs of the same aircraft.")
    ] = None,
    V_a: Annotated[list[float] | None, _airspeeds("that of the design")] = None,
    gamma: Annotated[list[float] | None, _path_angles("0, or the glide")] = None,
    h: HeightOption = 1000.0,
    seed: Annotated[int, Option(help="Seed of the excitation.", min=0)] = 0,
    out: Annotated[
        Path | None,
        Option(
            help="Model file to write, with a figure of the same name [default: identified.json in "
            "the aircraft's folder; for a shipped one or a log runs/identified/NAME.json]."
        ),
    ] = None,
    column: ColumnOption = None,
    assume: Annotated[
        list[str] | None,
        Option(
            metavar="CHANNEL=RAD_S",
            help="Bandwidth of phi or n_z to assume where logs cannot tell it; repeatable.",
        ),
    ] = None,
) -> Answer:
    """Identify how AIRCRAFT follows its commands in flight; write a model to tune on.

    Logs are of real flights: their stretches with enough command are fitted. Exit status 1 if
    they cannot tell a channel; then nothing is written.
    """
    from flighttune.logs.identify import identify as identify_source

    check_ending(out, ".json")
    identified = identify_source(
        aircraft,
        *(logs or ()),
        V_a=V_a or (),
        gamma=[angle * DEG for angle in gamma or ()],
        h=h,
        seed=seed,
        columns=column or (),
        assume=options.numbers(assume, "--assume", "CHANNEL=RAD_S"),
    )
    return replace(identified.answer(), files=identified.save(out))


def adopt(
    model: Annotated[
        str,
        Argument(
            metavar="MODEL|FILE.xml|FOLDER",
            help="A model that comes with JSBSim, or the main file of another, or its folder; also "
            "the file NAME-set.xml of an aircraft of FlightGear, or the folder that holds it.",
        ),
    ],
    V_a: Annotated[
        float | None, Option("--V-a", help="Airspeed in m/s [default: chosen by the model].")
    ] = None,
    h: Annotated[
        float | None,
        Option("--h", help="Height above sea level in m [default: 1000, more for a steep glide]."),
    ] = None,
    values: Annotated[
        list[str] | None,
        Option("--set", metavar="NAME=VALUE", help="Value of a property of the model; repeatable."),
    ] = None,
    throttle: Annotated[
        str | None, Option(help="Property that takes the throttle of the first engine.")
    ] = None,
    glide: Annotated[bool, Option("--glide", help="Leave the engines off.")] = False,
    no_rudder: Annotated[
        bool, Option("--no-rudder", help="Leave yaw to the airframe, without a rudder.")
    ] = False,
    out: Annotated[Path | None, out_folder("aircraft/MODEL")] = None,
) -> Answer:
    """Make an aircraft from a JSBSim model: find its surfaces and engines, tune it and fly it.

    Surfaces, engines and airspeed are found by experiment; the inner loop is designed, flown and
    identified, the outer loop is tuned on the identified model and flown in a turn, compared with
    the paper's gains scaled with airspeed.
    """
    from flighttune.adoption.adopt import adopt as adopt_model
    from flighttune.adoption.page import write_adoption

    name = Path(os.path.abspath(model)).stem.removesuffix("-set")
    choices = {"throttle": throttle, "glide": glide, "rudder": not no_rudder}
    choices["values"] = options.numbers(values, "--set", "NAME=VALUE of a property")
    try:
        with on_interrupt():
            folder = out or Path("aircraft") / name
            adoption = adopt_model(model, folder, V_a=V_a, h=h, say=_progress, **choices)
            page = write_adoption(adoption) if adoption.folder else None
    except KeyboardInterrupt:
        fail("interrupted; what is written is whole", INTERRUPTED)
    answer = adoption.answer()
    return replace(answer, files={**answer.files, "page": page})


def _progress(line: str) -> None:
    if not quiet():
        tell(line)
