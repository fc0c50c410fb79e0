"""Tubes of the paper's manoeuvre: how wide, how long, and whether any flight leaves one.

Run it with ``python benchmarks/bench_tube.py``; ``--json`` prints one object, ``--flights N`` says
how many flights are flown against each tube. The flights have random and bang-bang disturbances and
starts in the set, half of them at its edge; others push an error at one time by the sign of its
sensitivity to the disturbance of each sample. The loop of the kinematic law is written here a
second time. For the Aerosonde in calm air boxes are counted first; its tubes are held against a
fiftieth of the flights, of its model in these boxes. Exits with 1 where a target is missed or a
flight leaves a tube.
"""

import json
import tempfile
import time
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import running

import flighttune as ft
from flighttune.base.units import DEG
from flighttune.claims.tubes.enclosure import load_tube
from flighttune.claims.tubes.sample import LIFT
from flighttune.claims.tubes.tube import stated_problem, tube_of
from flighttune.flight.conditions import reference_of, start_condition
from flighttune.flight.loop.loop import simulate
from flighttune.flight.models import gain_set
from flighttune.vehicles.plants.point_mass import PointMassPlant

ROWS = {
    "K*, start within 5 deg": ("paper", 5.0, 0.0, (5.3, 6.1), 0.03, 80.0, 1.1),
    "tuned_identified, start within 5 deg": ("tuned_identified", 5.0, 0.0, None, None, None, None),
    "K*, |d| <= 0.0075 rad/s": ("paper", 0.0, 0.0075, (2.1, 1.6), 1.2, 50.0, 1.5),
    "tuned_identified, |d| <= 0.0075 rad/s": ("tuned_identified", 0.0, 0.0075) + (None,) * 4,
    "K*, |d| <= 0.01 rad/s": ("paper", 0.0, 0.01) + (None,) * 4,
    "K*, |d| <= 0.02 rad/s": ("paper", 0.0, 0.02, (np.inf, np.inf), np.inf, 60.0, None),
}
"""Gains, start (deg), disturbance (rad/s), then the targets: largest half-widths (deg), that at the
end (deg), processor time (s), ratio to the widest flights found."""

AIRCRAFT = {
    "feasible": (("feasible", 1.0), (0.6, 0.4), 0.3, 30.0, 2.0),
    "paper_identified": (("random_starts", 0.0), (4.0, 1.5), 0.6, 110.0, 2.5),
}
"""Of the Aerosonde in calm air, by scenario: source and starts, deg, then the same targets."""

# In the quick mode the flights, the rows and the counts are few.
SHORTER = {"flight.duration_s": 4.0} if running.QUICK else None
TINY = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7, "changes": SHORTER}
COUNT: dict[str, Any] = TINY if running.QUICK else {}
if running.QUICK:
    ROWS = {name: ROWS[name] for name in [*ROWS][2:3]}
    AIRCRAFT = {"feasible": AIRCRAFT["feasible"]}

VERIFY_S, FILE_MB = 60.0, 50.0
AT_ONCE = 4_000
ITERATIONS = 3
"""Times that sensitivities are taken: about the undisturbed flight, then about the worst ones."""

NUDGE = 1e-3
"""Part of its bound by which a disturbance is moved for a sensitivity."""

HOLDS = (1, 5, 25, 100, 1000)
"""Samples for which a random or bang-bang disturbance is held."""


def tube(scenario, gains, **flights):
    """The tube of a scenario's flights."""
    return tube_of(stated_problem(scenario, gains, **flights))


def drawn(found, count, rng):
    """Random and bang-bang disturbances, shape (k, 2, count), and starts, shape (2, count)."""
    problem = found.problem
    d_max = problem.disturbances[1][0][:, np.newaxis]
    edge = np.where(rng.random((2, count)) < 0.5, 1.0, rng.random((2, count)))
    starts = problem.start * edge * rng.choice([-1.0, 1.0], (2, count))
    hold = rng.choice(HOLDS, count)
    shift, bang = rng.integers(0, hold), rng.random(count) < 0.7
    d = np.empty((len(found.bounds.t), 2, count))
    for k in range(len(d)):
        fresh = rng.uniform(-1.0, 1.0, (2, count))
        fresh = np.where(bang, np.sign(fresh), fresh) * d_max
        d[k] = np.where((k + shift) % hold == 0, fresh, d[k - 1]) if k else fresh
    return d, starts


def flown(found, d, starts):
    """Errors of flights by the kinematic law, shape (k, 2, count): one way to write it."""
    loop, count = found.problem.loop, d.shape[2]
    K_P = np.array([law.K_P for law in loop.law.channels])
    K_I_half = np.array([law.K_I_half for law in loop.law.channels])
    low, high, step = (
        np.array([getattr(law, name) for law in loop.law.channels])[:, np.newaxis]
        for name in ("lower", "upper", "step_up")
    )
    x = np.array(loop.start[:2])[:, np.newaxis] + starts
    u = np.stack([np.full(count, loop.start[2]), np.cos(x[1]) / np.cos(loop.start[2])])
    integral, before = np.zeros((2, count)), None
    errors = np.empty((len(found.bounds.t), 2, count))
    for k in range(len(found.bounds.t)):
        error = loop.reference[k, :2, np.newaxis] - x
        errors[k] = error
        increment = 0.0 if before is None else K_I_half @ (error + before)
        before = error
        ahead = np.stack([np.zeros(count), loop.reference[k, LIFT] / np.cos(u[0])])
        held = ahead + K_P @ error + integral
        down, up = np.maximum(low, u - step), np.minimum(high, u + step)
        wanted = held + increment
        spare = np.where(increment > 0.0, np.maximum(up - held, 0.0), np.minimum(down - held, 0.0))
        outwards = ((wanted > up) & (increment > 0.0)) | ((wanted < down) & (increment < 0.0))
        integral = integral + np.where(outwards, spare, increment)
        u = np.clip(wanted, down, up)
        x = x + loop.dt * np.array([loop.g_over_v * np.tan(u[0]) + d[k, 0], np.zeros(count)])
        lift = u[1] * np.cos(u[0])
        half = x[1] + 0.5 * loop.dt * (loop.g_over_v * (lift - np.cos(x[1])) + d[k, 1])
        x[1] += loop.dt * (loop.g_over_v * (lift - np.cos(half)) + d[k, 1])
    return errors


class Reached:
    """The range of the errors of flights over time, and how far any is outside of the tube."""

    def __init__(self, found):
        self._low, self._high = (
            ends[:, :2, np.newaxis] for ends in (found.bounds.low, found.bounds.high)
        )
        self._least = np.full(self._low.shape, np.inf)
        self._most = -self._least
        self.outside = 0.0

    def add(self, errors):
        beyond = np.maximum(self._low - errors, errors - self._high).max()
        self.outside = max(self.outside, float(beyond))
        self._least = np.minimum(self._least, errors.min(axis=2, keepdims=True))
        self._most = np.maximum(self._most, errors.max(axis=2, keepdims=True))

    @property
    def widest(self):
        """Half of the largest range of both errors, deg."""
        return 0.5 * (self._most - self._least).max(axis=(0, 2)) / DEG


def random_flights(found, flights):
    """What random and bang-bang flights reach."""
    reached, rng = Reached(found), np.random.default_rng(1)
    for first in range(0, flights, AT_ONCE):
        reached.add(flown(found, *drawn(found, min(AT_ONCE, flights - first), rng)))
    return reached


def sensitive_flights(found):
    """What flights reach whose disturbance pushes an error at one time, by sign of its sensitivity.

    For every target time, error and sign the disturbance of each sample is at the end of its range
    that the derivative of that error points to. The first derivatives are those of a flight without
    disturbance. Limits bend the loop, so those that follow are about the flight that reached the
    largest error of each kind so far.
    """
    samples = len(found.bounds.t)
    d_max = found.problem.disturbances[1][0][:, np.newaxis]
    reached, undisturbed = Reached(found), np.zeros((samples, 2))
    nominal = flown(found, undisturbed[:, :, np.newaxis], np.zeros((2, 1)))
    about = [undisturbed] * 4
    for attempt in range(ITERATIONS):
        sensitivity = None
        for kind, (error, sign) in enumerate(product((0, 1), (1.0, -1.0))):
            if sensitivity is None or attempt:  # of the undisturbed flight they are the same
                sensitivity = sensitivities(found, about[kind])
            d = d_max * np.sign(sign * sensitivity[:, :, :, error])
            errors = flown(found, d, np.zeros((2, samples)))
            reached.add(errors)
            pushed = sign * (errors[:, error] - nominal[:, error])
            about[kind] = d[:, :, np.unravel_index(pushed.argmax(), pushed.shape)[1]]
    return reached


def sensitivities(found, d):
    """Of both errors at every time to each disturbance, shape (k, 2, target, error)."""
    samples = len(found.bounds.t)
    step = NUDGE * found.problem.disturbances[1].max()
    nudged = np.repeat(d[:, :, np.newaxis], 2 * samples + 1, axis=2)
    for channel in range(2):
        which = np.arange(samples)
        nudged[which, channel, 2 * which + channel] += step
    errors = flown(found, nudged, np.zeros((2, 2 * samples + 1)))
    change = errors[:, :, :-1] - errors[:, :, -1:]
    return change.reshape(samples, 2, samples, 2).transpose(2, 3, 0, 1)


def row(name, folder, flights):
    """One tube: measured, proven again, and flown against."""
    gains, start, disturbance, width, end, seconds, ratio = ROWS[name]
    scenario = ft.load_scenario("paper_identified", changes=SHORTER)
    wall, cpu = time.perf_counter(), time.process_time()
    found = tube(
        scenario, gain_set(scenario, gains), start=start * DEG, disturbance=disturbance or None
    )
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    widths = found.bounds.half_widths[:, :2] / DEG
    measured = {
        "row": name,
        "status": found.status,
        "reason": found.reason,
        "seconds": wall,
        "cpu_s": cpu,
        "largest_deg": widths.max(axis=0).tolist(),
        "end_deg": widths[-1].tolist(),
    }
    met, ratios = width is None or found.status == "bounded", np.zeros(2)
    if found.status == "bounded":
        path = Path(folder) / "tube.npz"
        found.save(path)
        began = time.process_time()
        valid = load_tube(path).verify().valid
        verify_s, size = time.process_time() - began, path.stat().st_size / 1e6
        measured |= {"verify_cpu_s": verify_s, "file_MB": size}
        reached = {"random": random_flights(found, flights)}
        if disturbance:
            reached["sensitive"] = sensitive_flights(found)
        outside = max(one.outside for one in reached.values())
        measured["outside_rad"] = outside
        for kind, one in reached.items():
            ratios = widths.max(axis=0) / np.maximum(one.widest, 1e-9)
            measured |= {
                f"widest_{kind}_deg": one.widest.tolist(),
                f"ratio_{kind}": ratios.tolist(),
            }
        # The second way to write the law integrates by the midpoint rule: 1e-6 rad in 20 s.
        met &= valid and outside <= 1e-6 and verify_s <= VERIFY_S and size <= FILE_MB
        if width is not None:
            met &= bool((widths.max(axis=0) <= width).all() and widths[-1].max() <= end)
            met &= cpu <= seconds
        if ratio is not None:
            met &= bool(ratios.max() <= ratio)  # of the stronger flights
    return measured | {"target_met": bool(met)}


class SeenOtherwise(PointMassPlant):
    """The point mass behind lags, whose controller sees `beyond` more roll at each sample, rad."""

    def __init__(self, lags, disturbance, beyond, g):
        super().__init__(lags, disturbance=disturbance, g=g)
        self._beyond = iter(beyond)

    def observe(self):
        chi, gamma, phi, *rest = super().observe()
        return (chi, gamma, phi + next(self._beyond), *rest)


def beyond_in(boxes, signs):
    """Roll beyond the model's, at the ends of its boxes (k, 4) as far as its change allows."""
    low, high = boxes[:, 0].copy(), boxes[:, 1].copy()
    for k in range(
        len(boxes) - 2, -1, -1
    ):  # from where the boxes of the next sample can be reached
        low[k] = max(low[k], low[k + 1] - boxes[k, 3])
        high[k] = min(high[k], high[k + 1] - boxes[k, 2])
    beyond = [low[0] if signs[0] < 0 else high[0]]
    for k, sign in enumerate(signs[1:], 1):
        least, most = beyond[-1] + boxes[k - 1, 2], beyond[-1] + boxes[k - 1, 3]
        beyond.append(max(low[k], least) if sign < 0 else min(high[k], most))
    return beyond


def flown_by_model(problem, count, rng):
    """Errors of `count` flights of the point mass behind the lags, shape (k, 2, count)."""
    low, high = problem.disturbances
    middle, radius = 0.5 * (low + high), 0.5 * (high - low)
    scenario, dt, k = problem.scenario, problem.controller().dt, len(problem.t)
    flights = []
    for i in range(count):
        hold = HOLDS[i % len(HOLDS)]
        signs = np.repeat(rng.choice([-1.0, 1.0], (k // hold + 2, 2)), hold, axis=0)
        d = middle + radius * signs[rng.integers(0, hold) :][:k]
        boxes = problem.loop.boxes
        roll = boxes[:, 2:].reshape(k, 4) if problem.loop.sees_roll else np.zeros((k, 4))
        plant = SeenOtherwise(
            problem.lags,
            lambda t, d=d: tuple(d[min(int(t / dt + 1e-6), k - 1)].tolist()),
            [*beyond_in(roll, signs[:k, 0]), 0.0],
            scenario.flight.g_mps2,
        )
        signals, _ = simulate(
            plant,
            problem.controller(),
            reference_of(scenario),
            condition=start_condition(scenario),
            duration=scenario.flight.duration_s,
        )
        flights.append(signals[["chi_err", "gamma_err"]].to_numpy())
    return np.stack(flights, axis=2)


def count(name, folder):
    """The file of a count for a scenario of the Aerosonde in calm air."""
    path = Path(folder) / f"{name}.npz"
    source, start_deg = AIRCRAFT[name][0]
    ft.residual(source, start_deg=start_deg, **COUNT).save(path)
    return path


def tube_of_aircraft(name, path, folder):
    """The tube of the Aerosonde in the boxes of a file, and what was measured."""
    scenario, known = ft.load_scenario(name, changes=SHORTER), ft.load(path)
    assert isinstance(known, ft.Residual)
    began = time.process_time()
    found = tube(scenario, gain_set(scenario, "tuned_identified"), band=known)
    cpu = time.process_time() - began
    measured: dict[str, Any] = {
        "status": found.status, "reason": found.reason, "cpu_s": cpu,
    }  # fmt: skip
    if found.status != "bounded":
        return found, measured
    widths = found.bounds.half_widths[:, :2] / DEG
    file = Path(folder) / "aircraft.npz"
    found.save(file)
    began = time.process_time()
    valid = load_tube(file).verify().valid
    return found, measured | {
        "largest_deg": widths.max(axis=0).tolist(),
        "end_deg": widths[-1].tolist(),
        "handed_over_s": found.handed_over,
        "inside": found.flown is not None and not found.flown.leave,
        "valid": valid,
        "verify_cpu_s": time.process_time() - began,
        "file_MB": file.stat().st_size / 1e6,
    }


def calm_row(name, folder, flights):
    """The tube in calm air, and how wide the flights of the model are in its boxes."""
    _, width, end, seconds, ratio = AIRCRAFT[name]
    found, measured = tube_of_aircraft(name, count(name, folder), folder)
    measured: dict[str, Any] = {"row": f"Aerosonde, calm, {name}", **measured}
    if found.status != "bounded":
        return measured | {"target_met": False}
    widths = found.bounds.half_widths[:, :2] / DEG
    errors = flown_by_model(found.problem, flights, np.random.default_rng(1))
    low, high = (ends[:, :2, np.newaxis] for ends in (found.bounds.low, found.bounds.high))
    outside = float(np.maximum(low - errors, errors - high).max())
    widest = 0.5 * np.ptp(errors, axis=2).max(axis=0) / DEG
    ratios = widths.max(axis=0) / widest
    met = measured["inside"] and measured["valid"] and outside <= 0.0
    met &= measured["verify_cpu_s"] <= VERIFY_S and measured["file_MB"] <= FILE_MB
    met &= bool((widths.max(axis=0) <= width).all() and widths[-1].max() <= end)
    return measured | {
        "widest_flown_deg": widest.tolist(),
        "ratio": ratios.tolist(),
        "outside_rad": outside,
        "target_met": met and measured["cpu_s"] <= seconds and bool(ratios.max() <= ratio),
    }


def main() -> int:
    parser = running.options(__doc__)
    parser.add_argument(
        "--flights", type=int, default=100 if running.QUICK else 20_000, help="against each tube"
    )
    parser.add_argument("--row", help="only the rows with this in their name")
    options = parser.parse_args()

    with tempfile.TemporaryDirectory() as folder:
        made = {name: partial(row, name, folder, options.flights) for name in ROWS}
        for name in AIRCRAFT:
            made[f"Aerosonde, calm, {name}"] = partial(
                calm_row, name, folder, options.flights // 50
            )
        rows = [make() for name, make in made.items() if (options.row or "") in name]
    if options.json:
        print(json.dumps({"rows": rows}, indent=2))
    else:
        for one in rows:
            print(", ".join(f"{key} {value}" for key, value in one.items()))
    return 0 if all(one["target_met"] for one in rows) else 1


if __name__ == "__main__":
    running.end(main)
