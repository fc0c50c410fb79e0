"""Whole flights of an aircraft whose step is compiled, sample by sample.

The loop around the step equals that of `Flight` and `JSBSimPlant`, to the bit. Without Numba it is
interpreted.
"""

import math

from flighttune.base.units import FT
from flighttune.flight.loop.batch import (
    ALPHA,
    ARRIVED,
    BESIDE,
    BEYOND,
    CHI,
    GOES_ON,
    HEIGHT,
    LIFT,
    N_Z,
    N_Z_SEEN,
    OUTSIDE,
    PSI,
    THETA,
    V_FPS,
)
from flighttune.flight.loop.kernel import law_sample, register_jitable, sample_kernel
from flighttune.vehicles.plants.sensors import ERROR, sense
from flighttune.vehicles.plants.weather import REFRESH, WIND, wind_at

# Places in the wind of a `Motion`: its change in a step, and the height before.
CHANGE, BEFORE = len(WIND), 2 * len(WIND)

inlined = register_jitable(inline="always")  # a call would pass some hundred numbers of a flight


@sample_kernel
def fly_samples(step, normals, motion, law, fed_back, seen, part, rows):
    """Fly a part of the samples into `rows`, whose first row has its signals already.

    `step` and `normals`: functions of the compiled step. `fed_back`: whether the law sees the load
    factor that the inner loop follows. `seen`: errors of the signals that the law sees, a row per
    sample or none, and the further arguments of `sense`. `part`: first sample, end of the samples,
    and length of the route (m). Returns the samples in the rows, the state of the flight, and the
    integration steps flown.
    """
    first, last, end = part
    shown, m, final = motion.shown, motion.signals, len(rows) - 1
    errors, places, numbers = seen
    for k in range(first, last):
        row = rows[k]
        n_z = shown[m + N_Z_SEEN] if fed_back else row[N_Z]
        if len(errors):
            sense(row, rows[k - 1], k > 0, errors[k], places, numbers)
        if errors.shape[1] > ERROR.n_z:
            n_z += errors[k, ERROR.n_z]
        phi_cmd, n_z_cmd, along = law_sample(k, n_z, law, rows)
        clock = k * motion.steps
        if k == final or along >= end:
            return k + 1, ARRIVED, clock
        if not (math.isfinite(phi_cmd) and math.isfinite(n_z_cmd)):
            return k + 1, BEYOND, clock
        motion.parameters[motion.commands[0]] = phi_cmd
        motion.parameters[motion.commands[1]] = n_z_cmd
        how, flown = _fly_steps(step, normals, motion, clock, motion.steps)
        if how != GOES_ON:
            return k + 1, how, clock + flown
        after = rows[k + 1]
        for j in range(m):
            after[j] = shown[j]
        for j in range(motion.further):
            after[m + j] = shown[m + BESIDE + j]
        after[CHI] = row[CHI] + _remainder(shown[CHI] - row[CHI])
        after[PSI] = row[PSI] + _remainder(shown[PSI] - row[PSI])
    return last, GOES_ON, last * motion.steps


@sample_kernel
def fly_sample(step, normals, motion, clock, steps):
    """Fly some integration steps; return the state of the flight and the steps flown."""
    return _fly_steps(step, normals, motion, clock, steps)


@inlined
def _fly_steps(step, normals, motion, clock, steps):
    shown, m, flown = motion.shown, motion.signals, 0
    while flown < steps:
        n = min(motion.between, steps - flown)
        _advance(step, normals, motion, clock + flown, n)
        flown += n
        if not motion.floor < shown[m + HEIGHT] < motion.ceiling:
            return BEYOND, flown
        if not _inside(shown, m, motion.low, motion.high):
            return OUTSIDE, flown
    return GOES_ON, flown


@inlined
def _inside(shown, m, low, high):
    alpha, theta = shown[ALPHA], shown[THETA]
    return (
        low[0] < alpha < high[0]
        and low[1] < shown[m + V_FPS] < high[1]
        and low[2] < shown[m + LIFT] < high[2]
        and low[3] < theta < high[3]
    )


@register_jitable
def _remainder(x):
    """``math.remainder(x, tau)``, as CPython computes it."""
    size = abs(x)
    whole = size % math.tau
    left = math.tau - whole
    if whole < left:
        r = whole
    elif whole > left:
        r = -left
    else:
        r = whole - 2.0 * (0.5 * (size - whole) % math.tau)
    return math.copysign(1.0, x) * r


@inlined
def _advance(step, normals, motion, clock, n):
    """Fly n integration steps after the `clock` steps so far; show the signals after the last."""
    states, parameters = motion.states.ctypes.data, motion.parameters.ctypes.data
    stream, shown = motion.stream.ctypes.data, motion.shown.ctypes.data
    windy = len(motion.air.levels) > 0
    done = 0
    while done < n:
        now, some = clock + done, n - done
        _change(motion, now)
        if motion.changed[0] < len(motion.change_at):
            some = min(some, motion.change_at[motion.changed[0]] - now)
        if windy:
            some = 1
            _blow(motion, now)
        if len(motion.errors):
            some = 1
            for j in range(len(motion.error_places)):
                motion.parameters[motion.error_places[j]] = motion.errors[now, j]
        if motion.stream.shape[1]:
            some = min(some, len(motion.stream))
            normals(motion.random.ctypes.data, motion.stream.shape[1] * some, stream)
        done += some
        show = done == n or (windy and (now + some) % REFRESH == 0)
        step(states, parameters, some, stream, shown, 1 if show else 0)


@inlined
def _change(motion, now):
    """Apply the changes of parameters and states that are due before a step."""
    i = motion.changed[0]
    while i < len(motion.change_at) and motion.change_at[i] <= now:
        place = motion.change_place[i]
        if place >= 0:
            motion.parameters[place] = motion.change_to[i]
        else:
            motion.states[-1 - place] = motion.change_to[i]
        i += 1
    motion.changed[0] = i


@inlined
def _blow(motion, now):
    """Write the wind at the end of the next step: linear between instants where it is computed."""
    wind = motion.wind
    if now % REFRESH == 0:
        h = motion.shown[motion.signals + HEIGHT]
        then = (2.0 * h - wind[BEFORE]) * FT + motion.ground
        after = wind_at(motion.air, (now + REFRESH) / motion.rate, then)
        for j in range(len(after)):
            wind[CHANGE + j] = (after[j] / FT - wind[j]) / REFRESH
        wind[BEFORE] = h
    for j in range(CHANGE):
        wind[j] += wind[CHANGE + j]
        motion.parameters[motion.wind_places[j]] = wind[j]
