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
        values=values,
        tables=[
            Table(columns("rate radius L_d"), [values], "certificate"),
            *proof_tables(values),
            gains_table("gains", certificate.gains),
        ],
        notes=[certificate.in_words, *filter(None, [certificate.boxes_note]), *certificate.assumed],
        verdict=certificate.sentence,
    )


def proof_tables(values: Mapping[str, Any]) -> list[Table]:
    """The exact rates and the boxes of lags and delays in the values of a certificate."""
    return [
        Table(EXACT_COLUMNS, values["exact_rates"], "exact rates of the norm"),
        Table(BOX_COLUMNS, values["boxes"], "box of lags and delays"),
    ]
