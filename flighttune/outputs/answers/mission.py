"""The answers of a mission, planned or counted."""

from dataclasses import replace

from flighttune.claims.band import Band
from flighttune.claims.mission import MissionOdds, OverGround, PlannedMission, over_ground
from flighttune.claims.turn_back import NOT_COUNTED, TurnBack
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.band import summary
from flighttune.outputs.answers.turn_back import ended

# Sentences at the top of a page.
LINES = 4

TERMS = "contingency volume beyond the path, by the guideline and as counted"
TERM_COLUMNS = (
    Column("term", "term"),
    Column("is", "what"),
    Column("guideline", "guideline", "m", ".1f"),
    Column("counted", "counted", "m", ".1f"),
)


def answer(mission: MissionOdds) -> Answer:
    """The answer of the mission, its room to turn back and its exits per flight hour."""
    counted = _of_flights(mission)
    if mission.per_hour is None:
        return counted
    said = mission.per_hour.answer()
    first, shares, *others = said.summary
    whether, odds, wide, *more = counted.summary
    # A page has the first `LINES` at its top: what is said of a whole flight comes first.
    lead = [whether, first, *others] if counted.failure else [first, *others, whether]
    short = [shares, wide, *(others[:-1] if counted.failure else [odds])]
    return replace(
        counted,
        summary=[*lead, shares, odds, wide, *more],
        values={**counted.values, **said.values},
        tables=[*said.tables, *counted.tables],
        notes=[*said.notes, *counted.notes],
        aside=[*short, *said.aside, *counted.aside],
        failure=counted.failure or said.failure,
    )


def _of_flights(mission: MissionOdds) -> Answer:
    """The answer of the band and of the room to turn back; a failure if one fails."""
    band, room, files = mission.band, mission.room, mission.files
    seen = over_ground(band.flights.route, mission.terrain, band)
    answer = beside_terrain(band.answer(mission.file or "FILE"), seen)
    whether, odds, *others = summary(band, room, room.summary if room else "")
    lines = [whether, f"{odds} {mission.way}".rstrip(), *others]
    if seen.faults:
        notes = [*answer.notes, answer.verdict] if answer.verdict else answer.notes
        lines = [*seen.faults, *lines[1:]]
        said = {"verdict": seen.faults[0], "failure": answer.failure or seen.failure}
        answer = replace(answer, notes=notes, **said)
    if room is None:
        return replace(answer, summary=lines, files=files)
    said = room.answer(files.get("room") or "FILE")
    turns, terms = dict(said.values), terms_table(room, band)
    if terms:
        turns["terms"] = terms[0].records
    total = band.confidence + room.confidence - 1.0
    return replace(
        answer,
        summary=lines,
        values={**answer.values, "confidence": total, "turn_back": turns},
        tables=[*answer.tables, said.tables[0], *terms, ended(room)],
        notes=[*answer.notes, *said.notes, said.verdict],
        aside=[*answer.aside, *(x for x in said.notes if x != NOT_COUNTED), said.verdict],
        failure=answer.failure or (f"room to turn back: {said.failure}" if said.failure else ""),
        files=files,
    )


def terms_table(room: TurnBack, band: Band) -> list[Table]:
    """Terms of the contingency volume, if one is claimed."""
    if not (room.claims and band.claims):
        return []
    return [Table(TERM_COLUMNS, room.terms(band), TERMS)]


def planned(mission: PlannedMission) -> Answer:
    """The planned route, with its clearance from fences and terrain."""
    seen, nearest = mission.seen, mission.nearest
    answer = beside_terrain(mission.route.answer([*mission.outside, *seen.faults]), seen)
    if answer.failure:  # problems come first
        answer = replace(answer, changed=[*mission.inside, *answer.changed])
    else:
        answer = replace(answer, summary=[*mission.inside, *answer.summary])
    return replace(
        answer,
        notes=[*mission.notes, *answer.notes],
        values={**answer.values, **({"fence": {"nearest": nearest}} if nearest else {})},
        files={"route": mission.file},
        failure="the planned path leaves the fence" if mission.outside else seen.failure,
    )


def beside_terrain(answer: Answer, seen: OverGround) -> Answer:
    """An answer with the clearance over terrain."""
    return replace(
        answer,
        values={**answer.values, **seen.values},
        changed=[*seen.changed, *answer.changed],
        notes=[*answer.notes, *seen.notes],
    )
