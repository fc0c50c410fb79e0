"""One sample of the enclosure against arithmetic of 30 digits, point by point.

The symbols of the set before the sample are kept; only those that the sample adds are slack.
"""

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from enclosed import KINEMATIC, POINT
from mpmath import mp, mpf

from flighttune.claims.tubes import exact, forms, sample, search, tube
from tests.claims.tubes.test_membership import with_law

DIGITS = 30
D = 0.01  # rad/s

# Half widths of a box: course, path angle, roll, lift, two integrals, two errors (rad and 1), and
# with feedback the expected commands
WIDTHS = np.array([0.02, 0.02, 0.02, 0.04, 0.01, 0.01, 0.02, 0.02, 0.02, 0.04])

# Planned commands (rad and 1) and rates of the reference (rad/s), whichever the law follows
AHEAD = np.array([0.02, -0.01, 0.03, -0.02])


def other(row, **changes):
    """A named tuple with other entries."""
    return type(row)(**{name: getattr(row, name) for name in type(row).__annotations__} | changes)


@pytest.fixture
def thirty_digits(monkeypatch):
    # What is added for computed flights would hide a fault of rounding.
    monkeypatch.setattr(sample, "COMPUTED", 0.0)
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
        without += mpf(float(loop.reference[1, 2 + i]))
        command = limited(without + increment, in_force[i], law)
        if loop.law.conditional and (without + increment - command) * increment > 0:
            # Of an increment outwards only what reaches the limit is taken.
            spare = command - without
            increment = spare if spare * increment > 0 else mpf(0)
        commands.append(command)
        integrals.append(x[4 + i] + increment)
    return commands, integrals, commands[1] - ahead / mp.cos(commands[0]), []


def by_the_exact_law(loop, x, e):
    laws = roll_law, load_law = loop.law.channels
    speed, level = mpf(loop.V_a * loop.law.inverts.per_g), mp.cos(x[1])
    turn, climb = (
        dot(law.K_P, e) + x[4 + i] + mpf(float(loop.reference[1, 4 + i]))
        for i, law in enumerate(laws)
    )
    a, b = speed * level * turn, speed * climb + level
    fed_back = loop.law.feeds_back
    before = x[8:] if fed_back else [x[2], x[3] / mp.cos(x[2])]
    wanted = [mp.atan2(a, b)]
    commands = [limited(wanted[0], before[0], roll_law)]
    wanted.append(b / mp.cos(commands[0]))
    commands.append(limited(wanted[1], before[1], load_law))
    free, expected = [a == b for a, b in zip(wanted, commands, strict=True)], []
    if fed_back:
        # The plant follows at once: what is measured is the command in force.
        expected, of = commands, zip(loop.law.inverts.feedback, commands, x[2:4], strict=True)
        wanted = [u + mpf(k) * (u - seen) for k, u, seen in of]
        commands = [limited(*one) for one in zip(wanted, x[2:4], laws, strict=True)]
        free = [f and a == b for f, a, b in zip(free, wanted, commands, strict=True)]
    integrals = [x[4 + i] + (dot(law.K_I_half, e) if free[i] else 0) for i, law in enumerate(laws)]
    return commands, integrals, commands[1] * (1 if fed_back else mp.cos(commands[0])), expected


def flown(loop, x, d):
    """The whole state a sample later."""
    e = [mpf(float(loop.reference[1, 0])) - x[0], mpf(float(loop.reference[1, 1])) - x[1]]
    law = by_the_exact_law if loop.law.inverts else by_the_paper_s_law
    (phi, n_z), integrals, extra, expected = law(loop, x, e)
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
    return [chi, 2 * mp.atan(half_tangent(h)), phi, extra, *integrals, *e, *expected]


def boxed(centres, sizes, rng):
    """Sets about states: as many symbols as rows, mixed a little, and errors of rounding."""
    count, n = centres.shape
    pieces = forms.Pieces(centres, sample.CONSTRAINTS, 120)
    mixed = np.eye(n) + 0.2 * rng.uniform(-1.0, 1.0, (count, n, n))
    pieces.values[:, :n, 1 : 1 + n] = (
        sizes[:, np.newaxis, np.newaxis] * WIDTHS[:n, np.newaxis] * mixed
    )
    pieces.used = n
    return pieces


@pytest.mark.parametrize(
    ("boxes", "points"), [(8, 4), pytest.param(25, 16, marks=pytest.mark.counts)]
)
@pytest.mark.parametrize(
    ("law", "plant", "samples", "anti_windup"),
    [
        # What limits of the paper's law remove is remembered for the sample after.
        ("paper", KINEMATIC, 2, "conditional"),
        ("paper", KINEMATIC, 1, "none"),
        ("exact", POINT, 1, "conditional"),
        ("exact", KINEMATIC, 1, "conditional"),
        ("fed back", KINEMATIC, 1, "conditional"),
    ],
)
@pytest.mark.usefixtures("thirty_digits")
def test_a_sample_holds_points_to_thirty_digits(law, plant, samples, anti_windup, boxes, points):
    scenario, gains = with_law(
        plant, law, chi_deg=0.0, gamma_deg=10.0, gamma_ref_deg=10.0, anti_windup=anti_windup
    )
    loop = tube.stated_problem(scenario, gains, disturbance=D).loop
    inverts = law != "paper"
    columns = sample.RATES if inverts else sample.PLANNED
    loop.reference[:, columns] = AHEAD[2:] if inverts else AHEAD[:2]
    # Limits and boxes whose ends differ; roll is at either end of its range in some of the sets.
    roll, load = (other(of, step_down=0.7 * of.step_down) for of in loop.law.channels)
    channels = other(roll, lower=-0.45, upper=0.43), load
    loop = replace(
        loop,
        law=other(loop.law, channels=channels),
        boxes=np.tile([[-0.2 * D, D], [-D, 0.4 * D]], (len(loop.boxes), 1, 1)),
    )
    rng, outside, centres, n = np.random.default_rng(5), [], [], loop.rows
    sizes = rng.choice([1.0, 0.3, 0.03, 0.0], boxes)
    for size in sizes:
        # Inside the range of roll, even in the corners of a box of this size
        inwards = 0.004 + 0.05 * size
        phi = rng.choice([-0.45 + inwards, rng.uniform(-0.4, 0.4), 0.43 - inwards])
        error = rng.uniform(-0.03, 0.03, 2)
        chi, gamma = -error[0], loop.reference[1, 1] - error[1]
        lift = rng.uniform(-0.05, 0.05) + (np.cos(gamma) if inverts else 0.0)
        # Near the commands wanted: some flights of a box are limited and some are not.
        integral = np.array([loop.g_over_v * np.tan(phi), 0.0]) if inverts else np.array([phi, 0.0])
        integral = integral - [np.array(of.K_P) @ error for of in loop.law.channels]
        integral = integral - loop.reference[1, columns]
        # Without a kink between the flights of a small box, these are exactly as limited.
        integral[0] += rng.choice([-0.03, 0.0, 0.03]) * (loop.g_over_v if inverts else 1.0)
        integral[1] += rng.choice([-0.04, 0.0, 0.04]) * (loop.g_over_v if inverts else 1.0)
        extra = lift / np.cos(phi) if law == "fed back" else lift
        expected = [phi, lift / np.cos(phi)][: n - sample.STATES]
        centres.append([chi, gamma, phi, extra, *integral, *error, *expected])
    pieces = boxed(np.array(centres), sizes, rng)
    sets = pieces.values[:, :n, : 1 + n].copy()
    enclosure, met = exact.enclosure_of(loop, pieces, search.Search(loop)), np.zeros(2, dtype=bool)
    for k in range(1, 1 + samples):
        met |= enclosure.sample(k)[1]
    slack = np.abs(pieces.values[:, :n, 1 + n :]).sum(axis=2) + pieces.err[:, :n]
    for before, after, more in zip(sets, pieces.values[:, :n, : 1 + n], slack, strict=True):
        for i in range(points):
            xi = rng.uniform(-1.0, 1.0, n)
            xi = np.sign(xi) if i % 2 else xi
            exactly = [mpf(1), *map(mpf, xi.tolist())]
            d = [mpf(float(ends[rng.integers(2)])) for ends in loop.boxes[1]]
            x = [dot(row, exactly) for row in before]
            for _ in range(samples):
                x = flown(loop, x, d)
            off = [abs(value - dot(row, exactly)) for value, row in zip(x, after, strict=True)]
            outside.append([float(a - mpf(float(b))) for a, b in zip(off, more, strict=True)])
    assert met.all()
    assert len(outside) == boxes * points
    assert np.max(outside) <= 0.0
