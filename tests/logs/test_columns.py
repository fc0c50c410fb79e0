"""Columns of a log against the laws of motion: each error is said with what mends it."""

import math
import re
from contextlib import suppress

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_files import heavy_cessna
from scipy import constants as si

import flighttune as ft

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


FLIGHTS = {"still air": RIGHT["turns and climbs"], "Cessna": lambda: of_run(heavy_cessna(150.0))}
WIND = np.array([7.0, -6.5, 0.0])


def of_run(run):
    """Columns of a simulated flight; its velocity over ground is the slope of its path."""
    names = "phi theta psi p q r n_z V_a north east phi_cmd n_z_cmd h"
    columns = {name: run.signals[name].to_numpy() for name in names.split()}
    over = {"v_north": run.signals["north"], "v_east": run.signals["east"], "v_down": -columns["h"]}
    return {"t_s": run.t, **columns, **{x: np.gradient(y, run.t) for x, y in over.items()}}


@pytest.fixture(scope="module")
def log_of(tmp_path_factory):
    """What is said of a table of a flight at a rate, with a change."""
    flown, path = {}, tmp_path_factory.mktemp("columns") / "flight.csv"

    def said(make, rate, change=lambda _: {}):
        if make not in flown:
            flown[make] = make()
        log = sampled(flown[make], rate)
        log.assign(**change(log)).to_csv(path, index=False)
        return ft.load_log(path).provenance.log

    return said


@pytest.mark.counts
@pytest.mark.parametrize("rate", [10, 25, 50])
@pytest.mark.parametrize("make", [*RIGHT.values(), FLIGHTS["Cessna"]], ids=[*RIGHT, "Cessna"])
def test_no_right_log_is_accused_at_any_rate(log_of, make, rate):
    assert log_of(make, rate)["wrong"] == []


def test_a_right_rate_is_not_accused_for_a_few_bad_seconds(log_of):
    """As between two kinds of flight: attitude is coarse, and the rate is large and unlike it."""
    rate, at = "q", 60.0

    def shaken(log):
        bad = (log["t_s"] >= at) & (log["t_s"] < at + 6.0)
        noise = np.random.default_rng(7).standard_normal(len(log))
        return {rate: np.where(bad, log[rate] + 0.1 * noise.cumsum(), log[rate])}

    log = log_of(FLIGHTS["still air"], 10, shaken)

    assert not log["wrong"]
    assert rate in str([line for line in log["checks"] if line.startswith("These agree")])


@pytest.fixture(scope="module")
def agreeing():
    """Columns at 10 Hz of a made-up flight in wind that obeys the laws of motion."""
    fine = outer_loop(60.0, wind=WIND, seed=2)
    over = np.column_stack([fine[f"v_{axis}"] for axis in ("north", "east", "down")])
    force = np.gradient(over, STEP, axis=0) - [0.0, 0.0, G]
    body = np.einsum("nij,ni->nj", axes_of(fine["phi"], fine["theta"], fine["psi"]), force)
    fine |= {
        "f_x": body[:, 0],
        "f_y": body[:, 1],
        "f_z": -G * fine["n_z"],
        "down": -fine["h"],
        "V_g": np.hypot(over[:, 0], over[:, 1]),
        "chi": np.arctan2(over[:, 1], over[:, 0]),
        "wind_north": 0.0 * over[:, 0] + WIND[0],
        "wind_east": 0.0 * over[:, 0] + WIND[1],
        "height_err": 500.0 - fine["h"],
        "theta_cmd": fine["theta"],
    }
    return {name: column[::10].copy() for name, column in fine.items()}


@pytest.fixture
def said(agreeing, tmp_path):
    """What a log of some columns says of them: what is wrong, and the notes."""

    def said(there, change=lambda _: {}, **options):
        given = {x: agreeing[x] for x in ("t_s", "phi", *there.split())}
        changed = pd.DataFrame(given | change({**agreeing, **given}))
        changed.to_csv(tmp_path / "f.csv", index=False)
        log = ft.load_log(tmp_path / "f.csv", **options).provenance.log
        return log["wrong"], [line for line in log["checks"] if line not in log["wrong"]]

    return said


ALL = (
    "theta psi p q r n_z V_a v_north v_east v_down north east h phi_cmd n_z_cmd V_err down V_g chi "
    "wind_north wind_east height_err theta_cmd f_x f_y"
)
AGREE = """
p q r | the changes of attitude
v_north v_east north east V_g chi | the path
v_down h down height_err | the vertical speed
wind_north wind_east | the wind that speeds and nose show
n_z n_z_cmd | path and roll
phi_cmd | the roll
theta_cmd | the pitch
V_err | the changes of speed
f_x | path and attitude
V_a | the ground speed
psi | the course
theta | gamma and lift
phi | course and speed in turns
"""


def test_every_column_of_a_right_log_agrees_with_others_that_are_named(said):
    """A side force alone does not act. Each column has its partner in this table."""
    wrong, (agree, rest, *_) = said(ALL)

    assert wrong == []
    assert re.match(r"f_y cannot be checked: .*too little", rest)
    pairs = dict(
        reversed(x.split(" with ")) for x in agree.removeprefix("These agree: ").split("; ")
    )
    found = {
        others.rstrip("."): {*re.findall(r"[a-zA-Z]\w*", re.sub(r"\(.*?\)| and ", " ", names))}
        for others, names in pairs.items()
    }
    rows = [row.split(" | ") for row in AGREE.strip().splitlines()]
    assert found == {others: {*names.split()} - {"and"} for names, others in rows}
    assert {*ALL.split(), "phi"} - {"f_y"} == {x for names, _ in rows for x in names.split()}


def late(seconds, *names):
    """Columns at 10 Hz that come so much later."""
    k = np.arange(600.0)
    return lambda x: {name: np.interp(k - 10.0 * seconds, k, x[name]) for name in names}


def times(factor, *names):
    return lambda x: {name: factor * x[name] for name in names}


def plus(angle, *names):
    return lambda x: {name: x[name] + angle for name in names}


def swapped(a, b):
    return lambda x: {a: x[b], b: x[a]}


def turned(by):
    c, s = math.cos(by), math.sin(by)
    return lambda x: {
        "v_north": c * x["v_north"] - s * x["v_east"],
        "v_east": s * x["v_north"] + c * x["v_east"],
    }


SWING = np.sin(0.6 * np.arange(600.0) * np.linspace(0.1, 0.5, 600))
DOWN, PATH, AIR = "V_a h v_down", "V_a v_north v_east north east", "V_a v_north v_east v_down"
RATES, COMMANDS = "V_a theta psi p q r", f"{AIR} n_z phi_cmd n_z_cmd"
NO_CURE = "something else, and no factor, shift or exchange mends it"
ABOUT = pytest.approx(-1.0, rel=0.13)  # of means over a second
SIGN = r"a factor of -1 would do \(its sign is turned\)"
WRONG = [
    # columns, change, what is said (how it differs, and what would mend it), by how many times
    (DOWN, times(1 / si.foot, "h"), r"slope of h .*of 0\.3048 .*\(ft read as m\)", 1 / si.foot),
    (DOWN, times(1 / si.knot, "v_down"), r"h .*0\.5144 .*kn read as m/s\) to v_down", si.knot),
    (DOWN, times(-1.0, "h"), f"h is .*{SIGN}", -1.0),
    (DOWN, late(3.0, "h"), r"slope of h comes 3\.0 s after .*: a shift by -3\.0 s would", None),
    (DOWN, late(-3.0, "h"), r"slope of h comes 3\.0 s before .*: a shift by \+3\.0 s would", None),
    (DOWN, times(0.0, "h"), rf"does not change with .*0\.00\): h or v_down is {NO_CURE}", None),
    ("V_a v_down down h", times(100.0, "down"), r"slope of down is .*a factor of 0\.01", 100.0),
    ("V_a down h", times(100.0, "h"), r"slope of h is .*a factor of 0\.01 .*\(cm read", 100.0),
    ("V_a height_err v_down", times(-1.0, "height_err"), f"height_err is .*{SIGN}", -1.0),
    (f"{AIR} V_g", times(1 / si.kmh, "V_g"), r"V_g is .*0\.2778 .*\(km/h read as m/s\)", 3.6),
    (f"{AIR} V_g", times(1 / si.mph, "V_g"), r"V_g is .*0\.447 .*\(mph read", 1 / si.mph),
    ("v_north v_east chi", plus(-np.radians(20.0), "chi"), r"chi is -20\.0 deg .*\+20\.0 deg",
     None),
    (f"{AIR} psi", plus(np.radians(90.0), "psi"), r"psi is \+10\d\.\d .*a change by -10\d\.\d",
     None),
    (RATES, swapped("q", "r"), "q is unlike the changes of attitude .*q and r exchanged", None),
    (RATES, times(1 / si.degree, "r"), r"r is .*0\.01745 .*deg read as rad", 1 / si.degree),
    (RATES, late(3.0, *"pqr"), r"[pqr] comes 3\.\d s after .*-3\.\d s of p, q and r", None),
    (RATES, lambda _: {"p": 0.3 * SWING}, f"p is unlike .*: p is {NO_CURE}", None),
    (f"{AIR} theta q r", times(-1.0, "r"), f"r is .*{SIGN}", ABOUT),
    ("V_a V_g chi p q r", times(-1.0, "q"), f"q is .*{SIGN}", ABOUT),
    (f"{RATES} v_north v_east v_down north east h", lambda x: {"t_s": 1.1 * x["t_s"]},
     r"t: rates .* all 1\.1 times .*a factor of 0\.90[789]", None),
    (PATH, swapped("v_north", "v_east"), r"velocity is unlike .*v_east and v_north exch", None),
    (PATH, turned(0.4), r"chi is \+22\.9 deg off .*a turn of the velocity by -22\.9 deg", None),
    (PATH, times(1 / si.foot, "north", "east"), r"velocity is .*0\.3048 .*to north and east",
     si.foot),
    (PATH, times(-1.0, "v_east"), rf"\(correlation 0\.\d+\): {SIGN} to v_east", None),
    (AIR, times(1 / si.kmh, "V_a"), r"V_a in turns is .*0\.2778 .*km/h", 3.6),
    (f"{AIR} psi", times(1 / si.knot, "V_a"), r"V_a in turns .*0\.5144 .*kn", 1 / si.knot),
    (f"{AIR} psi", lambda x: {"V_a": x["V_g"]},
     rf"V_g less V_a does not change .*: V_a or psi is {NO_CURE}", None),
    (AIR, times(-1.0, "phi"), f"phi is .* in turns: {SIGN}", -1.0),
    (f"{AIR} theta", swapped("phi", "theta"), "phi and theta exchanged", None),
    (f"{AIR} theta", times(-1.0, "theta"), f"theta is .* gamma and lift: {SIGN}", ABOUT),
    ("v_north v_east v_down theta n_z", times(-1.0, "theta"), f"theta is .*{SIGN}", ABOUT),
    (COMMANDS, plus(-1.0, "n_z"), r"n_z is 0\.\d+ .*a change by \+1 would do \(gravity", None),
    ("V_a n_z", times(2.0, "n_z"), r"n_z, .* path and roll: a factor of 0\.50", 2.0),
    ("V_a n_z theta", times(-1.0, "n_z"), f"n_z, .* path and roll: {SIGN}", -1.0),
    (f"{AIR} theta psi n_z", times(G, "n_z"), r"n_z, .*of 0\.102 .*m/s2 read as g", G),
    (COMMANDS, times(-1.0, "n_z_cmd"), f"n_z_cmd.* is .*{SIGN}", -1.0),
    (COMMANDS, times(-1.0, "phi_cmd"), f"phi_cmd is .*{SIGN}", -1.0),
    (COMMANDS, swapped("phi", "phi_cmd"), "phi and phi_cmd exchanged", None),
    (COMMANDS, late(1.0, "phi_cmd"), r"phi_cmd comes 0\.[67] s after .*a shift by -0\.[67] s",
     None),
    ("V_a theta theta_cmd", times(5.0, "theta_cmd"), r"theta_cmd is .*a factor of 0\.2 w", 5.0),
    (f"{AIR} theta psi f_x f_y", times(1 / G, "f_x"), r"f_x is .*9\.807 .*g read as", 1 / G),
    (f"{AIR} psi wind_north wind_east", times(-1.0, "wind_north", "wind_east"),
     f"the wind is .*{SIGN} to wind_north and wind_east", -1.0),
]  # fmt: skip


@pytest.fixture(scope="module")
def of_right():
    """What agrees in a right log, by its columns."""
    return {}


def agreed(notes):
    """Columns that agree with others."""
    pairs = [x for line in notes for x in line.removeprefix("These agree: ").split("; ")]
    names = " ".join(pair.partition(" with ")[0] for pair in pairs if " with " in pair)
    return {*re.findall(r"\w+", names)} - {"and", "times", "it"}


@pytest.mark.parametrize(("there", "change", "words", "ratio"), WRONG)
def test_a_wrong_column_is_said_with_its_numbers_and_its_cure(
    said, of_right, there, change, words, ratio
):
    """All others agree as in the right log."""
    if there not in of_right:
        wrong, notes = said(there)
        assert wrong == []
        of_right[there] = agreed(notes)
    (wrong,), notes = said(there, change)

    assert re.search(words, wrong), (wrong, notes)
    named = re.findall(r"\w+", wrong.replace("velocity", "v_north v_east"))
    assert of_right[there] - {*named} <= agreed(notes)
    if ratio is not None:
        found = float(re.search(r" is (-?[\d.]+) times", wrong)[1])
        assert found == ratio or found == pytest.approx(ratio, rel=0.04)


NOTED = [
    (COMMANDS, lambda _: {"phi_cmd": SWING}, rf"phi_cmd is unlike .*: phi_cmd is {NO_CURE}"),
    ("V_a height_err v_down", times(1.0 / si.foot, "height_err"), r"3\.28 .*0\.3048"),
    (RATES, times(0.0, "q"), "q is 0 throughout"),
    (f"{AIR} V_g chi", lambda x: {"V_a": x["V_g"]},
     "V_a cannot be checked: it is the ground speed"),
    ("psi v_north v_east V_a", times(1.2, "V_a"), r"V_a \(1\.20 times it\) with the ground speed"),
    ("theta V_a V_err", times(1.0), "phi and V_a cannot be checked: the log has no v_north and v_"),
    ("theta V_a V_err", times(1.0), "theta cannot be checked: the log has no gamma"),
    ("V_a", times(1.0), "phi and V_a cannot be checked"),
    ("V_a lat lon", lambda x: {"lat": 0.8 + x["north"] / 6.4e6, "lon": 0.1 + x["east"] / 4.4e6},
     r"(?s)v_north is the slope of north.*v_east is the slope of east"),
    ("V_g chi", times(1.0), r"(?s)north is the integral of v_north"),
    ("V_a f_z v_north v_east v_down", times(-1.0, "f_z"), "after its sign was turned: z is up"),
    ("v_north v_east V_a", lambda x: {"v_north": 20.0 + 0.0 * x["phi"], "v_east": 0.0 * x["phi"]},
     "V_a cannot be checked: the log is of one heading"),
]  # fmt: skip


@pytest.mark.parametrize(("there", "change", "words"), NOTED)
def test_what_cannot_be_told_is_a_note_and_no_fault(said, there, change, words):
    for name in ("lat", "lon"):
        there = there.replace(f" {name}", "")
    wrong, notes = said(there, change)

    assert wrong == []
    assert re.search(words, "\n".join(notes)), notes


def test_several_errors_at_once_are_each_said(said):
    change = {
        "p": lambda x: -x["p"],
        "h": lambda x: x["h"] / si.foot,
        "V_a": lambda x: 3.6 * x["V_a"],
    }
    wrong, _ = said(f"{RATES} {AIR} h", lambda x: {k: f(x) for k, f in change.items()})

    assert len(wrong) == 3
    for words in (r"^p is -.*-1", r"^the slope of h .*0\.3048", r"^V_a in turns .*0\.2778"):
        assert any(re.search(words, line) for line in wrong), wrong


def test_what_is_said_of_a_trusted_column_passes_and_models_refuse_the_rest(said, tmp_path):
    change, columns = times(1.0 / si.foot, "h"), DOWN
    assert said(columns, change, columns="trusted=V_g")[0] != []
    with pytest.raises(ft.InputError, match=r"columns of the log must agree: .*trusted="):
        ft.identify(tmp_path / "f.csv")
    wrong, notes = said(columns, change, columns="trusted=h v_down")
    assert wrong == []
    assert any("0.3048" in line and "trusted= passes" in line for line in notes)


def test_a_part_of_a_log_has_the_verdict_of_the_whole(said):
    """A part may hardly vary, or be too short to tell anything."""
    change = times(-1.0, "p")
    whole, _ = said(RATES, change)
    assert len(whole) == 1
    assert said(RATES, change, start=30.0, end=38.0)[0] == whole


@pytest.mark.parametrize(
    ("name", "values", "says"),
    [
        ("theta", [0.0, 1.6] * 99, "theta goes up to 1.6 rad"),
        ("theta", [0.0, 1.57] * 99, ""),
        ("phi", [*[1.0] * 500, 12.0], ""),  # one in 500 is noise
        ("chi", np.linspace(0.0, 59.0, 99), ""),  # nine turns
        ("chi", np.linspace(300.0, 359.0, 99), "chi goes up to 358 rad"),
        ("chi", [*[1.0] * 99, *[230.0] * 99], "chi goes up to 230 rad"),
        ("psi", [6.3] * 99, ""),
    ],
)
def test_angles_beyond_their_range_look_like_degrees(tmp_path, name, values, says):
    table = {"t": 0.1 * np.arange(len(values)), "phi": 0.0, "V_g": 20.0} | {name: values}
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)

    wrong = ft.load_log(tmp_path / "f.csv").provenance.log["wrong"]

    assert [line.partition(":")[0] for line in wrong if "goes up" in line] == [says] * bool(says)


def test_signals_that_a_log_lacks_follow_from_those_that_it_has(tmp_path):
    """Wind from a side, load factor from a force, course error, and a place without its start."""
    t = 0.1 * np.arange(150)
    table = {"t": t, "phi": 0.0, "h": 300.0 + t, "chi_ref": -3.0, "f_z": -12.0, "V_a": 20.0}
    table |= {"wind_speed": 4.0, "wind_from": 0.5, "v_north": -20.0, "v_east": 20.0}
    table["north"] = np.where(t < 0.15, np.nan, 100.0 - 20.0 * t)
    table["east"] = 7.0 + 20.0 * t
    pd.DataFrame(table).to_csv(tmp_path / "f.csv", index=False)

    signals = ft.load_log(tmp_path / "f.csv").signals.iloc[10:-10]

    first = {name: signals[name].iloc[0] for name in signals}
    found = [first[x] for x in ("wind_north", "wind_east", "wind_down", "n_z", "V_g", "chi_err")]
    assert found == pytest.approx(
        [-4 * math.cos(0.5), -4 * math.sin(0.5), 0.0, 12 / G, 800**0.5, 1.25 * math.pi - 3.0]
    )
    assert first["gamma"] == pytest.approx(math.atan(1.0 / 800**0.5))
    assert signals["north"].to_numpy() == pytest.approx(-20.0 * (signals.index - 0.2))
    assert signals["east"].to_numpy() == pytest.approx(20.0 * signals.index)


@pytest.mark.soak
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_columns_are_judged_whatever_they_hold(tmp_path_factory, seed):
    """Subsets of columns at random sizes, with gaps, zeros, drifts and nothing at all."""
    random, names = np.random.default_rng(seed), ALL.split()
    t = random.choice([0.02, 0.1, 0.2]) * np.arange(random.integers(200, 500))
    columns = {"t": t, "phi": random.standard_normal(len(t)), "phi_cmd": 0.0 * t}
    for name in (name for name in names if random.random() < 0.4):
        column = 10.0 ** random.integers(-3, 8) * random.standard_normal(len(t))
        gaps = np.where(random.random(len(t)) < 0.3, np.nan, column)
        kinds = [column, gaps, 0.0 * column, np.nan * column, np.cumsum(column)]
        columns[name] = kinds[random.integers(len(kinds))]
    path = tmp_path_factory.mktemp("any") / "f.csv"
    pd.DataFrame(columns).to_csv(path, index=False)
    with suppress(ft.RecordingError):  # a flight at no speed
        assert {"phi", "phi_cmd"} <= {*ft.load_log(path).signals}
