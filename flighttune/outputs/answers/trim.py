"""The answer of the steady flights of an aircraft."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

from flighttune.base.words import figures, pick
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.vehicles.trims import Trims

COLUMNS = columns(
    "V_a_mps gamma_deg trim.alpha_deg trim.beta_deg trim.elevator_deg trim.rudder_deg "
    "trim.throttle reason"
)
SPEED_COLUMNS = columns("V_a_mps gamma throttle reason", of="trims")


def answer(trims: Trims, *, every_condition: bool = False) -> Answer:
    """A row for each airspeed, or for every condition."""
    records, columns = trims.records, COLUMNS
    # With one path angle per airspeed the table of all conditions is equally short.
    if not every_condition and len({row["V_a_mps"] for row in records}) < len(records):
        records, columns = list(speeds(records)), SPEED_COLUMNS
    reason = trims.records[0]["reason"]
    failure = f"{trims.aircraft}: no steady flight among {len(trims.records)}: {reason}"
    steady = sum(bool(row["trim"]) for row in trims.records)
    return Answer(
        lines=[f"{steady} of {len(trims.records)} conditions have a steady flight."],
        values={**pick(trims, "aircraft not_compiled"), "trims": trims.records},
        tables=[Table(columns, records, f"{trims.title}: steady flight")],
        notes=[who_flies(trims.not_compiled)],
        findings=[] if any(row["trim"] for row in trims.records) else unmet(failure),
    )


def who_flies(not_compiled: str) -> str:
    """Whether the flights of an aircraft are compiled, or why not, in a sentence."""
    if not_compiled:
        return (
            f"JSBSim flies all flights itself: {not_compiled}. Campaigns, counts and missions then "
            "take 6 to 15 times the processor time, and `flighttune gradient` does not work."
        )
    return "Long flights are compiled."


def speeds(records: Sequence[Mapping[str, Any]]) -> Iterator[dict[str, Any]]:
    """A row for each airspeed: path angles with steady flight, and why others have none."""
    for V_a, group in groupby(records, key=lambda record: record["V_a_mps"]):
        climbs = sorted(group, key=lambda record: record["gamma_deg"])
        steady = [record for record in climbs if record["trim"]]
        reasons = [
            f"{ends(record['gamma_deg'] for record in alike)}: {reason}"
            for reason, alike in groupby(climbs, key=lambda record: record["reason"])
            if reason
        ]
        yield {
            "V_a_mps": V_a,
            "gamma": ends(record["gamma_deg"] for record in steady),
            "throttle": ends(record["trim"]["throttle"] for record in steady),
            "reason": "; ".join(reasons),
        }


def ends(values: Iterable[float]) -> str:
    """``-5 to 10``, or the only value; empty without values."""
    ordered = sorted(values)
    return " to ".join(dict.fromkeys(figures(value) for value in (*ordered[:1], *ordered[-1:])))
