"""The headline of a campaign's report: success, failures, the certified set, influences."""

from collections import Counter

import numpy as np

from flighttune.campaign.planning.draws import SEED
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.present.frame import Question, share_verdict
from flighttune.present.numbers import percent
from flighttune.report.campaign.words import demands

CHANCE = "noise and turbulence"
"""Effects of the seed of a flight."""

CONFIDENCE = {"clopper-pearson": "Clopper and Pearson's", "wilson": "Wilson's"}


def headline(findings: Findings) -> tuple[Question, ...]:
    """Answers on success, failures, the certified set and the influential parameters."""
    questions = [_holds(findings), _wrong(findings)]
    if any(summary.certified is not None for summary in findings.groups):
        questions.append(_certified(findings))
    if findings.flights.keys:
        questions.append(_matters(findings))
    return tuple(questions)


def _holds(findings: Findings) -> Question:
    flights = findings.flights
    plants = dict.fromkeys(summary.group.plant for summary in findings.groups)
    return Question(
        question="Which gains hold, and how often?",
        verdict=share_verdict(
            sum(summary.successes for summary in findings.groups),
            sum(summary.n for summary in findings.groups),
        ),
        short="; ".join(_best_and_lowest(findings, plant) for plant in plants),
        criterion=f"{demands(flights.plan.scenario.expect)} In brackets "
        f"{CONFIDENCE[flights.method]} interval of {100.0 * flights.confidence:g} % confidence.",
    )


def _best_and_lowest(findings: Findings, plant: str) -> str:
    there = [summary for summary in findings.groups if summary.group.plant == plant]
    most = max(summary.success.value for summary in there)
    best = [summary for summary in there if summary.success.value == most]
    others = [summary for summary in there if summary not in best]
    text = f"{', '.join(summary.group.gains for summary in best)} {percent(most)} %"
    if others:
        last = min(others, key=lambda summary: summary.success.value)
        lowest = "lowest: " if len(others) > 1 else ""
        text += f" ({lowest}{last.group.gains} {percent(last.success.value)} %)"
    return f"{text} on {plant}"


def _wrong(findings: Findings) -> Question:
    n = sum(summary.n for summary in findings.groups)
    failed = n - sum(summary.successes for summary in findings.groups)
    return Question(
        question="What goes wrong?",
        verdict="none",
        short=f"{failed} of {n} flights fail" if failed else "nothing",
    )


def _certified(findings: Findings) -> Question:
    counts = [summary.certified for summary in findings.groups if summary.certified is not None]
    kept, n = sum(count.held for count in counts), sum(count.of_all.n for count in counts)
    vacuous = bool(findings.claims) and all(claim.vacuous for claim in findings.claims.values())
    return Question(
        question="Does the certified bound hold?",
        verdict="none" if vacuous else share_verdict(kept, n),
        short=f"in {kept} of {n} flights",
        criterion="The certified ultimate set was entered and held.",
    )


def _matters(findings: Findings) -> Question:
    strongest = [
        _strongest(findings, summary.group, name)
        for summary in findings.groups
        for name in (SUCCESS, findings.measure)
        if name is not None
    ]
    counts = Counter(name for name in strongest if name)
    names = [name for name, count in counts.items() if count == max(counts.values())]
    return Question(
        question="What matters?",
        verdict="none",
        short=", ".join(names) or "nothing significant",
        criterion="The strongest significant parameters; p-values with Holm's correction for the "
        "number of tests.",
    )


def _strongest(findings: Findings, group: Group, name: str) -> str:
    """The strongest factor by its total Sobol index, else by ranks; empty if none matters."""
    indices = findings.sobol.get((group, name))
    if indices is not None:
        factor = findings.flights.plan.factors[int(np.argmax(indices.total[0]))]
        return CHANCE if factor == SEED else factor
    influences = findings.influences.get((group, name), ())
    return next((influence.parameter for influence in influences if influence.apart), "")
