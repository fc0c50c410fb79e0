"""The answer of certifying gains."""

from dataclasses import replace
from typing import Any

from flighttune.base.words import pick
from flighttune.control.certificates.make import Certification
from flighttune.control.linear_model import closed_loop
from flighttune.control.margins import loop_margins
from flighttune.control.theory.indicators import indicators
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.certificate import proof_tables, proven_in_words
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.tables import margins_table

ANY_ENVELOPE = (
    "The certificate holds over any envelope: the error dynamics of the exact law are the same "
    "everywhere."
)
INDICATOR_COLUMNS = [Column("units", "units of state"), *columns("R_K I_K E_K spectral_abscissa")]
ESTIMATE_COLUMNS = columns("error estimate_rad peak_gain error_rad", of="estimates")
CERTIFICATE_COLUMNS = columns("in_words rate growth radius L_d largest_factor", of="certificate")


def answer(certification: Certification) -> Answer:
    """Indicators, eigenvalues, margins and certificate; a failure without a certificate."""
    loop, values, proven = certification.indicators, certification.values, certification.certificate
    units = indicators_by_units(certification)
    poles = [{"real": pole.real, "imaginary": pole.imag} for pole in loop.eigenvalues]
    why = certification.reason if loop.status == "stable" else loop.reason
    factor = {"largest_factor": certification.largest_factor}
    title = f"{certification.name}: {loop.status}"
    return Answer(
        values={
            **pick(loop, "status reason R_K I_K E_K scaling spectral_abscissa"),
            "eigenvalues": [list(pole.values()) for pole in poles],
            "Q": loop.Q,
            "scaled": {key: units[1][key] for key in ("R_K", "I_K", "scaling")}
            if units[1:]
            else None,
            "gains": certification.name,
            **certification.gains.as_lists(),
            "certificate": values,
            "sentence": proven and proven.sentence,
            "envelope": {"R_K": values["rate"], **factor} if certification.over_envelope else None,
        },
        tables=[
            Table(INDICATOR_COLUMNS, units, title),
            margins_table(loop_margins(certification.model, certification.gains)),
            Table(
                ESTIMATE_COLUMNS,
                values["estimates"],
                f"estimates of grade {certification.navigation}",
            ),
            Table(columns("real imaginary", of="eigenvalues"), poles, "eigenvalues", aside=True),
            Table(CERTIFICATE_COLUMNS, [{**values, **factor}], "certificate", aside=True),
            *(replace(table, aside=True) for table in proof_tables(values)),
        ],
        lines=proven_in_words(proven) if proven else [f"No certificate: {why}"],
        notes=notes(certification),
        verdict=proven_in_words(proven)[0] if proven else f"No certificate: {why}",
        findings=[] if proven else unmet(f"gains {certification.name}: {why}"),
    )


def indicators_by_units(certification: Certification) -> list[dict[str, Any]]:
    """Indicators in plain units of state, and in the units of the tuning."""
    plain = pick(certification.indicators, "R_K I_K E_K scaling spectral_abscissa")
    rows = [{"units": "plain", **plain}]
    if certification.scaling is not None:
        loop = closed_loop(certification.model, certification.gains)
        scaled = indicators(loop, scaling=certification.scaling)
        rows.append({"units": "scaled by [tuning]", **pick(scaled, "R_K I_K scaling")})
    return rows


def notes(certification: Certification) -> list[str]:
    """Validity, gaps and assumptions of the certificate."""
    certificate = certification.certificate
    everywhere = certification.over_envelope and certification.largest_factor is None
    identified = certificate is not None and certificate.claim.conditions
    told = [ANY_ENVELOPE] if everywhere and not identified else []
    told += filter(None, [certification.absent, certificate and certificate.boxes_note])
    return [*told, *(certificate.assumed if certificate else ())]
