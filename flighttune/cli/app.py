"""The commands, and how errors end them."""

import inspect
import io
import shlex
import sys
from collections.abc import Callable
from functools import wraps
from itertools import islice
from types import MethodType
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from flighttune import __version__
from flighttune.cli import options
from flighttune.cli.aircraft import adopt, design, identify, trim
from flighttune.cli.band import band, mission, monitor, tube, worst
from flighttune.cli.flights import campaign, fly, list_shipped, new, view
from flighttune.cli.gains import certify, meet, tune, verify
from flighttune.cli.pages import compare, export, gap, report, reproduce
from flighttune.cli.show import COULD_NOT_RUN, INTERRUPTED, NO, emit, fail, output, working
from flighttune.errors import FlightTuneError, InfeasibleError, InputError, missing_extra
from flighttune.files.whole import reason_of
from flighttune.present.answer import Answer

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
QuietOption = Annotated[
    bool, typer.Option("--quiet", "-q", help="Print only failures, and the object of --json.")
]

# Commands and options of earlier versions, and what took their place.
FORMER = {
    "route": "mission FILE --plan",
    "campaign run": "campaign FILE",
    "refly": "verify FILE",
    "frontier": "tune FILE --frontier",
    "band --of": "tube SCENARIO --boxes FILE",
    "mission --skip": "mission FILE --set route.skip=true",
    "band --seed": "band FILE --set seed=N",
    **{
        f"band {option}": f"mission FILE {option}"
        for option in ("--aircraft", "--fence", "--like", "--page", "--turn-back")
    },
}

# Options of the group that may also stand behind a command.
ANYWHERE = ("--workers", "--scheduler")

# Characters of the first sentence of a command's help.
LONGEST_SENTENCE = 200


class Grouped(TyperGroup):
    """A group of commands whose help lists them under headings, in the order they were added."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the options of the group, wherever those that may stand anywhere do."""
        first, others, words = [], [], iter(args)
        for word in words:
            if word.partition("=")[0] in ANYWHERE:
                first += [word] if "=" in word else [word, *islice(words, 1)]
            else:
                others.append(word)
        return super().parse_args(ctx, first + others)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; one of an earlier version, or its option, is refused with the new."""
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
        panels: dict[str, list[tuple[str, str]]] = {}
        for name, command in self.commands.items():
            panel = getattr(command, "rich_help_panel", None)
            rows = panels.setdefault(panel if isinstance(panel, str) else "Commands", [])
            rows.append((name, command.get_short_help_str(LONGEST_SENTENCE)))
        for panel, rows in panels.items():
            with formatter.section(panel):
                formatter.write_dl(rows)


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
# Commands by their heading in the help: function, name, status on a terminal, and an example.
COMMANDS = {
    "Tune": [
        (tune, "tune", "tuning", "tune paper --out gains.json"),
        (meet, "meet", "searching", "meet paper_identified --budget 20"),
        (certify, "certify", "certifying", "certify paper --gains tuned --out certificate.json"),
        (verify, "verify", "verifying", "verify certificate.json"),
    ],
    "Fly": [
        (fly, "fly", "flying", "fly paper"),
        (mission, "mission", "counting", "mission circuit --plan"),
        (new, "new", "writing", "new my_turn --aircraft c172p"),
        (view, "view", "opening", "view runs/paper"),
        (list_shipped, "list", "listing", "list"),
        (campaign, "campaign", "planning", "campaign first_campaign"),
    ],
    "Explain": [
        (gap, "gap", "flying", "gap paper"),
        (compare, "compare", "comparing", "compare paper@paper paper@tuned"),
        (worst, "worst", "searching", "worst first_campaign --budget 40"),
        (tube, "tube", "enclosing", "tube paper --gains paper"),
        (band, "band", "counting", "band mission_in_wind --out mission.npz"),
        (monitor, "monitor", "counting", "monitor mission_in_wind --out monitor.npz"),
    ],
    "Aircraft": [
        (adopt, "adopt", "adopting", "adopt 737"),
        (trim, "trim", "trimming", "trim aerosonde --V-a 25 --gamma 0"),
        (design, "design", "designing", "design aerosonde --dry-run"),
        (identify, "identify", "identifying", "identify aerosonde --V-a 25"),
    ],
    "Publish": [
        (report, "report", "reporting", "report runs/paper"),
        (reproduce, "reproduce", "reproducing", "reproduce gains"),
        (export, "export", "exporting", "export paper --gains paper"),
    ],
}


def _add_command(
    function: Callable[..., Answer | None], name: str, doing: str, example: str, panel: str
) -> None:
    """Add a command, with --json and -q, that prints and exits as the answer of `function` says."""
    options = {} if function is view else {"as_json": JsonOption}
    options["quiet"] = QuietOption

    @wraps(function)
    def command(*args: Any, quiet: bool = False, as_json: bool = False, **kwargs: Any) -> None:
        with working(doing, quiet=quiet, as_json=as_json):
            answer = function(*args, **kwargs)
            if answer is not None:
                emit(answer, kwargs.get(next(iter(signature.parameters), "")))

    signature = inspect.signature(function)
    added = [
        inspect.Parameter(key, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=option)
        for key, option in options.items()
    ]
    command.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*signature.parameters.values(), *added]
    )
    command.__annotations__ = function.__annotations__ | options
    app.command(name, rich_help_panel=panel, epilog=f"Example: flighttune {example}")(command)


for panel, commands in COMMANDS.items():
    for function, name, doing, example in commands:
        _add_command(function, name, doing, example, panel)


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
    _debug: Annotated[
        bool, typer.Option("--debug", help="Show the traceback of an error.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes that fly on this machine, for any command that flies many, before or "
            "after it [default: one per core].",
            min=1,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Fly on the workers of a dask scheduler, tcp://HOST:PORT."
        ),
    ] = None,
) -> None:
    """Options of every command."""
    options.FLOWN_BY.set({"workers": workers, "scheduler": scheduler})


def main() -> None:
    """Run the command line; errors become one line on stderr and exit status 2."""
    try:
        _run()
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
        sys.exit(app(prog_name="flighttune", standalone_mode=False))
    except Exception as error:
        if isinstance(show := getattr(error, "show", None), MethodType):  # of Typer, about usage
            message = str(getattr(error, "format_message", str)()).rstrip(".?")
            if "\n" in message:  # the help, where a group was given no command
                show()
                sys.exit(COULD_NOT_RUN)
            command = " ".join(["flighttune", *sys.argv[1:2]])
            path = getattr(getattr(error, "ctx", None), "command_path", command)
            message = message.replace("Value error, ", "")
            fail(f"{message}; `{path} --help` lists what there is.", COULD_NOT_RUN)
        if "--debug" in sys.argv:
            raise
        fail(_reason(error), NO if isinstance(error, InfeasibleError) else COULD_NOT_RUN)
    finally:
        with output():
            pass  # what help and completion left in the buffer


def _reason(error: Exception) -> str:
    if isinstance(error, FlightTuneError):
        return str(error)
    if isinstance(error, ImportError) and (message := missing_extra(error, "this command")):
        return message
    if isinstance(error, PermissionError) and error.filename:
        return f"{error.filename}: {reason_of(error)}."
    what = f"{type(error).__name__}: {error}"
    return f"a fault of flighttune: {what} (its traceback: flighttune --debug ...)"
