"""Panels of influences: rank correlations, Sobol indices, and success over a parameter."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from flighttune.campaign.flying.columns import unit_of_key
from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings, values_of
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.campaign.statistics.sensitivity import Influence
from flighttune.present.figures import NEUTRAL, on_white, panel
from flighttune.present.frame import Picture, pictured
from flighttune.present.names import metric_label
from flighttune.present.palette import LIMIT
from flighttune.report.campaign.panels import DOTS, arrays_of, dot, places, rows_panel
from flighttune.report.campaign.tables import groups_of, influential_parameters
from flighttune.report.campaign.words import metric_name, styles_of

PARAMETERS = 8
"""Rows of a panel of parameters."""

TICKS = 6
SCATTERED = 2
"""Parameters over which a measure is drawn."""


def influence_panels(found: Findings) -> list[Picture]:
    """Rank correlation and share explained, of the measure and of success."""
    pictures = []
    for name in (found.measure, SUCCESS):
        influences = {
            group: found.influences.get((group, name or ""), ()) for group in groups_of(found)
        }
        if name and any(influences.values()):
            what = metric_name(name)
            pictures += [
                _panel(found, f"{what}: rank correlation", influences, "rho"),
                _panel(found, f"{what}: explained by each alone", influences, "share"),
            ]
    return pictures


def sobol_panels(found: Findings) -> list[Picture]:
    """First indices, filled, and total ones, open, of the measure and of success."""
    factors, styles = found.flights.plan.factors, styles_of(found)
    pictures = []
    for name in (found.measure, SUCCESS):
        own = {group: one for (group, of), one in found.sobol.items() if of == name}
        if not own:
            continue
        what = metric_name(name or "")
        title = f"{what}: Sobol indices, first (filled) and total (open)"
        order = np.argsort(-np.max([one.total[0] for one in own.values()], axis=0), kind="stable")
        names = [factors[i] for i in order]
        with rows_panel(title, "share of the variance", names, 2 * len(own)) as axes:
            below = places(2 * len(own))
            for place, (group, one) in enumerate(own.items()):
                style = styles[group.label]
                for row, i in enumerate(order.tolist()):
                    for kind, indices in enumerate((one.first, one.total)):
                        value, lo, hi = indices[:, i].tolist()
                        at = Estimate(value=value, lo=lo, hi=hi, n=one.n)
                        dot(axes, row + below[2 * place + kind], at, style, filled=kind == 0)
            axes.axvline(0.0, color=NEUTRAL, lw=1.0)
            pictures.append(pictured(axes, title))
    return pictures


def split_panels(found: Findings) -> list[Picture]:
    """Success rate over the values of the most influential parameter."""
    styles, pictures = styles_of(found), []
    for parameter in dict.fromkeys(one.parameter for one in found.splits):
        own = [one for one in found.splits if one.parameter == parameter]
        title = f"Success over {parameter}"
        with panel(title, "flights that succeed [%]", _axis(parameter), height=3.0) as axes:
            for one in own:
                colour = on_white(styles[one.group.label].colour)
                rate, lo, hi = arrays_of(one.success, 100.0)
                around = np.clip([rate - lo, hi - rate], 0.0, None)
                axes.errorbar(one.centres, rate, yerr=around, fmt="o-", ms=5, color=colour, lw=1.3)
            if not found.flights.is_number(parameter):
                axes.set_xticks(own[0].centres, own[0].labels)
            else:
                axes.locator_params(axis="x", nbins=TICKS)
            axes.set_ylim(-3.0, 103.0)
            pictures.append(pictured(axes, title))
    return pictures


def scatter_panels(found: Findings) -> list[Picture]:
    """The metric over the most influential parameters, a dot a flight."""
    if found.measure is None:
        return []
    how, styles, pictures = metric_label(found.measure), styles_of(found), []
    for key in influential_parameters(found)[:SCATTERED]:
        if not found.flights.is_number(key):
            continue
        title = f"{how.name} over {key}"
        with panel(title, how.heading, _axis(key), height=3.0) as axes:
            for group, rows in found.flights.groups():
                some = rows.iloc[:: len(rows) // DOTS + 1]
                x = some[key].to_numpy(dtype=float)
                y = how.factor * values_of(some, found.measure)
                colour = on_white(styles[group.label].colour)
                axes.plot(x, y, "o", ms=3.2, alpha=0.55, mew=0.0, color=colour)
                lost = x[np.isnan(y)]
                at_top, height = axes.get_xaxis_transform(), np.full(len(lost), 0.985)
                axes.plot(lost, height, "x", ms=5, color=colour, mec=LIMIT, transform=at_top)
            axes.locator_params(axis="x", nbins=TICKS)
            pictures.append(pictured(axes, f"{title}; red crosses ended early"))
    return pictures


def _panel(
    found: Findings, title: str, influences: dict[Group, tuple[Influence, ...]], kind: str
) -> Picture:
    """A row a parameter, a dot a group; open where it is not significant."""
    strength: dict[str, float] = {}
    for one in (one for own in influences.values() for one in own):
        if kind == "share" or math.isfinite(one.rho):
            strength[one.parameter] = max(one.strength, strength.get(one.parameter, 0.0))
    names = sorted(strength, key=lambda name: -strength[name])[:PARAMETERS]
    influences = {group: own for group, own in influences.items() if own}
    styles = styles_of(found)
    x = "rank correlation, with interval" if kind == "rho" else "share of the variance of ranks [%]"
    with rows_panel(title, x, names, len(influences)) as axes:
        for (group, own), below in zip(influences.items(), places(len(influences)), strict=True):
            for place, one in _placed(own, names):
                size = one.rho if kind == "rho" else 100.0 * max(0.0, one.share)
                lo, hi = (one.lo, one.hi) if kind == "rho" else (0.0, size)
                apart = (one.p_rho if kind == "rho" else one.p_share) < 1.0 - found.confidence
                at = Estimate(value=size, lo=lo, hi=hi, n=one.n)
                dot(axes, place + below, at, styles[group.label], filled=apart)
        axes.axvline(0.0, color=NEUTRAL, lw=1.0)
        axes.set_xlim(*((-1.04, 1.04) if kind == "rho" else (-2.0, 102.0)))
        return pictured(axes, f"{title}; open: not significant")


def _placed(own: Sequence[Influence], names: Sequence[str]) -> Iterator[tuple[int, Influence]]:
    for one in own:
        if one.parameter in names and not math.isnan(one.share):
            yield names.index(one.parameter), one


def _axis(key: str) -> str:
    unit = unit_of_key(key)
    return f"{key} [{unit}]" if unit != "1" else key
