"""Tasks of a campaign, and what every kind of workers does with them."""

from collections.abc import Callable, Hashable
from typing import Any, NamedTuple, Protocol

from flighttune.errors import CampaignError


class Task(NamedTuple):
    """A call for a worker.

    Attributes
    ----------
    about : hashable
        The run or runs it is about.
    function : callable
        Of a module.
    arguments : tuple
    """

    about: Hashable
    function: Callable[..., Any]
    arguments: tuple[Any, ...]


class Done(NamedTuple):
    """A task that is over.

    Attributes
    ----------
    task : Task
    value : object
        What it returned.
    lost : bool
        Whether its worker went away before it returned.
    """

    task: Task
    value: Any = None
    lost: bool = False


class Workers(Protocol):
    """Whoever does tasks: threads here, or a cluster elsewhere."""

    @property
    def waiting(self) -> int:
        """Tasks that are not over."""
        ...

    def threads(self) -> int:
        """How many tasks can run at a time now."""
        ...

    def submit(self, task: Task) -> None:
        """Take on a task."""
        ...

    def wait(self, seconds: float) -> list[Done]:
        """Tasks that are over, after at most `seconds`.

        Raises
        ------
        CampaignError
            If a worker cannot do our tasks, or can no longer be reached.
        """
        ...

    def stop(self) -> None:
        """Take back all tasks, and end the flights in progress where they can be reached."""
        ...


def translated(error: BaseException | None) -> CampaignError:
    """What a task raised, as an error of the campaign."""
    if isinstance(error, ModuleNotFoundError):
        return CampaignError(f"a worker has no `{error.name}`: install flighttune there")
    return CampaignError(f"a worker failed: {type(error).__name__}: {error}")
