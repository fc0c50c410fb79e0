"""The command that explains why the aircraft flies differently from the paper's law."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

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
from flighttune.cli.show import NO, emit, fail, tell
from flighttune.cli.tube import (
    fail_if_outside,
    run_tubes,
    run_tubes_notes,
    run_tubes_table,
    run_tubes_values,
)
from flighttune.present.answer import Answer

if TYPE_CHECKING:
    from flighttune.flight.gap import Gap


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

    Exit status 1 if a flight ends early, or the aircraft leaves its tube.
    """
    from flighttune.flight.gap import explain_gap
    from flighttune.flight.gap_charts import gap_sheet
    from flighttune.recording.record import record
    from flighttune.report.gap import gap_tables, gap_values, write_gap_page
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario)
    for note in loaded.notes:
        tell(f"{scenario}: {note}")
    name, chosen = chosen_gains(loaded, gains)
    stem = f"{Path(scenario).stem}-gap"
    folder = out or Path("runs") / stem
    with progress_bar() as progress:
        explained = explain_gap(
            loaded, chosen, name=Path(name).stem, plant=plant, lag=lag, progress=progress
        )
    top = explained.runs[-1]
    tubes = run_tubes([top], folder, make=tube, conformance=conformance)
    explained = replace(explained, runs=(*explained.runs[:-1], *tubes.runs))
    files = record(explained.flown(), folder, name=stem)
    values = gap_values(explained, files.signals)
    tables = gap_tables(explained, values)
    figure = page = None
    if explained.steps:
        figure, page = folder / "gap.svg", folder / "gap.html"
        gap_sheet(explained).save(figure)
        write_gap_page(explained, tables, page)
    emit(
        Answer(
            values={**values, "tubes": run_tubes_values(tubes)},
            tables=[*tables, run_tubes_table(tubes)],
            notes=[
                *_failed(explained),
                *run_tubes_notes(tubes, f"flighttune gap {scenario} --tube --conformance FILE"),
            ],
            files={"recording": files.recording, "figure": figure, "page": page},
        )
    )
    fail_if_outside(tubes)
    if explained.status != "explained":
        fail(f"{scenario}: {explained.reason}", NO)


def _failed(gap: "Gap") -> list[str]:
    if not (gap.steps and gap.failed):
        return []
    why = "; ".join(f"{plant} {reason}" for plant, reason in gap.failed.items())
    return [f"No metrics of, from or to a rung that failed: {why}"]
