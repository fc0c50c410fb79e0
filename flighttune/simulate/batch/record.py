"""Compiled: what is kept of a flight, and the measures of its errors."""

import math

from numba import njit

NO_STEP = 1e-6
SMALLEST_STEP = math.radians(0.1)
SETTLING_BAND = 0.05
SETTLED_FROM = 0.75
LARGEST_LEAF = 128
"""Numbers that NumPy's pairwise summation adds up without halving them again."""

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
def measure(t, traces, samples, scratch, metrics):
    """Fill `metrics` (2, 10) in the order of MEASURES from the first `samples` samples.

    Formula by formula and sum by sum what `flighttune.metrics` does, so that not a bit differs.
    `scratch` is room for as many numbers as there are samples.
    """
    if samples < 2:
        metrics[:] = math.nan
        return
    for j in range(2):
        error, out = traces[j, :samples], metrics[j]
        _integrals(t, error, scratch, out)
        _steps(t, error, out)
        for k in range(samples):
            scratch[k] = traces[2 + j, k] * traces[2 + j, k]
        out[8] = math.sqrt(total(scratch[:samples]) / samples)
        held = 0
        for k in range(samples - 1):
            if traces[4 + j, k] != 0.0:
                scratch[held] = t[k + 1] - t[k]
                held += 1
        out[9] = total(scratch[:held])


@njit
def total(values):
    """Sum of `values` in the order in which NumPy adds them up."""
    return 0.0 + _pairwise(values)


@njit
def _pairwise(a):
    n = len(a)
    if n > LARGEST_LEAF:
        half = n // 2
        half -= half % 8
        return _pairwise(a[:half]) + _pairwise(a[half:])
    if n < 8:
        s = 0.0
        for k in range(n):
            s += a[k]
        return s
    s_0, s_1, s_2, s_3, s_4, s_5, s_6, s_7 = a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7]
    whole = n - n % 8
    for k in range(8, whole, 8):
        s_0, s_1, s_2, s_3 = s_0 + a[k], s_1 + a[k + 1], s_2 + a[k + 2], s_3 + a[k + 3]
        s_4, s_5, s_6, s_7 = s_4 + a[k + 4], s_5 + a[k + 5], s_6 + a[k + 6], s_7 + a[k + 7]
    s = ((s_0 + s_1) + (s_2 + s_3)) + ((s_4 + s_5) + (s_6 + s_7))
    for k in range(whole, n):
        s += a[k]
    return s


@njit
def _integrals(t, error, scratch, out):
    last = len(error) - 1
    for k in range(last):
        both = t[k + 1] * abs(error[k + 1]) + t[k] * abs(error[k])
        scratch[k] = (t[k + 1] - t[k]) * both / 2.0
    itae = total(scratch[:last])
    first = last
    while first > 0 and t[first - 1] >= SETTLED_FROM * t[last]:
        first -= 1
    count = last + 1 - first
    mean = total(error[first:]) / count
    for k in range(count):
        scratch[k] = (error[first + k] - mean) ** 2
    out[0], out[1] = itae, itae / t[last]
    out[4], out[5] = mean, math.sqrt(total(scratch[:count]) / count)


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
    beyond = -sign * error[peak]
    out[2], out[3] = t[peak], beyond if beyond > 0.0 else 0.0
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
            return (t[k - 1] - t[k]) / (before - after) * (level - after) + t[k]
    return math.nan
