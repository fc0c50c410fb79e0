"""What a worker of the cluster runs: a chunk of flights, flown by a process of its own.

A worker never flies itself. A flight that ends its process, or does not end, therefore costs a
process that is replaced in a second, and the worker knows which run it was.
"""

import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from flighttune.campaign.engine.flyer_process import Fallen, Flown, FlyerProcess
from flighttune.errors import PlantError

_OF_THREAD = threading.local()
_FLYERS: list[FlyerProcess] = []


@dataclass(frozen=True, slots=True)
class FlownChunk:
    """What came of a chunk of runs; a worker returns its attributes as a dict.

    Attributes
    ----------
    tables : tuple of bytes
        Rows as Arrow streams, in order of `run`.
    fallen : tuple of (int, str, str)
        Run, status and reason of those that have no rows because nobody could finish them.
    seconds : float, s
        Time the flights took.
    refused : str
        Why this worker cannot fly for the campaign; empty where it can.
    """

    tables: tuple[bytes, ...] = ()
    fallen: tuple[tuple[int, str, str], ...] = ()
    seconds: float = 0.0
    refused: str = ""


@dataclass(slots=True)
class _Chunk:
    flyer: FlyerProcess
    plan: str
    limit: float
    tables: list[bytes] = field(default_factory=list)
    fallen: list[tuple[int, str, str]] = field(default_factory=list)
    seconds: float = 0.0

    def fly(self, first: int, end: int) -> None:
        """Fly the runs `first` to `end`; where they end the process, find out which one it is."""
        if first == end:
            return
        if end - first == 1:
            self._fly_alone(first, fell=0)
            return
        found = self._try(first, end)
        if found is None:
            return
        suspect = found.run if first <= found.run < end else first
        self.fly(first, suspect)
        if self._fly_alone(suspect, fell=1):
            self.fly(suspect + 1, end)
        else:  # it was another one of those that had begun together
            middle = (suspect + 1 + end) // 2
            self.fly(suspect + 1, middle)
            self.fly(middle, end)

    def _fly_alone(self, run: int, *, fell: int) -> bool:
        """Fly one run that `fell` so often; return whether it falls.

        It does where its process ends a second time: once that can have been by another hand.
        """
        found = self._try(run, run + 1)
        if found is not None and found.status == "crashed" and not fell:
            found = self._try(run, run + 1)
        if found is not None:
            self.fallen.append((run, found.status, found.reason))
        return found is not None

    def _try(self, first: int, end: int) -> Fallen | None:
        found = self.flyer.rows(self.plan, first, end, self.limit)
        if isinstance(found, Fallen) and found.run < 0:  # once that can have been by another hand
            found = self.flyer.rows(self.plan, first, end, self.limit)
        if isinstance(found, Flown):
            self.tables.append(found.data)
            self.seconds += found.seconds
            return None
        if found.run < 0:
            raise PlantError(f"the undispersed flights cannot be flown: {found.reason}")
        return found


def fly_chunk(
    plan: str, versions: Mapping[str, str], first: int, end: int, limit: float
) -> dict[str, Any]:
    """Fly the runs `first` to `end` of a plan.

    Parameters
    ----------
    plan : str
        The plan as JSON.
    versions : mapping of str to str
        Libraries the rows shall come from.
    first, end : int
        Runs, `end` not among them.
    limit : float, s
        Longest wall time of a run.

    Returns
    -------
    dict
        The attributes of a `FlownChunk`.
    """
    try:
        flyer = _flyer()
        if refused := _refusal(flyer, versions):
            return {"refused": refused}
        chunk = _Chunk(flyer, plan, limit)
        chunk.fly(first, end)
    except PlantError as error:
        return {"refused": str(error)}
    return {
        "tables": tuple(chunk.tables),
        "fallen": tuple(chunk.fallen),
        "seconds": chunk.seconds,
    }


def fly_signals(plan: str, run: int, limit: float) -> bytes:
    """Fly a run of a plan once more for its signals: the bytes of its recording, none if it falls.

    Parameters
    ----------
    plan : str
        The plan as JSON.
    run : int
        Which one.
    limit : float, s
        Longest wall time of the run.
    """
    found = _flyer().signals(plan, run, limit)
    return found.data if isinstance(found, Flown) else b""


def stand_down() -> None:
    """End every flight of this worker, and let none begin: it is about to end."""
    for flyer in _FLYERS:
        flyer.retire()


def _flyer() -> FlyerProcess:
    """The process that flies for this thread."""
    if not hasattr(_OF_THREAD, "flyer"):
        _OF_THREAD.flyer = FlyerProcess()
        _FLYERS.append(_OF_THREAD.flyer)
    _OF_THREAD.flyer.start()
    return _OF_THREAD.flyer


def _refusal(flyer: FlyerProcess, versions: Mapping[str, str]) -> str:
    """Why rows of this worker would not be those of the campaign."""
    return "; ".join(
        f"{name} must be {wanted}, got {flyer.versions.get(name, 'none')}"
        for name, wanted in versions.items()
        if flyer.versions.get(name) != wanted
    )
