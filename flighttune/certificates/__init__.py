"""Certificates of gains: made with solvers, checked without, kept as JSON files.

docs/certificate.md explains what a certificate says, and what it does not.
"""

from flighttune.certificates.certificate import (
    Certificate,
    Claim,
    load_certificate,
    save_certificate,
    verify,
)
from flighttune.certificates.make import Certification, certify
from flighttune.theory.exact import Check, Verification

__all__ = [
    "Certificate",
    "Certification",
    "Check",
    "Claim",
    "Verification",
    "certify",
    "load_certificate",
    "save_certificate",
    "verify",
]
