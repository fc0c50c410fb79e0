"""A log of a real flight as a run: our signals, units and signs on one time base, gaps as NaN."""

import math
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from flighttune.errors import InputError
from flighttune.flight.fly import library_versions
from flighttune.logs.checks import check_flight, checked
from flighttune.logs.columns import Column, Columns, columns_of, given_columns
from flighttune.logs.read import Fields, Stream, read_log
from flighttune.logs.time_base import on_one_base
from flighttune.references.maps import TOO_LARGE
from flighttune.simulate.run import SIGNAL_UNITS, Provenance, Run

PLANT = "log"  # label of the plant of a run that is a log


# Signals whose absence is said.
WANTED = ("chi", "gamma", "phi", "n_z", "V_a", "north", "h", "phi_cmd", "n_z_cmd", "wind_north")


def load_log(
    path: str | Path, *, columns: Columns = (), start: float = 0.0, end: float = math.inf
) -> Run:
    """Read the log of a real flight as a run.

    Reading takes seconds for an hour of flight. Nothing in the log is executed.

    Parameters
    ----------
    path : str or Path
        A ULog (PX4), a DataFlash log (ArduPilot), a telemetry log (MAVLink) or a table (.csv); the
        first three are known by their content.
    columns : mapping of str to str, or sequence of str or Path
        Where the log has signals, over what is known of its kind: ``{"chi": "COLUMN:UNIT"}``,
        ``"chi=COLUMN:UNIT"``, or TOML files of such pairs. In a binary log a column is
        ``TOPIC.FIELD``. Signals are those of runs and, as `sources.toml` says, attitude
        quaternions, velocities over ground, specific force, latitude and longitude.
    start, end : float, s
        Part of the log, from its first attitude on.

    Returns
    -------
    Run
        Its signals are in SI and radians at one sample time; north, east and down count from its
        start, and NaN stands where the log has a gap. ``provenance.scenario["log"]`` lists what is
        missing, and the checks of units and signs.

    Raises
    ------
    RecordingError
        If the file is no log, is damaged, or holds no flight of an aeroplane.
    InputError
        If a column or unit is not there, or pyulog or pymavlink is missing.

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
    places: dict[str, list[Column]] = {}

    def wanted(kind: str, header: list[str]) -> Fields:
        places.update(columns_of(kind, header, given, str(path)))
        fields: dict[str, list[str]] = {"HEARTBEAT": []} if kind == "MAVLink" else {}
        for column in (column for each in places.values() for column in each):
            topic, field = ("", column.source) if kind == "csv" else column.topic
            fields.setdefault(topic, []).append(field)
        if kind == "csv":  # the clock first, each once
            clock = places["t"][0].source
            fields[""] = [clock, *(name for name in dict.fromkeys(fields[""]) if name != clock)]
        return fields

    kind, streams, vehicle, header = read_log(path, wanted)
    wanted(kind, header)  # the copy that read the log took its own notes
    raw = _named(kind, streams, places)
    if "vehicle" in raw:  # PX4: of a VTOL it changes
        vehicle = f"type {np.max(raw.pop('vehicle')[1]):g} of PX4"
    large = []
    for name, (times, column) in raw.items():
        if number := np.count_nonzero(wrong := np.abs(column) >= TOO_LARGE):
            raw[name] = times, np.where(wrong, np.nan, column)
            large.append(f"{name}: samples of {TOO_LARGE:g} or more left out, {number}")
    t, values = on_one_base(str(path), raw, start, end, table=kind == "csv")
    signals, notes = checked(values, t)
    check_flight(str(path), signals, vehicle)
    ordered = [name for name in SIGNAL_UNITS if name in signals]
    missing = [name for name in WANTED if name not in signals]
    gaps = [
        f"{name}: {share:.1%} of the time"
        for name in ordered
        if (share := float(np.mean(np.isnan(signals[name])))) >= 0.0005
    ]
    table = {
        "file": path.name,
        "kind": kind,
        "from_s": start,
        "missing": [f"no {name}" for name in missing],
        "gaps": gaps + large,
        "checks": notes,
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
    index = pd.Index(t, name="t")
    frame = pd.DataFrame({name: signals[name] for name in ordered}, index=index)
    return Run(signals=frame, status="completed", reason="", provenance=made_by)


def _named(
    kind: str, streams: Mapping[str, Stream], places: Mapping[str, list[Column]]
) -> dict[str, Stream]:
    """Streams by signal, in SI, each from the first place where the log has it."""
    raw = {}
    clock = places["t"][0].factor if kind == "csv" else 1.0
    for name, columns in places.items():
        for column in columns:
            key = f".{column.source}" if kind == "csv" else column.source
            if key in streams and name != "t":
                t, values = streams[key]
                raw[name] = clock * t, column.factor * values
                break
    return raw


def load_part(name: str, columns: Columns) -> Run:
    """The log of a file, or the part ``LOG@START:END`` of one."""
    place, _, part = (name, "", "") if Path(name).exists() else name.partition("@")
    return load_log(place, columns=columns, **_part_of(part, name))


def _part_of(choice: str, name: str) -> dict[str, float]:
    """`start` and `end` (s) of a part ``START:END`` of a log; either may be empty."""
    if not choice:
        return {}
    first, colon, last = choice.partition(":")
    start = end = math.nan
    with suppress(ValueError):
        start, end = float(first or 0.0), float(last or math.inf)
    if not (colon and 0.0 <= start < end):
        raise InputError(f"{name}: the part of a log must be START:END in s, got {choice!r}.")
    return {"start": start, "end": end}
