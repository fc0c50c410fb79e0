"""Parameters of an autopilot, from the file of a ground station or from a log, as a law."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from flighttune.control.laws.autopilot import Autopilot, guidance, period_among
from flighttune.errors import InputError, naming
from flighttune.files.whole import reason_of
from flighttune.logs.read import read_parameters

# Aeroplanes and VTOLs in the head of files of QGroundControl and in logs, with their MAV_TYPE.
WITH_WINGS = re.compile(r"fixed.?wing|vtol|plane|MAV_TYPE (1|19|2[0-5])$", re.IGNORECASE)

# Beginnings of the names of parameters that only multicopters use.
OF_COPTERS = ("MPC_", "MC_ROLL", "ATC_", "PSC_", "WPNAV_", "MOT_SPIN")

# PX4 without a gain of NPFG_PERIOD and NPFG_DAMPING: builds from its pull request 24056 (May 2025)
# to 26765 (March 2026), whose versions are those before 1.17.0, and what they fly in their place.
UNFINISHED = re.compile(r"v?1\.17\b.*(dev|alpha|beta)", re.IGNORECASE)
OLD_TECS = re.compile(r"v?1\.(\d|1[0-2])(\.|$)")
HELD = {"NPFG_PERIOD": 10.0, "NPFG_DAMPING": 0.7071}


class Flown(NamedTuple):
    """The guidance that a user flies now."""

    law: Autopilot  # by the parameters that it uses
    name: str  # guidance, autopilot and version in words
    rows: list[dict[str, Any]]  # every parameter used, with its ``value`` and where it is ``from``
    unused: list[str]  # other parameters of the guidance
    rest: int  # number of the parameters of the file that are of no guidance
    notes: list[str]  # sentences about what the version changes


def flown_now(path: str | Path, version: str | None = None) -> Flown:
    """The guidance of a parameter file or log; `version` of the autopilot where it says none."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: must be a file of parameters or a log, got no such file.")
    values, vehicle, stated = read_parameters(path) or _read_text(path)
    version = version or stated
    _check_wings(path, values, vehicle)
    period = period_among(values)
    table = guidance()[period]
    former = table.get("former", {})
    renamed = {now: (values[was] * by, was) for was, (now, by) in former.items() if was in values}
    own = ((name, (values[name], path.name)) for name, *_ in table["parameters"] if name in values)
    used = renamed | dict(own)
    autopilot, of_source = table["source"].split()
    notes = []
    if period == "NPFG_PERIOD" and not version:
        raise InputError(
            f"{path}: `version` must be given, such as 1.15: the file has none, and some builds of "
            "PX4 1.17 fly NPFG without NPFG_PERIOD."
        )
    if period == "NPFG_PERIOD" and UNFINISHED.match(version):
        used |= {name: (value, f"PX4 {version}") for name, value in HELD.items()}
        notes.append(
            f"PX4 {version}: builds from May 2025 to March 2026 (pull requests 24056 to 26765) do "
            "not use NPFG_PERIOD and NPFG_DAMPING; 10 s and 0.7071 fly in their place. If yours is "
            "later, state `version` 1.17.0."
        )
    if autopilot == "PX4" and OLD_TECS.match(version):
        lost = " FW_T_TIME_CONST, the time in which its pitch mends the balance of energy, has no "
        lost = f"{lost}counterpart in it." * ("FW_T_TIME_CONST" in values)
        notes.append(f"PX4 {version} has an older TECS; that of {table['source']} flies.{lost}")
    missing = f"default of {table['source']}"
    rows = [
        {"name": name, **dict(zip(("value", "from"), used.get(name, (x, missing)), strict=True))}
        for name, x, _ in table["parameters"]
    ]
    law = Autopilot(name="yours", parameters={name: x for name, (x, _) in used.items()})
    with naming(path):
        _ = law.roles
    of_guidance = {name for name in values if name.startswith(tuple(table["group"]))}
    unused = sorted(of_guidance - used.keys() - {was for _, was in renamed.values()})
    name = f"{table['law']} and TECS of {autopilot} {version or f'as in {of_source}'}"
    return Flown(law, name, rows, unused, len(values.keys() - of_guidance - used.keys()), notes)


def _check_wings(path: Path, values: Mapping[str, float], vehicle: str) -> None:
    """Refuse the parameters of a vehicle without wings, and those without a guidance."""
    stated = vehicle or "plane", f"MAV_TYPE {values.get('MAV_TYPE', 1):g}"
    got = next((x for x in stated if not WITH_WINGS.search(x)), "")
    if not got and not period_among(values):
        copter = " as of a copter" if any(name.startswith(OF_COPTERS) for name in values) else ""
        got = f"none of {', '.join(guidance())} in {len(values)} parameters{copter}"
    if got:
        raise InputError(f"{path}: must have the parameters of an aeroplane, got {got}.")


def _read_text(path: Path) -> tuple[dict[str, float], str, str]:
    """Parameters, vehicle and version of a file of QGroundControl or Mission Planner."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = reason_of(error) if isinstance(error, OSError) else "a binary file"
        raise InputError(f"{path}: must be a file of parameters or a log, got {reason}.") from error
    values: dict[str, float] = {}
    head = {"Vehicle": "", "Version": ""}
    for number, line in enumerate(lines, start=1):
        text, _, comment = line.partition("#")
        key, _, value = comment.strip().partition(":")
        if key in head:
            head[key] = value.strip()
        if not (fields := re.split(r"[\s,]+", text.strip())) or not fields[0]:
            continue
        if len(fields) >= 4 and fields[0].isdigit() and fields[1].isdigit():  # QGroundControl
            fields = fields[2:]
        try:
            values[fields[0]] = float(fields[1])
        except (IndexError, ValueError):
            raise InputError(
                f"{path}: line {number} must be NAME,VALUE or VEHICLE COMPONENT NAME VALUE TYPE, "
                f"got {line[:60]!r}."
            ) from None
    return values, head["Vehicle"], head["Version"]
