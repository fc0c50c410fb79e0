"""Commands about an aircraft: adopt one, trim it, design and identify its inner loop."""

import os
from dataclasses import replace
from pathlib import Path

from flighttune.base.errors import InputError
from flighttune.base.files.shipped import is_shipped
from flighttune.base.files.whole import together
from flighttune.cli.options import Verb
from flighttune.cli.show import INTERRUPTED, fail, on_interrupt, quiet, tell
from flighttune.outputs.answers.answer import Answer


def trim(trim_aircraft: Verb, verbose: bool) -> Answer:
    """Trim AIRCRAFT over its envelope; where no trim exists, say why."""
    return trim_aircraft().answer(every_condition=verbose)


def design(design_aircraft: Verb, aircraft: str, out: Path | None, dry_run: bool) -> Answer:
    """Design the gains of AIRCRAFT's inner loop, check its step responses and write the gains."""
    from flighttune.vehicles.aircraft.aircraft import load_aircraft

    folder = load_aircraft(aircraft).folder
    if out is None and is_shipped(folder) and not dry_run:
        raise InputError(f"{aircraft}: --out must be given for an aircraft that is shipped.")
    designed = design_aircraft()
    if dry_run or designed.missed:
        return replace(designed.answer(), files={"written": None, "figure": None})
    return replace(designed.answer(), files=designed.save(out or folder))


def identify(identify_source: Verb, out: Path | None) -> Answer:
    """Identify how AIRCRAFT follows its commands in flight; write a model to tune on.

    Logs are of real flights: their stretches with enough command are fitted. Exit status 1 if
    they cannot tell a channel; then nothing is written.
    """
    identified = identify_source()
    return replace(identified.answer(), files=identified.save(out))


def adopt(
    adopt_model: Verb,
    model: str,
    out: Path | None,
    aileron: list[str] | None,
    elevator: list[str] | None,
    rudder: list[str] | None,
    no_rudder: bool,
) -> Answer:
    """Make an aircraft from a JSBSim model: find its surfaces and engines, tune it and fly it.

    Surfaces, engines and airspeed are found by experiment; the inner loop is designed, flown and
    identified, the outer loop is tuned on the identified model and flown in a turn, compared with
    the paper's gains scaled with airspeed.
    """
    from flighttune.outputs.pages.adoption import write_adoption

    folder = out or Path("aircraft") / Path(os.path.abspath(model)).stem.removesuffix("-set")
    named = {"aileron": aileron, "elevator": elevator, "rudder": rudder}
    commands = {surface: names for surface, names in named.items() if names}
    try:
        with on_interrupt(), together(folder):
            adoption = adopt_model(folder, commands=commands, rudder=not no_rudder, say=_progress)
            page = write_adoption(adoption) if adoption.folder else None
    except KeyboardInterrupt:
        fail("interrupted; what is written is whole", INTERRUPTED)
    answer = adoption.answer()
    return replace(answer, files={**answer.files, "page": page})


def _progress(line: str) -> None:
    if not quiet():
        tell(line)
