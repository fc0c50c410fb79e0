"""Tables of a campaign's report: headings and rows as text."""

from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd

from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.campaign.statistics.flights import failures, worst_first
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.present.names import metric_label
from flighttune.present.numbers import MISSING, figures, interval, number, percent_interval
from flighttune.present.tables import Table
from flighttune.report.campaign.words import (
    metric_name,
    probability,
    status_words,
)

METRICS = (
    *(f"{channel}.{metric}" for metric in ("ITAE", "MO_rad") for channel in ("chi", "gamma")),
    *(f"{channel}.{metric}" for metric in ("settling_s", "ST_rad") for channel in ("chi", "gamma")),
    "flight.n_z_max",
    "flight.alpha_max_rad",
)
"""Metrics of the page; the JSON object has all."""

WORST, WORST_OF_GROUP = 20, 2
"""Flights in the table of the worst, and the smallest number of each group."""

FLY_AGAIN = "to fly it again"
"""Column of commands."""

FAILURES = 12
PARAMETERS = 5
"""Parameters listed with a flight: the most influential ones."""

INFLUENCES = 10


def success_table(found: Findings) -> Table:
    """How often each group succeeds, and how its flights ended."""
    statuses = list(dict.fromkeys(s.status for one in found.groups for s in one.statuses))
    rows = []
    for one in found.groups:
        count = {status.status: status.count for status in one.statuses}
        held = MISSING if one.certified is None else _percent(one.certified.of_all)
        numbers = (str(n) for n in (one.n, one.successes))
        ended = (str(count.get(status, 0)) for status in statuses)
        rows.append((one.group.label, *numbers, _percent(one.success), *ended, held))
    ended = map(status_words, statuses)
    head = ("group", "flights", "succeed", "rate [%]", *ended, "certified set held [%]")
    return _by_group("How often", head, rows)


def reasons_table(found: Findings) -> Table:
    """Why flights failed; sentences that differ only in numbers are counted as one."""
    rows = []
    for one in found.groups:
        reasons = [(s.status, reason) for s in one.statuses for reason in s.reasons]
        reasons += [("completed", reason) for reason in one.missed]
        for status, reason in reasons:
            counts = str(reason.count), str(reason.run)
            rows.append((one.group.label, *counts, status_words(status), reason.text))
    return _by_group("Why flights fail", ("group", "flights", "first run", "ended", "reason"), rows)


def worst_table(found: Findings) -> Table:
    """The worst completed flights of each group, with the most influential parameters."""
    if found.measure is None:
        return _by_group("Worst completed flights", (), [])
    metric, label, keys = found.measure, metric_label(found.measure), influential_parameters(found)
    rows, each = [], max(WORST_OF_GROUP, WORST // len(found.groups))
    for group, own in found.flights.groups():
        for flight in worst_first(own, metric, each).to_dict("records"):
            value = label.text(float(flight[metric]))
            success = "yes" if flight[SUCCESS] else "no"
            command = f"flighttune campaign fly {found.flights.url} --run {flight['run']}"
            row = (*_flight(group.label, flight), value, success, *_values(flight, keys), command)
            rows.append(row)
    head = ("group", "run", "draw", label.heading, "succeeds", *_short(keys), FLY_AGAIN)
    return _by_group("Worst completed flights", head, rows)


def failures_table(found: Findings) -> Table:
    """Flights that ended early: the first ones of every status."""
    keys = influential_parameters(found)
    rows = []
    for flight in failures(found.flights.rows, FAILURES).to_dict("records"):
        ended = f"{status_words(str(flight['status']))}: {flight['reason']}"
        group = f"{flight['plant']} / {flight['gains']}"
        rows.append((*_flight(group, flight), *_values(flight, keys), ended))
    return _by_group(
        "Flights that ended early", ("group", "run", "draw", *_short(keys), "ended"), rows
    )


def metrics_table(found: Findings) -> Table:
    """Median of each metric of completed flights, with the 5th and 95th percentile."""
    rows = []
    for metric in dict.fromkeys([found.measure or "", *METRICS]):
        spreads = [one.measures.get(metric) for one in found.groups]
        if not any(spreads):
            continue
        label = metric_label(metric)
        cells = [
            MISSING
            if spread is None
            else "{} [{}, {}]".format(
                *(label.text(spread.percentiles[p].value) for p in ("p50", "p05", "p95"))
            )
            for spread in spreads
        ]
        rows.append((label.heading, *cells))
    head = ("median [5 %, 95 %]", *(one.group.label for one in found.groups))
    return Table(title="Metrics", head=head, rows=rows)


def influence_table(found: Findings, name: str) -> Table:
    """Influence of each parameter on success or on a metric, the strongest first."""
    rows = []
    for group in groups_of(found):
        for one in found.influences.get((group, name), ())[:INFLUENCES]:
            rho = number(one.rho, "+.2f")
            if rho != MISSING:
                rho += f" [{one.lo:+.2f}, {one.hi:+.2f}]"
            share = number(100.0 * one.share, ".1f")
            cells = ("0.0" if one.share < 0.0 else share, rho, number(one.partial, "+.2f"))
            p, apart = probability(min(one.p_rho, one.p_share)), "yes" if one.apart else "no"
            rows.append((group.label, one.parameter, str(one.n), *cells, p, apart))
    head = (
        *("group", "parameter", "flights", "rank variance [%]", "rank correlation", "partial"),
        *("p-value", "significant"),
    )
    return _by_group(f"Influence on {metric_name(name)}", head, rows)


def sobol_table(found: Findings) -> Table:
    """First and total indices with their intervals."""
    rows = []
    for (group, name), one in found.sobol.items():
        for i, factor in enumerate(found.flights.plan.factors):
            indices = ("{:.2f} [{:.2f}, {:.2f}]".format(*of[:, i]) for of in (one.first, one.total))
            rows.append((group.label, metric_name(name), factor, str(one.n), *indices))
    head = ("group", "of", "parameter", "blocks", "first index", "total index")
    return _by_group("Sobol indices", head, rows)


def paired_table(found: Findings) -> Table:
    """Gain sets compared draw by draw."""
    rows = []
    for one in found.paired:
        factor = metric_label(one.measure).factor
        rows.append(
            (
                f"{one.a} against {one.b}, {one.plant}",
                str(one.n),
                percent_interval(one.win_rate, one.lo, one.hi),
                interval(factor * one.median, factor * one.median_lo, factor * one.median_hi),
                str(one.only_a),
                str(one.only_b),
                probability(one.p_success),
            )
        )
    unit = f" [{metric_label(found.measure).unit}]" if found.measure else ""
    head = (
        *("first against second", "draws", "first lower [%]"),
        f"median of first minus second{unit}",
        *("only first succeeds", "only second", "p-value"),
    )
    return Table(title="Gains on the same draws", head=head, rows=rows)


def influential_parameters(found: Findings) -> list[str]:
    """The most influential parameters of any group, the strongest first."""
    strength: dict[str, float] = {}
    for influences in found.influences.values():
        for one in influences:
            strength[one.parameter] = max(one.strength, strength.get(one.parameter, 0.0))
    ordered = sorted(found.flights.keys, key=lambda key: -strength.get(key, 0.0))
    return ordered[:PARAMETERS]


def groups_of(found: Findings) -> list[Group]:
    """Groups that have flown, in the order of the plan."""
    return [one.group for one in found.groups]


def _short(keys: Sequence[str]) -> list[str]:
    """Keys by their last part, whole where two of them end alike."""
    ends = [key.rpartition(".")[2] for key in keys]
    return [end if ends.count(end) == 1 else key for key, end in zip(keys, ends, strict=True)]


def _percent(one: Estimate) -> str:
    return percent_interval(one.value, one.lo, one.hi)


def _flight(group: str, flight: dict[Any, Any]) -> tuple[str, str, str]:
    return group, str(flight["run"]), str(flight["draw"])


def _values(flight: dict[Any, Any], keys: Iterable[str]) -> list[str]:
    """Parameters of a flight; a category may be missing."""
    values = (flight[key] for key in keys)
    return [
        figures(value) if isinstance(value, float) else MISSING if pd.isna(value) else str(value)
        for value in values
    ]


def _by_group(title: str, head: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    """A table whose first column names the group."""
    labels = [row[0] for row in rows]
    is_text = head[-1:] in (("reason",), ("ended",), (FLY_AGAIN,))
    return Table(title=title, head=head, rows=rows, labels=labels, last_is_text=is_text)
