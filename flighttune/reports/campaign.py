"""The report of a campaign as one HTML file that needs nothing else, and its charts."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.dataset import dataset_hash
from flighttune.campaign.flying.columns import unit_of_key
from flighttune.campaign.statistics.findings import SUCCESS, Findings, is_number, values_of
from flighttune.campaign.statistics.intervals import Estimate, scores
from flighttune.files.shipped import scenario_files
from flighttune.files.table import toml_text
from flighttune.planning.plan import Group, draws_in_words
from flighttune.present.answer import MISSING, Table, facts_table, percent
from flighttune.present.chart import DASHED, HEAD_AND_FOOT, HEIGHT, Chart
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.names import key_words, measure_words, metric_label
from flighttune.present.palette import LIMIT, LineStyle, line_styles
from flighttune.reports import campaign_tables as tables
from flighttune.reports.campaign_tables import about, bound_words, influential_parameters
from flighttune.reports.tables import by_plant

# Least height of a row with a name and a share, and how far the share is below it, pixels.
ROW, BELOW = 30.0, 9.0

# Measures whose distributions are drawn.
SPREAD = ("chi.ITAE", "gamma.ITAE", "chi.MO_rad", "gamma.MO_rad")

# Ratio of the largest to the smallest value from which on an axis is logarithmic.
MANY_TIMES = 30.0

# Flights of a group in a chart of dots.
DOTS = 400

# Parameters over which a measure is drawn.
SCATTERED = 2


def styles_of(findings: Findings) -> dict[str, LineStyle]:
    """Line style of every group by its label, as in the report of its scenario."""
    plan = findings.plan
    pairs = [(plant.label, name) for plant in plan.scenario.plant for name in plan.gain_sets]
    return {Group(*pair).label: style for pair, style in line_styles(pairs).items()}


def arrays_of(estimates: Sequence[Estimate], factor: float) -> FloatArray:
    """Values, lower and upper ends of estimates times a factor, shape (3, n)."""
    return factor * np.array([(e.value, e.lo, e.hi) for e in estimates]).T


def rates(findings: Findings) -> list[Chart]:
    """Success rate of every group, and the measure that decides it."""
    groups, styles = findings.values["groups"], styles_of(findings)
    success = {group["group"]: (group["success"], group["lo"], group["hi"]) for group in groups}
    charts = [_shares("Flights that succeed", success, styles)]
    bounds = findings.values["requirements"]
    decides = bounds[0]["measure"] if bounds else findings.measure
    return charts + ([_distribution(findings, decides)] if decides else [])


def distributions(findings: Findings) -> list[Chart]:
    """Cumulative distribution of a metric over all flights, a panel a metric."""
    names = dict.fromkeys([findings.measure, *SPREAD])
    measures = [name for name in names if name and name in findings.measures]
    return [_distribution(findings, name) for name in measures]


def convergence(findings: Findings) -> list[Chart]:
    """Success rate and the 95th percentile of the measure from the first flights on."""
    if findings.measure is None:
        return []
    how = metric_label(findings.measure)
    title = f"95th percentile of {how.name}"
    return [
        _convergence(findings, "Success rate", "flights that succeed [%]", "success", 100.0),
        _convergence(findings, title, how.heading, "p95", how.factor),
    ]


def split_panels(findings: Findings) -> list[Chart]:
    """Success rate over the values of the most influential parameter."""
    styles, charts = styles_of(findings), []
    for parameter in dict.fromkeys(split["parameter"] for split in findings.splits):
        group_splits = [split for split in findings.splits if split["parameter"] == parameter]
        chart = Chart(
            title=f"Success over {key_words(parameter)}",
            x=_axis(parameter),
            y="flights that succeed [%]",
            y_range=(-3.0, 103.0),
        )
        for split in group_splits:
            label, centres = split["group"], np.asarray(split["centres"], dtype=float)
            rate, lo, hi = arrays_of(split["success"], 100.0)
            # each interval a line of its own: NaN between them
            across = np.column_stack([centres, centres, np.full(len(centres), np.nan)]).ravel()
            up = np.column_stack([lo, hi, np.full(len(centres), np.nan)]).ravel()
            chart.line(across, up, styles[label].colour, run=label, width=1.2, hover=False)
            chart.run_line(centres, rate, styles[label], label, width=1.4)
            chart.points(centres, rate, styles[label].colour, run=label)
        if not is_number(findings.rows[parameter]):
            centres = group_splits[0]["centres"]
            chart.x_ticks = list(zip(centres, group_splits[0]["labels"], strict=True))
            chart.x_range = (min(centres) - 0.5, max(centres) + 0.5)
        charts.append(chart)
    return charts


def scatter_panels(findings: Findings) -> list[Chart]:
    """The metric over the most influential parameters, a dot a flight."""
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
        chart = Chart(
            title=f"{measure_words(findings.measure)} over {key_words(key)}",
            x=_axis(key),
            y=how.heading,
            x_room=0.03,
        )
        for group, rows in findings.groups():
            label, some = group.label, rows.iloc[:: len(rows) // DOTS + 1]
            x = some[key].to_numpy(dtype=float)
            y = how.factor * values_of(some, findings.measure)
            # commands that fly each row again, as tips under the pointer
            again = f"flighttune verify {findings.url} --run"
            tips = np.array([f"run {run}: {again} {run}" for run in some["run"]])
            finite = np.isfinite(y)
            dots = {"size": 2.6, "opacity": 0.6, "tips": tips[finite].tolist()}
            chart.points(x[finite], y[finite], styles[label].colour, run=label, **dots)
            # flights that ended early have no value: they stand as high as the worst one
            top, lost = np.full(len(x), highest), {"shape": "cross", "tips": tips[~finite].tolist()}
            chart.points(x[~finite], top[~finite], LIMIT, run=label, **lost)
        charts.append(chart)
    return charts


def _shares(
    title: str, bars: dict[str, tuple[float, float, float]], styles: dict[str, LineStyle]
) -> Chart:
    """A row a group, from the top: its name, and below it the share with its interval."""
    height = max(HEIGHT, HEAD_AND_FOOT + ROW * len(bars))
    row = (height - HEAD_AND_FOOT) / len(bars)
    chart = Chart(
        title=title,
        x="share [%], with interval",
        height=height,
        y_range=(0.0, float(len(bars))),
        y_ticks=(),
        downwards=True,
    )
    for place, (label, shares) in enumerate(bars.items()):
        (value, lo, hi), colour = (100.0 * share for share in shares), styles[label].colour
        y = place + 0.5 + BELOW / row
        text = f"{percent(shares[0])} % [{percent(shares[1])}, {percent(shares[2])}]"
        chart.name_row(place + 0.5, f"{label}: {text}")
        chart.line([lo, hi], [y, y], colour, run=label, hover=False)
        chart.points(value, y, colour, run=label, size=4.0)
    low, high = min(lo for _, lo, _ in bars.values()), max(hi for _, _, hi in bars.values())
    room = 6.0 * max(high - low, 0.01)
    chart.x_range = max(-2.0, 100.0 * low - room), min(102.0, 100.0 * high + 2.5 * room)
    return chart


def _distribution(findings: Findings, measure: str) -> Chart:
    """Curves end below 100 % where flights were not completed or have no value."""
    how, styles = metric_label(measure), styles_of(findings)
    curves = {}
    for group, rows in findings.groups():
        values = np.sort(how.factor * scores(rows, measure))
        share = 100.0 * np.arange(1, len(values) + 1) / len(values)
        finite = np.isfinite(values)
        if finite.any():
            curves[group.label] = values[finite], share[finite]
    chart = Chart(
        title=f"Flights by {measure_words(measure)}",
        x=how.heading,
        y="flights at or below [%]",
        y_range=(0, 102),
    )
    bounds = {}
    for requirement in findings.values["requirements"]:
        if requirement["measure"] == measure:
            subject = f" ({about(requirement)})" if about(requirement) else ""
            bounds[bound_words(requirement) + subject] = how.factor * requirement["bound"]
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


def _convergence(findings: Findings, title: str, y: str, name: str, factor: float) -> Chart:
    styles = styles_of(findings)
    chart = Chart(title=title, x="flights of a group", y=y, log="x")
    for curve in findings.convergence:
        label, n = curve["group"], np.array(curve["n"], dtype=float)
        value, lo, hi = arrays_of(curve[name], factor)
        bounded = np.isfinite(lo) & np.isfinite(hi)
        low, high = (np.where(bounded, side, np.nan) for side in (lo, hi))
        chart.band(n, low, high, styles[label].colour, run=label)
        chart.run_line(n, value, styles[label], label)
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


def _axis(key: str) -> str:
    unit = unit_of_key(key)
    return f"{key_words(key)} [{unit}]" if unit != "1" else key_words(key)


CONFIDENCE = {
    "clopper-pearson": "Clopper and Pearson's interval",
    "wilson": "Wilson's interval",
    "any-time": "an interval that holds at all numbers of independent draws together",
}


def write_campaign_report(findings: Findings, path: str | Path) -> Report:
    """Write one self-contained page about a campaign."""
    campaign = findings.plan.campaign
    styles = styles_of(findings)
    shipped = campaign.scenario.removesuffix(".toml") in scenario_files()
    return write_page(
        Path(path),
        page_template("flighttune.reports", "campaign.html.jinja"),
        summary=summary(findings),
        sections=_sections(findings),
        title=campaign.title,
        claim=campaign.verifies,
        legend=list(styles.items()),
        styles=styles,
        notes=notes(findings),
        provenance=_provenance(findings),
        url=findings.url,
        example_run=int(findings.rows["run"].to_numpy()[0]),
        runs=findings.plan.runs,
        own_scenario="" if shipped else Path(campaign.scenario).name,
        campaign_text=toml_text(findings.plan.as_dict()["campaign"]),
        scenario_text=toml_text(findings.plan.scenario.as_dict()),
        version=findings.versions.get("flighttune", ""),
    )


def summary(findings: Findings) -> tuple[str, ...]:
    """Two sentences: the number of flights that succeed, and the quantities that matter most."""
    groups = findings.values["groups"]
    n = sum(group["n"] for group in groups)
    succeeded = by_plant((group["plant"], group["successes"], group["n"]) for group in groups)
    strongest = Counter(
        key_words(apart[0])
        for group in groups
        for sensitivity in group["sensitivity"].values()
        if (apart := [rank["parameter"] for rank in sensitivity["ranks"] if rank["apart"]])
    )
    names = [name for name, count in strongest.items() if count == max(strongest.values())]
    matters = ", ".join(names) if names else "no parameter significantly"
    return (
        f"Flights that succeed: {succeeded} ({draws_in_words(n, len(groups))}).",
        f"What matters most: {matters}.",
    )


def notes(findings: Findings) -> tuple[str, ...]:
    """Number of flights, what success is, and effect of the design on the intervals."""
    plan = findings.plan
    lines = [*plan.scenario.gains_notes()]
    if len(findings.rows) < plan.runs:
        lines.append(
            f"Not finished: the numbers are those of {len(findings.rows)} of {plan.runs} flights."
        )
    lines.append(tables.success_sentences(findings))
    if plan.cycle > 1:
        lines.append(
            f"Draws of this design come in cycles of {plan.cycle}: intervals are for the effective "
            "number of independent flights."
        )
    elif plan.campaign.design in ("latin_hypercube", "sobol"):
        lines.append(
            "Draws are spread evenly (" + plan.campaign.design.replace("_", " ") + "); intervals "
            "are those of independent draws, which is conservative."
        )
    if any(plan.scenario.plant_table(group.plant).aircraft for group in plan.groups):
        lines.append("How far an aircraft can be off: flighttune band CAMPAIGN.")
    return tuple(lines)


def _sections(findings: Findings) -> list[Section]:
    groups = findings.values["groups"]
    influences = [
        tables.influence_table(groups, name) for name in (findings.measure, SUCCESS) if name
    ]
    return [
        Section(charts=rates(findings)),
        Section(
            id="rates",
            title="How often",
            note=f"Of all flights of a group, with {CONFIDENCE[findings.method]}, of "
            f"{100.0 * findings.confidence:g} % confidence in brackets.",
            tables=[tables.success_table(findings, groups), tables.reasons_table(groups)],
            legend=False,
        ),
        Section(
            id="worst",
            title="Worst flights",
            note="With the most influential parameters. To fly one again: flighttune verify "
            f"{findings.url} --run RUN",
            tables=[tables.worst_table(findings, groups)],
            legend=False,
        ),
        Section(
            id="measures",
            title="Metrics",
            note="Curves count all flights: where some were not completed they end below 100 %. "
            "The table is of completed flights that have a value; --json has the confidence "
            "interval of each percentile.",
            charts=distributions(findings),
            tables=[tables.metrics_table(findings, groups)],
        ),
        Section(
            id="matters",
            title="What matters",
            note="A rank correlation has a direction; the rank variance is the share that a "
            "parameter explains alone, over ten classes of its values, whatever the shape. "
            "Red crosses ended early.",
            charts=[*split_panels(findings), *scatter_panels(findings)],
            tables=influences,
        ),
        Section(
            id="paired",
            title="Gains on the same draws",
            note="Every gain set flies every draw, so that only gains differ. A flight that was "
            "not completed counts as the worst.",
            tables=tables.paired_tables(findings),
            legend=False,
        ),
        Section(
            id="convergence",
            title="Convergence",
            note="Estimates from the first flights of each group, with intervals: enough have "
            "flown where the band is as narrow as the question needs.",
            charts=convergence(findings),
        ),
    ]


def _provenance(findings: Findings) -> Table:
    plan = findings.plan
    versions = ", ".join(f"{name} {value}" for name, value in findings.versions.items())
    seconds = float(np.sum(findings.rows["wall_s"].to_numpy()))
    return facts_table(
        "Provenance",
        {
            "campaign": findings.url,
            "flights": f"{len(findings.rows)} of {plan.runs}, on {plan.draws} draws",
            "design": f"{plan.campaign.design.replace('_', ' ')}, seed {plan.campaign.seed}",
            "plan, SHA-256": plan.sha256,
            "rows, SHA-256": dataset_hash(findings.url) if findings.url else MISSING,
            "flown with": versions or MISSING,
            "time in flights": f"{seconds:.1f} s",
            "source of the campaign": plan.campaign.source or MISSING,
        },
    )
