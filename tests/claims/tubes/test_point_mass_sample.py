"""A sample of the exact point mass against its integrated flights, which switch halfway."""

from itertools import product

import numpy as np
import pytest

from flighttune.claims.tubes import dynamics, forms, interval

INTEGRATED = 1e-9
"""The classical Runge-Kutta rule, with 20 steps for each half of a sample, errs by less."""

WIDER = 2.6
"""Widths of rates over those of the flights: the path angle is taken to turn both ways."""

RATE, STEPS = 0.4, 20

# Path angle, roll and load factor in the middle of four pieces: two keep their path angle, and the
# last its course too
MIDDLES = np.array(
    [
        [0.9, -0.8, 2.0],
        [-0.7, 1.0, -1.5],
        [0.9, -0.8, np.cos(0.9) / np.cos(0.8)],
        [0.9, 0.0, np.cos(0.9)],
    ]
)
D_CHI, D_GAMMA = (0.1, 0.3), (-0.35, -0.05)
STILL = (0.02, 0.02), (0.0, 0.0)

# Signs of roll, load factor and both disturbances in both halves, and of the first path angle
SIGNS = np.array([*product([-1.0, 1.0], repeat=7)])
HALVES = [SIGNS[:, [0, 2, 4, 4]], SIGNS[:, [1, 3, 5, 5]]]


def flown(middle, radii, d, h):
    """Course and path angle after a sample from course 0, and the rates within it, by flight."""
    x = np.zeros((len(SIGNS), 2))
    x[:, 1] = middle[0] + radii[0] * SIGNS[:, 6]
    rates = []
    for signs in HALVES:
        phi, n_z = (middle[1:] + radii[1:] * signs[:, :2]).T
        off = np.mean(d, axis=1) + 0.5 * np.ptp(d, axis=1) * signs[:, 2:]

        def rate(x, phi=phi, n_z=n_z, off=off):
            turn, climb = n_z * np.sin(phi) / np.cos(x[:, 1]), n_z * np.cos(phi) - np.cos(x[:, 1])
            return RATE * np.column_stack([turn, climb]) + off

        step = 0.5 * h / STEPS
        for _ in range(STEPS):
            a = rate(x)
            b = rate(x + 0.5 * step * a)
            c = rate(x + 0.5 * step * b)
            rates.append(a)
            x = x + step / 6.0 * (a + 2.0 * b + 2.0 * c + rate(x + step * c))
        rates.append(rate(x))
    return x, np.array(rates)


@pytest.mark.parametrize(
    ("radii", "d"),
    [
        # radii of path angle, roll and load factor
        ((0.0, 0.0, 0.0), STILL),
        ((0.02, 0.0, 0.0), STILL),
        ((0.0, 0.02, 0.0), STILL),
        ((0.0, 0.001, 0.0), STILL),
        ((0.0, 0.0, 0.05), STILL),
        ((0.0, 0.02, 0.05), STILL),
        ((0.02, 0.02, 0.0), STILL),
        ((0.02, 0.0, 0.05), STILL),
        ((0.0, 0.0, 0.0), (D_CHI, D_GAMMA)),
        ((0.0, 0.0, 0.0), (STILL[0], (-1.2, -1.0))),
        ((0.05, 0.05, 0.1), (D_CHI, D_GAMMA)),
    ],
)
@pytest.mark.parametrize("h", [0.004, 0.2])
def test_a_sample_holds_flights_whose_commands_switch_within_it(radii, d, h):
    pieces = forms.Pieces(np.zeros((4, 1)), constraints=0, capacity=3)
    quantities = []
    for middles, radius, symbol in zip(MIDDLES.T, radii, np.eye(3), strict=True):
        row = np.column_stack([middles, np.tile(radius * symbol, (4, 1))])
        form = forms.Form(row, np.zeros(4), np.abs(row).sum(axis=1) * forms.UP)
        quantities.append(forms.Quantity(form, pieces.plain_range(form)))
    (start, *_), zero = quantities, np.zeros((4, 4))
    chi = forms.Form(zero, np.zeros(4), np.zeros(4))
    of_d = interval.Interval(*np.transpose(d))

    *ends, spread = dynamics.point_mass_sample(
        chi, start, *quantities[1:], of_d, h=h, g_over_v=RATE
    )

    symbols = np.column_stack([SIGNS[:, 6], 0.5 * (HALVES[0] + HALVES[1])[:, :2]])
    apart = []
    for i, middle in enumerate(MIDDLES):
        x, rates = flown(middle, np.array(radii), d, h)
        apart.append([np.ptp(rates, axis=0).max(axis=0), np.ptp(rates, axis=(0, 1))])
        for end, reached in zip(ends, x.T, strict=True):
            left = reached - end.coefficients[i, 0] - symbols @ end.coefficients[i, 1:]
            assert np.abs(left).max() <= end.err[i] + INTEGRATED
    within, of_all = np.max(apart, axis=0)
    assert (spread >= within - INTEGRATED).all()
    assert (spread <= WIDER * of_all).all()
