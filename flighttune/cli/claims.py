"""Claims from files around the runs of a command."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from flighttune.cli.show import pick, progress_bar
from flighttune.errors import InputError
from flighttune.present.answer import Answer
from flighttune.present.names import columns
from flighttune.present.tables import Table


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


def fly_draw(file: Path, draw: int, out: Path | None) -> Answer:
    """Fly a draw of the band in a file again, and record it with the band around it."""
    from flighttune.campaign.band import load_band, plan_of
    from flighttune.campaign.flying.alone import fly_again
    from flighttune.recording.record import record
    from flighttune.simulate.claim import claimed as claimed_of

    counted, name = load_band(file), f"{file.stem}-run-{draw}"
    plan = plan_of(counted)
    with progress_bar() as progress:
        flown = fly_again(plan, draw, progress=progress)
    run = flown[plan.group_of(draw).label]
    claimed = run.status == "completed" and counted.claims
    flown = within(flown, [file] if claimed else [])
    around = claimed_of(flown.runs)
    files = record(flown, out or Path("runs") / name, name=name)
    of_draw = plan.values_of(draw)
    drawn = [{"parameter": key, "value": of_draw[key]} for key in plan.keys]
    return Answer(
        values={
            "run": draw,
            **pick(run, "status reason"),
            "signals": files.signals,
            **around.values,
        },
        tables=[Table(columns("parameter value"), drawn, f"draw {draw}: {run.label}")],
        notes=[
            *([] if claimed else [f"{run.label}: {run.outcome}"]),
            *around.notes,
            "A band keeps no row of a flight to compare it with.",
        ],
        files={"recording": files.recording},
    )
