"""The answer of a search for gains that meet requirements."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flighttune.base.words import interval, listed, percent, pick
from flighttune.campaigns.statistics.intervals import CONFIDENCE
from flighttune.claims.counted_flights import distribution_of
from flighttune.control.gains import gains_lists
from flighttune.control.linear_model import closed_loop
from flighttune.control.margins import loop_margins
from flighttune.control.theory.indicators import indicators
from flighttune.flight.gains import certify_scenario
from flighttune.flight.models import linear_model
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.early import finding_of_early
from flighttune.outputs.answers.finding import headlines, unmet
from flighttune.outputs.answers.labels import columns, endings_table, in_words, measure_words
from flighttune.outputs.answers.tables import dispersions_table, gains_table, margins_table
from flighttune.studies.meeting import BY_DEFAULT, Meeting

REQUIREMENT_COLUMNS = columns("run words must_be value start margin", of="requirements")
SHARE_COLUMNS = [*REQUIREMENT_COLUMNS[:3], *columns("value share share_start", of="shares")]
TRADE_COLUMNS = [*REQUIREMENT_COLUMNS[:4], *columns("alone beside", of="trade_offs")]
TRADED = "the best of each among the gains flown here"
CERTIFICATE_COLUMNS = [Column("in_words", "status"), *columns("rate growth radius")]
BY_DEFAULT_NOTE = (
    "Required by default: a gain margin of 6 dB and a phase margin of 35 deg (to change: "
    "at_least.loop of [[expect]])."
)
# Claims, by the rule that decides or by the sure answer.
AT_ANY = f"confidence {CONFIDENCE:g} at any number of draws"
DECIDED = {
    "lo": "{} are wanted, by the lower end of the interval",
    "value": "{} are wanted, by the estimate",
    "yes": f"those of a new random draw do with a probability of at least {{}}, {AT_ANY}",
    "no": f"those of a new random draw do with a probability below {{}}, {AT_ANY}",
    "evidence": "it is not sure whether those of a new random draw do with a probability of {}",
}


def answer(meeting: Meeting) -> Answer:
    """Requirements, gains, margins and certificate; a failure if a requirement is missed."""
    scenario, rows, law = meeting.scenario, meeting.requirements, meeting.scenario.laws[0]
    model = linear_model(scenario, law)
    loop = indicators(closed_loop(model, meeting.gains), errors=len(model.errors))
    figures = pick(loop, "R_K I_K E_K spectral_abscissa")
    certificate = certify_scenario(scenario, meeting.gains, law=law).values
    missed = [f"{subject(row)}: {row['why']}" for row in rows if row["why"]]
    shown, said = SHARE_COLUMNS if meeting.success else REQUIREMENT_COLUMNS, sentence(meeting)
    early = (
        [] if meeting.status == "met" else finding_of_early({"": meeting.endings}, meeting.flights)
    )
    return Answer(
        values={
            **pick(meeting, "status start start_met flights candidates metric"),
            **pick(meeting, "requirements worse trade_offs success tuned_for"),
            **gains_lists(meeting.gains),
            **figures,
            "certificate": certificate,
            **meeting.compiled.values,
        },
        tables=[
            Table(shown, [*map(in_words, rows)], scenario.title),
            Table(TRADE_COLUMNS, [*map(in_words, meeting.trade_offs)], TRADED),
            gains_table("gains", meeting.gains),
            *(replace(table, aside=True) for table in drawn(meeting)),
            Table(columns("R_K I_K E_K spectral_abscissa"), [figures], "indicators", aside=True),
            replace(margins_table(loop_margins(model, meeting.gains)), aside=True),
            Table(CERTIFICATE_COLUMNS, [certificate], "certificate", aside=True),
            endings_table(meeting.endings),
        ],
        lines=[said] * (not early) + choice_of_start(meeting),
        notes=[
            *filter(None, [worse_sentence(meeting), *meeting.notes, *missed]),
            *meeting.compiled.notes,
            *[BY_DEFAULT_NOTE] * any(row["run"].endswith(BY_DEFAULT) for row in rows),
        ],
        verdict=headlines(early)[0] if early else said,
        findings=early or ([] if meeting.status == "met" else unmet(said)),
    )


def choice_of_start(meeting: Meeting) -> list[str]:
    """Which gains the search compares itself with, and which others were tried; else nothing."""
    if not meeting.other_starts:
        return []
    whose = "gains that the scenario flies" if meeting.start_of_scenario else "tuned gains"
    return [
        f"The start is {meeting.start}, the nearest to the requirements of the {whose}; "
        f"{listed(meeting.other_starts)} were tried too."
    ]


def drawn(meeting: Meeting) -> list[Table]:
    """The dispersions of each plant; empty without a campaign."""
    if meeting.campaign is None:
        return []
    labels = [plant.label for plant in meeting.scenario.plant]
    return [dispersions_table(distribution_of(meeting.campaign, label), label) for label in labels]


def worse_sentence(meeting: Meeting) -> str:
    """Measures that are worse than with the initial gains; else empty."""
    worse = [
        f"{row['words']} {row['value']:.3g} {row['unit']} (was {row['start']:.3g})"
        for row in map(in_words, meeting.worse)
    ]
    return f"Worse than with {meeting.start}: {listed(worse)}." if worse else ""


def sentence(meeting: Meeting) -> str:
    """Whether the requirements are met, after how many flights, and which are active."""
    rows, flights = meeting.requirements, f"{meeting.flights} flight{'s' * (meeting.flights != 1)}"
    if meeting.success:
        return share_met(meeting, meeting.success, flights)
    n, missed = len(rows), sum(not row["margin"] >= 0.0 for row in rows)
    if missed:
        said = f"{missed} of {n} requirements are missed after {flights}"
        return f"{said}; these are the nearest gains."
    tightest = min(rows, key=lambda row: row["margin"])
    also = f"The gains of the start, {meeting.start}, already meet" if meeting.start_met else "Met:"
    met = (
        f"{also} all {n} requirements. The gains found have {100.0 * tightest['margin']:.1f} % to "
        f"spare in the tightest, {subject(tightest)}, after {flights}."
    )
    if meeting.metric["name"] == "margin":
        return met
    active = [subject(row) for row in rows if row["active"]]
    stop = "stops" if len(active) == 1 else "stop"
    limits = f"; {listed(active)} {stop} it from falling" if active else ""
    return (
        f"{met} {meeting.metric['name']} is {meeting.metric['value']:.4g}, "
        f"{meeting.metric['start']:.4g} at the start{limits}."
    )


def share_met(meeting: Meeting, success: Mapping[str, Any], flights: str) -> str:
    """The share of fresh draws on which the requirements are met."""
    gains, start = (
        interval(*(100.0 * x[end] for end in ("value", "lo", "hi")))
        if "lo" in x
        else percent(x["value"])
        for x in (success["share"], success["of_start"])
    )
    rule = DECIDED[success["sure"] or success["by"]].format(f"{100 * success['wanted']:g} %")
    return (
        f"On {success['share']['n']} fresh draws (seed {success['seed']}) {gains} % of the "
        f"flights meet all requirements, {start} % with {meeting.start}; {rule} ({flights})."
    )


def subject(row: Mapping[str, Any]) -> str:
    where = f"({BY_DEFAULT})" if row["run"] == BY_DEFAULT else f"on {row['run']}"
    return f"{measure_words(row['measure'])} {where}"
