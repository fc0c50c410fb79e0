"""A gap as plain values, its tables, and its page."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from flighttune.flight.gap import Gap, Step
from flighttune.flight.gap_charts import gap_charts
from flighttune.identify.file import lag_table
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table
from flighttune.report.panels import areas_in_words
from flighttune.report.tables import provenance_table
from flighttune.simulate.run import run_styles
from flighttune.table_file import toml_text

TUBE_NOTE = (
    "The error of the aircraft is drawn in its tube and in a counted band where there are any: "
    "flighttune gap SCENARIO takes --tube --conformance FILE and --band FILE."
)

# Metrics of the tables; ``--json`` has them all.
METRICS = [
    f"metrics.{channel}.{key}"
    for key in ("ITAE", "MO_rad", "ST_rad", "saturation_s")
    for channel in CHANNEL_SYMBOLS
]


RUNG_COLUMNS = columns(" ".join(["plant", "status", *METRICS]))
STEP_COLUMNS = [
    *columns("gains"),
    Column("adds", "upper minus lower plant"),
    *(replace(column, digits="+.2f") for column in columns(" ".join(METRICS))),
]
LAG_COLUMNS = columns("channel order natural_frequency_rad_s delay_s fit_percent")
MISMATCH_COLUMNS = [Column("bound", "largest |d|", "rad/s"), *columns("L_d")]


def gap_values(gap: Gap, signals: Mapping[str, Path]) -> dict[str, Any]:
    """A gap as ``--json`` has it; `signals` are the files of the rungs by label."""
    values: dict[str, Any] = {
        "status": gap.status,
        "reason": gap.reason,
        "gains": gap.aircraft.provenance.gains_name,
        "ladder": gap.flown().records(signals),
        "inner_loop": None,
        "contributions": [_step(step) for step in gap.steps],
        "whole": None if gap.whole is None else _step(gap.whole),
        "largest_residual": gap.residual if gap.steps else None,
        "cause": {
            channel: {"adds": cause[0], "ITAE": cause[1]}
            for channel in CHANNEL_SYMBOLS
            if (cause := gap.cause(channel))
        },
        "mismatch": None,
    }
    if gap.lags:
        values["inner_loop"] = {"source": gap.lag_source} | {
            name: {**lag_table(lag), "fit_percent": fit_percent}
            for name, (lag, fit_percent) in gap.lags.items()
        }
    if gap.mismatch is not None:
        values["mismatch"] = {"L_d": gap.mismatch.L_d, "bound": gap.mismatch.bound}
    return values


def gap_tables(gap: Gap, values: Mapping[str, Any]) -> list[Table]:
    """Tables of a gap from its values: rungs, steps, inner loop and mismatch."""
    if not gap.steps:
        return []
    loop = values["inner_loop"]
    lags = [{"channel": name, **loop[name]} for name in ("phi", "n_z")]
    mismatch = [values["mismatch"]] if values["mismatch"] else []
    return [
        Table(RUNG_COLUMNS, values["ladder"], "plants, from the law to the aircraft"),
        step_table([gap]),
        Table(LAG_COLUMNS, lags, f"inner loop ({loop['source']})"),
        Table(MISMATCH_COLUMNS, mismatch, "mismatch d: rates flown minus the law's"),
    ]


def step_table(gaps: Sequence[Gap]) -> Table:
    """The difference that each step from the paper's law to the aircraft adds, and the total."""
    records = [
        {"gains": gap.name, **_step(step)}
        for gap in gaps
        if gap.whole is not None
        for step in (*gap.steps, gap.whole)
    ]
    shown = STEP_COLUMNS if len(gaps) > 1 else STEP_COLUMNS[1:]
    return Table(title="steps", columns=shown, records=records)


def causes(gap: Gap) -> tuple[str, ...]:
    """A sentence for each channel: its ITAE from law to aircraft, and the largest step."""
    itae, said = gap.flown().metrics["ITAE"], []
    for channel, name in CHANNEL_NAMES.items():
        if (cause := gap.cause(channel)) is None:
            continue
        first, aircraft = (itae[run.label, channel] for run in (gap.runs[0], gap.aircraft))
        plant = gap.runs[0].provenance.plant
        said.append(
            f"{name.capitalize()} with {gap.name}: ITAE is {first:.2f} rad s² on {plant} and "
            f"{aircraft:.2f} on the aircraft; the largest step is {cause[1]:+.2f} ({cause[0]})."
        )
    return tuple(said)


def write_gap_page(gap: Gap, tables: Sequence[Table], path: str | Path) -> Report:
    """Write one self-contained page about a gap; parent folders are made.

    Raises InputError if the aircraft did not fly, OutputError if the file cannot be written.
    """
    made = gap.aircraft.provenance
    return write_page(
        Path(path),
        page_template("flighttune.report", "commands.html.jinja"),
        summary=causes(gap),
        sections=[
            Section(
                note=" ".join([TUBE_NOTE, *areas_in_words([gap.aircraft])]),
                charts=gap_charts(gap),
                legend=False,
            ),
            Section(id="numbers", title="Numbers", tables=tables, legend=False),
        ],
        title=f"From the law to the aircraft: {gap.scenario.title}; gains {gap.name}",
        styles=run_styles(gap.runs),
        provenance=provenance_table(gap.scenario.title, gap.scenario, gap.runs),
        commands=f"flighttune gap scenario.toml --gains {made.gains_name}",
        scenario_text=toml_text(made.scenario),
    )


def _step(step: Step) -> dict[str, Any]:
    return {
        "from": step.lower,
        "to": step.upper,
        "adds": step.adds,
        "metrics": {**step.metrics.to_dict(orient="index"), "flight": step.flight.to_dict()},
    }
