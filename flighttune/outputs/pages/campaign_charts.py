"""Charts of the findings of a campaign."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.names import key_words
from flighttune.base.words import figures, percent
from flighttune.campaigns.flying.columns import unit_of_key
from flighttune.campaigns.planning.plan import Group
from flighttune.campaigns.statistics.findings import Findings, is_number, strength, values_of
from flighttune.campaigns.statistics.intervals import Estimate, scores
from flighttune.outputs.answers.answer import Column
from flighttune.outputs.answers.labels import measure_words, metric_label
from flighttune.outputs.drawing.chart import DASHED, HEAD_AND_FOOT, HEIGHT, Chart
from flighttune.outputs.drawing.palette import LIMIT, LineStyle, line_styles

# Minimum height of a row with a name and a share, and offset of the share, pixels.
ROW, BELOW = 30.0, 9.0

# Measures with a chart of their distribution.
SPREAD = ("chi.ITAE", "gamma.ITAE", "chi.MO_rad", "gamma.MO_rad")

# Ratio of the largest to the smallest value from which an axis is logarithmic.
MANY_TIMES = 30.0

# Maximum number of flights of a group in a scatter chart.
DOTS = 400

# Numbers of most influential parameters that are listed with a flight, and that have a scatter
# chart.
PARAMETERS, SCATTERED = 5, 2


def styles_of(findings: Findings) -> dict[str, LineStyle]:
    """Line style of every group by its label, as in the report of its scenario."""
    plan = findings.plan
    pairs = [(plant.label, name) for plant in plan.scenario.plant for name in plan.gain_sets]
    return {Group(*pair).label: style for pair, style in line_styles(pairs).items()}


def influential_parameters(findings: Findings) -> list[str]:
    """The most influential parameters of any group, strongest first."""
    strongest: dict[str, float] = {}
    for group in findings.values["groups"]:
        for sensitivity in group["sensitivity"].values():
            for rank in sensitivity["ranks"]:
                key = rank["parameter"]
                strongest[key] = max(strength(rank), strongest.get(key, 0.0))
    return sorted(findings.plan.keys, key=lambda key: -strongest.get(key, 0.0))[:PARAMETERS]


def parameter(key: str) -> Column:
    """Column of a dispersed parameter."""
    unit = unit_of_key(key)
    return Column(f"parameters.{key}", key_words(key), "" if unit == "1" else unit, figures)


def bound_words(bound: Mapping[str, Any]) -> str:
    """A requirement in words, such as ``overshoot of course at most 12 deg``."""
    label = metric_label(bound["measure"])
    unit = "" if label.unit in ("", "1") else f" {label.unit}"
    sense = bound["sense"].replace("_", " ")
    return f"{measure_words(bound['measure'])} {sense} {label.factor * bound['bound']:.4g}{unit}"


def rates(findings: Findings) -> list[Chart]:
    """Success rate of every group, and the measure that decides success."""
    bounds = [bound["measure"] for bound in findings.values["requirements"]]
    decides = next((name for name in bounds if name in findings.measures), findings.measure)
    return [_shares(findings), *([_distribution(findings, decides)] if decides else [])]


def _shares(findings: Findings) -> Chart:
    """A row for each group, from the top: its name, and below it the share with its interval."""
    groups, styles = findings.values["groups"], styles_of(findings)
    height = max(HEIGHT, HEAD_AND_FOOT + ROW * len(groups))
    row = (height - HEAD_AND_FOOT) / len(groups)
    chart = Chart(
        title="Flights that succeed",
        x="share [%], with interval",
        height=height,
        y_range=(0.0, float(len(groups))),
        y_ticks=(),
        downwards=True,
    )
    shares = [[group[key] for key in ("success", "lo", "hi")] for group in groups]
    for place, (group, ends) in enumerate(zip(groups, shares, strict=True)):
        label, colour = group["group"], styles[group["group"]].colour
        share, lo, hi = map(percent, ends)
        chart.name_row(place + 0.5, f"{label}: {share} % [{lo}, {hi}]")
        value, *interval = (100.0 * end for end in ends)
        y = place + 0.5 + BELOW / row
        chart.line(interval, [y, y], colour, run=label, hover=False)
        chart.points(value, y, colour, run=label, size=4.0)
    low, high = min(lo for _, lo, _ in shares), max(hi for _, _, hi in shares)
    room = 6.0 * max(high - low, 0.01)
    chart.x_range = max(-2.0, 100.0 * low - room), min(102.0, 100.0 * high + 2.5 * room)
    return chart


def distributions(findings: Findings) -> list[Chart]:
    """Cumulative distribution of metrics over all flights, with a panel for each metric."""
    names = dict.fromkeys([findings.measure, *SPREAD])
    measures = [name for name in names if name and name in findings.measures]
    return [_distribution(findings, name) for name in measures]


def _distribution(findings: Findings, measure: str) -> Chart:
    """A curve ends below 100 % if flights were not completed or have no value."""
    how, styles = metric_label(measure), styles_of(findings)
    curves, bounds = {}, {}
    for group, rows in findings.groups():
        values = np.sort(how.factor * scores(rows, measure))
        share = 100.0 * np.arange(1, len(values) + 1) / len(values)
        finite = np.isfinite(values)
        if finite.any():
            curves[group.label] = values[finite], share[finite]
    for requirement in findings.values["requirements"]:
        if requirement["measure"] == measure:
            about = " / ".join(filter(None, (requirement["plant"], requirement["gains"])))
            words = bound_words(requirement) + (f" ({about})" if about else "")
            bounds[words] = how.factor * requirement["bound"]
    chart = Chart(
        title=f"Flights by {measure_words(measure)}",
        x=how.heading,
        y="flights at or below [%]",
        y_range=(0, 102),
    )
    for words, bound in bounds.items():
        chart.legend.append((words, LIMIT, DASHED))
        chart.upright(bound, LIMIT, dash=DASHED)
    if curves or bounds:
        sorted_values = [values for values, _ in curves.values()]
        chart.x_range, chart.log = _scale(sorted_values, list(bounds.values()))
    for label, (values, share) in curves.items():
        # a step at every value, from the share of the value before
        x, y = np.repeat(values, 2), np.repeat(np.append(0.0, share), 2)[1:-1]
        chart.run_line(x, y, styles[label], label)
    return chart


def _scale(
    values: Sequence[FloatArray], bounds: Sequence[float]
) -> tuple[tuple[float, float], str]:
    """Ends around all bounds and all values but the outer 0.5 %, and the logarithmic axes."""
    inner = np.quantile(np.concatenate(values), [0.005, 0.995]).tolist() if values else []
    low, high = min([*inner, *bounds]), max([*inner, *bounds])
    if low > 0.0 and high / low > MANY_TIMES:
        return (low / 1.1, high * 1.1), "x"
    room = 0.04 * (high - low) or 0.1 * abs(high) or 1.0
    return (low - room, high + room), ""


def convergence(findings: Findings) -> list[Chart]:
    """Success rate and the 95th percentile of the measure from the first flights on."""
    if findings.measure is None:
        return []
    how, styles, charts = metric_label(findings.measure), styles_of(findings), []
    for name, title, y, factor in (
        ("success", "Success rate", "flights that succeed [%]", 100.0),
        ("p95", f"95th percentile of {how.name}", how.heading, how.factor),
    ):
        chart = Chart(title=title, x="flights of a group", y=y, log="x")
        for curve in findings.convergence:
            label, n = curve["group"], np.array(curve["n"], dtype=float)
            value, lo, hi = _arrays(curve[name], factor)
            bounded = np.isfinite(lo) & np.isfinite(hi)
            low, high = (np.where(bounded, side, np.nan) for side in (lo, hi))
            chart.band(n, low, high, styles[label].colour, run=label)
            chart.run_line(n, value, styles[label], label)
        charts.append(chart)
    return charts


def _arrays(estimates: Sequence[Estimate], factor: float) -> FloatArray:
    """Values, lower and upper ends of estimates times a factor, shape (3, n)."""
    return factor * np.array([(e.value, e.lo, e.hi) for e in estimates]).T


def split_panels(findings: Findings) -> list[Chart]:
    """Success rate over the values of the most influential parameter."""
    styles = styles_of(findings)
    charts: dict[str, Chart] = {}
    for split in findings.splits:
        key, label = split["parameter"], split["group"]
        centres = np.asarray(split["centres"], dtype=float)
        if key not in charts:
            charts[key] = Chart(
                title=f"Success over {key_words(key)}",
                x=parameter(key).heading,
                y="flights that succeed [%]",
                y_range=(-3.0, 103.0),
            )
            if not is_number(findings.rows[key]):
                charts[key].x_ticks = list(zip(split["centres"], split["labels"], strict=True))
                charts[key].x_range = (centres.min() - 0.5, centres.max() + 0.5)
        rate, lo, hi = _arrays(split["success"], 100.0)
        # NaN separates the lines of the intervals
        across = np.column_stack([centres, centres, np.full(len(centres), np.nan)]).ravel()
        up = np.column_stack([lo, hi, np.full(len(centres), np.nan)]).ravel()
        charts[key].line(across, up, styles[label].colour, run=label, width=1.2, hover=False)
        charts[key].run_line(centres, rate, styles[label], label, width=1.4)
        charts[key].points(centres, rate, styles[label].colour, run=label)
    return [*charts.values()]


def scatter_panels(findings: Findings) -> list[Chart]:
    """The metric over the most influential parameters, with a dot for each flight."""
    if findings.measure is None:
        return []
    how, styles, charts = metric_label(findings.measure), styles_of(findings), []
    values = how.factor * values_of(findings.rows, findings.measure)
    highest = np.max(values[np.isfinite(values)], initial=-np.inf)
    if np.isinf(highest):
        return []
    for key in influential_parameters(findings)[:SCATTERED]:
        if not is_number(findings.rows[key]):
            continue
        title = f"{measure_words(findings.measure)} over {key_words(key)}"
        chart = Chart(title=title, x=parameter(key).heading, y=how.heading, x_room=0.03)
        for group, rows in findings.groups():
            label, some = group.label, rows.iloc[:: len(rows) // DOTS + 1]
            across = some[key].to_numpy(dtype=float)
            up = how.factor * values_of(some, findings.measure)
            # commands that repeat each row, shown under the pointer
            again = f"flighttune verify {findings.url} --run"
            tips = np.array([f"run {run}: {again} {run}" for run in some["run"]])
            finite = np.isfinite(up)
            dots = {"size": 2.6, "opacity": 0.6, "tips": tips[finite].tolist()}
            chart.points(across[finite], up[finite], styles[label].colour, run=label, **dots)
            # flights that ended early have no value and are drawn at the worst value
            lost = {"shape": "cross", "tips": tips[~finite].tolist()}
            top = np.full(np.count_nonzero(~finite), highest)
            chart.points(across[~finite], top, LIMIT, run=label, **lost)
        charts.append(chart)
    return charts
