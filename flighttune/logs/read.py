"""Log files to streams of numbers; the only module that imports pyulog and pymavlink.

A log may come from anybody. At a damaged file its libraries raise any error, use any amount of
memory and print. It is therefore read in a copy of this process, with bounds on memory and time.
"""

import math
import os
import signal
import struct
import traceback
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections import defaultdict
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, RecordingError, need
from flighttune.base.files.budget import LOG, opened
from flighttune.base.files.load import kind_of_log
from flighttune.base.files.table import first_line
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.flight.apart import apart

# Time (s) and value of the samples of one field.
Stream: TypeAlias = tuple[FloatArray, FloatArray]


class Column(NamedTuple):
    """One possible source of a signal in a log."""

    source: str  # TOPIC.FIELD, or the name of a column in a table
    factor: float  # SI value of its unit, with its sign


# Sources of each signal, from the kind of a log and the columns of a table.
Places: TypeAlias = Callable[[str, list[str]], Mapping[str, list[Column]]]

# Limit of processor time, s, and its increase per byte.
PATIENCE_S, PATIENCE_PER_BYTE = 10.0, 1e-5

# Time for each second of processor time: on a busy machine a reader waits for its turn.
WAITING = 30.0

# Stages of a PX4 version by their smallest number: version.h.
STAGES = ((255, ""), (192, "rc"), (128, "beta"), (64, "alpha"), (0, "dev"))

MAV_PARAM_TYPE_REAL32 = 9  # MAVLink's number of the type; smaller types are integers

# Exceptions that only a mistake in this module raises; damaged files raise others too.
OWN = (AttributeError, NameError)


class _OwnFaultError(RuntimeError):
    """A mistake in this module, not damage of the file."""


def _kind_of(path: Path) -> str:
    """Kind of a log by its first bytes, or ``csv`` by its ending; empty for other files."""
    with opened(path) as file:
        head = file.read(16)
        if os.fstat(file.fileno()).st_size > LOG.size:
            raise RecordingError(f"{path}: the file must have at most {LOG.size} bytes, got more.")
    kind, table = kind_of_log(head), path.suffix.lower() == ".csv"
    return "csv" if table and kind in ("", "MAVLink") else kind


def read_log(path: Path, places: Places) -> tuple[str, dict[str, Stream], str, list[str]]:
    """Kind of a log, its signals in SI, each from its first source, vehicle and unread columns."""
    kind = _kind_of(path)
    if not kind:
        raise RecordingError(
            f"{path}: must be a ULog (.ulg), a DataFlash log (.bin), a telemetry log (.tlog) or a "
            "table (.csv), got another file."
        )
    need(f"a log of kind {kind}", *({"ULog": ["pyulog"], "csv": []}.get(kind, ["pymavlink"])))

    def read() -> tuple[str, dict[str, Stream], str, list[str]]:
        header = [*map(str, _table(path, nrows=0).columns)] if kind == "csv" else []
        columns = {**places(kind, header)}
        sources = dict.fromkeys(column.source for each in columns.values() for column in each)
        streams, vehicle = _READERS[kind](path, [*sources])
        (clock, *_) = columns.pop("t", [Column("", 1.0)])
        signals = {}
        for name, each in columns.items():
            there = [column for column in each if column.source in streams]
            rows = [column.factor * streams[column.source][1] for column in there]
            for column, values in zip(there[1:], rows[1:], strict=True) if kind == "csv" else ():
                if _contradict(rows[0], values, angle=SIGNAL_UNITS.get(name) == "rad"):
                    raise RecordingError(
                        f"{path}: columns of `{name}` must agree, got {there[0].source} and "
                        f"{column.source}: --column {name}=COLUMN:UNIT chooses one."
                    )
            if there:
                signals[name] = clock.factor * streams[there[0].source][0], rows[0]
        return kind, signals, vehicle, [name for name in header if name not in sources]

    return _confined(path, kind, read)


def _contradict(values: FloatArray, others: FloatArray, *, angle: bool) -> bool:
    """Whether two columns differ in the median by over 1 %, apart from whole turns of angles."""
    both = (np.abs(values) < 1e9) & (np.abs(others) < 1e9)  # NaN counts as no contradiction
    values, others = values[both], others[both]
    gap = values - others
    if angle:
        gap = np.remainder(gap + math.pi, math.tau) - math.pi
    return bool(both.any() and np.median(np.abs(gap)) > 0.01 * np.abs(values).max())


def read_parameters(path: Path) -> tuple[dict[str, float], str, str] | None:
    """Last values of the parameters in a log, vehicle and version; None for another file."""
    kind = _kind_of(path)
    if kind not in _PARAMETERS:
        return None
    need(f"a log of kind {kind}", "pyulog" if kind == "ULog" else "pymavlink")
    return _confined(path, kind, partial(_PARAMETERS[kind], path))


def _confined(path: Path, kind: str, read: Callable[[], Any]) -> Any:
    """The result of a reader in a copy of this process; RecordingError if it fails."""

    def confined(_: object) -> Any:
        _confine(patience)
        try:
            return read()
        except OWN as error:
            *_, (frame, _) = traceback.walk_tb(error.__traceback__)
            if frame.f_globals.get("__name__") != __name__:
                raise
            raise _OwnFaultError(f"{path}: {type(error).__name__}: {error}") from error

    patience = PATIENCE_S + PATIENCE_PER_BYTE * path.stat().st_size
    try:
        result, ended, _ = apart(confined, WAITING * patience)
    except (InputError, _OwnFaultError):
        raise
    except MemoryError as error:
        raise RecordingError(
            f"{path}: must be read in {LOG.unpacked / 1e6:g} MB, got a log that takes more."
        ) from error
    except Exception as error:
        got = f"{type(error).__name__}: {first_line(error)}"
        raise RecordingError(
            f"{path}: must be a {kind} log, got a damaged one, or one of a form that "
            f"is not known ({got})."
        ) from error
    if ended:
        if ended.endswith(signal.SIGPROF.name):
            ended = f"did not end within {patience:.2g} s of processor time"
        raise RecordingError(f"{path}: must be a {kind} log, got one whose reader {ended}.")
    return result


def _confine(patience: float) -> None:
    """Bound memory and processor time (s) of this copy, and discard the output of libraries."""
    import resource  # Windows lacks the module

    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_PROF, patience)
    used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = used * resource.getpagesize() + LOG.unpacked
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (most if hard < 0 else min(most, hard), hard))
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)


def _by_topic(sources: Sequence[str]) -> dict[str, dict[str, str]]:
    """Sources by topic and field."""
    fields: dict[str, dict[str, str]] = defaultdict(dict)
    for source in sources:
        topic, _, field = source.partition(".")
        fields[topic][field] = source
    return fields


def _read_ulog(path: Path, sources: Sequence[str]) -> tuple[dict[str, Stream], str]:
    from pyulog import ULog

    fields, streams = _by_topic(sources), {}
    log = ULog(str(path), [*fields], True)
    for data in sorted(log.data_list, key=lambda data: -data.multi_id):  # the first stays
        t = 1e-6 * data.data["timestamp"].astype(float)
        for field in fields[data.name].keys() & data.data.keys():
            streams[fields[data.name][field]] = t, data.data[field].astype(float)
    return streams, ""


# Topic, time (s) and content of a message; without a topic, the name of the vehicle.
Message: TypeAlias = tuple[str, float, Any]


def _dataflash_log(path: Path) -> Any:
    """A DataFlash log, also if converted to text."""
    from pymavlink.DFReader import DFReader_binary, DFReader_text

    with path.open("rb") as file:
        reader = DFReader_text if file.read(4) == b"FMT," else DFReader_binary
    return reader(str(path), zero_time_base=True)


def _dataflash(path: Path, topics: Collection[str]) -> Iterator[Message]:
    log, first = _dataflash_log(path), {}
    while (message := log.recv_match(type=[*topics, "MSG"])) is not None:
        topic = message.get_type()
        if topic == "MSG":
            text = str(message.Message).replace("APM:", "Ardu")  # name in logs before 2016
            yield "", 0.0, text.split()[0] if text.startswith("Ardu") else ""
            continue
        instance = message.fmt.instance_field
        number = getattr(message, instance) if instance else None
        if first.setdefault(topic, number) == number:
            yield topic, _dataflash_clock(message), message


def _dataflash_clock(message: Any) -> float:
    """Time since boot, s. Logs before 2015 have ms; their GPS messages have it as ``T``."""
    if (stamp := getattr(message, "TimeUS", None)) is not None:
        return 1e-6 * stamp
    named = (getattr(message, name, None) for name in ("T", "TimeMS"))
    return 1e-3 * next((stamp for stamp in named if stamp is not None), math.nan)


def _mavlink(path: Path, topics: Collection[str]) -> Iterator[Message]:
    from pymavlink.mavutil import mavlogfile

    log, system, clock = mavlogfile(str(path)), None, math.nan
    while (message := log.recv_msg()) is not None:
        topic = message.get_type()
        other = topic == "HEARTBEAT" and message.autopilot == 8  # a message of a camera or a radio
        if topic == "HEARTBEAT" and not other and system is None:
            system = message.get_srcSystem()
            yield "", 0.0, f"type {message.type}"
        if topic in topics and not other and system in (None, message.get_srcSystem()):
            # The time stamp of the file comes from the ground station, where messages arrive in
            # bursts. A message without the vehicle's clock was sent with the message before.
            clock = 1e-3 * getattr(message, "time_boot_ms", 1e3 * clock)
            yield topic, clock, message


def _read_messages(
    messages: Callable[[Path, Collection[str]], Iterator[Message]],
    path: Path,
    sources: Sequence[str],
) -> tuple[dict[str, Stream], str]:
    """Streams of messages, and the vehicle; a field that a message lacks is left out."""
    fields, vehicle = _by_topic(sources), ""
    t: dict[str, list[float]] = defaultdict(list)
    values: dict[str, list[float]] = defaultdict(list)
    for topic, stamp, message in messages(path, fields):
        if not topic:
            vehicle = vehicle or message
            continue
        for field, source in fields[topic].items():
            value = getattr(message, field, None)
            t[source].append(stamp)
            values[source].append(float(value) if isinstance(value, int | float) else math.nan)
    streams = {source: (np.array(t[source]), np.array(values[source])) for source in values}
    return {x: stream for x, stream in streams.items() if not np.isnan(stream[1]).all()}, vehicle


def _table(path: Path, **options: Any) -> Any:
    """Columns of a table; JSBSim's socket sends a mark before its labels but not before rows."""
    import pandas as pd

    encoding = _encoding(path)
    with path.open(encoding=encoding) as file:
        first, row = file.readline(), file.readline()
    mark = max(",;\t", key=first.count)
    form = {"sep": mark, "skipinitialspace": True, "encoding": encoding}
    labels = [str(name) for name in pd.read_csv(path, nrows=0, **form).columns]
    names = [label.strip() for label in labels]
    mark_of_socket = names[:1] == ["<LABELS>"]
    if mark_of_socket or names != labels:
        options |= {"names": names[mark_of_socket:], "header": None, "skiprows": 1}
    if (cells := len(row.rstrip(f"{mark}\r\n ").split(mark))) > len(names) and '"' not in row:
        raise InputError(
            f"{path}: its first line must have a label for each cell of a row, got {len(names)} "
            f"labels and {cells} cells; with decimal commas, semicolons must be between cells."
        )
    table = pd.read_csv(path, **form, **options)
    if mark == ";":  # commas are decimal then
        table = table.replace({r"^(.*),(.*)$": r"\1.\2"}, regex=True)
    return table


def _encoding(path: Path) -> str:
    """Encoding of a table by its labels: UTF-8, UTF-16 with a mark, or else Latin-1."""
    with path.open("rb") as file:
        first = file.readline()
    if first.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        return "utf-16"
    try:
        first.decode("utf-8")
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8-sig"


def _read_csv(path: Path, sources: Sequence[str]) -> tuple[dict[str, Stream], str]:
    import pandas as pd

    rows = LOG.entries // len(sources)
    table = _table(path, usecols=sources, nrows=rows, dtype_backend="numpy_nullable")
    values = {
        name: pd.to_numeric(table[name], errors="coerce").to_numpy(float, na_value=np.nan)
        for name in sources
    }
    clock, t = table[sources[0]], values[sources[0]]
    if np.isfinite(t).sum() < 0.5 * clock.count():  # the column has dates
        # Day and month are read in the order that makes the log complete and short.
        readings = (pd.to_datetime(clock, errors="coerce", dayfirst=x) for x in (False, True))
        stamps = min(readings, key=lambda t: (t.isna().sum(), t.max() - t.min()))
        t = ((stamps - stamps.min()) / pd.Timedelta(seconds=1)).to_numpy(float)
    return {name: (t, column) for name, column in values.items()}, ""


def _ulog_parameters(path: Path) -> tuple[dict[str, float], str, str]:
    from pyulog import ULog

    log = ULog(str(path), [], True)
    changed = {name: value for _, name, value in log.changed_parameters}
    *numbers, kind = log.get_version_info() or ("", 255)
    stage = next(name for least, name in STAGES if kind >= least)
    return log.initial_parameters | changed, "", f"{'.'.join(map(str, numbers))} {stage}".strip()


def _dataflash_parameters(path: Path) -> tuple[dict[str, float], str, str]:
    log, values, vehicle = _dataflash_log(path), {}, ("", "")
    while (message := log.recv_match(type=["PARM", "MSG"])) is not None:
        if message.get_type() == "PARM":
            values[str(message.Name)] = float(message.Value)
        elif str(message.Message).startswith("Ardu"):
            vehicle = (*str(message.Message).split(), "")[:2]
    return values, vehicle[0], vehicle[1].removeprefix("V")


def _mavlink_parameters(path: Path) -> tuple[dict[str, float], str, str]:
    components: dict[int, dict[str, float]] = defaultdict(dict)
    vehicle = ""
    for topic, _, message in _mavlink(path, ["PARAM_VALUE"]):
        if not topic:
            vehicle = f"MAV_{message.upper()}"
            continue
        value, whole = message.param_value, message.param_type < MAV_PARAM_TYPE_REAL32
        if whole and not value.is_integer():  # PX4 sends the bytes of an integer
            (value,) = struct.unpack("<i", struct.pack("<f", value))
        components[message.get_srcComponent()][message.param_id] = float(value)
    # The autopilot is component 1; a camera or gimbal has parameters of its own.
    return components[min(components, default=1)], vehicle, ""


_PARAMETERS = {
    "ULog": _ulog_parameters,
    "DataFlash": _dataflash_parameters,
    "MAVLink": _mavlink_parameters,
}

_READERS = {
    "ULog": _read_ulog,
    "DataFlash": partial(_read_messages, _dataflash),
    "MAVLink": partial(_read_messages, _mavlink),
    "csv": _read_csv,
}
