"""Capabilities of a model, measured by experiment: lift, engines, surfaces, flight conditions."""

import math
import re
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, PlantError
from flighttune.base.files.xml import found_file, read_xml
from flighttune.base.units import DEG, FT, G_0
from flighttune.base.words import listed
from flighttune.studies.adoption import reads
from flighttune.studies.adoption.flightgear import UNSTATED, Stated
from flighttune.studies.adoption.reads import ANY_NAME
from flighttune.vehicles.aircraft.aircraft import (
    SURFACES,
    AircraftConfig,
    aircraft_from,
    property_name,
)
from flighttune.vehicles.aircraft.model_xml import in_inches
from flighttune.vehicles.plants.jsbsim import model_files, properties
from flighttune.vehicles.plants.jsbsim.bench import (
    EFFECTS,
    POSITIONS,
    AirframeState,
    Bench,
    surface_faults,
)
from flighttune.vehicles.plants.jsbsim.fdm import Fdm

SOURCE = "flighttune adopt"  # marks an aircraft that `adopt` may overwrite

# Maximum number of another simulator's properties that are declared for a model, and that a
# sentence names.
MAX_DECLARED, MAX_NAMED = 1000, 8

# Time in which a running model shows its references to properties, s.
TRIAL_S = 0.1

# The missing property in an error message of JSBSim.
MISSING = re.compile(
    r"(?:property|node)[^\w/.]*((?:[\w/.-]|\[\d+\])+)\W+(?:does not|is not)", re.IGNORECASE
)

# The wing stalls when the slope of lift falls below this share of its usual value.
STALL_SHARE = 1.0 / 3.0

ALPHAS = np.arange(-14.0, 30.5, 1.0) * DEG
MAX_STALL, MIN_STALL = 18.0 * DEG, -12.0 * DEG

# Minimum lift coefficient of an aeroplane at the stall, and range of its stall speed, m/s.
MIN_LIFT = 0.1
MIN_STALL_SPEED, MAX_STALL_SPEED = 3.0, 300.0

TABLES = tomllib.loads(Path(__file__).with_name("models.toml").read_text(encoding="utf-8"))

# Settings of levers to try until every engine pushes: name and values.
_LINKED, _FURTHER = TABLES["levers"]["linked"], TABLES["levers"]["further"]
LEVERS = {"": [], **{how: [*_LINKED, *levers] for how, levers in _FURTHER.items()}}

# Names of the levers of gear, flaps and brakes.
LEVERS_IN = re.compile(TABLES["levers"]["in"])

# Quantities of a body that must be positive.
BODY = {"mass": "inertia/mass-slugs", "wing area": "metrics/Sw-sqft"} | {
    f"inertia {axes}": f"inertia/i{axes}-slugs_ft2" for axes in ("xx", "yy", "zz")
}

# A moment of inertia is at most the sum of the other two, with this factor for rounding.
ROUNDED = 1.01

# Airspeed of the first sweep, m/s.
FIRST_SPEED = 60.0

# Airspeeds relative to the stall speed, in order of preference.
SPEEDS = (1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 1.5, 1.4)

# Excess thrust over drag, relative to weight, for a climb of 3 deg and a turn.
SPARE_THRUST = 0.08

# Thrust-to-weight ratio beyond any aeroplane: the speed of a propeller diverges, or an engine is
# meant for partial throttle.
MAX_THRUST = 10.0

# Integration rates to try in turn if the usual rate is too low, 1/s.
FINER_RATES = 400.0, 1000.0

# Nutation of the airframe by a propeller's angular momentum, rad/s, that prevents control: it is
# above the bandwidth of the inner loop.
FAST_NUTATION = 8.0

# Words for an engine without thrust.
ENGINE_SHOWS = "thrust-lbs", "power-hp", "propeller-rpm", "blade-angle", "n1", "n2"

THROTTLE_POSITION = "fcs/throttle-pos-norm"

PROPELLER_RPM = "propulsion/engine/propeller-rpm"

FUEL, FIRST_TANK = "propulsion/total-fuel-lbs", "propulsion/tank/contents-lbs"

# External force along the body axis that models use as thrust.
EXTERNAL = "forces/fbx-external-lbs"

# Names under which aerodynamics read a surface with several names.
NAMES = {"elevator": "(elevator|stabilator|(horz|horizontal)-tail|stabilizer)"}

# Motion beside level flight (rad, rad/s), share of the effect of a command and change of an
# acceleration (m/s^2) by which a switch must not change what already moves.
BESIDE = {"alpha": 2.0 * DEG, "beta": 0.05, "p": 0.1, "q": 0.1, "r": 0.1}
SAME_EFFECT, SAME_ACCELERATION = 0.01, 0.1

# Deviations from level flight in which every coefficient acts, rad and rad/s, and minimum share of
# an axis for the report of a coefficient that is 0.
SHAKEN = (
    *(("alpha", 4.0 * DEG), ("beta", 0.1), ("p", 0.2), ("q", 0.2), ("r", 0.2)),
    *(("aileron", 0.1), ("elevator", 0.1), ("rudder", 0.1)),
)
LEAST_SHARE = 0.005

# Maximum number of values in a note.
MAX_LISTED = 60

TINY = 1e-300

# Axes of the aerodynamics in words.
AXIS_WORDS = {"SIDE": "side force", "ROLL": "roll moment", "PITCH": "pitch moment"} | {
    "YAW": "yaw moment", "LIFT": "lift", "DRAG": "drag", "NORMAL": "normal force",
    "AXIAL": "axial force", "X": "force along x", "Y": "force along y", "Z": "force along z",
}  # fmt: skip

# Folders of JSBSim's own properties without positions of surfaces.
OWN = re.compile(
    "-?/?(accelerations|aero|atmosphere|attitude|flight-path|forces|gear|ic|inertia|metrics|"
    "moments|position|propulsion|simulation|velocities)/"
)

# Trial change (rad, or a share) of a position that may be a surface, and minimum share of the
# largest moment for a surface.
CHANGE, MOVER = 0.1, 0.5
VERBS = {"aileron": "rolls", "elevator": "pitches"}

# Motions that deviate from level flight, and minimum change of a position, in its unit, that shows
# flight control.
STIRRED = (("alpha", 0.0), ("alpha", 4.0 * DEG), ("q", 0.1), ("elevator", 0.1))
MOVES = 1e-3

GEAR = "gear/gear-pos-norm"

# Positions of extended drag devices, and maximum number of properties to try for retracting them.
OUT = *(f"fcs/{x}-pos-norm" for x in ("speedbrake", "spoiler", "spoilers", "flap")), GEAR
MAX_TRIED_IN = 100

# Airspeed (m/s) and angle of attack of the states in which a model shows its references.
SHOWN_AT = ((60.0, 0.0), (15.0, 8.0 * DEG), (150.0, 0.0), (300.0, 2.0 * DEG))

# Elements of a model's systems.
SYSTEMS = ("system", "flight_control", "autopilot")

# A thrust within this share of its final value has settled.
SETTLED = 1e-3

# Minimum settling time of engines that do not respond at once, and maximum wait, s.
PROPELLER_SETTLES = 15.0
MAX_SETTLING_S = 40.0

# Deceleration time of an electric propeller, relative to its acceleration time.
SLOWS_DOWN = 6

# Longest settling time in an ``aircraft.toml``, s.
LONGEST_SETTLING_S = 60

COMMANDS = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])

# A command is clipped when the slope of its effect falls below this share of the first slope.
CLIPPED = 0.2

# Minimum usable effect of full travel, rad/s^2.
MIN_EFFECT = 1e-6

# Assumed travel if no property of the model shows the position, rad.
USUAL_TRAVEL = 0.35

MAX_TRAVEL = 60.0 * DEG

# Interval after a command, s, in which its effect must not drift.
HOLD_TIMES = 3.0, 4.0

# Maximum drift as a share of the effect; twice this share up to the first time.
DRIFT = 0.05

ONE_RADIAN = math.degrees(1.0)


def undefined_in(text: str) -> str:
    """The undefined property in an error message of JSBSim; empty without one."""
    missing = MISSING.search(text)
    return property_name(missing[1]) if missing else ""


class Refusal(PlantError):
    """The model cannot be adopted as an aeroplane; the message says why, in one sentence."""


class Diverges(Refusal):
    """The thrust depends on the integration step, which is too long."""


class TooWeak(Refusal):
    """Its engines push but cannot hold level flight; it can be flown about its steady glide."""


class Lift(NamedTuple):
    """Lift and drag of the airframe with neutral surfaces."""

    alpha: FloatArray  # (n,), rad
    # (n,), 1: coefficients as shares of the largest lift coefficient
    lift: FloatArray
    drag: FloatArray
    # rad: range of angles of attack with growing lift
    stall: float
    negative_stall: float
    V_s: float  # m/s: airspeed at which the largest lift equals the weight

    def at(self, V_a: float) -> tuple[float, float]:
        """Angle of attack (rad) and drag-to-weight ratio in level flight."""
        q = (V_a / self.V_s) ** 2
        inside = (self.alpha >= self.negative_stall) & (self.alpha <= self.stall)
        alpha = float(np.interp(1.0 / q, self.lift[inside], self.alpha[inside]))
        return alpha, q * float(np.interp(alpha, self.alpha, self.drag))


class SwitchedOff(NamedTuple):
    """A function of the aerodynamics that is 0 because properties of another simulator are 0."""

    function: str
    names: tuple[str, ...]  # names of the properties, each of which switches it off
    axis: str  # name of its axis, in words
    share: float  # its largest share of the axis with 1 instead of 0

    @property
    def words(self) -> str:
        """The function and its share, in words."""
        return f"{self.function} (with 1 up to {100.0 * self.share:.0f} % of the {self.axis})"


class Survey(NamedTuple):
    """Findings about a model."""

    # tables of an ``aircraft.toml`` for the model: ``model``, ``surfaces``, ``engines``,
    # ``settings``, ``declared``, and wide ranges elsewhere
    tables: dict[str, Any]
    lift: Lift
    V_a: float  # m/s: airspeed chosen
    spare_thrust: float  # 1: excess thrust over drag there at full throttle, relative to weight
    glide_ratio: float  # 1: lift-to-drag ratio there with neutral surfaces
    largest_drag: tuple[str, float]  # largest function of the drag, and its share there
    notes: tuple[str, ...]  # changes of the model, one sentence each
    switched_off: tuple[SwitchedOff, ...] = ()  # functions of the aerodynamics that are 0


def survey(
    tables: dict[str, Any],
    folder: Path,
    *,
    h: float,
    V_a: float | None = None,
    say: Callable[[str], object] = lambda _: None,
    values: Mapping[str, float] = MappingProxyType({}),
    glide: bool = False,
    stated: Stated = UNSTATED,
) -> Survey:
    """Measure the capabilities of a model at height h (m); `glide` leaves its engines off.

    `stated`: values of properties from FlightGear's files.
    """
    # `tables`, which begin as `wide_tables`, keep the findings about a refused model.
    values = {property_name(name): value for name, value in values.items()}
    model = _Model(tables, folder, h, V_a, values, stated)
    say("step 1 of 9: reading the model")
    tables["engines"]["count"] = 0 if glide else _engine_count(model.config)
    model.declare()
    model.set_levers()
    say("step 2 of 9: sweeping lift")
    model.put_in()
    try:
        model.sweep()
    except Refusal as error:
        raise Refusal(f"{error}{model.zeros_in_words}") from error
    if tables["engines"]["count"]:
        say("step 3 of 9: starting the engines")
        model.find_throttle()
        model.drive()
    say("step 4 of 9: moving the surfaces")
    surfaces = model.surfaces()
    if any(name.startswith("ft/") for name in tables["declared"]):
        model.lift = _swept(model.load(surfaces=surfaces), model.speed)
    if "rudder" not in surfaces:
        model.notes.append("it has no rudder: yaw is left to the airframe")
    model.note_engines()
    tables["surfaces"] = surfaces
    off = model.switched_off()
    model.note_values(off)
    return Survey(
        tables=tables,
        lift=model.lift,
        V_a=model.speed,
        spare_thrust=model.spare,
        notes=tuple(model.notes),
        switched_off=tuple(off),
        **drag_at(model.load(), model.level(0.0)),
    )


def drag_at(bench: Bench, state: AirframeState) -> dict[str, Any]:
    """`Survey` values about drag in a state of flight."""
    bench.accelerations(state)
    fdm = bench.fdm
    return {"glide_ratio": fdm.reader("forces/lod-norm")(), "largest_drag": _largest_drag(fdm)}


def wide_tables(model: str) -> dict[str, Any]:
    """Tables of an aircraft whose surfaces use commands from -1 to 1 as positions in rad."""
    surface = {"travel_deg": [-ONE_RADIAN, ONE_RADIAN], "full_rad": [-1.0, 1.0]}
    surfaces = {name: dict(surface) for name in SURFACES}
    named = {"title": Path(model).stem, "source": SOURCE, "model": model, "surfaces": surfaces}
    return named | deepcopy(TABLES["wide"])


def _engine_count(config: AircraftConfig) -> int:
    """Number of engines of a model; a model that cannot be an aeroplane is refused."""
    root = model_files.main_root(config)
    if root.tag != "fdm_config":
        raise Refusal(f"its main file must be a <fdm_config> of JSBSim, got a <{root.tag}>")
    aerodynamics, propulsion = (_part(config, tag) for tag in ("aerodynamics", "propulsion"))
    if any(part.find(".//gas_cell") is not None for part in (root, aerodynamics, propulsion)):
        raise Refusal("it is carried by buoyancy (gas cells), not by a wing")
    axes = {axis.get("name", "").upper() for axis in aerodynamics.iter("axis")}
    if not axes & {"LIFT", "NORMAL", "Z"}:
        has = ", ".join(sorted(axes)) or "none"
        raise Refusal(f"its aerodynamics have no lift or normal-force axis: {has}")
    lacking = [axis for axis in ("ROLL", "PITCH", "YAW") if axis not in axes]
    if lacking:
        raise Refusal(f"its aerodynamics lack a moment axis: {', '.join(lacking)}")
    return len(propulsion.findall("engine"))


def _part(config: AircraftConfig, tag: str) -> Element:
    """A part of the main file of a model, which may be in a separate file."""
    part = model_files.main_root(config).find(tag)
    if part is None:
        return Element(tag)
    name, folders = part.get("file"), model_files.source_folders(config).parts
    file = str(model_files.source_folders(config).file)
    return read_xml(found_file(name, folders, folders[0]), file) if name else part


def _settable(fdm: Fdm, name: str) -> bool:
    """Whether a setting may name a property; a model must declare a property with a slash."""
    return not name.startswith("/") and fdm.has(name)


def _largest_drag(fdm: Fdm) -> tuple[str, float]:
    """The largest function of the drag axis, and its share."""
    aerodynamics = _part(fdm.config, "aerodynamics")
    axes = (axis for axis in aerodynamics.iter("axis") if axis.get("name", "").upper() == "DRAG")
    names = [f.get("name", "") for axis in axes for f in axis.findall("function")]
    parts = {name: abs(fdm.reader(name)()) for name in names if fdm.shows(name)}
    total = sum(parts.values())
    if not total > 0.0:
        return "", math.nan
    name = max(parts, key=lambda name: parts[name])
    return name, parts[name] / total


def _functions(fdm: Fdm) -> dict[str, list[str]]:
    """Names of the aerodynamic functions that JSBSim shows, by axis in words."""
    functions: dict[str, list[str]] = {}
    for axis in _part(fdm.config, "aerodynamics").iter("axis"):
        words = AXIS_WORDS.get(axis.get("name", "").upper(), axis.get("name", ""))
        names = (f.get("name", "").strip() for f in axis.findall("function"))
        functions.setdefault(words, []).extend(name for name in names if fdm.shows(name))
    return functions


def _level(V_a: float, alpha: float, throttle: float = 0.0) -> AirframeState:
    return AirframeState(V_a=V_a, alpha=alpha, theta=alpha, throttle=throttle)


def _swept(bench: Bench, V_a: float) -> Lift:
    """Lift and drag over the angle of attack, flown at V_a (m/s)."""
    fdm = bench.fdm
    ahead, down = (fdm.reader(f"forces/fb{axis}-aero-lbs") for axis in "xz")
    pressure, area = fdm.reader("aero/qbar-psf"), fdm.reader("metrics/Sw-sqft")()
    weight = fdm.reader("inertia/mass-slugs")() * G_0 / FT
    rows = []
    for alpha in ALPHAS.tolist():
        bench.accelerations(_level(V_a, alpha))
        x, z, q = ahead(), down(), pressure() * area
        # body axes: x forward, z down
        lift = x * math.sin(alpha) - z * math.cos(alpha)
        rows.append((lift / q, -(x * math.cos(alpha) + z * math.sin(alpha)) / q))
    C_L, C_D = np.array(rows).T
    if not np.isfinite(rows).all():
        raise Refusal("its aerodynamics give no number at an angle of attack below 30 deg")
    near = (ALPHAS >= -2.5 * DEG) & (ALPHAS <= 4.5 * DEG)
    slope = float(np.polyfit(ALPHAS[near], C_L[near], 1)[0])
    if not slope > 0.0:
        raise Refusal(f"lift does not grow with alpha (slope {slope:.2f} per rad)")
    stall = _end_of_lift(C_L, slope, 1)
    largest = C_L[stall]
    if not largest > MIN_LIFT:
        raise Refusal(f"it lifts too little: the largest lift coefficient is {largest:.2f}")
    density = pressure() / (V_a / FT) ** 2  # half of the density of air
    V_s = math.sqrt(weight / (density * area * largest)) * FT
    if not MIN_STALL_SPEED < V_s < MAX_STALL_SPEED:
        raise Refusal(f"it would stall at {V_s:.0f} m/s")
    return Lift(
        alpha=ALPHAS,
        lift=C_L / largest,
        drag=C_D / largest,
        stall=float(ALPHAS[stall]),
        negative_stall=float(ALPHAS[_end_of_lift(C_L, slope, -1)]),
        V_s=V_s,
    )


def _end_of_lift(C_L: FloatArray, slope: float, sense: int) -> int:
    """Index of the angle of attack at which lift stops growing, upwards or downwards."""
    i = int(np.argmin(np.abs(ALPHAS - 2.0 * DEG)))
    end = int(np.argmin(np.abs(ALPHAS - (MAX_STALL if sense > 0 else MIN_STALL))))
    step = sense * float(ALPHAS[1] - ALPHAS[0])
    while i != end and (C_L[i + sense] - C_L[i]) / step > STALL_SHARE * slope:
        i += sense
    return i


@dataclass(eq=False)
class _Model:
    """A model under survey, with the findings in its tables and notes."""

    tables: dict[str, Any]
    folder: Path
    h: float  # m
    V_a: float | None  # m/s: requested airspeed
    values: Mapping[str, float]
    stated: Stated = UNSTATED
    notes: list[str] = field(default_factory=list)
    lift: Lift = field(init=False)
    speed: float = field(init=False)  # m/s: airspeed chosen
    spare: float = field(init=False)  # excess thrust over drag there, relative to weight

    def load(self, **changed: Any) -> Bench:
        """The model on a test bench, with some tables changed."""
        return Bench(Fdm(aircraft_from(self.tables | changed, self.folder)), self.h)

    def level(self, throttle: float = 0.5) -> AirframeState:
        """Level flight at the chosen airspeed."""
        return _level(self.speed, self.lift.at(self.speed)[0], throttle)

    @cached_property
    def config(self) -> AircraftConfig:
        """The model before the survey."""
        return aircraft_from(self.tables, self.folder)

    @cached_property
    def roots(self) -> list[Element]:
        """The files of the model."""
        return [read_xml(file, str(file)) for file in model_files.model_files(self.config)]

    @cached_property
    def texts(self) -> tuple[set[str], set[str]]:
        """Texts of the elements of its aerodynamics, and of all other elements."""
        inside, outside = set[str](), set[str]()
        for root in self.roots:
            for top in (root, *root):
                texts = inside if "aerodynamics" in (root.tag, top.tag) else outside
                # JSBSim negates a property with a minus before its name.
                elements = (top,) if top is root else top.iter()
                names = ((part.text or "").strip().lstrip("-") for part in elements)
                texts |= {property_name(name) if "/" in name else name for name in names}
        return inside, outside

    @cached_property
    def reads_rudder(self) -> bool:
        """Whether its aerodynamics read a property named for a rudder."""
        return any("/" in text and "rudder" in text for text in self.texts[0])

    @cached_property
    def defined(self) -> set[str]:
        """Properties that its systems define for external settings."""
        elements = (part for root in self.roots for part in (root, *root))
        systems = (part for part in elements if part.tag in SYSTEMS)
        names = ((x.text or "").strip() for part in systems for x in part.findall("property"))
        return {property_name(name) for name in names}

    @cached_property
    def stated_read(self) -> dict[str, float]:
        """Values from FlightGear's files for properties that the model reads."""
        parts = (part for root in self.roots for part in root.iter())
        texts = ((*(part.text or "").split(), *part.attrib.values()) for part in parts)
        words = (word.lstrip("-") for text in texts for word in text if "/" in word)
        names = {property_name(word) for word in words} | self.defined
        names = {name for name in names - self.values.keys() if re.fullmatch(ANY_NAME, name)}
        values = ((name, self.stated.of(name)) for name in sorted(names))
        return {name: value for name, value in values if value is not None}

    @cached_property
    def taken(self) -> dict[str, float]:
        """Given values, with levers of gear, flaps and brakes as in flight."""
        return {name: 0.0 if LEVERS_IN.search(name) else x for name, x in self.stated_read.items()}

    @cached_property
    def parts(self) -> list[reads.Part]:
        """Its components of flight control and functions."""
        return reads.parts(self.roots)

    @property
    def zeros(self) -> list[str]:
        """Properties of another simulator that are 0 by default and not by a given value."""
        lever = self.tables["engines"].get("command")
        known = (lever, *self.tables["linked"], *self.taken, *self.values)
        declared = self.tables["declared"].items()
        zeros = (name for name, value in declared if not value and name not in known)
        return [name for name in zeros if not name.startswith("ft/")]

    @property
    def zeros_in_words(self) -> str:
        """The end of a sentence about properties that are 0 and read by the aerodynamics."""
        names = [name for name in self.zeros if name in self.texts[0]]
        if not names:
            return ""
        them, is_ = ("it", "is") if len(names) == 1 else ("them", "are")
        return (
            f"; its aerodynamics read {listed(names, most=MAX_NAMED)}, which {is_} of another "
            f"simulator and 0: --set {names[0]}=VALUE states {them}{self._why_unknown(names)}"
        )

    def _why_unknown(self, names: Sequence[str]) -> str:
        """Reasons why FlightGear's files lack properties, as the end of a sentence."""
        faults = self.stated.faults(names)
        if several := [name for name in names if self.stated.several(name)]:
            faults.append(f"{listed(self.stated.files)} state several values of {listed(several)}")
        return f" ({'; '.join(faults)})" if faults else ""

    def declare(self) -> None:
        """Declare the undefined properties that the model refers to, and the values."""
        declared = self.tables["declared"]  # it may have some that an earlier survey found late
        declared |= {name: self.taken.get(name, x) for name, x in declared.items()}
        for name, value in self.values.items():
            if not (re.fullmatch(ANY_NAME, name) and math.isfinite(value)):
                raise InputError(f"--set must be NAME=VALUE, got {name[:80]}={value}.")
        declared |= {name: x for name, x in self.values.items() if name.startswith("/")}
        read = sorted(reads.read(self.roots))
        while len(declared) < MAX_DECLARED:
            try:
                bench = self.load()
                # JSBSim misses the others only where it reads them, such as after 30 s.
                if new := [x for x in read if x not in declared and not bench.fdm.shows(x)]:
                    declared |= {name: self.taken.get(name, 0.0) for name in new}
                    bench = self.load()
                for V_a, alpha in SHOWN_AT:
                    bench.accelerations(_level(V_a, alpha))
                    bench.fdm.hold(TRIAL_S)
                break
            except PlantError as error:
                name = undefined_in(str(error))
                if not name or name in declared or name.startswith("ft/"):
                    raise
                declared[name] = self.taken.get(name, 0.0)
        else:
            raise Refusal(
                f"it refers to more than {MAX_DECLARED} properties that nothing defines, such as "
                f"{', '.join([*declared][:MAX_NAMED])}"
            )
        # A system does not change a property that was declared before, as by FlightGear. JSBSim may
        # read others later than in the trial, such as in a branch that was not taken.
        known = {name for name in self.taken if bench.fdm.shows(name)} - self.defined
        declared |= {name: x for name, x in self.taken.items() if name not in known}
        for name, source in TABLES["shown"].items():
            if name in declared and name not in self.values:
                self.tables["linked"][name] = source

    def set_levers(self) -> None:
        """Set fuel, gear, flaps, speed brake, mixture, propeller and values; check the inertias."""
        fdm, tables = self.load().fdm, self.tables
        read = set[str]().union(*self.texts)
        for surface, table in tables["surfaces"].items():
            command = table.get("command", "")
            linked = (x for x, to in tables["linked"].items() if to.lstrip("-") == command)
            for name in sorted({command, *linked} - read - {""}):
                raise InputError(f"--{surface}: the model must read {name}, it does not.")
        levers = {"propulsion/fuel_freeze": 1.0, "gear/gear-cmd-norm": 0.0}
        levers |= dict.fromkeys(("fcs/flap-cmd-norm", "fcs/speedbrake-cmd-norm"), 0.0)
        for i in range(tables["engines"]["count"]):
            levers |= {f"fcs/{name}-cmd-norm[{i}]": 1.0 for name in ("mixture", "advance")}
        tables["settings"] |= {name: value for name, value in levers.items() if fdm.has(name)}
        for name, value in self.values.items():
            kind = "declared" if name in tables["declared"] else "settings"
            if kind == "settings" and not _settable(fdm, name):
                other = f"; it reads /{name}, with a slash" if f"/{name}" in read else ""
                raise InputError(
                    f"--set {name}: the model must have or read it, it does neither{other}."
                )
            tables[kind][name] = value
        body = {quantity: fdm.reader(name)() for quantity, name in BODY.items()}
        for quantity, value in body.items():
            if not 0.0 < value < math.inf:
                raise Refusal(
                    f"its {quantity} must be above zero, got {value:g} ({BODY[quantity]})"
                )
        moments = {name: value for name, value in body.items() if name.startswith("inertia")}
        self.notes += [
            f"its moments of inertia are those of no body: {name} exceeds the sum of the others"
            for name, moment in moments.items()
            if 2.0 * moment > ROUNDED * sum(moments.values())
        ]

    def put_in(self) -> None:
        """Retract extended brakes, flaps and gear by a declared property, or report them."""
        bench, declared = self.load(), self.tables["declared"]
        # JSBSim shows fixed gear as extended.
        contacts = (part.text or "" for root in self.roots for part in root.iter("retractable"))
        retracts = any(text.strip() not in ("", "0") for text in contacts)
        names = OUT if retracts else [name for name in OUT if name != GEAR]
        texts = set[str]().union(*self.texts)
        read = [name for name in names if name in texts and bench.fdm.shows(name)]

        def out(bench: Bench) -> dict[str, float]:
            bench.accelerations(_level(FIRST_SPEED, 0.0))
            positions = {name: bench.fdm.reader(name)() for name in read}
            return {name: position for name, position in positions.items() if abs(position) > 0.01}

        before = out(bench)
        zeros = [name for name, x in declared.items() if not x and name not in self.values]
        for name in zeros[:MAX_TRIED_IN]:
            if not before:
                break
            after = out(self.load(declared=declared | {name: 1.0}))
            if after.keys() < before.keys():
                declared[name] = 1.0
                moved = ", ".join(name for name in before if name not in after)
                self.notes.append(f"{moved} is in by {name} = 1")
                before = after
        self.notes += [f"{name} is {position:.2g}: it is out" for name, position in before.items()]

    def sweep(self) -> None:
        """Measure lift and choose the airspeed of a glide."""
        bench = self.load()
        lift = _swept(bench, FIRST_SPEED)
        for _ in range(2):  # each sweep is flown at a multiple of the previous sweep's stall speed
            lift = _swept(bench, SPEEDS[0] * lift.V_s)
        self._glide(lift)

    def _glide(self, lift: Lift) -> None:
        self.lift, self.speed = lift, self.V_a or SPEEDS[0] * lift.V_s
        self.spare = -lift.at(self.speed)[1]

    def find_throttle(self) -> None:
        """Find the property that moves the throttle if the usual command does not."""
        bench = self.load()
        fdm = bench.fdm
        if "command" in self.tables["engines"] or not fdm.shows(THROTTLE_POSITION):
            return
        position, V = fdm.reader(THROTTLE_POSITION), SPEEDS[0] * self.lift.V_s

        def at(throttle: float) -> float:
            bench.accelerations(_level(V, self.lift.at(V)[0], throttle))
            return position()

        def opening(names: set[str]) -> list[str]:
            """The properties that open the throttle when set to 1."""
            shut, opens = position(), []
            for name in sorted(x for x in names if _settable(fdm, x)):
                before, write = fdm.reader(name)(), fdm.writer(name)
                write(1.0)
                fdm.evaluate()
                if position() - shut > 0.5 and name != THROTTLE_POSITION:
                    opens.append(name)
                write(before)
                fdm.evaluate()
            return opens

        closed, opened = at(0.0), at(1.0)
        if opened - closed > 0.5:
            return
        at(0.0)
        if levers := opening({x for x in self.texts[1] if not OWN.match(x)}):
            self.tables["engines"]["command"] = levers[0]
            self.tables["linked"] |= dict.fromkeys(levers[1:], properties.THROTTLE)
            self.notes.append(f"its throttle is moved by {', '.join(levers)}")
            return
        # A factor on the command is 0 until another simulator's script sets it.
        at(1.0)

        shut = 0.0, 0.0

        def follows(values: Mapping[str, float]) -> bool:
            nonlocal bench, position
            bench = self.load(**self._with(values))
            position = bench.fdm.reader(THROTTLE_POSITION)
            return at(1.0) - at(0.0) > 0.5 and _same(before, self._moves(bench, shut))

        before = self._moves(self.load(), shut)
        values = self._throttle_switches(opening(self.defined - self.values.keys()))
        if found := reads.fewest(values, follows):
            self._set(found, "its throttle does not follow its command")

    def _throttle_switches(self, opening: Sequence[str]) -> dict[str, list[float]]:
        """Values to try of the first property that opens the throttle, or of those on its way."""
        if opening:
            return {opening[0]: [1.0]}
        if values := self._switches([properties.THROTTLE, "fcs/throttle-cmd-norm"]):
            return values
        declared = self.tables["declared"].items()
        zeros = [name for name, x in declared if not x and name not in self.values]
        return {name: [1.0] for name in zeros[:MAX_TRIED_IN]}

    def drive(self) -> None:
        """Choose the airspeed by the thrust, with the first lever settings that let it fly."""
        tables, fdm, lift, refused = self.tables, self.load().fdm, self.lift, None
        texts = set[str]().union(*self.texts, tables["declared"])
        links = {
            name: re.sub(pattern, source, name)
            for pattern, source in TABLES["links"].items()
            for name in sorted(texts)
            if re.fullmatch(pattern, name)
        }
        for how, levers in LEVERS.items():
            tried = deepcopy(tables) | {"linked": tables["linked"] | (links if how else {})}
            names = (*tables["declared"], *tables["settings"])
            for name, (pattern, value) in product(names, levers):
                if re.search(pattern, name) and name not in self.values:
                    tried["declared" if name in tables["declared"] else "settings"][name] = value
            if how and tried == tables:
                continue
            try:
                if how:  # fuel changes the weight
                    lift = _swept(self.load(**tried), SPEEDS[0] * lift.V_s)
                self.speed, self.spare = self._driven(tried, lift)
            except Diverges:
                raise
            except PlantError as error:
                refused = refused or error
                continue
            self.lift = lift
            tables.update(tried)
            self.notes += [f"its engines drive it {how}"] if how else []
            return
        assert refused is not None  # the first levers are always tried
        if isinstance(refused, TooWeak):
            self.notes.append(f"{refused}: its engines stay off")
        elif model_files.has_engine(fdm.files, model_files.ROCKET):
            # JSBSim computes a rocket's thrust from the fuel that it burns.
            note = f"{refused}: a rocket has no thrust while its fuel is frozen, as it is"
            self.notes.append(note)
        else:
            raise refused
        tables["engines"]["count"] = 0
        self._glide(lift)

    def _driven(self, tables: dict[str, Any], lift: Lift) -> tuple[float, float]:
        """Airspeed and excess thrust; findings about the engines go into the tables."""
        table, V_a = tables["engines"], self.V_a
        table["settle_s"] = 0.0  # measured if the aircraft's file does not state it
        bench = self.load(**tables)
        fdm, thrusts = bench.fdm, bench.fdm.thrusts
        weight = fdm.reader("inertia/mass-slugs")() * G_0 / FT

        def settled(V: float, throttle: float, wait: float, bench: Bench = bench) -> FloatArray:
            bench.accelerations(_level(V, lift.at(V)[0], throttle))
            bench.fdm.start_engines()
            bench.fdm.hold(wait, still=SETTLED * 1e-7 if fdm.electric else 0.0)
            return np.array([read() for read in bench.fdm.thrusts])

        def moderate(rate: float) -> bool:
            """Whether at this integration rate the engines soon push like an aeroplane's."""
            other = self.load(**tables | {"inner_loop_rate_hz": rate})
            return 0.0 < settled(V, 1.0, 1.0, other).sum() <= MAX_THRUST * weight

        V = V_a or SPEEDS[0] * lift.V_s
        at_once = settled(V, 0.5, MAX_SETTLING_S)
        table["settle_s"] = _settling(bench, _level(V, lift.at(V)[0], 1.0), thrusts)
        wait = MAX_SETTLING_S if table["settle_s"] else 1.0
        full = settled(V, 1.0, wait)
        try:
            other = _thrust_of_another_kind(fdm, full, weight, partial(settled, V, wait=wait))
        except Diverges:
            finer = (rate for rate in FINER_RATES if rate > fdm.rate and moderate(rate))
            if not (rate := next(finer, None)):
                raise
            tables["inner_loop_rate_hz"] = rate
            return self._driven(tables, lift)
        if other:
            table |= other
            return self._driven(tables, lift)

        def as_full(thrust: FloatArray) -> bool:
            return bool(abs(full.sum() - thrust.sum()) < 1e-3 * abs(full.sum()))

        # Some levers are fully open at one half.
        if as_full(at_once) and as_full(settled(V, 0.1, wait)):
            raise Refusal("its thrust does not follow the throttle")
        points = []  # excess thrust, airspeed, thrust-to-drag ratio
        for V in (V_a,) if V_a else [share * lift.V_s for share in SPEEDS]:
            thrust = float(settled(V, 1.0, wait).sum()) / weight
            drag = fdm.reader("forces/fwx-aero-lbs")() / weight  # it may depend on the throttle
            if thrust - drag >= SPARE_THRUST:
                return V, thrust - drag
            points.append((thrust - drag, V, thrust / drag if drag > 0.0 else math.inf))
        best = max(ratio for _, _, ratio in points)
        if not best > 1.0:
            if V_a:  # another airspeed may work
                raise Refusal(f"its thrust is {best:.2f} of its drag at {V_a:g} m/s")
            raise TooWeak(f"its thrust is at most {best:.2f} of its drag at any airspeed")
        spare, V, _ = max(points)
        return V, spare

    def note_engines(self) -> None:
        """Note the source of the thrust, and a propeller that couples pitch with yaw."""
        engines = self.tables["engines"]
        if not engines["count"]:
            self.notes.append("it flies without an engine, about its steady glide")
            return
        bench = self.load()
        if (fdm := bench.fdm).shows(FUEL) and not fdm.electric and not fdm.reader(FUEL)():
            self.notes.append(
                "its tanks are empty: it flies without the weight of fuel, and its engines run "
                f"because fuel is frozen; `--set {FIRST_TANK}=LBS` fills the first tank"
            )
        if "full" in engines:
            self.notes.append(
                f"its engine is far too strong: full throttle is {engines['full']:.3g} of its "
                "lever, where it pushes with about the weight"
            )
        if rate := self.tables.get("inner_loop_rate_hz"):
            self.notes.append(
                f"its propeller is too light for steps of 5 ms: its inner loop runs at {rate:g} Hz"
            )
        if "thrust" in engines:
            self.notes.append(f"its engine has no thrust: an external force pushes it ({EXTERNAL})")
        propellers = [root for root in self.roots if root.tag == "propeller"]
        if any(map(in_inches, propellers)):
            self.notes.append(
                "the diameter of its propeller has no unit: it is inches, not feet as JSBSim has it"
            )
        inertias = [float(root.findtext("ixx", "0")) for root in propellers]
        if not (inertias and fdm.shows(PROPELLER_RPM)):
            return
        bench.accelerations(self.level())
        rpm = fdm.reader(PROPELLER_RPM)()
        across = math.prod(fdm.reader(BODY[f"inertia {axes}"])() for axes in ("yy", "zz"))
        nutation = max(inertias) * abs(rpm) * math.pi / 30.0 / math.sqrt(across)
        if nutation >= FAST_NUTATION:
            self.notes.append(
                f"its propeller makes it a gyroscope that nutates at {nutation:.3g} rad/s: an "
                f"inertia of {max(inertias):.3g} slug ft2 at {rpm:.3g} rpm"
            )

    def note_values(self, off: Sequence[SwitchedOff]) -> None:
        """Note values from FlightGear's files, and properties that are 0 without a given value."""
        declared = self.tables["declared"]
        taken = {name: x for name, x in self.taken.items() if declared.get(name) == x}
        if taken:
            values = [f"{name} = {x:.7g}" for name, x in taken.items() if x]
            zeros = [name for name, x in taken.items() if not x]
            values += [f"0 for {listed(zeros, most=MAX_LISTED)}"] if zeros else []
            verb = "states" if len(self.stated.files) == 1 else "state"
            said = listed(values, most=MAX_LISTED)
            self.notes.append(f"{listed(self.stated.files)} {verb} {said}")
        levers = {name: x for name, x in self.stated_read.items() if x != self.taken[name]}
        self.notes += [f"{name} is 0 as in flight, {x:g} is stated" for name, x in levers.items()]
        for names in dict.fromkeys(part.names for part in off):
            verb, it = ("is", "it") if len(names) == 1 else ("are", "them")
            parts = listed([part.words for part in off if part.names == names])
            self.notes.append(
                f"{listed(names)} of another simulator {verb} 0 and switches off {parts}: "
                f"--set {names[0]}=VALUE states {it}{self._why_unknown(names)}"
            )
        told = {name for part in off for name in part.names}
        if names := [name for name in self.zeros if name not in told]:
            more = len(names) - MAX_NAMED
            rest = f" and {more} more, all in `[declared]`" if more > 0 else ""
            shown = ", ".join(names[:MAX_NAMED])
            why = self._why_unknown(names)
            self.notes.append(f"properties of another simulator are 0: {shown}{rest}{why}")

    def switched_off(self) -> list[SwitchedOff]:
        """Functions of the aerodynamics that are always 0 because declared properties are 0."""
        # Gear, flaps and brakes are retracted, as in flight.
        zeros = [name for name in self.zeros if not LEVERS_IN.search(name)][:MAX_TRIED_IN]
        bench = self.load()
        functions = _functions(bench.fdm)
        names = [name for axis in functions.values() for name in axis]
        reads = [bench.fdm.reader(name) for name in names]
        level = self.level(0.0)
        states = [level, *(replace(level, **{x: getattr(level, x) + by}) for x, by in SHAKEN)]

        def sizes(states: Sequence[AirframeState], *at_zero: str) -> FloatArray:
            """Sizes of the functions in each state, shape (states, functions)."""
            for name in zeros:
                bench.fdm.declared_writer(name)(0.0 if name in at_zero else 1.0)
            rows = []
            for state in states:
                bench.accelerations(state)
                rows.append([abs(read()) for read in reads])
            return np.nan_to_num(np.array(rows))

        if not (zeros and names):
            return []
        try:
            as_it_is, with_ones = sizes(states, *zeros), sizes(states)
            off = np.asarray(~as_it_is.any(axis=0) & with_ones.any(axis=0))
            shown = [states[i] for i in sorted({*with_ones.argmax(axis=0)[off].tolist()})]
            by = {name: sizes(shown, name) for name in zeros} if shown else {}
        except PlantError:  # the model flies only with 0
            return []
        found = []
        for axis, inside in functions.items():
            others = as_it_is[:, [names.index(name) for name in inside]].sum(axis=1)
            for i in (names.index(name) for name in inside if off[names.index(name)]):
                switches = tuple(name for name in zeros if not by[name][:, i].any())
                size = with_ones[:, i]
                share = float(np.max(size / np.maximum(size + others, TINY)))
                found.append(SwitchedOff(names[i], switches, axis, share))
        return [part for part in found if part.names and part.share >= LEAST_SHARE]

    def surfaces(self) -> dict[str, Any]:
        """Tables of the surfaces, commanded through the model's flight control or past it."""
        tables, level = self.tables, self.level()
        moved, faults = self._answers(self.load())
        if self._switch_on(faults.keys() - moved.keys()):
            moved, faults = self._answers(self.load())
        surfaces = {name: tables["surfaces"][name] | table for name, table in moved.items()}
        if not faults:
            for wrong in surface_faults(self.load(surfaces=surfaces), level):
                name = wrong.split("`")[1]
                faults[name] = f"its {name} does not move in proportion to the {name} command"
        if not faults:
            return surfaces
        fault = next(iter(faults.values()))
        past, measured = self._past_flight_control()
        # Only the dead surfaces are replaced, unless the flight control is at fault without them.
        # A rudder whose command the model does not read is dead too.
        dead = faults.keys() - moved.keys()
        for replaced in ({name: past[name] for name in past if name not in moved}, past):
            if not replaced:
                continue
            whole = {name: tables["surfaces"][name] for name in past} | replaced
            frozen = self._held(past) if replaced == past else {}
            declared = tables["declared"] | frozen
            moved_past, faults_past = self._answers(self.load(surfaces=whole, declared=declared))
            if faults_past:
                continue
            of = "" if replaced == past else f" for its {listed([*replaced])}"
            self.notes.append(f"its flight control is bypassed{of}: {fault}")
            if frozen:
                held = ", ".join(name.removeprefix("ft/") for name in frozen)
                self.notes.append(f"its flight control moves {held}: held as in level flight")
                tables["declared"] |= frozen
            return {name: whole[name] | table for name, table in moved_past.items()}
        if dead:
            raise Refusal(fault + measured)
        self.notes.append(fault)
        return surfaces

    def _answers(self, bench: Bench) -> tuple[dict[str, dict[str, Any]], dict[str, str]]:
        """Travel of the surfaces that have an effect, and faults in sentences, by surface."""
        answers, faults, level = {}, dict[str, str](), self.level()
        for name, _ in bench.fdm.config.surfaces.named():
            try:
                answers[name] = _moved(bench, level, name)
            except Refusal as error:
                if name != "rudder" or self.reads_rudder:
                    faults[name] = f"{error}{self._zeros_on_way(name)}"
        if not faults:
            drifts = {x: _drift(bench, level, x, effect) for x, (effect, _) in answers.items()}
            faults = {name: drift for name, drift in drifts.items() if drift}
        return {name: table for name, (_, table) in answers.items()}, faults

    def _commands(self, surface: str) -> list[str]:
        """Properties of a surface's command: its own, and those that follow it."""
        command = self.tables["surfaces"][surface].get("command") or f"fcs/{surface}-cmd-norm"
        linked = self.tables["linked"].items()
        return [command, *(name for name, to in linked if to.lstrip("-") == command)]

    def _switches(self, commands: Sequence[str]) -> dict[str, list[float]]:
        """Properties on the way of commands that are 0 by default, with values to try."""
        fdm, on_way = self.load().fdm, reads.upstream(self.parts, commands)
        known = self.values.keys() | self.taken.keys() | self.tables["declared"].keys()
        own = sorted(name for name in self.defined - known if _settable(fdm, name))
        names = [*self.zeros, *(name for name in own if not fdm.reader(name)())]
        names = [x for x in names if reads.plain(x) in on_way and not LEVERS_IN.search(x)]
        return {name: reads.trial_values(self.parts, name) for name in names}

    def _zeros_on_way(self, surface: str) -> str:
        """The end of a sentence about a command: properties on its way that are 0 by default."""
        if not (names := [*self._switches(self._commands(surface))]):
            return ""
        them, are = ("it", "is") if len(names) == 1 else ("them", "are")
        return (
            f"; {listed(names, most=MAX_NAMED)} on its way {are} 0 by default: "
            f"--set {names[0]}=VALUE states {them}{self._why_unknown(names)}"
        )

    def _with(self, values: Mapping[str, float]) -> dict[str, dict[str, float]]:
        """The tables with other values of properties."""
        changed = {kind: dict(self.tables[kind]) for kind in ("declared", "settings")}
        for name, value in values.items():
            changed["declared" if name in changed["declared"] else "settings"][name] = value
        return changed

    def _set(self, values: Mapping[str, float], without: str) -> None:
        """Set properties that nothing states; `without`: what is so while they are 0."""
        self.tables.update(self._with(values))
        states = " ".join(f"--set {name}={value:g}" for name, value in values.items())
        names = [f"{name} = {value:g}" for name, value in values.items()]
        it, verb = ("it", "is") if len(names) == 1 else ("them", "are")
        self.notes.append(f"{listed(names)} {verb} assumed: with 0 {without}; {states} states {it}")

    def _switch_on(self, dead: Collection[str]) -> bool:
        """Set properties whose 0 switches off commands; whether there are any."""
        left, set_ = [name for name in SURFACES if name in dead], False
        while left:
            before = self._moves(self.load())
            commands = [command for name in left for command in self._commands(name)]
            revived = partial(self._revived, left, before)
            found = reads.fewest(self._switches(commands), lambda x: bool(revived(x)))  # noqa: B023
            if not (names := revived(found) if found else []):
                break
            plural = "command has" if len(names) == 1 else "commands have"
            self._set(found, f"its {listed(names)} {plural} no effect")
            left, set_ = [name for name in left if name not in names], True
        return set_

    def _revived(
        self,
        dead: Sequence[str],
        before: Mapping[str, tuple[float, ...]],
        values: Mapping[str, float],
    ) -> list[str]:
        """Those of dead commands that have an effect with values; none if anything else changes."""
        names, level = list[str](), self.level()
        try:
            bench = self.load(**self._with(values))
            for name in dead:
                with suppress(Refusal):
                    _moved(bench, level, name)
                    names.append(name)
            return names if names and _same(before, self._moves(bench)) else []
        except PlantError:  # JSBSim may not run with them
            return []

    def _moves(
        self, bench: Bench, throttles: tuple[float, float] = (0.5, 1.0)
    ) -> dict[str, tuple[float, ...]]:
        """Effects of the commands, and accelerations of their axes in four states; the others."""
        level, effects = self.level(throttles[0]), {}
        for name, _ in bench.fdm.config.surfaces.named():
            rate, _ = EFFECTS[name]
            low, high = (bench.accelerations(replace(level, **{name: x})) for x in (-0.5, 0.5))
            effects[name] = high[rate] - low[rate]
        stirred = {name: getattr(level, name) + by for name, by in BESIDE.items()}
        states = [bench.accelerations(replace(level, **stirred)), bench.accelerations(level)]
        bench.fdm.hold(HOLD_TIMES[0])
        later = {f"{x}_dot": f"accelerations/{x}dot-rad_sec2" for x in "pqr"}
        states.append(states[-1] | {x: bench.fdm.reader(name)() for x, name in later.items()})
        states.append(bench.accelerations(replace(level, throttle=throttles[1])))
        axes = {x: [y[EFFECTS[x][0]] for y in states] for x in effects}
        moves = {name: (effect, *axes[name]) for name, effect in effects.items()}
        return moves | {x: tuple(y[x] for y in states) for x in ("u_dot", "v_dot", "w_dot")}

    def _past_flight_control(self) -> tuple[dict[str, dict[str, Any]], str]:
        """Surfaces that aerodynamics read past the flight control, by name or effect; notes."""
        read, surfaces = self.texts[0], self.tables["surfaces"]
        replaced, measured = {}, ""
        for name in surfaces:
            names = NAMES.get(name, name)
            pattern = re.compile(
                rf"fcs/([\w-]+/)*(mag-)?(left-)?{names}-(pos|deflection)-(rad|deg|norm)"
            )
            replaced[name] = sorted(entry for entry in read if pattern.fullmatch(entry))
        # The magnitude of a deflection (mag) gives drag, not a moment.
        if not all(any("mag-" not in x for x in replaced[name]) for name in VERBS):
            moving, measured = self._movers()
            replaced = {name: moving[name] for name in replaced}
        lacking = [name for name, positions in replaced.items() if not positions]
        if lacking == ["rudder"] and not self.reads_rudder:
            del replaced["rudder"]
        elif lacking:
            return {}, measured
        return {name: surfaces[name] | {"replaces": x} for name, x in replaced.items()}, ""

    def _movers(self) -> tuple[dict[str, list[str]], str]:
        """Positions that aerodynamics read, by the surface with their effect, and a note."""
        fdm, level = self.load().fdm, self.level()
        computed = {part.get("name", "") for root in self.roots for part in root.iter("function")}
        read = self.texts[0] - computed
        names = sorted(name for name in read if not OWN.match(name) and fdm.shows(name))
        frozen = {f"ft/{name}": fdm.reader(name)() for name in names}
        bench = self.load(declared=self.tables["declared"] | frozen)
        inertias = np.array([bench.fdm.reader(BODY[f"inertia {2 * axis}"])() for axis in "xyz"])

        # Each is changed alone, in level flight. A minus marks the opposite sense.
        def moments(name: str, change: float) -> FloatArray:
            bench.fdm.writer(name)(frozen[name] + change)
            rates = bench.accelerations(level)
            bench.fdm.writer(name)(frozen[name])
            return inertias * [sign * rates[rate] for rate, sign in EFFECTS.values()]

        effects = np.zeros((len(names), len(EFFECTS)))
        for row, name in zip(effects, frozen, strict=True):
            change = CHANGE * (ONE_RADIAN if name.endswith("deg") else 1.0)
            row[:] = moments(name, change) - moments(name, -change)
        sizes = np.nan_to_num(np.abs(effects))
        shares = sizes / np.maximum(sizes.max(axis=0, initial=0.0), MIN_EFFECT * inertias)
        moves = shares >= MOVER
        moves[:, 2] &= (sizes[:, 2] > sizes[:, 0]) & ~moves[:, 0]
        movers = {
            surface: [
                ("-" if effects[i, k] < 0.0 else "") + names[i] for i in np.flatnonzero(which)
            ]
            for k, (surface, which) in enumerate(zip(EFFECTS, moves.T, strict=True))
        }
        lacking = " or ".join(VERBS[name] for name in VERBS if not movers[name])
        nothing = f"its aerodynamics read nothing that {lacking} it"
        if names:
            tried = ", ".join(names[:MAX_NAMED]) + ", ..." * (len(names) > MAX_NAMED)
            nothing = f"of what its aerodynamics read ({tried}) nothing {lacking} it"
        return movers, f", and {nothing}" if lacking else ""

    def _held(self, past: Mapping[str, Any]) -> dict[str, float]:
        """Values in level flight of other positions that flight control moves."""
        bench, level = self.load(surfaces=past), self.level()
        fdm = bench.fdm
        replaced = {name.removeprefix("-") for table in past.values() for name in table["replaces"]}
        names = sorted(name for name in self.texts[0] - replaced if name.startswith("fcs/"))
        reads = {name: fdm.reader(name) for name in names if fdm.shows(name)}
        shown = []
        for name, change in STIRRED:
            bench.accelerations(replace(level, **{name: getattr(level, name) + change}))
            shown.append([read() for read in reads.values()])
            fdm.hold(MAX_SETTLING_S)
            shown.append([read() for read in reads.values()])
        moves = np.ptp(shown, axis=0) > MOVES
        at_rest = zip(reads, shown[1], moves, strict=True)  # their values in level flight
        return {f"ft/{name}": value for name, value, moved in at_rest if moved}


def _same(before: Mapping[str, tuple[float, ...]], after: Mapping[str, tuple[float, ...]]) -> bool:
    """Whether the commands that had an effect still have it, and else no acceleration changed."""
    for name, values in before.items():
        effect = abs(values[0])
        if name in EFFECTS and effect < MIN_EFFECT:  # it had none
            continue
        most = SAME_EFFECT * effect if name in EFFECTS else SAME_ACCELERATION
        if not np.abs(np.subtract(after[name], values)).max() <= most:
            return False
    return True


def _thrust_of_another_kind(
    fdm: Fdm, full: FloatArray, weight: float, settled: Callable[..., FloatArray]
) -> dict[str, Any]:
    """Keys of `[engines]` for thrust as an external force, or for a far too strong engine."""
    if not full.any() and fdm.reader(EXTERNAL)() > 0.0:
        return {"thrust": EXTERNAL}
    for i, thrust in enumerate(full):
        if not thrust > 0.0:
            engine = f"propulsion/engine[{i}]"
            does = "does not push" if fdm.reader(f"{engine}/set-running")() else "does not run"
            shown = {name: f"{engine}/{name}" for name in ENGINE_SHOWS}
            said = [f"{name} {fdm.reader(x)():.3g}" for name, x in shown.items() if fdm.shows(x)]
            raise Refusal(
                f"engine {i + 1} of {len(full)} {does} at full throttle: {', '.join(said)}"
            )
    strong = full.sum() > MAX_THRUST * weight
    if not strong and fdm.rate not in FINER_RATES:
        return {}
    fdm.hold(MAX_SETTLING_S, rate=2.0 * fdm.rate)
    if not abs(sum(read() for read in fdm.thrusts) / full.sum() - 1.0) <= SETTLED:
        raise Diverges(
            f"the speed of its propeller diverges: at full throttle it pushes with "
            f"{full.sum() / weight:.3g} times the weight, and with another step of the integration "
            f"otherwise (the inertia `ixx` of the propeller is too small for {1e3 / fdm.rate:g} ms)"
        )
    if not strong:
        return {}
    shares = 0.5 ** np.arange(1.0, 16.0)
    weak = (float(share) for share in shares if settled(throttle=share).sum() <= weight)
    share = next(weak, None)
    return {"full": share} if share else {}


def _settling(bench: Bench, state: AirframeState, thrusts: list[Callable[[], float]]) -> float:
    """Settling time of the engines from half to full throttle, s; 0 if they respond at once."""
    bench.accelerations(state)
    history = [sum(read() for read in thrusts)]
    for _ in range(int(MAX_SETTLING_S)):
        bench.fdm.hold(1.0)
        history.append(sum(read() for read in thrusts))
    off = np.abs(np.array(history) - history[-1]) > SETTLED * abs(history[-1])
    last = int(np.flatnonzero(off)[-1]) + 1 if off.any() else 0
    if bench.fdm.electric:  # with a closed throttle a propeller slows down slowly
        last = min(SLOWS_DOWN * last, LONGEST_SETTLING_S)
    return max(PROPELLER_SETTLES, float(last)) if last else 0.0


def _moved(bench: Bench, level: AirframeState, name: str) -> tuple[float, dict[str, Any]]:
    """Half the difference of the effects of full commands, rad/s^2, and the travel."""
    fdm, (rate, sign) = bench.fdm, EFFECTS[name]
    surface = getattr(fdm.config.surfaces, name)
    positions = [fdm.reader(position) for position in POSITIONS[name] if fdm.has(position)]

    def at(command: float) -> tuple[float, list[float]]:
        effect = bench.accelerations(replace(level, **{name: command}))[rate]
        return effect, [read() for read in positions]

    # Past the flight control the aerodynamics read radians.
    full = USUAL_TRAVEL if surface.replaces else 1.0
    neutral, neutral_read = at(0.0)
    sides = []
    for side in (-1.0, 1.0):
        answers = [at(side * full * part) for part in COMMANDS]
        effects = np.array([effect - neutral for effect, _ in answers])
        if not np.isfinite(effects).all():
            raise Refusal(f"the effect of its {name} on {rate} is not finite")
        last = _last_usable(effects)
        usable = float(COMMANDS[last - 1]) if last else 0.0
        reach = [
            max((abs(p - was) for p, was in zip(deflected, neutral_read, strict=True)), default=0)
            for _, deflected in (answers[0], answers[last - 1])
        ]
        # Position at the full command, and the used share of it, since a command may be clipped.
        whole = max(reach[0] / COMMANDS[0], reach[1] / usable) if usable else 0.0
        used = reach[1] / whole if whole else usable
        if not whole and (surface.command or "").endswith("rad"):
            whole = 1.0  # the command is the position, in rad
        sides.append((float(effects[-1]), float(whole), float(used)))
    (effect_low, travel_low, usable_low), (effect_high, travel_high, usable_high) = sides
    largest = max(abs(effect_low), abs(effect_high))
    one_sense = largest >= MIN_EFFECT and effect_low * effect_high > 0.0
    if largest < MIN_EFFECT or one_sense or not (usable_low and usable_high):
        command = surface.command or f"fcs/{name}-cmd-norm"
        again = at(0.0)[0]
        if largest >= MIN_EFFECT and abs(again - neutral) > DRIFT * largest:
            raise Refusal(
                f"its flight control does not come to rest: with the same {name} command "
                f"({command}) {rate} was {neutral:.3g}, then {again:.3g} rad/s^2"
            )
        raise Refusal(
            f"its {name} command ({command}) has no usable effect"
            + (f": it changes {rate} in one sense only" if one_sense else "")
        )
    sense = math.copysign(1.0, sign * (effect_high - effect_low))
    if surface.replaces:
        travel_low = travel_high = USUAL_TRAVEL
    travels = [t if 0.01 < t < MAX_TRAVEL else USUAL_TRAVEL for t in (travel_low, travel_high)]
    low, high = -sense * travels[0], sense * travels[1]
    stops = sorted((usable_low * low, usable_high * high))
    return (effect_high - effect_low) / 2.0, {
        "travel_deg": [round(math.degrees(stop), 2) for stop in stops],
        "full_rad": [round(low, 5), round(high, 5)],
    }


def _last_usable(effects: FloatArray) -> int:
    """Number of `COMMANDS` until the effect stops growing with the command; 0 without an effect."""
    slopes = np.diff(effects, prepend=0.0) / np.diff(COMMANDS, prepend=0.0)
    first = slopes[0] if abs(slopes[0]) > 0.1 * np.abs(slopes).max() else slopes.mean()
    more = slopes / first > CLIPPED if first else np.zeros(len(slopes), bool)
    last = len(more) if more.all() else int(np.argmin(more))
    if not last and effects[-1]:  # a filter may swallow the first steps
        last = len(more) - int(np.argmax((slopes / effects[-1] > CLIPPED)[::-1]))
    return last


def _drift(bench: Bench, level: AirframeState, name: str, full_effect: float) -> str:
    """A sentence about the drift under a constant command; empty without a drift."""
    fdm, (rate, _) = bench.fdm, EFFECTS[name]
    command = 0.1 * (USUAL_TRAVEL if getattr(fdm.config.surfaces, name).replaces else 1.0)
    moved = replace(level, **{name: command})
    read = fdm.reader(f"accelerations/{rate[0]}dot-rad_sec2")
    at_once = bench.accelerations(moved)[rate]
    neutral = bench.accelerations(level)[rate]
    bench.accelerations(moved)
    fdm.hold(HOLD_TIMES[0])
    earlier = read()
    fdm.hold(HOLD_TIMES[1] - HOLD_TIMES[0])
    effect = max(abs(at_once - neutral), 0.1 * abs(full_effect))
    if abs(read() - earlier) > DRIFT * effect:
        return f"its flight control drifts while the {name} command is held"
    if abs(earlier - at_once) > 2.0 * DRIFT * effect:
        return f"its flight control keeps moving after the {name} command"
    return ""
