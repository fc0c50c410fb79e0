"""The answer of a certificate."""

from collections.abc import Mapping
from typing import Any

from flighttune.base.words import pick
from flighttune.control.certificates.certificate import Certificate
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.tables import gains_table

EXACT_COLUMNS = columns("loop decay growth true_rate", of="exact_rates")
BOX_COLUMNS = columns("error lag delay rate norm_rate growth", of="lag_boxes")


def answer(certificate: Certificate) -> Answer:
    """The claim with its gains and model."""
    values = {
        **certificate.values,
        **pick(certificate.claim, "envelope g"),
        "sentence": certificate.sentence,
        "gains": pick(
            certificate.gains, "inputs errors K_P K_I" + " feedback" * certificate.gains.feeds_back
        ),
        "model": pick(certificate.model, "states inputs errors A B C"),
    }
    return Answer(
        lines=proven_in_words(certificate),
        values=values,
        tables=[
            Table(columns("rate radius L_d"), [values], "certificate"),
            *proof_tables(values),
            gains_table("gains", certificate.gains),
        ],
        notes=[*filter(None, [certificate.boxes_note]), *certificate.assumed],
        verdict=certificate.sentence,
    )


def proven_in_words(proven: Certificate) -> list[str]:
    """The claim in short: the decay of errors, the meaning of R_K, and what makes it weak."""
    claim = proven.claim
    where = "for every flight of the law" if claim.envelope else "for the linear models"
    where = f"{where} {claim.place}" if claim.envelope or claim.conditions else ""
    of_norm, scope = f"R_K, {claim.rate:.4g} 1/s, is the rate of the squared norm", ""
    if proven.exact_rates:
        rate = proven.rates_values[0]
        said = (
            f"Proven: errors shrink as {rate['growth']:.3g} exp(-{rate['decay']:.4g} t) or faster "
            f"(true rate {rate['true_rate']:.4g} 1/s)"
        )
    else:
        said = f"Proven: errors shrink by exp(-{claim.rate / 2.0:.4g} t) or faster"
        scope = f", up to a factor of {proven.growth:.3g}"
    words = [f"{said}{scope}{f' {where}' if where else ' for the linear model'}. {of_norm}."]
    if proven.in_words != "certified":
        words.append(f"{proven.in_words[0].upper()}{proven.in_words[1:]}.")
    return words


def proof_tables(values: Mapping[str, Any]) -> list[Table]:
    """The exact rates and the boxes of lags and delays in the values of a certificate."""
    return [
        Table(EXACT_COLUMNS, values["exact_rates"], "exact rates of the norm"),
        Table(BOX_COLUMNS, values["boxes"], "box of lags and delays"),
    ]
