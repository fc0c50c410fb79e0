"""Commands that find gains: the best ones, and what each radius would allow."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from flighttune.cli.gain_sets import (
    gains_json,
    margins_json,
    margins_of,
    print_gains,
    say_margins,
    write_json,
)
from flighttune.cli.robust import (
    CandidatesOption,
    DrawsOption,
    MetricOption,
    MinSuccessOption,
    OutOption,
    PercentileOption,
    PlantOption,
    RobustOption,
    SchedulerOption,
    WorkersOption,
    tune_by_flying,
)
from flighttune.cli.show import NO, JsonOption, ScenarioArgument, fail, print_json, print_table, say
from flighttune.errors import InputError

ENVELOPE_STARTS = 2
"""Climbs over an envelope, besides the one from the gains tuned at the trim."""

if TYPE_CHECKING:
    from flighttune.tuning.diagnosis import Diagnosis


def tune(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO",
            help="A scenario file, or the name of a shipped one; none with --robust.",
        ),
    ] = None,
    method: Annotated[
        Literal["gradient", "genetic", "convex"] | None,
        typer.Option(help="By default what the scenario says, else gradient."),
    ] = None,
    envelope: Annotated[
        bool, typer.Option("--envelope", help="Maximise the rate over the scenario's envelope.")
    ] = False,
    robust: RobustOption = None,
    metric: MetricOption = None,
    percentile: PercentileOption = None,
    min_success: MinSuccessOption = None,
    candidates: CandidatesOption = None,
    draws: DrawsOption = None,
    plant: PlantOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    out: OutOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find the gains with the largest R_K under the constraints of SCENARIO.

    With --robust CAMPAIGN choose among the gains on the frontier of its scenario by flying them on
    its draws: the lowest percentile of a metric.
    """
    of_robust = {
        "metrics": metric and tuple(metric), "percentile": percentile, "least_success": min_success,
        "candidates": candidates, "draws": draws, "plants": plant and tuple(plant),
    }  # fmt: skip
    given = {name: value for name, value in of_robust.items() if value is not None}
    if out is not None and out.suffix.lower() != ".json":
        raise InputError(f"{out}: --out must end in .json.")
    if robust is not None:
        if scenario is not None or method is not None or envelope:
            raise InputError(
                "--robust: must be alone, without SCENARIO, --method and --envelope: the campaign "
                "names its scenario."
            )
        tune_by_flying(
            robust, given, workers=workers, scheduler=scheduler, out=out, as_json=as_json
        )
        return
    if scenario is None:
        raise InputError("SCENARIO: must be given, or --robust CAMPAIGN.")
    if given or workers is not None or scheduler is not None:
        raise InputError("--robust CAMPAIGN: must be given with options that say how to choose.")
    if envelope and method is not None:
        raise InputError("--method: must be absent with --envelope, which has a method of its own.")
    if envelope:
        _tune_envelope(scenario, out, as_json)
    else:
        _tune_at_trim(scenario, method, out, as_json)


def _tune_at_trim(scenario: str, method: str | None, out: Path | None, as_json: bool) -> None:
    from flighttune.outer_loop import tune_scenario, tuning_problem, tuning_scaling
    from flighttune.scenario import load_scenario
    from flighttune.tuning.diagnosis import diagnosis

    loaded = load_scenario(scenario)
    if method is not None:
        changed = loaded.tuning.model_copy(update={"method": method})
        loaded = loaded.model_copy(update={"tuning": changed})
    result = tune_scenario(loaded)
    optimal = result.status == "optimal"
    margins = margins_of(loaded.linear_model(), result.gains) if optimal else None
    scaling = tuning_scaling(loaded)
    n, _, p = loaded.linear_model().shape
    why = diagnosis(tuning_problem(loaded)) if result.status == "infeasible" else None
    told = {
        "status": result.status,
        "reason": result.reason,
        **gains_json(result.gains),
        "R_K": result.R_K,
        "I_K": result.I_K,
        "scaling": [1.0] * (n + p) if scaling is None else scaling.tolist(),
        "spectral_abscissa": result.spectral_abscissa,
        "active": list(result.active),
        "starts": result.starts,
        "wall_s": result.wall_s,
        "method": result.method,
        "margins": margins_json(margins),
        "diagnosis": None if why is None else _diagnosis_json(why),
    }
    if out is not None:
        write_json(out, told)
    if as_json:
        print_json(told)
    else:
        print_gains(
            f"{result.status}: R_K {result.R_K:.5f}, I_K {result.I_K:.4f}, "
            f"spectral abscissa {result.spectral_abscissa:.4f} 1/s",
            result.gains,
        )
        say(
            f"binding: {', '.join(result.active) or 'nothing'}; {result.method}, "
            f"{result.starts} starts, {result.wall_s:.2f} s"
        )
        say(
            "units of state: plain, as in `certify`"
            if scaling is None
            else "units of state: scaled by [tuning]; `certify` says R_K in plain ones too"
        )
        say_margins(margins)
        if why is not None:
            _print_diagnosis(why)
    if not optimal:
        fail(f"{scenario}: {result.reason}", NO)


def frontier(
    scenario: ScenarioArgument,
    out: Annotated[
        Path | None, typer.Option(help="Folder of table and figure; by default runs/NAME.")
    ] = None,
    points: Annotated[int, typer.Option(min=2, max=1000, help="Points of the frontier.")] = 25,
    as_json: JsonOption = False,
) -> None:
    """R_K against I_K for SCENARIO, with the paper's gains and the scenario's own marked."""
    from flighttune.control.gains import paper_family
    from flighttune.outer_loop import gain_set, tuning_problem
    from flighttune.scenario import load_scenario
    from flighttune.tuning.frontier import frontier as frontier_table
    from flighttune.tuning.frontier_figure import frontier_figure
    from flighttune.whole_file import whole_file

    loaded = load_scenario(scenario)
    names = [entry if isinstance(entry, str) else entry.name for entry in loaded.gains]
    own = {name: gain_set(loaded, name) for name in names}
    marked = {**paper_family(), **{name: gains for name, gains in own.items() if gains is not None}}
    table = frontier_table(tuning_problem(loaded), points=points, marked=marked)
    folder = out if out is not None else Path("runs") / Path(scenario).stem
    csv, png = folder / "frontier.csv", folder / "frontier.png"
    with whole_file(csv) as part:
        table.to_csv(part, index=False)
    with whole_file(png) as part:
        frontier_figure(table).savefig(part, dpi=160, format="png")
    columns = ("I_K", "R_K", "spectral_abscissa")
    numbers = zip(*(table[column].to_numpy().tolist() for column in columns), strict=True)
    rows = [
        (str(name), dict(zip(columns, values, strict=True)))
        for name, values in zip(table["name"], numbers, strict=True)
    ]
    if as_json:
        print_json(
            {
                "points": [row for name, row in rows if name == "frontier"],
                "marked": {name: row for name, row in rows if name != "frontier"},
                "csv": str(csv),
                "figure": str(png),
            }
        )
        return
    shown = [(name, *(f"{row[column]:.4f}" for column in columns)) for name, row in rows]
    header = ("", "I_K [s²]", "R_K [1/s]", "spectral abscissa [1/s]")
    print_table(loaded.title, header, shown)
    say(f"table: {csv}   figure: {png}")


def _tune_envelope(source: str, out: Path | None, as_json: bool) -> None:
    from flighttune.outer_loop import trim_and_envelope, tuning_problem
    from flighttune.scenario import load_scenario
    from flighttune.tuning.envelope import tune_over_envelope
    from flighttune.tuning.result import assessment

    scenario = load_scenario(source)
    trim, envelope = trim_and_envelope(scenario)
    g = scenario.flight.g_mps2
    problem = tuning_problem(scenario)
    found = tune_over_envelope(problem, envelope, trim, g=g, starts=ENVELOPE_STARTS)
    margins = margins_of(scenario.linear_model(), found.gains)
    at_trim = None if found.gains is None else assessment(problem, found.gains.K)
    told = {
        "status": found.status,
        "reason": found.reason,
        **gains_json(found.gains),
        "R_K": found.R_K,
        "I_K": found.I_K,
        "spectral_abscissa": None if at_trim is None else at_trim.spectral_abscissa,
        "active": [] if at_trim is None else list(at_trim.active),
        "starts": ENVELOPE_STARTS,
        "R_envelope": found.R,
        "R_envelope_bound": found.R_bound,
        "factor": found.factor,
        "wall_s": found.wall_s,
        "margins": margins_json(margins),
    }
    if out is not None:
        write_json(out, told)
    if as_json:
        print_json(told)
    else:
        print_gains(
            f"{found.status}: rate over the envelope {found.R:.4f} 1/s; at the trim R_K "
            f"{found.R_K:.4f}, I_K {found.I_K:.3f} ({found.wall_s:.1f} s)",
            found.gains,
        )
        say_margins(margins)
    if found.status != "found":
        fail(f"{source}: {found.reason}", NO)


def _diagnosis_json(why: "Diagnosis") -> dict[str, Any]:
    return {
        "smallest_I_K": why.smallest_I_K,
        "largest_R_K": why.largest_R_K,
        "common_factor": why.common_factor,
        "binding": list(why.binding),
        "limits": [asdict(one) for one in why.limits],
    }


def _print_diagnosis(why: "Diagnosis") -> None:
    say(
        f"within the limits I_K is at least {why.smallest_I_K:.2f} and R_K at most "
        f"{why.largest_R_K:.4f}; all limits times {why.common_factor:.2f} would be enough"
    )
    for one in why.limits:
        alone = (
            f"times {one.factor_alone:.2f} alone would be enough"
            if one.factor_alone < float("inf")
            else "no factor alone would be enough"
        )
        say(f"limit {one.name}: {alone}; without it I_K {one.smallest_I_K_without:.2f}")
