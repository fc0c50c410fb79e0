"""Compiled: the sampled loop of one controller and the kinematic plant."""

import math

import numpy as np
from numba import njit

from flighttune.plants.kinematic import LOST
from flighttune.simulate.batch.compiled import kernel, pi_step
from flighttune.simulate.batch.record import TRACES, keep, measure
from flighttune.units import wrap_angle

DONE, ROLLED, LOST_ANGLE = 0, 1, 2


@kernel
def fly_block(block, errors, inputs, settings, t, outputs):
    """Fly the flights of `block`, (first, end).

    `errors` is what sensors add to course, flight-path angle and airspeed, one row a flight of the
    block and one a sample; of no flight where the controller sees what is flown.

    `inputs` is K, start, ref, cosine of the path angle to follow (of the shape of ref without its
    last axis), bounds, waves, then lead_back, 1 over the speed of the schedule and g, each (N,);
    `settings` is conditional, wrapped, feed_forward, sample time, steps of the plant a sample;
    `outputs` is metrics, samples, ends, last, trajectories (N or 0 of them).
    """
    metrics, samples, ends, last, trajectories = outputs
    traces, scratch = np.empty((TRACES, len(t))), np.empty(len(t))
    row, true_error = np.empty(14), np.zeros(2)
    for i in range(block[0], block[1]):
        trajectory = trajectories[i] if len(trajectories) else trajectories[0:0].reshape((0, 14))
        sensed = errors[i - block[0]] if len(errors) else errors.reshape((0, 3))
        record = (row, true_error, traces, trajectory)
        samples[i], ends[i] = _fly(i, sensed, inputs, settings, t, record)
        last[i] = row
        measure(t, traces, samples[i], scratch, metrics[i])


@njit
def _fly(i, sensed, inputs, settings, t, record):
    _, start, ref, level_loads, _, waves, _, _, gravity = inputs
    feed_forward, dt, steps = settings[2], settings[3], settings[4]
    row, true_error, traces, trajectory = record
    chi, gamma, _, _, V_a = start[i]
    law, memory = _law(i, inputs, settings), _memory(start[i])
    u = memory[2]
    row_of_ref = i if len(ref) > 1 else 0
    followed, steadies = ref[row_of_ref], level_loads[row_of_ref]
    g_over_v, clock = gravity[i] / V_a, 0.0
    wanted, steady = followed[0], steadies[0]
    wave = (waves[i, 0], waves[i, 1], waves[i, 2], waves[i, 3])
    disturbed = _disturbance(wave, 0.0)
    for k in range(len(t)):
        if len(followed) > 1:
            wanted, steady = followed[k], steadies[k]
        level = steady / math.cos(u[0]) if feed_forward else 0.0
        y, speed = (chi, gamma), V_a
        if len(sensed):
            y, speed = (chi + sensed[k, 0], gamma + sensed[k, 1]), V_a + sensed[k, 2]
        pi_step(law, memory, (wanted[0], wanted[1]), y, (0.0, level), speed)
        if len(sensed):
            away = wanted[0] - chi
            true_error[0] = wrap_angle(away) if settings[1] else away
            true_error[1] = wanted[1] - gamma
        turn, lift = g_over_v * math.tan(u[0]), u[1] * math.cos(u[0])
        rates = turn + disturbed[0], g_over_v * (lift - math.cos(gamma)) + disturbed[1]
        _fill(row, (chi, gamma), true_error if len(sensed) else memory[0], rates, memory)
        keep(k, row, steady, traces, trajectory)
        if k == len(t) - 1:
            break
        if not (abs(u[0]) < math.pi / 2 and math.isfinite(u[1])):
            return k + 1, ROLLED
        flying = (turn, lift, g_over_v)
        span = (clock, dt / steps, steps)
        chi, gamma, disturbed = _advance((chi, gamma), rates, flying, wave, span)
        clock += dt
        if steps > 1:
            disturbed = _disturbance(wave, clock)
        if not (abs(chi) < LOST and abs(gamma) < LOST):
            return k + 1, LOST_ANGLE
    return len(t), DONE


@njit(inline="always")
def _fill(row, state, error, rates, memory):
    _, _, u, unlimited, integral, limited, _ = memory
    for j in range(2):
        row[j], row[2 + j], row[4 + j] = state[j], error[j], -rates[j]
        row[6 + j], row[8 + j] = u[j], unlimited[j]
        row[10 + j], row[12 + j] = integral[j], limited[j]


@njit
def _law(i, inputs, settings):
    K, bounds, lead_back, per_speed = inputs[0][i], inputs[4][i], inputs[6][i], inputs[7][i]
    conditional, wrapped, _, dt, _ = settings
    rows = (_row(0, K, bounds, dt), _row(1, K, bounds, dt))
    return rows, range(2), (wrapped, False), conditional, lead_back, per_speed


@njit
def _memory(start):
    u, unlimited = start[2:4].copy(), start[2:4].copy()
    error, summed, integral, limited = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    return error, summed, u, unlimited, integral, limited, np.zeros(1, dtype=np.bool_)


@njit
def _row(j, K, bounds, dt):
    half = 0.5 * dt
    return (
        j,
        (K[j, 0], K[j, 1]),
        (K[j, 2] * half, K[j, 3] * half),
        bounds[0, j],
        bounds[1, j],
        bounds[2, j] * dt,
        bounds[3, j] * dt,
    )


@njit
def _disturbance(wave, t):
    return wave[0] * math.sin(wave[1] * t), wave[2] * math.cos(wave[3] * t)


@njit(inline="always")
def _advance(state, rates, flying, wave, span):
    """The Runge-Kutta steps of `KinematicPlant` (without its position), and the disturbance then.

    `rates` are those of `state`; `flying` is what the command makes of it: ``g tan(phi)/V``,
    ``n_z cos(phi)`` and ``g/V``; `span` is start, length and number of the steps.
    """
    (chi, gamma), (c_1, g_1), (turn, lift, g_over_v) = state, rates, flying
    start, step, steps = span
    half, sixth = 0.5 * step, step / 6.0
    last = (0.0, 0.0)
    for s in range(steps):
        t = start + s * step
        if s > 0:
            last = _disturbance(wave, t)
            c_1, g_1 = turn + last[0], g_over_v * (lift - math.cos(gamma)) + last[1]
        middle, last = _disturbance(wave, t + half), _disturbance(wave, t + step)
        g_2 = g_over_v * (lift - math.cos(gamma + half * g_1)) + middle[1]
        g_3 = g_over_v * (lift - math.cos(gamma + half * g_2)) + middle[1]
        g_4 = g_over_v * (lift - math.cos(gamma + step * g_3)) + last[1]
        c_2, c_4 = turn + middle[0], turn + last[0]
        chi += sixth * (c_1 + 2.0 * (c_2 + c_2) + c_4)
        gamma += sixth * (g_1 + 2.0 * (g_2 + g_3) + g_4)
    return chi, gamma, last
