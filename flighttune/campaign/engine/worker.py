"""What a worker does, here or on a cluster: a chunk of runs, flown by a subprocess of its own.

A worker never flies itself. A run that crashes its process, or does not end, therefore costs a
process that is replaced in a second, and the worker knows which run it was.
"""

import threading
from dataclasses import dataclass, field

from flighttune.campaign.engine.flyer import CrashedRun, Flyer, FlyerAnswer
from flighttune.errors import PlantError

_OF_THREAD = threading.local()
_FLYERS: list[Flyer] = []


@dataclass(slots=True)
class FlownChunk:
    """What came of a chunk of runs.

    Attributes
    ----------
    tables : list of bytes
        Rows as Arrow streams.
    crashed : list of CrashedRun
        Those that have no rows.
    seconds : float, s
        Time the flights took.
    refused : str
        Why this worker cannot fly for the campaign; empty where it can.
    """

    tables: list[bytes] = field(default_factory=list)
    crashed: list[CrashedRun] = field(default_factory=list)
    seconds: float = 0.0
    refused: str = ""


def fly_chunk(
    plan: str, versions: dict[str, str], first: int, end: int, limit: float
) -> FlownChunk:
    """Fly the runs `first` to `end` of a plan.

    Parameters
    ----------
    plan : str
        The plan as JSON.
    versions : dict of str to str
        Libraries the rows must come from.
    first, end : int
        Runs, `end` not among them.
    limit : float, s
        Longest wall time of a run.
    """
    try:
        flyer = _flyer()
        if refused := _other_versions(flyer.versions, versions):
            return FlownChunk(refused=refused)
        bisection = _Bisection(flyer, plan, limit)
        bisection.fly(first, end)
    except PlantError as error:
        return FlownChunk(refused=str(error))
    return bisection.chunk


@dataclass(slots=True)
class _Bisection:
    """Flies a chunk; where runs of it crash, finds out which ones by flying parts of it again."""

    flyer: Flyer
    plan: str
    limit: float
    chunk: FlownChunk = field(default_factory=FlownChunk)

    def fly(self, first: int, end: int) -> None:
        """Fly the runs `first` to `end`, and each that crashes alone."""
        if first == end:
            return
        if end - first == 1:
            self._fly_alone(first, crashes=0)
            return
        crash = self._try(first, end)
        if crash is None:
            return
        # The run that had begun last is the suspect. It is the one where runs are flown one by one.
        # Runs of a batch begin together: then it is the first of them, and any may have crashed.
        # Rows come back for a whole chunk only, so that those before it are flown again too.
        suspect = crash.run if first <= crash.run < end else first
        self.fly(first, suspect)
        if self._fly_alone(suspect, crashes=1):
            self.fly(suspect + 1, end)
        else:  # another run of the batch crashed: halve the rest until it is found
            middle = (suspect + 1 + end) // 2
            self.fly(suspect + 1, middle)
            self.fly(middle, end)

    def _fly_alone(self, run: int, *, crashes: int) -> bool:
        """Fly one run that crashed `crashes` times so far; return whether it crashes.

        Only a second crash counts: somebody else (an operator, the system out of memory) may have
        killed the process once.
        """
        crash = self._try(run, run + 1)
        if crash is not None and crash.status == "crashed" and not crashes:
            crash = self._try(run, run + 1)
        if crash is not None:
            self.chunk.crashed.append(crash._replace(run=run))
        return crash is not None

    def _try(self, first: int, end: int) -> CrashedRun | None:
        found = self.flyer.rows(self.plan, first, end, self.limit)
        if isinstance(found, CrashedRun) and found.run < 0:  # before any run: as in `_fly_alone`
            found = self.flyer.rows(self.plan, first, end, self.limit)
        if isinstance(found, FlyerAnswer):
            self.chunk.tables.append(found.data)
            self.chunk.seconds += found.seconds
            return None
        if found.run < 0:
            raise PlantError(f"the undispersed flights cannot be flown: {found.reason}")
        return found


def fly_signals(plan: str, run: int, limit: float) -> bytes:
    """Fly a run once more for its signals: the bytes of its recording, none if it crashes.

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
    return found.data if isinstance(found, FlyerAnswer) else b""


def cancel_flights() -> None:
    """End every flight of this worker, and let none begin: the worker is about to end."""
    for flyer in _FLYERS:
        flyer.cancel()


def end_flights() -> None:
    """End the processes that fly, after `cancel_flights` and once no thread uses them."""
    while _FLYERS:
        _FLYERS.pop().close()


def fly_by(flyer: Flyer) -> None:
    """Let this thread fly by a process that has been started."""
    _OF_THREAD.flyer = flyer
    _FLYERS.append(flyer)


def _flyer() -> Flyer:
    """The process that flies for this thread."""
    if not hasattr(_OF_THREAD, "flyer"):
        fly_by(Flyer())
    _OF_THREAD.flyer.start()
    return _OF_THREAD.flyer


def _other_versions(got: dict[str, str], wanted: dict[str, str]) -> str:
    """Why rows of this worker would not be those of the campaign; empty where they would."""
    return "; ".join(
        f"{name} must be {wanted.get(name, 'absent')}, got {got.get(name, 'none')}"
        for name in (wanted | got)
        if got.get(name) != wanted.get(name)
    )
