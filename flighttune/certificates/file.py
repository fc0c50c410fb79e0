"""Certificates as JSON: written whole or not at all, read with one-line complaints."""

import json
from pathlib import Path
from typing import Any

from flighttune.certificates.certificate import Certificate, Claim
from flighttune.control.envelope import Envelope, JacobianHull
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel
from flighttune.errors import InputError
from flighttune.whole_file import whole_file

FORMAT = "flighttune certificate 1"
"""Readers refuse what they do not know."""

UNITS = {
    "rate_per_s": "1/s: decay of s' Q s, s = (rates of the states, errors); its norm: half of it",
    "radius": "norm of s: states' units per second and errors' units (rad/s and rad)",
    "disturbance_rate_bound": "norm of the disturbance's derivative: states' units per second^2",
    "entries": "a, b1, b2, b3 of the chi/gamma law's Jacobians, over the factor's unit",
}

Tables = dict[str, Any]


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
    with whole_file(path) as part:
        part.write_text(text, encoding="utf-8")


def load_certificate(path: str | Path) -> Certificate:
    """Read a certificate; nothing about it is believed before `verify` has checked it.

    Raises
    ------
    InputError
        If the file cannot be read or is not a certificate; the message names file and key.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
        tables = json.loads(text, parse_constant=_no_constant)
    except OSError as error:
        raise InputError(f"{path}: the file must be readable: {error.strerror}.") from error
    except ValueError as error:
        raise InputError(f"{path}: the file must be a JSON certificate: {error}.") from error
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
        tables["models"] = [_matrices(one) for one in certificate.models]
    return tables


def _matrices(model: LinearModel) -> Tables:
    return {name: getattr(model, name).tolist() for name in ("A", "B", "C")}


def certificate_from(tables: Any) -> Certificate:
    """A certificate from the object of its JSON file.

    Raises
    ------
    InputError
        If a key is missing, unknown or impossible; the message names it.
    """
    if not isinstance(tables, dict) or tables.get("format") != FORMAT:
        raise InputError(f"`format` must be {FORMAT!r}.")
    _known(
        tables,
        {"format", "claim", "units", "model", "models", "gains", "evidence", "made_with"}
        | {"scenario_sha256"},
        "",
    )
    claim, model = _table(tables, "claim"), _table(tables, "model")
    gains, evidence = _table(tables, "gains"), _table(tables, "evidence")
    if tables.get("units") != UNITS:
        raise InputError("`units` must be those of this format: nothing is converted.")
    _known(
        claim,
        {"rate_per_s", "radius", "disturbance_rate_bound", "envelope", "conditions", "holds"},
        "claim.",
    )
    _known(model, {"A", "B", "C", "states", "inputs", "errors"}, "model.")
    _known(gains, {"K_P", "K_I"}, "gains.")
    _known(evidence, {"Q", "W", "multiplier_per_s", "polytope"}, "evidence.")
    try:
        names = {key: tuple(map(str, model[key])) for key in ("states", "inputs", "errors")}
        return Certificate(
            claim=_claim(claim),
            model=LinearModel(A=model["A"], B=model["B"], C=model["C"], **names),
            gains=PIGains(
                K_P=gains["K_P"],
                K_I=gains["K_I"],
                inputs=names["inputs"],
                errors=names["errors"],
            ),
            Q=evidence["Q"],
            W=evidence.get("W"),
            multiplier=_optional("evidence.multiplier_per_s", evidence.get("multiplier_per_s")),
            hull=_hull(evidence.get("polytope")),
            models=tuple(_model(one, names) for one in _list("models", tables.get("models"))),
            made_with={str(key): str(name) for key, name in tables.get("made_with", {}).items()},
            scenario_sha256=tables.get("scenario_sha256"),
        )
    except KeyError as error:
        raise InputError(f"`{error.args[0]}` must be given.") from error
    except InputError:
        raise
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"the values must be numbers, lists and names: {error}.") from error


def _claim(tables: Tables) -> Claim:
    envelope = tables.get("envelope")
    if envelope is not None:
        _known(envelope, {"V_a_mps", "gamma_rad", "phi_rad", "n_z", "g_mps2"}, "claim.envelope.")
    claim = Claim(
        rate=_number("claim.rate_per_s", tables["rate_per_s"]),
        radius=_optional("claim.radius", tables.get("radius")),
        L_d=_optional("claim.disturbance_rate_bound", tables.get("disturbance_rate_bound")),
        envelope=None
        if envelope is None
        else Envelope(
            V_a=_range("claim.envelope.V_a_mps", envelope["V_a_mps"]),
            gamma=_range("claim.envelope.gamma_rad", envelope["gamma_rad"]),
            phi=_range("claim.envelope.phi_rad", envelope["phi_rad"]),
            n_z=_range("claim.envelope.n_z", envelope["n_z"]),
        ),
        g=None if envelope is None else _number("claim.envelope.g_mps2", envelope["g_mps2"]),
        conditions=tuple(
            _condition(one) for one in _list("claim.conditions", tables.get("conditions"))
        ),
    )
    place = claim.place if claim.conditions else None
    if tables.get("holds") != place:
        raise InputError(f"`claim.holds` must be {place!r}, as the conditions say.")
    return claim


def _condition(tables: Any) -> tuple[float, float]:
    _known(tables, {"V_a_mps", "gamma_rad"}, "claim.conditions[].")
    return (
        _number("claim.conditions[].V_a_mps", tables["V_a_mps"]),
        _number("claim.conditions[].gamma_rad", tables["gamma_rad"]),
    )


def _model(tables: Any, names: dict[str, tuple[str, ...]]) -> LinearModel:
    _known(tables, {"A", "B", "C"}, "models[].")
    return LinearModel(A=tables["A"], B=tables["B"], C=tables["C"], **names)


def _hull(tables: Tables | None) -> JacobianHull | None:
    if tables is None:
        return None
    _known(tables, {"factor", "lower", "upper"}, "evidence.polytope.")
    return JacobianHull(
        factor=_range("evidence.polytope.factor", tables["factor"]),
        lower=tables["lower"],
        upper=tables["upper"],
    )


def _table(tables: Tables, key: str) -> Tables:
    table = tables.get(key)
    if not isinstance(table, dict):
        raise InputError(f"`{key}` must be an object.")
    return table


def _list(key: str, values: Any) -> list[Any]:
    """The list of a key; empty where it is not given."""
    if not isinstance(values, list | None):
        raise InputError(f"`{key}` must be a list, got {values!r}.")
    return values or []


def _known(tables: Any, keys: set[str], where: str) -> None:
    if not isinstance(tables, dict):
        raise InputError(f"`{where.rstrip('.')}` must be an object.")
    unknown = sorted(set(tables) - keys)
    if unknown:
        raise InputError(f"`{where}{unknown[0]}` must not be there: the key is unknown.")


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"`{key}` must be a number, got {value!r}.")
    return float(value)


def _range(key: str, values: Any) -> tuple[float, float]:
    if not isinstance(values, list) or len(values) != 2:
        raise InputError(f"`{key}` must be [low, high], got {values!r}.")
    return _number(key, values[0]), _number(key, values[1])


def _optional(key: str, value: Any) -> float | None:
    return None if value is None else _number(key, value)


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number")
