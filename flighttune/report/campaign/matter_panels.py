"""Charts of influences: rank correlations, Sobol indices, and success over a parameter."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from flighttune.campaign.flying.columns import unit_of_key
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings, values_of
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.campaign.statistics.sensitivity import Influence
from flighttune.present.chart import Chart
from flighttune.present.names import metric_label
from flighttune.present.palette import LIMIT
from flighttune.report.campaign.panels import (
    DOTS,
    arrays_of,
    dot,
    flight_tips,
    places,
    rows_chart,
    styles_of,
)
from flighttune.report.campaign.tables import groups_of, influential_parameters, metric_name

PARAMETERS = 8
"""Rows of a panel of parameters."""

SCATTERED = 2
"""Parameters over which a measure is drawn."""


def influence_panels(findings: Findings) -> list[Chart]:
    """Rank correlation and share explained, of the measure and of success."""
    charts = []
    for name in (findings.measure, SUCCESS):
        influences = {
            group: findings.influences.get((group, name or ""), ()) for group in groups_of(findings)
        }
        if name and any(influences.values()):
            what = metric_name(name)
            charts += [
                _panel(findings, f"{what}: rank correlation", influences, "rho"),
                _panel(findings, f"{what}: explained by each alone", influences, "share"),
            ]
    return charts


def sobol_panels(findings: Findings) -> list[Chart]:
    """First indices, filled, and total ones, open, of the measure and of success."""
    factors, styles = findings.flights.plan.factors, styles_of(findings)
    charts = []
    for name in (findings.measure, SUCCESS):
        own = {group: sobol for (group, of), sobol in findings.sobol.items() if of == name}
        if not own:
            continue
        what = metric_name(name or "")
        title = f"{what}: Sobol indices, first (filled) and total (open)"
        order = np.argsort(
            -np.max([sobol.total[0] for sobol in own.values()], axis=0), kind="stable"
        )
        names = [factors[i] for i in order]
        chart = rows_chart(title, "share of the variance", names, 2 * len(own))
        chart.upright(0.0)
        below = places(2 * len(own))
        for place, (group, sobol) in enumerate(own.items()):
            for row, i in enumerate(order.tolist()):
                for kind, indices in enumerate((sobol.first, sobol.total)):
                    value, lo, hi = indices[:, i].tolist()
                    at = Estimate(value=value, lo=lo, hi=hi, n=sobol.n)
                    up = row + below[2 * place + kind]
                    dot(chart, up, at, styles[group.label], group.label, filled=kind == 0)
        charts.append(chart)
    return charts


def split_panels(findings: Findings) -> list[Chart]:
    """Success rate over the values of the most influential parameter."""
    styles, charts = styles_of(findings), []
    for parameter in dict.fromkeys(split.parameter for split in findings.splits):
        own = [split for split in findings.splits if split.parameter == parameter]
        chart = Chart(
            title=f"Success over {parameter}",
            x=_axis(parameter),
            y="flights that succeed [%]",
            y_range=(-3.0, 103.0),
        )
        for split in own:
            label = split.group.label
            centres = np.asarray(split.centres, dtype=float)
            rate, lo, hi = arrays_of(split.success, 100.0)
            # each interval a line of its own: NaN between them
            across = np.column_stack([centres, centres, np.full(len(centres), np.nan)]).ravel()
            up = np.column_stack([lo, hi, np.full(len(centres), np.nan)]).ravel()
            chart.line(across, up, styles[label].colour, run=label, width=1.2, hover=False)
            chart.run_line(centres, rate, styles[label], label, width=1.4)
            chart.points(centres, rate, styles[label].colour, run=label)
        if not findings.flights.is_number(parameter):
            chart.x_ticks = list(zip(own[0].centres, own[0].labels, strict=True))
            chart.x_range = (min(own[0].centres) - 0.5, max(own[0].centres) + 0.5)
        charts.append(chart)
    return charts


def scatter_panels(findings: Findings) -> list[Chart]:
    """The metric over the most influential parameters, a dot a flight."""
    if findings.measure is None:
        return []
    how, styles, charts = metric_label(findings.measure), styles_of(findings), []
    for key in influential_parameters(findings)[:SCATTERED]:
        if not findings.flights.is_number(key):
            continue
        chart = Chart(title=f"{how.name} over {key}", x=_axis(key), y=how.heading)
        tops = []
        for group, rows in findings.flights.groups():
            some = rows.iloc[:: len(rows) // DOTS + 1]
            x = some[key].to_numpy(dtype=float)
            y = how.factor * values_of(some, findings.measure)
            colour, tips = styles[group.label].colour, flight_tips(some, findings.flights.url)
            finite = np.isfinite(y)
            some_tips = [tip for tip, flew in zip(tips, finite, strict=True) if flew]
            chart.points(
                x[finite], y[finite], colour, run=group.label, size=2.6, opacity=0.6, tips=some_tips
            )
            lost_tips = [tip for tip, flew in zip(tips, finite, strict=True) if not flew]
            tops.append((x[~finite], lost_tips, group.label))
        # flights that ended early have no value: they stand at the upper edge
        top = chart.y_ends()[1]
        for lost, tips, label in tops:
            chart.points(lost, np.full(len(lost), top), LIMIT, run=label, shape="cross", tips=tips)
        charts.append(chart)
    return charts


def _panel(
    findings: Findings, title: str, influences: dict[Group, tuple[Influence, ...]], kind: str
) -> Chart:
    """A row a parameter, a dot a group; open where it is not significant."""
    strength: dict[str, float] = {}
    for influence in (influence for own in influences.values() for influence in own):
        if kind == "share" or math.isfinite(influence.rho):
            strength[influence.parameter] = max(
                influence.strength, strength.get(influence.parameter, 0.0)
            )
    names = sorted(strength, key=lambda name: -strength[name])[:PARAMETERS]
    influences = {group: own for group, own in influences.items() if own}
    styles = styles_of(findings)
    x = "rank correlation, with interval" if kind == "rho" else "share of the variance of ranks [%]"
    chart = rows_chart(title, x, names, len(influences))
    chart.upright(0.0)
    for (group, own), below in zip(influences.items(), places(len(influences)), strict=True):
        for place, influence in _placed(own, names):
            size = influence.rho if kind == "rho" else 100.0 * max(0.0, influence.share)
            lo, hi = (influence.lo, influence.hi) if kind == "rho" else (0.0, size)
            apart = (
                influence.p_rho if kind == "rho" else influence.p_share
            ) < 1.0 - findings.flights.confidence
            at = Estimate(value=size, lo=lo, hi=hi, n=influence.n)
            dot(chart, place + below, at, styles[group.label], group.label, filled=apart)
    chart.x_range = (-1.04, 1.04) if kind == "rho" else (-2.0, 102.0)
    return chart


def _placed(own: Sequence[Influence], names: Sequence[str]) -> Iterator[tuple[int, Influence]]:
    for influence in own:
        if influence.parameter in names and not math.isnan(influence.share):
            yield names.index(influence.parameter), influence


def _axis(key: str) -> str:
    unit = unit_of_key(key)
    return f"{key} [{unit}]" if unit != "1" else key
