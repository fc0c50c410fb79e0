"""The answers of exports."""

from flighttune.outputs.answers.answer import Answer
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.exports.export import ExportedSource
from flighttune.outputs.exports.jsbsim_folder import COLUMNS, CSV, README, SCRIPT, ExportedFlight


def source(exported: ExportedSource) -> Answer:
    """The written files and their folder."""
    monitor = {"monitor": exported.monitor} if exported.monitor else {}
    files = {"folder": exported.source.parent, "source": exported.source, **monitor}
    summary = [f"The outer loop is written in C99: {exported.source.name}."]
    return Answer(lines=summary, notes=exported.notes, files=files)


def flight(exported: ExportedFlight) -> Answer:
    """The command that flies the folder; a failure if its flight differs from `fly`."""
    folder = exported.folder
    return Answer(
        values={
            "start_s": exported.start,
            "csv": folder / CSV,
            "differences": {COLUMNS[name]: value for name, value in exported.differences.items()},
        },
        lines=[exported.verdict] if exported.same else (),
        notes=[
            *exported.notes,
            f"This command flies it again and writes {folder / CSV}, where the flight begins at "
            f"Time = {exported.start:g} s:",
        ],
        command=exported.command,
        files={"folder": folder, "script": folder / SCRIPT, "readme": folder / README},
        findings=[]
        if exported.same
        else unmet(f"{folder}: {exported.verdict} The folder is kept."),
    )
