"""Certificates as JSON: written whole or not at all, and read strictly."""

import json
import re
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flighttune.certificates.certificate import Certificate, Claim
from flighttune.control.envelope import Envelope, JacobianHull
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError
from flighttune.mistakes import abridged, first_mistake
from flighttune.quantities import Matrix
from flighttune.table_file import json_tables
from flighttune.whole_file import write_text

FORMAT = "flighttune certificate 1"
"""Readers refuse what they do not know."""

MAX_CONDITIONS = 1000

UNITS = {
    "rate_per_s": "1/s: decay of s' Q s, s = (rates of the states, errors); its norm: half of it",
    "radius": "norm of s: states' units per second and errors' units (rad/s and rad)",
    "disturbance_rate_bound": "norm of the disturbance's derivative: states' units per second^2",
    "entries": "a, b1, b2, b3 of the chi/gamma law's Jacobians, over the factor's unit",
}

KEYS = {
    **dict.fromkeys(("V_a", "gamma", "phi", "n_z"), "claim.envelope"),
    **{name: f"model.{name}" for name in ("A", "B", "C", "states", "inputs", "errors")},
    **{name: f"gains.{name}" for name in ("K_P", "K_I")},
    **{name: f"evidence.{name}" for name in ("Q", "W")},
    **{name: f"evidence.polytope.{name}" for name in ("factor", "lower", "upper")},
    "rate": "claim.rate_per_s",
    "radius": "claim.radius",
    "L_d": "claim.disturbance_rate_bound",
    "envelope": "claim.envelope",
    "g": "claim.envelope.g_mps2",
    "conditions": "claim.conditions",
    "multiplier": "evidence.multiplier_per_s",
    "hull": "evidence.polytope",
}
"""Keys of a certificate file by the names that `Certificate` has in its messages."""

Tables = dict[str, Any]
Ends: TypeAlias = Annotated[tuple[float, float], Field(strict=False)]  # a list in JSON


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class _Envelope(_Table):
    V_a_mps: Ends
    gamma_rad: Ends
    phi_rad: Ends
    n_z: Ends
    g_mps2: float


class _Condition(_Table):
    V_a_mps: float
    gamma_rad: float


class _Claim(_Table):
    rate_per_s: float
    radius: float | None = None
    disturbance_rate_bound: float | None = None
    envelope: _Envelope | None = None
    conditions: Annotated[list[_Condition], Field(max_length=MAX_CONDITIONS)] | None = None
    holds: str | None = None


class _Matrices(_Table):
    A: Matrix
    B: Matrix
    C: Matrix


class _Model(_Matrices):
    states: list[str]
    inputs: list[str]
    errors: list[str]


class _Gains(_Table):
    K_P: Matrix
    K_I: Matrix


class _Polytope(_Table):
    factor: Ends
    lower: list[float]
    upper: list[float]


class _Evidence(_Table):
    Q: Matrix
    W: Matrix | None = None
    multiplier_per_s: float | None = None
    polytope: _Polytope | None = None


class _File(_Table):
    format: str
    claim: _Claim
    units: dict[str, str]
    model: _Model
    models: list[_Matrices] | None = None
    gains: _Gains
    evidence: _Evidence
    made_with: dict[str, str] = Field(default_factory=dict)
    scenario_sha256: Annotated[str, Field(pattern="^[0-9a-f]{64}$")] | None = None


def save_certificate(certificate: Certificate, path: str | Path) -> None:
    """Write a certificate as JSON, under a temporary name until it is whole.

    Parameters
    ----------
    certificate : Certificate
    path : path-like
        File to write or replace; its folder is made where there is none.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    path = Path(path)
    text = json.dumps(certificate_tables(certificate), indent=2, allow_nan=False) + "\n"
    write_text(path, text)


def load_certificate(path: str | Path) -> Certificate:
    """Read a certificate; nothing in it is trusted before `verify` has checked it.

    Raises
    ------
    InputError
        If the file cannot be read or is not a certificate; the message names file and key.
    """
    tables = json_tables(Path(path))
    try:
        return certificate_from(tables)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def certificate_tables(certificate: Certificate) -> Tables:
    """The JSON object of a certificate; floats in it read back to the same bits."""
    claim, model, gains = certificate.claim, certificate.model, certificate.gains
    tables: Tables = {
        "format": FORMAT,
        "claim": {
            "rate_per_s": claim.rate,
            "radius": claim.radius,
            "disturbance_rate_bound": claim.L_d,
            "envelope": None,
        },
        "units": UNITS,
        "model": _matrices(model)
        | {name: list(getattr(model, name)) for name in ("states", "inputs", "errors")},
        "gains": {"K_P": gains.K_P.tolist(), "K_I": gains.K_I.tolist()},
        "evidence": {
            "Q": certificate.Q.tolist(),
            "W": None if certificate.W is None else certificate.W.tolist(),
            "multiplier_per_s": certificate.multiplier,
            "polytope": None,
        },
        "made_with": dict(certificate.made_with),
        "scenario_sha256": certificate.scenario_sha256,
    }
    if claim.envelope is not None and certificate.hull is not None:
        tables["claim"]["envelope"] = {
            "V_a_mps": list(claim.envelope.V_a),
            "gamma_rad": list(claim.envelope.gamma),
            "phi_rad": list(claim.envelope.phi),
            "n_z": list(claim.envelope.n_z),
            "g_mps2": claim.g,
        }
        tables["evidence"]["polytope"] = {
            "factor": list(certificate.hull.factor),
            "lower": certificate.hull.lower.tolist(),
            "upper": certificate.hull.upper.tolist(),
        }
    if claim.conditions:
        tables["claim"]["conditions"] = [
            {"V_a_mps": V_a, "gamma_rad": gamma} for V_a, gamma in claim.conditions
        ]
        tables["claim"]["holds"] = claim.place
        tables["models"] = [_matrices(model) for model in certificate.models]
    return tables


def _matrices(model: LinearModel) -> Tables:
    return {name: getattr(model, name).tolist() for name in ("A", "B", "C")}


def certificate_from(tables: Any) -> Certificate:
    """A certificate from the object of its JSON file."""
    stated = tables.get("format") if isinstance(tables, dict) else None
    if stated != FORMAT:
        raise InputError(f"`format` must be {FORMAT!r}, got {abridged(stated)}.")
    try:
        file = _File.model_validate(tables)
    except ValidationError as error:
        raise InputError(first_mistake(error)) from error
    if file.units != UNITS:
        raise InputError("`units` must be those of this format: nothing is converted.")
    evidence = file.evidence
    try:
        return Certificate(
            claim=_claim(file.claim),
            model=_linear_model(file.model, file.model),
            gains=PIGains(
                K_P=np.array(file.gains.K_P),
                K_I=np.array(file.gains.K_I),
                inputs=tuple(file.model.inputs),
                errors=tuple(file.model.errors),
            ),
            Q=np.array(evidence.Q),
            W=None if evidence.W is None else np.array(evidence.W),
            multiplier=evidence.multiplier_per_s,
            hull=None if evidence.polytope is None else _hull(evidence.polytope),
            models=tuple(_linear_model(model, file.model) for model in file.models or ()),
            made_with=file.made_with,
            scenario_sha256=file.scenario_sha256,
        )
    except InputError as error:
        raise InputError(re.sub(r"`(\w+)`", _key_in_file, str(error))) from error


def _key_in_file(name: re.Match[str]) -> str:
    return f"`{KEYS.get(name[1], name[1])}`"


def _claim(table: _Claim) -> Claim:
    envelope = table.envelope
    claim = Claim(
        rate=table.rate_per_s,
        radius=table.radius,
        L_d=table.disturbance_rate_bound,
        envelope=None
        if envelope is None
        else Envelope(
            V_a=envelope.V_a_mps,
            gamma=envelope.gamma_rad,
            phi=envelope.phi_rad,
            n_z=envelope.n_z,
        ),
        g=None if envelope is None else envelope.g_mps2,
        conditions=tuple(
            (condition.V_a_mps, condition.gamma_rad) for condition in table.conditions or ()
        ),
    )
    place = claim.place if claim.conditions else None
    if table.holds != place:
        raise InputError(f"`claim.holds` must be {place!r}, as the conditions say.")
    return claim


def _linear_model(matrices: _Matrices, names: _Model) -> LinearModel:
    return LinearModel(
        A=np.array(matrices.A),
        B=np.array(matrices.B),
        C=np.array(matrices.C),
        states=tuple(names.states),
        inputs=tuple(names.inputs),
        errors=tuple(names.errors),
    )


def _hull(table: _Polytope) -> JacobianHull:
    return JacobianHull(
        factor=table.factor, lower=np.array(table.lower), upper=np.array(table.upper)
    )
