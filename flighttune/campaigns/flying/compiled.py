"""How many flights of aircraft were compiled, and how many JSBSim flew, again or alone."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from flighttune.base.errors import InputError
from flighttune.base.words import listed

if TYPE_CHECKING:
    from flighttune.flight.loop.run import Run

# Key of the counts in a row, in the metadata of a file of rows, in the file of a count and in
# ``--json``.
COMPILED = "compiled"

# Reasons that a sentence names.
SHOWN = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class CompiledFlights:
    """Flights of aircraft by who flew their steps, added up with ``+``."""

    flights: int = 0  # by compiled code
    flown_again: int = 0  # flights of JSBSim that were compared with compiled ones
    by_jsbsim: int = 0  # by JSBSim alone
    # Number of those that were to be compiled, by the reason why JSBSim flew them
    reasons: Mapping[str, int] = field(default_factory=dict)

    @classmethod
    def of(cls, run: "Run", *, again: bool) -> "CompiledFlights":
        """The count of one flight of an aircraft; `again`: JSBSim flew it too."""
        if run.compiled:
            return cls(flights=1, flown_again=int(again))
        return cls(by_jsbsim=1, reasons={run.why_jsbsim: 1} if run.why_jsbsim else {})

    @classmethod
    def stated(cls, text: str | bytes | None) -> "CompiledFlights":
        """The counts in a file; none where an earlier version wrote it, InputError if damaged."""
        if text is None:
            return cls()
        # pydantic, which `--help` does without
        from flighttune.base.files.table import json_object

        try:
            text = text.decode() if isinstance(text, bytes) else text
            counts = cls(**json_object(text, f"`{COMPILED}`"))
            numbers = counts.flights, counts.flown_again, counts.by_jsbsim, *counts.reasons.values()
            if all(type(n) is int and n >= 0 for n in numbers):
                return counts
        except (ValueError, TypeError, AttributeError):
            pass
        raise InputError(f"`{COMPILED}` must hold numbers of flights.")

    @property
    def text(self) -> str:
        """The counts as JSON, for a file."""
        return json.dumps(asdict(self))

    @property
    def values(self) -> dict[str, Any]:
        """The counts as the value of an answer; none without flights of aircraft."""
        return {} if self == CompiledFlights() else {COMPILED: asdict(self)}

    def __add__(self, other: "CompiledFlights") -> "CompiledFlights":
        """Both counts together."""
        reasons = dict(self.reasons)
        for reason, flights in other.reasons.items():
            reasons[reason] = reasons.get(reason, 0) + flights
        return CompiledFlights(
            flights=self.flights + other.flights,
            flown_again=self.flown_again + other.flown_again,
            by_jsbsim=self.by_jsbsim + other.by_jsbsim,
            reasons=reasons,
        )

    @property
    def notes(self) -> list[str]:
        """The counts in a sentence; none where nothing was compiled, or to be."""
        if not (self.flights or self.reasons):
            return []
        most = sorted(self.reasons, key=lambda reason: -self.reasons[reason])
        why = listed([f"{reason} ({self.reasons[reason]})" for reason in most], "and", SHOWN)
        alone = f"JSBSim flew {self.by_jsbsim} itself{f': {why}' if why else ''}"
        if not self.flights:
            return [f"{alone}."]
        again = f"Compiled flights: {self.flights}, of which JSBSim flew {self.flown_again} again"
        return [f"{again}; {alone}." if self.by_jsbsim else f"{again}."]


def compiled_in(rows: Iterable[Mapping[str, Any]]) -> CompiledFlights:
    """The counts of all rows of flights of aircraft."""
    return sum((row[COMPILED] for row in rows if COMPILED in row), CompiledFlights())
