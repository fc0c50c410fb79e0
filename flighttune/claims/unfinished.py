"""Counts that take long, written while they are flown, so that a killed command can go on."""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from flighttune.base.errors import InputError
from flighttune.base.files import owned, whole
from flighttune.base.files.table import tables_of
from flighttune.campaigns.engine.progress import CampaignObserver
from flighttune.claims.about import About
from flighttune.claims.counted import BandFlights, Counted
from flighttune.claims.counted_file import read_counted
from flighttune.flight.fly import library_versions

C = TypeVar("C", bound=Counted)

# Flights after which a count is first written. It is written again when it has grown by this
# share, so that little is lost and writing takes a small part of the time.
FIRST, GROWN = 250, 0.125


def unfinished_beside(file: Path) -> Path:
    """The file of an unfinished count, beside the file that will hold it."""
    return Path(f"{file.with_suffix('')}-unfinished{file.suffix}")


def written_at(flights: int) -> list[int]:
    """Numbers of flights, below the planned number, after which a count is written."""
    numbers = [FIRST]
    while numbers[-1] < flights:
        numbers.append(numbers[-1] + math.ceil(GROWN * numbers[-1]))
    return numbers[:-1]


@dataclass(frozen=True, slots=True, kw_only=True)
class Unfinished:
    """The file of a count that is not finished yet, from which the same command goes on."""

    file: Path

    @classmethod
    def beside(cls, counted: Path) -> "Unfinished":
        """The file of an unfinished count, beside the file that will hold it."""
        return cls(file=unfinished_beside(counted))

    def begun(self, count: C, observer: CampaignObserver) -> C:
        """The count with the flights in the file, if they belong to it."""

        def flights_of(about: About) -> BandFlights:
            # The learned shape is part of it, so that an aircraft that flies otherwise is found.
            if tables_of(about) != tables_of(count.about):
                raise InputError("its flights belong to another count")
            return count.flights

        if not self.file.exists():
            return count
        if not owned.is_believed(self.file):
            observer.hear(
                f"{self.file}: must be a file of this user alone: it is counted from the beginning."
            )
            return count
        try:
            kept = read_counted(self.file, flights_of, unfinished=True)
        except InputError as error:
            observer.hear(f"{error}: it is counted from the beginning.")
            return count
        assert isinstance(kept, type(count))  # its kind is in `about`
        observer.hear(f"{self.file}: {len(kept.scores)} flights are counted already.")
        return kept

    def write(self, count: Counted) -> None:
        """Write the flights counted so far, at once even if they are part of an answer."""
        with whole.apart():
            count.save(self.file, versions=json.dumps(library_versions()))

    def remove(self) -> None:
        """Remove the file of a count that is finished."""
        if self.file.exists():
            whole.remove_file(self.file)
