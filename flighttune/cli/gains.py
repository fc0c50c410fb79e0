"""Commands that find gains: the best ones, and the frontier of R_K against I_K."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from typer import Option

from flighttune.cli.gain_sets import (
    gains_json,
    gains_table,
    margins_json,
    margins_of,
    margins_text,
    write_json,
)
from flighttune.cli.options import (
    GainsFileOption,
    ScenarioArgument,
    check_ending,
    out_folder,
)
from flighttune.cli.show import NO, emit, fail, pick, table
from flighttune.errors import InputError
from flighttune.present.tables import Table

ENVELOPE_STARTS = 2
"""Searches over an envelope, besides the one from the gains tuned at the trim."""

if TYPE_CHECKING:
    from flighttune.tuning.diagnosis import Diagnosis

Answer = tuple[dict[str, Any], list[Table | str]]
"""What is printed with ``--json``, and without."""


def tune(
    scenario: ScenarioArgument,
    method: Annotated[
        Literal["gradient", "genetic", "convex"] | None,
        Option(help="Optimiser [default: the scenario's, else gradient]."),
    ] = None,
    envelope: Annotated[
        bool, Option("--envelope", help="Maximise the rate over the scenario's envelope.")
    ] = False,
    out: GainsFileOption = None,
) -> None:
    """Find the gains with the largest R_K under the constraints of SCENARIO."""
    check_ending(out, ".json")
    if envelope and method is not None:
        raise InputError("--method: must be absent with --envelope, which has a method of its own.")
    answer, text = _tune_over_envelope(scenario) if envelope else _tune_at_trim(scenario, method)
    if out is not None:
        write_json(out, answer)
    emit(answer, text)
    if answer["status"] not in ("optimal", "found"):
        fail(f"{scenario}: {answer['reason']}", NO)


def frontier(
    scenario: ScenarioArgument,
    out: Annotated[Path | None, out_folder("runs/NAME")] = None,
    points: Annotated[int, Option(min=2, max=1000, help="Points of the frontier.")] = 25,
) -> None:
    """Tabulate and draw the largest R_K for each I_K, with the paper's and the scenario's gains."""
    from flighttune.control.gains import paper_family
    from flighttune.flight.outer_loop import gain_set, tuning_problem
    from flighttune.present.chart import Sheet
    from flighttune.present.palette import line_styles
    from flighttune.scenario import load_scenario
    from flighttune.tuning.frontier import frontier as frontier_table
    from flighttune.tuning.frontier import frontier_chart
    from flighttune.whole_file import write_text

    loaded = load_scenario(scenario)
    law, flight = loaded.laws[0], loaded.flight
    own = [name for name in loaded.gain_names if loaded.law_of(name)[0].by_gains]
    sets = {**paper_family(), **{name: gain_set(loaded, name) for name in own}}
    marked = {
        name: law.gains_from(gains, V_a=flight.V_a_mps, g=flight.g_mps2)
        for name, gains in sets.items()
        if gains is not None
    }
    found = frontier_table(tuning_problem(loaded), points=points, marked=marked)
    folder = out or Path("runs") / Path(scenario).stem
    csv, svg = folder / "frontier.csv", folder / "frontier.svg"
    write_text(csv, found.to_csv(index=False, lineterminator="\n"))
    styles = line_styles([("", name) for name in loaded.gain_names])
    chart = frontier_chart(found, {name: style for (_, name), style in styles.items()})
    Sheet(charts=[chart], columns=1).save(svg)
    columns = ["I_K", "R_K", "spectral_abscissa"]
    rows = list(zip(found["name"], found.loc[:, columns].to_dict(orient="records"), strict=True))
    answer = {
        "points": [row for name, row in rows if name == "frontier"],
        "marked": {name: row for name, row in rows if name != "frontier"},
        "csv": csv,
        "figure": svg,
    }
    text = [
        table(
            loaded.title,
            ("", "I_K [s²]", "R_K [1/s]", "spectral abscissa [1/s]"),
            [(name, *(f"{value:.4f}" for value in row.values())) for name, row in rows],
        ),
        f"table: {csv}   figure: {svg}",
    ]
    emit(answer, text)


def _tune_at_trim(source: str, method: str | None) -> Answer:
    from flighttune.flight.outer_loop import tune_scenario, tuning_problem, tuning_scaling
    from flighttune.scenario import load_scenario
    from flighttune.tuning.diagnosis import diagnosis

    scenario = load_scenario(source)
    if method is not None:
        changed = scenario.tuning.model_copy(update={"method": method})
        scenario = scenario.model_copy(update={"tuning": changed})
    result = tune_scenario(scenario)
    model = scenario.linear_model()
    margins = margins_of(model, result.gains) if result.status == "optimal" else None
    scaling = tuning_scaling(scenario)
    n, _, p = model.shape
    why = diagnosis(tuning_problem(scenario)) if result.status == "infeasible" else None
    answer = {
        **pick(result, "status reason"),
        **gains_json(result.gains),
        **pick(result, "R_K I_K"),
        "scaling": [1.0] * (n + p) if scaling is None else scaling,
        **pick(result, "spectral_abscissa active starts wall_s method"),
        "margins": margins_json(margins),
        "diagnosis": why and pick(why, "smallest_I_K largest_R_K common_factor binding limits"),
    }
    text = [
        gains_table(
            f"{result.status}: R_K {result.R_K:.5f}, I_K {result.I_K:.4f}, "
            f"spectral abscissa {result.spectral_abscissa:.4f} 1/s",
            result.gains,
        ),
        f"binding: {', '.join(result.active) or 'nothing'}; {result.method}, "
        f"{result.starts} starts, {result.wall_s:.2f} s",
        "units of state: plain, as in `certify`"
        if scaling is None
        else "units of state: scaled by [tuning]; `certify` gives R_K in plain ones too",
        *margins_text(margins),
        *(_diagnosis_text(why) if why else ()),
    ]
    return answer, text


def _tune_over_envelope(source: str) -> Answer:
    from flighttune.flight.outer_loop import trim_and_envelope, tuning_problem
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
    answer = {
        **pick(found, "status reason"),
        **gains_json(found.gains),
        **pick(found, "R_K I_K"),
        "spectral_abscissa": at_trim and at_trim.spectral_abscissa,
        "active": at_trim.active if at_trim else [],
        "starts": ENVELOPE_STARTS,
        "R_envelope": found.R,
        "R_envelope_bound": found.R_bound,
        **pick(found, "factor wall_s"),
        "margins": margins_json(margins),
    }
    title = (
        f"{found.status}: rate over the envelope {found.R:.4f} 1/s; at the trim R_K "
        f"{found.R_K:.4f}, I_K {found.I_K:.3f} ({found.wall_s:.1f} s)"
    )
    return answer, [gains_table(title, found.gains), *margins_text(margins)]


def _diagnosis_text(why: "Diagnosis") -> Iterator[str]:
    yield (
        f"within the limits I_K is at least {why.smallest_I_K:.2f} and R_K at most "
        f"{why.largest_R_K:.4f}; all limits times {why.common_factor:.2f} would be enough"
    )
    for one in why.limits:
        alone = (
            f"times {one.factor_alone:.2f} alone would be enough"
            if one.factor_alone < float("inf")
            else "no factor alone would be enough"
        )
        yield f"limit {one.name}: {alone}; without it I_K {one.smallest_I_K_without:.2f}"
