"""Tables of the findings of a campaign."""

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from flighttune.campaign.flying.columns import unit_of_key
from flighttune.campaign.statistics.findings import SUCCESS, Findings, strength
from flighttune.plants.base import goes_by
from flighttune.present.answer import Column, Table, figures, percent
from flighttune.present.names import columns, key_words, listed, measure_words, metric_label


def status_words(status: str) -> str:
    """A status as it is read."""
    return status.replace("_", " ")


# Verb of each status that a flight can have.
ENDS = {
    "completed": "is completed",
    "diverged": "diverges",
    "ground_contact": "meets the ground",
    "left_envelope": "leaves the envelope",
}


def probability(p: float) -> str:
    """A p-value as text; a very small one as an upper bound."""
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"


# Metrics of the page; the JSON object has all.
METRICS = (
    *(f"{channel}.{metric}" for metric in ("ITAE", "MO_rad") for channel in ("chi", "gamma")),
    *(f"{channel}.{metric}" for metric in ("settling_s", "ST_rad") for channel in ("chi", "gamma")),
    "flight.n_z_max",
    "flight.alpha_max_rad",
)

# Parameters listed with a flight: the most influential ones.
PARAMETERS = 5

INFLUENCES = 10

REASON_COLUMNS = [
    *columns("group"),
    Column("count", "flights"),
    Column("run", "first run"),
    *columns("ended reason"),
]
INFLUENCE_COLUMNS = [
    *columns("group parameter n"),
    # below 0 the parameter explains less than chance would
    Column("share", "rank variance", "%", lambda share: f"{max(0.0, share):.1f}", 100.0),
    Column("rho", "rank correlation", digits="+.2f", ends=("lo", "hi")),
    Column("partial", "partial", digits="+.2f"),
    Column("p", "p-value of variance or correlation", digits=probability),
    Column("apart", "significant"),
]


def success_table(findings: Findings, groups: Sequence[Mapping[str, Any]]) -> Table:
    """Success rate of each group, ends of its flights, and the metric that ranks them."""
    statuses = dict.fromkeys(status for group in groups for status in group["statuses"])
    layout = [
        *columns("group n successes"),
        Column("success", "rate", "%", percent, ends=("lo", "hi")),
        *(Column(f"statuses.{s}", status_words(s), digits=".0f", missing="0") for s in statuses),
    ]
    if findings.measure is not None:
        label, key = metric_label(findings.measure), f"metrics.{findings.measure}"
        for name, percentile in (("median", "p50"), ("95 %", "p95")):
            ends = (f"{key}.{percentile}_interval.0", f"{key}.{percentile}_interval.1")
            heading = f"{label.name}, {name}"
            layout.append(
                Column(f"{key}.{percentile}", heading, label.unit, figures, label.factor, ends=ends)
            )
    return _by_group("Success", layout, groups)


def bound_words(bound: Mapping[str, Any]) -> str:
    """A requirement as it is read, such as ``overshoot of course at most 12 deg``."""
    label = metric_label(bound["measure"])
    unit = "" if label.unit in ("", "1") else f" {label.unit}"
    sense = bound["sense"].replace("_", " ")
    return f"{measure_words(bound['measure'])} {sense} {label.factor * bound['bound']:.4g}{unit}"


def success_sentences(findings: Findings) -> str:
    """What makes a flight succeed: a sentence for each set of groups with the same requirements."""
    plan, groups_of = findings.plan, defaultdict[str, list[str]](list)
    for group in plan.groups:
        ends_stated = [table.status for table in plan.scenario.expected(group.plant, group.gains)]
        ends = dict.fromkeys(filter(None, ends_stated)) or ["completed"]
        bounds = [
            bound_words(bound)
            for bound in findings.values["requirements"]
            if goes_by(group.plant, bound["plant"]) and bound["gains"] in (None, group.gains)
        ]
        how = " or ".join(ENDS.get(end, f"ends with {status_words(end)}") for end in ends)
        groups_of[how + (f" with {listed(bounds)}" if bounds else "")].append(group.label)
    if len(groups_of) == 1:
        return f"A flight succeeds if it {next(iter(groups_of))}."
    return " ".join(
        f"A flight of {listed(labels, 'or')} succeeds if it {how}."
        for how, labels in groups_of.items()
    )


def about(table: Mapping[str, Any]) -> str:
    """The plant and gains that a requirement is about; empty for all."""
    return " / ".join(filter(None, (table["plant"], table["gains"])))


def reasons_table(groups: Sequence[Mapping[str, Any]]) -> Table:
    """Why flights failed; sentences that differ only in numbers are counted as one."""
    records = [
        {
            "group": group["group"],
            "ended": status_words(reason.get("status", "completed")),
            **reason,
        }
        for group in groups
        for reason in (*group["reasons"], *group["missed"])
    ]
    return _by_group("Why flights fail", REASON_COLUMNS, records)


def worst_table(findings: Findings, groups: Sequence[Mapping[str, Any]]) -> Table:
    """The worst completed flights of each group, with the most influential parameters."""
    records = [{"group": group["group"], **flight} for group in groups for flight in group["worst"]]
    layout = [
        *columns("group run draw"),
        *([metric_label(findings.measure)] if findings.measure else []),
        Column("success", "succeeds"),
        *_parameter_columns(influential_parameters(findings)),
    ]
    return _by_group("Worst completed flights", layout, records)


def metrics_table(findings: Findings, groups: Sequence[Mapping[str, Any]]) -> Table:
    """Median of each metric of completed flights, with the 5th and 95th percentile."""
    records = []
    for metric in dict.fromkeys([findings.measure or "", *METRICS]):
        if not any(metric in group["metrics"] for group in groups):
            continue
        label = metric_label(metric)
        record: dict[str, Any] = {"metric": label.heading}
        for group in groups:
            if (spread := group["metrics"].get(metric)) is not None:
                percentiles = {name: spread[name] * label.factor for name in ("p05", "p50", "p95")}
                record[group["group"]] = percentiles
        records.append(record)
    layout = [
        Column("metric", "median [5 %, 95 %]"),
        *(
            Column(f"{name}.p50", name, digits=figures, ends=(f"{name}.p05", f"{name}.p95"))
            for name in (group["group"] for group in groups)
        ),
    ]
    return Table(title="Metrics", columns=layout, records=records)


def influence_table(groups: Sequence[Mapping[str, Any]], name: str) -> Table:
    """Influence of each parameter on success or on a metric, the strongest first."""
    records = [
        {
            "group": group["group"],
            **rank,
            "parameter": key_words(rank["parameter"]),
            "p": min(rank["p_rho"], rank["p_share"]),
        }
        for group in groups
        for rank in group["sensitivity"].get(name, {"ranks": ()})["ranks"][:INFLUENCES]
    ]
    measure = name if name == SUCCESS else metric_label(name).name
    return _by_group(f"Influence on {measure}", INFLUENCE_COLUMNS, records)


def paired_tables(findings: Findings) -> list[Table]:
    """Gain sets compared draw by draw: by the measure, and by success."""
    records = [
        {**pair, "pair": f"{pair['a']} against {pair['b']}, {pair['plant']}"}
        for pair in findings.values["paired"]
    ]
    label = metric_label(findings.measure or "chi.ITAE")
    first = [Column("pair", "first against second"), Column("n", "draws")]
    by_measure = [
        Column("win_rate", f"{label.name} lower with first", "%", percent, ends=("lo", "hi")),
        Column(
            "median",
            "median of first minus second",
            label.unit,
            figures,
            label.factor,
            ends=("median_lo", "median_hi"),
        ),
    ]
    by_success = [
        Column("only_a", "only first succeeds"),
        Column("only_b", "only second succeeds"),
        Column("p_success", "p-value of the two counts", digits=probability),
    ]
    return [
        Table([*first, *by_measure], records, "Gains on the same draws"),
        Table([*first, *by_success], records, "Success on the same draws"),
    ]


def influential_parameters(findings: Findings) -> list[str]:
    """The most influential parameters of any group, the strongest first."""
    strongest: dict[str, float] = {}
    for group in findings.values["groups"]:
        for sensitivity in group["sensitivity"].values():
            for rank in sensitivity["ranks"]:
                key = rank["parameter"]
                strongest[key] = max(strength(rank), strongest.get(key, 0.0))
    ordered = sorted(findings.plan.keys, key=lambda key: -strongest.get(key, 0.0))
    return ordered[:PARAMETERS]


def _parameter_columns(keys: Sequence[str]) -> Iterator[Column]:
    for key in keys:
        unit = unit_of_key(key)
        yield Column(
            f"parameters.{key}", key_words(key), "" if unit == "1" else unit, digits=figures
        )


def _by_group(title: str, layout: Sequence[Column], records: Sequence[Mapping[str, Any]]) -> Table:
    return Table(title=title, columns=layout, records=records, label="group")
