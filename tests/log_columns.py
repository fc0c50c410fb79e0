"""Flights whose columns agree by construction: turns, climbs, loops, rolls, in wind and not."""

import numpy as np
import pandas as pd

G = 9.80665
STEP = 0.01
"""Of the integration, s."""


def axes_of(phi, theta, psi):
    """Axes of the body in north, east and down, shape (n, 3, 3), by column."""
    (c, s), (ct, st), (cy, sy) = ((np.cos(a), np.sin(a)) for a in (phi, theta, psi))
    rows = [
        [ct * cy, s * st * cy - c * sy, c * st * cy + s * sy],
        [ct * sy, s * st * sy + c * cy, c * st * sy - s * cy],
        [-st, s * ct, c * ct],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def rates_of(axes):
    """Body rates, shape (n, 3), by the vector of rotation from each sample to the next."""
    turned = np.einsum("nji,njk->nik", axes[:-1], axes[1:])
    skew = 0.5 * (turned - turned.swapaxes(1, 2))
    rates = np.column_stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]]) / STEP
    return np.concatenate([rates, rates[-1:]])


def motion(axes, air, wind):
    """Columns of a flight by its attitude and its velocity through the air, shape (n, 3)."""
    over = air + np.array(wind)
    force = np.gradient(over, STEP, axis=0) - [0.0, 0.0, G]
    body = np.einsum("nij,ni->nj", axes, force)
    places = np.cumsum(over, axis=0) * STEP
    p, q, r = rates_of(axes).T
    return {
        "t_s": STEP * np.arange(len(air)),
        "phi": np.arctan2(axes[:, 2, 1], axes[:, 2, 2]),
        "theta": -np.arcsin(np.clip(axes[:, 2, 0], -1.0, 1.0)),
        "psi": np.arctan2(axes[:, 1, 0], axes[:, 0, 0]),
        "p": p,
        "q": q,
        "r": r,
        "n_z": -body[:, 2] / G,
        "V_a": np.linalg.norm(air, axis=1),
        **{f"v_{name}": over[:, i] for i, name in enumerate(("north", "east", "down"))},
        "north": places[:, 0],
        "east": places[:, 1],
        "h": 500.0 - places[:, 2],
    }


def outer_loop(seconds, *, V=24.0, wind=(0.0, 0.0, 0.0), glide=0.0, seed=0, gusts=0.0):
    """Steps of course and path angle behind lags of roll and load factor, at a speed that errs."""
    rng, n = np.random.default_rng(seed), round(seconds / STEP)
    phi, n_z, chi, gamma, v, x = 0.0, 1.0, 0.0, -glide, V, 0.0
    wanted, climb, V_ref, gust, rows = 0.0, -glide, V, np.zeros(3), []
    for k in range(n):
        if k % 700 == 0:
            wanted = chi + rng.uniform(-1.6, 1.6)
        if k % 500 == 0:
            climb = -glide + rng.uniform(-0.12, 0.12)
        if k % 2300 == 2299:
            V_ref = V + rng.uniform(-2.0, 2.0)
        phi_cmd = float(np.clip(1.5 * (wanted - chi), -0.7, 0.7))
        n_z_cmd = float(np.clip((np.cos(gamma) + 2.5 * (climb - gamma)) / np.cos(phi), 0.3, 2.2))
        phi += STEP * 4.0 * (phi_cmd - phi)
        n_z += STEP * 5.0 * (n_z_cmd - n_z)
        chi += STEP * G / v * n_z * np.sin(phi) / np.cos(gamma)
        gamma += STEP * G / v * (n_z * np.cos(phi) - np.cos(gamma))
        x += STEP * 0.8 * (np.clip(0.6 * (V_ref - v) + G * np.sin(gamma), -4.0, 4.0) - x)
        v += STEP * (x - G * np.sin(gamma))
        gust += STEP * (-gust / 2.0) + gusts * np.sqrt(STEP) * rng.standard_normal(3)
        rows.append((phi, n_z, chi, gamma, v, phi_cmd, n_z_cmd, V_ref - v, *gust))
    phi, n_z, chi, gamma, v, phi_cmd, n_z_cmd, V_err, *gust = np.transpose(rows)
    alpha = np.radians(3.0) * n_z * (V / v) ** 2
    theta, psi = gamma + alpha * np.cos(phi), chi + alpha * np.sin(phi)
    nose = np.column_stack(
        [np.cos(gamma) * np.cos(chi), np.cos(gamma) * np.sin(chi), -np.sin(gamma)]
    )
    axes = axes_of(phi, theta, psi)
    columns = motion(axes, v[:, None] * nose, wind)
    columns["V_a"] = columns["V_a"] + gust[0]
    columns |= {"phi_cmd": phi_cmd, "n_z_cmd": n_z_cmd, "V_err": V_err - gust[0]}
    return columns


def manoeuvres(*parts, V=25.0, wind=(0.0, 0.0, 0.0), start=(0.0, 0.0, 0.0), energy=False):
    """A flight along the nose without a force along the wings, at one speed or one energy.

    Its parts are (seconds, p, q), rad/s; q is None in a level turn.
    """
    axes, speed, all_axes, air = axes_of(*(np.array([a]) for a in start))[0], V, [], []
    for seconds, p, q in parts:
        for _ in range(round(seconds / STEP)):
            all_axes.append(axes)
            air.append(speed * axes[:, 0])
            r = G * axes[2, 1] / speed
            level = r * axes[2, 1] / axes[2, 2] if abs(axes[2, 2]) > 0.1 else 0.0
            rates = np.array([p, level if q is None else q, r])
            angle = np.linalg.norm(rates) * STEP
            K = np.cross(np.eye(3), rates / max(np.linalg.norm(rates), 1e-12))
            axes = axes @ (np.eye(3) - np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K)
            speed += STEP * (G * axes[2, 0] + 0.1 * (V - speed)) if energy else 0.0
    return motion(np.array(all_axes), np.array(air), wind)


def sampled(columns, rate, *, noise=1.0, seed=0):
    """A table at a rate, Hz, with the noise of sensors."""
    rng, every = np.random.default_rng(seed), round(1.0 / (rate * STEP))
    sizes = dict.fromkeys(("phi", "theta", "psi"), 0.003) | dict.fromkeys("pqr", 0.01)
    sizes |= {"n_z": 0.03, "V_a": 0.3, "h": 0.1, "V_err": 0.3}
    sizes |= dict.fromkeys(("v_north", "v_east", "v_down", "north", "east"), 0.05)
    table = {name: column[::every].copy() for name, column in columns.items()}
    for name in table:
        if name in sizes:
            table[name] += noise * sizes[name] * rng.standard_normal(len(table[name]))
    return pd.DataFrame(table)


QUARTER = 0.5 * np.pi
STRAIGHT, ROLL, HALF = (6.0, 0.0, None), (2.0, np.pi, None), (1.0, np.pi, None)
UP = (QUARTER / 0.8, 0.0, 0.8)
"""A quarter of a loop."""


def loop(rate):
    return 4.0 * QUARTER / rate, 0.0, rate


def turn(phi, seconds):
    """Roll in, turn level, roll out."""
    return [(1.0, phi, None), (seconds, 0.0, None), (1.0, -phi, None)]


VERTICAL = (2.0, 0.0, 0.0)
INVERTED_BOX = [STRAIGHT, UP, VERTICAL, UP, (17.0, 0.0, 0.0), UP, VERTICAL, UP, ROLL]
INVERTED_TURNS = [STRAIGHT, HALF, (9.0, 0.0, None), *turn(0.5, 6.0), *turn(-0.6, 6.0), HALF]

RIGHT = {
    "turns and climbs": lambda: outer_loop(150.0),
    "wind of 0.4 of the airspeed": lambda: outer_loop(150.0, wind=(7.0, -6.5, 0.0)),
    "glider": lambda: outer_loop(150.0, glide=0.08, V=18.0, wind=(2.0, 1.0, 0.0)),
    "turbulence": lambda: outer_loop(150.0, gusts=1.0, wind=(-3.0, 4.0, 0.0)),
    "one heading": lambda: manoeuvres(STRAIGHT, *[(4.0, 0.0, 0.02), (4.0, 0.0, -0.02)] * 8),
    "long inverted": lambda: manoeuvres(*INVERTED_BOX * 3),
    "rolls": lambda: manoeuvres(*[STRAIGHT, ROLL, STRAIGHT, HALF, STRAIGHT, HALF] * 5),
    "loops in wind": lambda: manoeuvres(
        *[STRAIGHT, loop(0.8), *turn(0.8, 3.0)] * 5, wind=(5.0, -3.0, 0.0)
    ),
    "loops at one energy": lambda: manoeuvres(
        *[STRAIGHT, loop(0.9), *turn(-0.7, 4.0)] * 5, V=32.0, energy=True
    ),
    "spiral dive": lambda: manoeuvres(
        STRAIGHT, (1.0, 1.0, None), (40.0, 0.0, 0.35), start=(0.0, -0.2, 1.0), energy=True
    ),
    "inverted turns": lambda: manoeuvres(*INVERTED_TURNS * 3),
}
