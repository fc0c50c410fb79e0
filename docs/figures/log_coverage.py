"""Count how often the intervals of logs hold the truth.

python docs/figures/log_coverage.py LOGS identify|gap [RATE FIRST END]

LOGS flights are drawn; RATE (Hz, 0 for all), FIRST and END count a part, with the same numbers.
"""

import math
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.signal import lfilter

import flighttune as ft
from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG_PER_RAD, G_0
from flighttune.control.inner_loop import InnerLag
from flighttune.logs.identify import LogIdentification
from flighttune.vehicles.identification.file import IdentifiedChannel

RATES = 50.0, 25.0, 10.0
"""Samples of the logs, 1/s."""

SEED = 58

STEP, CONTROL = 0.005, 0.02
"""Of the integration, and the time for which the autopilot holds its commands, s."""

SECONDS = 120.0

SENSORS = {"phi": 0.004, "n_z": 0.015, "chi": 0.004, "gamma": 0.004, "V_a": 0.3}
"""Standard deviation of each sensor's coloured noise, rad, 1 and m/s; half as much is white."""

GUSTS = ((0.02, 1.0), (0.03, 0.5), (0.7, 3.0), (0.7, 3.0))
"""Standard deviations (rad, 1, m/s, m/s) of the turbulence in roll, load factor and wind to the
north and to the east, and its correlation times, s."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Truths:
    """What flights were made with, shape (logs, 2): lags of roll and load factor, and the wind."""

    frequency: FloatArray  # rad/s
    damping: FloatArray  # 1; of a lag of second order
    second: npt.NDArray[np.bool_]  # of second order
    delay: FloatArray  # s
    wind: FloatArray  # m/s, to the north and to the east
    V_a: float = 22.0

    def lag(self, log: int, channel: int) -> InnerLag:
        """A lag as flighttune has it."""
        here = log, channel
        return InnerLag(
            order=2 if self.second[here] else 1,
            natural_frequency=float(self.frequency[here]),
            damping=float(self.damping[here]) if self.second[here] else 1.0,
            delay=float(self.delay[here]),
        )


def drawn(random: np.random.Generator, count: int) -> Truths:
    """Truths from the ranges of small aircraft."""
    shape = count, 2
    return Truths(
        frequency=random.uniform((2.5, 3.0), (7.0, 8.0), shape),
        damping=random.uniform(0.6, 1.0, shape),
        second=random.random(shape) < 0.5,
        delay=np.asarray(STEP * random.integers(0, 30, shape), dtype=float),
        wind=random.uniform(-6.0, 6.0, shape),
    )


def coloured(random: np.random.Generator, shape: tuple[int, int], time: float) -> FloatArray:
    """Gauss-Markov noise of unit variance with a correlation time (s), samples by logs."""
    a = math.exp(-STEP / time)
    white = math.sqrt(1.0 - a * a) * random.standard_normal(shape)
    white[0] /= math.sqrt(1.0 - a * a)
    return np.asarray(lfilter([1.0], [1.0, -a], white, axis=0))


def set_points(
    random: np.random.Generator, shape: tuple[int, int], size: float, every: float
) -> FloatArray:
    """Values that change at random times, of the autopilot's samples, samples by logs."""
    hold = round(CONTROL / STEP)
    changes = random.random((shape[0] // hold + 1, shape[1])) < CONTROL / every
    numbers = np.cumsum(changes, axis=0, dtype=int)
    values = random.uniform(-size, size, (numbers.max() + 1, shape[1]))
    return np.repeat(np.take_along_axis(values, numbers, axis=0), hold, axis=0)[: shape[0]]


def fly(truths: Truths, random: np.random.Generator) -> dict[str, FloatArray]:
    """Signals of random turns and climbs every `STEP`, samples by logs.

    They are integrated here by the midpoint rule, and not by flighttune. Turbulence pushes roll and
    load factor through their lags and moves the air; the autopilot sees it.
    """
    shape = round(SECONDS / STEP), len(truths.delay)
    samples, logs = shape
    gusts = [size * coloured(random, shape, time) for size, time in GUSTS]
    targets = set_points(random, shape, 0.9, 5.0), set_points(random, shape, 0.12, 4.0)
    late = np.round(truths.delay / STEP).astype(int)
    rest = np.array([0.0, 1.0])
    commands = np.broadcast_to(rest, (samples, logs, 2)).copy()
    state, rate = np.tile(rest, (logs, 1)), np.zeros((logs, 2))
    chi, gamma, row = np.zeros(logs), np.zeros(logs), np.arange(logs)[:, None]
    f, z = truths.frequency, truths.damping
    rows, first = np.empty((samples, 5, logs)), 1.0 - np.exp(-f * STEP)
    for k in range(samples):
        level = truths.V_a * np.cos(gamma)
        north = level * np.cos(chi) + truths.wind[:, 0] + gusts[2][k]
        east = level * np.sin(chi) + truths.wind[:, 1] + gusts[3][k]
        V_g, phi, n_z = np.hypot(north, east), *state.T
        course, path = np.arctan2(east, north), np.arctan2(truths.V_a * np.sin(gamma), V_g)
        rows[k] = course, path, V_g, phi, n_z
        if k % round(CONTROL / STEP) == 0:
            error = np.remainder(targets[0][k] - course + math.pi, math.tau) - math.pi
            lift = (np.cos(gamma) + 2.5 * (targets[1][k] - path)) / np.cos(phi)
            now = np.clip(1.8 * error, -0.7, 0.7), np.clip(lift, 0.4, 1.8)
            commands[k : k + round(CONTROL / STEP)] = np.stack(now, axis=1)
        old = commands[np.maximum(k - late, 0), row, [0, 1]]
        target = np.where(k >= late, old, rest) + np.stack([gusts[0][k], gusts[1][k]], axis=1)
        before = rate
        push = f * f * (target - state - 0.5 * STEP * before) - 2.0 * z * f * before
        rate = before + STEP * push / (1.0 + z * f * STEP)
        step = np.where(truths.second, 0.5 * STEP * (before + rate), first * (target - state))
        phi, n_z = (state + 0.5 * step).T
        state = state + step
        middle = gamma + 0.5 * STEP * G_0 / truths.V_a * (n_z * np.cos(phi) - np.cos(gamma))
        chi = chi + STEP * G_0 / truths.V_a * n_z * np.sin(phi) / np.cos(middle)
        gamma = gamma + STEP * G_0 / truths.V_a * (n_z * np.cos(phi) - np.cos(middle))
    names = "chi", "gamma", "V_g", "phi", "n_z"
    signals = dict(zip(names, rows.transpose(1, 0, 2), strict=True))
    signals |= {"phi_cmd": commands[..., 0], "n_z_cmd": commands[..., 1]}
    return signals | {"V_a": np.full(shape, truths.V_a)}


def write(
    path: Path, signals: Mapping[str, FloatArray], rate: float, random: np.random.Generator
) -> Path:
    """A log of one flight, with the noise of sensors, from a random phase of the autopilot on."""
    every = round(1.0 / (rate * STEP))
    phase = int(random.integers(every))
    seen = {}
    for name, values in signals.items():
        size = SENSORS.get(name, 0.0)
        noise = coloured(random, (len(values), 1), 0.2)[:, 0]
        noise += 0.5 * random.standard_normal(len(values))
        # Samples are in the middle of a step, so that no phase is favoured.
        if not name.endswith("_cmd"):
            values = 0.5 * (values + np.append(values[1:], values[-1]))
        seen[name] = (values + size * noise)[phase::every]
    V_g, chi, gamma = seen["V_g"], seen["chi"], seen["gamma"]
    table = {
        "t_s": STEP * every * np.arange(len(V_g)),
        "phi_deg": DEG_PER_RAD * seen["phi"],
        "phi_cmd_deg": DEG_PER_RAD * seen["phi_cmd"],
        "n_z": seen["n_z"],
        "n_z_cmd": seen["n_z_cmd"],
        "V_a": seen["V_a"],
        "v_north": V_g * np.cos(chi),
        "v_east": V_g * np.sin(chi),
        "v_down": -V_g * np.tan(gamma),
    }
    pd.DataFrame(table).to_csv(path, index=False)
    return path


def save_model(path: Path, truths: Truths, log: int) -> Path:
    """A model of the lags of one flight without their delays."""
    channels = {}
    for channel, name in enumerate(("phi", "n_z")):
        lag = replace(truths.lag(log, channel), delay=0.0)
        channels[name] = IdentifiedChannel.of(lag, fit_percent=100.0, residual=0.0)
    any_model = ft.loop.load_identified("aerosonde")
    update = {"V_a": truths.V_a, "gamma": 0.0, "channels": channels}
    condition = any_model.conditions[0].model_copy(update=update)
    any_model.model_copy(update={"conditions": (condition,)}).save(path)
    return path


def told_by_identify(log: Path, truths: Truths, number: int) -> Iterator[tuple[str, bool | None]]:
    """Whether each interval holds the truth; None without one."""
    identified = ft.identify(log)
    assert isinstance(identified, LogIdentification)
    for channel, found in identified.channels.items():
        lag = truths.lag(number, ("phi", "n_z").index(channel))
        true = {"frequency": lag.natural_frequency, "delay": lag.delay}
        for name, value in true.items():
            ends = getattr(found, name)
            inside = ends and found.lag.order == lag.order and ends[0] <= value <= ends[1]
            yield f"identify {channel} {name}", inside


def told_by_gap(log: Path, truths: Truths, number: int) -> Iterator[tuple[str, bool | None]]:
    """Whether each interval holds the truth."""
    factors = ft.gap(log, aircraft=save_model(log.with_suffix(".json"), truths, number)).factors
    (phi, n_z), (north, east) = truths.delay[number], truths.wind[number]
    true = {"phi_late": phi, "n_z_late": n_z, "wind_north": north, "wind_east": east}
    for name, (_, low, high) in factors.items():
        yield f"gap {name}", bool(low <= true[name] <= high)


def told(
    logs: int,
    rates: Sequence[float],
    counted: Sequence[int],
    seed: int = SEED,
    commands=(told_by_identify, told_by_gap),
) -> dict[tuple[str, float], list[bool | None]]:
    """Whether each interval holds the truth, by name and rate; None without an interval."""
    random = np.random.default_rng(seed)
    truths = drawn(random, logs)
    signals = fly(truths, random)
    answers: dict[tuple[str, float], list[bool | None]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for log, rate in product(counted, rates):
            noise = np.random.default_rng([seed, log, int(rate)])
            flown = {name: values[:, log] for name, values in signals.items()}
            path = write(Path(folder) / "log.csv", flown, rate, noise)
            for command in commands:
                for name, inside in command(path, truths, log):
                    answers.setdefault((name, rate), []).append(inside)
    return answers


if __name__ == "__main__":
    command = {"identify": told_by_identify, "gap": told_by_gap}[sys.argv[2]]
    logs, part = int(sys.argv[1]), [int(x) for x in sys.argv[3:]] or [0, 0, int(sys.argv[1])]
    answers = told(logs, part[:1] if part[0] else RATES, range(*part[1:]), commands=(command,))
    print("| interval | samples, Hz | hold the truth | of | without an interval |")
    print("| --- | --- | --- | --- | --- |")
    for (name, rate), inside in sorted(answers.items()):
        given = [there for there in inside if there is not None]
        share = f"{100.0 * np.mean(given):.1f} %" if given else ""
        print(f"| {name} | {rate:g} | {share} | {len(given)} | {len(inside) - len(given)} |")
