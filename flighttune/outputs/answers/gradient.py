"""The answer of `flighttune gradient`."""

from flighttune.base.words import number, pick
from flighttune.flight.gradient import Gradient
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns, measure_words, metric_label

COLUMNS = columns("parameter value slope per_10_percent why", of="gradient")

HELD = (
    "Limits hold a command for {:.2f} s of the flight; slopes take the samples at limits as fixed."
)


def answer(gradient: Gradient) -> Answer:
    """A table for each measure, with a row for each parameter."""
    rows = [{**x, "per_10_percent": 0.1 * x["slope"] * x["value"]} for x in gradient.slopes]
    titles = {
        name: f"{measure_words(name)}: {number(value)} {metric_label(name).unit.strip('1')}".strip()
        for name, value in gradient.values.items()
    }
    return Answer(
        values={"run": gradient.run.label, **pick(gradient, "values slopes at_limits_s")},
        tables=[
            Table(COLUMNS, [row for row in rows if row["measure"] == name], title)
            for name, title in titles.items()
        ],
        notes=[HELD.format(gradient.at_limits_s)] if gradient.at_limits_s else [],
    )
