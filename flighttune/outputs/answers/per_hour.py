"""The answer of the exits per flight hour."""

from typing import Any

from flighttune.base.words import at_most, confidence_text, listed
from flighttune.claims.per_hour import LATER_S, PerHour, healthy_flights_for
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.finding import PartFinding

COLUMNS = (
    Column("term", "term"),
    Column("per_hour", "declared per hour", "1/h"),
    Column("ended", "ended", digits=".0f"),
    Column("outside", "left", digits=".0f"),
    Column("flights", "of flights", digits=".0f"),
    Column("share", "share at most"),
    Column("bound", "exits at most", "1/h"),
    Column("source", "source of the rate"),
)
LATER_COLUMNS = (
    Column("ended_s", "ended after", "s"),
    Column("outside", "left", digits=".0f"),
    Column("flights", "of flights", digits=".0f"),
    Column("total", "exits at most in all", "1/h"),
)

# Each kind of fault, in a sentence.
FAULTS = {
    "engine": "an engine failure",
    "aileron_stuck": "a stuck aileron",
    "elevator_stuck": "a stuck elevator",
    "rudder_stuck": "a stuck rudder",
    "actuator_slow": "a slow actuator",
    "airspeed_wrong": "a wrong airspeed",
    "receiver_jump": "a jump of the receiver",
    "receiver_lost": "a lost receiver",
    "link_lost": "a lost link",
}

# What an ended flight does, in a sentence.
ENDINGS = {
    "cut": "A cut closes the throttle and moves the surfaces to their stops.",
    "parachute": "A parachute ends a flight where it is, and drifts with the wind there.",
    "turn_back": (
        "A flight that turns back turns to a side that is drawn, as tight as the turns of the "
        "route, and flies straight to the start of the route, where it ends."
    ),
    "circle": "A flight that circles makes two circles, as tight as the turns of the route.",
    "glide": "A flight that glides closes the throttle and goes straight on to the ground.",
}


def answer(hourly: PerHour) -> Answer:
    """The bound, its terms and the number that matters most; a failure if a target is missed."""
    return Answer(
        values={"per_hour": values(hourly)},
        findings=finding(hourly),
        lines=lines(hourly),
        tables=tables(hourly),
        notes=notes(hourly),
        aside=notes(hourly)[:-1],
        verdict=hourly.sentence,
    )


def finding(hourly: PerHour) -> list[PartFinding]:
    """Whether the target is met; nothing without one."""
    target, total = hourly.table.target_per_hour, at_most(hourly.bound.total, 3)
    if target is None:
        return []
    said = f"{at_most_leave(hourly)}; the target is {target:g}."
    if hourly.met:
        return [PartFinding(found="met", sentence=said)]
    reason = f"exits per flight hour are at most {total}, and the target is {target:g}"
    if hourly.too_few:
        return [
            PartFinding(
                found="open", sentence=said, reason=reason, begins="Not shown yet: ", state=1
            )
        ]
    return [PartFinding(found="not met", sentence=said, reason=reason)]


def at_most_leave(hourly: PerHour) -> str:
    """The bound in words."""
    return (
        f"at most {at_most(hourly.bound.total, 3)} flights per flight hour leave the operational "
        f"volume, at a confidence of {confidence_text(hourly.confidence)}"
    )


def lines(hourly: PerHour) -> list[str]:
    """The shares of the bound, the latest ending, and what matters most."""
    bound, faults = hourly.bound, hourly.table.fault
    parts = [
        f"{fault.kind.replace('_', ' ')} {at_most(x, 2)}"
        for fault, x in zip(faults, bound.faults, strict=True)
    ]
    shares = (
        f"Of the exits per flight hour, healthy flight has {at_most(bound.healthy, 3)}, "
        f"{', '.join(parts)}, and two faults in a flight {at_most(bound.several, 2)}."
    )
    no_target = [f"{at_most_leave(hourly)[0].upper()}{at_most_leave(hourly)[1:]}."]
    no_target *= hourly.table.target_per_hour is None
    return [*no_target, shares, *latest(hourly), matters_most(hourly)]


def latest(hourly: PerHour) -> list[str]:
    """The latest time of ending, if it was looked for."""
    if not hourly.later:
        return []
    if (held := hourly.latest) is None:
        first = hourly.later[0].ended_s
        return [f"The target does not hold even if a flight is ended {first:g} s after the fault."]
    kind, ended_s = held
    more = "" if ended_s < LATER_S[-1] else ", the latest time that was flown"
    return [f"The target holds if a flight is ended within {ended_s:g} s of {FAULTS[kind]}{more}."]


def matters_most(hourly: PerHour) -> str:
    """The one number that matters most."""
    if (i := hourly.largest) is None:
        needed, healthy = healthy_flights_for(hourly), hourly.terms[0].count
        if healthy.outside:
            return (
                f"What matters most is healthy flight: {healthy.outside} of {healthy.flights} "
                "flights left the volume."
            )
        more = "more flights" if needed is None else f"{needed} flights (`flights`), none outside,"
        half = " would bring it to half of the target" if needed else " would lower it"
        return (
            "What matters most is the number of healthy flights: none of "
            f"{healthy.flights} left the volume; {more}{half}."
        )
    term = hourly.terms[i + 1]
    count, what = term.count, hourly.table.name_of(i, term.ended_s)
    what = f"What matters most is {what}: {count.outside} of {count.flights} flights left"
    if not count.outside:
        return f"{what}; more `flights` would lower its bound."
    if not term.ended:
        return f"{what}, none was ended (`ended_s`)."
    return f"{what}, {term.ended} were ended."


def tables(hourly: PerHour) -> list[Table]:
    """The terms, and the times of ending that were flown."""
    shown = [Table(COLUMNS, rows(hourly), "exits from the operational volume per flight hour")]
    if hourly.later:
        fault = hourly.table.fault[hourly.later[0].fault or 0].kind.replace("_", " ")
        shown.append(Table(LATER_COLUMNS, later_rows(hourly), f"time of ending: {fault}"))
    return shown


def rows(hourly: PerHour) -> list[dict[str, Any]]:
    """A record of each term."""
    bound, healthy = hourly.bound, hourly.terms[0].count
    table, terms = hourly.table, hourly.terms
    first = {
        "term": table.name_of(None, None),
        "per_hour": None,
        "ended": terms[0].ended,
        "outside": healthy.outside,
        "flights": healthy.flights,
        "share": healthy.share(bound.each),
        "bound": bound.healthy,
        "source": "",
    }
    of_faults = [
        {
            "term": table.name_of(term.fault, term.ended_s),
            "per_hour": fault.per_hour,
            "ended": term.ended,
            "outside": term.count.outside,
            "flights": term.count.flights,
            "share": term.count.share(bound.each),
            "bound": x,
            "source": fault.source,
        }
        for fault, term, x in zip(table.fault, terms[1:], bound.faults, strict=True)
    ]
    several = dict.fromkeys(("per_hour", "ended", "outside", "flights", "share"))
    return [
        first,
        *of_faults,
        {"term": "two faults", **several, "bound": bound.several, "source": ""},
    ]


def later_rows(hourly: PerHour) -> list[dict[str, Any]]:
    """A record of each time of ending."""
    return [
        {
            "ended_s": term.ended_s,
            "outside": term.count.outside,
            "flights": term.count.flights,
            "total": hourly.total_with(term),
        }
        for term in hourly.later
    ]


def values(hourly: PerHour) -> dict[str, Any]:
    """The answer as values."""
    held = hourly.latest
    return {
        "bound": hourly.bound.total,
        "confidence": hourly.confidence,
        "confidence_of_each": hourly.bound.each,
        "target": hourly.table.target_per_hour,
        "hours": hourly.bound.hours,
        "window_s": hourly.exposure.window_s,
        "terms": rows(hourly),
        "later": later_rows(hourly),
        "latest": None if held is None else {"fault": held[0], "ended_s": held[1]},
    }


def notes(hourly: PerHour) -> list[str]:
    """What is declared, what is counted, and what is not in it."""
    exposure, kinds = hourly.exposure, [x.kind.replace("_", " ") for x in hourly.table.fault]
    hours = hourly.bound.hours
    return [
        f"The rates of {listed(kinds)} are declared by the applicant; the shares are counted. Each "
        f"fault begins at any time of the first {exposure.window_s:.3g} s, and a flight lasts "
        f"{3600.0 * hours:.3g} s or more on average.",
        *endings(hourly),
        "A flight leaves by a side or the top of the volume, or by the floor of a fence before it "
        "comes down. A flight whose model no longer holds counts as outside, unless it was ended "
        "and falls to the ground inside as declared.",
        "Faults of other kinds, in wind or air beyond what is drawn, errors of the crew, other "
        "traffic, and injuries on the ground are not in it.",
    ]


def endings(hourly: PerHour) -> list[str]:
    """What ended flights do, and what is declared of them."""
    hows = dict.fromkeys(hourly.table.ending_of(x.fault) for x in hourly.terms if x.ended)
    ending, said = hourly.table.ending, [ENDINGS[how] for how in hows]
    if "parachute" in hows:
        opens = f"{ending.opens_s:g} s and sinks by {ending.sink_mps:g} m/s"
        said.append(f"The parachute opens after {opens}, as declared.")
    if ending.fall_per_height is not None and hows.keys() - {"parachute"}:
        fall = f"{ending.fall_per_height:g} m away per metre of height"
        said.append(f"An aircraft that falls comes down {fall}, as declared.")
    if hourly.alarms is not None:
        later = f"{ending.after_alarm_s:g} s after" if ending.after_alarm_s else "at"
        said.append(f"A flight is ended {later} the first alarm of the monitor.")
    return said
