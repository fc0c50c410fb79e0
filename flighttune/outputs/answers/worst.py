"""The answer of a search for the worst flight."""

import math

from flighttune.base.words import pick
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns, endings_table
from flighttune.studies.worst import BAND, TUBE, WorstFlight

WORST_COLUMNS = columns(
    "plant gains value first distance radius status ratio.chi ratio.gamma ratio_of_search.chi "
    "ratio_of_search.gamma family",
    of="worst",
)


def answer(worst: WorstFlight) -> Answer:
    """The flight with its drawn values; a failure if it contradicts the proof of a tube."""
    values = pick(worst, "metric value first flights family distance radius status missed plant")
    values |= pick(worst, "gains drawn ratio ratio_of_search") | worst.compiled.values
    drawn = [
        # A seed is not a quantity: a repeated flight needs all its digits.
        {"key": key, "value": value if isinstance(value, float) else str(value)}
        for key, value in worst.drawn.items()
    ]
    near = f"the worst flight ended early ({worst.status.replace('_', ' ')})"
    if math.isfinite(worst.value):
        near = f"the worst flight uses {worst.value:.4g} of the {worst.metric}"
    notes = [*worst.scenario.gains_notes(worst.plant, worst.gains)]
    notes += worst.compiled.notes
    notes += [near] * (worst.metric in (TUBE, BAND) and not worst.contradicts)
    return Answer(
        values=values,
        tables=[
            Table(WORST_COLUMNS, [values], f"worst {worst.metric} in {worst.flights} flights"),
            Table(columns("key value"), drawn, "drawn"),
            endings_table(worst.endings),
        ],
        notes=notes,
        verdict="" if worst.contradicts else worst.missed or "no requirement is missed",
        findings=unmet(f"{near}: this contradicts its proof") if worst.contradicts else [],
    )
