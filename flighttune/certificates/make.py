"""Making certificates: solvers propose, the exact checks decide."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from typing import Any, Literal

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.certificates.certificate import Certificate, Claim, vertex_matrices
from flighttune.control.envelope import Envelope, jacobian_hull, vertex_loops
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop, disturbance_entry
from flighttune.errors import InputError
from flighttune.theory.attractor import Ellipsoid, invariant_ellipsoid
from flighttune.theory.common import common_ellipsoid, common_Q
from flighttune.theory.exact import FACTORS, Verification, provable_rate
from flighttune.theory.indicators import indicators

# Airspeed (m/s) and flight-path angle (rad), and the model there.
Condition = tuple[tuple[float, float], LinearModel]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certification:
    """A certificate that has been verified, or the reason for which it was refused."""

    status: Literal["certified", "refused"]
    reason: str  # empty unless refused
    certificate: Certificate | None
    verification: Verification | None  # the checks of the certificate

    @property
    def in_words(self) -> str:
        """The status, and what a certificate is worth where it is little."""
        return self.status if self.certificate is None else self.certificate.in_words

    @property
    def values(self) -> dict[str, Any]:
        """The claim and its checks, for a command and a page; null where nothing is proven.

        The norm decays at half the rate, from at most ``growth`` times its start.
        """
        values = dict.fromkeys(("rate", "radius", "L_d", "holds", "growth"))
        values |= {"status": self.status, "reason": self.reason, "conditions": [], "checks": []}
        values["in_words"] = self.in_words
        if self.certificate is not None and self.verification is not None:
            values |= self.certificate.claim.values
            values["growth"] = self.certificate.growth
            values["checks"] = [asdict(check) for check in self.verification.checks]
        return values


def certify(
    model: LinearModel,
    gains: PIGains,
    *,
    envelope: Envelope | None = None,
    g: float | None = None,
    L_d: float | None = None,
    conditions: Sequence[Condition] = (),
    scenario_sha256: str | None = None,
) -> Certification:
    """Certify the rate of gains, and the ultimate radius for a disturbance bound.

    Parameters
    ----------
    model : LinearModel
        At the trim. With an envelope: the chi/gamma law's, and inside it.
    gains : PIGains
    envelope : Envelope, optional
        Claim the same for every flight of the chi/gamma law whose conditions stay in it.
    g : float, m/s^2, optional
        Acceleration of gravity; needed with an envelope.
    L_d : float, unit of x' per second, optional
        Bound on the norm of the disturbance's derivative; without one only the rate is claimed.
    conditions : sequence of ((V_a, gamma), model), optional
        Claim the same at these, behind the same gains, and for every mixture of their loops; not
        together with an envelope.
    scenario_sha256 : str, optional
        Kept in the certificate.

    Returns
    -------
    Certification
        Every inequality of a certificate has been proven; the claims are less than what was
        computed by about 1e-8 of themselves to leave room for that.

    Raises
    ------
    InputError
        If the channels or the states of the models do not fit, a bound is not positive, or an
        envelope comes without `g` or with conditions.

    Examples
    --------
    >>> model = ft.kinematic_model(V_a=25.0, gamma=0.26, g=9.81)
    >>> ft.certify(model, ft.PAPER_GAINS).status
    'certified'
    """
    models = tuple(model for _, model in conditions)
    if any(other.states != model.states for other in models):
        raise InputError("`conditions` must have models with the states of `model`.")
    polytope = None
    if envelope is None or g is None:
        loops = _distinct([closed_loop(linear, gains) for linear in (model, *models)])
    else:
        polytope = jacobian_hull(envelope, g=g)
        loops = vertex_loops(envelope, gains, g=g)
    vertices = vertex_matrices(model, gains, polytope, models)
    alone = len(loops) == 1
    figures = indicators(loops[0]) if alone else common_Q(loops)
    proven = None if figures.Q is None else provable_rate(vertices, figures.Q)
    if proven is None:
        why = figures.reason or "no inflation of Q could be proven to satisfy its inequality."
        return _refused(why)
    ellipsoid = radius = None
    if L_d is not None:
        ellipsoid, reason = _ellipsoid(loops, disturbance_entry(model), L_d)
        if ellipsoid is None:
            return _refused(reason)
        radius = math.sqrt(float(np.linalg.eigvalsh(ellipsoid.W)[-1])) * FACTORS[0]
    lyapunov = {"Lyapunov equation": f"numpy {np.__version__}"}
    solvers = lyapunov if alone else {"solver": "Clarabel", "clarabel": version("clarabel")}
    certificate = Certificate(
        claim=Claim(
            rate=proven[1],
            radius=radius,
            L_d=L_d,
            envelope=envelope,
            g=g,
            conditions=tuple(condition for condition, _ in conditions),
        ),
        model=model,
        gains=gains,
        Q=proven[0],
        W=None if ellipsoid is None else ellipsoid.W,
        multiplier=None if ellipsoid is None else ellipsoid.multiplier,
        hull=polytope,
        models=models,
        made_with={"flighttune": version("flighttune"), **solvers},
        scenario_sha256=scenario_sha256,
    )
    verification = certificate.verify()
    if not verification.valid:
        return _refused(verification.reason)
    return Certification(
        status="certified", reason="", certificate=certificate, verification=verification
    )


def _distinct(loops: Sequence[FloatArray]) -> FloatArray:
    """Loops stacked in order, the same ones once."""
    _, first = np.unique(np.array(loops), axis=0, return_index=True)
    return np.array(loops)[np.sort(first)]


def _ellipsoid(loops: FloatArray, E: FloatArray, L_d: float) -> tuple[Ellipsoid | None, str]:
    if len(loops) > 1:
        return common_ellipsoid(loops, E, L_d=L_d)
    return invariant_ellipsoid(loops[0], E, L_d=L_d, slack=1e-6), ""  # else rounding refutes it


def _refused(reason: str) -> Certification:
    return Certification(status="refused", reason=reason, certificate=None, verification=None)
