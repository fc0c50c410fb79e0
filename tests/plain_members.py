"""Plain classes that satisfy the protocols: type checkers read this file, tests fly them."""

import math

import flighttune as ft
from flighttune import PAPER_GAINS


class Proportional:
    """A law that is nothing but a class."""

    dt = 0.02
    signals = {"chi_seen": "rad"}  # noqa: RUF012

    def start(self, condition: ft.loop.FlightCondition) -> None:
        self.begun = condition

    def step(
        self, measured: ft.loop.Measured, reference: ft.loop.ReferenceSample, t: float
    ) -> tuple[float, float, float]:
        self.last = measured
        phi = 1.5 * (reference.chi - measured.chi)
        n_z = math.cos(measured.gamma) + 1.5 * (reference.gamma - measured.gamma)
        return phi, n_z, measured.chi


class Glider:
    """A plant that is nothing but a class: it follows at once and turns as it rolls."""

    kind = "glider"
    signals = ft.loop.COMMON_SIGNALS
    limits = ft.loop.Limits.none(2)

    def start(self, condition: ft.loop.FlightCondition) -> None:
        self.chi, self.gamma, self.phi, self.n_z = condition.chi, condition.gamma, 0.0, 1.0

    def observe(self) -> tuple[float, ...]:
        return self.chi, self.gamma, self.phi, self.n_z, 25.0, 0.0, 0.0, 0.0

    def advance(self, phi_cmd: float, n_z_cmd: float, duration: float) -> ft.loop.Stop | None:
        self.phi, self.n_z = phi_cmd, n_z_cmd
        self.chi += 0.4 * phi_cmd * duration
        self.gamma += 0.4 * (n_z_cmd - 1.0) * duration
        return None


law: ft.loop.Controller = Proportional()
paper: ft.loop.Controller = ft.loop.MimoPI(PAPER_GAINS, dt=0.02)
exact: ft.loop.Controller = ft.loop.ExactLaw(ft.loop.rate_gains(PAPER_GAINS, V_a=25.0), dt=0.02)
plant: ft.loop.Plant = Glider()
point: ft.loop.Plant = ft.loop.PointMassPlant()
