"""The signals of a run, and the subjects of its measures, as `signals.toml` describes them."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from flighttune.base.units import shown_unit

_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Signal:
    """A row of `signals.toml`, whose head says what the keys mean; a key left out is empty."""

    unit: str
    symbol: str = ""
    word: str = ""
    title: str = ""
    short: str = ""
    group: str = ""
    thin: str = ""
    reference: str = ""
    limit: str = ""
    measured: str = ""
    derived: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A quantity of a flight that requirements bound."""

    error: str  # the signal that is bounded
    command: str = ""  # the command that mostly moves it, if any
    symbol: str
    word: str


ALL_SIGNALS = {name: Signal(**row) for name, row in _TABLES["signals"].items()}

# Signals that a run may hold, and their units.
SIGNALS = {name: signal for name, signal in ALL_SIGNALS.items() if not signal.derived}
SIGNAL_UNITS = {name: signal.unit for name, signal in SIGNALS.items()}


def _subject(name: str, row: dict[str, str]) -> Subject:
    own = SIGNALS.get(name)
    return Subject(**({"symbol": own.symbol, "word": own.word} if own else {}) | row)


SUBJECTS = {name: _subject(name, row) for name, row in _TABLES["subjects"].items()}
COMMAND_OF = {name: subject.command for name, subject in SUBJECTS.items() if subject.command}

# Symbols of subjects and commands, and words of subjects.
SYMBOLS = {name: subject.symbol for name, subject in SUBJECTS.items()}
SYMBOLS |= {x: SIGNALS[x].symbol for x in COMMAND_OF.values() if SIGNALS[x].symbol}
CHANNEL_WORDS = {name: subject.word for name, subject in SUBJECTS.items()}

# Symbols and words of the channels of the path, which every flight has.
CHANNEL_SYMBOLS = {name: SYMBOLS[name] for name in ("chi", "gamma")}
CHANNEL_NAMES = {name: CHANNEL_WORDS[name] for name in CHANNEL_SYMBOLS}


def titles(name: str, unit: str = "") -> tuple[str, str]:
    """Title and label of a signal over time; `unit` (SI) is used where the table has no title."""
    signal = SIGNALS.get(name)
    if signal is None or not signal.title:
        return name, f"{name} [{shown_unit(unit)[0]}]"
    return signal.title, f"{signal.symbol or name} [{shown_unit(signal.unit)[0]}]"
