"""A gap as plain values, and the tables that commands and pages show of them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.flight.ladder import rung_metrics
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS, columns
from flighttune.present.tables import Column, Table
from flighttune.simulate.run import TUBE_SIGNALS
from flighttune.units import DEG_PER_RAD

if TYPE_CHECKING:
    from flighttune.flight.gap import Gap
    from flighttune.flight.ladder import Step
    from flighttune.guarantee.flight_check import FreeFlight
    from flighttune.guarantee.ultimate_set import Verdict
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
CHECK_COLUMNS = [
    *columns("gains"),
    Column("check", "bound"),
    Column("t_from", "from", "s"),
    *columns("L_d"),
    *(
        Column(f"{key}.{channel}", f"{symbol} {where}", "deg", ".3g", DEG_PER_RAD)
        for key, where in (("tube_rad", "within"), ("at_end_rad", "at the end"))
        for channel, symbol in CHANNEL_SYMBOLS.items()
    ),
    Column("sentence", "flight"),
]


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
        mismatch = {"L_d": gap.mismatch.L_d, "bound": gap.mismatch.bound, **_kept(gap)}
        for key, verdict in (("verdict", gap.verdict), ("settled", _settled(gap))):
            if verdict is not None:  # reachable sets take time: they are of no table
                mismatch[key]["reach_rad"] = _channels(verdict.claim.reach)
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
    """Tables of a gap from its values: rungs, steps, inner loop and bounds."""
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
        yield check_table([gap])


def check_table(gaps: Sequence["Gap"]) -> Table:
    """Certified bounds for the measured mismatch, and whether the flight kept them.

    A flight with a tube is left out: its tube is the tighter bound.
    """
    records = []
    for gap in gaps:
        if gap.mismatch is None or set(TUBE_SIGNALS) <= set(gap.aircraft.signals):
            continue
        kept = _kept(gap)
        for check, key in (
            ("ultimate set, whole flight", "verdict"),
            ("ultimate set, second half", "settled"),
            ("transient bound, no limit active", "approach"),
            ("unforced linear loop", "free"),
        ):
            own = kept[key]
            if own is not None:
                within = own.get("tube_rad", own.get("widest_rad"))
                records.append({"gains": gap.name, "check": check, **own, "tube_rad": within})
    return Table(title="Bounds for the mismatch", columns=CHECK_COLUMNS, records=records)


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


def _kept(gap: "Gap") -> dict[str, Any]:
    """Outcome of the flight for each bound; None where there is no bound."""
    from flighttune.guarantee.ultimate_set import held_or_broken

    verdict, settled, check = gap.verdict, _settled(gap), gap.check
    return {
        "held": verdict.held if verdict else None,
        "t_broken": verdict.t_broken if verdict else None,
        "says_nothing": verdict.claim.vacuous if verdict else None,
        "verdict": _verdict(verdict) if verdict else None,
        "settled": _verdict(settled) if settled else None,
        "free": _free(gap.free) if gap.free else None,
        "approach": {
            "held": check.t_broken is None,
            "t_broken": check.t_broken,
            "sentence": held_or_broken(check.t_broken),
        }
        if check
        else None,
    }


def _settled(gap: "Gap") -> "Verdict | None":
    return gap.check.settled if gap.check else None


def _verdict(verdict: "Verdict") -> dict[str, Any]:
    claim = verdict.claim
    return {
        "held": verdict.held,
        "t_entered": verdict.t_entered,
        "t_broken": verdict.t_broken,
        "t_from": claim.t_from,
        "L_d": claim.L_d,
        "radius": claim.radius,
        "tube_rad": _channels(claim.tube),
        "asked_rad": claim.commanded,
        "says_nothing": claim.vacuous,
        "sentence": verdict.sentence,
    }


def _free(free: "FreeFlight") -> dict[str, Any]:
    """Bounds relative to the errors of the linear loop left alone."""
    return {
        "t_from": free.t_from,
        "L_d": free.L_d,
        "widest_rad": _channels(free.widest),
        "at_end_rad": _channels(free.at_end),
        "held": free.t_broken is None,
        "t_broken": free.t_broken,
        "outside_rad": float(free.outside.max()),
        "sentence": free.sentence,
    }


def _channels(pair: tuple[float, float]) -> dict[str, float]:
    return dict(zip(CHANNEL_SYMBOLS, pair, strict=True))


def _lag(fitted: "FittedLag") -> dict[str, Any]:
    from flighttune.identify.file import lag_table

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
