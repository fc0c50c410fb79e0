"""The command that exports gains: for JSBSim alone, or in C for a board."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

from flighttune.cli.gain_sets import chosen_gains
from flighttune.cli.options import AircraftPlantOption, GainsOption, ScenarioArgument, out_folder
from flighttune.cli.show import emit


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
        emit({"folder": folder, "source": source}, [f"source: {source}"])
        return
    found = export_jsbsim(loaded, name, chosen, folder, plant=plant)
    answer = {
        "folder": found.folder,
        "script": found.script,
        "csv": found.csv,
        "command": found.command,
        "start_s": found.t_0,
    }
    text = [
        f"folder: {found.folder}",
        f"fly it: {found.command}",
        f"writes: {found.csv}, the flight from Time = {found.t_0:g} s on",
    ]
    emit(answer, text)
