"""Ranges of flight, and polytopes of Jacobians of the chi/gamma law over them.

The law's Jacobians depend on the flight condition through four numbers only (arXiv 2411.13140,
below Eq. (40)): ``a = (g/V) sin(gamma)``, ``b1 = (g/V) / cos(phi)^2``, ``b2 = (g n_z/V) sin(phi)``
and ``b3 = (g/V) cos(phi)``. A_K is affine in them, so that the box of their ranges, 16 vertices,
contains every Jacobian of the envelope. The corners of (V, gamma, phi, n_z) alone do not: the
extremes of a product or of a cosine need not lie there. The four share the factor g/V; keeping it
apart, 32 vertices, contains them all as well and is never larger, and so it is done here.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from flighttune.arrays import FloatArray, check_positive, check_upright, set_read_only
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop, entry_model
from flighttune.errors import InputError
from flighttune.units import DEG

RANGES = ("V_a", "gamma", "phi", "n_z")
ENTRIES = ("a", "b1", "b2", "b3")

# Relative widening of each range: some 50 times the rounding of the formulas.
OUTWARD = 1e-14

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """Ranges of flight conditions, each independent of the others."""

    V_a: Range  # m/s
    gamma: Range  # rad
    phi: Range  # rad
    n_z: Range

    def __post_init__(self) -> None:
        for name in RANGES:
            low, high = (float(end) for end in getattr(self, name))
            if not (math.isfinite(low) and math.isfinite(high) and low <= high):
                raise InputError(
                    f"`{name}` must be a range (low, high), got {getattr(self, name)}."
                )
            object.__setattr__(self, name, (low, high))
        if not self.V_a[0] > 0.0:
            raise InputError(f"`V_a` must be positive, got {self.V_a[0]:g} m/s.")
        for ends in zip(self.gamma, self.phi, strict=True):
            check_upright(gamma=ends[0], phi=ends[1])

    def __str__(self) -> str:
        units = ((1.0, " m/s"), (DEG, " deg"), (DEG, " deg"), (1.0, ""))
        return ", ".join(
            f"{name} {low / unit:g}..{high / unit:g}{symbol}"
            for name, (low, high), (unit, symbol) in zip(RANGES, self.ranges, units, strict=True)
        )

    @property
    def ranges(self) -> FloatArray:
        """Low and high end of each range, shape (4, 2)."""
        return np.array([getattr(self, name) for name in RANGES])

    @classmethod
    def at(cls, *, V_a: float, gamma: float) -> "Envelope":
        """The envelope of steady wings-level flight alone."""
        n_z = math.cos(gamma)
        return cls(V_a=(V_a, V_a), gamma=(gamma, gamma), phi=(0.0, 0.0), n_z=(n_z, n_z))

    def scaled(self, trim: "Envelope", factor: float) -> "Envelope":
        """Every end moved to ``trim + factor (end - trim)``.

        Raises
        ------
        InputError
            If `factor` is negative, or the result is not an envelope.
        """
        if not factor >= 0.0:
            raise InputError(f"`factor` must not be negative, got {factor}.")
        ranges = trim.ranges + factor * (self.ranges - trim.ranges)
        return Envelope(**dict(zip(RANGES, ranges.tolist(), strict=True)))

    def contains(self, other: "Envelope") -> bool:
        """Whether every range of `other` lies inside the same range here."""
        low, high = self.ranges.T
        return bool((low <= other.ranges[:, 0]).all() and (other.ranges[:, 1] <= high).all())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JacobianHull:
    """A polytope of entries (a, b1, b2, b3): a range of factors times a box.

    Attributes
    ----------
    factor : (float, float)
        Range of g/V, 1/s.
    lower, upper : ndarray, shape (4,)
        The box of the entries over g/V.
    """

    factor: Range
    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        set_read_only(self, lower=(len(ENTRIES),), upper=(len(ENTRIES),))
        if not (self.lower <= self.upper).all():
            raise InputError(
                f"`lower` must not exceed `upper`, got {self.lower.tolist()} "
                f"and {self.upper.tolist()}."
            )
        if not 0.0 < self.factor[0] <= self.factor[1] < math.inf:
            raise InputError(f"`factor` must be a positive range, got {self.factor}.")

    @property
    def corners(self) -> FloatArray:
        """Entries at the vertices, shape (k, 4); a range without width counts once."""
        box = itertools.product(
            *(sorted(set(ends)) for ends in zip(self.lower, self.upper, strict=True))
        )
        corners = np.array(list(box))
        return np.concatenate([factor * corners for factor in sorted(set(self.factor))])

    def models(self) -> tuple[LinearModel, ...]:
        """The linear model of each vertex."""
        return tuple(entry_model(corner) for corner in self.corners)


def jacobian_hull(envelope: Envelope, *, g: float) -> JacobianHull:
    """A polytope, rounded outward, with the law's Jacobian at every condition of an envelope.

    Notes
    -----
    Interval arithmetic: the sine grows over +-pi/2, the cosine has its maximum where roll is zero,
    and a product is extreme at ends of its factors. A function that is affine in each of several
    numbers lies, over a box of them, in the convex hull of its corner values.
    """
    check_positive("m/s^2", g=g)
    factor = (g / envelope.V_a[1], g / envelope.V_a[0])
    level = envelope.phi[0] <= 0.0 <= envelope.phi[1]
    cosines = sorted(map(math.cos, envelope.phi))
    cosine = (cosines[0], 1.0 if level else cosines[1])
    sine_gamma = (math.sin(envelope.gamma[0]), math.sin(envelope.gamma[1]))
    sine_phi = (math.sin(envelope.phi[0]), math.sin(envelope.phi[1]))
    box = (
        sine_gamma,
        (cosine[1] ** -2, cosine[0] ** -2),
        _product(envelope.n_z, sine_phi),
        cosine,
    )
    lower, upper = np.array([_outward(ends) for ends in box]).T
    return JacobianHull(factor=_outward(factor), lower=lower, upper=upper)


def vertex_loops(envelope: Envelope, gains: PIGains, *, g: float) -> FloatArray:
    """A_K at the vertices of `jacobian_hull`, shape (k, 4, 4).

    Raises
    ------
    InputError
        As `jacobian_hull`, or if the channels of `gains` are not (chi, gamma) to (phi, n_z).
    """
    models = jacobian_hull(envelope, g=g).models()
    return np.array([closed_loop(model, gains) for model in models])


def _product(first: Range, second: Range) -> Range:
    products = [a * b for a in first for b in second]
    return min(products), max(products)


def _outward(ends: Range) -> Range:
    low, high = ends
    return low - OUTWARD * abs(low), high + OUTWARD * abs(high)
