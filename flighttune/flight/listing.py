"""The scenarios and campaigns that come with flighttune, and the aircraft that are found."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flighttune.files.shipped import (
    aircraft_folders,
    campaign_files,
    is_shipped,
    scenario_files,
)
from flighttune.present.answer import Answer, Answering, Table
from flighttune.present.names import columns


@dataclass(frozen=True, slots=True, kw_only=True)
class Listing(Answering):
    """Files of scenarios and campaigns by name, and folders of aircraft by name."""

    scenarios: Mapping[str, Path]
    campaigns: Mapping[str, Path]
    aircraft: Mapping[str, Path]

    def answer(self) -> Answer:
        """Names and titles; an aircraft that is not shipped with its folder."""
        files = {"scenarios": self.scenarios, "campaigns": self.campaigns}
        places = [
            name if is_shipped(folder) else f"{name} ({folder})"
            for name, folder in self.aircraft.items()
        ]
        return Answer(
            values={"aircraft": list(self.aircraft)},
            tables=[
                Table(columns("name title"), [*map(_heading, paths.values())], kind, name=kind)
                for kind, paths in files.items()
            ],
            notes=[f"aircraft: {', '.join(places)}"],
        )


def listing() -> Listing:
    """List the scenarios and campaigns that come with the package, and all aircraft found."""
    return Listing(
        scenarios=scenario_files(), campaigns=campaign_files(), aircraft=aircraft_folders()
    )


def _heading(path: Path) -> dict[str, str]:
    """Name, title and claim of a shipped file; the whole file is checked by a test, not here."""
    # Only the part before the first table is parsed: the rest takes ten times as long.
    tables = tomllib.loads(path.read_text(encoding="utf-8").partition("\n[")[0])
    return {"name": path.stem, "title": tables["title"], "verifies": tables.get("verifies", "")}
