"""The answer of a comparison."""

from dataclasses import replace

import pandas as pd

from flighttune.base.units import shown_unit
from flighttune.base.words import listed, pick
from flighttune.gaps.compare import Comparison
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns, measure_words

COMPARED = columns("pair channel metric unit a b diff better", of="compared")
PAIR_COLUMNS = columns(
    "run_a run_b source_a source_b compared_s max_distance_m max_distance_at_s better.a better.b",
    of="pairs",
)


# Measures that a terminal shows of each channel, as after `fly`.
SHOWN = "MO_rad", "settling_s", "ITAE"

# Pairs that are judged in a sentence each, and worse measures that it names.
JUDGED, NAMED = 3, 3

# Longest text of a setting that differs, characters.
LONGEST = 40


def answer(comparison: Comparison) -> Answer:
    """Pairs and metrics side by side; exit status 2 if the runs cannot be compared."""
    differs = dict.fromkeys(
        f"A and B differ in `{key}`{different(first, second)}."
        for pair in comparison.pairs
        for key, (first, second) in sorted(pair.differs.items())
    )
    metrics = comparison.metrics
    flown = metrics[metrics["name"].isin(SHOWN)]
    return Answer(
        values={
            **pick(comparison, "comparable reason"),
            "metrics": comparison.metrics.to_dict(orient="records"),
            "max_distance_m": comparison.max_distance,
            **pick(comparison, "unpaired missing"),
        },
        lines=verdicts(comparison),
        changed=[
            *differs,
            *(f"Missing: {line}." for line in comparison.missing),
            *(f"No partner: {line}." for line in comparison.unpaired),
        ],
        tables=[
            comparison_table("", flown if len(flown) else metrics),
            pairs_table(comparison),
            replace(comparison_table("metrics", metrics), aside=True),
        ],
        notes=comparison.gains_notes,
        findings=unmet(comparison.reason, 2),
    )


def verdicts(comparison: Comparison) -> list[str]:
    """A sentence on each of the first pairs."""
    return [judged(comparison, place) for place in range(len(comparison.pairs[:JUDGED]))]


def judged(comparison: Comparison, place: int) -> str:
    """Which run of a pair is better, in how many measures, and where it is worse."""
    pair, metrics = comparison.pairs[place], comparison.metrics
    rows = metrics[(metrics["pair"] == place) & metrics["better"].isin(["a", "b"])]
    names = {"a": "A", "b": "B"}
    who = {"a": pair.a.provenance.gains_name, "b": pair.b.provenance.gains_name}
    if who["a"] == who["b"]:
        who = {"a": pair.source_a, "b": pair.source_b}
    first, second = pair.a.provenance.plant, pair.b.provenance.plant
    where = f"On {first}" if first == second else f"On {first} and {second}"
    counts = {side: int((rows["better"] == side).sum()) for side in ("a", "b")}
    better = max(counts, key=lambda side: counts[side])
    other = "a" if better == "b" else "b"
    if counts[better] == counts[other]:
        return f"{where} A and B are each better in {counts['a']} of {len(rows)} measures."
    worse = rows[rows["better"] == other]
    keys = [f"{row['channel']}.{row['name']}" for row in worse.to_dict("records")]
    named = [measure_words(key) for key in keys[:NAMED]]
    if others := len(keys) - NAMED if keys[NAMED:] else 0:
        named.append(f"{others} more")
    more = f": {listed(named)}" if keys else ""
    return (
        f"{where} {names[better]} ({who[better]}) is better in {counts[better]} of {len(rows)} "
        f"measures, {names[other]} ({who[other]}) in {counts[other]}{more}."
    )


def different(first: object, second: object) -> str:
    """Two values of a setting in words; empty if they are too long for a line."""
    words = f" ({first} and {second})"
    return "" if len(words) > LONGEST else words


def comparison_table(title: str, metrics: pd.DataFrame) -> Table:
    """Metrics of pairs side by side, from rows of `Comparison.metrics`; angles in degrees."""
    records = []
    for row in metrics.to_dict(orient="records"):
        unit, factor = shown_unit(str(row["unit"]))
        records.append(
            {
                "pair": paired(str(row["run_a"]), str(row["run_b"])),
                "channel": row["channel"],
                "metric": row["name"].removesuffix("_rad"),
                "unit": unit,
                **{key: row[key] * factor for key in ("a", "b", "diff")},
                "better": {"a": "A", "b": "B"}.get(str(row["better"]), row["better"]),
            }
        )
    return Table(title=title, columns=COMPARED, records=records, grouped=True)


def paired(first: str, second: str) -> str:
    """Two runs in a column; their plant once if it is the same."""
    (plant, _, a), (other, _, b) = first.partition(" / "), second.partition(" / ")
    return f"{plant}: {a} | {b}" if plant == other and a and b else f"{first} | {second}"


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
