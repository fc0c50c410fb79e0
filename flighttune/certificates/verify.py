"""Checking a certificate from its numbers alone: no solver, no trust in who made it."""

from pathlib import Path

from flighttune.certificates.certificate import Certificate
from flighttune.certificates.coverage import coverage_checks, vertex_matrices
from flighttune.certificates.file import load_certificate
from flighttune.control.closed_loop import disturbance_entry
from flighttune.theory.certificate import Check, Verification, radius_checks, rate_checks


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
    claim = certificate.claim
    checks: list[Check] = []
    if claim.envelope is not None and certificate.hull is not None and claim.g is not None:
        checks += coverage_checks(certificate.model, claim.envelope, certificate.hull, g=claim.g)
    vertices = vertex_matrices(
        certificate.model, certificate.gains, certificate.hull, certificate.models
    )
    checks += rate_checks(vertices, certificate.Q, rate=claim.rate)
    if (
        claim.radius is not None
        and claim.L_d is not None
        and certificate.W is not None
        and certificate.multiplier is not None
    ):
        checks += radius_checks(
            vertices,
            disturbance_entry(certificate.model),
            certificate.W,
            multiplier=certificate.multiplier,
            radius=claim.radius,
            L_d=claim.L_d,
        )
    return Verification.of(checks)
