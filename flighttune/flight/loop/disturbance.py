"""Disturbances of the course and flight-path-angle rates."""

import math
from bisect import bisect
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from flighttune.base.units import DEG
from flighttune.vehicles.plants.weather import OscillatingWind

# Time (s) by which a switch is early: it belongs to a sample, whose time is a rounded sum.
AHEAD = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Sinusoid:
    """``d_chi = a_chi sin(omega_chi t), d_gamma = a_gamma cos(omega_gamma t)``, or their signs.

    Eq. (39) of arXiv 2411.13140, which calls the amplitudes Lipschitz constants. A channel with
    switching times has its amplitude instead, of the other sign after each of them.
    """

    # rad/s: Amplitudes a_chi, a_gamma
    chi_amplitude: float = 0.0
    # rad/s: Angular frequencies
    chi_omega: float = 0.0
    gamma_amplitude: float = 0.0
    gamma_omega: float = 0.0
    # rad: Phases, added to the arguments
    chi_phase: float = 0.0
    gamma_phase: float = 0.0
    # Take the amplitude with the sign of the sinusoid: the worst disturbance of a size switches
    # between its bounds
    square: bool = False
    # s: Rising times at which a constant amplitude changes its sign; None for a sinusoid
    chi_switches: tuple[float, ...] | None = None
    gamma_switches: tuple[float, ...] | None = None

    @property
    def batched(self) -> bool:
        """Whether the compiled kernel flies it: plain sinusoids."""
        switches = self.chi_switches is not None or self.gamma_switches is not None
        return not (self.square or self.chi_phase or self.gamma_phase or switches)

    def __call__(self, t: float) -> tuple[float, float]:
        """Return (d_chi, d_gamma) in rad/s at time `t` in s."""
        chi = math.sin(self.chi_omega * t + self.chi_phase)
        gamma = math.cos(self.gamma_omega * t + self.gamma_phase)
        if self.square:
            chi, gamma = math.copysign(1.0, chi), math.copysign(1.0, gamma)
        if self.chi_switches is not None:
            chi = _sign_after(self.chi_switches, t)
        if self.gamma_switches is not None:
            gamma = _sign_after(self.gamma_switches, t)
        return self.chi_amplitude * chi, self.gamma_amplitude * gamma

    def as_wind(self, V_a: float, chi: float, gamma: float) -> OscillatingWind:
        """Oscillating wind that turns a path through the air at these rates, to first order.

        `V_a` (m/s) is the airspeed, `chi` and `gamma` (rad) the direction of flight about which the
        wind is laid. ``design/oscillating_wind.md`` derives it.
        """
        # The wind is horizontal and across the path for the course, and normal to the path for the
        # climb.
        across = V_a * math.cos(gamma) * _quotient(self.chi_amplitude, self.chi_omega)
        normal = V_a * _quotient(self.gamma_amplitude, self.gamma_omega)
        return OscillatingWind(
            cosine=(-across * math.sin(chi), across * math.cos(chi), 0.0),
            cosine_omega=self.chi_omega,
            sine=(
                normal * math.cos(chi) * math.sin(gamma),
                normal * math.sin(chi) * math.sin(gamma),
                normal * math.cos(gamma),
            ),
            sine_omega=self.gamma_omega,
        )

    @classmethod
    def of_table(cls, table: Mapping[str, Any]) -> "Sinusoid":
        """The disturbance of a table ``[disturbance]``, as plain values."""
        parts: dict[str, Any] = {"square": table.get("wave") == "square"}
        for channel in ("chi", "gamma"):
            parts[f"{channel}_amplitude"] = table.get(f"{channel}_amplitude", 0.0)
            parts[f"{channel}_omega"] = table.get(f"{channel}_omega_rad_s", 0.0)
            parts[f"{channel}_phase"] = (table.get(f"{channel}_phase_deg") or 0.0) * DEG
            switches = table.get(f"{channel}_switch_s")
            parts[f"{channel}_switches"] = None if switches is None else tuple(switches)
        return cls(**parts)

    @property
    def rate_bound(self) -> float:
        """L_d: bound of the norm of the derivative, rad/s^2; infinite where it switches."""
        chi, gamma = self.chi_amplitude, self.gamma_amplitude
        products = chi * self.chi_omega, gamma * self.gamma_omega
        switches = self.chi_switches if chi else None, self.gamma_switches if gamma else None
        if any(switches) or (self.square and any(products)):
            return math.inf
        # The derivatives are then a quarter period apart.
        if abs(self.chi_omega) == abs(self.gamma_omega) and self.chi_phase == self.gamma_phase:
            return max(map(abs, products))
        return math.hypot(*products)


def _sign_after(switches: tuple[float, ...], t: float) -> float:
    return -1.0 if bisect(switches, t + AHEAD) % 2 else 1.0


def _quotient(amplitude: float, omega: float) -> float:
    return amplitude / omega if amplitude else 0.0
