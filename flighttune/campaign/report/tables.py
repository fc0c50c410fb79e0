"""Tables of a campaign's report: headings and rows as text."""

import math
from collections.abc import Iterable
from typing import Any

import pandas as pd

from flighttune.campaign.planning.plan import Group
from flighttune.campaign.report.estimates import Estimate
from flighttune.campaign.report.findings import SUCCESS, Findings
from flighttune.campaign.report.sensitivity import Influence
from flighttune.campaign.report.words import (
    figures,
    label_of,
    percent,
    probability,
    shown,
    with_interval,
)
from flighttune.campaign.report.worst import failures, worst_first
from flighttune.report.frame import PageTable

MEASURES = (
    "chi.ITAE", "gamma.ITAE", "chi.MO_rad", "gamma.MO_rad", "chi.settling_s", "gamma.settling_s",
    "chi.ST_rad", "gamma.ST_rad", "flight.n_z_max", "flight.alpha_max_rad",
)  # fmt: skip
"""Measures of the page; the JSON object has all."""

WORST, LEAST = 20, 2
"""Flights in the table of the worst, and at least so many of each group."""

FAILURES = 12
PARAMETERS = 5
"""Parameters beside a flight: those that matter most."""

INFLUENCES = 10


def success_table(found: Findings) -> PageTable:
    """How often each group succeeds, and how its flights ended."""
    statuses = list(dict.fromkeys(s.status for one in found.groups for s in one.statuses))
    rows = []
    for one in found.groups:
        count = {status.status: status.count for status in one.statuses}
        known = one.certified
        rows.append(
            (
                label_of(one.group), str(one.n), str(one.successes),
                _percent(one.success),
                *(str(count.get(status, 0)) for status in statuses),
                "–" if known is None else _percent(known.of_all),
            )
        )  # fmt: skip
    head = (
        "group", "flights", "succeed", "rate [%]",
        *(status.replace("_", " ") for status in statuses), "certified set held [%]",
    )  # fmt: skip
    return _by_group("How often", head, rows)


def reasons_table(found: Findings) -> PageTable:
    """Why flights failed, sentences that differ in numbers alone put together."""
    rows = []
    for one in found.groups:
        told = [(s.status, why) for s in one.statuses for why in s.reasons]
        told += [("completed", why) for why in one.missed]
        for status, why in told:
            word = status.replace("_", " ")
            rows.append((label_of(one.group), str(why.count), str(why.run), word, why.text))
    return _by_group("Why flights fail", ("group", "flights", "first run", "ended", "reason"), rows)


def worst_table(found: Findings) -> PageTable:
    """The worst completed flights of each group, with the parameters that matter most."""
    flown, measure = found.flown, found.measure or ""
    keys = telling_parameters(found)
    rows, each = [], max(LEAST, WORST // len(found.groups))
    for group, own in flown.groups():
        for flight in worst_first(own, measure, each).to_dict("records"):
            rows.append(
                (
                    label_of(group), str(flight["run"]), str(flight["draw"]),
                    figures(shown(measure).factor * float(flight[measure])),
                    "yes" if flight[SUCCESS] else "no", *(_value(flight[key]) for key in keys),
                )
            )  # fmt: skip
    head = ("group", "run", "draw", shown(measure).titled, "succeeds", *keys)
    return _by_group("Worst completed flights", head, rows)


def failures_table(found: Findings) -> PageTable:
    """Flights that ended early, of every status the first ones."""
    keys = telling_parameters(found)
    rows = [
        (
            f"{flight['plant']} / {flight['gains']}", str(flight["run"]), str(flight["draw"]),
            *(_value(flight[key]) for key in keys),
            f"{str(flight['status']).replace('_', ' ')}: {flight['reason']}",
        )
        for flight in failures(found.flown.rows, FAILURES).to_dict("records")
    ]  # fmt: skip
    return _by_group("Flights that ended early", ("group", "run", "draw", *keys, "ended"), rows)


def measures_table(found: Findings) -> PageTable:
    """Percentiles of the measures of completed flights with their intervals."""
    wanted = [*dict.fromkeys([found.measure or "", *MEASURES])]
    rows, labels = [], []
    for measure in wanted:
        for one in found.groups:
            spread = one.measures.get(measure)
            if spread is None:
                continue
            how, of = shown(measure), spread.percentiles
            cells = (with_interval(of[name], how.factor) for name in ("p05", "p50", "p95"))
            label = label_of(one.group)
            rows.append(
                (label, how.titled, str(spread.n), figures(how.factor * spread.mean), *cells)
            )
            labels.append(label)
    head = ("group", "measure", "flights", "mean", "5 %", "50 %", "95 %")
    return PageTable(title="Measures", head=head, rows=tuple(rows), label=tuple(labels))


def influence_table(found: Findings, name: str) -> PageTable:
    """What each parameter does to success or to a measure, the strongest first."""
    rows = []
    for group, _ in found.flown.groups():
        rows += [
            (
                label_of(group), one.parameter, str(one.n), _explained(one),
                _correlation(one), "–" if math.isnan(one.partial) else f"{one.partial:+.2f}",
                probability(min(one.p_rho, one.p_share)), "yes" if one.apart else "no",
            )
            for one in found.influences.get((group, name), ())[:INFLUENCES]
        ]  # fmt: skip
    what = SUCCESS if name == SUCCESS else shown(name).name
    head = (
        "group", "parameter", "flights", "explains [% of ranks]", "rank correlation", "partial",
        "chance", "stands apart",
    )  # fmt: skip
    return _by_group(f"What matters to {what}", head, rows)


def sobol_table(found: Findings) -> PageTable:
    """First and total indices with their intervals."""
    rows = []
    for (group, name), one in found.sobol.items():
        what = SUCCESS if name == SUCCESS else shown(name).name
        for i, factor in enumerate(found.flown.plan.factors):
            first, total = (
                f"{value[i]:.2f} [{lo[i]:.2f}, {hi[i]:.2f}]"
                for value, lo, hi in (
                    (one.first, one.first_lo, one.first_hi),
                    (one.total, one.total_lo, one.total_hi),
                )
            )
            rows.append((label_of(group), what, factor, str(one.n), first, total))
    head = ("group", "of", "parameter", "blocks", "first index", "total index")
    return _by_group("Sobol indices", head, rows)


def paired_table(found: Findings) -> PageTable:
    """Gain sets against each other, draw by draw."""
    rows = []
    for one in found.paired:
        how = shown(one.measure)
        low, middle, high = (
            figures(how.factor * value) for value in (one.median_lo, one.median, one.median_hi)
        )
        wins = f"{percent(one.win_rate)} [{percent(one.lo)}, {percent(one.hi)}]"
        rows.append(
            (
                f"{one.a} against {one.b}, {one.plant}", str(one.n), wins,
                f"{middle} [{low}, {high}]", str(one.only_a), str(one.only_b),
                probability(one.p_success),
            )
        )  # fmt: skip
    unit = f" [{shown(found.measure).unit}]" if found.measure else ""
    head = (
        "first against second", "draws", "first has less [%]", f"median of first less second{unit}",
        "only first succeeds", "only second", "chance",
    )  # fmt: skip
    return PageTable(
        title="Gains on the same draws", head=head, rows=tuple(rows), label=("",) * len(rows)
    )


def telling_parameters(found: Findings) -> list[str]:
    """The parameters that matter most to any group, the strongest first."""
    strength: dict[str, float] = {}
    for influences in found.influences.values():
        for one in influences:
            strength[one.parameter] = max(one.strength, strength.get(one.parameter, 0.0))
    ordered = sorted(found.flown.keys, key=lambda key: -strength.get(key, 0.0))
    return ordered[:PARAMETERS]


def _percent(one: Estimate) -> str:
    return f"{percent(one.value)} [{percent(one.lo)}, {percent(one.hi)}]"


def _correlation(one: Influence) -> str:
    return "–" if math.isnan(one.rho) else f"{one.rho:+.2f} [{one.lo:+.2f}, {one.hi:+.2f}]"


def _explained(one: Influence) -> str:
    return "–" if math.isnan(one.share) else f"{100.0 * max(0.0, one.share):.1f}"


def _value(value: Any) -> str:
    if isinstance(value, float):
        return figures(value)
    return "–" if pd.isna(value) else str(value)


def _by_group(title: str, head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> PageTable:
    """A table whose first column names the group; words end it where the last is no number."""
    rows = tuple(rows)
    return PageTable(
        title=title,
        head=head,
        rows=rows,
        label=tuple(row[0] for row in rows),
        ends_in_words=head[-1] in ("reason", "ended"),
    )


def groups_of(found: Findings) -> list[Group]:
    """Groups that have flown, in the order of the plan."""
    return [one.group for one in found.groups]
