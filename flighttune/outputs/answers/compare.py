"""The answer of a comparison."""

import pandas as pd

from flighttune.base.units import shown_unit
from flighttune.base.words import pick
from flighttune.gaps.compare import Comparison
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns

COMPARED = columns("pair channel metric unit a b diff better", of="compared")
PAIR_COLUMNS = columns(
    "run_a run_b source_a source_b compared_s max_distance_m max_distance_at_s better.a better.b",
    of="pairs",
)


def answer(comparison: Comparison) -> Answer:
    """Pairs and metrics side by side; exit status 2 if the runs cannot be compared."""
    differs = {
        f"not the same: {key}: {first} and {second}"
        for pair in comparison.pairs
        for key, (first, second) in pair.differs.items()
    }
    return Answer(
        values={
            **pick(comparison, "comparable reason"),
            "metrics": comparison.metrics.to_dict(orient="records"),
            "max_distance_m": comparison.max_distance,
            **pick(comparison, "unpaired missing"),
        },
        tables=[pairs_table(comparison), comparison_table("metrics", comparison.metrics)],
        notes=[
            *comparison.gains_notes,
            *sorted(differs),
            *(f"missing: {line}" for line in comparison.missing),
            *(f"no partner: {line}" for line in comparison.unpaired),
        ],
        failure=comparison.reason,
        status=2,
    )


def comparison_table(title: str, metrics: pd.DataFrame) -> Table:
    """Metrics of pairs side by side, from rows of `Comparison.metrics`; angles in degrees."""
    records = []
    for row in metrics.to_dict(orient="records"):
        unit, factor = shown_unit(str(row["unit"]))
        records.append(
            {
                "pair": f"{row['run_a']} | {row['run_b']}",
                "channel": row["channel"],
                "metric": row["name"].removesuffix("_rad"),
                "unit": unit,
                **{key: row[key] * factor for key in ("a", "b", "diff")},
                "better": {"a": "A", "b": "B"}.get(str(row["better"]), row["better"]),
            }
        )
    return Table(title=title, columns=COMPARED, records=records, grouped=True)


def pairs_table(comparison: Comparison) -> Table:
    """The compared runs, their distance, and the number of metrics in which each is better."""
    better = comparison.metrics.groupby(["pair", "better"]).size()
    records = [
        {
            "run_a": pair.a.label,
            "run_b": pair.b.label,
            **pick(pair, "source_a source_b differs"),
            "status_a": pair.a.status,
            "status_b": pair.b.status,
            "compared_s": pair.a.duration,
            "max_distance_m": pair.max_distance,
            "max_distance_at_s": pair.t_max_distance,
            "better": {side: int(better.get((place, side), 0)) for side in ("a", "b", "same")},
        }
        for place, pair in enumerate(comparison.pairs)
    ]
    return Table(title="pairs", name="pairs", columns=PAIR_COLUMNS, records=records)
