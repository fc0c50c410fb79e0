"""One sample of the enclosure against arithmetic of 30 digits, point by point.

The symbols of the set before the sample are kept; only those that the sample adds are slack.
"""

import mpmath
import numpy as np
import pytest
from mpmath import mp, mpf

from flighttune.claims.tubes import sample as sample_module
from flighttune.claims.tubes.exact import enclosure_of
from flighttune.claims.tubes.forms import Pieces
from flighttune.claims.tubes.sample import CONSTRAINTS, STATES
from flighttune.claims.tubes.search import Search
from flighttune.claims.tubes.tube import stated_problem
from tests.claims.tubes.test_membership import KINEMATIC, POINT, with_law

DIGITS = 30
D = 0.01  # rad/s

# Half widths of a box: course, path angle, roll, lift, two integrals, two errors (rad and 1).
WIDTHS = np.array([0.02, 0.02, 0.02, 0.04, 0.01, 0.01, 0.02, 0.02])


@pytest.fixture
def thirty_digits(monkeypatch):
    # What is added for computed flights would hide a fault of rounding.
    monkeypatch.setattr(sample_module, "COMPUTED", 0.0)
    with mp.workdps(DIGITS):
        yield


def dot(row, values):
    return sum((mpf(float(a)) * b for a, b in zip(row, values, strict=True)), mpf(0))


def limited(wanted, before, law):
    """The command after its limits; it starts inside its range."""
    low = max(mpf(law.lower), before + mpf(law.step_down))
    return min(max(wanted, low), min(mpf(law.upper), before + mpf(law.step_up)))


def by_the_paper_s_law(loop, x, e):
    """Commands, integrals and the lift kept; conditional anti-windup."""
    ahead = mp.cos(mpf(float(loop.reference[1, 1])))
    in_force = x[2], x[3] + ahead / mp.cos(x[2])
    commands, integrals = [], []
    for i, law in enumerate(loop.law.channels):
        increment = dot(law.K_I_half, [a + b for a, b in zip(e, x[6:8], strict=True)])
        without = (ahead / mp.cos(x[2]) if i else 0) + dot(law.K_P, e) + x[4 + i]
        command = limited(without + increment, in_force[i], law)
        if (without + increment - command) * increment > 0:
            # Of an increment outwards only what reaches the limit is taken.
            spare = command - without
            increment = spare if spare * increment > 0 else mpf(0)
        commands.append(command)
        integrals.append(x[4 + i] + increment)
    return commands, integrals, commands[1] - ahead / mp.cos(commands[0])


def by_the_exact_law(loop, x, e):
    roll_law, load_law = loop.law.channels
    speed, level = mpf(loop.V_a * loop.law.inverts.per_g), mp.cos(x[1])
    turn, climb = (dot(law.K_P, e) + x[4 + i] for i, law in enumerate(loop.law.channels))
    a, b = speed * level * turn, speed * climb + level
    wanted = mp.atan2(a, b)
    phi = limited(wanted, x[2], roll_law)
    load = b / mp.cos(phi)
    n_z = limited(load, x[3] / mp.cos(x[2]), load_law)
    free = wanted == phi, load == n_z
    integrals = [
        x[4 + i] + (dot(law.K_I_half, e) if free[i] else 0)
        for i, law in enumerate((roll_law, load_law))
    ]
    return [phi, n_z], integrals, n_z * mp.cos(phi)


def flown(loop, x, d):
    """The whole state a sample later."""
    e = [mpf(float(loop.reference[1, 0])) - x[0], mpf(float(loop.reference[1, 1])) - x[1]]
    law = by_the_exact_law if loop.law.inverts else by_the_paper_s_law
    (phi, n_z), integrals, extra = law(loop, x, e)
    h, rate = mpf(loop.dt), mpf(loop.g_over_v)
    # With T = tan(gamma/2) the climb is T' = p + q T^2, which has a closed form.
    lift = rate * n_z * mp.cos(phi) + d[1]
    p, q, start = (lift - rate) / 2, (lift + rate) / 2, mp.tan(x[1] / 2)
    root = mp.sqrt(mpmath.mpc(p * q))

    def half_tangent(t):
        turned = mp.tan(root * t)
        return ((start * root + p * turned) / (root - q * start * turned)).real

    if loop.exact:
        nodes = mpmath.calculus.quadrature.GaussLegendre(mp).calc_nodes(3, mp.prec)
        over_cosine = sum(
            weight / 2 * (1 + T * T) / (1 - T * T)
            for node, weight in nodes
            for T in [half_tangent(h * (1 + node) / 2)]
        )
        turning = n_z * mp.sin(phi) * over_cosine
    else:
        turning = mp.tan(phi)
    chi = x[0] + h * (rate * turning + d[0])
    return [chi, 2 * mp.atan(half_tangent(h)), phi, extra, *integrals, *e]


def boxed(centre, rng):
    """A set about a state: as many symbols as rows, mixed a little, and errors of rounding."""
    pieces = Pieces(centre[np.newaxis], CONSTRAINTS, 120)
    mixed = np.eye(STATES) + 0.2 * rng.uniform(-1.0, 1.0, (STATES, STATES))
    size = rng.choice([1.0, 0.3, 0.03, 0.0])
    pieces.values[0, :STATES, 1 : 1 + STATES] = size * WIDTHS[:, np.newaxis] * mixed
    pieces.used = STATES
    return pieces


@pytest.mark.parametrize(
    ("boxes", "points"), [(6, 4), pytest.param(25, 16, marks=pytest.mark.counts)]
)
@pytest.mark.parametrize(("exact", "plant"), [(False, KINEMATIC), (True, POINT), (True, KINEMATIC)])
@pytest.mark.usefixtures("thirty_digits")
def test_a_sample_holds_points_to_thirty_digits(exact, plant, boxes, points):
    scenario, gains = with_law(
        plant, exact=exact, chi_err_deg=0.0, gamma_deg=10.0, gamma_ref_deg=10.0
    )
    loop = stated_problem(scenario, gains, disturbance=D).loop
    rng, outside, met = np.random.default_rng(5), [], np.zeros(2, dtype=bool)
    for _ in range(boxes):
        phi, error = rng.uniform(-0.5, 0.5), rng.uniform(-0.03, 0.03, 2)
        chi, gamma = -error[0], loop.reference[1, 1] - error[1]
        lift = rng.uniform(-0.05, 0.05) + (np.cos(gamma) if exact else 0.0)
        # Near the commands wanted: some flights of a box are limited and some are not.
        integral = np.array([loop.g_over_v * np.tan(phi), 0.0]) if exact else np.array([phi, 0.0])
        integral = integral - [np.array(law.K_P) @ error for law in loop.law.channels]
        centre = np.array([chi, gamma, phi, lift, *integral, *error])
        pieces = boxed(centre, rng)
        before = pieces.values[0, :STATES, : 1 + STATES].copy()
        _, limited = enclosure_of(loop, pieces, Search(loop)).sample(1)
        met |= limited
        after, err = pieces.values[0, :STATES], pieces.err[0, :STATES]
        slack = np.abs(after[:, 1 + STATES :]).sum(axis=1) + err
        for i in range(points):
            xi = rng.uniform(-1.0, 1.0, STATES)
            xi = np.sign(xi) if i % 2 else xi
            exactly = [mpf(1), *map(mpf, xi.tolist())]
            d = [mpf(D) * int(sign) for sign in rng.choice([-1, 1], 2)]
            x = [dot(row, exactly) for row in before]
            off = [
                abs(value - dot(row[: 1 + STATES], exactly))
                for value, row in zip(flown(loop, x, d), after, strict=True)
            ]
            outside.append([float(a - mpf(float(b))) for a, b in zip(off, slack, strict=True)])
    assert met.all()
    assert len(outside) == boxes * points
    assert np.max(outside) <= 0.0
