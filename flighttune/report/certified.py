"""A certification as plain values, for a command and a page."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from flighttune.certificates import Certification, Claim


def claim_values(claim: Claim | None) -> dict[str, Any]:
    """The claim of a certificate and its place; all null where there is none."""
    return {
        **{key: getattr(claim, key, None) for key in ("rate", "radius", "L_d")},
        "holds": claim.place if claim else None,
        "conditions": [
            {"V_a_mps": V_a, "gamma_rad": gamma}
            for V_a, gamma in (claim.conditions if claim else ())
        ],
    }


def certification_values(made: Certification) -> dict[str, Any]:
    """The proven claim: the norm decays at half the rate, from at most `growth` times its start."""
    certificate, verification = made.certificate, made.verification
    return {
        "status": made.status,
        "reason": made.reason,
        **claim_values(certificate.claim if certificate else None),
        "growth": math.sqrt(float(np.linalg.cond(certificate.Q))) if certificate else None,
        "checks": [asdict(check) for check in verification.checks] if verification else [],
    }
