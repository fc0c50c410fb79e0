"""Laws that other autopilots fly, as own laws: PID with feed-forward, and LQI."""

import math

import numpy as np
from scipy.linalg import solve_continuous_are

import flighttune as ft
from flighttune.control.exact_law import turning_speed

G = 9.81
STEEPEST = 1.2  # rad: roll beyond which the lift is not divided by its cosine


class Peer:
    """Limits, errors and integrals that both have; the integrals stand while a limit holds."""

    def __init__(self, setup, aircraft, V):
        lags = ft.loop.load_identified(aircraft).nearest(V, 0.0).lags
        self.late = np.array([lag.whole + 0.5 * setup.dt for lag in lags])
        self.dt, self.signals = setup.dt, {}
        self.limiter = ft.loop.CommandLimiter(setup.limits, setup.dt)

    def start(self, condition):
        self.integral = np.zeros(2)
        self.limiter.start((condition.phi, condition.n_z_start))

    def commands(self, measured, error, rates, V, upright):
        """Roll and load factor; `rates` of the reference, `V` of `turning_speed`."""
        raise NotImplementedError

    def step(self, measured, reference, _t):
        chi = math.remainder(reference.chi - measured.chi, math.tau)
        error = np.array([chi, reference.gamma - measured.gamma])
        rates = np.array([reference.chi_dot, reference.gamma_dot])
        upright = math.cos(min(max(measured.phi, -STEEPEST), STEEPEST))
        commands = self.commands(measured, error, rates, turning_speed(measured), upright)
        limited = self.limiter.limit(*commands)
        self.integral += np.where(self.limiter.limited, 0.0, error) * self.dt
        return limited


class Pid(Peer):
    """Gains by the SIMC rules of S. Skogestad for an integrator behind the identified lag.

    ``kp = 1 / (2 T)``, ``ki = kp / (8 T)``, T the whole lag: J. Process Control 13 (2003).
    """

    def commands(self, measured, error, rates, V, upright):
        K_P = 0.5 / self.late
        turn, climb = rates + K_P * error + K_P / (8.0 * self.late) * self.integral
        lift = math.cos(measured.gamma) + V * climb / G
        return math.atan(V * turn / G), lift / upright


class Lqi(Peer):
    """A linear-quadratic regulator of errors, roll, lift and integrals about the reference."""

    def __init__(self, setup, aircraft, V):
        super().__init__(setup, aircraft, V)
        none, one, fast = np.zeros((2, 2)), np.eye(2), np.diag(1.0 / self.late)
        A = np.block([[none, -G / V * one, none], [none, -fast, none], [one, none, none]])
        B = np.vstack([none, fast, none])
        Q = np.diag([4.0] * 2 + [0.0] * 2 + [2.0] * 2)
        self.K = B.T @ solve_continuous_are(A, B, Q, one)

    def commands(self, measured, error, rates, V, upright):
        turn, climb = rates
        phi, lift = math.atan(V * turn / G), math.cos(measured.gamma) + V * climb / G
        off = measured.phi - phi, measured.n_z * upright - lift
        more = -self.K @ np.array([*error, *off, *self.integral])
        return phi + more[0], (lift + more[1]) / upright
