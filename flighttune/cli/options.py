"""Options: most are read from the verbs of the package, signature and docstring; some are alike.

The text of a verb is read, not imported: a help starts without NumPy.
"""

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from contextvars import ContextVar
from functools import partial
from importlib import import_module
from inspect import Parameter, Signature, cleandoc, signature
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias, get_origin

from typer import Argument, Option

from flighttune import modules_of
from flighttune.cli.show import campaign_display, progress_bar
from flighttune.errors import InputError
from flighttune.files.shipped import aircraft_names, campaign_files, scenario_files
from flighttune.present.answer import Answer
from flighttune.units import DEG

# Workers of a command that flies: `--workers` and `--scheduler`, which all of them have.
FLOWN_BY: ContextVar[Mapping[str, Any]] = ContextVar(
    "flown_by", default=MappingProxyType({"workers": None, "scheduler": None})
)

# The argument of a command that takes a scenario alone.
SCENARIO = {
    "metavar": "SCENARIO",
    "help": "A scenario file, or the name of a shipped one.",
    "autocompletion": scenario_files,
}


GAINS = "Gain set (paper, K1..K6, tuned, a name from the scenario) or file of gains"
SETTING = "Value of the scenario to set, such as flight.V_a_mps=30"


def to_fly() -> list[str]:
    """Names of what ships and can be flown, for completion."""
    return [*campaign_files(), *scenario_files()]


def changes(settings: list[str] | None, option: str, form: str) -> dict[str, Any]:
    """The values of ``--set`` by key, read as TOML; a word that is not TOML is a string."""
    from flighttune.files.mistakes import shown
    from flighttune.files.table import toml_value

    values = {}
    for setting in settings or ():
        key, sign, text = map(str.strip, setting.partition("="))
        if not (key and sign and text) or "\n" in setting:
            raise InputError(f"{option}: must be {form} in one line, got {setting!r}.")
        values[key] = toml_value(text, f"{option}: `{shown(key)}`")
    return values


def seed_of(changed: dict[str, Any]) -> int | None:
    """The seed of the draws among values that are set, taken out of them."""
    seed = changed.pop("seed", None)
    if seed is not None and (type(seed) is not int or seed < 0):
        raise InputError(f"--set: `seed` must be an integer from 0 on, got {seed!r}.")
    return seed


def numbers(pairs: list[str] | None, option: str, form: str) -> dict[str, float]:
    """The numbers by name of an option of this form, such as NAME=VALUE."""
    values = {}
    for pair in pairs or ():
        name, _, text = pair.partition("=")
        try:
            values[name] = float(text)
        except ValueError:
            raise InputError(f"{option} must be {form}, got {pair[:80]!r}.") from None
    return values


def number(text: str | None, option: str) -> float | None:
    """The number that an option has beside words."""
    try:
        return None if text is None else float(text)
    except ValueError:
        raise InputError(f"{option}: must be a number, got {text!r}.") from None


def spans(texts: list[str] | None, option: str, form: str) -> list[tuple[float, float]] | None:
    """The ranges of an option of the form LOW:HIGH, if it was given."""
    try:
        ends = [(float(low), float(high)) for low, high in (x.split(":") for x in texts or ())]
    except ValueError:
        raise InputError(f"{option} must be {form}, got {', '.join(texts or ())[:80]!r}.") from None
    return ends or None


LAG = {
    "metavar": "LOW:HIGH",
    "help": "Smallest and largest lag of the inner loop, s; given twice: of roll and of lift.",
    "read": spans,
}

ColumnOption = Annotated[
    list[str] | None,
    Option(
        "--column",
        metavar="NAME=COLUMN[:UNIT]",
        help="Column of a log (TOPIC.FIELD of a binary one) with a signal, such as "
        "chi=heading:deg, or a TOML file of such pairs; repeatable.",
    ),
]


def check_ending(out: Path | None, *endings: str, option: str = "--out") -> None:
    """Refuse a file that does not end in one of `endings`, before anything is computed."""
    if out is not None and endings and out.suffix.lower() not in endings:
        raise InputError(f"{out}: {option} must end in {endings[0]}.")


ClaimOption = Annotated[
    list[Path] | None,
    Option(
        "--claim",
        metavar="FILE",
        help="File of a tube or band: draw its bounds around the runs that it covers; monitor: "
        "record its score and say when it alarms; repeatable.",
    ),
]


# The verb of a command: its `keywords` are the options that were given; it takes more.
Verb: TypeAlias = partial[Any]
Body: TypeAlias = Callable[..., Answer | None]

# Parameters that the command line supplies.
SUPPLIED = {"progress": progress_bar, "observer": campaign_display}

# Options that read the same in all commands.
SPELLED: dict[str, Any] = {"columns": ColumnOption, "claims": ClaimOption}

# What arguments and options have besides the text of the verb, in all commands; `read` makes values
# of words of the form `metavar`.
OF_CAMPAIGN = {"metavar": "CAMPAIGN", "autocompletion": campaign_files}
ALIKE: dict[str, dict[str, Any]] = {
    "scenario": SCENARIO,
    "aircraft": {"metavar": "AIRCRAFT", "autocompletion": aircraft_names},
    **dict.fromkeys(("campaign", "like"), OF_CAMPAIGN),
    **{name: {"min": 1} for name in ("budget", "flights", "learn", "runs")},
    "seed": {"min": 0},
    "changes": {"metavar": "KEY=VALUE", "read": changes},
    "assume": {"metavar": "CHANNEL=RAD_S", "read": numbers},
    "values": {"metavar": "NAME=VALUE", "read": numbers},
}

# Flags of parameters that Python names otherwise.
FLAGS = {
    "changes": "--set",
    "values": "--set",
    "predicted_from": "--given",
    "form": "--format",
    "signals": "--signal",
    "fences": "--fence",
    "autopilot": "--with",
}

# What the help of an option says before its default.
SENTENCES = {"changes": SETTING, "gains": GAINS, "plant": "Label of the plant as `fly` prints it"}

TYPES = {"str": str, "int": int, "float": float, "bool": bool, "Path": Path}
SEQUENCES, OF_PYTHON = {"Iterable", "Sequence"}, {"Callable", "Mapping"}


def of(place: str, **spelled: Mapping[str, Any] | str | None) -> Callable[[Body], Body]:
    """Make a command of a function: its options are those of a verb, ``module:name``, and its own.

    The function is called with the verb, and with its further parameters: an ``Annotated`` one is
    an option as it stands, another has the value of the option of the verb. `spelled` has what
    `typer.Option` needs besides the text of the verb; a parameter with None has no option, and one
    with a sentence is a file to write: the ending that the sentence has in brackets is checked, and
    its default below ``runs/`` is filled in. The seed of draws is one of the changes.
    """
    module, _, name = place.partition(":")

    def command_of(body: Body) -> Body:
        _, *stated = signature(body).parameters.values()
        files = {x: text for x, text in spelled.items() if isinstance(text, str)}
        own = {x: _file_option(x, text) for x, text in files.items()}
        for x in stated:
            if get_origin(x.annotation) is Annotated:
                own[x.name] = x.replace(kind=Parameter.KEYWORD_ONLY)
        verb = _definition(module, name)
        names = [x.arg for x in (*verb.args.args, *verb.args.kwonlyargs)]
        stated_in = dict(zip(names[::-1], reversed(verb.args.kw_defaults), strict=False))
        first, drawn = names[0], getattr(stated_in.get("seed"), "value", 0) is None
        absent = {*own, *SUPPLIED, *FLOWN_BY.get()} | ({"seed"} if drawn else set())
        absent |= {x for x in spelled if spelled[x] is None}
        more = ALIKE | {x: y for x, y in spelled.items() if isinstance(y, Mapping)}
        read = {x.name: x for x in _parameters(verb, absent, more)} | own
        ordered = sorted(read.values(), key=lambda x: (x.name != first, x.name == "changes"))
        defaults = {x: read[x].default for x in names[1:] if x in read}

        def command(**values: Any) -> Answer | None:
            for x in values.keys() & {x for x in names if "read" in more.get(x, ())}:
                values[x] = more[x]["read"](values[x], FLAGS.get(x, f"--{x}"), more[x]["metavar"])
            if drawn and (seed := seed_of(values["changes"])) is not None:
                values["seed"] = seed
            for x, text in files.items():
                values[x] = _file_to_write(x, text, values[x], values[first])
            stated_by_user = {
                x: values[x]
                for x in names[1:]
                if x in values and values[x] not in (None, [], {}, defaults.get(x))
            }
            call = partial(_called, (module, name, names, values[first]), **stated_by_user)
            return body(call, **{x.name: values[x.name] for x in stated})

        command.__signature__ = Signature(ordered)  # type: ignore[attr-defined]
        command.__annotations__ = {x.name: x.annotation for x in ordered}
        command.__doc__, command.__name__ = body.__doc__, body.__name__
        return command

    return command_of


def _file_option(name: str, text: str) -> Parameter:
    annotation = Annotated[Path | None, Option(f"--{name}", help=text)]
    return Parameter(name, Parameter.KEYWORD_ONLY, default=None, annotation=annotation)


def _file_to_write(name: str, text: str, file: Path | None, source: Any) -> Path | None:
    """A file, its ending checked, or its default: the help of its option says both."""
    check_ending(file, *re.findall(r"\((\.\w+)\)", text), option=f"--{name}")
    default = re.search(r"\[default: (runs/\S+)\]", text)
    return Path(default[1].replace("NAME", Path(source).stem)) if default and not file else file


def _called(verb: tuple[str, str, list[str], Any], *values: Any, **given: Any) -> Any:
    """Import a verb and call it, watched and flown as the command line says."""
    module, name, [first, *names], source = verb
    given |= {x: value for x, value in FLOWN_BY.get().items() if x in names}
    with ExitStack() as stack:
        for supplied in SUPPLIED.keys() & {*names} - given.keys():
            given[supplied] = stack.enter_context(SUPPLIED[supplied]())
        return getattr(import_module(f"flighttune.{module}"), name)(
            given.pop(first, source), *values, **given
        )


def _definition(module: str, name: str) -> ast.FunctionDef:
    """Signature and docstring of a verb, from the text of its module."""
    file = Path(__file__).parents[1].joinpath(*module.split(".")).with_suffix(".py")
    pattern = re.compile(rf'^def {name}\(.*?^    """.*?"""', re.DOTALL | re.MULTILINE)
    (text,) = pattern.findall(file.read_text(encoding="utf-8"))
    *_, verb = ast.parse(text).body  # after its overloads
    assert isinstance(verb, ast.FunctionDef)
    return verb


def _parameters(
    verb: ast.FunctionDef, absent: set[str], spelled: Mapping[str, Any]
) -> Iterator[Parameter]:
    """Parameters of a verb that have an option, or the argument."""
    entries = _entries(_docstring(verb))
    arguments = [*verb.args.args, *verb.args.kwonlyargs]
    stated = [*verb.args.defaults, *verb.args.kw_defaults]
    defaults = [None] * (len(arguments) - len(stated)) + stated
    for argument, default in zip(arguments, defaults, strict=True):
        name, (described, _) = argument.arg, entries.get(argument.arg, ("", ""))
        kind = _type(ast.unparse(argument.annotation or ast.Constant("")), described)
        more = {**spelled.get(name, {})}
        kind = list[str] if more.pop("read", None) else kind
        if name in absent or not (kind or name in SPELLED):
            continue
        value, made = getattr(default, "value", None), partial(Option, _flag(name, described))
        if argument is arguments[0]:
            value, made = Parameter.empty, Argument
        if (annotation := SPELLED.get(name)) is None:
            more = {"help": _help(name, kind, entries), **more}
            if re.search(r"float, rad\b(?!/)", described):
                more["callback"] = _radians
            annotation = Annotated[kind | None if value is None else kind, made(**more)]
        yield Parameter(name, Parameter.KEYWORD_ONLY, default=value, annotation=annotation)


def _entries(docstring: str) -> dict[str, tuple[str, str]]:
    """Type and text of each parameter in a NumPy docstring, or in that of the verb it names."""
    section = re.search(r"Parameters\n-+\n(.*?)(?=\n\n\w+\n-+\n|\Z)", docstring, re.DOTALL)
    entry = re.compile(r"^(\w[\w, ]*) : ([^\n]*)\n?((?:    .*\n?)*)", re.MULTILINE)
    entries = {}
    for names, described, text in entry.findall(section[1] if section else ""):
        own = dict.fromkeys(names.split(", "), (described, text))
        if other := re.fullmatch(r"as for `(\w+)`", described):
            module = modules_of("flighttune")[other[1]].removeprefix("flighttune.")
            shared = _entries(_docstring(_definition(module, other[1])))
            own = {name: shared[name] for name in own}
        entries |= own
    return entries


def _docstring(verb: ast.FunctionDef) -> str:
    return cleandoc(ast.get_docstring(verb) or "")


def _type(annotation: str, described: str) -> Any:
    """The type of an option; None of a parameter that has none on a command line."""
    if choices := re.search(r"\{(.+)\}", described):
        return Literal[ast.literal_eval(f"({choices[1]},)")]
    words = re.findall(r"\w+", annotation)
    types = [TYPES[word] for word in words if word in TYPES]
    if OF_PYTHON & {*words} or not types:
        return None
    return list[types[-1]] if SEQUENCES & {*words} else types[0]


def _help(name: str, kind: Any, entries: dict[str, tuple[str, str]]) -> str:
    """The sentences of a parameter as the help of an option, its default in brackets."""
    described, text = entries.get(name, ("", ""))
    text = re.sub(
        r"`(\w+)`", lambda x: _flag(x[1], entries[x[1]][0]) if x[1] in entries else x[0], text
    )
    text = " ".join(text.replace("``", "").split())
    text = re.sub(r"[,;] by default (.+?)(?=\.( |$))", r" [default: \1]", text)
    sentence, bracket, others = re.split(r"( \[default: |\.(?= |$))", text, maxsplit=1)
    unit = re.search(r"(?<!or )float, (?!1\b|optional)([^,]*)", described)
    unit = f", {'deg' if unit[1] == 'rad' else unit[1]}" if unit else ""
    repeatable = "; repeatable" * (get_origin(kind) is list)
    return f"{SENTENCES.get(name, sentence)}{unit}{repeatable}{bracket}{others}"


def _radians(value: Any) -> Any:
    """Radians of an angle, or of several, that the command line has in degrees."""
    return [x * DEG for x in value] if isinstance(value, list) else value and value * DEG


def _flag(name: str, described: str) -> str:
    if name == "start" and described.startswith("float, rad"):  # `meet` starts from gains
        name = "start_deg"
    return FLAGS.get(name, f"--{name.replace('_', '-')}")
