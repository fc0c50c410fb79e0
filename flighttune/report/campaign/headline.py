"""The headline of a campaign's report: success rates with intervals, failures, influences."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from flighttune.campaign.planning.draws import SEED
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.campaign.statistics.paired import Paired
from flighttune.campaign.statistics.sensitivity import Influence
from flighttune.campaign.statistics.summary import GroupSummary
from flighttune.present.frame import Answer, share_verdict
from flighttune.present.names import metric_label
from flighttune.present.numbers import figures, percent
from flighttune.report.campaign.words import (
    demands,
    metric_name,
    percent_with_interval,
    probability,
)
from flighttune.units import DEG

MOST_REASONS = 3
"""Reasons given for one group; the tables have all."""

MOST_PARAMETERS = 3
MOST_PAIRS = 6
SMALLEST_INDEX = 0.01
"""Total Sobol index from which on a factor is named."""

CHANCE = "noise and turbulence"
"""What the seed of a flight changes."""


def headline(found: Findings) -> tuple[Answer, ...]:
    """Which gains succeed, what goes wrong, whether the certified set holds, what matters."""
    answers = [_holds(found), _wrong(found)]
    if any(one.certified is not None for one in found.groups):
        answers.append(_certified(found))
    if found.flights.keys:
        answers.append(_matters(found))
    return tuple(answers)


def best_of(found: Findings, plant: str) -> list[GroupSummary]:
    """The groups of a plant that succeed most often, in the order of the groups."""
    there = [one for one in found.groups if one.group.plant == plant]
    most = max(one.success.value for one in there)
    return [one for one in there if one.success.value == most]


def plants_of(found: Findings) -> list[str]:
    """Plants in the order of the groups."""
    return list(dict.fromkeys(one.group.plant for one in found.groups))


def _holds(found: Findings) -> Answer:
    good, all_of = sum(one.successes for one in found.groups), sum(one.n for one in found.groups)
    sentences = [
        f"{one.group.label}: {one.successes} of {one.n} flights succeed, "
        f"{percent_with_interval(one.success)}."
        for one in found.groups
    ]
    sentences += [_against(one) for one in _pairs_of_the_best(found)]
    short = "; ".join(_best_and_lowest(found, plant) for plant in plants_of(found))
    intervals = "Clopper and Pearson's" if found.flights.method == "clopper-pearson" else "Wilson's"
    return Answer(
        question="Which gains hold, and how often?",
        verdict=share_verdict(good, all_of),
        short=short,
        sentences=tuple(sentences),
        criterion=f"{demands(found.flights.plan.scenario.expect)} In brackets {intervals} interval "
        f"of {100.0 * found.flights.confidence:g} % confidence.",
    )


def _best_and_lowest(found: Findings, plant: str) -> str:
    best = best_of(found, plant)
    others = [one for one in found.groups if one.group.plant == plant and one not in best]
    text = f"{', '.join(one.group.gains for one in best)} {percent(best[0].success.value)} %"
    if others:
        last = min(others, key=lambda one: one.success.value)
        lowest = "lowest: " if len(others) > 1 else ""
        text += f" ({lowest}{last.group.gains} {percent(last.success.value)} %)"
    return f"{text} on {plant}"


def _pairs_of_the_best(found: Findings) -> list[Paired]:
    """The best of each plant against the others."""
    best = {plant: best_of(found, plant)[0].group.gains for plant in plants_of(found)}
    return [one for one in found.paired if best[one.plant] in (one.a, one.b)][:MOST_PAIRS]


def _against(one: Paired) -> str:
    measure = metric_label(one.measure)
    first, other, median, low, high = (
        (one.a, one.b, one.median, one.median_lo, one.median_hi)
        if one.median <= 0.0
        else (one.b, one.a, -one.median, -one.median_hi, -one.median_lo)
    )
    wins = one.win_rate if first == one.a else 1.0 - one.win_rate
    less, least, most = (figures(-measure.factor * value) for value in (median, high, low))
    only = f"{one.only_a} draws only {one.a} succeeds, on {one.only_b} only {one.b}"
    differ = one.wins_a + one.wins_b
    those = f" of the {differ} on which they differ" if differ < one.n else ""
    by = f", by {less} {measure.unit} ({least} to {most}) in median"
    by = "" if low <= 0.0 <= high else by
    return (
        f"On the same {one.n} draws on {one.plant}, {measure.name} is lower with {first} than with "
        f"{other} on {percent(wins)} %{those}{by}; on {only} ({probability(one.p_success)})."
    )


def _wrong(found: Findings) -> Answer:
    failed, n = sum(one.n - one.successes for one in found.groups), sum(g.n for g in found.groups)
    sentences = [line for one in found.groups for line in _failures(one)]
    return Answer(
        question="What goes wrong?",
        verdict="none",
        short=f"{failed} of {n} flights fail" if failed else "nothing",
        sentences=tuple(sentences) or ("Every flight succeeds.",),
    )


def _failures(one: GroupSummary) -> Iterator[str]:
    lines = []
    for status in one.statuses:
        if status.status == "completed":
            continue
        word = status.status.replace("_", " ")
        first = status.reasons[0] if status.reasons else None
        why = f": {first.text.rstrip('.')} (e.g. run {first.run})" if first else ""
        more = f", and {len(status.reasons) - 1} other reasons" if len(status.reasons) > 1 else ""
        lines.append(f"{status.count} of {one.n} ended as {word}{why}{more}")
    for missed in one.missed[:MOST_REASONS]:
        lines.append(
            f"{missed.count} completed flights miss: {missed.text} (e.g. run {missed.run})"
        )
    if lines:
        yield f"{one.group.label}: {'; '.join(lines)}."


def _certified(found: Findings) -> Answer:
    sentences, held, known = [], 0, 0
    for one in found.groups:
        if one.certified is None:
            continue
        count = one.certified
        held, known = held + count.held, known + count.of_all.n
        entered = count.held + count.broken
        of_entered = (
            f"; of the {entered} flights that entered it, {percent_with_interval(count.of_entered)}"
            if entered
            else "; no flight entered it"
        )
        sentences.append(
            f"{one.group.label}: the certified ultimate set{_size(found, one.group)} was "
            f"entered and held in {count.held} of {count.of_all.n} flights, "
            f"{percent_with_interval(count.of_all)}{of_entered}."
        )
    return Answer(
        question="Does the certified bound hold?",
        verdict="none" if _all_vacuous(found) else share_verdict(held, known),
        short=f"in {held} of {known} flights",
        sentences=tuple(sentences),
    )


def _size(found: Findings, group: Group) -> str:
    """The error bounds of the set of a group, and whether they are vacuous."""
    claim = found.claims.get(group)
    if claim is None:
        return ""
    chi, gamma = (figures(width / DEG) for width in claim.tube)
    nothing = ": too loose to be useful" if claim.vacuous else ""
    return f" (from {claim.t_from:g} s on errors up to {chi}° of χ and {gamma}° of γ{nothing})"


def _all_vacuous(found: Findings) -> bool:
    """Whether the bound of every group is too loose to be useful."""
    return bool(found.claims) and all(claim.vacuous for claim in found.claims.values())


def _matters(found: Findings) -> Answer:
    rows = [
        (f"{one.group.label}, {metric_name(name)}", one, name)
        for one in found.groups
        for name in (SUCCESS, found.measure)
        if name is not None
    ]
    sentences, named = [], []
    for label, one, name in rows:
        first, text = _variance(found, one.group, name) or _ranks(found, one.group, name)
        named += [first] if first else []
        sentences += [f"{label}: {text}."] if text else []
    return Answer(
        question="What matters?",
        verdict="none",
        short=", ".join(_most_named(named)) or "nothing significant",
        sentences=tuple(sentences) or ("Too few flights, or all of them alike.",),
        criterion="The strongest significant parameters; p-values with Holm's correction for the "
        "number of tests.",
    )


def _most_named(named: list[str]) -> list[str]:
    """The names that stand there most often, in the order of the first of each."""
    counts = Counter(named)
    return [name for name, count in counts.items() if count == max(counts.values())]


def _variance(found: Findings, group: Group, name: str) -> tuple[str, str] | None:
    """The strongest factors by their total Sobol index, where there are some."""
    indices = found.sobol.get((group, name))
    if indices is None:
        return None
    names = [CHANCE if factor == SEED else factor for factor in found.flights.plan.factors]
    total, lo, hi = 100.0 * indices.total
    alone = 100.0 * np.maximum(0.0, indices.first[0])
    order = np.argsort(-total, kind="stable")[:MOST_PARAMETERS].tolist()
    parts = [
        f"{names[i]} contributes to {total[i]:.0f} % of the variance ({lo[i]:.0f} to {hi[i]:.0f} "
        f"%), alone {alone[i]:.0f} %"
        for i in order
        if lo[i] > 100.0 * SMALLEST_INDEX
    ]
    return names[order[0]], "; ".join(parts)


def _ranks(found: Findings, group: Group, name: str) -> tuple[str, str]:
    """The strongest parameters by ranks; empty if none is significant."""
    influences = found.influences.get((group, name), ())
    significant = [influence for influence in influences if influence.apart][:MOST_PARAMETERS]
    if significant:
        texts = (_influence_text(one, 1.0 - found.flights.confidence) for one in significant)
        return significant[0].parameter, "; ".join(texts)
    if not influences:
        return "", ""
    n = influences[0].n
    return "", f"none of {len(influences)} parameters is significant in {n} flights"


def _influence_text(one: Influence, limit: float) -> str:
    """The significant part of an influence: the share explained, the direction, or both."""
    parts = []
    if one.p_share < limit:
        parts.append(f"accounts for {100.0 * one.share:.0f} % of the rank variance")
    if one.p_rho < limit:
        parts.append(f"rank correlation {one.rho:+.2f}")
    return f"{one.parameter} {', '.join(parts)}"
