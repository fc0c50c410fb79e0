"""The command that explains why the aircraft flies differently from the paper's law."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from flighttune.cli.gain_sets import chosen_gains
from flighttune.cli.options import (
    AircraftPlantOption,
    ConformanceOption,
    GainsOption,
    ScenarioArgument,
    TubeOption,
    out_folder,
)
from flighttune.cli.progress import progress_bar
from flighttune.cli.show import NO, as_json, emit, fail, pick, table, tell
from flighttune.cli.tube import fail_if_outside, run_tubes, run_tubes_json, run_tubes_text
from flighttune.present.numbers import number
from flighttune.present.tables import Table
from flighttune.units import DEG_PER_RAD

if TYPE_CHECKING:
    from flighttune.flight.gap import Gap
    from flighttune.flight.ladder import Ladder, Step
    from flighttune.guarantee.flight_check import FreeFlight
    from flighttune.guarantee.ultimate_set import Verdict
    from flighttune.identify.fit import FittedLag
    from flighttune.simulate.run import Run

METRICS = (("ITAE", 1.0), ("MO_rad", DEG_PER_RAD), ("ST_rad", DEG_PER_RAD), ("saturation_s", 1.0))
"""Metrics of the printed table and the factor to its unit; ``--json`` has them all."""


def gap(
    scenario: ScenarioArgument,
    gains: GainsOption = None,
    plant: AircraftPlantOption = None,
    out: Annotated[Path | None, out_folder("runs/NAME-gap")] = None,
    lag: Annotated[
        Literal["identified", "fitted"] | None,
        Option(
            help="Inner-loop lag of the third plant: from the aircraft's model file, or fitted to "
            "this flight [default: the model file, if there is one]."
        ),
    ] = None,
    tube: TubeOption = False,
    conformance: ConformanceOption = None,
) -> None:
    """Fly gains on plants from the paper's law to the aircraft; show what each step adds.

    Exit status 1 if a flight ends early, or the aircraft does not stay in the certified set.
    """
    from flighttune.flight.gap import explain_gap
    from flighttune.flight.gap_charts import gap_sheet
    from flighttune.recording.record import record
    from flighttune.report.gap_page import write_gap_page
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario)
    for note in loaded.notes:
        tell(f"{scenario}: {note}")
    name, chosen = chosen_gains(loaded, gains)
    stem = f"{Path(scenario).stem}-gap"
    folder = out or Path("runs") / stem
    with progress_bar() as progress:
        found = explain_gap(
            loaded, chosen, name=Path(name).stem, plant=plant, lag=lag, progress=progress
        )
    top = found.runs[-1]
    tubes = run_tubes([top], folder, make=tube, conformance=conformance)
    found = replace(found, runs=(*found.runs[:-1], *tubes.runs))
    files = record(found.flown(), folder, name=stem)
    figure = page = None
    if found.ladder is not None:
        figure, page = folder / "gap.svg", folder / "gap.html"
        gap_sheet(found).save(figure)
        write_gap_page(found, page)
    written = {"recording": files.recording, "figure": figure, "page": page}
    how = f"flighttune gap {scenario} --tube --conformance FILE"
    text = [
        *_text(found),
        *run_tubes_text(tubes, how),
        *(f"{what}: {path}" for what, path in written.items()),
    ]
    answer = (
        {**gap_json(found, files.signals), "tubes": run_tubes_json(tubes), **written}
        if as_json()  # the reachable sets in it take a fifth of the time of the flights
        else {}
    )
    emit(answer, text)
    fail_if_outside(tubes)
    if found.status != "explained":
        fail(f"{scenario}: {found.reason}", NO)
    if found.verdict is None or not found.verdict.held:
        why = found.indicators.reason if found.verdict is None else found.verdict.sentence
        fail(f"{scenario}: gains {name}: the certified set: {why}", NO)


def gap_json(found: "Gap", signals: Mapping[str, Path]) -> dict[str, Any]:
    """A gap as ``--json`` has it; `signals` are the files of the rungs by label."""
    flown, ladder = found.flown(), found.ladder
    return {
        **pick(found, "status reason"),
        "gains": found.runs[-1].provenance.gains_name,
        "ladder": [
            {
                "plant": run.provenance.plant,
                **pick(run, "status reason"),
                "duration_s": run.duration,
                "signals": signals.get(run.label),
                "metrics": flown.metrics_of(run),
            }
            for run in found.runs
        ],
        "inner_loop": ladder
        and {
            "source": ladder.inner_loop.source,
            "phi": _lag_json(ladder.inner_loop.phi),
            "n_z": _lag_json(ladder.inner_loop.n_z),
        },
        "contributions": [_step_json(step) for step in ladder.steps] if ladder else [],
        "whole": ladder and _step_json(ladder.whole),
        "largest_residual": ladder and ladder.residual,
        "mismatch": _mismatch_json(found),
    }


def _lag_json(fitted: "FittedLag") -> dict[str, Any]:
    from flighttune.identify.file import lag_table

    return {**lag_table(fitted.lag), "fit_percent": fitted.fit_percent}


def _step_json(step: "Step") -> dict[str, Any]:
    channels = step.metrics.to_dict(orient="index")
    return {
        "from": step.lower,
        "to": step.upper,
        "adds": step.adds,
        "signals": {
            name: {"rms_rad": _rms(values), "max_rad": float(abs(values).max())}
            for name, values in (("chi", step.chi), ("gamma", step.gamma))
        },
        "metrics": {**channels, "flight": step.flight.to_dict()},
    }


def _mismatch_json(found: "Gap") -> dict[str, Any] | None:
    if found.mismatch is None:
        return None
    verdict, check = found.verdict, found.check
    settled = check and check.settled
    return {
        **pick(found.mismatch, "L_d bound"),
        "held": verdict and verdict.held,
        "t_broken": verdict and verdict.t_broken,
        "says_nothing": verdict and verdict.claim.vacuous,
        "verdict": verdict and _verdict_json(verdict),
        "settled": settled and _verdict_json(settled),
        "free": found.free and _free_json(found.free),
        "approach": check and {"held": check.t_broken is None, "t_broken": check.t_broken},
    }


def _verdict_json(verdict: "Verdict") -> dict[str, Any]:
    claim = verdict.claim
    return {
        **pick(verdict, "held t_entered t_broken"),
        **pick(claim, "t_from L_d radius"),
        "tube_rad": _channels(claim.tube),
        "reach_rad": _channels(claim.reach),
        "asked_rad": claim.commanded,
        "says_nothing": claim.vacuous,
        "sentence": verdict.sentence,
    }


def _channels(pair: tuple[float, float]) -> dict[str, float]:
    return dict(zip(("chi", "gamma"), pair, strict=True))


def _free_json(free: "FreeFlight") -> dict[str, Any]:
    return {
        **pick(free, "t_from L_d"),
        "widest_rad": _channels(free.widest),
        "at_end_rad": _channels(free.at_end),
        "held": free.t_broken is None,
        "t_broken": free.t_broken,
        "outside_rad": float(free.outside.max()),
    }


def _rms(values: Any) -> float:
    return math.sqrt(float((values**2).mean()))


def _text(found: "Gap") -> Iterator[Table | str]:
    ladder = found.ladder
    if ladder is None:
        return
    yield _ladder_table(found, ladder)
    yield (
        "a step is upper minus lower plant; differences, MO and ST in deg, ITAE in rad s², time "
        f"at limits in s; sum of the steps against the whole: {ladder.residual:.0e}"
    )
    if ladder.failed:
        why = "; ".join(f"{plant} {reason}" for plant, reason in ladder.failed.items())
        yield f"no metrics of, from or to a rung that failed: {why}"
    loop = ladder.inner_loop
    for name, fitted in (("phi", loop.phi), ("n_z", loop.n_z)):
        lag, percent = fitted.lag, fitted.fit_percent
        share = (
            f"{percent:.2f} % of this flight" if math.isfinite(percent) else "not commanded here"
        )
        yield (
            f"inner loop {name} ({loop.source}): order {lag.order}, {lag.natural_frequency:.2f} "
            f"rad/s, delay {lag.delay:.3f} s; {share}"
        )
    yield from _mismatch_text(found)


def _ladder_table(found: "Gap", ladder: "Ladder") -> Table:
    from flighttune.flight.ladder import rung_metrics

    def cells(metrics: Any, form: str) -> list[str]:
        return [
            number(float(metrics.loc[channel, key]) * factor, form, missing="-")
            for key, factor in METRICS
            for channel in ("chi", "gamma")
        ]

    def rung(run: "Run") -> list[str]:
        return [run.provenance.plant, "-", "-", *cells(rung_metrics(run), ".2f")]

    rows = [rung(found.runs[0])]
    for step in (*ladder.steps, ladder.whole):
        adds = step.adds if step is ladder.whole else f"+ {step.adds}"
        apart = [f"{_rms(values) * DEG_PER_RAD:.2f}" for values in (step.chi, step.gamma)]
        rows.append([adds, *apart, *cells(step.metrics, "+.2f")])
    rows.append(rung(found.runs[-1]))
    head = "plant or step to the next, Δχ rms, Δγ rms, ITAE χ, ITAE γ, MO χ, MO γ, ST χ, ST γ"
    title = f"{found.scenario.title}; gains {found.runs[-1].provenance.gains_name}"
    return table(title, [*head.split(", "), "limited χ", "limited γ"], rows)


def _mismatch_text(found: "Gap") -> Iterator[str]:
    from flighttune.guarantee.ultimate_set import held_or_broken

    if found.mismatch is None:
        return
    yield (
        f"mismatch d, rates flown minus the law's: |d| up to {found.mismatch.bound:.3f} rad/s, "
        f"its derivative up to L_d = {found.mismatch.L_d:.3f} rad/s²"
    )
    check, free = found.check, found.free
    if check is not None:
        for name, verdict in (("whole flight", found.verdict), ("second half", check.settled)):
            if verdict is not None:
                yield (
                    f"ultimate set, {name}: L_d {verdict.claim.L_d:.3f} rad/s², errors end within "
                    f"{_in_deg(verdict.claim.tube)}: {verdict.sentence}"
                )
        yield f"transient bound, outside the limits: {held_or_broken(check.t_broken)}"
    if free is not None:
        yield (
            f"no limit from {free.t_from:.2f} s on, L_d {free.L_d:.3f} rad/s²: errors within "
            f"{_in_deg(free.widest)} of those of the linear loop left alone, at the end within "
            f"{_in_deg(free.at_end)}: {free.sentence}"
        )


def _in_deg(pair: tuple[float, float]) -> str:
    chi, gamma = (width * DEG_PER_RAD for width in pair)
    return f"{chi:.1f} deg (chi) and {gamma:.1f} deg (gamma)"
