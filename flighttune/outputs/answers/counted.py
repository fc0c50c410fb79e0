"""The answer of a count."""

from pathlib import Path
from typing import Any

from flighttune.base.units import shown_unit
from flighttune.base.words import pick
from flighttune.claims.counted import Counted
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.early import in_words, most
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns, endings_table
from flighttune.outputs.answers.tables import dispersions_table, gains_table

WIDTH_COLUMNS = columns("signal largest last_quarter end low high unit", of="widths")


def answer(counted: Counted, file: str | Path = "FILE") -> Answer:
    """The counted flights and their claim; a failure without a claim."""
    law = counted.flights.scenario.law_table(counted.flights.gains_name)
    (title, name), n = counted.title, len(counted.scores)
    return Answer(
        values={
            "status": "claimed" if counted.claims else "nothing_claimed",
            **pick(counted.about, "of epsilon predicted_from learned"),
            **pick(counted, "scale readings confidence outside not_completed sentence"),
            "distribution": counted.flights.sentence,
            "gains": counted.flights.gains.as_lists(),
            "law": law.model_dump(mode="json", exclude_none=True),
            "flights": len(counted.scores),
            "nearest_draw": counted.nearest if counted.claims else None,
            **counted.own_values,
            **counted.compiled.values,
        },
        tables=[
            Table(WIDTH_COLUMNS, widths(counted), title, name=name),
            dispersions_table(counted.flights.distribution, counted.flights.flown),
            gains_table("gains", counted.flights.gains),
            endings_table(counted.endings),
        ],
        notes=[
            *counted.flights.gains_notes,
            *counted.own_notes,
            *counted.compiled.notes,
            *nearest(counted, file),
        ],
        lines=[in_words({"": (counted.endings, n)})] if most(counted.endings, n) else [],
        verdict=counted.sentence if counted.claims else "",
        findings=[] if counted.claims else unmet(counted.sentence),
    )


def widths(counted: Counted) -> list[dict[str, Any]]:
    """The claimed bounds of each signal, in the shown units; empty without a claim."""
    if not counted.claims:
        return []
    rows = []
    signals = counted.about.signals.items()
    for (signal, unit), sizes in zip(signals, counted.sizes(), strict=True):
        shown, factor = shown_unit(unit)
        in_unit = {key: float(size) * factor for key, size in sizes.items()}
        rows.append({"signal": signal, **in_unit, "unit": shown})
    return rows


def nearest(counted: Counted, file: str | Path) -> list[str]:
    """The inside flight nearest to leaving, and the command that repeats it."""
    if not counted.claims:
        return []
    seed = counted.about.plan["campaign"]["seed"]
    return [
        f"Of the flights inside, draw {counted.nearest} (seed {seed}) is nearest to leaving: "
        f"flighttune verify {file} --run {counted.nearest}"
    ]
