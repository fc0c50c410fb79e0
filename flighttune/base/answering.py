"""Results that answer: the functions that make their answers are found in a table.

The functions lie in the rooms above and are imported on first use. This module knows the names of
all results and no text of an answer.
"""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

# Characters of a line that is printed from Python.
WIDTH = 100

# By class of a result, as module:function: what makes its answer, and what draws its figure.
SPEAKERS = {
    "Adoption": "flighttune.outputs.answers.adoption:answer",
    "AircraftIdentification": "flighttune.outputs.answers.identification:answer",
    "Band": "flighttune.outputs.answers.band:answer",
    "Beside": "flighttune.outputs.answers.beside:answer",
    "CampaignOutcome": "flighttune.outputs.answers.campaign:flown",
    "Certificate": "flighttune.outputs.answers.certificate:answer",
    "Certification": "flighttune.outputs.answers.certification:answer",
    "Comparison": "flighttune.outputs.answers.compare:answer",
    "Counted": "flighttune.outputs.answers.counted:answer",
    "DesignedAircraft": "flighttune.outputs.answers.design:answer",
    "ExportedFlight": "flighttune.outputs.answers.export:flight",
    "ExportedSource": "flighttune.outputs.answers.export:source",
    "FlownScenario": "flighttune.outputs.answers.flown:answer",
    "Forecast": "flighttune.outputs.answers.campaign:planned",
    "Frontier": "flighttune.outputs.answers.frontier:answer",
    "Gap": "flighttune.outputs.answers.gap:answer",
    "Gradient": "flighttune.outputs.answers.gradient:answer",
    "Indicators": "flighttune.outputs.answers.indicators:answer",
    "LogGap": "flighttune.outputs.answers.log_gap:answer",
    "LogIdentification": "flighttune.outputs.answers.log_identification:answer",
    "LogMonitor": "flighttune.outputs.answers.monitor:answer",
    "Meeting": "flighttune.outputs.answers.meeting:answer",
    "MissionOdds": "flighttune.outputs.answers.mission:answer",
    "PerHour": "flighttune.outputs.answers.per_hour:answer",
    "PlannedMission": "flighttune.outputs.answers.mission:planned",
    "PlannedRoute": "flighttune.outputs.answers.route:answer",
    "RateBound": "flighttune.outputs.answers.bound:answer",
    "Reflown": "flighttune.outputs.answers.refly:answer",
    "Report": "flighttune.outputs.pages.frame:answer",
    "Reproduction": "flighttune.outputs.paper.reproduce:answer",
    "Retuned": "flighttune.outputs.answers.retuned:answer",
    "Run": "flighttune.outputs.answers.run:facts",
    "TriedDisturbances": "flighttune.outputs.answers.tube:tried",
    "Trims": "flighttune.outputs.answers.trim:answer",
    "Tube": "flighttune.outputs.answers.tube:answer",
    "TuningResult": "flighttune.outputs.answers.tuning:answer",
    "Verified": "flighttune.outputs.answers.verify:answer",
    "WorstFlight": "flighttune.outputs.answers.worst:answer",
}
FIGURES = {
    "AircraftIdentification": "flighttune.outputs.answers.identification:sheet",
    "DesignedAircraft": "flighttune.outputs.answers.design:sheet",
    "Frontier": "flighttune.outputs.answers.frontier:sheet",
    "Indicators": "flighttune.outputs.answers.indicators:answer",
    "LogGap": "flighttune.outputs.answers.log_gap:sheet",
    "LogIdentification": "flighttune.outputs.answers.log_identification:sheet",
}


class Answering:
    """A result that terminal, ``--json`` and notebooks show by its `answer`."""

    __slots__ = ()

    def answer(self, *args: Any, **options: Any) -> Any:
        """Values, tables, notes and verdict, as they are shown; see `SPEAKERS`."""
        return function_for(self, SPEAKERS)(self, *args, **options)

    def save(self, path: str | Path, /) -> Any:
        """Write the JSON object of the answer; gains in it are read by `load_gains`."""
        self.answer().save(path)

    # A dataclass without a `__repr__` of its own would print all its arrays.
    def __init_subclass__(cls) -> None:
        cls.__repr__ = Answering.__str__

    def __str__(self) -> str:
        return "\n".join(self.answer().text(WIDTH))

    def _repr_html_(self) -> str:
        return self.answer().html()


class Drawn(Answering):
    """An answering result with a figure."""

    __slots__ = ()

    def sheet(self) -> Any:
        """The charts of its figure; see `FIGURES`."""
        return function_for(self, FIGURES)(self)


def function_for(result: object, table: Mapping[str, str]) -> Any:
    """The function in a table for the class of a result, or for the nearest of its base classes."""
    line = [kind.__name__ for kind in type(result).__mro__]
    if (place := next((table[name] for name in line if name in table), None)) is None:
        raise NotImplementedError(f"`{line[0]}` must have a row in the tables of {__name__}.")
    module, _, function = place.partition(":")
    return getattr(import_module(module), function)
