"""What a bound on R_K says."""

from flighttune.base.answers.answer import Answer, Table
from flighttune.base.answers.labels import columns as columns_by
from flighttune.base.words import pick
from flighttune.control.certificates.bound import RateBound

BOUND_COLUMNS = columns_by("I_star R_bound", of="bound")


def answer(bound: RateBound) -> Answer:
    """The bound and its sentence."""
    values = pick(bound, "sentence I_star R_bound")
    return Answer(values=values, tables=[Table(BOUND_COLUMNS, [values])], verdict=bound.sentence)
