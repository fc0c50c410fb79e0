"""The answer of repeated runs."""

from collections.abc import Mapping
from pathlib import Path

from flighttune.base.words import pick
from flighttune.flight.records.refly import Reflown
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.run import claimed

COLUMNS = columns("run status result")
DIFFERENCE_COLUMNS = columns("run what t recorded reflown", of="differences")


def answer(reflown: Reflown, signals: Mapping[str, Path] | None = None) -> Answer:
    """Each run with its differences; `signals` are files of recorded flights by label."""
    records = [run.record for run in reflown.runs]
    differences = [{"run": r["run"], **other} for r in records for other in r["differences"]]
    # All digits, because users repeat a draw by typing them after --set.
    drawn = [
        {"parameter": key, "value": str(value)} for key, value in reflown.runs[0].drawn.items()
    ]
    around = claimed(reflown.flown.runs if reflown.flown else ())
    versions = reflown.versions.items()
    changed = [f"{name}: {then} then, {now} now" for name, (then, now) in versions]
    equal = sum(run["equal"] for run in records)
    same = f"{equal} of {len(records)} runs are equal to the bit when they are flown again."
    different = [f"{r['run']}: {r['result']}" for r in records if not r["equal"]]
    return Answer(
        lines=[same],
        values={
            **pick(reflown, "equal missing"),
            "versions": {name: {"recorded": then, "now": now} for name, (then, now) in versions},
            **({"signals": signals} if signals else {}),
            **(around.values if reflown.flown else {}),
        },
        tables=[
            Table(COLUMNS, records, f"{reflown.source}, flown again", name="runs"),
            Table(columns("parameter value"), drawn if len(reflown.runs) == 1 else []),
            Table(DIFFERENCE_COLUMNS, differences, "differences"),
        ],
        notes=[*(f"missing: {line}" for line in reflown.missing), *changed, *around.notes],
        findings=[
            *(unmet(f"{reflown.source}: {different[0]}") if different else []),
            *around.findings,
        ],
    )
