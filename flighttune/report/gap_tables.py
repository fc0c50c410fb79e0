"""A gap as plain values, and the tables that commands and pages show of them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.flight.ladder import rung_metrics
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table
from flighttune.units import DEG_PER_RAD

if TYPE_CHECKING:
    from flighttune.flight.gap import Gap
    from flighttune.flight.ladder import Step
    from flighttune.identify.fit import FittedLag

METRICS = [
    f"metrics.{channel}.{key}"
    for key in ("ITAE", "MO_rad", "ST_rad", "saturation_s")
    for channel in CHANNEL_SYMBOLS
]
"""Metrics of the tables; ``--json`` has them all."""


RUNG_COLUMNS = columns(" ".join(["plant", "status", *METRICS]))
STEP_COLUMNS = [
    Column("adds", "step"),
    Column("signals.chi.rms_rad", "Δχ rms", "deg", ".2f", DEG_PER_RAD),
    Column("signals.gamma.rms_rad", "Δγ rms", "deg", ".2f", DEG_PER_RAD),
    *(replace(column, digits="+.2f") for column in columns(" ".join(METRICS))),
]
LAG_COLUMNS = columns("channel order natural_frequency_rad_s delay_s fit_percent")
MISMATCH_COLUMNS = [Column("bound", "largest |d|", "rad/s"), *columns("L_d")]


def gap_values(gap: "Gap", signals: Mapping[str, Path]) -> dict[str, Any]:
    """A gap as ``--json`` has it; `signals` are the files of the rungs by label."""
    flown, ladder = gap.flown(), gap.ladder
    explained: dict[str, Any] = {
        "inner_loop": None,
        "contributions": [],
        "whole": None,
        "largest_residual": None,
    }
    if ladder is not None:
        loop = ladder.inner_loop
        lags = {name: _lag(lag) for name, lag in (("phi", loop.phi), ("n_z", loop.n_z))}
        explained = {
            "inner_loop": {"source": loop.source, **lags},
            "contributions": [_step(step) for step in ladder.steps],
            "whole": _step(ladder.whole),
            "largest_residual": ladder.residual,
        }
    mismatch = None
    if gap.mismatch is not None:
        mismatch = {"L_d": gap.mismatch.L_d, "bound": gap.mismatch.bound}
    return {
        "status": gap.status,
        "reason": gap.reason,
        "gains": gap.runs[-1].provenance.gains_name,
        "ladder": [
            {
                "plant": run.provenance.plant,
                "status": run.status,
                "reason": run.reason,
                "duration_s": run.duration,
                "signals": signals.get(run.label),
                "metrics": flown.metrics_of(run),
            }
            for run in gap.runs
        ],
        **explained,
        "mismatch": mismatch,
    }


def gap_tables(gap: "Gap", values: Mapping[str, Any]) -> Iterator[Table]:
    """Tables of a gap from its values: rungs, steps, inner loop and mismatch."""
    if gap.ladder is None:
        return
    title = f"{gap.scenario.title}; gains {values['gains']}"
    yield Table(title=title, columns=RUNG_COLUMNS, records=values["ladder"])
    steps = [*values["contributions"], values["whole"]]
    yield Table(title="upper minus lower plant", columns=STEP_COLUMNS, records=steps)
    loop = values["inner_loop"]
    lags = [{"channel": name, **loop[name]} for name in ("phi", "n_z")]
    yield Table(title=f"inner loop ({loop['source']})", columns=LAG_COLUMNS, records=lags)
    if values["mismatch"] is not None:
        title = "mismatch d: rates flown minus the law's"
        yield Table(title=title, columns=MISMATCH_COLUMNS, records=[values["mismatch"]])


def step_table(gaps: Sequence["Gap"]) -> Table:
    """ITAE from the paper's law to the aircraft, step by step."""
    records = []
    for gap in gaps:
        law = rung_metrics(gap.runs[0])["ITAE"].to_dict()
        for channel, symbol in CHANNEL_SYMBOLS.items():
            steps = [float(step.metrics["ITAE"].to_dict()[channel]) for step in gap.steps]
            first = float(law[channel])
            records.append(
                {
                    "run": gap.aircraft.label,
                    "gains": f"{gap.name}, {symbol}",
                    "law": first,
                    **{step.adds: change for step, change in zip(gap.steps, steps, strict=True)},
                    "aircraft": first + sum(steps),
                }
            )
    shown = [
        Column("gains", "gains, channel"),
        Column("law", "paper's law", digits="z.2f"),
        *(
            Column(step.adds, f"+ {step.adds}", digits="+.2f")
            for step in (gaps[0].steps if gaps else ())
        ),
        Column("aircraft", "aircraft", digits="z.2f"),
    ]
    title = "ITAE [rad\u00a0s²], step by step"
    return Table(title=title, name="gap", columns=shown, records=records, label="run")


def largest_step(gap: "Gap") -> str:
    """Sentence on the step of the ladder that moves course and path angle most."""
    parts = []
    for channel, name in CHANNEL_NAMES.items():
        rms = {step.adds: _rms(getattr(step, channel)) for step in gap.steps}
        largest = max(rms, key=lambda adds: rms[adds])
        parts.append(f"{name}, from {largest} ({rms[largest] * DEG_PER_RAD:.1f}° rms)")
    return f"With {gap.name} most of the difference comes, in {' and in '.join(parts)}."


def _lag(fitted: "FittedLag") -> dict[str, Any]:
    from flighttune.identify.model import lag_table

    return {**lag_table(fitted.lag), "fit_percent": fitted.fit_percent}


def _step(step: "Step") -> dict[str, Any]:
    return {
        "from": step.lower,
        "to": step.upper,
        "adds": step.adds,
        "signals": {
            name: {"rms_rad": _rms(values), "max_rad": float(abs(values).max())}
            for name, values in (("chi", step.chi), ("gamma", step.gamma))
        },
        "metrics": {**step.metrics.to_dict(orient="index"), "flight": step.flight.to_dict()},
    }


def _rms(values: Any) -> float:
    return math.sqrt(float((values**2).mean()))
