"""The answer of the comparison between a user's guidance and our gains."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from flighttune.base.words import listed, percent
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.statistics.count import flights_needed
from flighttune.control.margins import Margins
from flighttune.logs.parameters import Flown
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.early import finding_of_early
from flighttune.outputs.answers.labels import columns, endings_table
from flighttune.outputs.answers.tables import margins_table
from flighttune.studies.beside import (
    CONFIDENCE,
    CUT,
    EPSILON,
    OURS,
    YOURS,
    Beside,
    airspeed_words,
    our_rate_gains,
)

Rows: TypeAlias = Sequence[Mapping[str, Any]]

NO_TRACK = (
    "A reference over time has no track: your guidance follows its course, turn and rate of climb."
)
NOT_EMULATED = (
    "Not emulated: your throttle, which is that of the aircraft here, underspeed and excess wind, "
    "and the switch from leg to leg. Where the throttle is at a stop, TECS gives up height for "
    "airspeed; ours holds the path."
)
# The flights of both sides, in a sentence.
WHOSE = {YOURS: "with your parameters", OURS: "with our law"}
ACCURACY = columns("of yours ours unit better flights share", of="beside")
PARAMETERS = columns("name value range from", of="parameters")
TRACKING = columns("of log low high unit", of="beside_log")


def answer(beside: Beside) -> Answer:
    """Accuracy, losses, margins and the emulation in four lines; then the tables."""
    accuracy, now = beside.accuracy, beside.now
    ended = beside.rows[beside.rows["status"] != "completed"].assign(run=lambda x: x["draw"])
    lost = {x: ended[ended["gains"] == x].to_dict(orient="records") for x in (YOURS, OURS)}
    kept, bound = kept_errors(beside.plan.draws)
    unused = ", ".join(now.unused) or "none"
    early = finding_of_early({WHOSE[x]: rows for x, rows in lost.items()}, beside.plan.draws)
    if early:  # the errors of the other flights would compare nothing
        accuracy = []
    return Answer(
        findings=early,
        lines=with_airspeed(
            [] if early else summary(beside, kept, accuracy, lost),
            *airspeed_words(beside.plan, now),
        ),
        values={
            "guidance": now.name,
            "airspeed": airspeeds(beside.plan, now),
            "accuracy": accuracy,
            "lost": {name: len(rows) for name, rows in lost.items()},
            "parameters": now.rows,
            "beyond": now.beyond,
            "unused": now.unused,
            "rest": now.rest,
            "tracking": beside.tracking,
        },
        tables=[
            Table(ACCURACY, accuracy, bound),
            *(
                replace(endings_table(rows), title=f"lost of {name}", name=f"lost_of_{name}")
                for name, rows in lost.items()
            ),
            Table(TRACKING, beside.tracking, "the log, and the flights with your guidance"),
            *(
                replace(margins_table(cut), title=f"margins of {x}", name=f"margins_{x}")
                for x, cut in beside.margins.items()
            ),
            Table(PARAMETERS, now.rows, f"parameters of {now.name}"),
        ],
        notes=[
            *now.notes,
            *beside.notes,
            *beside.plan.scenario.assumptions,
            *([] if beside.plan.scenario.route else [NO_TRACK]),
            NOT_EMULATED,
            f"Not used of the guidance: {unused}. Parameters of other parts: {now.rest}.",
        ],
    )


def with_airspeed(said: Sequence[str], words: str, far: bool) -> list[str]:
    """Sentences with aircraft and airspeed: first if they are far from the user's, else second."""
    return [words, *said] if far else [*said[:1], words, *said[1:]]


def airspeeds(plan: Plan, now: Flown) -> dict[str, float | None]:
    """Airspeeds of the flights and of the user's parameters, m/s."""
    own = None if now.airspeed is None else now.airspeed[1]
    return {"flown_mps": plan.scenario.flight.V_a_mps, "yours_mps": own}


def kept_errors(n: int) -> tuple[str, str]:
    """Words for the bounds on errors of a new flight by n draws, in short and with confidence."""
    if n < (needed := flights_needed(EPSILON, CONFIDENCE)):
        largest = f"the largest errors of {n} flight{'s' * (n > 1)}"
        return largest, f"{largest.capitalize()}; {needed} are needed for a bound"
    kept = f"the errors that {100.0 * (1.0 - EPSILON):g} % of flights keep to"
    sure = f"each by itself, at a confidence of {100.0 * CONFIDENCE:g} %"
    return kept, f"{kept.capitalize()}, {sure}"


def summary(beside: Beside, kept: str, accuracy: Rows, lost: Mapping[str, Rows]) -> list[str]:
    """Bounds on errors, lost flights, draws in which ours is better, the loops, and the basis."""
    n, shown = beside.plan.draws, accuracy[:3]  # cross track, height and airspeed of a route
    better = [
        f"{x['better']} for the {x['of']} ({percent(x['lo'])} to {percent(x['hi'])} %)"
        for x in shown
    ]
    checked = "" if beside.tracking else "; not checked against a log"
    beyond = listed(beside.now.beyond)
    beyond = f" Beyond their published ranges: {beyond}." if beyond else ""
    return [
        f"By {kept}, {nearer(shown)}. {losses(lost, n)}",
        f"Draw by draw, our law has the smaller error in {listed(better)} of {n}.",
        in_your_terms(beside),
        f"What flies for you are the equations of {beside.now.name} above the inner loop here, "
        f"not the firmware{checked}.{beyond}",
    ]


def nearer(accuracy: Rows) -> str:
    """In which errors our law is better, and in which it is not, with both values."""
    closer: list[str] = []
    farther: list[str] = []
    for x in accuracy:
        yours, ours = (bound_in_words(x[name], x["unit"]) for name in (YOURS, OURS))
        said = closer if x[OURS] < x[YOURS] else farther
        said.append(f"{x['of']} {ours} (yours {yours})")
    better = f"our law is better in {listed(closer)}" if closer else ""
    worse = f"{'' if closer else 'our law is '}not better in {listed(farther)}"
    return ", and ".join(filter(None, [better, worse if farther else ""]))


def bound_in_words(value: float, unit: str) -> str:
    """A bound with its unit; an infinite one comes from flights that ended early."""
    return f"{value:.3g} {unit}" if math.isfinite(value) else "no bound, for the flights lost"


def losses(lost: Mapping[str, Rows], draws: int) -> str:
    """How many aircraft each side lost, and by which end."""
    if not any(lost.values()):
        return f"Neither lost an aircraft in {draws} flight{'s' * (draws > 1)}."
    said = []
    for name, rows in lost.items():
        why = ", ".join(dict.fromkeys(row["status"].replace("_", " ") for row in rows))
        whose = "your parameters" if name == YOURS else "our law"
        said.append(f"{whose} {len(rows)}" + (f" ({why})" if rows else ""))
    return f"Aircraft lost in {draws} flights: {', '.join(said)}."


def in_your_terms(beside: Beside) -> str:
    """The gain of the course as the user's parameter, and the margins."""
    law, period = beside.now.law, beside.now.law.period
    K_P = our_rate_gains(beside.plan).K_P[0, 0]
    same = 4.0 * math.pi * law.roles["damping"] / K_P
    cuts = list(beside.margins.values())
    margins = "; ".join(
        f"{name} {' | '.join(margins_at(cut, place) for cut in cuts)}"
        for place, name in enumerate(CUT if cuts else ())
    )
    return (
        f"On this aircraft our course gain, {K_P:.2f} 1/s, corresponds to {period} = {same:.1f} s "
        f"(yours {law.roles['period']:g} s); `flighttune meet` with your file says which period "
        f"keeps to a route. {f'Margins, yours | ours: {margins}.' if margins else ''}"
    ).strip()


def margins_at(cut: Sequence[Margins], place: int) -> str:
    """Gain and phase margin of a loop cut at one place."""
    if not cut:
        return "unstable"
    gain, phase = cut[place].gain_increase, math.degrees(cut[place].phase_margin)
    of_gain = f"{20.0 * math.log10(gain):.1f} dB" if math.isfinite(gain) else "any gain"
    return f"{of_gain}, {phase:.0f} deg" if math.isfinite(phase) else f"{of_gain}, any phase"
