"""Commands made of the verbs of the package; options are read from signature and docstring.

The text of a verb is read, not imported: a help starts without NumPy. ``commands.toml`` has the
rest.
"""

import ast
import re
import shlex
import sys
import tomllib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from contextvars import ContextVar
from functools import partial
from importlib import import_module
from inspect import Parameter, Signature, cleandoc, signature
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeAlias, get_args, get_origin

from typer import Argument, Option

from flighttune import modules_of
from flighttune.base.answers.answer import Answer
from flighttune.base.errors import InputError
from flighttune.base.files.shipped import aircraft_names, campaign_files, scenario_files
from flighttune.base.units import DEG
from flighttune.cli.show import campaign_display, emit, progress_bar, working

# Texts of all commands by their heading in the help, and of options that are alike.
COMMANDS = tomllib.loads(Path(__file__).with_name("commands.toml").read_text(encoding="utf-8"))
ALIKE, FORMER = COMMANDS.pop("alike"), COMMANDS.pop("former")

# Workers of a command that flies: `--workers` and `--scheduler`, which all of them have.
FLOWN_BY: ContextVar[Mapping[str, Any]] = ContextVar(
    "flown_by", default=MappingProxyType({"workers": None, "scheduler": None})
)

# `--run-code` of a command that flies again what a file of flighttune's has.
RUN_CODE: ContextVar[bool] = ContextVar("run_code", default=False)

# The verb of a command: its `keywords` are the options that were given; it takes more.
Verb: TypeAlias = partial[Any]


def this_command() -> str:
    """The command as it was given."""
    return shlex.join(["flighttune", *sys.argv[1:]])


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


# What makes a value of the words of an option, and what a shell completes.
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
}

TYPES = {"str": str, "int": int, "float": float, "bool": bool, "Path": Path, "Columns": str}
SEQUENCES, OF_PYTHON = {"Columns", "Iterable", "Sequence"}, {"Callable", "Mapping"}

# Endings of the files that commands write.
OF_FILES = ".csv", ".html", ".json", ".npz", ".parquet", ".rrd", ".svg", ".toml"

# Parameters that the command line supplies.
SUPPLIED = {"progress": progress_bar, "observer": campaign_display}


def command(body: Callable[..., Answer | None], texts: Mapping[str, Any]) -> Callable[..., None]:
    """A command that calls `body`, with the verb of its `texts` before the values of its options.

    The options are those of the verb and those of `body` with help in ``commands.toml``. The seed
    of draws is one of the changes.
    """
    place, own = texts.get("verb", ""), signature(body).parameters
    verb = _definition(*f"flighttune.{place}".split(":")) if place else None
    # A command without a verb takes the values of its options alone.
    arguments, of_body = _arguments(verb), [*own][1:] if place else [*own]
    first, several = next(iter([*arguments, *of_body]), ""), _several(verb)
    drawn = arguments.get("seed", ("", 0))[1] is None
    absent = {*SUPPLIED, *FLOWN_BY.get(), "run_code", *texts.get("absent", ())}
    absent |= {"seed"} if drawn else set()
    spelled = ALIKE | {x: y for x, y in texts.items() if isinstance(y, dict)}
    kinds = {x: own[x].annotation for x in of_body} | dict.fromkeys(("as_json", "quiet"), bool)
    made = [x for x in _parameters(verb, kinds, spelled, first) if x.name not in absent]
    made.sort(key=lambda x: (x.name in ("as_json", "quiet"), x.name == "changes"))
    defaults = {x.name: x.default for x in made}
    read = {x: spelled[x] for x in defaults if "read" in spelled.get(x, ())}
    files = {
        x: spelled[x]["help"]
        for x in of_body
        if kinds[x] in (Path, Path | None) and x != first and "help" in spelled.get(x, ())
    }

    def run(*, quiet: bool, as_json: bool = False, **values: Any) -> None:
        with working(texts["doing"], quiet=quiet, as_json=as_json):
            if RUN_CODE.get() and "run_code" not in arguments:
                others = "verify, band, mission, monitor and worst"
                raise InputError(f"--run-code must be given with {others} alone.")
            for x, how in read.items():
                values[x] = _read(values[x] or [], how["read"], _flag(x), how["metavar"])
            if drawn and (seed := values["changes"].pop("seed", None)) is not None:
                if type(seed) is not int or seed < 0:
                    reason = f"`seed` must be an integer from 0 on, got {seed!r}."
                    raise InputError(f"--set: {reason}")
                values["seed"] = seed
            source = values.get(first, "")
            for x, text in files.items():
                values[x] = _file_to_write(_flag(x), text, values[x], source)
            taken = {x: values[x] for x in of_body}
            others = values.pop(several, None) or ()
            if place:
                chosen = {
                    x: values[x]
                    for x in [*arguments][1:]
                    if x in values and values[x] not in (None, [], {}, defaults.get(x))
                }
                call = partial(_called, place, [*arguments], source, *others, **chosen)
                answer = body(call, **taken)
            else:
                answer = body(**taken)
            if answer is not None:
                emit(answer, source)

    run.__signature__ = Signature(made)  # type: ignore[attr-defined]
    run.__annotations__ = {x.name: x.annotation for x in made}
    run.__doc__ = body.__doc__
    return run


def _read(words: list[str], how: str, flag: str, form: str) -> Any:
    """The value of an option that has words of a form."""
    try:
        return READ[how](words)
    except InputError:
        raise
    except ValueError:
        raise InputError(f"{flag} must be {form}, got {', '.join(words)[:80]!r}.") from None


def _file_to_write(flag: str, text: str, file: Path | None, source: Any) -> Path | None:
    """A file, its ending checked, or its default: the help of its option says both."""
    if file and text.startswith("Folder") and file.suffix in OF_FILES and not file.is_dir():
        raise InputError(f"{file}: {flag} must be a folder, got the name of a file.")
    check_ending(file, *re.findall(r"\((\.\w+)\)", text), option=flag)
    default = re.search(r"\[default: (runs/\S+)\]", text)
    if file or not default:
        return file
    whole_log = re.sub(r"@[\d.:]*$", "", Path(str(source)).name)  # without the part of it
    return Path(default[1].replace("NAME", Path(whole_log).stem))


def check_ending(out: Path | None, *endings: str, option: str = "--out") -> None:
    """Refuse a file that does not end in one of `endings`, before anything is computed."""
    if out is not None and endings and out.suffix.lower() not in endings:
        raise InputError(f"{out}: {option} must end in {' or '.join(endings)}.")


def _called(place: str, names: list[str], source: Any, /, *values: Any, **keywords: Any) -> Any:
    """Import a verb and call it, watched and flown as the command line says."""
    module, _, name = place.partition(":")
    keywords |= {x: value for x, value in FLOWN_BY.get().items() if x in names}
    keywords |= {"run_code": True} if RUN_CODE.get() else {}
    with ExitStack() as stack:
        for supplied in SUPPLIED.keys() & {*names} - keywords.keys():
            keywords[supplied] = stack.enter_context(SUPPLIED[supplied]())
        verb = getattr(import_module(f"flighttune.{module}"), name)
        return verb(keywords.pop(names[0], source), *values, **keywords)


def _definition(module: str, name: str) -> ast.FunctionDef:
    """Signature and docstring of a verb, from the text of its module."""
    file = Path(__file__).parents[2].joinpath(*module.split(".")).with_suffix(".py")
    pattern = re.compile(rf'^def {name}\(.*?^    """.*?"""', re.DOTALL | re.MULTILINE)
    (text,) = pattern.findall(file.read_text(encoding="utf-8"))
    *_, verb = ast.parse(text).body  # after its overloads
    assert isinstance(verb, ast.FunctionDef)
    return verb


def _several(verb: ast.FunctionDef | None) -> str:
    """The parameter of a verb that takes any number of values."""
    return verb.args.vararg.arg if verb and verb.args.vararg else ""


def _arguments(verb: ast.FunctionDef | None) -> dict[str, tuple[str, Any]]:
    """Annotation and default of each parameter of a verb."""
    if verb is None:
        return {}
    stated = [*verb.args.args, *verb.args.kwonlyargs]
    defaults = [*verb.args.defaults, *verb.args.kw_defaults]
    defaults = [None] * (len(stated) - len(defaults)) + defaults
    several = {name: ("Sequence[str]", None) for name in [_several(verb)] if name}
    return {
        x.arg: (ast.unparse(x.annotation or ast.Constant("")), getattr(default, "value", None))
        for x, default in zip(stated, defaults, strict=True)
    } | several


def _parameters(
    verb: ast.FunctionDef | None, own: Mapping[str, Any], spelled: Mapping[str, Any], first: str
) -> Iterator[Parameter]:
    """Arguments and options of a verb and, with help in `spelled`, of a command's own."""
    entries, arguments = _entries(verb), _arguments(verb)
    for name in dict.fromkeys([*arguments, *own]):
        described, _ = entries.get(name, ("", ""))
        more = {**spelled.get(name, {})}
        annotation, value = arguments.get(name, ("", None))
        kind = _type(annotation, described)
        if name in own and "help" in more:
            kind, value = own[name], None
        if more.pop("read", None):
            kind = list[str]
        if kind is None:
            continue
        if kind is bool:
            value = bool(value)
        made = partial(Option, *more.pop("flags", [_flag(name, described)]))
        if name in (first, _several(verb)):
            made = Argument
            value = None if kind == list[str] or type(None) in get_args(kind) else Parameter.empty
        sentence = more.pop("sentence", "")
        if complete := more.pop("complete", None):
            more["autocompletion"] = COMPLETE[complete]
        if re.search(r"float, rad\b(?!/)", described):
            more["callback"] = _radians
        repeatable = get_origin(kind) is list and made is not Argument
        more = {"help": _help(name, entries, sentence, repeatable=repeatable), **more}
        annotation = Annotated[kind | None if value is None else kind, made(**more)]
        yield Parameter(name, Parameter.KEYWORD_ONLY, default=value, annotation=annotation)


def _entries(verb: ast.FunctionDef | None) -> dict[str, tuple[str, str]]:
    """Type and text of each parameter in a NumPy docstring, or in that of the verb it names."""
    text = cleandoc((verb and ast.get_docstring(verb)) or "")
    section = re.search(r"Parameters\n-+\n(.*?)(?=\n\n\w+\n-+\n|\Z)", text, re.DOTALL)
    entry = re.compile(r"^(\w[\w, ]*) : ([^\n]*)\n?((?:    .*\n?)*)", re.MULTILINE)
    entries = {}
    for names, described, text in entry.findall(section[1] if section else ""):
        own = dict.fromkeys(names.split(", "), (described, text))
        if other := re.fullmatch(r"as for `(\w+)`", described):
            shared = _entries(_definition(modules_of("flighttune")[other[1]], other[1]))
            own = {name: shared[name] for name in own}
        entries |= own
    return entries


def _type(annotation: str, described: str) -> Any:
    """The type of an option; None of a parameter that has none on a command line."""
    if choices := re.search(r"\{(.+)\}", described):
        return Literal[ast.literal_eval(f"({choices[1]},)")]
    words = re.findall(r"\w+", annotation)
    types = [TYPES[word] for word in words if word in TYPES]
    if OF_PYTHON & {*words} or not types:
        return None
    return list[types[-1]] if SEQUENCES & {*words} else types[0]


def _help(name: str, entries: dict[str, tuple[str, str]], first: str, *, repeatable: bool) -> str:
    """The sentences of a parameter as the help of an option, its default in brackets."""
    described, text = entries.get(name, ("", "."))
    text = re.sub(
        r"`(\w+)`", lambda x: _flag(x[1], entries[x[1]][0]) if x[1] in entries else x[0], text
    )
    text = " ".join(text.replace("``", "").split())
    text = re.sub(r"[,;] by default (.+?)(?=\.( |$))", r" [default: \1]", text)
    sentence, bracket, others = re.split(r"( \[default: |\.(?= |$))", text, maxsplit=1)
    unit = re.search(r"(?<!or )float, (?!1\b|optional)([^,]*)", described)
    unit = f", {'deg' if unit[1] == 'rad' else unit[1]}" if unit else ""
    repeated = "; repeatable" if repeatable else ""
    return f"{first or sentence}{unit}{repeated}{bracket}{others}"


def _radians(value: Any) -> Any:
    """Radians of an angle, or of several, that the command line has in degrees."""
    return [x * DEG for x in value] if isinstance(value, list) else value and value * DEG


def _flag(name: str, described: str = "") -> str:
    if name == "start" and described.startswith("float, rad"):  # `meet` starts from gains
        name = "start_deg"
    return ALIKE.get(name, {}).get("flags", [f"--{name.replace('_', '-')}"])[0]
