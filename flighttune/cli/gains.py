"""Commands that find gains; gains by name or file, and how commands print them."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from flighttune.cli import options
from flighttune.cli.show import NO, fail
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Table

if TYPE_CHECKING:
    from flighttune.control.gains import PIGains
    from flighttune.scenario.schema import Scenario


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
    from flighttune.certificates.bound import bound_rate
    from flighttune.files.value import write
    from flighttune.flight.gains import tune as tune_scenario

    options.check_ending(out, ".json")
    options.check_ending(prove, ".json")
    result = tune_scenario(scenario, envelope=envelope, changes=options.changes(settings))
    answer = result.answer()
    failure = f"{scenario}: {answer.failure}" if answer.failure else ""
    answer = replace(answer, files={"out": out}, failure=failure)
    if prove is not None:
        problem = result.problem
        bound = bound_rate(problem.model, problem.I_star, problem.scaling)
        if bound is None:
            fail(f"--prove: no proof was found for `I_star` {problem.I_star:g}.", NO)
        write(bound, prove)
        answer = replace(
            answer,
            values={**answer.values, "bound": bound.answer().values},
            notes=[*answer.notes, f"proven {bound.sentence}"],
            files={**answer.files, "proof": prove},
        )
    if out is not None:
        save_answer(out, answer)
    return answer


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
    from flighttune.flight.load import load_scenario
    from flighttune.flight.models import gain_set, tuning_problem
    from flighttune.present.chart import Sheet
    from flighttune.present.palette import line_styles
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


def chosen_gains(
    source: str, wanted: str | None, settings: list[str] | None
) -> "tuple[Scenario, str, PIGains]":
    """Scenario, and the name and gains of ``--gains``; exit status 1 if tuning finds none."""
    from flighttune.flight.load import scenario_and_gains

    return scenario_and_gains(source, wanted, options.changes(settings))


def save_answer(path: Path, answer: Answer) -> None:
    """Write the JSON object of an answer to a file, whole or not at all."""
    from flighttune.files.whole import write_text

    write_text(path, answer.json() + "\n")
