"""The answer of a band, and of a mission with its corridor."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.endings import why_ended
from flighttune.base.errors import InputError
from flighttune.base.words import at_most, confidence_text, pick
from flighttune.claims.band import Band, Fenced
from flighttune.claims.counted import Counted
from flighttune.claims.known import MOST_OF_THE_TIME, navigation_errors
from flighttune.outputs.answers import counted
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import PartFinding, unmet
from flighttune.outputs.answers.labels import columns

# The corridor is that of true distances; a log has those that its autopilot saw.
TRIANGLE = (
    "The true distance from the path is at most the distance that the autopilot sees plus the "
    "error of navigation."
)
NEAREST_COLUMNS = columns("what margin_m side edge along_m stretch", of="fence")


def answer(band: Band, file: str | Path = "FILE") -> Answer:
    """The half-widths of the band in a file and its claim; a failure if nothing is claimed.

    Along a route it also has the length and the time. The claim about its last fence, if any, is
    then the verdict, and a failure if the count does not support it.
    """
    answer = counted.answer(band, file)
    try:
        return along_route(band, answer) if band.flights.over == "along" else answer
    except InputError as error:
        return replace(answer, verdict="", findings=unmet(str(error)))


def along_route(band: Band, answer: Answer) -> Answer:
    """The answer with the route, and with the count of flights inside its last fence."""
    planned, values = band.flights.route, dict(answer.values)
    values["route"] = {**pick(planned, "conditions time"), "length_m": planned.length}
    changed = [*band.flights.scenario.notes, *planned.changed]
    known = [TRIANGLE] * (navigation_errors(band) is not None)
    notes = [*answer.notes, *known]
    said = {"findings": findings(band), "lines": lines(band), "notes": notes}
    answer = replace(answer, values=values, changed=changed, **said)
    # The summary has the claim in short.
    warned = band.flights.gains_notes
    answer = replace(answer, aside=[*(x for x in notes if x not in warned), answer.verdict])
    if not band.about.fences:
        return answer
    count = band.inside(band.about.fences[-1])
    values["fence"] = count._asdict()
    notes = [*answer.notes, band.sentence]
    for nearest in count.nearest:
        if nearest["what"] == "band":
            within = "inside" if nearest["margin_m"] >= 0.0 else "not inside"
            notes.append(f"The band itself is {within} the fence.")
    aside = [*answer.aside, *notes[len(answer.notes) :], count.sentence]
    notes.append(f"The fence has {count.heights}.")
    if band.not_completed:
        notes.append(f"Of the flights {band.lost}: they count as outside.")
    return replace(
        answer,
        tables=[*answer.tables, Table(NEAREST_COLUMNS, count.nearest, "fence")],
        notes=notes,
        aside=aside,
        verdict=count.sentence if count.supported else "",
    )


def lines(band: Band, room: Counted | None = None, room_words: str = "") -> list[str]:
    """Probability, width and conditions of a mission.

    The room to turn back, if it was counted, shares the confidence.
    """
    about, flights, planned = band.about, len(band.scores), band.flights.route
    confidence = band.confidence - (0.0 if room is None else 1.0 - room.confidence)
    sure = f"at a confidence of {confidence_text(confidence)} for all that is said here"
    if band.too_many_lost:
        odds = f"They ended so:{why_ended(band.endings).removesuffix('.')}."
    elif about.fences:
        odds = odds_in_fence(band, band.inside(about.fences[-1]), sure)
    elif band.claims:
        odds = "A new flight leaves its corridor with a probability of at most "
        odds += f"{about.epsilon:g}, {sure}: {band.outside} of {flights} flights did."
    else:
        odds = ""
    flown = band.flights.distribution.sentence(band.flights.flown).partition("; drawn")[0]
    wide = f"{width(band)} {room_words}" if room_words else width(band)
    holds = f"It holds for {flown}, over {planned.answer().verdict}."
    return [odds, wide, holds]


def findings(band: Band) -> list[PartFinding]:
    """What a count finds of the mission and its fences, and of a wind that is not planned for."""
    about, flights, slower = band.about, len(band.scores), band.flights.route.except_slopes
    asked = [in_fence(band, about.fences[-1])] if about.fences else []
    found = [*asked, *others_in_fence(band), *wind_of_turns(band)]
    if band.too_many_lost:
        said = f"of {flights} flights {band.lost}; at most {band.allowed} of {band.first} may."
        return [
            PartFinding(found="not met", sentence=said, reason=_reason(band)),
            *found[len(asked) :],
        ]
    if asked:
        return found
    if not band.claims:
        said = f"{band.sentence}."
        return [PartFinding(found="open", sentence=said, reason=band.sentence, state=1), *found]
    said = f"the mission can be flown{slower}. It has no fence to stay inside."
    return [PartFinding(found="met", sentence=said), *found]


def _reason(band: Band) -> str:
    """Why a band's claim, or that about its last fence, is not supported."""
    if not band.about.fences:
        return band.sentence
    said = band.inside(band.about.fences[-1]).sentence
    return f"{said}; {band.about.epsilon:g} was asked for"


def in_fence(band: Band, tables: Mapping[str, Any]) -> PartFinding:
    """Whether the mission stays inside its fence."""
    flights, slower = len(band.scores), band.flights.route.except_slopes
    fenced = band.inside(tables)
    if fenced.supported:
        slower += "," * bool(slower)
        said = f"the mission can be flown{slower} and stays inside its fence."
        return PartFinding(found="met", sentence=said)
    reason = _reason(band)
    if band.about.until_sure:
        more = f"`flighttune band FILE --flights {2 * band.first}` may be enough."
        said = f"{fenced.sentence}."
        no = band.decided
    else:
        said = (
            f"{fenced.outside} of {flights} flights are not certainly inside the fence; at most "
            f"{band.allowed} of {band.first} may be outside."
        )
        more = (
            f"{flights} of {band.first} flights were flown; `flighttune band FILE --flights "
            f"{band.first}` flies the others."
        )
        no = flights >= band.first or fenced.outside > band.allowed
    if no:
        return PartFinding(found="not met", sentence=said, reason=reason)
    return PartFinding(found="open", sentence=more, reason=reason, state=1)


def others_in_fence(band: Band) -> list[PartFinding]:
    """Fences that were counted before, and are drawn beside the last one."""
    found = []
    for number, tables in enumerate(band.about.fences[:-1], start=1):
        fenced = band.inside(tables)
        if not fenced.supported:
            said = f"fence {number}, asked before, is not kept: {fenced.sentence}."
            found.append(PartFinding(found="reserve", sentence=said))
    return found


def odds_in_fence(band: Band, fenced: Fenced, sure: str) -> str:
    """The probability of leaving a fence, and where flights come nearest to it."""
    flights, nearest = len(band.scores), min(fenced.nearest, key=lambda row: row["margin_m"])
    margin, at = nearest["margin_m"], at_place(nearest)
    if fenced.supported:
        return (
            f"A new flight leaves the fence with a probability of at most "
            f"{at_most(fenced.epsilon)}, {sure}: {fenced.outside} of {flights} flights did. "
            + (
                f"The flights and their corridor come nearest to it {at}: {margin:.1f} m."
                if margin >= 0.0
                else f"The flight furthest out is {-margin:.1f} m outside, {at}."
            )
        )
    if margin >= 0.0:  # what is outside did not complete, or was not flown
        return f"The completed flights come nearest to it {at}: {margin:.1f} m."
    return (
        f"They come furthest out {at}: {-margin:.1f} m, which is the room that the fence lacks "
        "there; a lower airspeed or wind may do too."
    )


def at_place(place: Mapping[str, Any]) -> str:
    """A place along the route, and the edge of a fence beside it."""
    return "on the {stretch}, {along_m:.0f} m along ({edge}, {side})".format(**place)


def wind_of_turns(band: Band) -> list[PartFinding]:
    """A reserve if faster wind is drawn than the turns are planned for."""
    return wind_beyond(band.flights.route.wind, band.flights.distribution.fastest_wind)


def wind_beyond(planned: float, fastest: float) -> list[PartFinding]:
    """A reserve if the fastest wind, m/s, is faster than turns are planned for."""
    if fastest <= planned:
        return []
    said = (
        f"turns and times are planned for wind up to {planned:.3g} m/s, and the wind reaches "
        f"{at_most(fastest, 3)} m/s: `--set route.wind_mps={at_most(fastest, 3)}` plans for it."
    )
    return [PartFinding(found="reserve", sentence=said)]


def width(band: Band) -> str:
    """The width and height of the corridor, if one is claimed."""
    if not band.claims or band.about.predicted_from:
        return "No corridor is claimed."
    claimed = band.corridor()
    beside, above = np.abs([claimed.low, claimed.high]).max(axis=(0, 1)).tolist()
    of_sides, of_height, flying = ", ", "", ""
    if (errors := navigation_errors(band)) is not None:
        sides, height = (f"{min(x):.2g} m" for x in zip(errors[:2], (beside, above), strict=True))
        of_sides = f", where errors of navigation alone reach {sides}, "
        of_height = f", where they reach {height}"
        seen = f"{errors.seen_beside:.2g} m and {errors.seen_above:.2g} m"
        time = f"{100.0 * MOST_OF_THE_TIME:g} % of the time once it has joined the path"
        flying = f" The autopilot sees errors of at most {seen} for {time}."
    by_rtk = ""
    if len(band.by_rtk):
        aside, off = band.by_rtk.max(axis=0).tolist()
        flown = f" Flown by RTK, {len(band.by_rtk)} flights kept to"
        by_rtk = f"{flown} {aside:.2g} m and {off:.2g} m."
    return (
        f"The corridor is at most {at_most(beside, 3)} m wide to either side of the path{of_sides}"
        f"and {at_most(above, 3)} m high above and below it{of_height}.{flying}{by_rtk}"
    )
