"""A new scenario as a file: a first manoeuvre of an aircraft, or another scenario made for it."""

import math
import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from flighttune.aircraft.aircraft import AircraftConfig, load_aircraft
from flighttune.arrays import FloatArray
from flighttune.errors import InputError, OutputError
from flighttune.files.shipped import scenario_files
from flighttune.files.whole import write_text
from flighttune.flight.conditions import reference_of
from flighttune.flight.fly import fly
from flighttune.flight.load import load_scenario
from flighttune.identification.file import load_identified, rounded
from flighttune.plants.jsbsim.trim import level, trim_table
from flighttune.plants.label import plant_label
from flighttune.references.follow import RouteReference
from flighttune.scenario.load import GAINS_FILES, existing_file
from flighttune.scenario.route import RouteTable
from flighttune.scenario.schema import Scenario
from flighttune.units import DEG, G_PAPER

AIRCRAFT = "aerosonde"

# deg: climb of the first manoeuvre; without an engine the glide gets steeper by it.
CLIMB = 3.0

TURN = 30.0  # deg: turn of the first manoeuvre

REST = 4.0  # s: flown after it

# Significant digits of values that are computed.
DIGITS = 5

# Shares of the path angles of another scenario that are tried in turn, until the aircraft can fly
# them steadily.
SHARES = (1.0, 0.75, 0.5, 0.35, 0.25, 0.15, 0.1, 0.05)

# Margin of a route, if it is more than its own, and factor on its look-ahead: tried in turn until
# the route is flown.
ROUTES = (0.0, 1.0), (0.4, 2.0), (0.6, 3.0)

# A first scenario; `_first` replaces the values and comments that depend on the aircraft.
TEMPLATE = """\
# Units are at the end of a key; all keys: scenarios/README.md, or the page "Keys" of the docs.
title    = ""
verifies = ""
gains    = ["tuned_identified"]     # also "paper", "tuned", or a file that `tune --out` wrote

[flight]
V_a_mps    = 25.0
h_m        = 1000.0
gamma_deg  = 0.0
duration_s = 40.0

# Where to: each channel a constant, which is flown as a step, or a list of segments. A ramp that
# rises to its rate within roll_in_s has its roll and lift planned.
[reference]
chi_deg   = []
gamma_deg = []

[limits]                            # of the commands, on the law as on the aircraft
phi_deg        = []
phi_rate_dps   = 0.0
n_z            = []
n_z_rate_per_s = 0.0

[controller]
feed_forward = true                 # adds the load factor of steady flight

[tuning]                            # of tuned_identified: how fast roll can follow bounds its gain
model     = "identified"
roll_rate = true

[[plant]]                           # the guidance law alone ...
kind = "kinematic"

[[plant]]                           # ... and the aircraft it is compared with
kind     = "jsbsim"
aircraft = ""

[[expect]]                          # what both must achieve; MO: overshoot, ST: scatter at the end
at_most.chi.MO_deg   = 5.0
at_most.gamma.MO_deg = 3.0
at_most.chi.ST_deg   = 0.5
at_most.gamma.ST_deg = 0.5
"""

NEXT = """
# What to do next:
#   flighttune fly {name}                    # metrics, requirements, a recording
#   flighttune report {run}                 # a page to send
#   flighttune gap {name}                    # what each step from law to aircraft adds
#   flighttune meet {name}                   # gains that meet [[expect]]
#   flighttune fly {name} --gains FILE --set flight.duration_s=60
"""


def new_scenario(
    name: str,
    *,
    aircraft: str | None = None,
    like: str | None = None,
    overshoot: float | None = None,
    settle: float | None = None,
) -> Path:
    """Write a scenario that an aircraft can fly to ``NAME.toml``, and return the file.

    With `like`, the file or name of another scenario, it is that one made for the aircraft, which
    is by default its own. A route is flown before it is kept, with more and more margin to the
    limits until the requirements are met. Otherwise `overshoot` (deg) and `settle` (s, to 5 %) are
    required of course and path angle in place of the template's; to settle, both are steps.

    Raises OutputError if there is such a file already, and InputError if the aircraft or the other
    scenario is not there, the aircraft cannot fly it, a requirement is not positive or beside
    `like`, or the name is empty or has a control character.
    """
    if not name.isprintable():
        raise InputError(f"`NAME` must have printable characters only, got {name!r}.")
    stem = name.removesuffix(".toml")
    if not os.path.basename(stem).strip(" ."):
        raise InputError(f"`NAME` must be that of a file, got {name!r}.")
    file = Path(f"{stem}.toml")
    if os.path.exists(file):  # which a name that is too long does not; writing says so
        raise OutputError(f"{file}: must be a new file, there is one already; give another NAME.")
    if like is not None and aircraft is not None and aircraft.lower().endswith(".json"):
        raise InputError(f"{aircraft}: `--like` must be absent: the model has no airframe to trim.")
    if aircraft is not None and (Path(aircraft) / "aircraft.toml").is_file():
        aircraft = str(Path(aircraft).resolve())
    _check_required({"overshoot": overshoot, "settle": settle}, like)
    names = {"name": shlex.quote(str(file)), "run": shlex.quote(f"runs/{file.stem}")}
    reason = ""
    try:
        for margin, look_ahead in ROUTES:
            if like is None:
                text = _first(aircraft or AIRCRAFT, file.parent)
                text = _requiring(text, overshoot, settle)
            else:
                text = _made_for(like, aircraft, file.parent, margin, look_ahead)
            write_text(file, text + NEXT.format(**names))
            scenario = load_scenario(file)
            if like is None or scenario.route is None:
                return file
            flown = fly(scenario)
            if not (reason := next(iter(flown.claim.missed), "")):
                beside, off = flown.flight[["cross_track_m", "height_err_m"]].max()
                seen = f"at most {beside:.2g} m beside the route and {off:.2g} m off its height"
                write_text(
                    file, f"# Flown by `flighttune new`: {seen}.\n{text}" + NEXT.format(**names)
                )
                return file
    except BaseException:
        if os.path.exists(file):
            file.unlink()
        raise
    file.unlink()
    raise InputError(
        f"{like}: must be a route that the aircraft can fly, got, with the most margin, "
        f"{reason.rstrip('.')}."
    )


def _named(aircraft: str, folder: Path) -> str:
    """An aircraft as a scenario in `folder` names it."""
    return os.path.relpath(aircraft, folder) if os.path.isabs(aircraft) else aircraft


def _limits(config: AircraftConfig) -> dict[str, Any]:
    """The limits of an aircraft as keys of ``[limits]``."""
    limits = config.limits
    values = {
        "phi_deg": [x / DEG for x in limits.phi],
        "phi_rate_dps": limits.phi_rate / DEG,
        "n_z": [*limits.n_z],
        "n_z_rate_per_s": limits.n_z_rate,
    }
    return rounded(values, DIGITS)


def _design(config: AircraftConfig) -> tuple[float, float]:
    """Airspeed (m/s) and height (m) that an aircraft is meant for."""
    if config.design is None:
        return sum(config.envelope.V_a) / 2.0, 1000.0
    return config.design.V_a, config.design.h


def _first(aircraft: str, folder: Path) -> str:
    """The template with the values of an aircraft; as values, for its texts may hold quotes."""
    if Path(aircraft).suffix.lower() == ".json":
        return _of_logs(Path(aircraft), folder)
    config = load_aircraft(aircraft)
    document: Any = tomlkit.parse(TEMPLATE)
    flight, (low, high) = document["flight"], config.envelope.V_a
    V_a, h = _design(config)
    start = level(config, V_a, h).gamma / DEG
    climb, change = ("climb", CLIMB) if config.engines.count else ("descend", -CLIMB)
    document["title"] = f"Turn right by {TURN:g} deg and {climb} by {CLIMB:g} deg"
    document["verifies"] = f"the aircraft turns and {climb}s with little overshoot, and settles"
    flight.comment(f"start: {config.title}")
    flight.update(rounded({"V_a_mps": V_a, "h_m": h, "gamma_deg": start}, DIGITS + 1))
    flight["V_a_mps"].comment(f"the aircraft flies {low:g} to {high:g} m/s")
    ramps = _first_ramps(config, V_a, change)
    for key, ramp in ramps.items():
        table = tomlkit.inline_table()
        table.update(ramp)
        document["reference"][key].append(table)
    # At rest for some seconds at the end, and no more: a glider whose glide got steeper speeds up.
    rest = max(r["start_s"] + r["duration_s"] + 0.5 * r["roll_in_s"] for r in ramps.values())
    flight["duration_s"] = max(flight["duration_s"], math.ceil(rest + REST))
    document["limits"].update(_limits(config))
    document["plant"][1]["aircraft"] = _named(aircraft, folder)
    return tomlkit.dumps(document)


def _check_required(required: Mapping[str, float | None], like: str | None) -> None:
    for option, value in required.items():
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"`--{option}` must be positive and finite, got {value:g}.")
        if value is not None and like is not None:
            raise InputError(f"`--{option}` must be absent: `--like` brings requirements.")


def _requiring(text: str, overshoot: float | None, settle: float | None) -> str:
    """A first scenario with requirements of course and path angle in place of its own."""
    document: Any = tomlkit.parse(text)
    if settle is not None:
        # Ramps are followed with hardly an error: steps of the same size have to settle.
        for key, value in document["reference"].items():
            if isinstance(value, list):
                change = sum(ramp["rate_dps"] * ramp["duration_s"] for ramp in value)
                document["reference"][key] = rounded(float(change), 2)
        start = document["flight"]["gamma_deg"]
        document["reference"]["gamma_deg"] += start
        document["flight"]["duration_s"] = max(document["flight"]["duration_s"], 5.0 * settle)
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
    """A turn and a climb (deg) that roll in, in parts of what the aircraft's limits allow."""
    limits = config.limits
    roll = 0.6 * limits.phi[1]
    loads = {"chi_deg": math.tan(roll), "gamma_deg": 0.3 * (limits.n_z[1] - 1.0)}
    rates = {"chi_deg": limits.phi_rate, "gamma_deg": limits.n_z_rate}
    changes = {"chi_deg": TURN, "gamma_deg": climb}
    ramps = {}
    for key, change in changes.items():
        # Over the roll-in the command changes at up to 0.6 of its rate limit, and it takes at most
        # half of the ramp: a small change has a small rate.
        roll_in = loads[key] / (0.6 * rates[key])
        rate = math.copysign(loads[key] * G_PAPER / V_a / DEG, change)
        duration = max(change / rate, 2.0 * roll_in)
        values = {
            "start_s": max(2.0, 0.51 * roll_in),  # half of the roll-in lies before it
            "duration_s": duration,
            "rate_dps": change / duration,
            "roll_in_s": roll_in,
        }
        ramps[key] = {"shape": "ramp", **rounded(values, DIGITS)}
    return ramps


def _of_logs(model: Path, folder: Path) -> str:
    """The template with a model identified from logs as the plant, and the limits that they show.

    Without an airframe behind it such a model flies as a point mass behind its lags.
    """
    identified = load_identified(model)
    log, condition = identified.log, identified.conditions[0]
    if log is None:
        raise InputError(f"{model}: must be identified from logs; others are in their aircraft.")
    document: Any = tomlkit.parse(TEMPLATE)
    document["title"] = f"Turn right by {TURN:g} deg and climb by {CLIMB:g} deg"
    document["verifies"] = "the aircraft turns and climbs with little overshoot, and settles"
    document["flight"].update({"V_a_mps": rounded(condition.V_a, 4), "h_m": condition.h})
    document["flight"].comment(f"start: as in {log.logs[0]}")
    document["reference"].update({"chi_deg": TURN, "gamma_deg": CLIMB})
    limits = {key: getattr(log, key) for key in ("phi_deg", "n_z")}
    rates = {key: getattr(log, key) for key in ("phi_rate_dps", "n_z_rate_per_s")}
    seen = {**{key: [*ends] for key, ends in limits.items()}, **rates}
    document["limits"].update(rounded(seen, 3))
    document["limits"].comment("as seen in the logs")
    document["plant"].pop()
    plant = tomlkit.table()
    plant.update({"kind": "point_mass_lag", "identified": os.path.relpath(model, folder)})
    document["plant"].append(plant)
    return tomlkit.dumps(document)


def _made_for(
    like: str, aircraft: str | None, folder: Path, margin: float, look_ahead: float
) -> str:
    """The text of another scenario, with the values that depend on the aircraft replaced.

    A route keeps at least `margin` to the limits, and has `look_ahead` times its look-ahead.
    """
    source = existing_file(like, "scenario", scenario_files(), ["scenarios"])
    scenario = load_scenario(source)
    document: Any = tomlkit.parse(source.read_text(encoding="utf-8"))
    flown = scenario.aircraft
    aircraft = aircraft or (flown[0].aircraft if flown else None) or AIRCRAFT
    config = load_aircraft(aircraft)
    if scenario.route is not None and not config.engines.count:
        raise InputError(f"{like}: must be without a route: {aircraft} has no engine, and glides.")
    other = flown[0].config if flown else config
    faster = _design(config)[0] / (_design(other)[0] if flown else scenario.flight.V_a_mps)
    flight = scenario.flight
    V_a = flight.V_a_mps * faster
    # A bank turns by g tan(phi) / V.
    banks = [math.tan(of.limits.phi[1]) for of in (config, other)]
    turn = min(1.0, banks[0] / banks[1]) / faster
    document["flight"]["V_a_mps"], document["limits"] = rounded(V_a, DIGITS), _limits(config)
    if scenario.route is None:
        climb = _climb(config, V_a, scenario)
        rates = [(of.limits.phi_rate, of.limits.n_z_rate) for of in (other, config)]
        loads = turn * faster, climb * faster
        # Of the same change of a command, a slower one takes longer.
        roll_in = tuple(max(a / b * load, 1.0) for a, b, load in zip(*rates, loads, strict=True))
        _scale_reference(document["reference"], turn, climb, (roll_in[0], roll_in[1]))
    else:
        climb = _fit_route(document, scenario, (config, other), V_a, margin, look_ahead)
    _scale(document["flight"], {"gamma_deg": climb})
    _scale(document.get("envelope", {}), {"V_a_mps": faster})
    wind = {"chi_amplitude": 1.0 / faster, "gamma_amplitude": 1.0 / faster}  # of the same speed
    _scale(document.get("disturbance", {}), wind)
    labels = {}
    for table, plant in zip(document["plant"], scenario.plant, strict=True):
        if plant.aircraft is not None:
            table["aircraft"] = _named(aircraft, folder)
            labels[plant.label] = plant_label(plant.kind, aircraft, plant.name)
            table.get("airframe", {}).pop("coefficient_factors", None)  # functions of its model
    for table in document.get("expect", ()):
        if table.get("plant") in labels:
            table["plant"] = labels[table["plant"]]
    for i, entry in enumerate(document.get("gains", ())):
        if isinstance(entry, str) and Path(entry).suffix in GAINS_FILES:
            document["gains"][i] = os.path.relpath(source.parent / entry, folder)
    for table in (*document.get("law", ()), *document["plant"]):
        if isinstance(table, dict) and "module" in table:
            table["module"] = os.path.relpath(source.parent / table["module"], folder)
    document.get("tuning", {}).pop("identified", None)
    document["title"] = f"{scenario.title} ({config.title})"
    document.pop("verifies", None)  # a claim about the other aircraft
    return tomlkit.dumps(document)


def _scale_reference(
    reference: Any, turn: float, climb: float, roll_in: tuple[float, float]
) -> None:
    """Multiply the turn rates of a reference, its path angles, and the times of roll-ins."""
    scales_of = ("chi", 1.0, turn, roll_in[0]), ("gamma", climb, climb, roll_in[1])
    for key, angle, rate, rolling in scales_of:
        _scale(reference, {f"{key}_from_deg": angle})
        if isinstance(reference[f"{key}_deg"], list):
            scales = {"change_deg": angle, "amplitude_deg": angle, "rate_dps": rate}
            scales["roll_in_s"] = rolling
            for segment in reference[f"{key}_deg"]:
                _scale(segment, scales)
                if "roll_in_s" in segment:  # no longer than the ramp
                    most = min(segment["duration_s"], 2.0 * segment["start_s"])
                    segment["roll_in_s"] = min(segment["roll_in_s"], most)
        else:
            _scale(reference, {f"{key}_deg": angle})


def _fit_route(
    document: Any,
    scenario: Scenario,
    aircraft: tuple[AircraftConfig, AircraftConfig],
    V_a: float,
    margin: float,
    look_ahead: float,
) -> float:
    """Make a route for the first of two aircraft from that of the second; share of the climbs."""
    route, flight, table = scenario.route, scenario.flight, document["route"]
    assert route is not None
    if "waypoint" not in table:
        raise InputError("`route` must have waypoints of its own for another aircraft, got a file.")
    kept = route.model_copy(update={"margin": max(margin, route.margin)})
    if margin > route.margin:
        table["margin"] = margin
    if look_ahead > 1.0:
        table["look_ahead_s"] = look_ahead * route.look_ahead_s
    config, other = aircraft
    room = _room(kept, V_a, flight.g_mps2, config)
    size = float((room / _room(route, flight.V_a_mps, flight.g_mps2, other)).max())
    climb = _climb(config, V_a, scenario, size, (1.0 - kept.margin) * config.limits.phi[1])
    for point in table["waypoint"]:
        _scale(point, dict.fromkeys(("north_m", "east_m", "radius_m"), size))
        _scale(point, {"up_m": size * climb, "climb_deg": climb})
        if not point.get("climb_deg", 1.0):
            del point["climb_deg"]
        for key in {"lat_deg", "lon_deg"} & {*point}:
            first = table["waypoint"][0][key]
            point[key] = round(first + size * (point[key] - first), 8)
    faster = V_a / flight.V_a_mps
    _scale(document["flight"], {"duration_s": size / faster})
    # A slow roll ends every turn beyond its course, in a limit cycle (design/roll_rate.md).
    document.setdefault("tuning", tomlkit.table())["roll_rate"] = True
    for expected in document.get("expect", ()):  # an error of position grows with the way ahead
        more = max(1.0, faster) * look_ahead
        errors = {"cross_track_m": more, "height_err_m": more}
        _scale(expected.get("at_most", {}).get("flight", {}), errors)
    return climb


def _room(route: RouteTable, V_a: float, g: float, config: AircraftConfig) -> FloatArray:
    """Radius of a turn on a route, and what half a turn takes with its roll-in, m."""
    phi, phi_rate = config.limits.phi[1], config.limits.phi_rate
    ability = route.ability(V_a=V_a, g=g, phi=phi, phi_rate=phi_rate)
    radius = 1.0 / ability.curvature
    return np.array([radius, radius + ability.rolling(ability.curvature)])


def _scale(table: Any, factors: Mapping[str, float]) -> None:
    """Multiply those keys that a table has."""
    for key, factor in factors.items():
        if key in table and factor != 1.0:
            value = table[key]
            scaled = [factor * x for x in value] if isinstance(value, list) else factor * value
            table[key] = rounded(scaled, DIGITS)


def _climb(
    config: AircraftConfig, V_a: float, scenario: Scenario, size: float = 1.0, phi: float = 0.0
) -> float:
    """Share of a scenario's path angles that an aircraft can fly steadily at an airspeed.

    On a route, made larger by the factor `size`, also at its greatest height, with a bank `phi`.
    """
    flight, top = scenario.flight, 0.0
    if scenario.route is None:
        assert scenario.reference is not None  # one of both is there
        _, steepest = scenario.reference.steepest(flight.gamma_deg, flight.duration_s)
        asked = {flight.gamma_deg * DEG, steepest * DEG} - {0.0}
    else:
        route = reference_of(scenario)
        assert isinstance(route, RouteReference)
        asked = {math.atan(route.path.slope.max()), math.atan(route.path.slope.min())} - {0.0}
        top = size * max(0.0, float(route.path.up.max()))
    for share in SHARES if asked else ():
        gammas = [share * gamma for gamma in asked]
        trims = trim_table(config, V_a=[V_a], gamma=gammas, phi=phi, h=flight.h_m + share * top)
        if all(record["trim"] for record in trims):
            return share
    return 0.0 if asked else 1.0
