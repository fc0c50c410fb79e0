"""Commands that find gains, and the file that they write."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Option

from flighttune.cli import options
from flighttune.present.answer import Answer


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
    from flighttune.files.value import write
    from flighttune.flight.gains import tune as tune_scenario

    options.check_ending(out, ".json")
    options.check_ending(prove, ".json")
    result = tune_scenario(
        scenario,
        envelope=envelope,
        prove=prove is not None,
        changes=options.changes(settings),
    )
    answer = result.answer()
    answer = replace(answer, files={"out": out, "proof": prove})
    if prove is not None and result.bound is not None:
        write(result.bound, prove)
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
    from flighttune.files.whole import write_text
    from flighttune.flight.frontier import frontier as find_frontier

    result = find_frontier(scenario, points=points, changes=options.changes(settings))
    folder = out or Path("runs") / Path(scenario).stem
    csv, svg = folder / "frontier.csv", folder / "frontier.svg"
    write_text(csv, result.table.to_csv(index=False, lineterminator="\n"))
    result.sheet.save(svg)
    return replace(result.answer(), files={"csv": csv, "figure": svg})


def save_answer(path: Path, answer: Answer) -> None:
    """Write the JSON object of an answer to a file, whole or not at all."""
    from flighttune.files.whole import write_text

    write_text(path, answer.json() + "\n")
