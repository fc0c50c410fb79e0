"""The commands, and their ends by errors."""

import io
import re
import shlex
import sys
from contextvars import copy_context
from importlib.metadata import version
from itertools import islice
from types import MethodType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from flighttune.base.errors import (
    FlightTuneError,
    InfeasibleError,
    InputError,
    broken_library,
    missing_extra,
    said_in_one_line,
)
from flighttune.base.files.code import BY_JSBSIM
from flighttune.base.files.whole import reason_of
from flighttune.cli.aircraft import adopt, design, identify, trim
from flighttune.cli.explain import band, compare, gap, gradient, monitor, tube, worst
from flighttune.cli.flights import campaign, fly, list_shipped, mission, new, open_page, view
from flighttune.cli.gains import certify, meet, tune, verify
from flighttune.cli.options import ALIKE, COMMANDS, FORMER, OF_ALL, RUN_CODE, WORKERS, command
from flighttune.cli.pages import export, report, reproduce
from flighttune.cli.show import COULD_NOT_RUN, INTERRUPTED, NO, cleaning_up, clear, fail, output

# Options of the group that may also stand behind a command, with a value and without one.
WITH_VALUE, FLAGS = ("--workers", "--scheduler"), ("--run-code", "--jsbsim")

# What Pydantic says of the value of an option, and what we do.
OF_PYDANTIC = {
    "Value error, ": "",
    r"Input should be greater than or equal to (\S+)": r"it must be at least \1",
    r"Input should be less than or equal to (\S+)": r"it must be at most \1",
    "Input should be a valid integer.*": "it must be an integer",
    "Input should be a valid number.*": "it must be a number",
}

# Options that stand in the help of the group, not of each command.
FOR_ALL = [ALIKE[name] for name in OF_ALL]

# Maximum length of the first sentence of a command's help, characters.
LONGEST_SENTENCE = 200


class Grouped(TyperGroup):
    """A group of commands whose help lists them under headings, in order of definition."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options of the group, some of which may stand anywhere."""
        first, others, words = [], [], iter(args)
        for word in words:
            if word.partition("=")[0] in WITH_VALUE + FLAGS:
                alone = "=" in word or word in FLAGS
                first += [word] if alone else [word, *islice(words, 1)]
            else:
                others.append(word)
        return super().parse_args(ctx, first + others)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; refuse an earlier version's command or option with its replacement."""
        name, *words = args
        sources = [word for word in words if not word.startswith("-")]
        source = next(iter(sources[args[:2] == ["campaign", "run"] :]), "FILE")
        for old in (name, *(f"{name} {word.partition('=')[0]}" for word in words)):
            if new := FORMER.get(old):
                new = new.replace("FILE", shlex.quote(source))
                raise InputError(f"`flighttune {old}` is `flighttune {new}` now.")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002
        """Write the commands, each group of them under its heading."""
        for panel, names in COMMANDS.items():
            helps = [self.commands[x].get_short_help_str(LONGEST_SENTENCE) for x in names]
            with formatter.section(panel):
                formatter.write_dl([*zip(names, helps, strict=True)])
        with formatter.section("Options of every command"):
            formatter.write_dl([(", ".join(x["flags"]), x["help"]) for x in FOR_ALL])


app = typer.Typer(
    name="flighttune",
    cls=Grouped,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"max_content_width": 100, "help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,  # Rich would read "[default: ...]" in a help text as markup and drop it
    help="Tune a fixed-wing outer loop with a certificate, fly it on the kinematic law and on "
    "JSBSim, and compare both in one recording.",
    epilog="Begin with: flighttune new my_turn, then flighttune fly my_turn.toml. Exit status: 0 "
    "fine, 1 the answer is no, 2 could not run.",
)
NAMED_AS_FUNCTION = (
    *(adopt, band, campaign, certify, compare, design, export, fly, gap, gradient, identify),
    *(meet, mission, monitor, new, report, reproduce, trim, tube, tune, verify, view, worst),
)
BODIES = {
    "list": list_shipped,
    "open": open_page,
    **{body.__name__: body for body in NAMED_AS_FUNCTION},
}

for panel, commands in COMMANDS.items():
    for name, texts in commands.items():
        epilog = f"Example: flighttune {texts['example']}"
        app.command(name, rich_help_panel=panel, epilog=epilog)(command(BODIES[name], texts))


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"flighttune {version('flighttune')}")
        raise typer.Exit


@app.callback()
def _options(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_show_version, help="Show the version and exit."
        ),
    ] = False,
    _debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes that fly on this machine, stated before or after any command that "
            "flies many [default: one per core].",
            min=1,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Fly on the workers of a dask scheduler, tcp://HOST:PORT."
        ),
    ] = None,
    run_code: Annotated[
        bool,
        typer.Option(
            "--run-code",
            help="Run Python files that a recording, the folder of a campaign or a claim names, "
            "with the commands that fly again what is in one: verify, band, mission, monitor, "
            "worst.",
        ),
    ] = False,
    jsbsim: Annotated[
        bool,
        typer.Option(
            "--jsbsim",
            help="Let JSBSim itself fly what would be flown compiled, to the same numbers, with "
            "any command.",
        ),
    ] = False,
) -> None:
    """Options of every command."""
    RUN_CODE.set(run_code)
    BY_JSBSIM.set(jsbsim)
    WORKERS.set({"workers": workers, "scheduler": scheduler})


def main() -> None:
    """Run the command line; errors become one line on stderr and exit status 2."""
    try:
        with cleaning_up():
            copy_context().run(_run)
    except KeyboardInterrupt:  # also while an error is printed
        sys.exit(INTERRUPTED)


def _run() -> None:
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:  # closed by the caller
            setattr(sys, name, io.StringIO())
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # an encoding may lack Greek letters
    try:
        with said_in_one_line():
            sys.exit(app(prog_name="flighttune", standalone_mode=False))
    except Exception as error:
        if isinstance(show := getattr(error, "show", None), MethodType):  # Typer's usage errors
            message = str(getattr(error, "format_message", str)()).rstrip(".?")
            if "\n" in message:  # the help, if a group has no command
                show()
                sys.exit(COULD_NOT_RUN)
            command = " ".join(["flighttune", *sys.argv[1:2]])
            path = getattr(getattr(error, "ctx", None), "command_path", command)
            for words, ours in OF_PYDANTIC.items():
                message = re.sub(words, ours, message)
            fail(f"{message}; `{path} --help` lists what there is.", COULD_NOT_RUN)
        if "--debug" in sys.argv:
            raise
        fail(_reason(error), NO if isinstance(error, InfeasibleError) else COULD_NOT_RUN)
    finally:
        with output():
            clear()  # also write the buffered output of help and completion


def _reason(error: Exception) -> str:
    if isinstance(error, FlightTuneError):
        return str(error)
    if isinstance(error, ImportError) and (message := missing_extra(error, "this command")):
        return message
    if isinstance(error, ImportError):
        return broken_library(error)
    if isinstance(error, MemoryError):
        got = next(iter(str(error).splitlines()), "no memory")
        return f"libraries and data must fit into the memory there is, got: {got}."
    if isinstance(error, OSError) and error.filename:
        from flighttune.base.files.table import shown

        return f"{shown(str(error.filename))}: {reason_of(error)}."
    what = f"{type(error).__name__}: {error}"
    return f"a fault of flighttune: {what} (its traceback: flighttune --debug ...)"
