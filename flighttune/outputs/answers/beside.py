"""The answer of the comparison between a user's guidance and our gains."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

from flighttune.base.words import listed, number, percent
from flighttune.campaigns.statistics.count import flights_needed
from flighttune.control.margins import Margins
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns, endings_table
from flighttune.outputs.answers.tables import margins_table
from flighttune.studies.beside import CONFIDENCE, CUT, EPSILON, OURS, YOURS, Beside, our_rate_gains

Rows: TypeAlias = Sequence[Mapping[str, Any]]

NO_TRACK = (
    "A reference over time has no track: your guidance follows its course, turn and rate of climb."
)
NOT_EMULATED = (
    "Not emulated: your throttle, which is that of the aircraft here, underspeed and excess wind, "
    "and the switch from leg to leg. Where the throttle is at a stop, TECS gives up height for "
    "airspeed; ours holds the path."
)
ACCURACY = columns("of yours ours unit better flights share", of="beside")
PARAMETERS = columns("name value range from", of="parameters")
TRACKING = columns("of log low high unit", of="beside_log")


def answer(beside: Beside) -> Answer:
    """Accuracy, losses, margins and the emulation in four lines; then the tables."""
    accuracy, now = beside.accuracy, beside.now
    ended = beside.rows[beside.rows["status"] != "completed"].assign(run=lambda x: x["draw"])
    lost = {x: ended[ended["gains"] == x].to_dict(orient="records") for x in (YOURS, OURS)}
    kept, bound = kept_errors(beside)
    unused = ", ".join(now.unused) or "none"
    return Answer(
        summary=summary(beside, kept, accuracy, lost),
        values={
            "guidance": now.name,
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


def kept_errors(beside: Beside) -> tuple[str, str]:
    """Words for the bounds on errors of a new flight, in short and with the confidence."""
    if (n := beside.plan.draws) < (needed := flights_needed(EPSILON, CONFIDENCE)):
        return f"Largest errors of {n}", f"Largest errors of {n}; {needed} are needed for a bound"
    kept = f"Errors that {percent(1.0 - EPSILON)} % of flights keep to"
    return kept, f"{kept}, each by itself, at a confidence of {percent(CONFIDENCE)} %"


def summary(beside: Beside, kept: str, accuracy: Rows, lost: Mapping[str, Rows]) -> list[str]:
    """Bounds on errors, lost flights, draws in which ours is better, the loops, and the basis."""
    n, both, better, said = beside.plan.draws, [], [], []
    for x in accuracy[:3]:  # cross track, height and airspeed of a route
        yours, ours = (number(x[name], ".3g") for name in (YOURS, OURS))
        both.append(f"{x['of']} {yours} | {ours} {x['unit']}")
        better.append(f"{x['of']} {x['better']} ({percent(x['lo'])} to {percent(x['hi'])} %)")
    for rows in lost.values():
        why = ", ".join(dict.fromkeys(row["status"].replace("_", " ") for row in rows))
        said.append(f"{len(rows)} ({why})" if rows else "0")
    checked = "" if beside.tracking else "; not checked against a log"
    beyond = listed(beside.now.beyond)
    beyond = f" Beyond their published ranges: {beyond}." if beyond else ""
    return [
        f"{kept}, yours | ours: {', '.join(both)}; lost {' | '.join(said)} of {n}.",
        f"Ours is better of {n} draws in: {', '.join(better)}.",
        in_your_terms(beside),
        f"Yours: the equations of {beside.now.name} above the inner loop here, not the "
        f"firmware{checked}.{beyond}",
    ]


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
        f"Our K_P of the course, {K_P:.2f} 1/s, is {period} = {same:.1f} s (yours "
        f"{law.roles['period']:g} s). {f'Margins: {margins}.' if margins else ''}"
    ).strip()


def margins_at(cut: Sequence[Margins], place: int) -> str:
    """Gain and phase margin of a loop cut at one place."""
    if not cut:
        return "unstable"
    gain, phase = cut[place].gain_increase, math.degrees(cut[place].phase_margin)
    return f"{20.0 * math.log10(gain):.1f} dB, {phase:.0f} deg"
