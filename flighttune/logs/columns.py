"""Which columns of a log are which of our signals, in which unit."""

import tomllib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

from flighttune.errors import InputError
from flighttune.files.shipped import nearest_name
from flighttune.files.table import toml_tables
from flighttune.simulate.run import SIGNAL_UNITS
from flighttune.units import DEG, FT, G_0

# Value of each unit that a log may have, in SI.
UNITS = {
    **dict.fromkeys(("", "1", "rad", "rad/s", "s", "m", "m/s", "m/s^2", "m/s2"), 1.0),
    **dict.fromkeys(("deg", "deg/s"), DEG),
    **dict.fromkeys(("ms", "mm"), 1e-3),
    **dict.fromkeys(("cm", "cm/s"), 1e-2),
    **dict.fromkeys(("ft", "ft/s"), FT),
    "cdeg": 0.01 * DEG,
    "1e-7deg": 1e-7 * DEG,
    "us": 1e-6,
    "ns": 1e-9,
    "km": 1e3,
    "km/h": 1.0 / 3.6,
    "kn": 1852.0 / 3600.0,
    "g": G_0,
    "mG": 1e-3 * G_0,
}

# What a log may have besides signals of a run; `sources.toml` says what they are.
RAW = (
    *("t", "f_z", "lat", "lon", "v_north", "v_east", "v_down", "wind_speed", "wind_from"),
    *(f"{attitude}_{part}" for attitude in ("q", "q_cmd", "q_enu") for part in "wxyz"),
    *("phi_err", "n_z_err", "vehicle"),
)

# Endings of the columns of a table that say their unit, such as `chi_deg`.
ENDINGS = {"": "", "_deg": "deg", "_rad": "rad", "_mps": "m/s", "_m": "m", "_s": "s", "_ms": "ms"}

CLOCKS = ("t", "time", "timestamp")

# Columns as a user gives them: NAME=SOURCE[:UNIT], files of such, or a mapping.
Columns: TypeAlias = Sequence[str | Path] | Mapping[str, str]


class Column(NamedTuple):
    """One place where a log may have a signal."""

    source: str  # TOPIC.FIELD, or the column of a table
    factor: float  # SI value of its unit, with the sign

    @property
    def topic(self) -> tuple[str, str]:
        """Topic and field; of a table the topic is empty."""
        topic, _, field = self.source.partition(".")
        return topic, field


def _column(name: str, source: str, place: str) -> Column:
    signals = {*SIGNAL_UNITS, *RAW}
    if name not in signals:
        raise InputError(
            f"{place}: `{name}` must be a signal, got no such{nearest_name(name, sorted(signals))}"
        )
    field, colon, unit = source.rpartition(":") if ":" in source else (source, "", "")
    sign = -1.0 if unit.startswith("-") else 1.0
    if colon and unit.removeprefix("-") not in UNITS:
        raise InputError(
            f"{place}: the unit of `{name}` must be one of {', '.join(filter(None, UNITS))}, with "
            f"a minus in front for the other sign, got {unit!r}."
        )
    return Column(field, sign * UNITS[unit.removeprefix("-")])


def given_columns(columns: Columns) -> dict[str, Column]:
    """The columns that a user gives; an InputError names a signal or unit that there is not."""
    pairs: dict[str, tuple[str, str]] = {}
    if isinstance(columns, Mapping):
        pairs = {name: (source, "columns") for name, source in columns.items()}
        columns = ()
    for entry in columns:
        name, equals, source = str(entry).partition("=")
        if equals:
            pairs[name] = source, "--column"
            continue
        for key, value in toml_tables(Path(entry)).items():
            if not isinstance(value, str):
                raise InputError(f'{entry}: `{key}` must be text "COLUMN:UNIT", got {value!r}.')
            pairs[key] = value, str(entry)
    return {name: _column(name, source, place) for name, (source, place) in pairs.items()}


@cache
def _tables() -> Mapping[str, Mapping[str, list[str]]]:
    text = Path(__file__).with_name("sources.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def columns_of(
    kind: str, header: Sequence[str], given: Mapping[str, Column], place: str
) -> dict[str, list[Column]]:
    """Places of every signal in a log of a kind; a table has `header`, and a clock first.

    Raises InputError if a table has no clock or not the columns `given`.
    """
    if kind != "csv":
        tables = _tables()[kind].items()
        shipped = {name: [_column(name, text, kind) for text in texts] for name, texts in tables}
        return {**shipped, **{name: [column] for name, column in given.items()}}
    for name, column in given.items():
        if column.source not in header:
            raise InputError(
                f"{place}: the column of `{name}` must be one of the file's, got "
                f"{column.source!r}{nearest_name(column.source, header)}"
            )
    in_header = {
        name: [Column(f"{name}{ending}", UNITS[unit])]
        for name in (*SIGNAL_UNITS, *RAW)
        for ending, unit in ENDINGS.items()
        if f"{name}{ending}" in header
    }
    clocks = [Column(f"{name}{end}", UNITS[ENDINGS[end]]) for name in CLOCKS for end in ("", "_s")]
    clock = given.get("t") or next((c for c in clocks if c.source in header), None)
    if clock is None:
        raise InputError(
            f"{place}: the time must be a column `t`, or given as --column t=COLUMN:UNIT, got "
            f"columns {', '.join(header[:8])}{' ...' if len(header) > 8 else ''}."
        )
    return {**in_header, **{name: [column] for name, column in given.items()}, "t": [clock]}
