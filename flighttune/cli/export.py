"""The command that exports gains: for JSBSim alone, or in C for a board."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

from flighttune.cli.gain_sets import chosen_gains
from flighttune.cli.options import AircraftPlantOption, GainsOption, ScenarioArgument, out_folder
from flighttune.cli.show import emit
from flighttune.present.answer import Answer


def export(
    scenario: ScenarioArgument,
    gains: GainsOption = None,
    plant: AircraftPlantOption = None,
    form: Annotated[
        Literal["jsbsim", "c"],
        Option("--format", help="A folder that JSBSim flies by itself, or one C99 file."),
    ] = "jsbsim",
    out: Annotated[Path | None, out_folder("runs/NAME-export")] = None,
) -> None:
    """Write one flight of SCENARIO for JSBSim alone, or its outer loop in C."""
    from flighttune.export import export_c, export_jsbsim
    from flighttune.scenario import load_scenario

    loaded = load_scenario(scenario)
    name, chosen = chosen_gains(loaded, gains)
    if Path(name).suffix.lower() in (".json", ".toml"):
        name = Path(name).stem  # of a file; a colon in its folder names no law
    folder = out or Path("runs") / f"{Path(scenario).stem}-export"
    if form == "c":
        source = export_c(loaded, name, chosen, folder, plant=plant)
        emit(Answer(files={"folder": folder, "source": source}))
        return
    exported = export_jsbsim(loaded, name, chosen, folder, plant=plant)
    emit(
        Answer(
            values={"command": exported.command, "start_s": exported.t_0},
            notes=[
                f"{exported.command} flies it and writes the table, which has the flight from "
                f"Time = {exported.t_0:g} s on."
            ],
            files={"folder": exported.folder, "script": exported.script, "csv": exported.csv},
        )
    )
