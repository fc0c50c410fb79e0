"""The answer of the gap between law and aircraft."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from flighttune.base.signals import CHANNEL_NAMES, CHANNEL_SYMBOLS
from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import pick
from flighttune.gaps.gap import Gap
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.run import claimed
from flighttune.vehicles.identification.file import lag_table

# Metrics of the tables; ``--json`` has them all.
METRICS = [
    f"metrics.{channel}.{key}"
    for key in ("ITAE", "MO_rad", "ST_rad", "saturation_s")
    for channel in CHANNEL_SYMBOLS
]
METRIC_COLUMNS = [
    *columns(" ".join(METRICS[:4])),
    *(replace(column, spare=True) for column in columns(" ".join(METRICS[4:]))),
]
RUNG_COLUMNS = [*columns("plant status"), *METRIC_COLUMNS]
STEP_COLUMNS = [
    *columns("gains"),
    Column("adds", "upper minus lower plant"),
    *(replace(column, digits="+.2f") for column in METRIC_COLUMNS),
]
AIRSPEED_COLUMNS = columns(
    "plant metrics.V.ITAE metrics.V.MO_mps metrics.V.settling_s metrics.V.ST_mps metrics.V.min_mps"
)
LAG_COLUMNS = columns("channel order natural_frequency_rad_s delay_s fit_percent")
MISMATCH_TITLE = "mismatch d: rates flown minus the law's"
MISMATCH_COLUMNS = [Column("bound", "largest |d|", "rad/s"), *columns("L_d")]


def answer(gap: Gap, signals: Mapping[str, Path] | None = None) -> Answer:
    """The steps and the inner loop; a failure unless all rungs flew to the end."""
    ladder = gap.flown().records(signals or {})
    changes = [(x, *cause) for x in CHANNEL_SYMBOLS if (cause := gap.cause(x))]
    lags = {name: {**lag_table(lag), "fit_percent": fit} for name, (lag, fit) in gap.lags.items()}
    mismatch = gap.mismatch and pick(gap.mismatch, "L_d bound")
    failed = "; ".join(f"{plant} {reason}" for plant, reason in gap.failed.items())
    early = "" if gap.status == "explained" else f"{gap.scenario.title}: {gap.reason}"
    hidden = failed and gap.steps
    notes = [f"No metrics of, from or to a rung that failed: {failed}"] if hidden else []
    rows, around = [{"channel": name, **lag} for name, lag in lags.items()], claimed(gap.runs)
    tables = [
        Table(RUNG_COLUMNS, ladder, "plants, from the law to the aircraft"),
        Table(AIRSPEED_COLUMNS, ladder if gap.scenario.airspeed else [], "airspeed"),
        step_table([gap]),
        Table(LAG_COLUMNS, rows, f"inner loop ({gap.lag_source})"),
        Table(MISMATCH_COLUMNS, list(filter(None, [mismatch])), MISMATCH_TITLE),
    ]
    return Answer(
        values={
            **pick(gap, "status reason"),
            "gains": gap.aircraft.provenance.gains_name,
            "ladder": ladder,
            "inner_loop": {"source": gap.lag_source} | lags if lags else None,
            "contributions": [step.values for step in gap.steps],
            "whole": None if gap.whole is None else gap.whole.values,
            "largest_residual": gap.residual if gap.steps else None,
            "cause": {x: {"adds": adds, "ITAE": change} for x, adds, change in changes},
            "mismatch": mismatch,
            "planning": gap.largest_errors,
            **around.values,
        },
        lines=[*around.summary, *causes(gap)],
        tables=tables if gap.steps else [],
        notes=[*gap.scenario.notes, *notes, *planning(gap), *around.notes],
        findings=[*around.findings, *unmet(early)],
    )


def planning(gap: Gap) -> list[str]:
    """A sentence on the reduction of errors by planning; empty without planning."""
    errors = " and that of ".join(
        f"{CHANNEL_NAMES[channel]} from {largest['unplanned'] * DEG_PER_RAD:.3g} to "
        f"{largest['planned'] * DEG_PER_RAD:.3g} deg"
        for channel, largest in (gap.largest_errors or {}).items()
    )
    return [f"Planning roll and lift takes the largest error of {errors}."] if errors else []


def causes(gap: Gap) -> tuple[str, ...]:
    """A sentence for each channel: its ITAE from law to aircraft, and the largest step."""
    itae, sentences = gap.flown().metrics["ITAE"], []
    for channel, name in CHANNEL_NAMES.items():
        if (cause := gap.cause(channel)) is None:
            continue
        first, aircraft = (itae[run.label, channel] for run in (gap.runs[0], gap.aircraft))
        if not (math.isfinite(first) and math.isfinite(aircraft)):
            continue
        plant = gap.runs[0].provenance.plant
        sentences.append(
            f"{name.capitalize()} with {gap.name}: ITAE is {first:.2f} rad s² on {plant} and "
            f"{aircraft:.2f} on the aircraft; the largest step is {cause[1]:+.2f} ({cause[0]})."
        )
    return tuple(sentences)


def step_table(gaps: Sequence[Gap]) -> Table:
    """The difference that each step from the paper's law to the aircraft adds, and the total."""
    records = [
        {"gains": gap.name, **step.values}
        for gap in gaps
        if gap.whole is not None
        for step in (*gap.steps, gap.whole)
    ]
    layout = STEP_COLUMNS if len(gaps) > 1 else STEP_COLUMNS[1:]
    return Table(title="steps", columns=layout, records=records)
