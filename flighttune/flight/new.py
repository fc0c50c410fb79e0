"""A new scenario as a file: a first manoeuvre of an aircraft."""

import math
import os
import shlex
from pathlib import Path
from typing import Any

import tomlkit

from flighttune.base.errors import InputError, OutputError
from flighttune.base.files.shipped import SCHEMAS
from flighttune.base.files.whole import together, write_text
from flighttune.base.units import DEG, G_PAPER, Degrees, Seconds
from flighttune.base.words import pick
from flighttune.control.gains_keys import FIRST_FOUND
from flighttune.flight.load import load_scenario
from flighttune.flight.models import with_found_gains
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, load_aircraft
from flighttune.vehicles.identification.file import load_identified, rounded
from flighttune.vehicles.plants.jsbsim.trim import level

AIRCRAFT = "aerosonde"

# deg: climb of the first manoeuvre; without an engine, the increase of the glide angle.
CLIMB = 3.0

TURN = 30.0  # deg: turn of the first manoeuvre

REST = 4.0  # s: flight after it

# Significant digits of computed values.
DIGITS = 5

# The schema beside a new scenario, with which editors complete and check it: its place in the file
# then names no folder of this machine.
SCHEMA = ".flighttune/scenario.json"

# A first scenario with next steps; `_first` fills in values of the aircraft.
TEMPLATE, NEXT_HEAD, NEXT = (
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8").partition("\n# What to do next")
)


def new_scenario(
    name: str,
    *,
    aircraft: str | None = None,
    overshoot: Degrees | None = None,
    settle: Seconds | None = None,
) -> Path:
    """Write a scenario that an aircraft can fly to ``NAME.toml``, and return the file.

    Parameters
    ----------
    name : str
        The scenario to write, to NAME.toml.
    aircraft : str, optional
        Aircraft that flies, by name or folder, by default aerosonde.
    overshoot : float, deg, optional
        Maximum overshoot of course and path angle, by default 5 and 3.
    settle : float, s, optional
        Maximum settling time of course and path angle, to 5 %. Both are then steps.

    Its gains are the first that tuning finds of ``tuned_fed_back`` and ``tuned_identified``.

    Raises OutputError if the file exists, InfeasibleError if tuning finds no gains, and InputError
    if the aircraft does not exist or cannot fly it, a requirement is not positive, or the name is
    empty or has a control character.
    """
    if not name.isprintable():
        raise InputError(f"`NAME` must have printable characters only, got {name!r}.")
    stem = name.removesuffix(".toml")
    if not os.path.basename(stem).strip(" ."):
        raise InputError(f"`NAME` must be that of a file, got {name!r}.")
    file = Path(f"{stem}.toml")
    with together(file.parent):
        return _written(file, aircraft, overshoot, settle)


def _written(
    file: Path, aircraft: str | None, overshoot: Degrees | None, settle: Seconds | None
) -> Path:
    if os.path.exists(file):  # false for a name that is too long, which writing reports
        raise OutputError(f"{file}: must be a new file, there is one already; give another NAME.")
    if aircraft is not None and os.path.isfile(Path(aircraft) / "aircraft.toml"):
        aircraft = str(Path(aircraft).resolve())
    for option, value in (("overshoot", overshoot), ("settle", settle)):
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"`--{option}` must be positive and finite, got {value:g}.")
    document = _first(aircraft or AIRCRAFT, file.parent)
    names = {"name": shlex.quote(str(file)), "run": shlex.quote(f"runs/{file.stem}")}
    text = f"#:schema {SCHEMA}\n{_requiring(document, overshoot, settle)}"
    text += (NEXT_HEAD + NEXT).format(**names)
    write_text(file, text)
    if (found := with_found_gains(load_scenario(file)).gains[0]) != FIRST_FOUND[0]:
        first, other = (f'gains    = ["{name}"] ' for name in (FIRST_FOUND[0], found))
        assert first in text  # of the template
        write_text(file, text.replace(first, other, 1).replace(f'also "{found}"', "others"))
    shipped = (SCHEMAS / "scenario.json").read_text(encoding="utf-8")
    write_text(file.parent / SCHEMA, shipped)
    return file


def _fill_from_logs(document: Any, aircraft: str, folder: Path) -> None:
    """Put the values of a model identified from logs into the template."""
    identified = load_identified(aircraft)
    log, condition = identified.log, identified.conditions[0]
    if log is None:
        raise InputError(f"{aircraft}: must be identified from logs; others are in their aircraft.")
    document["flight"].update({"V_a_mps": rounded(condition.V_a, 4), "h_m": condition.h})
    document["flight"].comment(f"start: as in {log.logs[0]}")
    document["reference"].update({"chi_deg": TURN, "gamma_deg": CLIMB})
    ends = {"phi_deg": [*log.phi_deg], "n_z": [*log.n_z]}
    limits = document["limits"]
    limits.update(rounded({**ends, **pick(log, "phi_rate_dps n_z_rate_per_s")}, 3))
    limits.comment("as seen in the logs")
    document["plant"].pop()
    document["controller"].pop("speed_priority")
    plant = tomlkit.table()
    plant.update({"kind": "point_mass_lag", "identified": os.path.relpath(aircraft, folder)})
    if identified.assumptions:
        plant["identified"].comment(" ".join(identified.assumptions))
    document["plant"].append(plant)


def _first(aircraft: str, folder: Path) -> Any:
    """The template with the values of an aircraft, as TOML values because texts may have quotes."""
    document: Any = tomlkit.parse(TEMPLATE)
    flight, limits, plants = document["flight"], document["limits"], document["plant"]
    climb, change = "climb", CLIMB
    # The plant of a model from logs is a point mass behind its lags.
    if Path(aircraft).suffix.lower() == ".json":
        _fill_from_logs(document, aircraft, folder)
    else:
        config = load_aircraft(aircraft)
        own, (low, high) = config.limits, config.envelope.V_a
        V_a, h = (low + high) / 2.0, 1000.0
        if config.design is not None:
            V_a, h = config.design.V_a, config.design.h
        if not config.engines.count:
            climb, change = "descend", -CLIMB
            document["controller"].pop("speed_priority")
        start = level(config, V_a, h).gamma / DEG
        flight.comment(f"start: {config.title}")
        flight.update(rounded({"V_a_mps": V_a, "h_m": h, "gamma_deg": start}, DIGITS + 1))
        flight["V_a_mps"].comment(f"the aircraft flies {low:g} to {high:g} m/s")
        ramps = _first_ramps(config, V_a, change)
        for key, ramp in ramps.items():
            table = tomlkit.inline_table()
            table.update(ramp)
            document["reference"][key].append(table)
        # At rest for some seconds at the end but no longer, because a glider accelerates on a
        # steeper glide.
        rest = max(r["start_s"] + r["duration_s"] + 0.5 * r["roll_in_s"] for r in ramps.values())
        flight["duration_s"] = max(flight["duration_s"], math.ceil(rest + REST))
        ends = {"phi_deg": [x / DEG for x in own.phi], "n_z": [*own.n_z]}
        rates = {"phi_rate_dps": own.phi_rate / DEG, "n_z_rate_per_s": own.n_z_rate}
        limits.update(rounded({**ends, **rates}, DIGITS))
        beside = os.path.relpath(aircraft, folder) if os.path.isabs(aircraft) else aircraft
        plants[1]["aircraft"] = beside
    document["title"] = f"Turn right by {TURN:g} deg and {climb} by {CLIMB:g} deg"
    document["verifies"] = f"the aircraft turns and {climb}s with little overshoot, and settles"
    return document


def _requiring(document: Any, overshoot: float | None, settle: float | None) -> str:
    """A first scenario with the given requirements of course and path angle."""
    if settle is not None:
        # Ramps are followed almost without error, so steps of the same size must settle.
        reference, flight = document["reference"], document["flight"]
        for key, value in reference.items():
            if isinstance(value, list):
                change = sum(ramp["rate_dps"] * ramp["duration_s"] for ramp in value)
                reference[key] = rounded(float(change), 2)
        reference["gamma_deg"] += flight["gamma_deg"]
        flight["duration_s"] = max(flight["duration_s"], 5.0 * settle)
    head, _, _ = tomlkit.dumps(document).partition("at_most.")
    lines = [
        f"at_most.{channel}.{measure} = {value:g}"
        for channel, most in (("chi", 5.0), ("gamma", 3.0))
        for measure, value in (
            ("MO_deg", most if overshoot is None else overshoot),
            ("ST_deg", 0.5) if settle is None else ("settling_s", settle),
        )
    ]
    return head + "\n".join(lines) + "\n"


def _first_ramps(config: AircraftConfig, V_a: float, climb: float) -> dict[str, Any]:
    """A turn and a climb (deg) that roll in, with shares of the aircraft's limits."""
    limits, ramps = config.limits, {}
    for key, change, load, load_rate in (
        ("chi_deg", TURN, math.tan(0.6 * limits.phi[1]), limits.phi_rate),
        ("gamma_deg", climb, 0.3 * (limits.n_z[1] - 1.0), limits.n_z_rate),
    ):
        # During the roll-in the command changes at up to 0.6 of its rate limit. The roll-in takes
        # at most half of the ramp, so a small change has a small rate.
        roll_in = load / (0.6 * load_rate)
        rate = math.copysign(load * G_PAPER / V_a / DEG, change)
        duration = max(change / rate, 2.0 * roll_in)
        values = {
            "start_s": max(2.0, 0.51 * roll_in),  # half of the roll-in lies before it
            "duration_s": duration,
            "rate_dps": change / duration,
            "roll_in_s": roll_in,
        }
        ramps[key] = {"shape": "ramp", **rounded(values, DIGITS)}
    return ramps
