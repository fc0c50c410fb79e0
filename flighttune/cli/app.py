"""The commands, and how errors end them."""

import io
import os
import sys
from typing import Annotated, Any

import typer

from flighttune import __version__
from flighttune.cli.adopt import adopt
from flighttune.cli.aircraft import design, identify, trim
from flighttune.cli.campaign import campaign
from flighttune.cli.certificates import certify, verify
from flighttune.cli.command import Grouped, add_command
from flighttune.cli.compare import compare
from flighttune.cli.conform import conform
from flighttune.cli.export import export
from flighttune.cli.flights import fly, list_shipped, refly, view
from flighttune.cli.gains import frontier, tune
from flighttune.cli.gap import gap
from flighttune.cli.report import report, reproduce
from flighttune.cli.show import COULD_NOT_RUN, fail
from flighttune.cli.tube import tube
from flighttune.cli.worst import worst
from flighttune.errors import FlightTuneError
from flighttune.extras import missing_extra
from flighttune.whole_file import reason_of

app = typer.Typer(
    name="flighttune",
    cls=Grouped,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"max_content_width": 100, "help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,  # Rich would take "[default: ...]" in a help text for markup and drop it
    help="Tune a fixed-wing outer loop with a certificate, fly it on the kinematic law and on "
    "JSBSim, and compare both in one recording.",
    epilog="Begin with: flighttune fly paper. Exit status: 0 fine, 1 the answer is no, 2 could not "
    "run.",
)
COMMANDS = {
    "Tune": [
        (tune, "tuning", "flighttune tune paper --out gains.json"),
        (frontier, "tuning", "flighttune frontier paper"),
        (certify, "certifying", "flighttune certify paper --gains tuned --out certificate.json"),
        (verify, "verifying", "flighttune verify certificate.json"),
        (trim, "trimming", "flighttune trim aerosonde --V-a 25 --gamma 0"),
        (design, "designing", "flighttune design aerosonde --dry-run"),
        (adopt, "adopting", "flighttune adopt 737"),
        (identify, "identifying", "flighttune identify aerosonde --V-a 25"),
    ],
    "Fly": [
        (fly, "flying", "flighttune fly paper"),
        (refly, "flying", "flighttune refly runs/paper"),
        (view, "opening", "flighttune view runs/paper"),
        (list_shipped, "listing", "flighttune list"),
    ],
    "Explain": [
        (gap, "flying", "flighttune gap paper"),
        (compare, "comparing", "flighttune compare paper@paper paper@tuned"),
        (worst, "searching", "flighttune worst first_campaign --budget 40"),
        (tube, "enclosing", "flighttune tube paper --gains paper"),
        (conform, "learning", "flighttune conform aerosonde --out conformance.json"),
    ],
    "Publish": [
        (report, "reporting", "flighttune report runs/paper"),
        (reproduce, "reproducing", "flighttune reproduce gains"),
        (export, "exporting", "flighttune export paper --gains paper"),
    ],
}
"""Commands by their heading in the help: function, status on a terminal, and an example."""

for panel, commands in COMMANDS.items():
    for command, doing, example in commands:
        add_command(
            app,
            command,
            doing=doing,
            example=example,
            name="list" if command is list_shipped else None,
            panel=panel,
            answers=command is not view,
        )
    if panel == "Fly":
        app.add_typer(campaign, rich_help_panel=panel)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"flighttune {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Show the version and exit."
        ),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Options of every command."""


def main() -> None:
    """Run the command line; errors become one line on stderr and exit status 2."""
    sys.stdout, sys.stderr = map(_writable, ("stdout", "stderr"))
    try:
        _run()
    finally:
        _flush()


class _Descriptor(io.FileIO):
    """A descriptor for which it is no failure that nobody reads it any more."""

    def write(self, data: Any, /) -> int | None:
        try:
            return super().write(data)
        except BrokenPipeError:
            return len(data)


def _writable(name: str) -> Any:
    """A standard stream that takes all characters; a closed one discards them."""
    stream = getattr(sys, name)
    if stream is None:
        return open(os.devnull, "w")
    if not isinstance(stream, io.TextIOWrapper):
        return stream  # of a test or a notebook
    stream.reconfigure(errors="replace")  # an encoding may lack Greek letters
    if stream is not getattr(sys, f"__{name}__"):
        return stream
    return io.TextIOWrapper(
        io.BufferedWriter(_Descriptor(stream.fileno(), "wb", closefd=False)),
        encoding=stream.encoding,
        errors="replace",
        line_buffering=stream.line_buffering or name == "stderr",
    )


def _flush() -> None:
    """Write what is left of standard output."""
    try:
        sys.stdout.flush()
    except OSError as error:
        # what is left cannot be written: Python would complain about it once more
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        fail(f"standard output must be writable, got {reason_of(error)}.", COULD_NOT_RUN)


def _run() -> None:
    try:
        app(prog_name="flighttune")
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        fail(_reason(error), COULD_NOT_RUN)


def _reason(error: Exception) -> str:
    if isinstance(error, FlightTuneError):
        return str(error)
    if isinstance(error, ImportError) and (message := missing_extra(error, "this command")):
        return message
    if isinstance(error, PermissionError) and error.filename:
        return f"{error.filename}: {reason_of(error)}."
    what = f"{type(error).__name__}: {error}"
    return f"a fault of flighttune: {what} (its traceback: flighttune --debug ...)"
