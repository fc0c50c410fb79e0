"""Compiled: the Runge-Kutta pair of order 8(5,3) with its interpolant, for four states."""

import numpy as np
from numba import njit
from scipy.integrate import DOP853

A = np.vstack([np.hstack([DOP853.A, np.zeros((12, 4))]), np.zeros((1, 16)), DOP853.A_EXTRA])
A[12, :12] = DOP853.B
C = np.concatenate([DOP853.C, [1.0], DOP853.C_EXTRA])
E_3, E_5, D = DOP853.E3, DOP853.E5, DOP853.D
N = 4
LAST, ALL = 12, 16
SAFETY, SHRINK, GROW = 0.9, 0.2, 10.0


@njit
def _weighted(weights, k, count):
    s_0 = s_1 = s_2 = s_3 = 0.0
    for j in range(count):
        w = weights[j]
        s_0 += w * k[j, 0]
        s_1 += w * k[j, 1]
        s_2 += w * k[j, 2]
        s_3 += w * k[j, 3]
    return s_0, s_1, s_2, s_3


def make_pair(rates):
    """Step and interpolant for ``y' = rates(t, y, par, out)``, which writes its result to `out`.

    Parameters
    ----------
    rates : compiled function
        Of time, state (4,), parameters and result (4,).

    Returns
    -------
    step : compiled function
        ``step(t, h, y, par, work, tolerance)``: one step from `y`; returns the error over the
        tolerance. Of `work`, it takes the rates at `y` from ``k[0]`` and writes ``k[1:13]`` and
        `y_new`; the third is room for a state.
    interpolant : compiled function
        ``interpolant(t, h, y, par, work, F)``: writes the coefficients (7, 4) that `at` takes; adds
        three stages to k.

    Notes
    -----
    Method, error estimate and coefficients are those of `scipy.integrate.DOP853`; E. Hairer,
    S. P. Norsett, G. Wanner, *Solving Ordinary Differential Equations I*, section II.5.
    """

    @njit
    def stages(those, t, h, y, par, work):
        k, _, scratch = work
        for s in range(those[0], those[1]):
            s_0, s_1, s_2, s_3 = _weighted(A[s], k, s)
            scratch[0], scratch[1] = y[0] + h * s_0, y[1] + h * s_1
            scratch[2], scratch[3] = y[2] + h * s_2, y[3] + h * s_3
            rates(t + C[s] * h, scratch, par, k[s])

    @njit
    def step(t, h, y, par, work, tolerance):
        k, y_new, scratch = work
        stages((1, LAST + 1), t, h, y, par, work)
        y_new[:] = scratch
        e_3, e_5 = _weighted(E_3, k, LAST + 1), _weighted(E_5, k, LAST + 1)
        fifth = third = 0.0
        for c in range(N):
            scale = tolerance * (1.0 + max(abs(y[c]), abs(y_new[c])))
            third += (e_3[c] / scale) ** 2
            fifth += (e_5[c] / scale) ** 2
        if fifth == 0.0:
            return 0.0
        return h * fifth / np.sqrt((fifth + 0.01 * third) * N)

    @njit
    def interpolant(t, h, y, par, work, F):
        k, y_new, _ = work
        stages((LAST + 1, ALL), t, h, y, par, work)
        for c in range(N):
            change = y_new[c] - y[c]
            F[0, c] = change
            F[1, c] = h * k[0, c] - change
            F[2, c] = 2.0 * change - h * (k[LAST, c] + k[0, c])
        for i in range(4):
            total = _weighted(D[i], k, ALL)
            for c in range(N):
                F[3 + i, c] = h * total[c]

    return step, interpolant


@njit
def at(x, y, F, out):
    """Write to `out` the state at the part `x` of the step that began at `y`."""
    for c in range(N):
        value = F[6, c] * x
        value = (value + F[5, c]) * (1.0 - x)
        value = (value + F[4, c]) * x
        value = (value + F[3, c]) * (1.0 - x)
        value = (value + F[2, c]) * x
        value = (value + F[1, c]) * (1.0 - x)
        out[c] = y[c] + (value + F[0, c]) * x


@njit
def at_many(parts, count, y, F, points):
    """Write to ``points[:, :count]`` the states at the first `count` of `parts`."""
    for c in range(N):
        start, f_0, f_1, f_2 = y[c], F[0, c], F[1, c], F[2, c]
        f_3, f_4, f_5, f_6 = F[3, c], F[4, c], F[5, c], F[6, c]
        component = points[c]
        for m in range(count):
            x = parts[m]
            left = 1.0 - x
            value = (((f_6 * x + f_5) * left + f_4) * x + f_3) * left
            component[m] = start + (((value + f_2) * x + f_1) * left + f_0) * x


@njit
def next_step(h, error):
    """Length of the step to try after one of length `h` with `error` over tolerance."""
    if error == 0.0:
        return h * GROW
    return h * min(GROW, max(SHRINK, SAFETY * error ** (-1.0 / 8.0)))
