"""The commands, and what becomes of errors."""

import sys
from typing import Annotated

import typer

from flighttune import __version__
from flighttune.cli.aircraft import design, identify, trim
from flighttune.cli.campaign import campaign
from flighttune.cli.certificates import certify, verify
from flighttune.cli.compare import compare
from flighttune.cli.conform import conform
from flighttune.cli.flights import fly, list_shipped, refly, view
from flighttune.cli.gains import frontier, tune
from flighttune.cli.gap import gap
from flighttune.cli.report import report, reproduce
from flighttune.cli.show import COULD_NOT_RUN, fail
from flighttune.cli.streams import StandardStreams
from flighttune.cli.tube import tube
from flighttune.cli.worst import worst
from flighttune.errors import FlightTuneError

app = typer.Typer(
    name="flighttune",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"max_content_width": 100, "help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,  # Rich would take "[default: ...]" in a help text for markup and drop it
    help="Tune a fixed-wing outer loop with a certificate, fly it on the kinematic law and on "
    "JSBSim, and compare both in one recording.",
    epilog="Exit status: 0 fine, 1 the answer is no, 2 could not run.",
)
ON_SCENARIOS = fly, tune, certify, verify, frontier, gap, tube, worst
ON_AIRCRAFT = trim, design, identify, conform
ON_RUNS = compare, report, refly, view
for command in (*ON_SCENARIOS, *ON_AIRCRAFT, *ON_RUNS, reproduce):
    app.command()(command)
app.command("list")(list_shipped)
app.add_typer(campaign)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"flighttune {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Show the version and leave."
        ),
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")] = False,
) -> None:
    """Options of every command."""


def main() -> None:
    """Run the command line; errors become one line on stderr and exit status 2."""
    streams = StandardStreams()
    try:
        _run()
    finally:
        if why := streams.failure():
            fail(f"standard output must be writable, got {why}.", COULD_NOT_RUN)


def _run() -> None:
    try:
        app()
    except FlightTuneError as error:
        if "--debug" in sys.argv:
            raise
        fail(str(error), COULD_NOT_RUN)
    except Exception as error:
        if "--debug" in sys.argv:
            raise
        what = f"{type(error).__name__}: {error}"
        fail(
            f"a fault of flighttune: {what} (its traceback: flighttune --debug ...)", COULD_NOT_RUN
        )
