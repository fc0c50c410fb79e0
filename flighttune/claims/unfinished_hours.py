"""Flights of a claim per flight hour, written while they are flown, so that it can go on."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from flighttune.base.errors import InputError
from flighttune.base.files import owned, whole
from flighttune.base.files.table import STRICT, read, tables_of, write
from flighttune.campaigns.engine.progress import CampaignObserver
from flighttune.claims.hourly_flights import Ends, FlownTerm
from flighttune.claims.leaving import Alarms, Volume
from flighttune.flight.fly import library_versions
from flighttune.flight.records.refly import other_libraries


@dataclass(frozen=True, kw_only=True, eq=False)
class UnfinishedHours:
    """The terms of a claim so far, and all that decides what their flights do."""

    rates: dict[str, Any]
    plan: dict[str, Any]
    volume: Volume
    alarms: Alarms | None = None
    versions: dict[str, str] = field(default_factory=library_versions)
    terms: tuple[FlownTerm, ...] = ()

    __pydantic_config__: ClassVar = STRICT
    FORMAT: ClassVar[str] = "flighttune unfinished flight hours 1"
    UNITS: ClassVar[Mapping[str, str]] = {"volume": "m"}


class KeptTerms:
    """The terms of a claim so far, also in a file with which the same command goes on."""

    def __init__(self, ends: Ends, file: Path | None, observer: CampaignObserver) -> None:
        self._file = file
        self._claim = UnfinishedHours(
            rates=ends.rates.model_dump(mode="json", exclude_none=True),
            plan=ends.plan.as_dict(),
            volume=ends.volume,
            alarms=ends.alarms,
        )
        if file is None or not file.exists():
            return
        try:
            if not owned.is_believed(file):
                raise InputError(f"{file}: must be a file of this user alone.")
            kept = read(file, UnfinishedHours)
            if other := other_libraries(kept.versions):
                raise InputError(f"{file}: was flown with other libraries: {other}")
            if tables_of(replace(kept, terms=())) != tables_of(self._claim):
                raise InputError(f"{file}: its flights belong to another count.")
        except InputError as error:
            observer.hear(f"{str(error).rstrip('.')}: it is counted from the beginning.")
        else:
            self._claim = kept
            observer.hear(f"{file}: {self.flights} flights are counted already.")

    @property
    def flights(self) -> int:
        """Number of flights that are kept."""
        return sum(map(len, self._claim.terms))

    def begun(self, fault: int | None, ended_s: float | None) -> FlownTerm:
        """A term with the flights that are kept of it."""
        none = FlownTerm(fault=fault, ended_s=ended_s, left_s=(), end_s=(), ended_at_s=())
        return next((x for x in self._claim.terms if _same(x, none)), none)

    def keep(self, term: FlownTerm) -> None:
        """Keep a term that has grown, and write it at once even if it is part of an answer."""
        others = (x for x in self._claim.terms if not _same(x, term))
        self._claim = replace(self._claim, terms=(*others, term))
        if self._file is not None:
            with whole.apart():
                write(self._claim, self._file)

    def remove(self) -> None:
        """Remove the file of a claim that is finished."""
        if self._file is not None and self._file.exists():
            whole.remove_file(self._file)


def _same(one: FlownTerm, other: FlownTerm) -> bool:
    return (one.fault, one.ended_s) == (other.fault, other.ended_s)
