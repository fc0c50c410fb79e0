"""Making certificates: solvers propose, the exact checks decide."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from importlib.metadata import version
from typing import Any, Literal

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.words import pick
from flighttune.control.certificates import exact_rate, lag_box
from flighttune.control.certificates.certificate import Certificate, Claim, vertex_matrices
from flighttune.control.certificates.estimates import ROOM, estimate_gains
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import (
    Envelope,
    LinearModel,
    closed_loop,
    disturbance_entry,
    jacobian_hull,
    loops_of,
)
from flighttune.control.theory import exact, lyapunov
from flighttune.control.theory.indicators import Indicators, indicators

# Largest bound on disturbances, rad/s^2; the square of a larger one overflows.
MAX_L_D = 1e6


# Estimation errors in the bound on the true error, in standard deviations.
SIGMAS = 3.0

# Airspeed (m/s) and flight-path angle (rad), and the model there.
Condition = tuple[tuple[float, float], LinearModel]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certification(Answering):
    """Gains on a linear model with a certificate that has been verified, or why there is none.

    Attributes
    ----------
    status : "certified" or "refused"
    reason : str
        Reason of a refusal; empty otherwise.
    model : LinearModel
    gains : PIGains
    certificate : Certificate or None
    verification : Verification or None
        The checks of the certificate.
    name : str
        Name of the gains.
    over_envelope : bool
        Whether a certificate over an envelope, or at every identified condition, was asked for.
    ranges : tuple of Envelope, or None
        The trim and the ranges of flight of the scenario, if its law differs over them.
    g : float or None, m/s^2
        Acceleration of gravity; goes with `ranges`.
    largest_factor : float or None
        Largest certified factor on the envelope, scaled about the trim; None if the certificate
        covers the model alone or holds everywhere.
    scaling : ndarray, shape (n + p,), or None
        Units of state in which the gains were tuned; None for plain units.
    navigation : str
        Grade of navigation for which peak gains were requested; or empty.
    estimate_sd : tuple of float, length p, or None, unit of the errors
        Standard deviation of each estimate of that grade.
    absent : str
        Why the sampled loop has no exact rate, or the identified conditions no box of lags; empty
        if they have, or if none was requested.

    Examples
    --------
    >>> certification = ft.certify("paper", "paper")
    >>> certification.status, round(certification.certificate.claim.rate, 4)
    ('certified', 0.4599)
    """

    status: Literal["certified", "refused"]
    reason: str
    model: LinearModel
    gains: PIGains
    certificate: Certificate | None = None
    verification: exact.Verification | None = None
    name: str = "gains"
    over_envelope: bool = False
    ranges: tuple[Envelope, Envelope] | None = None
    g: float | None = None
    largest_factor: float | None = None
    scaling: FloatArray | None = None
    navigation: str = ""
    estimate_sd: tuple[float, ...] | None = None
    absent: str = ""

    @property
    def in_words(self) -> str:
        """The status, with a warning if the certificate is too weak to be useful."""
        return self.status if self.certificate is None else self.certificate.in_words

    @property
    def indicators(self) -> Indicators:
        """R_K, I_K and E_K of the loop, in plain units of state."""
        return indicators(closed_loop(self.model, self.gains), errors=len(self.model.errors))

    @property
    def values(self) -> dict[str, Any]:
        """The claim and its checks, for a command and a page; null without a proof.

        The norm decays at half the rate, from at most ``growth`` times its initial value.
        """
        values = dict.fromkeys(("rate", "radius", "L_d", "holds", "growth"))
        values |= {"status": self.status, "reason": self.reason}
        values |= {"conditions": [], "checks": [], "exact_rates": [], "boxes": [], "estimates": []}
        values["in_words"] = self.in_words
        if self.certificate is not None and self.verification is not None:
            values |= self.certificate.values | pick(self.certificate, "growth")
            values["checks"] = [asdict(check) for check in self.verification.checks]
            values["estimates"] = self._estimates(self.certificate)
        return values

    def _estimates(self, certificate: Certificate) -> list[dict[str, Any]]:
        """For each error: three deviations of its estimate, and the bound on the true error."""
        if certificate.peak_gains is None or self.estimate_sd is None:
            return []
        largest = SIGMAS * np.array(self.estimate_sd)
        bounds = certificate.peak_gains @ largest
        columns = self.model.errors, largest, certificate.peak_gains.diagonal(), bounds
        names = "error", "estimate_rad", "peak_gain", "error_rad"
        return [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]


def certify_model(
    model: LinearModel,
    gains: PIGains,
    *,
    envelope: Envelope | None = None,
    g: float | None = None,
    L_d: float | None = None,
    conditions: Sequence[Condition] = (),
    scenario_sha256: str | None = None,
    rates: Sequence[exact_rate.ExactRate] = (),
    boxes: Sequence[lag_box.LagBox] = (),
    estimates: bool = False,
) -> Certification:
    """Certify the rate of gains, and the ultimate radius for a disturbance bound.

    Every inequality of a certificate has been proven; the claims are about 1e-8 weaker than the
    computed values to leave room for the proof. `model` is the model at the trim; an `envelope` of
    the chi/gamma law contains it, and needs `g`. `L_d` (unit of x' per second) bounds the norm of
    the disturbance's derivative. The claim also holds at `conditions`, each (V_a, gamma) with a
    model, and for every mixture of their loops. `rates` and `boxes` go into the certificate. With
    `estimates` the certificate also states the peak gains from estimation errors.
    """
    models = tuple(model for _, model in conditions)
    if any(other.states != model.states for other in models):
        raise InputError("`conditions` must have models with the states of `model`.")
    refused = partial(Certification, status="refused", model=model, gains=gains)
    polytope = None if envelope is None or g is None else jacobian_hull(envelope, g=g)
    if polytope is None:
        loops = loops_of((model, *models), gains)
        # equal loops once, in their order
        loops = loops[np.sort(np.unique(loops, axis=0, return_index=True)[1])]
    else:
        loops = loops_of(polytope.models(), gains)
    vertices = vertex_matrices(model, gains, polytope, models)
    alone = len(loops) == 1
    figures = indicators(loops[0]) if alone else lyapunov.common_Q(loops)
    proven = None if figures.Q is None else exact.provable_rate(vertices, figures.Q)
    if proven is None:
        why = figures.reason or "no inflation of Q could be proven to satisfy its inequality."
        return refused(reason=why)
    ellipsoid, reason = (None, "") if L_d is None else _ellipsoid(model, loops, L_d)
    if reason:
        return refused(reason=reason)
    peaks = None
    if estimates:
        trim = vertex_matrices(model, gains, None)[0]
        peaks = estimate_gains(trim, model, gains, proven[0], rate=proven[1]).upper * (1.0 + ROOM)
    solvers = {"solver": "Clarabel", "clarabel": version("clarabel")}
    if alone:
        solvers = {"Lyapunov equation": f"numpy {np.__version__}"}
    certificate = Certificate(
        claim=Claim(
            rate=proven[1],
            radius=None if ellipsoid is None else ellipsoid.radius * exact.FACTORS[0],
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
        exact_rates=tuple(rates),
        boxes=tuple(boxes),
        peak_gains=peaks,
    )
    verification = certificate.verify()
    if not verification.valid:
        return refused(reason=verification.reason)
    return Certification(
        status="certified",
        reason="",
        model=model,
        gains=gains,
        certificate=certificate,
        verification=verification,
    )


def _ellipsoid(
    model: LinearModel, loops: FloatArray, L_d: float
) -> tuple[lyapunov.Ellipsoid | None, str]:
    """The invariant ellipsoid of one loop or of several; why there is none."""
    if L_d > MAX_L_D:
        raise InputError(f"`L_d` must be at most {MAX_L_D:g}, got {L_d:g}.")
    E = disturbance_entry(model)
    if len(loops) > 1:
        return lyapunov.common_ellipsoid(loops, E, L_d=L_d)
    # Without slack, rounding alone would make the exact check fail.
    return lyapunov.invariant_ellipsoid(loops[0], E, L_d=L_d, slack=1e-6), ""
