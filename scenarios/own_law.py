"""A law of one's own: an LQR on the identified aircraft with integral action, beside K*.

Run it with ``python scenarios/own_law.py [FOLDER]``.
"""

import math
import sys

import numpy as np
from scipy.linalg import solve_continuous_are

import flighttune as ft

AIRCRAFT, V_A = "aerosonde", 25.0


class LQR:
    """Feeds back errors, their integrals, roll and load factor, which lag as identified."""

    def __init__(self, setup, errors=2.0, integrals=1.0):
        self.dt, self.signals = setup.dt, {"chi_sum": "rad s", "gamma_sum": "rad s"}
        self.limiter = ft.loop.CommandLimiter(setup.limits, setup.dt)
        lags = ft.loop.load_identified(AIRCRAFT).nearest(V_A, 0.0).lags
        speed = np.diag([1.0 / (lag.whole + setup.dt / 2.0) for lag in lags])
        none, one = np.zeros((2, 2)), np.eye(2)
        # x = (errors, roll and load factor above steady flight, integrals of the errors)
        turn = -setup.g / V_A * one
        A = np.block([[none, turn, none], [none, -speed, none], [one, none, none]])
        B = np.vstack([none, speed, none])
        Q = np.diag([errors] * 2 + [0.0] * 2 + [integrals] * 2)
        self.K = B.T @ solve_continuous_are(A, B, Q, one)

    def start(self, condition):
        """Begin with empty integrals."""
        self.sums = np.zeros(2)
        self.limiter.start((condition.phi, condition.n_z_start))

    def step(self, measured, reference, _):
        """Command roll and load factor; an integral stands while its command is limited."""
        e_chi = math.remainder(reference.chi - measured.chi, math.tau)
        errors = np.array([e_chi, reference.gamma - measured.gamma])
        lift = math.cos(measured.gamma) / math.cos(measured.phi)
        u = -self.K @ [*errors, measured.phi, measured.n_z - lift, *self.sums]
        commands = self.limiter.limit(u[0], lift + u[1])
        self.sums += np.where(self.limiter.limited, 0.0, errors) * self.dt
        return *commands, *self.sums


if __name__ == "__main__":
    tables = ft.load_scenario("paper_identified").as_dict() | {"gains": ["paper"], "expect": []}
    flown = ft.fly(ft.scenario_from(tables), laws={"lqr": LQR})
    print(flown.metrics[["ITAE", "MO_rad", "settling_s"]])
    print(ft.record(flown, sys.argv[1] if len(sys.argv) > 1 else "runs/own_law"))
