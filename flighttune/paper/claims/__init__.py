"""Every checkable sentence of the abstract and of section 5: to add one, list it in its file."""

from flighttune.paper.claims import (
    abstract,
    disturbances,
    gains,
    indicator,
    spread,
    stabilisation,
    theorem,
)
from flighttune.paper.claims.base import Claim, Finding, judged
from flighttune.paper.study import Study

CLAIMS: tuple[Claim, ...] = (
    *abstract.CLAIMS,
    *theorem.CLAIMS,
    *gains.CLAIMS,
    *stabilisation.CLAIMS,
    *indicator.CLAIMS,
    *spread.CLAIMS,
    *disturbances.CLAIMS,
)
"""In the order of the paper."""


def findings(study: Study) -> tuple[Finding, ...]:
    """Every claim held against a study."""
    return tuple(judged(claim, study) for claim in CLAIMS)
