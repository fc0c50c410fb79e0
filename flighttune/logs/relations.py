"""Relations between columns of a log: motion, its frames, and one table of relations."""

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.units import DEG, DEG_PER_RAD, G_0
from flighttune.routes.maps import north_east

SLOWEST = 5.0  # a vehicle below this ground speed does not fly, m/s
STEEP = 0.35  # a course is meaningless below this cosine of the path angle
SMOOTH_S = 1.0  # time over which both sides of a relation are averaged
STILL = 1.0 * DEG  # minimum rms of angles and rates for a comparison, rad and rad/s

TRAILING = 4.0 * DEG  # a smaller constant angle between course and path counts as zero, rad
UNSTEADY = 0.5  # change of wind in any air, m/s
COPIED = 0.02  # an airspeed within this share of the ground speed is a copy of it
DRIFTING = 40.0 * DEG  # largest drift angle between nose and course, rad

# Columns that may be exchanged, and units that may be mistaken for each other.
KINDS = {
    "angle": ("phi", "theta", "psi", "chi", "phi_cmd", "theta_cmd"),
    "rate": ("p", "q", "r"),
    "load": ("n_z", "n_z_cmd"),
    "speed": ("v_north", "v_east", "v_down", "V_g", "V_a", "V_err", "V_ref"),
    "wind": ("wind_north", "wind_east"),
    "length": ("north", "east", "down", "h", "height_err"),
    "place": ("lat", "lon"),
    "force": ("f_x", "f_y", "f_z"),
}
KIND = {name: kind for kind, names in KINDS.items() for name in names}

Sides: TypeAlias = tuple[FloatArray, FloatArray]


class Motion:
    """Columns of a log at one sample time, and the motion that follows; used columns are noted."""

    def __init__(self, given: Mapping[str, FloatArray], dt: float) -> None:
        self.given, self.dt = given, dt
        self.values, self.notes = completed(given, dt)
        self.used: set[str] = set()

    def __contains__(self, name: str) -> bool:
        if name in ("v_north", "v_east"):
            return {"v_north", "v_east"} <= self.values.keys()
        return name in self.values

    def __getitem__(self, name: str) -> FloatArray:
        self.used |= self.sources(name)
        return self.values[name]

    def sources(self, name: str) -> set[str]:
        """Given columns from which a signal is made."""
        if name in ("V_g", "chi", "gamma"):
            axes = ("v_north", "v_east", *(("v_down",) if name == "gamma" else ()))
            return {source for axis in axes for source in self.sources(axis)}
        if name in self.given:
            return {name}
        if name in ("v_north", "v_east") and {"V_g", "chi"} <= self.given.keys():
            return {"V_g", "chi"}
        places = {"north": {"lat", "lon"}, "east": {"lat", "lon"}, "down": {"h"}, "n_z": {"f_z"}}
        places |= {wind: {"wind_speed", "wind_from"} for wind in ("wind_north", "wind_east")}
        axis = name.removeprefix("v_")
        made = {axis} if axis in self.given else places.get(axis, set()) & self.given.keys()
        # Without a position column the velocity is integrated.
        return made or ({f"v_{axis}"} & self.given.keys() if axis == name else made)

    def rate(self, values: FloatArray) -> FloatArray:
        """Slope from the sample before to the sample after."""
        return np.gradient(values, self.dt, axis=0)

    def slow_rate(self, values: FloatArray) -> FloatArray:
        """Slope between means that are more than twice their length apart."""
        smooth, rate, half = self.smooth(values), np.full(len(values), np.nan), self.span + 1
        rate[half:-half] = (smooth[2 * half :] - smooth[: -2 * half]) / (2 * half * self.dt)
        return rate

    def turning(self, name: str) -> FloatArray:
        """Rate of an angle, rad/s."""
        angle, rate = self[name], np.full(len(self[name]), np.nan)
        rate[1:-1] = np.angle(np.exp(1j * (angle[2:] - angle[:-2]))) / (2.0 * self.dt)
        return rate

    @cached_property
    def flying(self) -> FloatArray:
        """1 while a vehicle flies, at least at half its usual speed; else NaN."""
        values = self.values
        speed = values.get("V_a", values.get("V_g", np.full(len(values["phi"]), np.nan)))
        fast = max(SLOWEST, 0.5 * median(speed[speed > SLOWEST]))
        return np.where(speed > fast, 1.0, np.nan)

    @property
    def velocity(self) -> FloatArray:
        """Velocity over ground, shape (n, 3), m/s; level without `v_down`."""
        down = self["v_down"] if "v_down" in self else 0.0 * self["v_north"]
        return np.column_stack([self["v_north"], self["v_east"], down])

    @property
    def force(self) -> FloatArray:
        """Specific force to north, east and down from the velocity, shape (n, 3), m/s2."""
        return self.rate(self.velocity) - np.array([0.0, 0.0, G_0])

    @property
    def across(self) -> Sides:
        """Specific force right of and above the nose, m/s2; without a heading, of the path.

        In wind the two differ, and the force of a looping is not small compared to a turn.
        """
        force = self.force
        if "psi" in self and "theta" in self:
            ahead, climb = self["psi"], self["theta"]
        else:
            ahead = self.heading
            climb = self["gamma"] if "gamma" in self else 0.0 * ahead
        there = np.where(np.cos(climb) > STEEP, 1.0, np.nan) * self.flying
        along = force[:, 0] * np.cos(ahead) + force[:, 1] * np.sin(ahead)
        right = force[:, 1] * np.cos(ahead) - force[:, 0] * np.sin(ahead)
        up = -along * np.sin(climb) - force[:, 2] * np.cos(climb)
        return right * there, up * there

    @property
    def heading(self) -> FloatArray:
        """Heading of the nose, or course of the path without a heading, rad."""
        return self["psi"] if "psi" in self else self["chi"]

    @property
    def axes(self) -> FloatArray:
        """Axes of the body in north, east and down, as columns, shape (n, 3, 3)."""
        zero = 0.0 * self["phi"]
        pitch = next((self[name] for name in ("theta", "gamma") if name in self), zero)
        yaw = self.heading if "psi" in self or "chi" in self else zero
        (c, s), (ct, st), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (self["phi"], pitch, yaw))
        x = [ct * cy, ct * sy, -st]
        y = [s * st * cy - c * sy, s * st * sy + c * cy, s * ct]
        z = [c * st * cy + s * sy, c * st * sy - s * cy, c * ct]
        return np.moveaxis(np.array([x, y, z]), 2, 0).swapaxes(1, 2)

    @cached_property
    def span(self) -> int:
        """Odd number of samples in a moving mean."""
        return 2 * max(1, round(0.5 * SMOOTH_S / self.dt)) + 1

    def smooth(self, values: FloatArray) -> FloatArray:
        """Means over `SMOOTH_S`; NaN if a sample is NaN."""
        pad, shape = self.span // 2, (self.span, *values.shape[1:])
        total = np.cumsum(
            np.concatenate([np.zeros((1, *shape[1:])), np.nan_to_num(values)]), axis=0
        )
        gaps = np.cumsum(np.append(0, ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)))
        means = np.full(values.shape, np.nan)
        if len(values) > self.span:
            whole = gaps[self.span :] == gaps[: -self.span]
            middle = (total[self.span :] - total[: -self.span]) / self.span
            means[pad : len(values) - pad][whole] = middle[whole]
        return means


def median(values: FloatArray) -> float:
    """Median of the finite values; NaN without any."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if len(there) else math.nan


def completed(
    given: Mapping[str, FloatArray], dt: float
) -> tuple[dict[str, FloatArray], list[str]]:
    """Signals completed by position, velocity, course, wind and load factor; and notes."""
    values, notes = dict(given), []
    if "north" not in values and {"lat", "lon"} <= values.keys():
        values["north"], values["east"] = plane(values["lat"], values["lon"])
    if "h" in values:
        values.setdefault("down", -values["h"])
    if "v_north" not in values and {"V_g", "chi"} <= values.keys():
        values["v_north"] = values["V_g"] * np.cos(values["chi"])
        values["v_east"] = values["V_g"] * np.sin(values["chi"])
    for place in ("north", "east", "down"):
        velocity = f"v_{place}"
        if velocity not in values and place in values:
            values[velocity] = np.gradient(values[place], dt)
            notes.append(f"{velocity} is the slope of {place}")
        elif place not in values and velocity in values:
            values[place] = np.cumsum(np.nan_to_num(values[velocity])) * dt
            notes.append(f"{place} is the integral of {velocity}")
    if {"v_north", "v_east"} <= values.keys():
        values["V_g"] = np.hypot(values["v_north"], values["v_east"])
        values["chi"] = np.arctan2(values["v_east"], values["v_north"])
        if "v_down" in values:
            values["gamma"] = np.arctan2(-values["v_down"], values["V_g"])
    _with_air(values, notes)
    return values, notes


def _with_air(values: dict[str, FloatArray], notes: list[str]) -> None:
    """Add wind and load factor from other signals of a log."""
    if {"wind_speed", "wind_from"} <= values.keys():
        for name, part in (("wind_north", np.cos), ("wind_east", np.sin)):
            values[name] = -values["wind_speed"] * part(values["wind_from"])
    if "wind_north" in values:
        values.setdefault("wind_down", 0.0 * values["wind_north"])
    if "f_z" in values and "n_z" not in values:
        up = np.cos(values["phi"]) * np.cos(values.get("theta", 0.0))
        flying = values.get("V_g", values.get("V_a", np.full(len(up), np.inf))) > SLOWEST
        values["n_z"] = -values["f_z"] / G_0
        # The mean vertical force is the weight, upright and inverted.
        weight = values["n_z"] * up * flying
        if np.nansum(weight) < -0.5 * np.nansum(np.abs(weight)):
            values["n_z"] = -values["n_z"]
            notes.append("the load factor is of a sensor after its sign was turned: z is up")


def plane(lat: FloatArray, lon: FloatArray) -> tuple[FloatArray, FloatArray]:
    """North and east (m) of places on Earth (rad), linear about the first place."""
    first = int(np.argmax(np.isfinite(lat) & np.isfinite(lon)))
    origin = float(lat[first]) * DEG_PER_RAD, float(lon[first]) * DEG_PER_RAD
    step = 0.01  # deg
    if not (abs(origin[0]) < 89.0 and abs(origin[1]) <= 360.0):
        return np.full(len(lat), np.nan), np.full(len(lat), np.nan)
    up, _ = north_east((origin[0] + step, origin[1]), origin)
    _, right = north_east((origin[0], origin[1] + step), origin)
    scale = DEG_PER_RAD / step
    return (lat - lat[first]) * scale * up, (lon - lon[first]) * scale * right


def _body_rate(axis: int) -> Callable[[Motion], Sides | str]:
    def sides(motion: Motion) -> Sides | str:
        if axis and not ("psi" in motion or "chi" in motion):
            return "the log has neither heading nor course"
        axes = motion.axes
        turned = np.einsum("nji,njk->nik", axes[:-2], axes[2:])
        cosine = np.clip(0.5 * (np.trace(turned, axis1=1, axis2=2) - 1.0), -1.0, 1.0)
        scale = 1.0 / np.maximum(np.sinc(np.arccos(cosine) / math.pi), 0.1)
        (i, j), expected = ((2, 1), (0, 2), (1, 0))[axis], np.full(len(axes), np.nan)
        expected[1:-1] = 0.5 * (turned[:, i, j] - turned[:, j, i]) * scale / (2.0 * motion.dt)
        if "psi" not in motion and "gamma" in motion:
            expected *= np.where(np.cos(motion["gamma"]) > STEEP, 1.0, np.nan)
        return motion["pqr"[axis]], expected

    return sides


def _heading(motion: Motion) -> Sides:
    there = motion.flying
    if "gamma" in motion:
        there = there * np.where(np.cos(motion["gamma"]) > STEEP, 1.0, np.nan)
    return motion.turning("psi") * there, motion.turning("chi") * there


def _nose(motion: Motion) -> Sides:
    there = (
        motion.flying * np.where(np.cos(motion["gamma"]) > STEEP, 1.0, np.nan)
        if "gamma" in motion
        else motion.flying
    )
    nose, course = (
        np.column_stack([np.cos(motion[name]), np.sin(motion[name])]) for name in ("psi", "chi")
    )
    return nose * there[:, None], course


def _path(motion: Motion) -> Sides:
    moved = np.column_stack([motion.rate(motion[name]) for name in ("north", "east")])
    over = np.column_stack([motion["v_north"], motion["v_east"]])
    return over * motion.flying[:, None], moved


def _stated_velocity(motion: Motion) -> Sides:
    """Given speed and course against speed and course of the velocity."""
    level = motion.given.get("V_g", motion["V_g"]), motion.given.get("chi", motion["chi"])
    motion.used |= {"V_g", "chi"} & motion.given.keys()
    stated = np.column_stack([level[0] * np.cos(level[1]), level[0] * np.sin(level[1])])
    return stated * motion.flying[:, None], np.column_stack([motion["v_north"], motion["v_east"]])


def _stated_speed(motion: Motion) -> Sides:
    motion.used.add("V_g")
    return motion.given["V_g"] * motion.flying, motion["V_g"]


def _climb(name: str, sign: float) -> Callable[[Motion], Sides]:
    return lambda motion: (sign * motion.rate(motion[name]), -motion["v_down"] * motion.flying)


def _heights(motion: Motion) -> Sides:
    return motion.rate(motion["h"]) * motion.flying, -motion.rate(motion["down"])


def _turn(motion: Motion) -> Sides:
    """Turn without a side force: the tangent of roll, times its cosine and the force above."""
    right, up = motion.across
    return np.sin(motion["phi"]) * up, np.cos(motion["phi"]) * right


def _lift(motion: Motion) -> FloatArray:
    """Load factor from path and attitude."""
    phi = motion["phi"]
    if "v_north" not in motion or "v_down" not in motion:
        up = np.cos(phi) * (np.cos(motion["theta"]) if "theta" in motion else 1.0)
        return np.where(np.abs(up) > STEEP, 1.0 / up, np.nan) * motion.flying
    if "theta" in motion and "psi" in motion:
        return -np.einsum("ni,ni->n", motion.force, motion.axes[:, :, 2]) / G_0 * motion.flying
    right, up = motion.across
    return (up * np.cos(phi) + right * np.sin(phi)) / G_0


def _load(name: str) -> Callable[[Motion], Sides]:
    return lambda motion: (motion[name], _lift(motion))


def _changes_of_load(motion: Motion) -> Sides | str:
    if "v_down" not in motion or "v_north" not in motion:
        return "the log has no velocity to north, east and down"
    return motion["n_z"], _lift(motion)


def _along(axis: int) -> Callable[[Motion], Sides]:
    def sides(motion: Motion) -> Sides:
        expected = np.einsum("ni,ni->n", motion.force, motion.axes[:, :, axis])
        return motion["f_x" if axis == 0 else "f_y"], expected * motion.flying

    return sides


def _pitch(motion: Motion) -> Sides | str:
    """Pitch and path angle without their part from the angle of attack in steady flight."""
    level = np.cos(motion["phi"])
    speed = motion["V_a"] if "V_a" in motion else motion["V_g"]
    # The nose is above the path by about alpha cos(phi), and alpha grows with n_z over V_a^2.
    load = motion["n_z"] if "n_z" in motion else 1.0 / np.maximum(level, 0.2)
    terms = np.column_stack([np.ones(len(level)), level, level * load / speed**2])
    columns = np.column_stack([motion["theta"], motion["gamma"]]) * motion.flying[:, None]
    terms, columns = motion.smooth(terms), motion.smooth(columns)
    there = np.asarray(np.isfinite(np.column_stack([terms, columns])).all(axis=1))
    if np.count_nonzero(there) < 50:
        return "the log has too little of it without a gap"
    scale = np.maximum(np.abs(terms[there]).max(axis=0), 1e-30)
    weights = np.linalg.lstsq(terms[there] / scale, columns[there], rcond=None)[0]
    left = np.where(there[:, None], columns - terms / scale @ weights, np.nan)
    return left[:, 0], left[:, 1]


def _by_nose(motion: Motion, level: Floats, over: FloatArray) -> Sides:
    """Rows and values of the equations ground = factor * air * nose + wind, without gaps."""
    nose = np.column_stack([np.cos(motion["psi"]), np.sin(motion["psi"])])
    air = motion["V_a"] * level * motion.flying
    through = motion.smooth(air[:, None] * nose)
    there = np.isfinite(np.column_stack([through, over])).all(axis=1)
    ones = np.ones(np.count_nonzero(there))
    north = np.column_stack([through[there, 0], ones, 0.0 * ones])
    east = np.column_stack([through[there, 1], 0.0 * ones, ones])
    return np.concatenate([north, east]), over[there].T.ravel()


def _by_speed(motion: Motion, level: Floats, over: FloatArray) -> Sides:
    """The same for |ground - wind| = factor * air, which needs no nose, by Gauss-Newton."""
    air = motion.smooth(motion["V_a"] * level * motion.flying)
    there = np.isfinite(np.column_stack([air, over])).all(axis=1)
    fit, rows, size = np.array([1.0, 0.0, 0.0]), np.zeros((0, 3)), np.zeros(0)
    for _ in range(20 if np.count_nonzero(there) else 0):
        off = over[there] - fit[1:]
        size = np.maximum(np.linalg.norm(off, axis=1), 1e-3)
        rows = np.column_stack([air[there], off / size[:, None]])
        if not np.isfinite(rows).all():
            return np.zeros((0, 3)), np.zeros(0)
        step = np.linalg.lstsq(rows, size - fit[0] * air[there], rcond=1e-9)[0]
        fit = fit + step
        if np.abs(step).max() < 1e-4:
            break
    return rows, size + rows[:, 1:] @ fit[1:]


def wind_triangle(motion: Motion) -> tuple[float, FloatArray] | str:
    """Ratio of ground speed to airspeed in still air, and the wind (m/s); or why not.

    A constant wind and one factor convert the velocity through the air to the ground velocity.
    """
    level = np.cos(motion["gamma"]) if "gamma" in motion else 1.0
    equations = _by_nose if "psi" in motion else _by_speed
    rows, values = equations(motion, level, motion.smooth(motion.velocity[:, :2]))
    if len(rows) < 50 or not (np.isfinite(values).all() and np.isfinite(rows).all()):
        return "the log has too little of it without a gap"
    fit = np.asarray(np.linalg.lstsq(rows, values, rcond=1e-9)[0], dtype=float)
    spread = np.linalg.pinv(rows.T @ rows)
    # Errors of wind and turbulence last for about 5 s.
    residual = max(float(np.std(rows @ fit - values)), UNSTEADY)
    error = residual * math.sqrt(spread[0, 0] * 5.0 / motion.dt)
    if not error < 0.2 * abs(fit[0]):
        return "the log is of one heading, where wind and a wrong unit look alike"
    return float(fit[0]), fit[1:]


def _airspeed(motion: Motion) -> Sides | str:
    triangle = wind_triangle(motion)
    if isinstance(triangle, str):
        return triangle
    return motion["V_a"] * motion.flying, triangle[0] * motion["V_a"]


def copied(motion: Motion) -> bool:
    """Whether the airspeed is the ground speed, in still air or by mistake."""
    if not {"V_a", "V_g"} <= motion.values.keys():
        return False
    same = np.abs(motion.values["V_a"] / motion.values["V_g"] - 1.0) < COPIED
    return float(np.mean(np.append(same[motion.flying == 1.0], False))) > 0.9


def _head_wind(motion: Motion) -> Sides | str:
    """Ground speed less airspeed, and the wind along the course from nose and course."""
    usual = Motion({**motion.given, "V_a": 0.0 * motion["V_a"] + median(motion["V_a"])}, motion.dt)
    triangle = wind_triangle(usual)
    motion.used |= usual.used
    if isinstance(triangle, str):
        return triangle
    wind, chi = triangle[1], motion["chi"]
    along = wind[0] * np.cos(chi) + wind[1] * np.sin(chi)
    return (motion["V_g"] - motion["V_a"]) * motion.flying, along


def _wind(motion: Motion) -> Sides | str:
    triangle = wind_triangle(motion)
    if isinstance(triangle, str):
        return triangle
    factor, wind = triangle
    if not EQUAL[0] < factor < EQUAL[1]:
        return "airspeed and ground speed leave it open"
    stated = np.column_stack([motion["wind_north"], motion["wind_east"]])
    return stated * motion.flying[:, None], np.tile(wind, (len(stated), 1))


def _speed_error(motion: Motion) -> Sides | str:
    """Changes of the airspeed error, without changes by wind, and changes of the speed."""
    error = motion["V_err"] * motion.flying
    if not {"V_a", "V_g"} & motion.values.keys():
        return "the log has no speed"
    if "V_ref" in motion:
        return error, motion["V_ref"] - motion["V_a" if "V_a" in motion else "V_g"]
    speed = motion["V_a" if "V_a" in motion else "V_g"]
    turns = []
    if "V_a" not in motion and "chi" in motion:
        turns = [np.cos(motion["chi"]), np.sin(motion["chi"])]
    rates = np.column_stack([motion.slow_rate(x) for x in (error, -speed, *turns)])
    there = np.asarray(np.isfinite(rates).all(axis=1))
    if np.count_nonzero(there) < 50:
        return "the log has too little of it without a gap"
    # A new reference is not a speed error, and wind changes the ground speed with the course.
    usual = 3.0 * np.median(np.abs(rates[there, :2]), axis=0)
    changes, turns = np.clip(rates[:, :2], -usual, usual), rates[:, 2:]
    weights = np.linalg.lstsq(turns[there], changes[there], rcond=None)[0]
    left = np.where(there[:, None], changes - turns @ weights, np.nan)
    return left[:, 0], left[:, 1]


def _height_error(motion: Motion) -> Sides:
    return motion.rate(motion["height_err"]) * motion.flying, motion["v_down"]


def _command(name: str) -> Callable[[Motion], Sides]:
    return lambda motion: (motion[f"{name}_cmd"] * motion.flying, motion[name] * motion.flying)


class Relation(NamedTuple):
    """One column against its value from other columns."""

    name: str  # name of the judged column
    needs: tuple[str, ...]  # columns that must be given or derivable
    sides: Callable[[Motion], Sides | str]  # column and value from others; or why not
    others: str  # the value from others, in words
    within: tuple[float, float]  # range of the ratio that counts as equal units
    still: float  # minimum rms of the value from others for a comparison
    # Strength of the evidence against a differing column: an identity of motion; a coordinated
    # flight without a stall; a loop that may be open.
    rests_on: Literal["motion", "flight", "loop"]
    about: Literal["changes", "values"] = "changes"  # compared without or with their means
    lag: tuple[float, float] = (-1.0, 1.0)  # s: possible delays of the column
    label: str = ""  # name of the column in a sentence
    turned: float = math.inf  # rad: possible turn of a vector
    also: tuple[str, ...] = ()  # other columns that are right if it holds


OVER_GROUND = ("v_north", "v_east", "V_g", "chi")
EQUAL = (0.7, 1.4)
TURNS = (0.4, 2.0)  # ratios under steps, lags and wind
LEVEL = (0.6, 1.6)  # ratios of load factors
IN_TURNS = (0.55, 1.8)  # speeds in knots give 0.51 or 1.94, flights of ALFA 0.6 to 1.2
FOLLOWED = (-2.0, 0.05)  # s: delay of a command against its response

RELATIONS = (
    *(
        Relation(
            name, ("phi",), _body_rate(axis), "the changes of attitude", TURNS, STILL, "motion"
        )
        for axis, name in enumerate("pqr")
    ),
    Relation(
        "psi",
        ("chi",),
        _heading,
        "the course",
        TURNS,
        STILL,
        "flight",
        "changes",
        (-2.0, 2.0),
        "the change of psi",
    ),
    Relation(
        "psi",
        ("chi",),
        _nose,
        "the course",
        (0.0, 2.0),
        0.5,
        "flight",
        "values",
        (-2.0, 2.0),
        "",
        DRIFTING,
    ),
    Relation(
        "v_north",
        ("north", "east"),
        _path,
        "the path",
        EQUAL,
        2.0,
        "motion",
        "values",
        (-2.0, 2.0),
        "the velocity",
        TRAILING,
        (*OVER_GROUND, "north", "east", "lat", "lon"),
    ),
    Relation(
        "V_g",
        ("v_north", "v_east"),
        _stated_speed,
        "the velocities",
        EQUAL,
        2.0,
        "motion",
        "values",
    ),
    Relation(
        "chi",
        ("v_north", "v_east"),
        _stated_velocity,
        "the velocities",
        EQUAL,
        2.0,
        "motion",
        "values",
        (-2.0, 2.0),
        "",
        TRAILING,
    ),
    Relation(
        "h",
        ("v_down",),
        _climb("h", 1.0),
        "the vertical speed",
        EQUAL,
        0.3,
        "motion",
        "changes",
        (-2.0, 2.0),
        "the slope of h",
        also=("v_down",),
    ),
    Relation(
        "down",
        ("v_down",),
        _climb("down", -1.0),
        "the vertical speed",
        EQUAL,
        0.3,
        "motion",
        "changes",
        (-2.0, 2.0),
        "the slope of down",
        also=("v_down",),
    ),
    Relation(
        "h",
        ("down",),
        _heights,
        "down",
        EQUAL,
        0.3,
        "motion",
        "changes",
        (-2.0, 2.0),
        "the slope of h",
        also=("down",),
    ),
    Relation(
        "phi",
        ("v_north", "v_east"),
        _turn,
        "course and speed in turns",
        IN_TURNS,
        0.3,
        "flight",
        also=OVER_GROUND,
    ),
    Relation(
        "n_z",
        ("phi",),
        _load("n_z"),
        "path and roll",
        LEVEL,
        0.3,
        "flight",
        "values",
        label="n_z, over the flight,",
    ),
    Relation(
        "n_z_cmd",
        ("phi",),
        _load("n_z_cmd"),
        "path and roll",
        LEVEL,
        0.3,
        "flight",
        "values",
        label="n_z_cmd, over the flight,",
    ),
    Relation(
        "n_z",
        ("phi",),
        _changes_of_load,
        "path and roll",
        (0.3, 3.0),
        0.03,
        "flight",
        label="the change of n_z",
    ),
    Relation(
        "f_x",
        ("v_north", "v_down", "psi", "theta"),
        _along(0),
        "path and attitude",
        TURNS,
        0.5,
        "flight",
    ),
    Relation(
        "f_y",
        ("v_north", "v_down", "psi", "theta"),
        _along(1),
        "path and attitude",
        TURNS,
        0.5,
        "loop",
    ),
    Relation(
        "theta",
        ("gamma",),
        _pitch,
        "gamma and lift",
        (0.4, 2.5),
        0.5 * STILL,
        "flight",
        also=("v_down",),
    ),
    Relation(
        "V_a",
        ("v_north", "v_east"),
        _airspeed,
        "the ground speed",
        EQUAL,
        SLOWEST,
        "flight",
        "values",
        label="V_a in turns",
    ),
    Relation(
        "V_a",
        ("v_north", "v_east", "psi"),
        _head_wind,
        "the wind that nose and course show",
        TURNS,
        1.5,
        "flight",
        label="V_g less V_a",
    ),
    Relation(
        "wind_north",
        ("V_a", "v_north", "v_east", "wind_east"),
        _wind,
        "the wind that speeds and nose show",
        (0.25, 2.5),
        3.0,
        "flight",
        "values",
        label="the wind",
        also=("wind_east", "wind_speed", "wind_from"),
    ),
    Relation("V_err", (), _speed_error, "the changes of speed", TURNS, 0.05, "loop"),
    Relation("height_err", ("v_down",), _height_error, "the vertical speed", TURNS, 0.5, "loop"),
    *(
        Relation(
            *(f"{name}_cmd", (name,), _command(name), words),
            *((0.3, 4.0), still, "loop", "changes", FOLLOWED),
        )
        for name, words, still in (
            ("phi", "the roll", STILL),
            ("theta", "the pitch", STILL),
            ("n_z", "the load factor", 0.05),
        )
    ),
)
