"""Disturbances of the course and flight-path-angle rates."""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Sinusoid:
    """``d_chi = a_chi sin(omega_chi t), d_gamma = a_gamma cos(omega_gamma t)``.

    Attributes
    ----------
    chi_amplitude, gamma_amplitude : float, rad/s
        Amplitudes a_chi, a_gamma.
    chi_omega, gamma_omega : float, rad/s
        Angular frequencies.

    Notes
    -----
    Eq. (39) of arXiv 2411.13140, which calls the amplitudes Lipschitz constants. The bound of the
    derivative that enters the guarantees is `rate_bound`.
    """

    chi_amplitude: float
    chi_omega: float
    gamma_amplitude: float
    gamma_omega: float

    def __call__(self, t: float) -> tuple[float, float]:
        """Return (d_chi, d_gamma) in rad/s at time `t` in s."""
        return (
            self.chi_amplitude * math.sin(self.chi_omega * t),
            self.gamma_amplitude * math.cos(self.gamma_omega * t),
        )

    @property
    def rate_bound(self) -> float:
        """L_d: bound of the norm of the derivative, rad/s^2.

        With one frequency it is the larger amplitude times the frequency (the derivatives are a
        quarter period apart), else the norm of both products.
        """
        products = self.chi_amplitude * self.chi_omega, self.gamma_amplitude * self.gamma_omega
        if abs(self.chi_omega) == abs(self.gamma_omega):
            return max(map(abs, products))
        return math.hypot(*products)
