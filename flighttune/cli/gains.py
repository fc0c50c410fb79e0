"""Commands that find gains: the best ones, and the frontier of R_K against I_K."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

from flighttune.cli.gain_sets import gains_table, gains_values, margins_table, save_answer
from flighttune.cli.options import GainsFileOption, ScenarioArgument, check_ending, out_folder
from flighttune.cli.show import NO, emit, fail, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

ENVELOPE_STARTS = 2
"""Searches over an envelope, besides the one from the gains tuned at the trim."""

RESULT_COLUMNS = columns("status R_K I_K spectral_abscissa active method starts wall_s")
ENVELOPE_COLUMNS = [
    *columns("status"),
    Column("R_envelope", "rate over the envelope", "1/s"),
    *columns("R_K I_K spectral_abscissa wall_s"),
]
DIAGNOSIS_COLUMNS = [
    Column("smallest_I_K", "smallest I_K", "s²"),
    Column("largest_R_K", "largest R_K", "1/s"),
    Column("common_factor", "factor on all limits that would be enough"),
]
LIMIT_COLUMNS = [
    Column("name", "limit"),
    Column("factor_alone", "factor on it alone that would be enough"),
    Column("smallest_I_K_without", "smallest I_K without it", "s²"),
]


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
    answer = _tune_over_envelope(scenario) if envelope else _tune_at_trim(scenario, method)
    if out is not None:
        save_answer(out, answer)
    emit(answer)
    if answer.values["status"] not in ("optimal", "found"):
        fail(f"{scenario}: {answer.values['reason']}", NO)


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
    table = frontier_table(tuning_problem(loaded), points=points, marked=marked)
    folder = out or Path("runs") / Path(scenario).stem
    csv, svg = folder / "frontier.csv", folder / "frontier.svg"
    write_text(csv, table.to_csv(index=False, lineterminator="\n"))
    styles = line_styles([("", name) for name in loaded.gain_names])
    chart = frontier_chart(table, {name: style for (_, name), style in styles.items()})
    Sheet(charts=[chart], columns=1).save(svg)
    shown = columns("name I_K R_K spectral_abscissa")
    rows = table[[column.key for column in shown]].to_dict(orient="records")
    emit(
        Answer(
            values={
                "points": [row for row in rows if row["name"] == "frontier"],
                "marked": {row["name"]: row for row in rows if row["name"] != "frontier"},
            },
            tables=[Table(title=loaded.title, columns=shown, records=rows)],
            files={"csv": csv, "figure": svg},
        )
    )


def _tune_at_trim(source: str, method: str | None) -> Answer:
    from flighttune.control.margins import loop_margins
    from flighttune.flight.outer_loop import tune_scenario, tuning_problem, tuning_scaling
    from flighttune.scenario import load_scenario
    from flighttune.tuning.diagnosis import diagnosis

    scenario = load_scenario(source)
    if method is not None:
        changed = scenario.tuning.model_copy(update={"method": method})
        scenario = scenario.model_copy(update={"tuning": changed})
    result, model, scaling = (
        tune_scenario(scenario),
        scenario.linear_model(),
        tuning_scaling(scenario),
    )
    stable = result.gains if result.status == "optimal" else None
    n, _, p = model.shape
    why, tables = None, []
    if result.status == "infeasible":
        nearest = diagnosis(tuning_problem(scenario))
        why = pick(nearest, "smallest_I_K largest_R_K common_factor binding limits")
        tables = [
            Table(title="within the limits", columns=DIAGNOSIS_COLUMNS, records=[why]),
            Table(title="limits", columns=LIMIT_COLUMNS, records=nearest.limits),
        ]
    values = {
        **pick(result, "status reason"),
        **gains_values(result.gains),
        **pick(result, "R_K I_K"),
        "scaling": [1.0] * (n + p) if scaling is None else scaling,
        **pick(result, "spectral_abscissa active starts wall_s method"),
        "diagnosis": why,
    }
    return Answer(
        values=values,
        tables=[
            Table(title="tuning", columns=RESULT_COLUMNS, records=[values]),
            gains_table("gains", result.gains),
            margins_table(() if stable is None else loop_margins(model, stable)),
            *tables,
        ],
        notes=[
            "units of state: plain, as in `certify`"
            if scaling is None
            else "units of state: scaled by [tuning]; `certify` gives R_K in plain ones too"
        ],
    )


def _tune_over_envelope(source: str) -> Answer:
    from flighttune.control.margins import loop_margins
    from flighttune.flight.outer_loop import trim_and_envelope, tuning_problem
    from flighttune.scenario import load_scenario
    from flighttune.tuning.envelope import tune_over_envelope
    from flighttune.tuning.result import assessment

    scenario = load_scenario(source)
    trim, envelope = trim_and_envelope(scenario)
    problem = tuning_problem(scenario)
    result = tune_over_envelope(
        problem, envelope, trim, g=scenario.flight.g_mps2, starts=ENVELOPE_STARTS
    )
    margins, at_trim = (), {"spectral_abscissa": None, "active": []}
    if result.gains is not None:
        margins = loop_margins(scenario.linear_model(), result.gains)
        at_trim = pick(assessment(problem, result.gains.K), "spectral_abscissa active")
    values = {
        **pick(result, "status reason"),
        **gains_values(result.gains),
        **pick(result, "R_K I_K"),
        **at_trim,
        "starts": ENVELOPE_STARTS,
        "R_envelope": result.R,
        "R_envelope_bound": result.R_bound,
        **pick(result, "factor wall_s"),
    }
    return Answer(
        values=values,
        tables=[
            Table(title="tuning over the envelope", columns=ENVELOPE_COLUMNS, records=[values]),
            gains_table("gains", result.gains),
            margins_table(margins),
        ],
    )
