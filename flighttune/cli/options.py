"""Arguments and options that several commands have."""

from collections.abc import Mapping
from contextvars import ContextVar
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

from typer import Option

from flighttune.errors import InputError
from flighttune.files.shipped import campaign_files, scenario_files

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


def out_folder(default: str) -> Any:
    """The option ``--out`` of a command that writes into a folder."""
    return Option("--out", help=f"Folder to write to [default: {default}].")


def check_ending(out: Path | None, *endings: str, option: str = "--out") -> None:
    """Refuse a file that does not end in one of `endings`, before anything is computed."""
    if out is not None and endings and out.suffix.lower() not in endings:
        raise InputError(f"{out}: {option} must end in {endings[0]}.")


ClaimOption = Annotated[
    list[Path] | None,
    Option(
        "--claim",
        metavar="FILE",
        help="File of a tube or band: draw its bounds around the runs that it covers; repeatable.",
    ),
]
