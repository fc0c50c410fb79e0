"""The command that says why the aircraft flies otherwise than the paper's law."""

import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from flighttune.cli.gain_sets import GainsOption, chosen_gains
from flighttune.cli.show import (
    NO,
    JsonOption,
    ScenarioArgument,
    fail,
    print_json,
    print_table,
    progress_bar,
    say,
)

if TYPE_CHECKING:
    from flighttune.gap.certified_set import Verdict
    from flighttune.gap.explain import Gap
    from flighttune.gap.free_flight import FreeFlight
    from flighttune.gap.ladder import Step
    from flighttune.gap.lag_fit import FittedLag

DEGREES = 180.0 / math.pi

SHOWN = (("ITAE", 1.0), ("MO_rad", DEGREES), ("ST_rad", DEGREES), ("saturation_s", 1.0))
"""Metrics of the printed table and the factor to the unit shown; ``--json`` has them all."""


def gap(
    scenario: ScenarioArgument,
    gains: GainsOption = None,
    plant: Annotated[
        str | None,
        typer.Option(
            help="Label of the aircraft, as `flighttune fly` shows it; by default the first one."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of figure and recording; by default runs/NAME-gap."),
    ] = None,
    lag: Annotated[
        Literal["identified", "fitted"] | None,
        typer.Option(
            help="Lag of the third rung: of the aircraft's model file, or fitted to this flight. "
            "By default the model file, where there is one."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Fly gains up a ladder from the paper's law to the aircraft; say what each step adds."""
    from flighttune.gap.explain import explain_gap
    from flighttune.gap.figure import save_gap_figure
    from flighttune.recording.record import record
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
    stem = f"{Path(scenario).stem}-gap"
    folder = out if out is not None else Path("runs") / stem
    with progress_bar() as progress:
        found = explain_gap(
            loaded, chosen, name=Path(name).stem, plant=plant, lag=lag, progress=progress
        )
    files = record(found.flown(), folder, name=stem)
    figure = None if found.ladder is None else folder / "gap.png"
    if figure is not None:
        save_gap_figure(found, figure)
    if as_json:
        signals = {label: str(path) for label, path in files.signals.items()}
        print_json({**gap_json(found, signals), **_files(files.recording, figure)})
    else:
        _print(found)
        for what, path in _files(files.recording, figure).items():
            say(f"{what}: {path}")
    if found.status != "explained":
        fail(f"{scenario}: {found.reason}", NO)
    if found.verdict is None or not found.verdict.held:
        why = found.indicators.reason if found.verdict is None else found.verdict.sentence
        fail(f"{scenario}: gains {name}: the certified set: {why}", NO)


def gap_json(found: "Gap", signals: dict[str, str]) -> dict[str, Any]:
    """A gap as plain values; `signals` are the files of the rungs by label."""
    flown, ladder = found.flown(), found.ladder
    return {
        "status": found.status,
        "reason": found.reason,
        "gains": found.runs[-1].provenance.gains_name,
        "ladder": [
            {
                "plant": run.provenance.plant,
                "status": run.status,
                "reason": run.reason,
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


def _files(recording: Path, figure: Path | None) -> dict[str, str | None]:
    return {"recording": str(recording), "figure": None if figure is None else str(figure)}


def _lag_json(fitted: "FittedLag") -> dict[str, Any]:
    lag = fitted.lag
    return {
        "order": lag.order,
        "natural_frequency_rad_s": lag.natural_frequency,
        "bandwidth_rad_s": lag.bandwidth,
        "damping": lag.damping if lag.order > 1 else None,
        "lag_s": lag.lag if lag.order > 2 else None,
        "delay_s": lag.delay,
        "fit_percent": fitted.fit_percent,
    }


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
    verdict, loop = found.verdict, found.loop
    return {
        "L_d": found.mismatch.L_d,
        "bound": found.mismatch.bound,
        "held": verdict and verdict.held,
        "t_broken": verdict and verdict.t_broken,
        "says_nothing": verdict and verdict.says_nothing,
        "verdict": verdict and _verdict_json(verdict),
        "settled": found.settled and _verdict_json(found.settled),
        "free": found.free and _free_json(found.free),
        "approach": loop
        and {"held": loop.t_promise_broken() is None, "t_broken": loop.t_promise_broken()},
    }


def _verdict_json(verdict: "Verdict") -> dict[str, Any]:
    values = asdict(verdict)
    values["asked_rad"] = values.pop("asked")
    for name in ("tube", "reach"):
        values[f"{name}_rad"] = dict(zip(("chi", "gamma"), values.pop(name), strict=True))
    return {**values, "says_nothing": verdict.says_nothing, "sentence": verdict.sentence}


def _free_json(free: "FreeFlight") -> dict[str, Any]:
    return {
        "t_from": free.t_from,
        "L_d": free.L_d,
        "widest_rad": dict(zip(("chi", "gamma"), free.widest, strict=True)),
        "at_end_rad": dict(zip(("chi", "gamma"), free.at_end, strict=True)),
        "held": free.t_broken is None,
        "t_broken": free.t_broken,
        "outside_rad": float(free.outside.max()),
    }


def _rms(values: Any) -> float:
    return math.sqrt(float((values**2).mean()))


def _print(found: "Gap") -> None:
    if found.ladder is None:
        return
    ladder, gains = found.ladder, found.runs[-1].provenance.gains_name

    def cells(metrics: Any, shape: str) -> list[str]:
        return [
            _cell(float(metrics.loc[channel, key]) * unit, shape)
            for key, unit in SHOWN
            for channel in ("chi", "gamma")
        ]

    first, last = found.runs[0], found.runs[-1]
    rows: list[tuple[str, ...]] = [
        (first.provenance.plant, "-", "-", *cells(ladder.known_metrics(first), ".2f"))
    ]
    for step in (*ladder.steps, ladder.whole):
        adds = step.adds if step is ladder.whole else f"+ {step.adds}"
        apart = [f"{_rms(values) * DEGREES:.2f}" for values in (step.chi, step.gamma)]
        rows.append((adds, *apart, *cells(step.metrics, "+.2f")))
    rows.append((last.provenance.plant, "-", "-", *cells(ladder.known_metrics(last), ".2f")))
    header = (
        "plant, or step to the next", "Δχ rms", "Δγ rms", "ITAE χ", "ITAE γ", "MO χ", "MO γ",
        "ST χ", "ST γ", "held χ", "held γ",
    )  # fmt: skip
    print_table(f"{found.scenario.title}; gains {gains}", header, rows)
    say(
        "a step is upper minus lower plant; differences, MO and ST in deg, ITAE in rad s², time "
        f"held by limits in s; sum of the steps against the whole: {ladder.residual:.0e}"
    )
    if ladder.failed:
        why = "; ".join(f"{plant} {reason}" for plant, reason in ladder.failed.items())
        say(f"no metrics of, from or to a rung that failed: {why}")
    _say_lags(found)
    _say_mismatch(found)


def _cell(value: float, shape: str) -> str:
    return f"{value:{shape}}" if math.isfinite(value) else "-"


def _say_lags(found: "Gap") -> None:
    assert found.ladder is not None
    loop = found.ladder.inner_loop
    for name, fitted in (("phi", loop.phi), ("n_z", loop.n_z)):
        lag, told = fitted.lag, fitted.fit_percent
        share = f"{told:.2f} % of this flight" if math.isfinite(told) else "not commanded here"
        say(
            f"inner loop {name} ({loop.source}): order {lag.order}, {lag.natural_frequency:.2f} "
            f"rad/s, delay {lag.delay:.3f} s; {share}"
        )


def _say_mismatch(found: "Gap") -> None:
    if found.mismatch is None:
        return
    say(
        f"mismatch d, rates flown minus the law's: |d| up to {found.mismatch.bound:.3f} rad/s, "
        f"its derivative up to L_d = {found.mismatch.L_d:.3f} rad/s²"
    )
    for name, verdict in (("whole flight", found.verdict), ("second half", found.settled)):
        if verdict is not None:
            chi, gamma = (width * DEGREES for width in verdict.tube)
            say(
                f"certified set, {name}: L_d {verdict.L_d:.3f} rad/s², errors end within "
                f"{chi:.1f} deg (chi) and {gamma:.1f} deg (gamma): {verdict.sentence}"
            )
    if found.loop is not None:
        say(f"promised way into it, which knows no limits: {found.loop.promise_sentence}")
    free = found.free
    if free is not None:
        widest, end = ([width * DEGREES for width in each] for each in (free.widest, free.at_end))
        say(
            f"no limit from {free.t_from:.2f} s on, L_d {free.L_d:.3f} rad/s²: errors within "
            f"{widest[0]:.1f} deg (chi) and {widest[1]:.1f} deg (gamma) of those of the linear "
            f"loop left alone, at the end within {end[0]:.1f} and {end[1]:.1f} deg: {free.sentence}"
        )
