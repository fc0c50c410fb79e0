"""Faults in flight: how soon a monitor, a band of errors and fixed thresholds find them.

``python docs/figures/monitor.py [FLIGHTS] [HEALTHY]``: each fault on FLIGHTS fresh flights of
``mission_in_wind`` (60 by default), and false alarms on HEALTHY ones (the same number by default).
All three are counted alike, at 5 % and a confidence of 0.95. Beside them stands the likelihood
ratio of a monitor that knows the fault and when it begins.
"""

import sys

import numpy as np
from scipy.stats import multivariate_normal

import flighttune as ft
from flighttune.claims.monitor import Monitor
from flighttune.flight.fly import fly_alone
from flighttune.gaps.watch import columns_of, dt_of, residuals

CAMPAIGN, FROM_S = "mission_in_wind", 20.0
LEARN, COUNTED, FIRST = 100, 208, 400  # fresh draws begin behind those that were counted
FAULTS = {
    "engine to 6 %": {"throttle_factor": 0.06},
    "actuators 4 times slower": {"actuator_lag_factor": 4.0},
    "centre of gravity 2.5 cm aft": {"cg_aft_m": 0.025},
    "aileron stuck at 5 deg": {"aileron_stuck_deg": 5.0},
    "lift x 0.8, drag x 1.5": {"lift_factor": 0.8, "drag_factor": 1.5},
    "airspeed sensor 3 m/s low": {"V_a_bias_mps": -3.0},
}
ERRORS = ["chi_err", "gamma_err"]
OPEN, SOON_S = 0.05, 8.0

# Flights whose residuals with a fault are learned, samples of residuals in a second, times after
# the fault at which flights are judged (s), and what keeps a covariance of few flights regular.
TAUGHT, PER_S = 1000, 10
TIMES = 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0
SHRUNK, FLOOR = 0.2, 1e-4


class Draws:
    """Flights of the campaign, with a fault or without."""

    def __init__(self, last):
        plan = ft.plan_campaign(ft.load_campaign(CAMPAIGN))
        self.plan = plan.of_group(plan.chosen_group(None, None)).with_runs(last)
        (self.group,) = self.plan.groups

    def fly(self, draw, fault=None):
        tables = self.plan.scenario_of(draw).as_dict() | {"expect": []}
        if fault:
            air = tables["plant"][0].setdefault("airframe", {})
            air["fault"] = {"from_s": FROM_S} | fault
        scenario = ft.scenario_from(tables)
        return fly_alone(self.plan.entry(self.group, scenario))


def first(above, t):
    """Time of the first sample that is above; infinite without one."""
    places = np.flatnonzero(above)
    return float(t[places[0]]) if len(places) else np.inf


def sizes(run):
    """Errors and the difference of the airspeed from 25 m/s, as fixed thresholds take them."""
    signals = run.signals
    return np.column_stack([signals[ERRORS].abs(), (signals["V_a"] - 25.0).abs()])


def histories(flights, t):
    """Means of residuals over 10 s before the fault and over ever longer parts of t s after it."""
    ends, length = [round(PER_S * FROM_S)], PER_S / 2
    last = ends[0] + round(PER_S * t)
    while ends[-1] < last:
        ends.append(min(last, ends[-1] + int(length)))
        length *= 1.5
    starts = [ends[0] - 10 * PER_S, *ends[:-1]]
    ended = [np.pad(x, ((0, max(0, last - len(x))), (0, 0)), mode="edge") for x in flights]
    parts = zip(starts, ends, strict=True)
    return np.concatenate([[x[a:b].mean(axis=0) for x in ended] for a, b in parts], axis=1)


def known_fault(healthy, counted, faulty, fresh):
    """Share of fresh flights that the likelihood ratio has found at each of `TIMES`.

    Normal distributions of `histories` are learned from flights `healthy` and `faulty`, and the
    limit of their log-likelihood ratio is that of five flights of those `counted`.
    """
    shares = []
    for t in TIMES:
        without, limits, with_fault, tried = (
            histories(x, t) for x in (healthy, counted, faulty, fresh)
        )
        floor = FLOOR * np.diag(without.var(axis=0))
        normal = []
        for x in (without, with_fault):
            C = np.cov(x.T)
            C = (1.0 - SHRUNK) * C + SHRUNK * np.diag(np.diag(C)) + floor
            normal.append(multivariate_normal(x.mean(axis=0), C))
        ratios = [normal[1].logpdf(x) - normal[0].logpdf(x) for x in (limits, tried)]
        shares.append(float(np.mean(ratios[1] > np.sort(ratios[0])[-6])))
    return np.maximum.accumulate(shares)


def main(flights=60, healthy=None):
    healthy = healthy or flights
    draws = Draws(max(FIRST + max(flights, healthy), TAUGHT + flights))
    monitor = ft.monitor(CAMPAIGN, learn=LEARN)
    assert isinstance(monitor, Monitor)
    band = ft.band(CAMPAIGN, learn=LEARN, epsilon=0.05, confidence=0.95)

    def missing(run):
        models, dt = monitor.watch.models, dt_of(run)
        return residuals(models, columns_of(models, run), dt)[:: round(1.0 / (PER_S * dt))]

    learned = [missing(draws.fly(i)) for i in range(LEARN)]
    runs = map(draws.fly, range(LEARN, LEARN + COUNTED))
    peaks, counted = zip(*((sizes(run).max(axis=0), missing(run)) for run in runs), strict=True)
    unit = np.median(peaks, axis=0)
    limit = np.sort((np.array(peaks) / unit).max(axis=1))[-6]  # five of 208 outside

    def times(run):
        t = run.t
        alarm, bounds = monitor.alarm(run), band.bounds(t)
        errors = run.signals[ERRORS].to_numpy()
        outside = ((errors < bounds.low) | (errors > bounds.high)).any(axis=1)
        above = (sizes(run) / unit > limit).any(axis=1)
        return alarm.at_s if alarm else np.inf, first(outside, t), first(above, t)

    def harm(runs):
        """How many are lost, and the largest errors of the others from the fault on, deg."""
        kept = [run for run in runs if run.status == "completed"]
        peaks = [sizes(run)[run.t >= FROM_S, :2].max(axis=0) for run in kept]
        largest = np.round(np.degrees(np.max(peaks, axis=0)), 2) if kept else "-"
        return f"{len(runs) - len(kept)} of {len(runs)} lost; largest errors of others {largest}"

    print(monitor.sentence)
    found = np.isfinite([times(draws.fly(FIRST + i)) for i in range(healthy)]).sum(axis=0)
    print(f"no fault, {healthy} flights: false alarms of monitor {found[0]}, band of errors")
    print(f"  {found[1]}, fixed thresholds {found[2]}")
    print(f"  {harm([draws.fly(FIRST + i) for i in range(flights)])}")
    for name, fault in FAULTS.items():
        runs = [draws.fly(FIRST + i, fault) for i in range(flights)]
        print(f"{name}: {harm(runs)}")
        after = np.array([times(run) for run in runs]) - FROM_S
        for what, column in zip(("monitor", "band of errors", "thresholds"), after.T, strict=True):
            seen = column[np.isfinite(column) & (column >= 0.0)]
            early = int((column < 0.0).sum())
            at = np.round(np.quantile(seen, [0.1, 0.5, 0.9]), 1) if len(seen) else "-"
            print(f"  {what}: {len(seen)} found, after s (10, 50, 90 %) {at}; {early} before it")
        if "throttle_factor" in fault:
            # With a closed throttle, an engine that lost its power flies as before.
            opened = [
                first((run.t >= FROM_S) & (run.signals["throttle"] > OPEN), run.t) for run in runs
            ]
            soon = int((after[:, 0] + FROM_S - opened <= SOON_S).sum())
            print(f"  monitor: {soon} within {SOON_S:g} s of the throttle's passing {OPEN:g}")
        taught = [missing(draws.fly(TAUGHT + i, fault)) for i in range(flights)]
        shares = known_fault(learned, counted, taught, [missing(run) for run in runs])
        print("  a monitor that knows the fault and its time: found after s", end="")
        print(*(f", {t:g}: {n:.0f}" for t, n in zip(TIMES, flights * shares, strict=True)), sep="")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
