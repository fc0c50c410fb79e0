"""Parameters of an autopilot, from the file of a ground station or from a log, as a law."""

import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from flighttune.base.errors import InputError, naming
from flighttune.base.files.table import abridged
from flighttune.base.words import listed
from flighttune.control.laws.autopilot import Autopilot, guidance, period_among
from flighttune.logs.parameter_file import number_text, read_text
from flighttune.logs.read import read_parameters

# Aeroplanes and VTOLs, by their MAV_TYPE or name in QGroundControl's files and in logs.
WITH_WINGS = re.compile(r"fixed.?wing|vtol|plane|MAV_TYPE (1|19|2[0-5])$", re.IGNORECASE)

# Prefixes of parameters that only other kinds of vehicles have. ArduPlane's parameters for hover
# begin with Q_; a VTOL of PX4 has a copter's parameters.
OF_OTHERS = {
    "a rover or boat": (
        "CRUISE_SPEED", "CRUISE_THROTTLE", "TURN_RADIUS", "TURN_MAX_G", "STEER2SRV_", "ATC_STR_",
        "ATC_SPEED_", "ATC_BRAKE", "ATC_TURN_", "WP_PIVOT_", "SAIL_", "BAL_", "GND_L1_", "RD_",
        "RO_", "MODE1", "MODE_CH",
    ),
    "a submarine": ("JS_GAIN", "JS_LIGHTS", "SURFACE_DEPTH", "FRAME_CONFIG", "UUV_", "FS_LEAK"),
    "a copter": (
        "ATC_RAT_", "ATC_ANG_", "PSC_", "WPNAV_", "MOT_SPIN", "PILOT_SPEED", "LOIT_SPEED", "PHLD_",
        "MPC_", "MC_",
    ),
    "a copter or rover": ("FRAME_CLASS", "FRAME_TYPE"),
}  # fmt: skip
OF_COPTERS_OF_PX4, OF_VTOLS_OF_PX4 = ("MPC_", "MC_"), ("VT_",)

# PX4 builds that ignore NPFG_PERIOD and NPFG_DAMPING: from pull request 24056 (May 2025) to 26765
# (March 2026), with versions before 1.17.0, and the values that they use instead.
UNFINISHED = re.compile(r"v?1\.17\b.*(dev|alpha|beta)", re.IGNORECASE)
HELD = {"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7071}

# Beginning of a version, and the last version of PX4 that flies L1.
VERSION, LAST_L1 = re.compile(r"v?(\d+)\.(\d+)"), (1, 13)

# Major and minor number of a version, and the end of an open range of versions.
Version: TypeAlias = tuple[int, int]
NO_END: Version = (999, 0)

# Largest limit of roll or pitch, deg.
RIGHT_ANGLE_DEG = 90.0


class Flown(NamedTuple):
    """The guidance that a user flies now."""

    law: Autopilot  # with the parameters that it uses
    name: str  # guidance, autopilot and version in words
    # every used parameter, with its ``value``, its published ``range`` and its source ``from``
    rows: list[dict[str, Any]]
    unused: list[str]  # other parameters of the guidance
    rest: int  # number of parameters in the file that do not belong to the guidance
    notes: list[str]  # sentences about changes by the version, and about gaps in the file
    beyond: list[str]  # parameters beyond their published ranges, with value and range
    airspeed: (
        tuple[str, float] | None
    )  # parameter of the airspeed that it flies, and its value, m/s
    older_tecs: bool  # whether the autopilot has a TECS before the emulated one


def flown_now(path: str | Path, version: str | None = None) -> Flown:
    """The guidance of a parameter file or log; `version`: the autopilot's, if the file has none."""
    path = Path(path)
    if not os.path.isfile(path):
        raise InputError(f"{path}: must be a file of parameters or a log, got no such file.")
    logged = read_parameters(path)
    values, vehicle, stated, others = read_text(path) if logged is None else (*logged, {})
    if version and not VERSION.match(version):
        raise InputError(f"{path}: `version` must be such as 1.15, got {abridged(version)}.")
    if not version:  # QGroundControl writes -1.-1.-1 or 0.0.0 for an unknown one
        version = stated if VERSION.match(stated) and _version(stated) > (0, 0) else ""
    period = _period(path, values, vehicle, version)
    table = guidance()[period]
    defaults = {name: x for name, x, *_ in table["parameters"]}
    used, beyond = _used(path, values, table)
    autopilot, _ = table["source"].split()
    notes = [*_contradictions(values, others, table)]
    if period == "NPFG_PERIOD" and not version:
        raise InputError(
            f"{path}: `version` must be given, as by --version 1.15: the file has none, and some "
            "builds of PX4 1.17 fly NPFG without NPFG_PERIOD."
        )
    if period == "NPFG_PERIOD" and UNFINISHED.match(version):
        used |= {name: (value, f"PX4 {version}") for name, value in HELD.items()}
        notes.append(
            f"PX4 {version}: builds from May 2025 to March 2026 (pull requests 24056 to 26765) do "
            "not use NPFG_PERIOD and NPFG_DAMPING; 10 s and 0.7071 fly in their place. If yours is "
            "later, state `version` 1.17.0."
        )
    missing = f"default of {table['source']}"
    if period not in used:
        used[period] = defaults[period], missing
        notes.append(
            f"{period} is not in the file: its default in {table['source']}, {defaults[period]:g} "
            f"s, flies, as those of {len(defaults.keys() - used.keys())} others."
        )
    rows = _rows(table, used, missing)
    law = Autopilot(name="yours", parameters={name: x for name, (x, _) in used.items()})
    with naming(path):
        _ = law.roles
    told = _told(path, values, version, table)
    notes += _of_version(told, values, table)
    of_guidance = {name for name in values if name.startswith(tuple(table["group"]))}
    airspeed = _airspeed(values, table)
    flown = {*used, *table.get("former", {}), *(airspeed or ())[:1]}
    unused = sorted(of_guidance - flown)
    rest = len(values.keys() - of_guidance - used.keys())
    name = f"{table['law']} and TECS of {autopilot} {told.words}"
    older = told.older(table)
    return Flown(law, name, rows, unused, rest, notes, beyond, airspeed, older_tecs=older)


def _airspeed(values: Mapping[str, float], table: Mapping[str, Any]) -> tuple[str, float] | None:
    """The parameter of the airspeed that an autopilot flies and its value, m/s; None without it."""
    stated = ((name, values[name] * by) for name, by in table["airspeed"].items() if name in values)
    return next(((name, V) for name, V in stated if 0.0 < V < math.inf), None)


class Told(NamedTuple):
    """The version of an autopilot: stated, or between those that the names in a file tell."""

    words: str
    oldest: Version
    newest: Version

    def older(self, table: Mapping[str, Any]) -> bool:
        """Whether its TECS is older than the emulated one."""
        return self.newest < _version(table["versions"][0])


def _told(path: Path, values: Iterable[str], version: str, table: Mapping[str, Any]) -> Told:
    """The version; InputError if neither it is stated nor its names tell which TECS flies."""
    if version:
        return Told(version, _version(version), _version(version))
    since = {name: x for name, x in table["since"].items() if name in values}
    until = {name: x for name, x in table["until"].items() if name in values}
    oldest = max(since.values(), key=_version, default="0.0")
    newest = min(until.values(), key=_version, default="")
    words = f"{oldest} or newer"
    if newest:
        words = newest if newest == oldest else f"{newest} or older"
    told = Told(words, _version(oldest), _version(newest) if newest else NO_END)
    if told.older(table) or told.oldest >= _version(table["versions"][0]):
        return told
    (autopilot, example), known = table["source"].split(), table["versions"][0]
    telling = next(name for name, first in table["since"].items() if first == known)
    has = "neither a version nor"
    if until:  # names that only older versions have
        example, has = newest, f"{listed(sorted(until))} of {autopilot} {newest} or older, but not"
    raise InputError(
        f"{path}: `version` must be given, as by --version {example}: the file has {has} a name "
        f"such as {telling} that tells {autopilot} {known} or newer from one with an older TECS."
    )


def _version(text: str) -> Version:
    """The first two numbers of a version."""
    number = VERSION.match(text)
    assert number  # it is checked where it is read
    return int(number[1]), int(number[2])


def _of_version(told: Told, values: Mapping[str, float], table: Mapping[str, Any]) -> Iterator[str]:
    """Sentences about a version that the emulation does not follow, or that names contradict."""
    autopilot, _ = table["source"].split()
    _, newest = table["versions"]
    if told.newest != NO_END and told.oldest > _version(newest):
        yield (
            f"{autopilot} {told.words} is newer than {newest}, the newest that the emulation "
            "follows."
        )
    if told.older(table):
        lost = " FW_T_TIME_CONST, the time in which its pitch mends the balance of energy, has no "
        lost = f"{lost}counterpart in it." * ("FW_T_TIME_CONST" in values)
        yield f"{autopilot} {told.words} has an older TECS; that of {table['source']} flies.{lost}"
    ends = ("since", "or newer"), ("until", "or older")
    for (key, word), beyond in zip(ends, (told.newest.__lt__, told.oldest.__gt__), strict=True):
        against: dict[str, list[str]] = {}
        for name, version in table[key].items():
            if name in values and beyond(_version(version)):
                against.setdefault(version, []).append(name)
        for version, names in against.items():
            verb = "are" if len(names) > 1 else "is"
            of = f"{autopilot} {version} {word}"
            yield f"{listed(names)} {verb} of {of}: is {told.words} your version?"


def _rows(
    table: Mapping[str, Any], used: Mapping[str, tuple[float, str]], missing: str
) -> list[dict[str, Any]]:
    """Each parameter of the used guidance: its value, source and range."""
    return [
        {
            "name": name,
            **dict(zip(("value", "from"), used.get(name, (x, missing)), strict=True)),
            "range": _range_words(unit, low, high),
        }
        for name, x, _, unit, low, high in table["parameters"]
    ]


def _period(path: Path, values: Mapping[str, float], vehicle: str, version: str) -> str:
    """The period parameter of the used guidance; InputError without it."""
    stated = vehicle or "plane", f"MAV_TYPE {values.get('MAV_TYPE', 1):g}"
    got = next((x for x in stated if not WITH_WINGS.search(x)), "")
    tables = guidance()
    ours = {
        autopilot: {
            name
            for table in tables.values()
            if table["source"].startswith(autopilot)
            for name in values
            if name.startswith(tuple(table["group"]))
        }
        for autopilot in ("ArduPilot", "PX4")
    }
    own = set[str]().union(*ours.values())
    vtol = OF_COPTERS_OF_PX4 if _beginning(values, OF_VTOLS_OF_PX4) else ()
    no_vtol = [name for name in values if not name.startswith(vtol)]
    others = {kind: _beginning(no_vtol, names) for kind, names in OF_OTHERS.items()}
    kind = max(others, key=lambda kind: len(others[kind]))
    # Rovers and boats also have the period of L1.
    if not got and len(others[kind]) > len({x for x in own if not x.startswith("NAVL1_")}):
        some = listed(others[kind], most=3)
        own = {name for name in own if not name.startswith("NAVL1_")}
        beside = f" beside {listed(sorted(own), most=3)} of an aeroplane" if own else ""
        got = f"{some} of {kind}{beside}"
    if not got and not own:
        groups = ", ".join(tables)
        got = f"none of {groups} in {len(values)} parameters"
    if got:
        raise InputError(f"{path}: must have the parameters of an aeroplane, got {got}.")
    if all(ours.values()):
        both = (f"{min(names)} of {autopilot}" for autopilot, names in ours.items())
        raise InputError(
            f"{path}: must have the parameters of one autopilot, got {' and '.join(both)}."
        )
    if period := period_among(values):
        return period
    if ours["ArduPilot"]:
        return "NAVL1_PERIOD"
    if not version:
        raise InputError(
            f"{path}: `version` must be given, as by --version 1.15: the file has neither "
            "NPFG_PERIOD nor FW_L1_PERIOD, which tell PX4 with NPFG from one with L1."
        )
    former = _version(version) <= LAST_L1 and not values.get("FW_USE_NPFG")
    return "FW_L1_PERIOD" if former else "NPFG_PERIOD"


def _beginning(values: Iterable[str], beginnings: tuple[str, ...]) -> list[str]:
    return sorted(name for name in values if name.startswith(beginnings))


def _used(
    path: Path, values: Mapping[str, float], table: Mapping[str, Any]
) -> tuple[dict[str, tuple[float, str]], list[str]]:
    """Parameters of the guidance with their sources, and parameters beyond their ranges."""
    ranges = {name: (unit, low, high) for name, _, _, unit, low, high in table["parameters"]}
    # By present name: value in its unit, name in the file, and conversion factor.
    found = {
        now: (values[was] * by, was, by)
        for was, (now, by) in table.get("former", {}).items()
        if was in values
    }
    found |= {name: (values[name], name, 1.0) for name in ranges if name in values}
    beyond, far = [], []
    for now, (value, name, by) in found.items():
        unit, low, high = ranges[now]
        published, wide = _range_words(unit, low, high), high - low
        words = f"{name} {number_text(values[name])}{f' ({value:g} {unit})' if by != 1.0 else ''}"
        if by != 1.0 and 0.0 < abs(values[name]) <= RIGHT_ANGLE_DEG:
            far.append(f"{words}, which is in hundredths of a degree: in degrees it is {now}")
        elif not low - wide <= value <= high + wide and math.isfinite(value):
            hint = _in_hundredths(unit, value, low, high) if by == 1.0 else ""
            far.append(f"{words} ({published}{hint})")
        elif not low <= value <= high:
            beyond.append(f"{words} ({published})")
    if far:
        raise InputError(
            f"{path}: parameters must be near their published ranges, got {listed(far)}: is a "
            "decimal point lost, or the unit another one?"
        )
    return {now: (value, path.name) for now, (value, _, _) in found.items()}, beyond


def _in_hundredths(unit: str, value: float, low: float, high: float) -> str:
    """An angle read in hundredths of a degree, if it then fits its range."""
    fits = unit == "deg" and abs(value) > RIGHT_ANGLE_DEG and low <= 0.01 * value <= high
    return f"; {0.01 * value:g} in hundredths of a degree" if fits else ""


def _range_words(unit: str, low: float, high: float) -> str:
    of = f" {unit}" if unit != "1" else ""
    return f"{low:g} to {high:g}{of}" if high < math.inf else f"at least {low:g}{of}"


def _contradictions(
    values: Mapping[str, float], others: Mapping[str, list[str]], table: Mapping[str, Any]
) -> Iterator[str]:
    """Sentences about parameters that the file states more than once."""
    for name, stated in others.items():
        if name.startswith(tuple(table["group"])):
            used = f"{values[name]:g} is used" if name in values else "none is used"
            yield f"{name} is also {listed(stated)}: {used}."
    for was, (now, by) in table.get("former", {}).items():
        if was in values and now in values and values[was] * by != values[now]:
            yield f"{was} is {values[was]:g} and {now} {values[now]:g}: {now} is used."
