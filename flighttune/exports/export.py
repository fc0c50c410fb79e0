"""A flight for JSBSim alone, or the outer loop in C, from one gain set of a scenario."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias

from flighttune.control.gains import PIGains
from flighttune.exports.c_source import export_c
from flighttune.exports.jsbsim_folder import ExportedFlight, export_jsbsim
from flighttune.flight.load import scenario_and_gains
from flighttune.present.answer import Answer, Answering
from flighttune.scenario.schema import Scenario

Form: TypeAlias = Literal["jsbsim", "c"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportedSource(Answering):
    """The outer loop as a file of C99."""

    source: Path
    notes: tuple[str, ...] = ()

    def answer(self) -> Answer:
        """The file and its folder."""
        return Answer(notes=self.notes, files={"folder": self.source.parent, "source": self.source})


def export(
    scenario: Scenario | str | Path,
    gains: PIGains | str | None = None,
    *,
    out: str | Path,
    plant: str | None = None,
    form: Form = "jsbsim",
    changes: Mapping[str, Any] | None = None,
) -> ExportedFlight | ExportedSource:
    """Write one flight of a scenario for JSBSim alone, or its outer loop in C.

    JSBSim flies the folder at once, in a process of its own, and its flight is compared with that
    of `fly`; this takes seconds.

    Parameters
    ----------
    scenario : Scenario, str or Path
        A scenario, a file, or the name of a shipped one.
    gains : PIGains or str, optional
        Gains, or a gain set by name or file; by default the first of the scenario.
    out : str or Path
        Folder to write to; files of the same names are replaced.
    plant : str, optional
        Label of the aircraft; by default the first of the scenario.
    form : {"jsbsim", "c"}
        A folder that JSBSim flies by itself, or one C99 file.
    changes : mapping of str to value, optional
        Values to set in the scenario by dotted key.

    Returns
    -------
    ExportedFlight or ExportedSource
        The files, and how the two flights compare.

    Raises
    ------
    InputError
        If the scenario has no such aircraft, a wind that changes, or a law that has no such form.
    InfeasibleError
        If tuning finds no such gains.
    PlantError
        If the aircraft cannot be built or has no steady flight to start from.
    OutputError
        If the folder cannot be written.

    Examples
    --------
    >>> ft.export("paper", "paper", out="loop", form="c").source.name
    'ft_outer_loop.c'
    """
    loaded, name, chosen = scenario_and_gains(scenario, gains, changes)
    notes = loaded.gains_notes(plant, name)
    if form == "c":
        source = export_c(loaded, name, chosen, Path(out), plant=plant)
        return ExportedSource(source=source, notes=notes)
    flight = export_jsbsim(loaded, name, chosen, Path(out).absolute(), plant=plant)
    return replace(flight, notes=notes)
