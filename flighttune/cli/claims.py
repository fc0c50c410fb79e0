"""Claims from files around the runs of a command."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from flighttune.errors import InputError
from flighttune.present.answer import Answer


class Flights(Protocol):
    """Flights that claims can be drawn around."""

    def within(self: "T", *claims: Any) -> "T":
        """The flights with these claims."""
        ...


T = TypeVar("T", bound=Flights)


def within(flights: T, files: Sequence[Path] | None) -> T:
    """Flights with the claims in files around them; an error names the file."""
    from flighttune.campaign.claims import load_claim

    for file in files or ():
        try:
            flights = flights.within(load_claim(file))
        except InputError as error:
            reason = str(error).removeprefix(f"{file}: ")
            raise InputError(f"{file}: {reason}") from error
    return flights


def claim_page(file: str, out: Path) -> Answer:
    """Write the page of the claim in a file."""
    from flighttune.campaign.claims import load_claim
    from flighttune.reports.claim import write_claim_page

    claim = load_claim(file)
    page = write_claim_page(claim, file, out)
    return replace(claim.answer(), files={"report": page.path})
