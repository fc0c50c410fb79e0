"""``[[law]]`` of a scenario: the law that turns errors into commands."""

from functools import cache, cached_property
from typing import TYPE_CHECKING, Annotated, Literal, Self, TypeAlias

from pydantic import BeforeValidator, Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.kind_keys import OwnTable, check_keys
from flighttune.control.exact_law import Priority
from flighttune.control.law import Law, law_kinds, made_law, plain_laws

# Laws that a scenario can name without a table.
LAWS = plain_laws()


if TYPE_CHECKING:
    LawKind: TypeAlias = str
else:
    LawKind = Literal[tuple(law_kinds())]


class LawTable(OwnTable):
    """``[[law]]``: the law that turns errors into commands, with the keys of its kind."""

    name: q.Name
    # paper; exact: the inversion of the point mass; autopilot: the guidance of PX4 or ArduPilot
    # with its parameters; python: a class of your own
    kind: LawKind
    priority: Priority | None = None  # exact law: which channel gives way at the limits
    # Exact law: minimum share of lift that is kept
    lift_floor: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    # Exact law: rate at which errors are reduced without overshoot
    braking: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    # Exact law: whether errors of the course are reduced likewise; by default if roll is fed back
    brakes_turns: bool | None = None
    # Whether a law of your own flies every gain set; if left out, once with the first set
    takes_gains: bool | None = None

    @model_validator(mode="after")
    def _keys_of_the_kind(self) -> Self:
        check_keys(self, self.kind, law_kinds())
        if self.name in LAWS and self.name != self.kind:
            raise ValueError(f"`name` of [[law]] must not be {self.name!r} with kind {self.kind}")
        return self

    @property
    def family(self) -> type[Law]:
        """Class of its kind."""
        return law_kinds()[self.kind]

    @cached_property
    def law(self) -> Law:
        """The law, with defaults for keys that are left out."""
        options = {key: getattr(self, key) for key in self.family.keys}
        return made_law(self.kind, self.name, **options, maker=self.maker)


@cache
def law_named(name: str) -> LawTable:
    """One of `LAWS` with its defaults."""
    return LawTable.model_validate({"name": name, "kind": name})


def _law_tables(value: object) -> object:
    """Tables of laws from names and tables, or from one name."""
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list):
        return value
    for law in value:
        if isinstance(law, str) and law not in LAWS:
            raise ValueError(f"`law` must name {' or '.join(LAWS)}, got {law!r}")
    return [law_named(law) if isinstance(law, str) else law for law in value]


Laws: TypeAlias = Annotated[list[LawTable], Field(min_length=1), BeforeValidator(_law_tables)]
