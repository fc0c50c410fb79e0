"""The answer of a bound on R_K."""

from flighttune.base.words import pick
from flighttune.control.certificates.bound import RateBound
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns as columns_by

BOUND_COLUMNS = columns_by("I_star R_bound", of="bound")


def answer(bound: RateBound) -> Answer:
    """The bound and its sentence."""
    values = pick(bound, "sentence I_star R_bound")
    return Answer(values=values, tables=[Table(BOUND_COLUMNS, [values])], verdict=bound.sentence)
