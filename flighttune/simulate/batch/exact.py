"""Compiled: the continuous loop with magnitude limits, from corner to corner."""

import math

import numpy as np
from numba import njit

from flighttune.plants.kinematic import LOST
from flighttune.simulate.batch.compiled import kernel
from flighttune.simulate.batch.dop853 import at, at_many, make_pair, next_step
from flighttune.simulate.batch.record import TRACES, measure

DONE, ROLLED, LOST_ANGLE, STUCK = 0, 1, 2, 3
FIRST_STEP = 0.01
SHORTEST_STEP = 1e-13
BEYOND = 1e-12
CORNER_TIME = 1e-12
MOST_CORNERS = 20_000
CHUNK = 64


@njit
def _wanted(y, par):
    """Commands before the limits; a state is chi, gamma and the integral parts."""
    K, ref = par[0], par[1]
    e_0, e_1 = ref[0] - y[0], ref[1] - y[1]
    return K[0] * e_0 + K[1] * e_1 + y[2], K[4] * e_0 + K[5] * e_1 + y[3]


@njit
def _held(v, side, low, high):
    return v if side == 0.0 else high if side > 0.0 else low


@njit
def _rates(t, y, par, out):
    """The law with each command free or held as the sides in `par` say, whatever v is."""
    K, ref, bounds, wave, flight, sides = par
    g_over_v, lead = flight[0], flight[1]
    e_0, e_1 = ref[0] - y[0], ref[1] - y[1]
    v_0, v_1 = _wanted(y, par)
    phi = _held(v_0, sides[0], bounds[0], bounds[1])
    n_z = _held(v_1, sides[1], bounds[2], bounds[3])
    cosine = math.cos(phi)
    out[0] = g_over_v * math.sin(phi) / cosine + wave[0] * math.sin(wave[1] * t)
    out[1] = g_over_v * (n_z * cosine - math.cos(y[1])) + wave[2] * math.cos(wave[3] * t)
    out[2] = K[2] * e_0 + K[3] * e_1 - lead * (v_0 - phi)
    out[3] = K[6] * e_0 + K[7] * e_1 - lead * (v_1 - n_z)


_step, _interpolant = make_pair(_rates)


@njit
def _crossed(y, par):
    """Which command left the piece of the law it is on: 0, 1, or -1 where none did."""
    bounds, sides = par[2], par[5]
    v_0, v_1 = _wanted(y, par)
    if _outside(v_0, sides[0], bounds[0], bounds[1]):
        return 0
    return 1 if _outside(v_1, sides[1], bounds[2], bounds[3]) else -1


@njit
def _outside(v, side, low, high):
    if side == 0.0:
        return v > high + BEYOND or v < low - BEYOND
    return v < high - BEYOND if side > 0.0 else v > low + BEYOND


@njit
def _corner(before, after, piece, par, point):
    """Part of the step at which a command meets its corner; `point` gets the state there."""
    _, h, y, F = piece
    while (after - before) * h > CORNER_TIME:
        middle = 0.5 * (before + after)
        at(middle, y, F, point)
        if _crossed(point, par) >= 0:
            after = middle
        else:
            before = middle
    at(after, y, F, point)
    return after


@njit
def _fill(row, t, y, par):
    ref, bounds, wave, g_over_v = par[1], par[2], par[3], par[4][0]
    v = _wanted(y, par)
    for j in range(2):
        u = min(max(v[j], bounds[2 * j]), bounds[2 * j + 1])
        row[j], row[2 + j], row[6 + j], row[8 + j] = y[j], ref[j] - y[j], u, v[j]
        row[10 + j], row[12 + j] = y[2 + j], 1.0 if u != v[j] else 0.0
    lift = row[7] * math.cos(row[6]) - math.cos(y[1])
    row[4] = -g_over_v * math.tan(row[6]) - wave[0] * math.sin(wave[1] * t)
    row[5] = -g_over_v * lift - wave[2] * math.cos(wave[3] * t)


@njit
def _lost(chi, gamma, phi, stop_at_90):
    if stop_at_90 and not abs(phi) < math.pi / 2:
        return ROLLED
    return DONE if abs(chi) < LOST and abs(gamma) < LOST else LOST_ANGLE


@kernel
def fly_block(block, inputs, settings, t, outputs):
    """Fly the flights of `block`, (first, end).

    `inputs` is K, start, ref, bounds, waves, lead (N,); `settings` is whether to stop at 90 deg of
    roll, looks for corners a sample, tolerance, g; `outputs` as in the sampled loop.
    """
    metrics, samples, ends, last, trajectories = outputs
    traces, row, scratch = np.empty((TRACES, len(t))), np.empty(14), np.empty(len(t))
    for i in range(block[0], block[1]):
        trajectory = trajectories[i] if len(trajectories) else trajectories[0:0].reshape((0, 14))
        samples[i], ends[i] = _fly(i, inputs, settings, t, (row, traces, trajectory))
        last[i] = row
        measure(t, traces, samples[i], scratch, metrics[i])


@njit
def _parameters(i, inputs, g):
    K, start, ref, bounds, waves, lead = inputs
    r = ref[i if len(ref) > 1 else 0, 0]
    flat, b, w = K[i].reshape(8), bounds[i], waves[i]
    gains = (flat[0], flat[1], flat[2], flat[3], flat[4], flat[5], flat[6], flat[7])
    return (
        gains,
        (r[0], r[1]),
        (b[0, 0], b[1, 0], b[0, 1], b[1, 1]),
        (w[0], w[1], w[2], w[3]),
        (g / start[i, 4], lead[i]),
    )


@njit
def _start_sides(y, par):
    bounds, sides = par[2], par[5]
    v = _wanted(y, par)
    for j in range(2):
        low, high = bounds[2 * j], bounds[2 * j + 1]
        sides[j] = 1.0 if v[j] > high else -1.0 if v[j] < low else 0.0


@njit
def _turn(y, par):
    """Let the command that met its corner go, or hold it."""
    bounds, sides, j = par[2], par[5], _crossed(y, par)
    if j >= 0:
        v = _wanted(y, par)[j]
        sides[j] = 0.0 if sides[j] != 0.0 else 1.0 if v > bounds[2 * j + 1] else -1.0


@njit
def _look_along(piece, par, room, look, record):
    """Look for corners along a step, and keep the samples before the first.

    `piece` is the step: start, length, state at the start, coefficients of the interpolant.
    Returns the next look, the part of the step at which there is a corner (-1: none; the first of
    `room` is the state there) and how the flight ended, if it did.
    """
    now, h, y, F = piece
    t, looks, spacing = record[:3]
    point, parts, points = room
    before, last = 0.0, (len(t) - 1) * looks
    final = False
    while not final:
        due = min(int((now + h) / spacing + 1e-9), last) - look + 1
        count = max(0, min(due, len(parts) - 1))
        final = count == due or due < 0
        for m in range(count):
            parts[m] = min(((look + m) * spacing - now) / h, 1.0)
        parts[count] = 1.0
        seen = count + 1 if final else count
        at_many(parts, seen, y, F, points)
        free = _before_corner(seen, points, par)
        whole = min(free, count)
        end, kept = _keep_samples(look, whole, points, par, record)
        look += kept
        if end != DONE:
            return look, -1.0, end
        if free < seen:
            before = parts[free - 1] if free > 0 else before
            return look, _corner(before, parts[free], piece, par, point), DONE
        before = parts[seen - 1]
    return look, -1.0, DONE


@njit
def _before_corner(count, points, par):
    """How many of the `points` lie before the first that is beyond a corner."""
    bounds, sides = par[2], par[5]
    side_0, side_1 = sides[0], sides[1]
    for m in range(count):
        v_0, v_1 = _wanted(points[:, m], par)
        if _outside(v_0, side_0, bounds[0], bounds[1]) or _outside(
            v_1, side_1, bounds[2], bounds[3]
        ):
            return m
    return count


@njit
def _keep_samples(look, count, points, par, record):
    """Keep those of the first `count` looks that are samples; return the end and looks taken."""
    t, looks, _, steady, stop_at_90, row, traces, trajectory = record
    ref, bounds = par[1], par[2]
    last, rated = len(t) - 1, len(trajectory) > 0
    first, after = -(-look // looks), -(-(look + count) // looks)
    for k in range(first, after):
        m = k * looks - look
        v_0, v_1 = _wanted(points[:, m], par)
        phi, n_z = min(max(v_0, bounds[0]), bounds[1]), min(max(v_1, bounds[2]), bounds[3])
        traces[0, k], traces[1, k] = ref[0] - points[0, m], ref[1] - points[1, m]
        traces[2, k], traces[3, k] = phi, n_z - steady
        traces[4, k] = 1.0 if phi != v_0 else 0.0
        traces[5, k] = 1.0 if n_z != v_1 else 0.0
    for k in range(first, after):
        m = k * looks - look
        end = _lost(points[0, m], points[1, m], traces[2, k], stop_at_90)
        if rated or k == last or end != DONE:
            _fill(row, t[k], points[:, m], par)
            if rated:
                trajectory[k] = row
        if end != DONE:
            return end, m + 1
    return DONE, count


@njit
def _fly(i, inputs, settings, t, kept):
    stop_at_90, looks, tolerance, g = settings
    K, ref, bounds, wave, flight = _parameters(i, inputs, g)
    par = (K, ref, bounds, wave, flight, np.zeros(2))
    record = (t, looks, t[1] / looks, math.cos(ref[1]), stop_at_90, *kept)
    y, y_new, scratch, k = np.zeros(4), np.empty(4), np.empty(4), np.empty((16, 4))
    point, parts, points, F = np.empty(4), np.empty(CHUNK), np.empty((4, CHUNK)), np.empty((7, 4))
    y[0], y[1] = inputs[1][i, 0], inputs[1][i, 1]
    points[:, 0] = y
    _start_sides(y, par)
    end, look = _keep_samples(0, 1, points, par, record)
    now, h, corners = 0.0, FIRST_STEP, 0
    _rates(now, y, par, k[0])
    while look <= (len(t) - 1) * looks and end == DONE:
        h = min(h, t[-1] - now)
        if h < SHORTEST_STEP or corners > MOST_CORNERS:
            _fill(kept[0], now, y, par)
            return (look - 1) // looks + 1, STUCK
        error = _step(now, h, y, par, (k, y_new, scratch), tolerance)
        if not error < 1.0:
            h = next_step(h, error) if math.isfinite(error) else 0.1 * h
            continue
        _interpolant(now, h, y, par, (k, y_new, scratch), F)
        look, corner, end = _look_along((now, h, y, F), par, (point, parts, points), look, record)
        if corner < 0.0:
            now += h
            y[:], k[0] = y_new, k[12]
            h = next_step(h, error)
        else:
            now += corner * h
            y[:] = point
            _turn(y, par)
            corners += 1
            _rates(now, y, par, k[0])
    return (look - 1) // looks + 1, end
