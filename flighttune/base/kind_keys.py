"""Tables whose keys depend on their kind, which may be a user's class."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Annotated, Any, Protocol, Self

from pydantic import ConfigDict, Field, PrivateAttr

from flighttune.base import quantities as q


class Kind(Protocol):
    """A kind of law or plant, as the table that names it sees it."""

    @property
    def keys(self) -> frozenset[str]:
        """Keys that only this kind takes."""
        ...

    @property
    def required(self) -> tuple[str, ...]:
        """Keys that must be given with it."""
        ...


class OwnTable(q.Table):
    """A law or plant, which may be a user's class; the class itself is never written to a file."""

    model_config = ConfigDict(serialize_by_alias=True)

    module: Annotated[str, Field(min_length=1)] | None = None  # file of the class, for kind python
    # Name of the class in that file
    class_: Annotated[str, Field(min_length=1)] | None = Field(default=None, alias="class")
    parameters: dict[str, Any] | None = None  # keyword arguments of the class
    sha256: str | None = None  # hash of the file when the scenario was read; filled in
    _maker: Callable[..., Any] | None = PrivateAttr(None)

    @property
    def maker(self) -> Callable[..., Any] | None:
        """The user's class, once it is loaded or given from Python."""
        return self._maker

    @property
    @abstractmethod
    def family(self) -> Kind:
        """Keys, labels and defaults of its kind."""

    @property
    def of_the_user(self) -> bool:
        """Whether a user's class flies."""
        return "module" in self.family.keys

    def made_by(self, maker: Callable[..., Any]) -> Self:
        """The table with the user's class."""
        table = self.model_copy()
        table._maker = maker
        return table


def check_keys(table: q.Table, kind: str, kinds: Mapping[str, Kind]) -> None:
    """Refuse keys of other kinds, and a table that lacks a key which its kind requires."""
    for key in sorted(table.model_fields_set - kinds[kind].keys):
        if others := " or ".join(name for name, other in kinds.items() if key in other.keys):
            raise ValueError(f"`{key.removesuffix('_')}` must be given with kind {others} only")
    for key in kinds[kind].required:
        if getattr(table, key) is None:
            raise ValueError(f"`{key}` must be given with kind {kind}")
    if len({"module", "class_"} & table.model_fields_set) == 1:
        raise ValueError("`module` and `class` must be given together")
