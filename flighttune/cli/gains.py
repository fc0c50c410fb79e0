"""Commands that find gains; gains by name or file, and how commands print them."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flighttune.cli import options
from flighttune.cli.show import NO, fail, pick
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Column, Table

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.control.margins import Margins
    from flighttune.scenario import Scenario

# Searches over an envelope, besides the one from the gains tuned at the trim.
ENVELOPE_STARTS = 2

MARGIN_COLUMNS = [
    *columns("loop"),
    Column("gain_decrease", "gain from"),
    Column("gain_increase", "gain to"),
    *columns("phase_margin_deg delay_margin_s lag_margin_s"),
]
RESULT_COLUMNS = columns("status R_K I_K E_K spectral_abscissa active method starts wall_s")
ENVELOPE_COLUMNS = [
    *columns("status"),
    Column("R_envelope", "rate over the envelope", "1/s"),
    *columns("R_K I_K E_K spectral_abscissa wall_s"),
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
OF_LOOP = columns("R_K I_K E_K spectral_abscissa")
CERTIFICATE_STATUS = [Column("in_words", "status"), *columns("rate growth")]
OF_CERTIFICATE = [*CERTIFICATE_STATUS, *columns("radius")]


def tune(
    scenario: options.ScenarioArgument,
    envelope: Annotated[
        bool, Option("--envelope", help="Maximise the rate over the scenario's envelope.")
    ] = False,
    settings: options.SetOption = None,
    out: options.GainsFileOption = None,
    prove: Annotated[
        Path | None,
        Option(help="File for a proof that bounds R_K over all gains; `verify` checks it."),
    ] = None,
) -> Answer:
    """Find the gains with the largest R_K under the constraints of SCENARIO."""
    from flighttune.control.gains import gains_table
    from flighttune.control.margins import loop_margins
    from flighttune.scenario import load_scenario

    options.check_ending(out, ".json")
    options.check_ending(prove, ".json")
    loaded = load_scenario(scenario, changes=options.changes(settings))
    if envelope and loaded.tuning.objective != "R_K":
        raise InputError("--envelope: `objective` of [tuning] must be R_K, got cost.")
    gains, search = _over_envelope(loaded) if envelope else _at_trim(loaded)
    tuned = search.values["status"] in ("optimal", "found")
    margins = loop_margins(loaded.linear_model(), gains) if tuned and gains else ()
    first, *others = search.tables
    answer = replace(
        search,
        values={**search.values, **gains_values(gains)},
        tables=[first, gains_table("gains", gains), margins_table(margins), *others],
        files={"out": out},
        failure="" if tuned else f"{scenario}: {search.values['reason']}",
    )
    if prove is not None:
        answer = _with_bound(loaded, answer, prove)
    if out is not None:
        save_answer(out, answer)
    return answer


def _with_bound(scenario: "Scenario", answer: Answer, file: Path) -> Answer:
    """The answer with a proven bound on R_K over all gains, whose proof is written to `file`."""
    from flighttune.certificates.bound import bound_rate
    from flighttune.files.value import write
    from flighttune.flight.outer_loop import tuning_problem

    problem = tuning_problem(scenario)
    bound = bound_rate(problem.model, problem.I_star, problem.scaling)
    if bound is None:
        fail(f"--prove: no proof was found for `I_star` {problem.I_star:g}.", NO)
    write(bound, file)
    return replace(
        answer,
        values={**answer.values, "bound": bound.answer().values},
        notes=[*answer.notes, f"proven {bound.sentence}"],
        files={**answer.files, "proof": file},
    )


def frontier(
    scenario: options.ScenarioArgument,
    out: Annotated[Path | None, options.out_folder("runs/NAME")] = None,
    points: Annotated[int, Option(min=2, max=1000, help="Points of the frontier.")] = 25,
    settings: options.SetOption = None,
) -> Answer:
    """Tabulate and draw the largest R_K for each I_K, with the paper's and the scenario's gains.

    The same gains are drawn against E_K, the largest error that a disturbance can cause.
    """
    from flighttune.control.gains import paper_family
    from flighttune.files.whole import write_text
    from flighttune.flight.outer_loop import gain_set, tuning_problem
    from flighttune.present.chart import Sheet
    from flighttune.present.palette import line_styles
    from flighttune.scenario import load_scenario
    from flighttune.tuning.frontier import frontier as frontier_table
    from flighttune.tuning.frontier import frontier_chart

    loaded = load_scenario(scenario, changes=options.changes(settings))
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
    of_gains = {name: style for (_, name), style in styles.items()}
    charts = [frontier_chart(table, of_gains, against=key) for key in ("I_K", "E_K")]
    Sheet(charts=charts, columns=1).save(svg)
    shown = columns("name I_K E_K R_K spectral_abscissa")
    rows = table[[column.key for column in shown]].to_dict(orient="records")
    return Answer(
        values={
            "points": [row for row in rows if row["name"] == "frontier"],
            "marked": {row["name"]: row for row in rows if row["name"] != "frontier"},
        },
        tables=[Table(shown, rows, loaded.title)],
        files={"csv": csv, "figure": svg},
    )


def _at_trim(scenario: "Scenario") -> "tuple[PIGains | None, Answer]":
    from flighttune.flight.outer_loop import tune_scenario, tuning_problem, tuning_scaling
    from flighttune.tuning.diagnosis import diagnosis

    result, scaling = tune_scenario(scenario), tuning_scaling(scenario)
    n, _, p = scenario.linear_model().shape
    why, tables = None, []
    if result.status == "infeasible":
        nearest = diagnosis(tuning_problem(scenario))
        why = pick(nearest, "smallest_I_K largest_R_K common_factor binding limits")
        tables = [
            Table(DIAGNOSIS_COLUMNS, [why], "within the limits"),
            Table(LIMIT_COLUMNS, nearest.limits, "limits"),
        ]
    values = {
        **pick(
            result, "status reason R_K I_K E_K cost spectral_abscissa active starts wall_s method"
        ),
        "scaling": [1.0] * (n + p) if scaling is None else scaling,
        "diagnosis": why,
    }
    by_cost = scenario.tuning.objective == "cost"
    shown = [*RESULT_COLUMNS, Column("cost", "quadratic cost")] if by_cost else RESULT_COLUMNS
    note = "units of state: scaled by [tuning]; `certify` gives R_K in plain ones too"
    return result.gains, Answer(
        values=values,
        tables=[Table(shown, [values], "tuning"), *tables],
        notes=["units of state: plain, as in `certify`" if scaling is None else note],
    )


def _over_envelope(scenario: "Scenario") -> "tuple[PIGains | None, Answer]":
    from flighttune.flight.outer_loop import trim_and_envelope, tuning_problem
    from flighttune.tuning.envelope import tune_over_envelope
    from flighttune.tuning.result import assessment

    trim, envelope = trim_and_envelope(scenario)
    problem, g = tuning_problem(scenario), scenario.flight.g_mps2
    result = tune_over_envelope(problem, envelope, trim, g=g, starts=ENVELOPE_STARTS)
    at_trim = {"E_K": None, "spectral_abscissa": None, "active": []}
    if result.gains is not None:
        at_trim = pick(assessment(problem, result.gains.K), "E_K spectral_abscissa active")
    values = {
        **pick(result, "status reason R_K I_K factor wall_s"),
        **at_trim,
        "starts": ENVELOPE_STARTS,
        "R_envelope": result.R,
        "R_envelope_bound": result.R_bound,
    }
    table = Table(ENVELOPE_COLUMNS, [values], "tuning over the envelope")
    return result.gains, Answer(values=values, tables=[table])


def chosen_gains(
    source: str, wanted: str | None, settings: list[str] | None
) -> "tuple[Scenario, str, PIGains]":
    """Scenario, and the name and gains of ``--gains``; exit status 1 if tuning finds none."""
    from flighttune.flight.outer_loop import scenario_and_gains

    return scenario_and_gains(source, wanted, options.changes(settings))


def gains_values(gains: "PIGains | None") -> dict[str, Any]:
    """``K_P`` and ``K_I`` as nested lists, null where there are no gains."""
    return {"K_P": None, "K_I": None} if gains is None else dict(gains.as_lists())


def margins_table(margins: "Sequence[Margins]") -> Table:
    """Stability margins: a row a channel, and one for all channels at once."""
    records = [
        {
            **pick(row, "loop gain_decrease gain_increase"),
            "phase_margin_deg": math.degrees(row.phase_margin),
            "delay_margin_s": row.delay_margin,
        }
        for row in margins
    ]
    if margins:
        records[-1] |= {
            "lag_margin_s": margins[-1].lag_margin,
            "disk_margin": margins[-1].disk_margin,
        }
    return Table(MARGIN_COLUMNS, records, "stability margins", name="margins")


def save_answer(path: Path, answer: Answer) -> None:
    """Write the JSON object of an answer to a file, whole or not at all."""
    from flighttune.files.whole import write_text

    write_text(path, answer.json() + "\n")
