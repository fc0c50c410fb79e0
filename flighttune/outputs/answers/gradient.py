"""The answer of `flighttune gradient`."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from flighttune.base.words import number, pick
from flighttune.flight.gradient import Gradient
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns, measure_words, metric_label

COLUMNS = columns("parameter value slope per_10_percent why", of="gradient")

# Measures with a sentence each.
SENTENCES = 4

HELD = (
    "Limits hold a command for {:.2f} s of the flight; slopes take the samples at limits as fixed."
)


def answer(gradient: Gradient) -> Answer:
    """A table for each measure, with a row for each parameter."""
    rows = [{**x, "per_10_percent": 0.1 * x["slope"] * x["value"]} for x in gradient.slopes]
    titles = {
        name: f"{measure_words(name)}: {number(value)} {unit_of(name)}".strip()
        for name, value in gradient.values.items()
    }
    return Answer(
        lines=[*filter(None, (strongest(name, rows) for name in [*titles][:SENTENCES]))],
        values={"run": gradient.run.label, **pick(gradient, "values slopes at_limits_s")},
        tables=[
            Table(COLUMNS, [row for row in rows if row["measure"] == name], title)
            for name, title in titles.items()
        ],
        notes=[HELD.format(gradient.at_limits_s)] if gradient.at_limits_s else [],
    )


def strongest(measure: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The parameter that moves a measure most; empty if none does."""
    changes = {row["parameter"]: row["per_10_percent"] for row in rows if row["measure"] == measure}
    known = {name: change for name, change in changes.items() if not math.isnan(change)}
    most = max(known, key=lambda name: abs(known[name]), default="")
    if not known.get(most):
        return ""
    change = f"{number(known[most], '.2g')} {unit_of(measure)}".strip()
    return f"{measure_words(measure)}: {most} moves it most, by {change} for +10 %."


def unit_of(measure: str) -> str:
    """The unit in which a name states a measure: radians, unless it ends in ``_deg``."""
    label = metric_label(measure)
    unit = label.unit if label.factor == 1.0 else label.unit.replace("deg", "rad")
    return unit.strip("1")
