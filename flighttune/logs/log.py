"""A log of a real flight as a run: its signals, units and signs on one time base, NaN in gaps."""

import math
import os
import re
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, RecordingError
from flighttune.base.files.shipped import nearest_name
from flighttune.base.files.table import shown, toml_tables
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.base.units import DEG, FT, G_0, KNOT
from flighttune.base.words import listed
from flighttune.flight.fly import library_versions
from flighttune.flight.loop.run import Provenance, Run
from flighttune.logs.checks import check_flight, degrees_as_radians, signals_of, verdicts
from flighttune.logs.read import Column, read_log
from flighttune.logs.streams import EVENTS, Phase, in_words, inside, on_one_base, phases
from flighttune.routes.maps import TOO_LARGE

# SI value of each unit that a log may have.
UNITS = (
    dict.fromkeys(("", "1", "rad", "rad/s", "s", "m", "m/s", "m/s^2", "m/s2", "m/s²"), 1.0)
    | {"deg": DEG, "deg/s": DEG, "°": DEG, "°/s": DEG, "cdeg": 0.01 * DEG, "1e-7deg": 1e-7 * DEG}
    | {"ms": 1e-3, "us": 1e-6, "ns": 1e-9, "mm": 1e-3, "cm": 1e-2, "cm/s": 1e-2, "km": 1e3}
    | {"ft": FT, "ft/s": FT, "km/h": 1.0 / 3.6, "kn": KNOT, "kt": KNOT, "g": G_0, "mG": 1e-3 * G_0}
)

# Signals that a log may have besides the signals of a run; `sources.toml` explains them.
RAW = (
    *("t", "f_z", "lat", "lon", "v_north", "v_east", "v_down", "wind_speed", "wind_from"),
    *(f"{attitude}_{part}" for attitude in ("q", "q_cmd", "q_enu") for part in "wxyz"),
    *("phi_err", "theta_err", "n_z_err", "vehicle", "trusted", *EVENTS),
)

# Columns of a table that name their unit: by their ending, such as `chi_deg`, or as `chi [deg]` and
# `chi (deg)`. If a signal has several columns, the first of these is read.
ENDINGS = (
    *("_ms:ms", "_s:s", "_m:m", "_mps:m/s", "_rad:rad", "_deg:deg", ""),
    *("_ft:ft", "_fps:ft/s", "_kt:kn", "_kmh:km/h"),
)
WITH_UNIT = re.compile(r"(\w+) ?[\[(](.+)[\])]")

# Maximum number of columns in a message.
MAX_SHOWN = 8

# Names of the clock of a table; the first match is read.
CLOCKS = "t", "time", "timestamp"

# A user's columns: NAME=SOURCE[:UNIT], files of these, or a mapping.
Columns: TypeAlias = str | Path | Sequence[str | Path] | Mapping[str, str]


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
            f"{place}: the unit of `{name}` in the column `{shown(field)}` must be one of "
            f"{', '.join(filter(None, UNITS))}, with a minus in front for the other sign, got "
            f"{shown(unit)!r}."
        )
    # The unit of a load factor is g, and of an acceleration m/s2.
    load_factor = name.startswith("n_") and unit.endswith(("g", "G"))
    return Column(field, sign * UNITS[unit.removeprefix("-")] / (G_0 if load_factor else 1.0))


def _columns(name: str, sources: Iterable[str], place: str) -> list[Column]:
    return [_column(name, source, place) for source in sources]


def given_columns(columns: Columns) -> dict[str, Column]:
    """The user's columns; InputError for an unknown signal or unit."""
    pairs: dict[str, tuple[str, str]] = {}
    if isinstance(columns, Mapping):
        pairs = {name: (source, "columns") for name, source in columns.items()}
        columns = ()
    for entry in [columns] if isinstance(columns, str | Path) else columns:
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
def _tables() -> Mapping[str, Mapping[str, Any]]:
    return tomllib.loads(Path(__file__).with_name("sources.toml").read_text(encoding="utf-8"))


def columns_of(
    given: Mapping[str, Column], place: str, kind: str, header: Sequence[str]
) -> dict[str, list[Column]]:
    """Sources of every signal in a log of a kind; a table has `header`, with a clock first."""
    stated = {name: [column] for name, column in given.items()}
    if kind != "csv":
        stated.pop("t", None)  # messages have their own clock
        return {x: _columns(x, sources, kind) for x, sources in _tables()[kind].items()} | stated
    for name, column in given.items():
        if column.source not in header:
            raise InputError(
                f"{place}: the column of `{name}` must be one of the file's, got "
                f"{column.source!r}{nearest_name(column.source, header)}"
            )
    # JSBSim's own output puts a path before properties; they also match without it.
    shipped = {
        x: [*sources, *(source.removeprefix("/fdm/jsbsim/") for source in sources)]
        for x, sources in _tables()["JSBSim"].items()
    }
    rolls = {column.source for column in _columns("phi", shipped["phi"], kind)}
    of_jsbsim = shipped if rolls & {*header} else {}
    labelled, places = defaultdict[str, list[str]](list), {}
    for column in header:
        if match := WITH_UNIT.fullmatch(column):  # a dash is the unit of a dimensionless number
            labelled[match[1]].append(f"{column}:{'1' if match[2] == '-' else match[2]}")
    for name in (name for name in (*SIGNAL_UNITS, *RAW) if name not in stated):
        sources = [*of_jsbsim.get(name, ())]
        for label in CLOCKS if name == "t" else [name]:
            sources += [*(f"{label}{ending}" for ending in ENDINGS), *labelled[label]]
        columns = _columns(name, sources, place)
        if there := [column for column in columns if column.source in header]:
            places[name] = there
    places |= stated
    if "t" not in places:
        raise InputError(
            f"{place}: the time must be a column `t`, or given as --column t=COLUMN:UNIT, got "
            f"columns {_named(header)}."
        )
    return {"t": places["t"], **places}


def _named(columns: Sequence[str]) -> str:
    """Columns of a table, listed for a message."""
    return listed([shown(column) for column in columns], most=MAX_SHOWN)


def _gaps(columns: Mapping[str, FloatArray]) -> list[str]:
    """A sentence on the signals that have gaps."""
    shares = {name: float(np.mean(np.isnan(values))) for name, values in columns.items()}
    shares = {name: share for name, share in shares.items() if share >= SMALLEST_GAP}
    if not shares:
        return []
    ends = dict.fromkeys(f"{100.0 * end(shares.values()):.1f}" for end in (min, max))
    some = listed([*shares], most=MAX_SHOWN)
    return [f"Gaps of {' to '.join(ends)} % of the time in {some}."]


PLANT = "log"  # plant label of a run from a log

# Share of the time from which the gaps of a signal are reported.
SMALLEST_GAP = 0.0005


# Signals whose absence is reported.
WANTED = ("chi", "gamma", "phi", "n_z", "V_a", "north", "h", "phi_cmd", "n_z_cmd", "wind_north")


def load_log(
    path: str | Path,
    *,
    columns: Columns = (),
    start: float = 0.0,
    end: float = math.inf,
    mode: str = "",
) -> Run:
    """Read the log of a real flight as a run.

    Reading takes seconds for an hour of flight. Nothing in the log is executed.

    Parameters
    ----------
    path : str or Path
        A ULog (PX4), a DataFlash log (ArduPilot), a telemetry log (MAVLink) or a table (.csv); the
        first three are recognised by content.
    columns : mapping of str to str, str, Path, or sequence of these two
        Columns of signals, which replace the defaults for this kind of log: ``{"chi":
        "COLUMN:UNIT"}``, ``"chi=COLUMN:UNIT"``, or TOML files of such pairs. In a binary log a
        column is ``TOPIC.FIELD``. Possible signals are the signals of runs and, from
        `sources.toml`, attitude quaternions, velocities over ground, specific force, latitude and
        longitude. ``trusted=NAME,NAME`` accepts contradictions of these signals with others.
    start, end : float, s
        Part of the log, from its first attitude on.
    mode : str
        Keep only this flight mode, such as ``AUTO`` of ArduPlane or ``MISSION`` of PX4, or the
        state ``armed`` or ``airborne``. The time between two phases of the mode is a gap.

    Returns
    -------
    Run
        Its signals are in SI and radians at one sample time; north, east and down count from its
        start, and gaps of the log are NaN. ``provenance.scenario["log"]`` lists the flight modes,
        faults of sensors, missing signals, and the checks of units and signs.

    Raises
    ------
    RecordingError
        If the file is not a log, is damaged, or has no flight of an aeroplane.
    InputError
        If a column, unit or mode is not there, or pyulog or pymavlink is missing.

    Examples
    --------
    >>> import numpy as np, pandas
    >>> t = np.arange(500) / 25.0
    >>> columns = {"t_s": t, "phi_deg": 10.0 * np.sin(t), "v_north": 15.0, "v_east": 20.0}
    >>> pandas.DataFrame(columns).to_csv("flight.csv", index=False)
    >>> run = ft.load_log("flight.csv")
    >>> run.label, round(run.duration, 2), round(float(run.signals["chi"].iloc[0]), 4)
    ('log / flight', 19.96, 0.9273)
    """
    path, given = Path(path), given_columns(columns)
    trusted = given.pop("trusted", Column("", 1.0)).source.replace(",", " ").split()
    for name in trusted:
        _column(name, "", "trusted")  # refuses unknown signals
    kind, raw, vehicle, unread = read_log(path, partial(columns_of, given, str(path)))
    if "vehicle" in raw:  # PX4: the type of a VTOL changes in flight
        vehicle = f"type {np.max(raw.pop('vehicle')[1]):g} of PX4"
    large = []
    for name, (times, column) in raw.items():
        if number := np.count_nonzero(wrong := np.abs(column) >= TOO_LARGE):
            raw[name] = times, np.where(wrong, np.nan, column)
            large.append(f"{name}: samples of {TOO_LARGE:g} or more left out, {number}")
    said = degrees_as_radians(raw)  # before angles are wrapped
    modes = {**_tables()["modes"], "csv": {}}
    named = {**modes["DataFlash"], **modes[kind]} if kind == "MAVLink" else modes[kind]
    times, faults = phases(str(path), raw, named, _tables()["states"].get(kind, {}))
    chosen: list[Phase] = []
    if mode:
        chosen = [phase for phase in times if phase.name.lower() == mode.lower()]
        if not chosen:
            got = ", ".join(dict.fromkeys(phase.name for phase in times)) or "no flight mode"
            raise InputError(
                f"{path}: the part of a log must be START:END in s, or a flight mode of the log, "
                f"which has {got}, got {mode!r}."
            )
        start, end = chosen[0].start, chosen[-1].end
    t, values = on_one_base(str(path), raw, start, end, table=kind == "csv")
    there = inside(t + start, chosen) if mode else np.ones(len(t))
    values = {name: column * there for name, column in values.items()}
    signals, notes = signals_of(values, t)
    whole = t, values
    if start > 0.0 or end < math.inf:
        # The whole log tells more of a column than a part, in which it may hardly vary.
        with suppress(RecordingError):  # e.g. over hours, or with a break
            whole = on_one_base(str(path), raw, 0.0, math.inf, table=kind == "csv")
    wrong, of_columns = verdicts(whole[1], whole[0], said)
    notes += of_columns
    # Units, such as km/h, may follow a colon.
    passed = [x for x in wrong if {*trusted} & {*re.findall(r"\w+", x.partition(":")[0])}]
    wrong = [line for line in wrong if line not in passed]
    notes += [f"{line}, which --column trusted= passes" for line in passed]
    check_flight(str(path), signals, vehicle)
    ordered = [name for name in SIGNAL_UNITS if name in signals]
    lacks = [name for name in WANTED if name not in signals]
    missing = [f"The log has no {listed(lacks, 'or')}."] if lacks else []
    if unread:
        way = "--column NAME=COLUMN:UNIT reads one"
        missing.append(f"No signal is read from {_named(unread)}; {way}.")
    gaps = _gaps({name: signals[name][there == 1.0] for name in ordered})
    table = {
        "file": path.name,
        "kind": kind,
        "from_s": start,
        "phases": in_words(times),
        "sensors": faults,
        "missing": missing,
        "gaps": gaps + large,
        "checks": [*wrong, *notes],
        "wrong": wrong,
    }
    libraries = {"ULog": "pyulog", "csv": "pandas"}.get(kind, "pymavlink")
    made_by = Provenance(
        scenario={"title": f"Log {path.name}", "log": table},
        plant=PLANT,
        gains_name=path.stem,
        gains=None,
        seed=0,
        versions={**library_versions(), libraries: version(libraries)},
        wall_s=0.0,
    )
    frame = pd.DataFrame({name: signals[name] for name in ordered}, index=pd.Index(t, name="t"))
    return Run(signals=frame, status="completed", reason="", provenance=made_by)


def load_part(name: str, columns: Columns) -> Run:
    """A log, or its part ``LOG@START:END`` (s, either may be empty) or ``LOG@MODE``."""
    place, _, part = (name, "", "") if os.path.exists(name) else name.partition("@")
    if ":" not in part:
        return load_log(place, columns=columns, mode=part)
    first, _, last = part.partition(":")
    start = end = math.nan
    with suppress(ValueError):
        start, end = float(first or 0.0), float(last or math.inf)
    if not 0.0 <= start < end:
        raise InputError(f"{name}: the part of a log must be START:END in s, got {part!r}.")
    return load_log(place, columns=columns, start=start, end=end)
