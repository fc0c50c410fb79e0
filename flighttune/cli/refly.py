"""The command that flies a recording again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import (
    NO,
    JsonOption,
    fail,
    print_json,
    print_table,
    progress_bar,
    say,
)
from flighttune.errors import RecordingError, ScenarioError

if TYPE_CHECKING:
    from flighttune.recording.load import Recording
    from flighttune.refly import Difference, Reflight


def refly(
    recording: Annotated[
        Path,
        typer.Argument(
            metavar="RECORDING",
            help="A recording, the folder of one, or a Parquet file of one run.",
        ),
    ],
    as_json: JsonOption = False,
) -> None:
    """Fly RECORDING again from the scenario and seed in it; are the bits the same?

    Exit status 1 if they are not; the first difference is shown.
    """
    from flighttune.recording.load import load_recording
    from flighttune.refly import refly as fly_again

    found = load_recording(recording)
    try:
        with progress_bar() as progress:
            flights = fly_again(found.runs, progress=progress)
    except (RecordingError, ScenarioError) as error:
        raise RecordingError(f"{recording}: {error}") from error
    different = [flight for flight in flights if flight.difference]
    if as_json:
        print_json(_json(found, flights))
    else:
        _print(recording, found, flights)
    if different:
        first = different[0]
        fail(f"{recording}: {first.recorded.label}: {_sentence(first.difference)}", NO)


def _json(found: "Recording", flights: tuple["Reflight", ...]) -> dict[str, Any]:
    return {
        "equal": not any(flight.difference for flight in flights),
        "missing": list(found.missing),
        "versions": {
            name: {"recorded": then, "now": now}
            for flight in flights
            for name, (then, now) in flight.versions.items()
        },
        "runs": [
            {
                "run": flight.recorded.label,
                "status": flight.recorded.status,
                "samples": len(flight.recorded.signals),
                "equal": flight.difference is None,
                "difference": flight.difference
                and {
                    "what": flight.difference.what,
                    "t_s": flight.difference.t,
                    "recorded": flight.difference.recorded,
                    "reflown": flight.difference.reflown,
                },
            }
            for flight in flights
        ],
    }


def _print(recording: Path, found: "Recording", flights: tuple["Reflight", ...]) -> None:
    rows = [
        (
            flight.recorded.label,
            flight.recorded.status,
            str(len(flight.recorded.signals)),
            _sentence(flight.difference),
        )
        for flight in flights
    ]
    print_table(f"{recording}, flown again", ("run", "status", "samples", "result"), rows)
    for line in found.missing:
        say(f"missing: {line}")
    changed = {name: pair for flight in flights for name, pair in flight.versions.items()}
    for name, (then, now) in changed.items():
        say(f"{name}: {then} then, {now} now")


def _sentence(difference: "Difference | None") -> str:
    if difference is None:
        return "equal to the bit"
    when = "" if difference.t is None else f" at t = {difference.t:g} s"
    values = [
        value if isinstance(value, str) else repr(value)
        for value in (difference.recorded, difference.reflown)
    ]
    return f"{difference.what} differs{when}: {values[0]} recorded, {values[1]} flown again"
