"""Faults in flight: how soon a monitor, a band of errors and fixed thresholds find them.

``python docs/figures/monitor.py [FLIGHTS] [HEALTHY]``: each fault on FLIGHTS fresh flights of
``mission_in_wind`` (60 by default), and false alarms on HEALTHY ones (the same number by default).
All three are counted alike, at 5 % and a confidence of 0.95.
"""

import sys

import numpy as np

import flighttune as ft
from flighttune.flight.fly import fly_alone

CAMPAIGN, FROM_S = "mission_in_wind", 20.0
LEARN, COUNTED, FIRST = 100, 208, 400  # fresh draws begin behind those that were counted
FAULTS = {
    "engine to 6 %": {"throttle_factor": 0.06},
    "actuators 4 times slower": {"actuator_lag_factor": 4.0},
    "centre of gravity 2.5 cm aft": {"cg_aft_m": 0.025},
    "aileron stuck at 5 deg": {"aileron_stuck_deg": 5.0},
    "lift x 0.8, drag x 1.5": {"lift_factor": 0.8, "drag_factor": 1.5},
}
ERRORS = ["chi_err", "gamma_err"]


class Draws:
    """Flights of the campaign, with a fault or without."""

    def __init__(self, last):
        plan = ft.plan_campaign(ft.load_campaign(CAMPAIGN))
        self.plan = plan.of_group(plan.chosen_group(None, None)).with_runs(last)
        (group,) = self.plan.groups
        self.gains, self.name = self.plan.gain_sets[group.gains], group.gains

    def fly(self, draw, fault=None):
        tables = self.plan.scenario_of(draw).as_dict() | {"expect": []}
        if fault:
            air = tables["plant"][0].setdefault("airframe", {})
            air["fault"] = {"from_s": FROM_S} | fault
        scenario = ft.scenario_from(tables)
        return fly_alone(scenario, scenario.plant[0], self.gains, self.name)


def first(above, t):
    """Time of the first sample that is above; infinite without one."""
    places = np.flatnonzero(above)
    return float(t[places[0]]) if len(places) else np.inf


def sizes(run):
    """Errors and the difference of the airspeed from 25 m/s, as fixed thresholds take them."""
    signals = run.signals
    return np.column_stack([signals[ERRORS].abs(), (signals["V_a"] - 25.0).abs()])


def main(flights=60, healthy=None):
    healthy = healthy or flights
    draws = Draws(FIRST + max(flights, healthy))
    monitor = ft.monitor(CAMPAIGN, learn=LEARN)
    band = ft.band(CAMPAIGN, learn=LEARN, epsilon=0.05, confidence=0.95)
    peaks = np.array([sizes(draws.fly(i)).max(axis=0) for i in range(LEARN, LEARN + COUNTED)])
    unit = np.median(peaks, axis=0)
    limit = np.sort((peaks / unit).max(axis=1))[-6]  # five of 208 outside

    def times(run):
        t = run.t
        alarm, bounds = monitor.alarm(run), band.bounds(t)
        errors = run.signals[ERRORS].to_numpy()
        outside = ((errors < bounds.low) | (errors > bounds.high)).any(axis=1)
        above = (sizes(run) / unit > limit).any(axis=1)
        return alarm.at_s if alarm else np.inf, first(outside, t), first(above, t)

    print(monitor.sentence)
    found = np.isfinite([times(draws.fly(FIRST + i)) for i in range(healthy)]).sum(axis=0)
    print(f"no fault, {healthy} flights: false alarms of monitor {found[0]}, band of errors")
    print(f"  {found[1]}, fixed thresholds {found[2]}")
    for name, fault in FAULTS.items():
        runs = [draws.fly(FIRST + i, fault) for i in range(flights)]
        lost = sum(run.status != "completed" for run in runs)
        print(f"{name}: {lost} of {flights} lost; largest errors of the others", end=" ")
        kept = [sizes(run)[:, :2].max(axis=0) for run in runs if run.status == "completed"]
        print(np.round(np.degrees(np.max(kept, axis=0)), 2) if kept else "-", "deg")
        after = np.array([times(run) for run in runs]) - FROM_S
        for what, column in zip(("monitor", "band of errors", "thresholds"), after.T, strict=True):
            seen = column[np.isfinite(column) & (column >= 0.0)]
            early = int((column < 0.0).sum())
            at = np.round(np.quantile(seen, [0.1, 0.5, 0.9]), 1) if len(seen) else "-"
            print(f"  {what}: {len(seen)} found, after s (10, 50, 90 %) {at}; {early} before it")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
