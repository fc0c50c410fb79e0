"""Columns of a log checked against each other for their units, signs and axes."""

import math
from collections.abc import Mapping

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.errors import InputError, RecordingError
from flighttune.logs.read import Stream
from flighttune.references.maps import north_east
from flighttune.simulate.run import Run
from flighttune.units import DEG, DEG_PER_RAD, FT, G_0, KNOT

# Ground speed below which a vehicle does not fly, m/s.
SLOWEST = 5.0

# Vehicles without wings: PX4's type of vehicle, ArduPilot's name, types of MAVLink.
ROTARY = ("type 1 of PX4", "ArduCopter", *(f"type {kind}" for kind in (2, 3, 4, 13, 14, 15)))

# Range in which a ratio of two measurements of one quantity is taken as one of equal units.
EQUAL = (0.7, 1.4)

# The same of what steps, lags and wind disturb more.
TURNS = (0.4, 2.0)

# Units taken for each other, and the factor that mends it; sizes between two of them are near both.
MISTAKEN = {
    "ft read as m": FT,
    "m read as ft": 1.0 / FT,
    "deg read as rad": DEG,
    "rad read as deg": 1.0 / DEG,
    "kn read as m/s": KNOT,
    "m/s read as kn": 1.0 / KNOT,
    "km/h read as m/s": 1.0 / 3.6,
    "m/s read as km/h": 3.6,
    "m/s2 read as g": 1.0 / G_0,
    "g read as m/s2": G_0,
    "ft/s2 read as g": FT / G_0,
    "its sign is turned": 1.0,
}
NEAR = 0.15  # logarithm of a factor over that of a known mistake
ALIKE = 0.7  # correlation from which on two columns show the same motion
BEHIND_S = (0.0, 0.5, 1.0, 2.0)  # times by which a response may come after its command, s
STILL = 1.0 * DEG  # rms of angles and rates, rad and rad/s, from which on they are compared
TRAILING = 4.0 * DEG  # constant angle between course and path that is taken as none, rad

# Median angle between course and path, and between nose and course, that is taken as right, rad.
ALONG = 20.0 * DEG

PATH_S = 2.0  # time over which a path is compared with its velocity, s


def refuse_wrong(*runs: Run) -> None:
    """Refuse logs whose columns contradict each other, before anything is fitted to them."""
    for run in runs:
        for sentence in (run.provenance.log or {}).get("wrong", ()):
            raise InputError(
                f"{run.label}: the columns of the log must agree: {sentence}. Where the column is "
                "right, --column trusted=NAME,NAME passes what is said of a signal."
            )


def degrees_as_radians(raw: Mapping[str, Stream]) -> list[str]:
    """Sentences on angles that lie where those in degrees do."""
    limits = dict.fromkeys(("phi", "phi_cmd"), math.pi)
    limits |= dict.fromkeys(("theta", "gamma", "lat"), 0.5 * math.pi)
    limits |= dict.fromkeys(("lon", "chi", "psi", "chi_ref"), math.tau)
    sentences = []
    for name, limit in limits.items():
        values = raw[name][1] if name in raw else np.zeros(0)
        values = values[np.isfinite(values)]
        most = float(np.percentile(np.abs(values), 99.0)) if len(values) > 1 else 0.0
        # A course may run on over many turns; in degrees it also jumps, or rests far from zero.
        running = np.abs(np.diff(values)).max(initial=0.0) < 30.0 * math.tau and most < 60.0
        if most > 1.01 * limit and not (limit == math.tau and running):
            factor = f"a factor of {DEG:.4g} would do (deg read as rad)"
            sentences.append(f"{name} goes up to {most:.3g} rad: {factor}")
    return sentences


def _cure(ratio: float) -> str:
    """The factor that would bring a ratio of two columns to 1, and the mistake that it mends."""
    size = abs(math.log(abs(ratio)))
    words, factor = min(MISTAKEN.items(), key=lambda item: abs(math.log(abs(ratio) * item[1])))
    if abs(math.log(abs(ratio) * factor)) > NEAR or (ratio > 0.0 and factor == 1.0):
        return f"a factor of {1.0 / ratio:.3g} would do"
    turned = " and its sign turned" if ratio < 0.0 and size > NEAR else ""
    return f"a factor of {math.copysign(factor, ratio):.4g} would do ({words}{turned})"


def _ratio(column: FloatArray, other: FloatArray, least: float) -> float:
    """Size of a motion over that by other columns; NaN where they do not show the same one."""
    there = np.isfinite(column) & np.isfinite(other)
    if np.count_nonzero(there) < 50:
        return math.nan
    a, b = (values[there] - values[there].mean() for values in (column, other))
    size, base = float(np.std(a)), float(np.std(b))
    if not (size > 0.0 and base > least):
        return math.nan
    alike = float(np.mean(a * b)) / (size * base)
    return math.copysign(size / base, alike) if abs(alike) > ALIKE else math.nan


class _Judge:
    """Ratios of columns to the same by others over 2 s, and sentences on those that are wrong."""

    def __init__(self, values: Mapping[str, FloatArray], dt: float) -> None:
        self.values, self.flying, self.dt = values, _flying(values), dt
        self._span = max(1, round(0.5 * PATH_S / dt))
        self.sentences: list[str] = []

    def slope(self, name: str, *, angle: bool = True) -> FloatArray:
        """Rate of a column; zero without it."""
        if name not in self.values:
            return np.zeros(len(self.flying))
        column = self.values[name]
        return self._slope(np.unwrap(np.nan_to_num(column)) if angle else column) + 0.0 * column

    def _slope(self, column: FloatArray) -> FloatArray:
        rate, span = np.full(len(column), np.nan), self._span
        rate[span:-span] = (column[2 * span :] - column[: -2 * span]) / (2 * span * self.dt)
        return rate

    def mean(self, column: FloatArray) -> FloatArray:
        """Mean while a vehicle flies."""
        return self._slope(np.cumsum(np.nan_to_num(column)) * self.dt) + 0.0 * column * self.flying

    def say(
        self, name: str, ratio: float, others: str, within: tuple[float, float] = TURNS
    ) -> None:
        """Put in a sentence where a ratio is not that of equal units and signs."""
        if math.isfinite(ratio) and not within[0] < ratio < within[1]:
            either = "" if others == "level flight" else f" (or its inverse on {others})"
            said = f"{name} is {ratio:.3g} times the value from {others}: {_cure(ratio)}{either}"
            self.sentences.append(said)


def _attitude_contradictions(judge: _Judge) -> list[str]:
    """Sentences on attitude, its rates and commands against each other and the course."""
    values, flying = judge.values, judge.flying
    theta, phi = values.get("theta", np.zeros(len(flying))), values["phi"]
    roll, pitch, heading, turn = (judge.slope(name) for name in ("phi", "theta", "psi", "chi"))
    judge.say("the change of psi", _ratio(heading * flying, turn, STILL), "the course")
    yaw = (heading if "psi" in values else turn) * np.cos(theta)
    rates = {
        "p": roll - yaw * np.tan(theta),
        "q": pitch * np.cos(phi) + yaw * np.sin(phi),
        "r": yaw * np.cos(phi) - pitch * np.sin(phi),
    }
    for name in {*rates} & {*values}:
        ratio = _ratio(judge.mean(values[name]), rates[name], STILL)
        judge.say(name, ratio, "the changes of attitude")
    if "V_g" in values:
        sideways = judge.mean(turn * values["V_g"])
        ratio = _ratio(judge.mean(G_0 * np.tan(phi)), sideways, 0.1)
        judge.say("phi", ratio, "course and speed in turns", (0.4, 2.5))
    if "phi_cmd" in values:
        behind = (max(1, round(late / judge.dt)) for late in BEHIND_S)
        ratios = [_ratio(values["phi_cmd"][:-k], (phi * flying)[k:], STILL) for k in behind]
        ratio = next((ratio for ratio in ratios if math.isfinite(ratio)), math.nan)
        judge.say("phi_cmd", ratio, "the roll", (0.3, 4.0))
    return judge.sentences


def _without_lift(judge: _Judge, *names: str) -> list[FloatArray]:
    """Means of signals without what goes with the angle of attack in a steady flight.

    The nose is above the path by about alpha cos(phi), and alpha grows with n_z over V_a^2.
    """
    level = np.cos(judge.values["phi"])
    speed = judge.values.get("V_a", judge.values.get("V_g", level))
    lift = level * judge.values.get("n_z", 1.0 / np.maximum(level, 0.2)) / speed**2
    columns = [judge.mean(judge.values[name]) for name in names]
    terms = np.column_stack([judge.mean(np.ones(len(level))), judge.mean(level), judge.mean(lift)])
    there = np.isfinite(np.column_stack([terms, *columns])).all(axis=1)
    left = []
    for column in columns:
        weights = np.linalg.lstsq(terms[there], column[there], rcond=None)[0]
        left.append(np.where(there, column - terms @ weights, np.nan))
    return left


def _contradictions(values: Mapping[str, FloatArray], dt: float) -> list[str]:
    """Sentences on columns that others contradict, each with the factor that would do."""
    judge = _Judge(values, dt)
    for name in ("n_z", "n_z_cmd"):
        middle = _median(values[name] * judge.flying) if name in values else math.nan
        judge.say(f"{name}, in the median of the flight,", middle, "level flight", (0.6, 1.6))
    if "gamma" in values and "theta" in values:
        steep, pitch = _without_lift(judge, "gamma", "theta")
        judge.say("gamma", _ratio(steep, pitch, 0.15 * STILL), "theta and lift", (0.4, 2.5))
    if "gamma" in values and "n_z" in values:
        excess = values["n_z"] * np.cos(values["phi"]) - np.cos(values["gamma"])
        rate = judge.mean(G_0 * excess / values["V_g"])
        ratio = _ratio(judge.slope("gamma") * judge.flying, rate, 0.2 * STILL)
        judge.say("the change of gamma", ratio, "n_z")
    if "h" in values and "v_down" in values:
        climb = judge.slope("h", angle=False) * judge.flying
        ratio = _ratio(climb, -judge.mean(values["v_down"]), 0.3)
        judge.say("the slope of h", ratio, "the vertical speed", EQUAL)
    if {"V_a", "v_north", "v_east"} <= set(values):
        nose = values.get("psi", values["chi"])
        through = [judge.mean(values["V_a"] * part(nose)) for part in (np.cos, np.sin)]
        over = [judge.mean(values[name]) for name in ("v_north", "v_east")]
        air, ground = (np.concatenate([x - _median(x) for x in pair]) for pair in (through, over))
        ratio = _ratio(air, ground, 1.0)
        judge.say("V_a in turns", ratio, "the ground speed", EQUAL)
        drifts = zip(("north", "east"), through, over, strict=True)
        for axis, air, ground in drifts if "wind_north" in values and ratio > 0.0 else ():
            drift = _median(ground - air)
            if abs(drift) > 3.0:
                ratio = _median(values[f"wind_{axis}"]) / drift
                judge.say(f"wind_{axis}", ratio, "speeds and nose", (0.25, 2.5))
    return _attitude_contradictions(judge)


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def checked(
    raw: Mapping[str, FloatArray], t: FloatArray
) -> tuple[dict[str, FloatArray], list[str], list[str]]:
    """Signals of a run from raw ones on one time base, and sentences about what was checked.

    The last sentences are those on columns that contradict each other.
    """
    values, dt = dict(raw), float(t[1] - t[0])
    notes, wrong = _motion(values, dt)
    if "wind_speed" in values and "wind_from" in values:
        for name, part in (("wind_north", np.cos), ("wind_east", np.sin)):
            values[name] = -values["wind_speed"] * part(values["wind_from"])
    if "wind_north" in values:
        values.setdefault("wind_down", np.zeros(len(t)))
    notes += _load_notes(values)
    wrong += _contradictions(values, dt)
    for place in ("north", "east", "down"):
        if place in values:
            there = values[place][np.isfinite(values[place])]
            values[place] = values[place] - (there[0] if len(there) else 0.0)
    for name in ("chi", "gamma"):
        if {name, f"{name}_ref"} <= set(values):
            error = values[f"{name}_ref"] - values[name]
            values[f"{name}_err"] = np.angle(np.exp(1j * error))
    return values, notes, wrong


def _motion(values: dict[str, FloatArray], dt: float) -> tuple[list[str], list[str]]:
    """Put in course, path angle, and what is missing of position and velocity; check them."""
    notes, wrong = [], []
    if {"lat", "lon"} <= set(values) and "north" not in values:
        values["north"], values["east"] = _plane(values["lat"], values["lon"])
    if "down" not in values and "h" in values:
        values["down"] = -values["h"]
    if "v_north" not in values and {"V_g", "chi"} <= set(values):
        values["v_north"] = values["V_g"] * np.cos(values["chi"])
        values["v_east"] = values["V_g"] * np.sin(values["chi"])
    for velocity, place in (("v_north", "north"), ("v_east", "east"), ("v_down", "down")):
        if velocity not in values and place in values:
            values[velocity] = np.gradient(values[place], dt)
            notes.append(f"{velocity} is the slope of {place}")
        elif place not in values and velocity in values:
            values[place] = np.cumsum(np.nan_to_num(values[velocity])) * dt
            notes.append(f"{place} is the integral of {velocity}")
    if not {"v_north", "v_east"} <= set(values):
        return notes, wrong
    north, east = values["v_north"], values["v_east"]
    V_g, chi = np.hypot(north, east), np.arctan2(east, north)
    flying = np.where(V_g > SLOWEST, 1.0, np.nan)
    ratio = _median(values.get("V_g", V_g) / V_g * flying)
    if not EQUAL[0] < ratio < EQUAL[1] and ratio > 0.0:
        wrong.append(f"V_g is {ratio:.3g} times what the velocities make it: {_cure(ratio)}")
    wrong += _offset("chi", values.get("chi", chi) - chi, flying, "the velocities")
    values["V_g"], values["chi"] = V_g, chi
    if "v_down" in values:
        values["gamma"] = np.arctan2(-values["v_down"], values["V_g"])
    more, contradicted = _path_notes(values, dt)
    return [*notes, *more], [*wrong, *contradicted]


def _offset(name: str, angles: FloatArray, flying: FloatArray, others: str) -> list[str]:
    """A sentence on an angle that is off by the same all along, as a magnetic course is."""
    off = angles[np.isfinite(angles * flying)]
    turns = np.exp(1j * off)
    middle = float(np.angle(turns.mean())) if len(off) > 50 else 0.0
    if (
        abs(middle) < TRAILING
        or np.median(np.abs(np.angle(turns * np.exp(-1j * middle)))) > 3 * DEG
    ):
        return []
    return [
        f"{name} is {middle * DEG_PER_RAD:+.1f} deg off that of {others} all along: magnetic, or "
        f"axes that are turned; a change by {-middle * DEG_PER_RAD:+.1f} deg would do"
    ]


def _plane(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """North and east (m) of places on Earth (rad), linear about the first one."""
    first = int(np.argmax(np.isfinite(lat) & np.isfinite(lon)))
    origin = float(lat[first]) * DEG_PER_RAD, float(lon[first]) * DEG_PER_RAD
    step = 0.01  # deg
    if not (abs(origin[0]) < 89.0 and abs(origin[1]) <= 360.0):
        return np.full(len(lat), np.nan), np.full(len(lat), np.nan)
    up, _ = north_east((origin[0] + step, origin[1]), origin)
    _, right = north_east((origin[0], origin[1] + step), origin)
    scale = DEG_PER_RAD / step
    return (lat - lat[first]) * scale * up, (lon - lon[first]) * scale * right


def _median(values: FloatArray) -> float:
    there = values[np.isfinite(values)]
    return float(np.median(there)) if len(there) else math.nan


def _flying(values: Mapping[str, FloatArray]) -> FloatArray:
    """Ground speed above `SLOWEST`; NaN elsewhere, to be multiplied with."""
    speed = values.get("V_g", values.get("V_a", np.full(len(values["phi"]), np.nan)))
    return np.where(speed > SLOWEST, 1.0, np.nan)


def _path_notes(values: Mapping[str, FloatArray], dt: float) -> tuple[list[str], list[str]]:
    """Velocity against the path, and airspeed against ground speed; what is wrong of them."""
    notes, wrong, flying = [], [], _flying(values)
    span = max(1, round(PATH_S / dt))
    north, east = values.get("north"), values.get("east")
    if north is not None and east is not None and len(north) > 2 * span:
        moved = [(axis[span:] - axis[:-span]) / (span * dt) for axis in (north, east)]
        middle = slice(span // 2, span // 2 + len(moved[0]))
        speed, course = values["V_g"][middle] * flying[middle], values["chi"][middle]
        ratio = _median(np.hypot(*moved) / speed)
        off = course - np.arctan2(*moved[::-1])
        angle = _median(np.abs(np.angle(np.exp(1j * off))))
        said = f"the path is {ratio:.3g} times the ground speed, {angle * DEG_PER_RAD:.1f} deg off "
        said += "the course"
        if EQUAL[0] < ratio < EQUAL[1] or not ratio > 0.0:
            bad = angle > ALONG
            notes.append(f"{said}{': axes of velocity or position are wrong' if bad else ''}")
            wrong += _offset("chi", off, flying[middle], "the path")
        else:
            cure = f"{_cure(1.0 / ratio)} to the velocity, or its inverse to the position"
            wrong.append(f"{said}: unit or axes of velocity or position are wrong, and {cure}")
    if "V_a" in values:
        ratio = _median(values["V_a"] * flying / values["V_g"])
        said = f"airspeed is {ratio:.2f} times the ground speed"
        if EQUAL[0] < ratio < EQUAL[1] or not ratio > 0.0:
            notes.append(said)
        else:
            notes.append(f"{said}: its unit is wrong ({_cure(ratio)}), or the wind strong")
    sideways = np.gradient(np.unwrap(np.nan_to_num(values["chi"])), dt) * values["V_g"] * flying
    phi = values["phi"]
    level = G_0 * np.tan(phi)  # the same acceleration of a level coordinated turn
    there = np.isfinite(sideways * level) & (np.abs(np.abs(phi) - 45.0 * DEG) < 35.0 * DEG)
    if np.count_nonzero(there) * dt > 5.0:
        ratio = float(np.sum((sideways * level)[there]) / np.sum(level[there] ** 2))
        end = "" if TURNS[0] < ratio < TURNS[1] else ": unit or sign of roll or course is wrong"
        notes.append(f"the course turns {ratio:.2f} times as fast as the roll makes it{end}")
    if "psi" in values:
        angle = _median(np.abs(np.angle(np.exp(1j * (values["psi"] - values["chi"])))) * flying)
        if angle > 2.0 * ALONG:
            notes.append(f"the nose is {angle * DEG_PER_RAD:.0f} deg off the course in the median")
    return notes, wrong


def _load_notes(values: dict[str, FloatArray]) -> list[str]:
    """Load factor from the specific force; its median says whether the sensor is upright."""
    if "f_z" not in values or "n_z" in values:
        return []
    values["n_z"] = -values["f_z"] / G_0
    middle = _median(values["n_z"] * _flying(values))
    if -1.5 < middle < -0.6:
        values["n_z"] = -values["n_z"]
        return [f"load factor {-middle:.2f} in the median after its sign was turned: z is up"]
    upright = 0.6 < middle < 1.5
    end = "" if upright else ": the sensor is rotated, or its unit is wrong"
    return [f"load factor {middle:.2f} in the median of the flight{end}"]


def check_flight(place: str, signals: Mapping[str, FloatArray], vehicle: str) -> None:
    """Refuse the log of a multicopter, and of what did not fly."""
    speed = signals.get("V_g", signals.get("V_a"))
    fastest = math.inf if speed is None else float(np.nanmax(np.append(speed, 0.0)))
    if fastest < SLOWEST:
        raise RecordingError(
            f"{place}: must be the log of a flight, got a speed of at most {fastest:.2g} m/s."
        )
    lacking = {"V_a": "no airspeed", "phi_cmd": "no roll commands", "V_g": "no ground speed"}
    got = [words for name, words in lacking.items() if name not in signals]
    rotary = vehicle in ROTARY
    if rotary or len(got) == len(lacking):
        got = [f"a vehicle without wings ({vehicle})", *got] if rotary else got
        raise RecordingError(f"{place}: must be the log of an aeroplane, got {', '.join(got)}.")
