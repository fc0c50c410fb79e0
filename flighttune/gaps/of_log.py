"""A real flight against a model that flies its commands, and causes of the difference.

The commands are flown open loop, so that errors of a model add up. Each stretch therefore starts
from the log again, and course and path angle are compared without their mean difference.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np

from flighttune.base.answering import Drawn
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import FlightTuneError, InputError
from flighttune.base.files.load import A_LOG, LOG, load_one
from flighttune.base.units import DEG, DEG_PER_RAD
from flighttune.flight.apart import Progress
from flighttune.flight.loop.run import Run
from flighttune.gaps.tracking import Tracking, tracking
from flighttune.logs.checks import refuse_wrong
from flighttune.logs.identify import EXCITED, HELD_S, flying, interval_of, speed_of
from flighttune.logs.log import Columns
from flighttune.vehicles.aircraft.aircraft import AircraftConfig, OffNominal, load_aircraft
from flighttune.vehicles.identification.file import FILE_NAME, load_identified
from flighttune.vehicles.plants.base import FlightCondition, Plant
from flighttune.vehicles.plants.jsbsim.plant import DEEPEST_GROUND, JSBSimPlant
from flighttune.vehicles.plants.point_mass import PointMassPlant

# Time after the start of a stretch in which the start decays, and compared time, s.
WAIT_S, STRETCH_S = 5.0, 12.0
MIN_STRETCHES, MAX_STRETCHES = 3, 8

# Scale of each signal's difference; ``nose`` is pitch minus path angle, ``tail`` ground speed minus
# airspeed. The model does not include the log's control of airspeed.
SCALES = {"chi": DEG, "gamma": DEG, "phi": DEG, "n_z": 0.05, "tail": 0.5, "nose": DEG}
# Signals compared without their mean in a stretch: they drift from its start, or have a sensor
# offset.
DRIFTING = ("chi", "gamma", "nose")

# Scaled difference of a start or flight that a model cannot do, in every signal and sample.
LOST = 30.0

TURNED = 60.0 * DEG  # minimum range of the course that shows a wind

# Maximum steps of the fit, scaled change of factors in a step and in the last step, and improvement
# of the sum of squares below which the fit ends.
MAX_STEPS, REACH, DONE, GAIN = 12, 3.0, 0.02, 1e-2
STEP = 0.2  # scaled change of a factor for a slope
NEAR = 1.0  # slopes are reused up to this scaled change of factors
AT_END = 0.02  # a fit within this share of a factor's range from an end is at this end

# Names of the damping of roll and of pitch in models.
DAMPING = (("Clp", "Cl_p"), ("Cmq", "Cm_q"))


class Factor(NamedTuple):
    """A parameter in which flight and model may differ."""

    cause: str
    title: str
    unit: str
    nominal: float
    size: float  # scale of a significant change
    low: float  # ends of the fitted range
    high: float

    def at_end(self, value: float) -> bool:
        """Whether a value lies at an end of the range."""
        return min(value - self.low, self.high - value) < AT_END * (self.high - self.low)

    def unidentifiable(self, value: float, low: float, high: float) -> str:
        """Why a log cannot identify the factor, from its best value and interval; else empty."""
        if not math.isfinite(high - low):
            return "a change of it has the same effect as changes of the others"
        unit = "" if self.unit == "1" else f" {self.unit}"
        if self.at_end(value):
            return f"the best fit is at an end of its range, {self.low:g} to {self.high:g}{unit}"
        if low < self.nominal < high and high - low > 2.0 * self.size:
            ends = f"{max(low, self.low):.2g} to {min(high, self.high):.2g}{unit}"
            return f"its interval at 95 %, {ends}, holds {self.nominal:g} and is too wide"
        return ""


FACTORS = {
    "phi_late": Factor("lag", "roll later than the model's", "s", 0.0, 0.1, -1.0, 2.0),
    "n_z_late": Factor("lag", "load factor later than the model's", "s", 0.0, 0.1, -1.0, 2.0),
    "mass": Factor("mass", "mass over the model's", "1", 1.0, 0.2, 0.3, 3.0),
    "damping": Factor("damping", "damping over the model's", "1", 1.0, 0.4, 0.1, 5.0),
    "wind_north": Factor("wind", "air moving north", "m/s", 0.0, 5.0, -50.0, 50.0),
    "wind_east": Factor("wind", "air moving east", "m/s", 0.0, 5.0, -50.0, 50.0),
}

# Factors that need flights of their own; a wind only shifts these flights.
IN_AIR = ("phi_late", "n_z_late", "mass", "damping")

LOGGED = ("chi", "gamma", "V_g", "phi", "n_z", "phi_cmd", "n_z_cmd")
NO_HEIGHT = 1000.0  # m: assumed for a log without height

# Signals of all stretches, from a log or a model, shape (stretches, samples).
Signals: TypeAlias = Mapping[str, FloatArray]

# Makes a plant from the factors.
PlantMaker: TypeAlias = Callable[[Mapping[str, float]], Plant]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LogGap(Drawn):
    """The difference between a real flight and a model that flies its commands."""

    # Names of log and model
    log: str
    aircraft: str
    # (stretches, samples), s: times of the flown stretches, from the start of the log
    t: FloatArray
    # Signals of the log in SI, each (stretches, samples), with the commands; ``nose`` is pitch
    # minus path angle, ``tail`` ground speed minus airspeed
    logged: Signals
    # Signals of the same shape by model: the paper's law, the exact point mass, the point mass
    # behind the identified lag, the aircraft, and the aircraft with the fitted factors; NaN after
    # the end of a flight
    flights: Mapping[str, Signals]
    # Fitted value of each factor, and the ends of its interval at 95 %; without factors that the
    # log cannot identify
    factors: Mapping[str, tuple[float, float, float]]
    # Share of the aircraft's difference that each cause explains alone, and share that remains
    # without it; squares are summed over all signals, scaled by `SCALES`
    causes: Mapping[str, tuple[float, float]]
    explained: float  # share that all factors explain together
    # Errors of track where the log is straight, beside flights of the aircraft; empty for a model
    # or a log without a track
    tracking: tuple[Tracking, ...]
    notes: tuple[str, ...]  # sentences on factors that the log cannot identify, and why


def log_gap(
    log: str | Path | Run, aircraft: str | Path, columns: Columns, progress: Progress | None
) -> LogGap:
    """Fly the commands of a log on an aircraft or identified model; explain the difference."""
    run = load_one(log, A_LOG, LOG, columns=columns)
    refuse_wrong(run)
    flights = _Flights(run, aircraft, progress)
    fly, nominal = flights.fly, flights.nominal
    flown = {title: fly({}, maker) for title, maker in flights.lower.items()}
    flown[flights.label] = fly(nominal)
    factors = _fitted(flights)
    best = {name: value for name, (value, _, _) in factors.items()}
    flown[f"{flights.label}, explained"] = fly(best)
    whole = flights.size(flown[flights.label])
    causes = {}
    for cause in dict.fromkeys(FACTORS[name].cause for name in nominal):
        fitted = {name: value for name, value in best.items() if FACTORS[name].cause == cause}
        without = best | {name: nominal[name] for name in fitted}
        alone = 1.0 - flights.size(fly(nominal | fitted)) / whole
        causes[cause] = alone, flights.size(fly(without)) / whole
    return LogGap(
        log=str(run.provenance.gains_name),
        aircraft=flights.label,
        t=flights.t,
        logged=flights.logged,
        flights=flown,
        factors=factors,
        causes=causes,
        explained=1.0 - flights.size(flown[f"{flights.label}, explained"]) / whole,
        tracking=flights.tracking(aircraft),
        notes=tuple(flights.notes),
    )


class _Flights:
    """The stretches of a log, the plants that fly its commands, and the identifiable factors."""

    def __init__(self, run: Run, aircraft: str | Path, progress: Progress | None) -> None:
        self.notes: list[str] = []
        self._progress = progress
        self._in_air: dict[tuple[object, ...], Signals] = {}
        self._places: list[dict[str, float]] = []
        self._run, self._file = run, Path(aircraft).suffix == ".json"
        self.label = Path(aircraft).stem if self._file else Path(aircraft).name
        config = None if self._file else load_aircraft(aircraft)
        rate = 1.0 / HELD_S if config is None else float(config.inner_loop_rate)
        self.t, self.logged = _stretches(run, max(1, round(HELD_S * rate)) / rate)
        lags = None
        if config is None or (config.folder / FILE_NAME).exists():
            identified = load_identified(aircraft)
            lags = identified.nearest(float(np.median(self.logged["V_a"])), 0.0).lags
            self.notes += identified.assumptions
        self.lower: dict[str, PlantMaker] = {
            "kinematic": lambda _: PointMassPlant(turn="paper"),
            "point_mass": lambda _: PointMassPlant(),
        }
        self.nominal = {name: factor.nominal for name, factor in FACTORS.items()}
        if config is None:
            self._maker: PlantMaker = lambda _: PointMassPlant(lags)
            self._leave("mass", "damping", why=f"{self.label} has no airframe to change")
        else:
            if lags is not None:
                self.lower["point_mass_lag"] = lambda _: PointMassPlant(lags)
            damping = [name for names in DAMPING if (name := _named(config, names))]
            self._maker = partial(_airframe, config, damping)
            if not damping:
                names = ", ".join(name for names in DAMPING for name in names)
                self._leave("damping", why=f"{self.label} has no aerodynamics named {names}")
        if "n_z" not in self.logged:
            self.notes.append(
                "The log has no load-factor commands: its load factor is flown in their place, so "
                "that a delay of about minus the lag of the model is found."
            )
        if "h" not in run.signals:
            self.notes.append(f"The log has no height: the air is that at {NO_HEIGHT:g} m.")
        why = "" if "V_a" in run.signals else "the log has no airspeed"
        if not why and np.ptp(self.logged["chi"]) < TURNED:
            why = f"the course changes by less than {TURNED * DEG_PER_RAD:g} deg"
        if why:
            self._leave("wind_north", "wind_east", why=why)
        self._keep_flyable()

    def tracking(self, aircraft: str | Path) -> tuple[Tracking, ...]:
        """Errors of track of the log beside flights of the aircraft at its airspeed and height."""
        if self._file:
            return ()
        V_a, h = (float(np.median(self.logged[name])) for name in ("V_a", "h"))
        try:
            return tracking(self._run, str(aircraft), V_a, h)
        except FlightTuneError as error:
            self.notes.append(f"No straight flights to compare the log's track with: {error}")
            return ()

    def drop_unidentifiable(self, name: str, why: str) -> None:
        """Drop a factor from the fit, which the log cannot identify: it keeps its nominal value."""
        factor = FACTORS[name]
        self.notes.append(
            f"The log cannot identify {factor.title}: {why}; "
            f"it is taken as {self.nominal.pop(name):g}."
        )

    def _leave(self, *names: str, why: str) -> None:
        for name in names:
            del self.nominal[name]
        causes = " and ".join(dict.fromkeys(FACTORS[name].title for name in names))
        self.notes.append(f"Not fitted: {causes}, because {why}.")

    def _keep_flyable(self) -> None:
        """Drop the stretches that the aircraft cannot start."""
        kept, reason = [], ""
        for k in range(len(self.t)):
            try:
                self._maker(_in_air(self.nominal)).start(self._start(k))
                kept.append(k)
            except FlightTuneError as error:
                reason = str(error)
        if len(kept) < MIN_STRETCHES:
            raise InputError(
                f"{self.label}: must fly {MIN_STRETCHES} stretches of the log at least, got "
                f"{len(kept)}: {reason}"
            )
        if reason:
            got = f"{len(self.t) - len(kept)} of {len(self.t)} stretches"
            self.notes.append(f"{got} are left out: {reason}")
        self.t = self.t[kept]
        self.logged = {name: values[kept] for name, values in self.logged.items()}

    def _start(self, k: int) -> FlightCondition:
        """Start of a flight of stretch `k`; its course is corrected once the wind is known."""
        chi, gamma, V_g, phi = (float(self.logged[x][k, 0]) for x in ("chi", "gamma", "V_g", "phi"))
        V_a, h = (float(np.median(self.logged[name][k])) for name in ("V_a", "h"))
        climb = math.asin(min(1.0, max(-1.0, V_g * math.tan(gamma) / V_a)))
        return FlightCondition(V_a=V_a, h=h, chi=chi, gamma=climb, phi=phi)

    def size(self, flown: Signals) -> float:
        """Sum of the squares of the scaled difference."""
        return float(np.sum(self.difference(flown) ** 2))

    def difference(self, flown: Signals) -> FloatArray:
        """Scaled difference, shape (stretches, signals times samples)."""
        return scaled(self.t, self.logged, flown)

    def slopes(self, factors: Mapping[str, float]) -> FloatArray:
        """Slopes of the difference in each scaled factor, shape (samples, factors)."""
        air = _in_air(factors)

        def near(place: Mapping[str, float]) -> bool:
            return all(abs(x - place[name]) <= NEAR * FACTORS[name].size for name, x in air.items())

        place = next(filter(near, self._places), air)
        if place is air:
            self._places.append(air)
        centre = {name: place.get(name, x) for name, x in factors.items()}
        base, columns = self.difference(self.fly(centre)).ravel(), []
        for name, x in centre.items():
            step = STEP if x + STEP * FACTORS[name].size < FACTORS[name].high else -STEP
            there = self.fly(centre | {name: x + step * FACTORS[name].size})
            columns.append((self.difference(there).ravel() - base) / step)
        return np.column_stack(columns)

    def fly(self, factors: Mapping[str, float], maker: PlantMaker | None = None) -> Signals:
        """Signals of the aircraft, or of another plant, under the commands of every stretch."""
        # Flights are in still air, over a flat Earth at rest: a steady wind only turns their start
        # and shifts them.
        air = _in_air(factors)
        key = maker, *air.values()
        if key not in self._in_air:
            flown = [self._flown((maker or self._maker)(air), k, air) for k in range(len(self.t))]
            self._in_air[key] = {
                name: np.stack([each[name] for each in flown]) for name in flown[0]
            }
            if self._progress is not None:
                self._progress(self.label, 1.0 - 0.9 ** len(self._in_air))
        return self._over_ground(self._in_air[key], factors)

    def _over_ground(self, air: Signals, factors: Mapping[str, float]) -> Signals:
        """Signals over ground of flights in air that moves with the wind of the factors."""
        north, east = (factors.get(f"wind_{axis}", 0.0) for axis in ("north", "east"))
        chi, V_g = self.logged["chi"][:, :1], self.logged["V_g"][:, :1]
        start = np.arctan2(V_g * np.sin(chi) - east, V_g * np.cos(chi) - north)
        course, level = air["chi"] - chi + start, air["V_a"] * np.cos(air["gamma"])
        to_north, to_east = level * np.cos(course) + north, level * np.sin(course) + east
        course, level = np.unwrap(np.arctan2(to_east, to_north)), np.hypot(to_north, to_east)
        course += math.tau * np.round((chi - course[:, :1]) / math.tau)
        gamma = np.arctan2(air["V_a"] * np.sin(air["gamma"]), level)
        signals = {**air, "chi": course, "gamma": gamma, "tail": level - air["V_a"]}
        return signals | ({"nose": air["theta"] - gamma} if "theta" in air else {})

    def _flown(self, plant: Plant, k: int, factors: Mapping[str, float]) -> Signals:
        """Signals under the commands of one stretch; NaN after an early end."""
        t, rows = self.t[k], np.full((self.t.shape[1], len(plant.signals)), np.nan)
        step = float(t[1] - t[0])
        # A command that is held over a sample represents the command at its middle.
        commands = [
            np.interp(t + 0.5 * step - factors[f"{x}_late"], t, self.logged[f"{x}_cmd"][k])
            for x in ("phi", "n_z")
        ]
        with suppress(FlightTuneError):
            plant.start(self._start(k))
            for i, (phi_cmd, n_z_cmd) in enumerate(np.column_stack(commands).tolist()):
                rows[i] = plant.observe()
                if plant.advance(phi_cmd, n_z_cmd, step) is not None:
                    break
        return dict(zip(plant.signals, rows.T, strict=True))


def _in_air(factors: Mapping[str, float]) -> dict[str, float]:
    """The factors that need flights of their own, nominal where they are not given."""
    return {name: factors.get(name, FACTORS[name].nominal) for name in IN_AIR}


def _named(config: AircraftConfig, names: Sequence[str]) -> str:
    """The first of these aerodynamic functions in a model; empty if there is none."""
    for name in names:
        with suppress(InputError):
            JSBSimPlant(config, off_nominal=OffNominal(coefficient_factors={name: 1.0}))
            return name
    return ""


def _airframe(
    config: AircraftConfig, damping: Sequence[str], factors: Mapping[str, float]
) -> Plant:
    """The aircraft with changed mass and damping."""
    off = OffNominal(
        mass_factor=factors["mass"], coefficient_factors=dict.fromkeys(damping, factors["damping"])
    )
    return JSBSimPlant(config, off_nominal=off, ground=-DEEPEST_GROUND)


def _stretches(run: Run, step: float) -> tuple[FloatArray, Signals]:
    """Times and signals of stretches with changing roll commands, spread evenly over a log."""
    signals, place, t = run.signals.astype(float), run.label, run.t
    lacking = [name for name in ("chi", "gamma", "V_g", "phi", "phi_cmd") if name not in signals]
    if lacking or not {"n_z", "n_z_cmd"} & set(signals):
        names = ", ".join([*lacking] or ["n_z"])
        raise InputError(f"{place}: must have {names} to be flown on a model, got none.")
    logged = {name: signals[name].to_numpy() for name in LOGGED if name in signals}
    logged["V_a"] = speed_of(run)
    if "V_a" in signals:
        logged["tail"] = logged["V_g"] - logged["V_a"]
    logged.setdefault("n_z_cmd", logged["n_z"])
    if "n_z_cmd" not in signals:
        del logged["n_z"]
    if "theta" in signals:
        logged["nose"] = signals["theta"].to_numpy() - logged["gamma"]
    good = flying(run, *logged.values())
    heights = signals["h"].to_numpy() if "h" in signals else np.full(len(t), NO_HEIGHT)
    logged |= {
        "h": np.nan_to_num(heights, nan=NO_HEIGHT),
        "chi": np.unwrap(np.nan_to_num(logged["chi"])),
    }
    size, low, pieces = math.ceil((WAIT_S + STRETCH_S) / (t[1] - t[0])) + 1, 0, []
    # After a gap a new stretch begins, so that no stretch has a gap and none overlap.
    while low + size < len(t):
        piece = slice(low, low + size + 1)
        bad = np.flatnonzero(~good[piece])
        if not len(bad) and np.ptp(logged["phi_cmd"][piece]) > EXCITED["phi"]:
            pieces.append(piece)
        low += int(bad[-1]) + 1 if len(bad) else size
    if len(pieces) < MIN_STRETCHES:
        raise InputError(
            f"{place}: must have {MIN_STRETCHES} stretches of {WAIT_S + STRETCH_S:g} s without a "
            f"gap in which roll commands change by {EXCITED['phi'] / DEG:g} deg, got {len(pieces)}."
        )
    # Every step of the fit flies all stretches, so only some, spread over the log, are kept.
    chosen = np.linspace(0, len(pieces) - 1, min(MAX_STRETCHES, len(pieces))).round().astype(int)
    count = math.floor((WAIT_S + STRETCH_S) / step)
    times = np.array([t[pieces[i].start] + step * np.arange(count) for i in chosen])
    return times, {name: np.interp(times, t, values) for name, values in logged.items()}


def compared(t: FloatArray, values: FloatArray) -> FloatArray:
    """Samples of stretches after the time in which the start decays."""
    return values[:, round(WAIT_S / float(t[0, 1] - t[0, 0])) :]


def difference(t: FloatArray, logged: Signals, flown: Signals) -> dict[str, FloatArray]:
    """Log minus model in SI, by common signal, shape (stretches, samples)."""
    apart = {}
    for name in SCALES:
        if name in logged and name in flown:
            apart[name] = compared(t, logged[name] - flown[name])
            if name in DRIFTING:
                there = np.isfinite(apart[name])
                total = np.sum(apart[name], axis=1, where=there, keepdims=True)
                apart[name] -= total / np.maximum(1, there.sum(axis=1, keepdims=True))
    return apart


def scaled(t: FloatArray, logged: Signals, flown: Signals) -> FloatArray:
    """Differences divided by their scales, shape (stretches, signals times samples)."""
    scaled = np.hstack([x / SCALES[name] for name, x in difference(t, logged, flown).items()])
    return np.clip(np.nan_to_num(scaled, nan=LOST), -LOST, LOST)


def rms(values: FloatArray) -> float:
    """Root mean square while a flight lasted; NaN if it never did."""
    flown = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(flown**2))) if len(flown) else math.nan


def _fitted(flights: _Flights) -> dict[str, tuple[float, float, float]]:
    """Identifiable factors of the least squared difference, with intervals, by Gauss-Newton."""
    x, reach, least, kept = dict(flights.nominal), REACH, math.inf, set[str]()
    fitted, unidentifiable = dict[str, tuple[float, float, float]](), dict[str, str]()
    for _ in range(MAX_STEPS):
        if not x:
            return {}
        size = flights.size(flights.fly(x))
        reach = REACH if size <= least else 0.5 * reach
        fitted, unidentifiable = _step(flights, x, reach)
        ahead = {name: fitted.get(name, (nominal,))[0] for name, nominal in flights.nominal.items()}
        moved = max((abs(ahead[n] - x[n]) / FACTORS[n].size for n in ahead), default=0.0)
        done = moved < DONE or (abs(least - size) < GAIN * size and kept == {*fitted})
        ended = [name for name in fitted if done and FACTORS[name].at_end(ahead[name])]
        unidentifiable |= {name: FACTORS[name].unidentifiable(*fitted[name]) for name in ended[:1]}
        # A factor that was identifiable in the last step but no longer is would oscillate: drop it.
        for name in kept & unidentifiable.keys():
            flights.drop_unidentifiable(name, unidentifiable.pop(name))
            del ahead[name]
        x, least, kept = ahead, size, {*fitted}
        if done and not ended:
            break
    else:
        flights.notes.append(f"The fit still moved after {MAX_STEPS} steps: its factors are rough.")
    for name, why in unidentifiable.items():
        flights.drop_unidentifiable(name, why)
    return {name: fitted[name] for name in fitted if name in flights.nominal}


def _step(
    flights: _Flights, x: Mapping[str, float], reach: float
) -> tuple[dict[str, tuple[float, float, float]], dict[str, str]]:
    """Factors of least difference by slopes at `x`, with intervals; why others are dropped."""
    from scipy.optimize import lsq_linear

    names, unidentifiable = [*x], dict[str, str]()
    slopes, here = flights.slopes(x), flights.difference(flights.fly(x)).ravel()
    nominal, sizes, low, high = np.array([FACTORS[name][3:] for name in names]).T
    at = (np.array([*x.values()]) - nominal) / sizes
    # Each factor changes by at most `reach` times its scale. The least identifiable factor is
    # dropped until the log identifies the rest.
    nearest = np.maximum((low - nominal) / sizes, at - reach)
    furthest = np.minimum((high - nominal) / sizes, at + reach)
    late = np.array([name.endswith("_late") for name in names]) / sizes
    here = here - slopes @ at  # with all factors at their nominal values
    kept, fitted = [*range(len(names))], dict[str, tuple[float, float, float]]()
    while kept:
        part = slopes[:, kept]
        best = lsq_linear(part, -here, (nearest[kept], furthest[kept])).x
        blocks = part.reshape(len(flights.t), -1, len(kept))
        left = (here + part @ best).reshape(len(flights.t), -1)
        normal = np.einsum("smi,smj->sij", blocks, blocks)
        ends = interval_of(best, normal, np.einsum("smi,sm->si", blocks, left), late[kept])
        table = nominal[kept] + sizes[kept] * np.vstack([best, ends])
        fitted = {names[i]: tuple(column) for i, column in zip(kept, table.T.tolist(), strict=True)}
        vague = {
            name: (high - low) / FACTORS[name].size
            for name, (value, low, high) in fitted.items()
            if FACTORS[name].unidentifiable(value, low, high) and not FACTORS[name].at_end(value)
        }
        if not vague:
            return fitted, unidentifiable
        name = max(vague, key=lambda name: vague[name])
        unidentifiable[name] = FACTORS[name].unidentifiable(*fitted[name])
        kept.remove(names.index(name))
    return {}, unidentifiable
