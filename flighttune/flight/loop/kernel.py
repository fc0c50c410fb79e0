"""Compiled: the sampled loop of one controller and the paper's law, flight by flight.

Numba is imported here and nowhere else, and takes about a second: import this on first use. Without
it (the extra ``fast``) the same functions are interpreted, some hundred times slower. The arguments
are the tuples of `flighttune.flight.loop.batch`.
"""

import math
import pickle
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

import numpy as np

from flighttune.base import units
from flighttune.base.files.owned import believed_bytes
from flighttune.base.files.whole import apart, whole_file
from flighttune.base.units import wrap_angle
from flighttune.control import exact_law, limits, mimo_pi, wind
from flighttune.control.exact_law import LAW_NUMBERS, RateLaw
from flighttune.control.mimo_pi import ChannelLaw, PILaw, PIState
from flighttune.control.wind import filtered, path_over_ground, speed_in_wind, speed_over
from flighttune.flight.loop import measures
from flighttune.routes import follow, path
from flighttune.routes.follow import guidance, path_at, placed, steepest_sine
from flighttune.vehicles.plants import base, navigation, point_mass, sensors, weather
from flighttune.vehicles.plants.jsbsim import properties
from flighttune.vehicles.plants.navigation import Arithmetic
from flighttune.vehicles.plants.point_mass import LOST
from flighttune.vehicles.plants.sensors import ERROR

try:
    import numba.core.caching
    import numba.core.serialize
    from numba import njit
    from numba.extending import register_jitable

    COMPILED = True
except ImportError:
    numba = cast("Any", None)

    def _interpreted(function: Any = None, **_: Any) -> Any:
        return function or (lambda decorated: decorated)

    njit = register_jitable = cast("Any", _interpreted)
    COMPILED = False

SOURCES = (
    Path(__file__),
    *(Path(__file__).with_name(name) for name in ("batch.py", "compiled.py")),
    *(
        Path(str(module.__file__))
        for module in (
            *(exact_law, follow, limits, mimo_pi, path, point_mass, units, measures, wind),
            *(properties, base, sensors, navigation, weather),
        )
    ),
)
DIGEST = sha256(b"".join(path.read_bytes() for path in SOURCES)).hexdigest()[:12]

# Bytes of the SHA-256 at the beginning of a file with a compiled function.
DIGEST_BYTES = 32

# Codes of the ways in which a flight ends.
COMPLETED, ROLLED, DIVERGED = 0, 1, 2

register_jitable(wrap_angle)
for of_law in (
    *(limits.limit_command, exact_law.with_feedback),
    *(exact_law.braked_rate, exact_law.roll_of_lift),
    *(wind.speed_over, wind.level_speed, wind.wind_triangle, wind.speed_in_wind),
    *(wind.filtered, wind.path_over_ground),
    *(follow.steepest_sine, follow.path_at, follow.column_at, follow.nearest_point),
    *(follow.off_route, follow.placed, follow.guidance),
    *(sensors.motion_seen, sensors.sense, weather.wind_at),
):
    register_jitable(of_law)
exact_step = register_jitable(inline="always")(exact_law.exact_step)
pi_step = register_jitable(inline="always")(mimo_pi.pi_step)
for of_errors in (
    *(measures.first_below, measures.step_measures, measures.moves),
    *(measures.settling_time, measures.error_measures),
):
    register_jitable(of_errors)

FunctionCache: Any = numba.core.caching.FunctionCache if COMPILED else object


class Kept(FunctionCache):
    """Compiled functions on disk, each with its SHA-256; after any error they are compiled."""

    # Numba believes its own files: it raises on one that was cut, and runs one that was changed.

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = self

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function of a signature; None if it must be compiled."""
        with suppress(Exception):  # not there or damaged, whatever that raises
            return super().load_overload(sig, target_context)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled function, if that can be done."""
        with suppress(Exception):
            super().save_overload(sig, data)

    def _file(self, key: Any) -> Path:
        """The file of a signature, a processor and a version of Numba."""
        kind = sha256(repr((numba.__version__, key)).encode()).hexdigest()[:16]
        return Path(self.cache_path, f"{self._impl.filename_base}.{kind}.compiled")

    def load(self, key: Any) -> Any:
        """What this user saved, None if it was changed since."""
        file = self._file(key)
        data = believed_bytes(file)
        whole = _digest(file, data[DIGEST_BYTES:]) == data[:DIGEST_BYTES]
        return pickle.loads(data[DIGEST_BYTES:]) if whole else None

    def save(self, key: Any, data: Any) -> None:
        """Write what Numba needs to use a function again."""
        file, compiled = self._file(key), numba.core.serialize.dumps(data)
        with apart(), whole_file(file) as part:
            part.write_bytes(_digest(file, compiled) + compiled)


def _digest(file: Path, compiled: bytes) -> bytes:
    """SHA-256 of a compiled function and of the name that tells which one it is."""
    return sha256(file.name.encode() + compiled).digest()


def kernel(function: Callable[..., Any], **options: Any) -> Any:
    """Compile `function` and keep the result on disk."""
    # Numba looks only at the file of the function to see whether a kept result is still good. The
    # digest of every source that goes into it is therefore made a part of its name.
    function.__qualname__ = f"{function.__qualname__}_{DIGEST}"
    compiled: Any = njit(function, **options)
    with suppress(Exception):  # Numba raises where no folder can be written to
        compiled._cache = Kept(function)
    return compiled


def sample_kernel(function: Callable[..., Any]) -> Any:
    """`kernel` for what makes no array, and need count no references to one: twice as fast."""
    return kernel(function, _nrt=False)


@kernel
def fly_block(first, end, sensor_errors, flights, result):
    """Fly the flights from `first` up to `end` into their places of `result`."""
    for i in range(first, end):
        # Errors of sensors have one row a flight of the block and one a sample; there are none
        # where the controller sees the true values.
        errors = sensor_errors[i - first] if len(sensor_errors) else sensor_errors.reshape((0, 0))
        rows = result.trajectories[i]
        result.samples[i], result.ends[i] = _fly(i, errors, flights, result.t, rows)
        rows[:, result.samples[i] :] = np.nan


@kernel
def error_measures(t, ref, error, effort, limited):
    """The function of that name, compiled."""
    return measures.error_measures(t, ref, error, effort, limited)


@sample_kernel
def mapped(matrix, rows, out):
    """`Arithmetic.mapped`, compiled."""
    for i in range(len(matrix)):
        begun = False
        for j in range(len(rows)):
            x = matrix[i, j]
            if x == 0.0:
                continue
            for k in range(rows.shape[1]):
                product = x * rows[j, k]
                out[i, k] = out[i, k] + product if begun else product
            begun = True
        if not begun:
            for k in range(rows.shape[1]):
                out[i, k] = 0.0


@sample_kernel
def decayed(factor, rows):
    """`Arithmetic.decayed`, compiled."""
    for i in range(len(rows)):
        for k in range(1, rows.shape[1]):
            rows[i, k] += factor * rows[i, k - 1]


@sample_kernel
def turned(real, imag, x, y):
    """`Arithmetic.turned`, compiled."""
    for i in range(len(x)):
        for k in range(1, x.shape[1]):
            a, b = x[i, k - 1], y[i, k - 1]
            x[i, k] += real * a - imag * b
            y[i, k] += imag * a + real * b


ARITHMETIC = Arithmetic(mapped, decayed, turned)


@sample_kernel
def law_sample(k, n_z, law, rows):
    """One sample of a flight under a law of the package, into its row, which has the signals.

    `n_z`: the load factor that the law sees. Returns both commands and the distance along the
    route, m.
    """
    numbers, places, _, _, priority, refs, path, ahead, memory = law
    row, wind, m = rows[k], places[9], places[11]
    chi, gamma, V_a, phi = row[places[0]], row[places[1]], row[places[2]], row[places[3]]
    held = m + 10  # where the row says which limits hold: behind the place, on a route
    if len(path):
        ref, held = _guided(k, row, law)
    else:
        ref = refs[k, 0], refs[k, 1], refs[k, 2], refs[k, 3]
    asked, engines = ref[1], priority[3]
    if engines >= 0:
        sine = steepest_sine(row[engines], V_a, priority[0], priority[1])
        given = math.asin(sine)
        if wind >= 0:
            estimate, air = memory[16:19], row[wind : wind + 3]
            known = filtered(priority[2], estimate if k else air, air)
            estimate[0], estimate[1], estimate[2] = known
            given = path_over_ground(chi, sine, V_a, known)
        if asked > given:
            ref = ref[0], given, ref[2], 0.0
        row[held] = ref[1]
        held += 1
    error, u, u_unsat, integral = memory[0:2], memory[2:4], memory[4:6], memory[6:8]
    state = PIState(error, u, u_unsat, integral, memory[8:10], memory[19:20], memory[10:12])
    if len(numbers) < LAW_NUMBERS:
        more = 0.0, 0.0
        if len(ahead):
            more = ahead[k, 0], ahead[k, 1]
            if math.isnan(more[0]):
                more = 0.0, more[1] / math.cos(phi)
        pi_step(_law(numbers), state, (ref[0], ref[1]), (chi, gamma), more, V_a)
    else:
        speed = V_a if wind < 0 else speed_in_wind(chi, gamma, V_a, row[wind : wind + 3])
        exact_step(_rate_law(numbers), state, ref, (chi, gamma, phi, n_z), speed)
    row[m], row[m + 1], row[m + 2], row[m + 3] = ref[0], asked, 0.0, 0.0
    for j in range(2):
        row[m + 4 + j], row[m + 6 + j], row[m + 8 + j] = u[j], u_unsat[j], integral[j]
        row[held + j] = memory[8 + j]
    return u[0], u[1], memory[20]


@register_jitable(inline="always")
def _guided(k, row, law):
    """What to follow on a route, and where the row ends that has the places on it."""
    _, places, dt, settings, _, _, path, _, memory = law
    V_g, m = places[10], places[11]
    north, east = row[places[5]], row[places[6]]
    if k and V_g >= 0:
        memory[13] = row[V_g]
    elif k:
        memory[13] = speed_over(north - memory[14], east - memory[15], dt)
    memory[14], memory[15] = north, east
    now = row[places[0]], row[places[1]], north, east, row[places[7]]
    ref, place, _, _, _ = guidance(path, path_at(path, memory[12]), memory[13], now, settings)
    memory[12], held = place[0], m + 13
    if V_g >= 0:
        row[m + 13], row[m + 14], held = place[1], place[2], m + 15
        position = row[5], row[6], row[places[8]] - settings[0]
        _, place = placed(path, path_at(path, memory[20]), position)
    memory[20] = place[0]
    row[m + 10], row[m + 11], row[m + 12] = place
    return ref, held


@njit
def _fly(i, sensor_errors, flights, t, rows):
    """Fly one flight into `rows`; return its number of samples and how it ended."""
    chi, gamma, phi, n_z, V_a = flights.start[i]
    j = i if len(flights.ref) > 1 else 0
    ref, ref_rates = flights.ref[j], flights.ref_rates[j]
    wave, g_over_v = flights.waves[i], flights.g[i] / V_a
    law, rate_law, state = _law(flights.laws[i]), _rate_law(flights.laws[i]), _state(phi, n_z)
    step = flights.dt / flights.steps
    u, true_error = state.u, np.zeros(2)
    # The clock is summed as that of the plant is, so that both see the same disturbance.
    clock, disturbance = 0.0, _disturbance(wave, 0.0)
    for k in range(len(t)):
        now = ref[k if len(ref) > 1 else 0]
        chi_ref, gamma_ref = now[0], now[1]
        y, speed = (chi, gamma, u[0], u[1]), V_a
        if len(sensor_errors):
            error = sensor_errors[k]
            y = chi + error[ERROR.chi], gamma + error[ERROR.gamma], u[0], u[1]
            speed = V_a + error[ERROR.V_a]
        if flights.exact:
            rate = ref_rates[k if len(ref_rates) > 1 else 0]
            exact_step(rate_law, state, (chi_ref, gamma_ref, rate[0], rate[1]), y, speed)
        else:
            lift_ff = math.cos(gamma_ref) / math.cos(u[0]) if flights.feed_forward else 0.0
            pi_step(law, state, (chi_ref, gamma_ref), y, (0.0, lift_ff), speed)
        true_error[0] = wrap_angle(chi_ref - chi) if flights.wrapped else chi_ref - chi
        true_error[1] = gamma_ref - gamma
        turn, lift = g_over_v * math.tan(u[0]), u[1] * math.cos(u[0])
        rates = turn + disturbance[0], g_over_v * (lift - math.cos(gamma)) + disturbance[1]
        _fill(rows[:, k], (chi, gamma), true_error, rates, state)
        if k == len(t) - 1:
            break
        if not (abs(u[0]) < math.pi / 2 and math.isfinite(u[1])):
            return k + 1, ROLLED
        for s in range(flights.steps):
            middle = _disturbance(wave, clock + (s + 0.5) * step)
            last = _disturbance(wave, clock + (s + 1) * step)
            chi, gamma = _runge_kutta_step(
                (chi, gamma), (turn, lift, g_over_v), (disturbance, middle, last), step
            )
            disturbance = last
        clock += flights.dt
        if not (abs(chi) < LOST and abs(gamma) < LOST):
            return k + 1, DIVERGED
    return len(t), COMPLETED


@njit
def _fill(row, x, error, rates, state):
    for j in range(2):
        row[j], row[2 + j], row[4 + j] = x[j], error[j], -rates[j]
        row[6 + j], row[8 + j] = state.u[j], state.u_unsat[j]
        row[10 + j], row[12 + j] = state.integral[j], state.limited[j]


@njit
def _law(row):
    channels = _channel(row[:8]), _channel(row[8:16])
    wrapped, conditional = (row[16] != 0.0, row[17] != 0.0), row[18] != 0.0
    return PILaw(channels, wrapped, conditional, row[19], row[20])


@njit
def _channel(row):
    return ChannelLaw((row[0], row[1]), (row[2], row[3]), row[4], row[5], row[6], row[7])


@njit
def _rate_law(row):
    channels = _channel(row[:8]), _channel(row[8:16])
    wrapped, conditional, n = row[16] != 0.0, row[17] != 0.0, row[18:]
    return RateLaw(
        channels, wrapped, conditional, n[0], n[1], n[2], n[3], n[4] != 0.0, (n[5], n[6]), n[7]
    )


@njit
def _state(phi, n_z):
    u, started = np.array([phi, n_z]), np.zeros(1, dtype=np.bool_)
    zero = np.zeros(2)
    return PIState(zero, u, u.copy(), zero.copy(), zero.copy(), started, u.copy())


@njit
def _disturbance(wave, t):
    return wave[0] * math.sin(wave[1] * t), wave[2] * math.cos(wave[3] * t)


@njit
def _runge_kutta_step(x, forcing, disturbances, step):
    """Course and flight-path angle after one step of `PointMassPlant` with the paper's law."""
    # The command makes `forcing`: ``g tan(phi)/V``, ``n_z cos(phi)`` and ``g/V``.
    (chi, gamma), (turn, lift, g_over_v) = x, forcing
    # These are the disturbances at start, middle and end of the step.
    first, middle, last = disturbances
    half, sixth = 0.5 * step, step / 6.0
    k_1 = g_over_v * (lift - math.cos(gamma)) + first[1]
    k_2 = g_over_v * (lift - math.cos(gamma + half * k_1)) + middle[1]
    k_3 = g_over_v * (lift - math.cos(gamma + half * k_2)) + middle[1]
    k_4 = g_over_v * (lift - math.cos(gamma + step * k_3)) + last[1]
    chi += step * turn + sixth * (first[0] + 4.0 * middle[0] + last[0])
    return chi, gamma + sixth * (k_1 + 2.0 * (k_2 + k_3) + k_4)
