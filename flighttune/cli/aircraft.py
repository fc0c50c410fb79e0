"""Commands about an aircraft: adopt one, trim it, design and identify its inner loop."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flighttune.cli.options import Verb, of
from flighttune.cli.show import INTERRUPTED, fail, on_interrupt, quiet, tell
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, is_shipped
from flighttune.present.answer import Answer


@of("plants.jsbsim.trims:trim")
def trim(
    trim_aircraft: Verb,
    verbose: Annotated[
        bool, Option("--verbose", "-v", help="Print every condition, with angles and surfaces.")
    ] = False,
) -> Answer:
    """Trim AIRCRAFT over its envelope; where no trim exists, say why."""
    return trim_aircraft().answer(every_condition=verbose)


@of(
    "identification.design:design",
    out="Folder to write to [default: the aircraft's own; required for a shipped one].",
)
def design(
    design_aircraft: Verb,
    aircraft: str,
    out: Path | None,
    dry_run: Annotated[
        bool, Option("--dry-run", help="Print the gains; write no file and no figure.")
    ] = False,
) -> Answer:
    """Design the gains of AIRCRAFT's inner loop, check its step responses and write the gains."""
    from flighttune.aircraft.aircraft import load_aircraft

    folder = load_aircraft(aircraft).folder
    if out is None and is_shipped(folder) and not dry_run:
        raise InputError(f"{aircraft}: --out must be given for an aircraft that is shipped.")
    designed = design_aircraft()
    if dry_run or designed.missed:
        return replace(designed.answer(), files={"written": None, "figure": None})
    return replace(designed.answer(), files=designed.save(out or folder))


@of(
    "logs.identify:identify",
    source={"metavar": "AIRCRAFT|LOG", "autocompletion": aircraft_names},
    out="Model file (.json) to write, with a figure of the same name [default: identified.json in "
    "the aircraft's folder; for a shipped one or a log runs/identified/NAME.json].",
)
def identify(
    identify_source: Verb,
    out: Path | None,
    logs: Annotated[
        list[str] | None, Argument(metavar="[LOG...]", help="Further logs of the same aircraft.")
    ] = None,
) -> Answer:
    """Identify how AIRCRAFT follows its commands in flight; write a model to tune on.

    Logs are of real flights: their stretches with enough command are fitted. Exit status 1 if
    they cannot tell a channel; then nothing is written.
    """
    identified = identify_source(*(logs or ()))
    return replace(identified.answer(), files=identified.save(out))


def command_of(surface: str) -> Any:
    """The option that names what takes the command of a surface."""
    return Option(
        f"--{surface}",
        metavar="PROPERTY",
        help=f"Property that takes the command of the {surface}, with a minus its negative; "
        "repeatable [default: found by what it moves].",
    )


@of(
    "adoption.adopt:adopt",
    model={"metavar": "MODEL|FILE.xml|FOLDER"},
    folder=None,
    rudder=None,
    commands=None,
    out="Folder to write to [default: aircraft/MODEL].",
)
def adopt(
    adopt_model: Verb,
    model: str,
    out: Path | None,
    aileron: Annotated[list[str] | None, command_of("aileron")] = None,
    elevator: Annotated[list[str] | None, command_of("elevator")] = None,
    rudder_by: Annotated[list[str] | None, command_of("rudder")] = None,
    no_rudder: Annotated[
        bool, Option("--no-rudder", help="Leave yaw to the airframe, without a rudder.")
    ] = False,
) -> Answer:
    """Make an aircraft from a JSBSim model: find its surfaces and engines, tune it and fly it.

    Surfaces, engines and airspeed are found by experiment; the inner loop is designed, flown and
    identified, the outer loop is tuned on the identified model and flown in a turn, compared with
    the paper's gains scaled with airspeed.
    """
    from flighttune.adoption.page import write_adoption

    name = Path(os.path.abspath(model)).stem.removesuffix("-set")
    asked = {"aileron": aileron, "elevator": elevator, "rudder": rudder_by}
    commands = {surface: names for surface, names in asked.items() if names}
    try:
        with on_interrupt():
            folder = out or Path("aircraft") / name
            adoption = adopt_model(folder, commands=commands, rudder=not no_rudder, say=_progress)
            page = write_adoption(adoption) if adoption.folder else None
    except KeyboardInterrupt:
        fail("interrupted; what is written is whole", INTERRUPTED)
    answer = adoption.answer()
    return replace(answer, files={**answer.files, "page": page})


def _progress(line: str) -> None:
    if not quiet():
        tell(line)
