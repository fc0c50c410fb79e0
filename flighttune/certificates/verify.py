"""Checking a certificate from its numbers alone: no solver, no trust in who made it."""

import itertools
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np

from flighttune.certificates.certificate import Certificate, load_certificate
from flighttune.control.envelope import ENTRIES, Envelope, JacobianHull
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, disturbance_entry
from flighttune.theory.certificate import (
    Check,
    Verification,
    margin_check,
    radius_checks,
    rate_checks,
)
from flighttune.theory.exact import Interval, Rationals, cosine, exact, product, sine


def vertex_matrices(
    model: LinearModel,
    gains: PIGains,
    hull: JacobianHull | None,
    models: Sequence[LinearModel] = (),
) -> tuple[Rationals, ...]:
    """A_K at every vertex of the polytope, or of the model and `models`, without rounding.

    Loops that are the same are one vertex.

    Returns
    -------
    tuple of ndarray of Fraction, shape (n + p, n + p)
        ``[[A + B K_P C, B K_I], [C, 0]]``, assembled in rational arithmetic.
    """
    K_P, K_I = exact(gains.K_P), exact(gains.K_I)
    if hull is None:
        distinct: list[Rationals] = []
        for linear in (model, *models):
            loop = _closed_loop(exact(linear.A), exact(linear.B), exact(linear.C), K_P, K_I)
            if not any(np.array_equal(loop, other) for other in distinct):
                distinct.append(loop)
        return tuple(distinct)
    box = [sorted({Fraction(low), Fraction(high)}) for low, high in _ends(hull)]
    factors = sorted({Fraction(end) for end in hull.factor})
    C = exact(model.C)
    return tuple(
        _closed_loop(*_jacobians([factor * entry for entry in corner]), C, K_P, K_I)
        for factor in factors
        for corner in itertools.product(*box)
    )


def coverage_checks(
    model: LinearModel, envelope: Envelope, hull: JacobianHull, *, g: float
) -> list[Check]:
    """Check that the polytope contains the Jacobian at every condition, and that of the model.

    Parameters
    ----------
    model : LinearModel
    envelope : Envelope
    hull : JacobianHull
    g : float, m/s^2
    """
    slowest, fastest = (Fraction(V) for V in envelope.V_a)
    rates = Fraction(g) / fastest, Fraction(g) / slowest
    sine_gamma, sine_phi = (
        (sine(low)[0], sine(high)[1]) for low, high in (envelope.gamma, envelope.phi)
    )
    n_z = Fraction(envelope.n_z[0]), Fraction(envelope.n_z[1])
    lowest, highest = zip(*map(cosine, envelope.phi), strict=True)
    level = envelope.phi[0] <= 0.0 <= envelope.phi[1]
    low, high = min(lowest), Fraction(1) if level else max(highest)
    boxes = [sine_gamma, (1 / high**2, 1 / low**2), product(n_z, sine_phi), (low, high)]
    checks = [_inside("g/V of the envelope", rates, hull.factor)]
    for name, box, ends in zip(ENTRIES, boxes, _ends(hull), strict=True):
        checks.append(_inside(f"{name} of the envelope", box, ends))
    return [*checks, _model_check(model, hull)]


def _ends(hull: JacobianHull) -> list[tuple[float, float]]:
    return list(zip(hull.lower.tolist(), hull.upper.tolist(), strict=True))


def _closed_loop(
    A: Rationals, B: Rationals, C: Rationals, K_P: Rationals, K_I: Rationals
) -> Rationals:
    n, p = len(A), len(C)
    A_K = exact(np.zeros((n + p, n + p)))
    A_K[:n, :n] = A + B @ K_P @ C
    A_K[:n, n:] = B @ K_I
    A_K[n:, :n] = C
    return A_K


def _jacobians(entries: Sequence[Fraction]) -> tuple[Rationals, Rationals]:
    a, b1, b2, b3 = entries
    A, B = exact(np.zeros((2, 2))), exact(np.zeros((2, 2)))
    A[1, 1] = a
    B[0, 0], B[1, 0], B[1, 1] = -b1, b2, -b3
    return A, B


def _inside(name: str, inner: Interval, outer: tuple[float, float]) -> Check:
    margin = min(inner[0] - Fraction(outer[0]), Fraction(outer[1]) - inner[1])
    return margin_check(f"{name} inside [{outer[0]:.6g}, {outer[1]:.6g}]", margin)


def _model_check(model: LinearModel, hull: JacobianHull) -> Check:
    """Checks that the model is the chi/gamma law's, its entries in the polytope for a factor."""
    name = "trim model inside the polytope"
    A, B = exact(model.A), exact(model.B)
    if model.shape != (2, 2, 2) or not np.array_equal(model.C, np.eye(2)):
        return Check(name=name, margin=-np.inf, exact=False)
    entries = [A[1, 1], -B[0, 0], B[1, 0], -B[1, 1]]
    expected = _jacobians(entries)
    if not (np.array_equal(A, expected[0]) and np.array_equal(B, expected[1])):
        return Check(name=name, margin=-np.inf, exact=False)
    low, high = (Fraction(end) for end in hull.factor)
    margin = high - low
    for entry, (lower, upper) in zip(entries, _ends(hull), strict=True):
        for side, bound in ((1, Fraction(upper)), (-1, -Fraction(lower))):
            limit = side * entry
            if bound > 0:
                low = max(low, limit / bound)
            elif bound < 0:
                high = min(high, limit / bound)
            elif limit > 0:
                margin = min(margin, -limit)
    return margin_check(name, min(margin, high - low))


def verify(certificate: Certificate | str | Path) -> Verification:
    """Check every inequality of a certificate, in floating point and exactly.

    Parameters
    ----------
    certificate : Certificate or path-like
        The value, or the JSON file it was written to.

    Returns
    -------
    Verification
        Valid if every inequality is proven in rational arithmetic. The loops are assembled from
        the stated models, gains and polytope, so that there is no other matrix to believe in.

    Raises
    ------
    InputError
        If a file cannot be read or is not a certificate.
    """
    if not isinstance(certificate, Certificate):
        certificate = load_certificate(certificate)
    claim, model, hull = certificate.claim, certificate.model, certificate.hull
    checks: list[Check] = []
    if claim.envelope is not None and hull is not None and claim.g is not None:
        checks += coverage_checks(model, claim.envelope, hull, g=claim.g)
    vertices = vertex_matrices(model, certificate.gains, hull, certificate.models)
    checks += rate_checks(vertices, certificate.Q, rate=claim.rate)
    W, multiplier, L_d = certificate.W, certificate.multiplier, claim.L_d
    if claim.radius is not None and not (W is None or multiplier is None or L_d is None):
        sizes = {"multiplier": multiplier, "radius": claim.radius, "L_d": L_d}
        checks += radius_checks(vertices, disturbance_entry(model), W, **sizes)
    return Verification.of(checks)
