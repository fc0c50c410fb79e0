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

# The same of a flight that is level, or turns level, in the median.
LEVEL = (0.6, 1.6)

# The same of roll and turns: speeds in knots give 0.51 or 1.94, flights of ALFA 0.6 to 1.2.
IN_TURNS = (0.55, 1.8)

# Units taken for each other, and the factor that mends it; sizes between two of them are near both.
MISTAKEN = (
    {"ft read as m": FT, "m read as ft": 1.0 / FT}
    | {"deg read as rad": DEG, "rad read as deg": 1.0 / DEG}
    | {"kn read as m/s": KNOT, "m/s read as kn": 1.0 / KNOT}
    | {"km/h read as m/s": 1.0 / 3.6, "m/s read as km/h": 3.6}
    | {"m/s2 read as g": 1.0 / G_0, "g read as m/s2": G_0, "ft/s2 read as g": FT / G_0}
    | {"its sign is turned": 1.0}
)
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
    words, factor = min(MISTAKEN.items(), key=lambda item: abs(math.log(abs(ratio) * item[1])))
    if abs(math.log(abs(ratio) * factor)) > NEAR or (ratio > 0.0 and factor == 1.0):
        return f"a factor of {1.0 / ratio:.3g} would do"
    turned = " and its sign turned" if ratio < 0.0 and abs(math.log(-ratio)) > NEAR else ""
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


def _median(values: FloatArray) -> float:
    there = values[np.isfinite(values)]
    return float(np.median(there)) if len(there) else math.nan


class _Check:
    """Signals of a run from raw ones, and sentences about what was checked of them."""

    def __init__(self, raw: Mapping[str, FloatArray], t: FloatArray) -> None:
        self.values, self.dt = dict(raw), float(t[1] - t[0])
        self.notes: list[str] = []
        self.wrong: list[str] = []  # on columns that contradict each other
        # Columns are compared with the same by others, in means and slopes over 2 s.
        self._span = max(1, round(0.5 * PATH_S / self.dt))

    @property
    def flying(self) -> FloatArray:
        """Ground speed above `SLOWEST`: 1, and NaN elsewhere, to be multiplied with."""
        none = np.full(len(self.values["phi"]), np.nan)
        return np.where(self.values.get("V_g", self.values.get("V_a", none)) > SLOWEST, 1.0, np.nan)

    def slope(self, name: str, *, angle: bool = True) -> FloatArray:
        """Rate of a column; zero without it."""
        if name not in self.values:
            return np.zeros(len(self.values["phi"]))
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
        """Add a sentence where a ratio is not that of equal units and signs."""
        if math.isfinite(ratio) and not within[0] < ratio < within[1]:
            either = "" if others == "level flight" else f" (or its inverse on {others})"
            said = f"{name} is {ratio:.3g} times the value from {others}: {_cure(ratio)}{either}"
            self.wrong.append(said)

    def offset(self, name: str, angles: FloatArray, flying: FloatArray, others: str) -> None:
        """Add a sentence on an angle that is off by the same all along, as a magnetic course is."""
        off = angles[np.isfinite(angles * flying)]
        turns = np.exp(1j * off)
        middle = float(np.angle(turns.mean())) if len(off) > 50 else 0.0
        around = np.abs(np.angle(turns * np.exp(-1j * middle)))
        if abs(middle) >= TRAILING and np.median(around) <= 3 * DEG:
            self.wrong.append(
                f"{name} is {middle * DEG_PER_RAD:+.1f} deg off that of {others} all along: "
                "magnetic, or axes that are turned; a change by "
                f"{-middle * DEG_PER_RAD:+.1f} deg would do"
            )

    def motion(self) -> None:
        """Add course, path angle, and what is missing of position and velocity; check them."""
        values = self.values
        if "north" not in values and {"lat", "lon"} <= values.keys():
            values["north"], values["east"] = _plane(values["lat"], values["lon"])
        if "h" in values:
            values.setdefault("down", -values["h"])
        if "v_north" not in values and {"V_g", "chi"} <= values.keys():
            values["v_north"] = values["V_g"] * np.cos(values["chi"])
            values["v_east"] = values["V_g"] * np.sin(values["chi"])
        for place in ("north", "east", "down"):
            velocity = f"v_{place}"
            if velocity not in values and place in values:
                values[velocity] = np.gradient(values[place], self.dt)
                self.notes.append(f"{velocity} is the slope of {place}")
            elif place not in values and velocity in values:
                values[place] = np.cumsum(np.nan_to_num(values[velocity])) * self.dt
                self.notes.append(f"{place} is the integral of {velocity}")
        if not {"v_north", "v_east"} <= values.keys():
            return
        V_g = np.hypot(values["v_north"], values["v_east"])
        chi = np.arctan2(values["v_east"], values["v_north"])
        stated_V_g, stated_chi = values.get("V_g", V_g), values.get("chi", chi)
        values |= {"V_g": V_g, "chi": chi}
        ratio = _median(stated_V_g / V_g * self.flying)
        if not EQUAL[0] < ratio < EQUAL[1] and ratio > 0.0:
            self.wrong.append(
                f"V_g is {ratio:.3g} times what the velocities make it: {_cure(ratio)}"
            )
        self.offset("chi", stated_chi - chi, self.flying, "the velocities")
        if "v_down" in values:
            values["gamma"] = np.arctan2(-values["v_down"], V_g)
        self._path()
        self._speeds_and_turns()

    def _path(self) -> None:
        """Check the velocity against the path."""
        values, span = self.values, max(1, round(PATH_S / self.dt))
        places = [values[axis] for axis in ("north", "east") if axis in values]
        if len(places) < 2 or len(places[0]) <= 2 * span:
            return
        moved = [(axis[span:] - axis[:-span]) / (span * self.dt) for axis in places]
        middle = slice(span // 2, span // 2 + len(moved[0]))
        flying = self.flying[middle]
        ratio = _median(np.hypot(*moved) / (values["V_g"][middle] * flying))
        off = values["chi"][middle] - np.arctan2(*moved[::-1])
        angle = _median(np.abs(np.angle(np.exp(1j * off))))
        said = f"the path is {ratio:.3g} times the ground speed, {angle * DEG_PER_RAD:.1f} deg off "
        said += "the course"
        if EQUAL[0] < ratio < EQUAL[1] or not ratio > 0.0:
            bad = ": axes of velocity or position are wrong" if angle > ALONG else ""
            self.notes.append(said + bad)
            self.offset("chi", off, flying, "the path")
        else:
            cure = f"{_cure(1.0 / ratio)} to the velocity, or its inverse to the position"
            said += f": unit or axes of velocity or position are wrong, and {cure}"
            self.wrong.append(said)

    def _speeds_and_turns(self) -> None:
        """Check airspeed and roll against ground speed and course."""
        values, flying = self.values, self.flying
        if "V_a" in values:
            ratio = _median(values["V_a"] * flying / values["V_g"])
            right = EQUAL[0] < ratio < EQUAL[1] or not ratio > 0.0
            end = "" if right else f": its unit is wrong ({_cure(ratio)}), or the wind strong"
            self.notes.append(f"airspeed is {ratio:.2f} times the ground speed{end}")
        turn = np.gradient(np.unwrap(np.nan_to_num(values["chi"])), self.dt)
        sideways, phi = turn * values["V_g"] * flying, values["phi"]
        level = G_0 * np.tan(phi)  # the same acceleration of a level coordinated turn
        there = np.isfinite(sideways * level) & (np.abs(np.abs(phi) - 45.0 * DEG) < 35.0 * DEG)
        if np.count_nonzero(there) * self.dt > 5.0:
            ratio = float(np.sum((sideways * level)[there]) / np.sum(level[there] ** 2))
            right = LEVEL[0] < ratio < LEVEL[1]
            end = "" if right else ": unit or sign of roll, course or speed is wrong"
            self.notes.append(
                f"the course turns {ratio:.2f} times as fast as the roll makes it{end}"
            )
        if "psi" in values:
            off = np.abs(np.angle(np.exp(1j * (values["psi"] - values["chi"]))))
            if (angle := _median(off * flying)) > 2.0 * ALONG:
                degrees = angle * DEG_PER_RAD
                self.notes.append(f"the nose is {degrees:.0f} deg off the course in the median")

    def load_factor(self) -> None:
        """Add the load factor; the median of a sensor's says whether the sensor is upright."""
        if "f_z" not in self.values or "n_z" in self.values:
            return
        n_z = -self.values["f_z"] / G_0
        middle = _median(n_z * self.flying)
        sign, end = 1.0, "of the flight"
        if -1.5 < middle < -0.6:
            sign, end = -1.0, "after its sign was turned: z is up"
        elif not 0.6 < middle < 1.5:
            end += ": the sensor is rotated, or its unit is wrong"
        self.values["n_z"] = sign * n_z
        self.notes.append(f"load factor {sign * middle:.2f} in the median {end}")

    def flight_path(self) -> None:
        """Check load factor, path angle, climb and airspeed against what others make them."""
        values, flying = self.values, self.flying
        for name in ("n_z", "n_z_cmd"):
            column = values.get(name, np.nan) * flying
            middle = _median(column)
            if abs(middle) < min(LEVEL[0], 2.0 * _median(np.abs(column - middle))):
                said = f"{name} is {middle:.2g} in the median of the flight, where 1 is level"
                self.wrong.append(f"{said}: a change by +1 would do (gravity is left out)")
            else:
                self.say(f"{name}, in the median of the flight,", middle, "level flight", LEVEL)
        if {"gamma", "theta"} <= values.keys():
            steep, pitch = self._without_lift("gamma", "theta")
            self.say("gamma", _ratio(steep, pitch, 0.15 * STILL), "theta and lift", (0.4, 2.5))
        if {"gamma", "n_z"} <= values.keys():
            excess = values["n_z"] * np.cos(values["phi"]) - np.cos(values["gamma"])
            rate = self.mean(G_0 * excess / values["V_g"])
            ratio = _ratio(self.slope("gamma") * flying, rate, 0.2 * STILL)
            self.say("the change of gamma", ratio, "n_z")
        if {"h", "v_down"} <= values.keys():
            ratio = _ratio(self.slope("h", angle=False) * flying, -self.mean(values["v_down"]), 0.3)
            self.say("the slope of h", ratio, "the vertical speed", EQUAL)
        if not {"V_a", "v_north", "v_east"} <= values.keys():
            return
        nose = values.get("psi", values["chi"])
        through = [self.mean(values["V_a"] * part(nose)) for part in (np.cos, np.sin)]
        over = [self.mean(values[name]) for name in ("v_north", "v_east")]
        air, ground = (np.concatenate([x - _median(x) for x in pair]) for pair in (through, over))
        ratio = _ratio(air, ground, 1.0)
        self.say("V_a in turns", ratio, "the ground speed", EQUAL)
        drifts = zip(("north", "east"), through, over, strict=True)
        for axis, air, ground in drifts if "wind_north" in values and ratio > 0.0 else ():
            drift = _median(ground - air)
            if abs(drift) > 3.0:
                ratio = _median(values[f"wind_{axis}"]) / drift
                self.say(f"wind_{axis}", ratio, "speeds and nose", (0.25, 2.5))

    def _without_lift(self, *names: str) -> list[FloatArray]:
        """Means of signals without what goes with the angle of attack in a steady flight."""
        level = np.cos(self.values["phi"])
        speed = self.values.get("V_a", self.values.get("V_g", level))
        # The nose is above the path by about alpha cos(phi), and alpha grows with n_z over V_a^2.
        lift = level * self.values.get("n_z", 1.0 / np.maximum(level, 0.2)) / speed**2
        columns = [self.mean(self.values[name]) for name in names]
        terms = np.column_stack([self.mean(x) for x in (np.ones(len(level)), level, lift)])
        there = np.isfinite(np.column_stack([terms, *columns])).all(axis=1)
        left = []
        for column in columns:
            weights = np.linalg.lstsq(terms[there], column[there], rcond=None)[0]
            left.append(np.where(there, column - terms @ weights, np.nan))
        return left

    def attitude(self) -> None:
        """Check attitude, its rates and commands against each other and the course."""
        values, flying = self.values, self.flying
        phi, theta = values["phi"], values.get("theta", np.zeros(len(flying)))
        roll, pitch, heading, turn = (self.slope(name) for name in ("phi", "theta", "psi", "chi"))
        self.say("the change of psi", _ratio(heading * flying, turn, STILL), "the course")
        yaw = (heading if "psi" in values else turn) * np.cos(theta)
        rates = {
            "p": roll - yaw * np.tan(theta),
            "q": pitch * np.cos(phi) + yaw * np.sin(phi),
            "r": yaw * np.cos(phi) - pitch * np.sin(phi),
        }
        for name in (name for name in rates if name in values):
            ratio = _ratio(self.mean(values[name]), rates[name], STILL)
            self.say(name, ratio, "the changes of attitude")
        if "V_g" in values:
            ratio = _ratio(self.mean(G_0 * np.tan(phi)), self.mean(turn * values["V_g"]), 0.1)
            self.say("phi", ratio, "course and speed in turns", IN_TURNS)
        if "phi_cmd" in values:
            behind = (max(1, round(late / self.dt)) for late in BEHIND_S)
            ratios = [_ratio(values["phi_cmd"][:-k], (phi * flying)[k:], STILL) for k in behind]
            ratio = next((ratio for ratio in ratios if math.isfinite(ratio)), math.nan)
            self.say("phi_cmd", ratio, "the roll", (0.3, 4.0))


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


@np.errstate(invalid="ignore", divide="ignore", over="ignore")
def checked(
    raw: Mapping[str, FloatArray], t: FloatArray
) -> tuple[dict[str, FloatArray], list[str], list[str]]:
    """Signals of a run from raw ones on one time base, notes, and contradictions of columns."""
    check = _Check(raw, t)
    check.motion()
    values = check.values
    if {"wind_speed", "wind_from"} <= values.keys():
        for name, part in (("wind_north", np.cos), ("wind_east", np.sin)):
            values[name] = -values["wind_speed"] * part(values["wind_from"])
    if "wind_north" in values:
        values.setdefault("wind_down", np.zeros(len(t)))
    check.load_factor()
    check.flight_path()
    check.attitude()
    for place in ("north", "east", "down"):
        if place in values:
            there = values[place][np.isfinite(values[place])]
            values[place] = values[place] - (there[0] if len(there) else 0.0)
    for name in ("chi", "gamma"):
        if {name, f"{name}_ref"} <= values.keys():
            values[f"{name}_err"] = np.angle(np.exp(1j * (values[f"{name}_ref"] - values[name])))
    return values, check.notes, check.wrong


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
