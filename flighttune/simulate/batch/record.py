"""Compiled: what is kept of a flight, and the measures of its errors."""

import math

from numba import njit

NO_STEP = 1e-6
SMALLEST_STEP = math.radians(0.1)
SETTLING_BAND = 0.05
SETTLED_FROM = 0.75


TRACES = 6
"""Errors, efforts and whether a limit holds the command, each of course and flight-path angle."""


@njit(inline="always")
def keep(k, row, steady, traces, trajectory):
    """Take sample `k`: `row` in the order of SIGNALS, `steady` the load factor of level flight."""
    for j in range(2):
        traces[j, k] = row[2 + j]
        traces[4 + j, k] = row[12 + j]
    traces[2, k], traces[3, k] = row[6], row[7] - steady
    if len(trajectory):
        trajectory[k] = row


@njit
def measure(t, traces, samples, metrics):
    """Fill `metrics` (2, 10) in the order of MEASURES from the first `samples` samples."""
    if samples < 2:
        metrics[:] = math.nan
        return
    for j in range(2):
        error, out = traces[j, :samples], metrics[j]
        _integrals(t, error, out)
        _steps(t, error, out)
        squares = held = 0.0
        for k in range(samples):
            squares += traces[2 + j, k] * traces[2 + j, k]
        for k in range(samples - 1):
            held += t[k + 1] - t[k] if traces[4 + j, k] != 0.0 else 0.0
        out[8], out[9] = math.sqrt(squares / samples), held


@njit
def _integrals(t, error, out):
    itae, last = 0.0, len(error) - 1
    for k in range(last):
        left, right = t[k] * abs(error[k]), t[k + 1] * abs(error[k + 1])
        itae += 0.5 * (t[k + 1] - t[k]) * (left + right)
    first = last
    while first > 0 and t[first - 1] >= SETTLED_FROM * t[last]:
        first -= 1
    mean = error[first:].mean()
    spread = 0.0
    for k in range(first, last + 1):
        spread += (error[k] - mean) ** 2
    out[0], out[1] = itae, itae / t[last]
    out[4], out[5] = mean, math.sqrt(spread / (last + 1 - first))


@njit
def _steps(t, error, out):
    n, first = len(error), 0
    while first < n and abs(error[first]) <= NO_STEP:
        first += 1
    out[2], out[3], out[6], out[7] = math.nan, 0.0, math.nan, math.nan
    if first == n:
        return
    step, sign = abs(error[first]), math.copysign(1.0, error[first])
    peak = first
    for k in range(first, n):
        if sign * error[k] < sign * error[peak]:
            peak = k
    out[2], out[3] = t[peak], max(0.0, -sign * error[peak])
    if step < SMALLEST_STEP:
        return
    out[6] = _passage(t, error, first, sign * step, 0.1) - _passage(
        t, error, first, sign * step, 0.9
    )
    settled = n
    while settled > first and abs(error[settled - 1]) / step <= SETTLING_BAND:
        settled -= 1
    if settled < n:
        out[7] = t[settled] - t[first]


@njit
def _passage(t, error, first, step, level):
    """Time at which the part of `step` still to go first passes `level`."""
    for k in range(first, len(error)):
        after = error[k] / step
        if after <= level:
            if k == first:
                return t[k]
            before = error[k - 1] / step
            return t[k] - (t[k] - t[k - 1]) * (level - after) / (before - after)
    return math.nan
