"""Commands made of the verbs of the package.

``cli/verbs.py`` reads the parameters of a verb and their sentences; ``commands.toml`` adds what a
signature cannot state.
"""

import os
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin

import typer

from flighttune.base.errors import InputError
from flighttune.base.files.shipped import aircraft_names, campaign_files, scenario_files
from flighttune.base.units import DEG
from flighttune.campaigns.engine.fliers import FlownBy
from flighttune.cli.show import campaign_display, emit, progress_bar, working
from flighttune.cli.verbs import Argument, arguments_of
from flighttune.outputs.answers.answer import Answer

# Texts of all commands by their heading in the help, and of shared options.
COMMANDS = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
ALIKE, FORMER = COMMANDS.pop("alike"), COMMANDS.pop("former")

# `--workers` and `--scheduler`, which every command takes.
WORKERS: ContextVar[FlownBy] = ContextVar("workers")

# `--run-code` of a command that flies the content of a file written by flighttune.
RUN_CODE: ContextVar[bool] = ContextVar("run_code", default=False)

# The command's verb, bound to the options that the user gave.
Verb: TypeAlias = partial[Any]


def this_command() -> str:
    """The command as the user typed it."""
    return shlex.join(["flighttune", *sys.argv[1:]])


def kept_flights(source: str, done: str) -> Path:
    """The file that keeps the flights of a command while they are flown."""
    return Path("runs") / f"{Path(source.partition('@')[0]).stem}-{done}-unfinished.jsonl"


def changes(settings: list[str]) -> dict[str, Any]:
    """The values of ``--set`` by key, read as TOML; a word that is not TOML is a string."""
    from flighttune.base.files.table import shown, toml_value

    values = {}
    for setting in settings:
        key, sign, text = map(str.strip, setting.partition("="))
        if not (key and sign and text) or "\n" in setting:
            raise InputError(f"--set: must be KEY=VALUE in one line, got {setting!r}.")
        values[key] = toml_value(text, f"--set: `{shown(key)}`")
    return values


def gain_set_names() -> list[str]:
    """Names of gain sets for a shell: those that any scenario knows, then those of the scenario."""
    from flighttune.control.gains import PAPER_EPSILON
    from flighttune.control.gains_keys import TUNED, TUNED_FOR_AIRCRAFT

    # The parser gives nothing of a line that ends in an option without its value.
    typed = os.environ.get("_TYPER_COMPLETE_ARGS") or os.environ.get("COMP_WORDS", "")
    shipped = scenario_files()
    files = [shipped.get(word, Path(word)) for word in typed.split()]
    names: list[str] = []
    for file in files:
        if file.suffix == ".toml":
            with suppress(OSError, ValueError):  # a shell completes other names all the same
                sets = tomllib.loads(file.read_text(encoding="utf-8")).get("gains", [])
                names += [x.get("name", "") if isinstance(x, dict) else str(x) for x in sets]
    known = "paper", *PAPER_EPSILON, TUNED, *TUNED_FOR_AIRCRAFT
    return [*dict.fromkeys([*known, *filter(None, names)])]


# Functions that read the words of an option, and functions that list shell completions.
READ: dict[str, Callable[[list[str]], Any]] = {
    "changes": changes,
    "numbers": lambda words: {name: float(x) for name, _, x in (w.partition("=") for w in words)},
    "spans": lambda words: [(float(a), float(b)) for a, b in (w.split(":") for w in words)],
}
COMPLETE: dict[str, Callable[[], Any]] = {
    "aircraft": aircraft_names,
    "campaigns": campaign_files,
    "scenarios": scenario_files,
    "flights": lambda: [*campaign_files(), *scenario_files()],
    "gains": gain_set_names,
}

# Endings of the files that commands write.
OF_FILES = ".csv", ".html", ".json", ".npz", ".parquet", ".rrd", ".svg", ".toml"

# Parameters that the command line supplies.
SUPPLIED = {"progress": progress_bar, "observer": campaign_display}

# Options of every command, which the help of the group lists.
OF_ALL = {"as_json": bool, "quiet": bool}


@dataclass(frozen=True, kw_only=True)
class Option:
    """An option or argument of a command; ``commands.toml`` tells what each key means."""

    name: str
    argument: Argument  # parameter of the verb; empty for an option of the command alone
    own: Any = None  # its type, for an option of the command alone
    help: str = ""
    sentence: str = ""
    metavar: str | None = None
    flags: Sequence[str] = ()
    min: int | None = None
    max: int | None = None
    hidden: bool = False
    choices: Sequence[str] = ()
    complete: str = ""
    read: str = ""
    ending: Sequence[str] = ()
    folder: bool = False
    default: str = ""

    @property
    def flag(self) -> str:
        """Its first flag on the command line."""
        return [*self.flags, f"--{self.name.replace('_', '-')}"][0]

    @cached_property
    def kind(self) -> Any:
        """Type of its value on the command line; None if it has no form there."""
        if self.read:
            return list[str]
        if self.choices:
            return Literal[tuple(self.choices)]
        return self.own or self.argument.kind

    @property
    def value(self) -> Any:
        """Value of an option that is not given."""
        if self.kind is bool:
            return bool(self.argument.default)
        return None if self.own else self.argument.default

    def parameter(self, *, positional: bool, flags: Mapping[str, str]) -> Parameter:
        """Typer's parameter for the option; `flags`: flags that its help may name."""
        kind, value = self.kind, self.value
        kept = {key: getattr(self, key) for key in ("metavar", "min", "max")}
        more = {key: x for key, x in kept.items() if x is not None}
        if self.hidden or self.name in OF_ALL:
            more["hidden"] = True
        if self.complete:
            more["autocompletion"] = COMPLETE[self.complete]
        if self.argument.unit == "rad":
            more["callback"] = _radians
        if positional:
            made = partial(typer.Argument)
            optional = kind == list[str] or type(None) in get_args(kind)
            value = value or (None if optional else Parameter.empty)
            more["show_default"] = False  # its help says so
        else:
            made = partial(typer.Option, *(self.flags or [self.flag]))
        text = self._help(flags, repeatable=get_origin(kind) is list and not positional)
        annotation = Annotated[kind | None if value is None else kind, made(help=text, **more)]
        return Parameter(self.name, Parameter.KEYWORD_ONLY, default=value, annotation=annotation)

    def _help(self, flags: Mapping[str, str], *, repeatable: bool) -> str:
        """The help text of the option, with its unit, endings and default."""
        if self.help:
            default = f" [default: {self.default}]" if self.default else ""
            return _in_first_sentence(self.help.format(*self.ending), default)
        text = re.sub(r"`(\w+)`", lambda x: flags.get(x[1], x[0]), self.argument.text or ".")
        text = " ".join(text.replace("``", "").split())
        text = re.sub(r"[,;] by default (.+?)(?=\.( |$))", r" [default: \1]", text)
        unit = {"": "", "rad": ", deg"}.get(self.argument.unit, f", {self.argument.unit}")
        return _in_first_sentence(text, unit + "; repeatable" * repeatable, self.sentence)

    def words(self, words: list[str]) -> Any:
        """The value of an option from its words."""
        try:
            return READ[self.read](words)
        except InputError:
            raise
        except ValueError:
            got = ", ".join(words)[:80]
            raise InputError(f"{self.flag} must be {self.metavar}, got {got!r}.") from None

    def file(self, file: Path | None, source: Any) -> Path | None:
        """The file or folder to write, its ending checked, or the default for a source."""
        if file and self.folder and file.suffix in OF_FILES and not file.is_dir():
            raise InputError(f"{file}: {self.flag} must be a folder, got the name of a file.")
        check_ending(file, *self.ending, option=self.flag)
        if file or not self.default:
            return file
        whole_log = re.sub(r"@[\d.:]*$", "", Path(str(source)).name)  # without the selected part
        return Path(self.default.replace("NAME", Path(whole_log).stem))


def _in_first_sentence(text: str, more: str, sentence: str = "") -> str:
    """The text with `more` at the end of its first sentence, or of `sentence` instead."""
    first, bracket, others = re.split(r"( \[default: |\.(?= |$))", text, maxsplit=1)
    return f"{sentence or first}{more}{bracket}{others}"


def _radians(value: Any) -> Any:
    """Radians of one or several angles that the command line states in degrees."""
    return [x * DEG for x in value] if isinstance(value, list) else value and value * DEG


@contextmanager
def flown_by() -> Iterator[FlownBy]:
    """The keywords of a verb that flies many runs, with a display of its progress."""
    with campaign_display() as observer:
        yield {**WORKERS.get(), "observer": observer}


def check_ending(out: Path | None, *endings: str, option: str = "--out") -> None:
    """Refuse a file without one of the `endings` before any computation."""
    if out is not None and endings and out.suffix.lower() not in endings:
        raise InputError(f"{out}: {option} must end in {' or '.join(endings)}.")


class Command:
    """A command: a body that takes the verb of its `texts`, and then its options.

    Its options are the verb's options and the body's options with help in ``commands.toml``.
    """

    def __init__(self, body: Callable[..., Answer | None], texts: Mapping[str, Any]) -> None:
        self.body, self.place, self.doing = body, texts.get("verb", ""), texts["doing"]
        self.verb, own = arguments_of(self.place), signature(body).parameters
        # A command without a verb takes only the values of its options.
        self.own = {x.name: x.annotation for x in [*own.values()][bool(self.place) :]}
        self.source = next(iter([*self.verb, *self.own]), "")
        self.several = next((x.name for x in self.verb.values() if x.several), "")
        # The seed of draws is one of the changes.
        self.seeded = "seed" in self.verb and self.verb["seed"].default is None
        self.absent = {*SUPPLIED, "run_code", *texts.get("absent", ())}
        self.absent |= {"seed"} if self.seeded else set()
        spelled = ALIKE | {x: y for x, y in texts.items() if isinstance(y, dict)}
        self.known = {x.name: x for x in self._known(spelled)}
        self.options = {
            name: option
            for name, option in self.known.items()
            if option.kind is not None and name not in self.absent
        }

    def _known(self, spelled: Mapping[str, Any]) -> Iterator[Option]:
        """Parameters of verb and body; a help may also name parameters that are not options."""
        own = self.own | OF_ALL
        names = dict.fromkeys([*self.verb, *own])
        for name in sorted(names, key=lambda x: (x in OF_ALL, x == "changes")):
            keys = spelled.get(name, {})
            argument = self.verb.get(name, Argument(name=name))
            only_here = own[name] if name in own and "help" in keys else None
            yield Option(name=name, argument=argument, own=only_here, **keys)

    def function(self) -> Callable[..., None]:
        """The function whose parameters become Typer's options."""

        def run(*, quiet: bool, as_json: bool = False, **values: Any) -> None:
            self.run(values, quiet=quiet, as_json=as_json)

        flags = {x: option.flag for x, option in self.known.items()}
        made = [
            option.parameter(positional=name in (self.source, self.several), flags=flags)
            for name, option in self.options.items()
        ]
        run.__signature__ = Signature(made)  # type: ignore[attr-defined]
        run.__annotations__ = {x.name: x.annotation for x in made}
        run.__doc__ = self.body.__doc__
        return run

    def run(self, values: dict[str, Any], *, quiet: bool, as_json: bool) -> None:
        """Run the command with the values of its options, and print its answer."""
        with working(self.doing, quiet=quiet, as_json=as_json):
            if RUN_CODE.get() and "run_code" not in self.verb:
                others = "verify, band, mission, monitor and worst"
                raise InputError(f"--run-code must be given with {others} alone.")
            source = values.get(self.source, "")
            values = self._read(values, source)
            verb = [self._called(values, source)] if self.place else []
            answer = self.body(*verb, **{x: values[x] for x in self.own})
            if answer is not None:
                emit(answer, source)

    def _read(self, given: Mapping[str, Any], source: Any) -> dict[str, Any]:
        """Values of the options, with words read and output files checked and named."""
        values = dict(given)
        for name, option in self.options.items():
            if option.read:
                values[name] = option.words(values[name] or [])
        if self.seeded and (seed := values["changes"].pop("seed", None)) is not None:
            if type(seed) is not int or seed < 0:
                raise InputError(f"--set: `seed` must be an integer from 0 on, got {seed!r}.")
            values["seed"] = seed
        for name, option in self.options.items():
            if option.own in (Path, Path | None) and name != self.source:
                values[name] = option.file(values[name], source)
        return values

    def _called(self, values: Mapping[str, Any], source: Any) -> Verb:
        """The verb, bound to the options that differ from their defaults."""
        defaults = {x: option.value for x, option in self.options.items()}
        others = self.source, self.several
        given = {
            x: values[x]
            for x in self.verb
            if x in values and x not in others and values[x] not in (None, [], {}, defaults.get(x))
        }
        several = values.get(self.several) or ()
        return partial(_called, self.place, [*self.verb], source, *several, **given)


def command(body: Callable[..., Answer | None], texts: Mapping[str, Any]) -> Callable[..., None]:
    """The function of a command for Typer."""
    return Command(body, texts).function()


def _called(place: str, names: list[str], source: Any, /, *values: Any, **keywords: Any) -> Any:
    """Import a verb and call it with the workers of the command line, its progress shown."""
    module, _, name = place.partition(":")
    keywords |= {"run_code": True} if RUN_CODE.get() else {}
    with ExitStack() as stack:
        if {*names} >= FlownBy.__annotations__.keys():
            keywords |= stack.enter_context(flown_by())
        for supplied in SUPPLIED.keys() & {*names} - keywords.keys():
            keywords[supplied] = stack.enter_context(SUPPLIED[supplied]())
        verb = getattr(import_module(f"flighttune.{module}"), name)
        return verb(keywords.pop(names[0], source), *values, **keywords)
