"""The answers of a mission, planned or counted."""

from collections.abc import Sequence
from dataclasses import replace

from flighttune.base.words import listed
from flighttune.claims.band import Band
from flighttune.claims.mission import (
    MissionOdds,
    OverGround,
    PlannedMission,
    bounded_by,
    over_ground,
)
from flighttune.claims.turn_back import NOT_COUNTED, TurnBack
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.band import at_place, findings, lines, wind_beyond
from flighttune.outputs.answers.finding import PartFinding
from flighttune.outputs.answers.turn_back import ended
from flighttune.routes.fence import Beyond
from flighttune.routes.volumes import CONTINGENCY, NAMES

# Sentences at the top of a page, beside those of further findings.
LINES = 4

BELOW = "the path or its corridor is below the ground"

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
    own = [*said.lines]
    # Without a target no finding states the rate.
    rate = [own.pop(0)] if mission.per_hour.table.target_per_hour is None else []
    shares, *others = own
    odds, wide, *more = counted.lines
    # What is said of a whole flight comes first.
    short = [shares, wide, *(others[:-1] if counted.failure else [odds])]
    return replace(
        counted,
        findings=[*said.findings, *counted.findings],
        lines=[*rate, *others, shares, odds, wide, *more],
        values={**counted.values, **said.values},
        tables=[*said.tables, *counted.tables],
        notes=[*said.notes, *counted.notes],
        aside=[*short, *said.aside, *counted.aside],
    )


def hours_not_used(mission: MissionOdds) -> list[PartFinding]:
    """What a refused file of exits per flight hour beside a band finds."""
    if not mission.refused:
        return []
    said = f"the exits per flight hour beside it are not used: {mission.refused}"
    return [PartFinding(found="reserve", sentence=said)]


def _of_flights(mission: MissionOdds) -> Answer:
    """The answer of the band and of the room to turn back, with what each of them finds."""
    band, room, files = mission.band, mission.room, mission.files
    seen, beyond = over_ground(band.flights.route, mission.terrain, band), mission.beyond
    answer = beside_terrain(band.answer(mission.file or "FILE"), seen)
    # Where flights come furthest out, or how they ended, stands before the width.
    odds, wide, holds = lines(band, room, room.summary if room and room.claims else "")
    said = [f"{odds} {mission.way}".strip(), wide, holds]
    found = [
        *under_ground(seen),
        *findings(band),
        *beyond_fences(mission, beyond),
        *corridor(mission),
        *hours_not_used(mission),
    ]
    if seen.faults:
        notes = [*answer.notes, answer.verdict] if answer.verdict else answer.notes
        answer = replace(answer, notes=notes, verdict=found[0].headline)
    answer = replace(answer, findings=found, lines=said, files=files)
    if room is None:
        return answer
    turned = room.answer(files.get("room") or "FILE")
    turns, terms = dict(turned.values), terms_table(room, band)
    if terms:
        turns["terms"] = terms[0].records
    turns["beyond_fence"] = [
        {"volume": name, "fence": number, "by_m": x.by_m, **x.place} for number, name, x in beyond
    ]
    total = band.confidence + room.confidence - 1.0
    if not room.claims:
        reason = f"room to turn back: {turned.failure}"
        found.append(PartFinding(found="open", sentence=room.summary, reason=reason, state=1))
    return replace(
        answer,
        findings=found,
        values={**answer.values, "confidence": total, "turn_back": turns},
        tables=[*answer.tables, turned.tables[0], *terms, ended(room)],
        notes=[*answer.notes, *turned.notes, turned.verdict],
        aside=[*answer.aside, *(x for x in turned.notes if x != NOT_COUNTED), turned.verdict],
    )


def under_ground(seen: OverGround) -> list[PartFinding]:
    """A finding on each place of path or corridor below the ground."""
    return [PartFinding(found="not met", sentence=said, reason=BELOW) for said in seen.faults]


def beyond_fences(
    mission: MissionOdds, beyond: Sequence[tuple[int, str, Beyond]]
) -> list[PartFinding]:
    """A finding on each volume that is beyond a fence."""
    fences, found = mission.band.about.fences, []
    for number, tables in enumerate(fences, start=1):
        named = f"fence {number}" if len(fences) > 1 else "the fence"
        inner = NAMES[: NAMES.index(bounded_by(tables)) + 1]
        for name in NAMES:
            parts = [x for at, of, x in beyond if (at, of) == (number, name)]
            if not parts:
                continue
            said = f"the {name} reaches {listed([reaches(x, named) for x in parts])}"
            if number == len(fences) and name in inner:
                way = ": `--fence-of geography` is a fence of the flight geography alone"
                reason = f"{said}{way * (name == CONTINGENCY)}"
                found.append(PartFinding(found="not met", sentence=f"{said}.", reason=reason))
            else:
                outside = name not in inner
                why = f"; the fence need only hold the {inner[-1]}" * outside
                found.append(PartFinding(found="reserve", sentence=f"{said}{why}."))
    return found


def reaches(beyond: Beyond, fence: str) -> str:
    """How far a volume is beyond a fence, and where."""
    place, by = (
        beyond.place,
        f"{beyond.by_m:.0f} m" if beyond.by_m >= 10.0 else f"{beyond.by_m:.1f} m",
    )
    if "margin_m" not in place:
        return (
            f"{by} {'above' if place['side'] == 'up' else 'below'} the {place['edge']} of {fence}"
        )
    return f"{by} beyond {fence} {at_place(place)}, {place['margin_m']:.0f} m from the path"


def corridor(mission: MissionOdds) -> list[PartFinding]:
    """A reserve if the corridor is beyond the fence that flights keep."""
    band = mission.band
    if not band.about.fences or (mission.room is not None and mission.room.claims):
        return []
    rows = [x for x in band.inside(band.about.fences[-1]).nearest if x["what"] == "band"]
    return [
        PartFinding(
            found="reserve",
            sentence=f"the corridor reaches {-row['margin_m']:.1f} m beyond the fence "
            f"{at_place(row)}: it bounds the flights less closely than their count does.",
        )
        for row in rows
        if row["margin_m"] < 0.0
    ]


def terms_table(room: TurnBack, band: Band) -> list[Table]:
    """Terms of the contingency volume, if one is claimed."""
    if not (room.claims and band.claims):
        return []
    return [Table(TERM_COLUMNS, room.terms(band), TERMS)]


def planned(mission: PlannedMission) -> Answer:
    """The planned route, with its clearance from fences and terrain."""
    seen, nearest = mission.seen, mission.nearest
    why = "the planned path leaves the fence"
    found = [
        *(PartFinding(found="not met", sentence=said, reason=why) for said in mission.outside),
        *under_ground(seen),
        *(PartFinding(found="met", sentence=said) for said in mission.inside),
    ]
    values, wind = {"fence": {"nearest": nearest}} if nearest else {}, []
    if (spread := mission.forecast) is not None:
        found += wind_beyond(mission.route.wind, spread.speed_mps[1])
        wind, values["wind"] = [spread.words], spread._asdict()
    answer = beside_terrain(mission.route.answer(found), seen)
    return replace(
        answer,
        changed=[*wind, *answer.changed],
        notes=[*mission.notes, *answer.notes],
        values={**answer.values, **values},
        files={"route": mission.file},
    )


def beside_terrain(answer: Answer, seen: OverGround) -> Answer:
    """An answer with the clearance over terrain."""
    return replace(
        answer,
        values={**answer.values, **seen.values},
        changed=[*seen.changed, *answer.changed],
        notes=[*answer.notes, *seen.notes],
    )
