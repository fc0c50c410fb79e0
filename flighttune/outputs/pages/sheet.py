"""What a mission's page prints as one A4 page: conditions, claims, and how to check them."""

import base64
import hashlib
from pathlib import Path

from flighttune.base.files.whole import current
from flighttune.claims.band import Band
from flighttune.claims.distribution import AIR, EXACT
from flighttune.claims.mission import MissionOdds, bounded_by
from flighttune.flight.fly import library_versions
from flighttune.outputs.answers import per_hour
from flighttune.outputs.answers.answer import Column, Table, facts_table
from flighttune.outputs.answers.mission import terms_table
from flighttune.outputs.answers.tables import gains_table
from flighttune.outputs.pages.frame import sentence
from flighttune.routes.maps import NOT_SEEN
from flighttune.routes.volumes import CONTINGENCY

VOLUME_COLUMNS = (
    Column("volume", "volume"),
    Column("width_m", "to each side", "m", ".1f"),
    Column("min_over_ground_m", "from", "m", ".1f"),
    Column("max_over_ground_m", "to", "m", ".1f"),
)
FILE_COLUMNS = (
    Column("file", "file"),
    Column("command", "check it with"),
    Column("digest", "its SHA-256"),
)

# Libraries whose versions decide the numbers of a flight.
DECIDING = "flighttune", "jsbsim", "numpy", "python"

NO_GAIN = "0.0000", ""

FAILURES = "Failures of engine, link and receiver"


def volumes(mission: MissionOdds) -> list[Table]:
    """Terms of the contingency volume, and the sizes of all volumes, if claimed."""
    if mission.room is None:
        return []
    terms = terms_table(mission.room, mission.band)
    if not terms:
        return []
    sizes = [
        {"volume": name, **volume.outwards.sizes}
        for name, volume in mission.room.volumes(mission.band).items()
    ]
    return [*terms, Table(VOLUME_COLUMNS, sizes, "volumes, heights over ground")]


def tables(mission: MissionOdds) -> list[Table]:
    """What a mission's count holds for, declared faults, claims, and how to check them."""
    hourly = mission.per_hour
    return [
        facts_table("", conditions(mission)),
        *([] if hourly is None else per_hour.tables(hourly)[:1]),
        facts_table("What is claimed", claims(mission)),
        files_table(mission),
    ]


def conditions(mission: MissionOdds) -> dict[str, str]:
    """Aircraft, air, navigation, law and flights, in words."""
    band = mission.band
    flights, about = band.flights, band.about
    distribution, law = flights.distribution, flights.scenario.law_table(flights.gains_name)
    air = dict(distribution.air_words)
    known = air.pop("navigation", "")
    size = f", {flights.span:.3g} m of span" if flights.span else ""
    words = ", ".join(AIR[name].format(text) for name, text in air.items())
    counted = f"{len(band.scores)} counted, {about.learned} learned from"
    if mission.room is not None:
        counted += f"; {len(mission.room.scores)} counted that turn back"
    hourly, of_hours = mission.per_hour, {}
    if hourly is not None:
        inside = about.fences and bounded_by(about.fences[-1]) == CONTINGENCY
        of_hours["operational volume"] = "the fence" if inside else "the contingency volume"
        if said := per_hour.endings(hourly):
            of_hours["endings"] = " ".join(said)
    return {
        "aircraft": f"{flights.plant}{size}, at {distribution.airspeeds}",
        "drawn at random": "; ".join(distribution.varied) or "no more",
        "air": words or "calm",
        "navigation": known or EXACT,
        "law": f"{law.kind}, gains {flights.gains_name}: {_gains(band)}",
        "route": f"{flights.route.answer().verdict}",
        "flights": f"{counted}; seed {about.plan['campaign']['seed']}",
        **of_hours,
    }


def _gains(band: Band) -> str:
    """The gains of each command that are not zero."""
    table = gains_table("", band.flights.gains)
    said = []
    for record in table.records:
        command, *columns = table.columns
        parts = [
            f"{column.text(record)} {column.name}"
            for column in columns
            if column.text(record) not in NO_GAIN
        ]
        said.append(f"{command.text(record)} = {', '.join(parts)}")
    return "; ".join(said)


def claims(mission: MissionOdds) -> dict[str, str]:
    """Each claim, and what none of them has in it."""
    band, room, hourly = mission.band, mission.room, mission.per_hour
    fences = [f"fence {i}" for i in range(1, len(band.said_of_fences) + 1)]
    stated = {"corridor": band.claim_words}
    stated |= dict(zip(fences if len(fences) > 1 else ["fence"], band.said_of_fences, strict=False))
    if room is not None:
        stated["room to turn back"] = room.claim_words
    if hourly is not None:
        stated["per flight hour"] = f"{hourly.rate}, with the declared rates above"
    missing = FAILURES if hourly is None else "Faults of other kinds"
    stated["not in it"] = f"{missing}, errors of the crew, other traffic and injuries on the ground"
    if mission.terrain is None:
        stated["ground"] = NOT_SEEN.partition(":")[0]
    return {what: sentence(claim) for what, claim in stated.items()}


def files_table(mission: MissionOdds) -> Table:
    """The files of the claims and volumes with their digests, and the commands that check them."""
    files = {**mission.files, "band": mission.file}
    records = [
        {
            "file": file.name,
            "command": "" if key in ("volumes", "kml") else f"flighttune verify {file.name}",
            "digest": sha256(file),
        }
        for key, file in files.items()
        if file is not None
    ]
    versions = library_versions()
    with_versions = ", ".join(f"{name} {versions[name]}" for name in DECIDING if name in versions)
    return Table(FILE_COLUMNS, records, f"How to check it (with {with_versions})")


def sha256(file: Path) -> str:
    """SHA-256 of a file, also of one that is about to be written."""
    return hashlib.sha256(current(file).read_bytes()).hexdigest()


def font() -> str:
    """CSS with the font of the printed page, so that it fits on every computer alike."""
    faces = []
    for name, weight in (("regular", 400), ("bold", 700)):
        file = Path(__file__).with_name("fonts") / f"{name}.woff2"
        data = base64.b64encode(file.read_bytes()).decode()
        faces.append(
            f"@font-face {{ font-family: Sheet; font-weight: {weight}; "
            f"src: url(data:font/woff2;base64,{data}) format('woff2'); }}"
        )
    return "\n".join(faces)
