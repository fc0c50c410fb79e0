"""A claim about gains, checked from its numbers alone: no solver, and no trust in its maker."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_positive, set_read_only
from flighttune.base.errors import InputError
from flighttune.base.files.claim import read, write
from flighttune.base.files.table import STRICT
from flighttune.base.words import listed, pick, quoted
from flighttune.control.certificates.estimates import estimate_gains, gains_checks
from flighttune.control.certificates.exact_rate import SAME_MODEL, ExactRate, lag_units
from flighttune.control.certificates.lag_box import NOT_ENCLOSED, LagBox, boxes_checks
from flighttune.control.gains import ERRORS_WITH_AIRSPEED, PIGains
from flighttune.control.linear_model import (
    ENTRIES,
    LAW_NAMES,
    Envelope,
    JacobianHull,
    LinearModel,
    closed_loop,
    disturbance_entry,
    inner_feedback,
    kinematic_model,
)
from flighttune.control.theory import exact as rational
from flighttune.control.theory.decay import true_rate

KINDS = "states", "inputs", "errors"

# Longest useful time for a proven rate to halve errors, s: no leg or turn lasts longer.
MAX_HALVING_S = 60.0

# Largest growth of an error before it decays: 3 deg then become 90 deg, and no linear model holds.
MAX_GROWTH = 30.0

# Largest I_K, s^2: the disturbance of the paper, 0.015 rad/s^2, is then bounded by a half turn.
MAX_I_K = 200.0

# The exact check takes seconds at this size, and grows with its fourth power.
MAX_STATES = 24


@dataclass(frozen=True, slots=True, kw_only=True)
class Claim:
    """Claim about ``s' = A_K s + E v`` with s = (x', e), v the disturbance's derivative.

    Attributes
    ----------
    rate : float, 1/s
        With v = 0 some quadratic form of s decays at this rate or faster, and the norm at half of
        it.
    radius : float, unit of s, or None
        With ``||v|| <= L_d`` the norm of s is ultimately at most this.
    L_d : float, unit of x' per second, or None
        Goes with `radius`.
    envelope : Envelope or None
        Ranges of the Jacobian of the chi/gamma law at every instant; None: the model alone.
    g : float, m/s^2, or None
        Acceleration of gravity; goes with `envelope`.
    conditions : tuple of (V_a, gamma), m/s and rad
        Further conditions of the claim, each with its own model; every mixture of their loops is
        included. Empty: the model alone, or the envelope.
    """

    rate: float
    radius: float | None = None
    L_d: float | None = None
    envelope: Envelope | None = None
    g: float | None = None
    conditions: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        check_positive(rate=self.rate, radius=self.radius, L_d=self.L_d, g=self.g)
        for name, other in (("radius", "L_d"), ("envelope", "g")):
            if (getattr(self, name) is None) != (getattr(self, other) is None):
                raise InputError(f"`{name}` and `{other}` must be given together.")
        if not all(V_a > 0.0 and math.isfinite(V_a + gamma) for V_a, gamma in self.conditions):
            raise InputError("`conditions` must be positive airspeeds and finite angles.")
        if self.conditions and self.envelope is not None:
            raise InputError("`conditions` must be empty with `envelope`.")

    @property
    def place(self) -> str:
        """The validity of the claim, in words."""
        if self.envelope is not None:
            return f"over the envelope {self.envelope}"
        if not self.conditions:
            return "at the trim"
        speeds, climbs = zip(*self.conditions, strict=True)
        return (
            f"at {len(self.conditions)} conditions, which its maker states as V_a {min(speeds):g}.."
            f"{max(speeds):g} m/s and gamma {math.degrees(min(climbs)):g}.."
            f"{math.degrees(max(climbs)):g} deg, and for every mixture of their loops"
        )


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certificate(Answering):
    """A claim about gains and the matrices that prove it; also the format of its file.

    Attributes
    ----------
    claim : Claim
    model : LinearModel
        The linear model at the trim, n states and p errors.
    gains : PIGains
    Q : ndarray, shape (n + p, n + p), s
        Proves the rate.
    W : ndarray, shape (n + p, n + p), square of the unit of s, or None
        Proves the radius, with `multiplier`.
    multiplier : float, 1/s, or None
    hull : JacobianHull or None
        Contains the Jacobians of the envelope.
    models : tuple of LinearModel
        Models of the claim's conditions, in their order.
    made_with : mapping of str to str
        Versions of flighttune and of the solvers: a note of its maker, which nothing reads.
    scenario_sha256 : str or None
        Hash of the scenario file the gains belong to, a note likewise.
    files : mapping of str to str
        SHA-256, by name, of the identified model from which `model` was taken; empty for other
        models and in files of version 0.3.0.
    exact_rates : tuple of ExactRate
        The largest rates that a norm proves for the loop at the trim, first continuous, then
        sampled. Empty over an envelope and at other conditions.
    boxes : tuple of LagBox
        Rates of each channel for ranges of its lag and delay; empty if not requested, and in files
        of version 0.3.0.
    peak_gains : ndarray, shape (p, p), or None
        Largest true tracking error (rows) for estimation errors of at most 1 (columns), in the
        units of the errors, at the trim and without a disturbance; None if not requested, and in
        files of version 0.4.0.
    assumed : tuple of str
        Assumptions of the identified model, one sentence each: a note of its maker.

    Examples
    --------
    >>> certificate = ft.certify("paper", "paper").certificate
    >>> round(certificate.claim.rate, 4), certificate.Q.shape
    (0.4599, (4, 4))
    """

    claim: Claim
    model: LinearModel
    gains: PIGains
    Q: FloatArray
    W: FloatArray | None = None
    multiplier: float | None = None
    hull: JacobianHull | None = None
    models: tuple[LinearModel, ...] = ()
    made_with: Mapping[str, str] = field(default_factory=dict)
    scenario_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None
    files: Mapping[str, str] = field(default_factory=dict)
    exact_rates: tuple[ExactRate, ...] = ()
    boxes: tuple[LagBox, ...] = ()
    peak_gains: FloatArray | None = None
    assumed: tuple[str, ...] = ()

    kind: ClassVar[Literal["proven"]] = "proven"

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune certificate 4"
    UNSEALED: ClassVar[str] = "flighttune certificate 3"
    UNITS: ClassVar[Mapping[str, str]] = {
        "angles and times": "rad and s; V_a in m/s, g in m/s^2",
        "exact_rates": "1/s and s: the norm sqrt(s' Q s) of s over `units` decays at `rate`",
        "claim.rate": "1/s: decay of s' Q s, s = (rates of the states, errors); its norm: half",
        "claim.radius": "norm of s: states' units per second and errors' units (rad/s and rad)",
        "claim.L_d": "norm of the disturbance's derivative: states' units per second^2",
        "claim.conditions": "V_a and gamma of each of `models`",
        "peak_gains": "largest true error of each row for an error of 1 of each column's estimate",
        "hull": "ranges of a, b1, b2, b3 of the chi/gamma law's Jacobians, over those of `factor`",
    }

    def __post_init__(self) -> None:
        model, claim = self.model, self.claim
        model.check_channels(self.gains)
        if len(model.states) > MAX_STATES:
            raise InputError(f"`states` must be at most {MAX_STATES}, got {len(model.states)}.")
        for name, names, law in zip(KINDS, model.names, LAW_NAMES, strict=True):
            if claim.envelope is not None and names != law:
                raise InputError(
                    f"`{name}` must be {', '.join(law)} with an `envelope`, the names of the law, "
                    f"got {', '.join(names)}."
                )
        n, _, p = model.shape
        set_read_only(self, Q=(n + p, n + p), W=(n + p, n + p), peak_gains=(p, p))
        if len({x is None for x in (claim.radius, self.W, self.multiplier)}) > 1:
            raise InputError("`radius`, `W` and `multiplier` must be given together.")
        if self.multiplier is not None and not math.isfinite(self.multiplier):
            raise InputError(f"`multiplier` must be finite, got {self.multiplier}.")
        if (claim.envelope is None) != (self.hull is None):
            raise InputError("`envelope` and `hull` must be given together.")
        if len(self.models) != len(claim.conditions):
            raise InputError(
                f"`models` must be one a condition, got {len(self.models)} models and "
                f"{len(claim.conditions)} conditions."
            )
        if self.exact_rates and not self._at_trim:
            raise InputError("`exact_rates` must be empty with an `envelope` or `conditions`.")
        if self.boxes and claim.envelope is not None:
            raise InputError("`boxes` must be empty with an `envelope`.")
        sampled = [rate.sampling is not None for rate in self.exact_rates]
        if sampled not in ([], [False], [True], [False, True]):
            raise InputError(
                "`exact_rates` must be of the continuous loop, then of the sampled one, each at "
                f"most once, got {len(sampled)}."
            )
        if any(other.names != model.names for other in self.models):
            raise InputError("`models` must have the states, inputs and errors of `model`.")
        # A plain dict, because a read-only view cannot be pickled and worker processes return
        # certificates.
        object.__setattr__(self, "made_with", dict(self.made_with))

    @property
    def _at_trim(self) -> bool:
        """Whether the claim is about the loop of `model` alone."""
        return self.claim.envelope is None and not self.claim.conditions

    @property
    def growth(self) -> float:
        """Largest factor by which the norm of s may grow before it decays."""
        return math.sqrt(float(np.linalg.cond(self.Q)))

    @property
    def values(self) -> dict[str, Any]:
        """The claim with its exact rates and boxes, for a command and a page."""
        claim = self.claim
        return {
            **pick(claim, "rate radius L_d"),
            "holds": claim.place,
            "conditions": [{"V_a_mps": V_a, "gamma_rad": gamma} for V_a, gamma in claim.conditions],
            "exact_rates": self.rates_values,
            "boxes": [box.values(e) for e, box in zip(self.gains.errors, self.boxes, strict=False)],
        }

    @property
    def rates_values(self) -> list[dict[str, Any]]:
        """Loop, rate, growth and true rate of each exact rate."""
        return [proven.values(self.model, self.gains) for proven in self.exact_rates]

    @property
    def boxes_note(self) -> str:
        """The limits of the boxes, and the rate of the identified models; empty without boxes."""
        if not self.boxes or not self.models:
            return NOT_ENCLOSED * bool(self.boxes)
        slowest = min(true_rate(closed_loop(model, self.gains)) for model in self.models)
        return (
            f"{NOT_ENCLOSED} The slowest of the {len(self.models)} identified models has "
            f"eigenvalues that decay at {slowest:.4g} 1/s."
        )

    @property
    def in_words(self) -> str:
        """``certified``, with a warning if the certificate is too weak to be useful."""
        # The norm decays at half the rate of its square, or at the exact rate of the loop.
        norm_rate, growth = self.claim.rate / 2.0, self.growth
        if self.exact_rates:
            exact_rate = self.exact_rates[0]
            norm_rate, growth = exact_rate.rate, exact_rate.growth(self.model)
        halving_s = math.log(2.0) / norm_rate
        sigma_min = np.linalg.svd(closed_loop(self.model, self.gains), compute_uv=False)[-1]
        I_K = self.growth**2 / (self.claim.rate * sigma_min) if self._at_trim else 0.0
        worth = []
        if halving_s > MAX_HALVING_S:
            hours = f"{halving_s / 3600.0:.2g} hours"
            lasts = hours if halving_s > 3600.0 else f"{halving_s / 60.0:.2g} minutes"
            worth.append(f"the proven rate halves errors in {lasts}")
        if growth > MAX_GROWTH:
            worth.append(f"an error may first grow {growth:.0f}-fold")
        if I_K > MAX_I_K:
            worth.append(f"I_K of {I_K:.2g} s² is too large to be a useful bound")
        return f"certified, but {listed(worth)}" if worth else "certified"

    @property
    def sentence(self) -> str:
        """The claim in words: its validity, the rate, and the radius under a disturbance."""
        claim = self.claim
        states = f"whose states its maker names {quoted(', '.join(self.model.states))}"
        if claim.envelope is not None:
            where = (
                f"{claim.place}, g {claim.g:g} m/s²: for every flight of the law that stays in it"
            )
        elif claim.conditions:
            where = f"for the linear models, {states}, {claim.place}"
            if g := law_gravity(claim.conditions, self.models):
                where += f" (their entries are those of the law there, with g {g:g} m/s²)"
        else:
            where = f"for the linear model, {states}"
        words = (
            f"{where}: a quadratic form of errors and their rates decays at "
            f"{claim.rate:.6g} 1/s, their norm at half of it"
        )
        for values in self.rates_values:
            words += (
                f"; a norm of the loop ({values['loop']}) decays at "
                f"{values['decay']:.6g} 1/s, with a growth of at most "
                f"{values['growth']:.3g}"
            )
        sampled = any(rate.sampling for rate in self.exact_rates)
        if sampled or (self.exact_rates and any(lag_units(self.model) != 1.0)):
            words += ", where lags and commands count by the rate that they cause"
        for error, box in zip(self.gains.errors, self.boxes, strict=False):
            words += f"; {box.sentence(error)}"
        if self.peak_gains is not None:
            words += "".join(
                f"; estimation errors of at most n cause an error of {error} of at most "
                f"{gain + 0.0005:.3f} n at the trim"
                for error, gain in zip(self.model.errors, self.peak_gains.sum(axis=1), strict=True)
            )
        if claim.radius is None or claim.L_d is None:
            return words
        return (
            f"{words}; under a disturbance whose derivative is at most "
            f"{claim.L_d:.6g} the norm ends up at {claim.radius:.6g} or less"
        )

    def save(self, path: str | Path) -> None:
        """Write the claim with its proof (.json)."""
        write(self, path)

    def verify(self) -> rational.Verification:
        """Check every inequality, in floating point and exactly, from these numbers alone.

        The loops are assembled from the stated models, gains and polytope, so that no other matrix
        needs to be trusted.
        """
        claim, model, hull = self.claim, self.model, self.hull
        checks: list[rational.Check] = []
        if claim.envelope is not None and hull is not None and claim.g is not None:
            checks += coverage_checks(model, claim.envelope, hull, g=claim.g)
        vertices = vertex_matrices(model, self.gains, hull, self.models)
        checks += rational.rate_checks(vertices, self.Q, rate=claim.rate)
        W, multiplier, L_d = self.W, self.multiplier, claim.L_d
        if claim.radius is not None and not (W is None or multiplier is None or L_d is None):
            sizes = {"multiplier": multiplier, "radius": claim.radius, "L_d": L_d}
            checks += rational.radius_checks(vertices, disturbance_entry(model), W, **sizes)
        for proven in self.exact_rates:
            checks += proven.checks(model, self.gains)
        if self.boxes:
            checks += boxes_checks(self.boxes, (model, *self.models), self.gains)
        if self.peak_gains is not None and all(check.exact for check in checks):
            # The rate, which is proven above, bounds what the enclosure leaves out.
            trim = vertex_matrices(model, self.gains, None)[0]
            computed = estimate_gains(trim, model, self.gains, self.Q, rate=claim.rate)
            checks += gains_checks(model.errors, self.peak_gains, computed)
        return rational.Verification.of(checks)


def load_certificate(path: str | Path) -> Certificate:
    """Read a certificate; nothing in it is trusted before `verify` has checked it."""
    return read(path, Certificate)


def law_gravity(
    conditions: Sequence[tuple[float, float]], models: Sequence[LinearModel]
) -> float | None:
    """The g for which models, behind any lags, are the chi/gamma law at (V_a, gamma); or None."""
    g = 0.0
    for (V_a, gamma), model in zip(conditions, models, strict=True):
        p = len(model.errors)
        direct, lagged = (
            dict(zip(names, columns.T, strict=True))
            for names, columns in ((model.inputs, model.B), (model.states, model.A))
        )
        B = np.array([lagged.get(name, direct[name]) for name in direct]).T[:p]
        g = g or -V_a * float(B[0, 0])
        # Another law, or gains that grow with airspeed, have no such g.
        if g <= 0.0 or abs(gamma) >= math.pi / 2.0:
            return None
        law = kinematic_model(V_a=V_a, gamma=gamma, g=g, airspeed=p == len(ERRORS_WITH_AIRSPEED))
        own = model.A[:p, :p], B, model.C
        expected = law.A, law.B, np.eye(p, len(model.states))
        if (model.states[:p], model.inputs) != (law.states, law.inputs) or not all(
            np.allclose(a, b, rtol=SAME_MODEL, atol=SAME_MODEL)
            for a, b in zip(own, expected, strict=True)
        ):
            return None
    return g or None


def vertex_matrices(
    model: LinearModel,
    gains: PIGains,
    hull: JacobianHull | None,
    models: Sequence[LinearModel] = (),
) -> tuple[rational.Rationals, ...]:
    """A_K at every vertex of the polytope, or of the model and `models`, without rounding."""
    # A and B contain the inner feedback of the gains. Equal loops are one vertex.
    K_P, K_I = rational.exact(gains.K_P), rational.exact(gains.K_I)
    nothing = rational.exact(np.zeros((len(model.errors),) * 2))

    def closed(
        A: rational.Rationals, B: rational.Rationals, C: rational.Rationals
    ) -> rational.Rationals:
        return np.block([[A + B @ K_P @ C, B @ K_I], [C, nothing]])

    if hull is not None:
        # A_K is affine in the entries and in the factor, so a proof at the vertices holds inside.
        box = [sorted({Fraction(low), Fraction(high)}) for low, high in _ends(hull)]
        C = rational.exact(model.C)
        return tuple(
            closed(*_jacobians([factor * entry for entry in corner]), C)
            for factor in sorted({Fraction(end) for end in hull.factor})
            for corner in itertools.product(*box)
        )
    # Without this an equal loop would be checked twice.
    distinct: list[rational.Rationals] = []
    for linear in (model, *models):
        k, k_M = map(rational.exact, inner_feedback(linear, gains.feedback))
        A, B, C = map(rational.exact, (linear.A, linear.B, linear.C))
        loop = closed(A - B @ k_M, B * (1 + k), C)
        if not any(np.array_equal(loop, other) for other in distinct):
            distinct.append(loop)
    return tuple(distinct)


def coverage_checks(
    model: LinearModel, envelope: Envelope, hull: JacobianHull, *, g: float
) -> list[rational.Check]:
    """Check that the polytope contains the Jacobians at every condition and of the model."""
    slowest, fastest = (Fraction(V) for V in envelope.V_a)
    rates = Fraction(g) / fastest, Fraction(g) / slowest
    sine_gamma, sine_phi = (
        (rational.sine(low)[0], rational.sine(high)[1])
        for low, high in (envelope.gamma, envelope.phi)
    )
    n_z = Fraction(envelope.n_z[0]), Fraction(envelope.n_z[1])
    # The cosine is smallest at an end of the range; it is 1 if the range contains level flight.
    lowest, highest = zip(*map(rational.cosine, envelope.phi), strict=True)
    level = envelope.phi[0] <= 0.0 <= envelope.phi[1]
    low, high = min(lowest), Fraction(1) if level else max(highest)
    boxes = [sine_gamma, (1 / high**2, 1 / low**2), rational.product(n_z, sine_phi), (low, high)]
    entries = zip(ENTRIES, boxes, _ends(hull), strict=True)
    checks = [_inside(f"{name} of the envelope", box, ends) for name, box, ends in entries]
    return [_inside("g/V of the envelope", rates, hull.factor), *checks, _model_check(model, hull)]


def _ends(hull: JacobianHull) -> list[tuple[float, float]]:
    return list(zip(hull.lower.tolist(), hull.upper.tolist(), strict=True))


def _jacobians(entries: Sequence[Fraction]) -> tuple[rational.Rationals, rational.Rationals]:
    a, b1, b2, b3 = entries
    A, B = rational.exact(np.zeros((2, 2))), rational.exact(np.zeros((2, 2)))
    A[1, 1] = a
    B[0, 0], B[1, 0], B[1, 1] = -b1, b2, -b3
    return A, B


def _inside(name: str, inner: rational.Interval, outer: tuple[float, float]) -> rational.Check:
    margin = min(inner[0] - Fraction(outer[0]), Fraction(outer[1]) - inner[1])
    return rational.margin_check(f"{name} inside [{outer[0]:.6g}, {outer[1]:.6g}]", margin)


def _model_check(model: LinearModel, hull: JacobianHull) -> rational.Check:
    """Checks that the model is the chi/gamma law's, its entries in the polytope for a factor."""
    name = "trim model inside the polytope"
    A, B, C = map(rational.exact, (model.A, model.B, model.C))
    entries = [A[1, 1], -B[0, 0], B[1, 0], -B[1, 1]]
    if not all(map(np.array_equal, (A, B, C), (*_jacobians(entries), rational.identity(2)))):
        return rational.Check(name=name, margin=-np.inf, exact=False)
    low, high = (Fraction(end) for end in hull.factor)
    margin = high - low
    for entry, (lower, upper) in zip(entries, _ends(hull), strict=True):
        # Each inequality, entry <= factor upper and entry >= factor lower, bounds the factor from
        # one side; the sign of the limit says from which side.
        for side, bound in ((1, Fraction(upper)), (-1, -Fraction(lower))):
            limit = side * entry
            if bound > 0:
                low = max(low, limit / bound)
            elif bound < 0:
                high = min(high, limit / bound)
            elif limit > 0:
                margin = min(margin, -limit)
    return rational.margin_check(name, min(margin, high - low))
