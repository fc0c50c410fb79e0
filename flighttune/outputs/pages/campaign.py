"""The report of a campaign as one self-contained HTML file, and its tables."""

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from flighttune.base.files.shipped import scenario_files
from flighttune.base.files.table import toml_text
from flighttune.base.names import key_words
from flighttune.base.words import MISSING, figures, listed, percent
from flighttune.campaigns.dataset import dataset_hash
from flighttune.campaigns.statistics.findings import SUCCESS, Findings, answer_words
from flighttune.outputs.answers.answer import Answer, Column, Table, facts_table
from flighttune.outputs.answers.labels import columns, metric_label
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.pages import campaign_charts as charts
from flighttune.outputs.pages.campaign_charts import bound_words, influential_parameters, parameter
from flighttune.outputs.pages.frame import Report, Section, write_page
from flighttune.outputs.pages.panels import TEXTS
from flighttune.vehicles.plants.base import goes_by

# Metrics on the page; the JSON object has all.
METRICS = (
    *(f"{channel}.{metric}" for metric in ("ITAE", "MO_rad") for channel in ("chi", "gamma")),
    *(f"{channel}.{metric}" for metric in ("settling_s", "ST_rad") for channel in ("chi", "gamma")),
    "flight.n_z_max",
    "flight.alpha_max_rad",
)

INFLUENCES = 10


REASON_COLUMNS = columns("group count run ended reason", of="reasons")
INFLUENCE_COLUMNS = columns("group parameter n share rho partial p apart", of="influence")


def write_campaign_report(findings: Findings, path: str | Path) -> Report:
    """Write one self-contained page about a campaign."""
    plan = findings.plan
    campaign, styles = plan.campaign, charts.styles_of(findings)
    shipped = campaign.scenario.removesuffix(".toml") in scenario_files()
    sha256 = dataset_hash(findings.url) if findings.url else MISSING
    tables = _tables(findings)
    page = write_page(
        Path(path),
        page_template("flighttune.outputs.pages", "campaign.html.jinja"),
        summary=summary(findings),
        sections=_sections(findings, tables),
        title=campaign.title,
        claim=campaign.verifies,
        legend=list(styles.items()),
        styles=styles,
        notes=notes(findings),
        provenance=_provenance(findings, sha256),
        url=findings.url,
        example_run=int(findings.rows["run"].to_numpy()[0]),
        runs=plan.runs,
        own_scenario="" if shipped else Path(campaign.scenario).name,
        campaign_text=toml_text(plan.as_dict()["campaign"]),
        scenario_text=toml_text(plan.scenario.as_dict()),
        version=findings.versions.get("flighttune", ""),
    )
    shown = Answer(
        values={**findings.values, "sha256": sha256, **findings.compiled.values},
        tables=[*tables["rates"], *tables["paired"]],
        lines=page.summary,
        notes=notes(findings),
    )
    return replace(page, shown=shown)


def _tables(findings: Findings) -> dict[str, list[Table]]:
    """The tables of each section."""
    return {
        "rates": [success_table(findings), reasons_table(findings)],
        "worst": [worst_table(findings)],
        "measures": [metrics_table(findings)],
        "matters": [influence_table(findings, x) for x in (findings.measure, SUCCESS) if x],
        "paired": paired_tables(findings),
    }


def _sections(findings: Findings, tables: Mapping[str, Sequence[Table]]) -> list[Section]:
    """The sections with their charts and `tables`."""
    drawn = {
        "runs": charts.rates(findings),
        "measures": charts.distributions(findings),
        "matters": [*charts.split_panels(findings), *charts.scatter_panels(findings)],
        "convergence": charts.convergence(findings),
    }
    about = {
        "interval": TEXTS["interval"][findings.method],
        "confidence": 100.0 * findings.confidence,
        "url": findings.url,
    }
    return [
        Section(
            id=key,
            title=texts.get("title", ""),
            note=texts.get("note", "").format(**about),
            charts=drawn.get(key, ()),
            tables=tables.get(key, ()),
        )
        for key, texts in TEXTS["campaign"].items()
    ]


def summary(findings: Findings) -> tuple[str, ...]:
    """The answer about the required share, if any, the number of successes, and main influences."""
    groups = findings.values["groups"]
    succeeded = [f"{group['group']} {group['successes']}/{group['n']}" for group in groups]
    strongest = Counter(
        key_words(apart[0])
        for group in groups
        for sensitivity in group["sensitivity"].values()
        if (apart := [rank["parameter"] for rank in sensitivity["ranks"] if rank["apart"]])
    )
    names = [name for name, count in strongest.items() if count == max(strongest.values())]
    matters = ", ".join(names) if names else "no parameter significantly"
    answered = answer_words(findings.values.get("sure", {}), findings.plan.campaign.until_sure)
    return (
        *filter(None, [answered]),
        f"Flights that succeed: {', '.join(succeeded)}.",
        f"What matters most: {matters}.",
    )


def notes(findings: Findings) -> tuple[str, ...]:
    """Number of flights, definition of success, and effect of the design on the intervals."""
    plan = findings.plan
    lines = [*plan.scenario.gains_notes()]
    answers, flown = findings.values.get("sure", {}), f"{len(findings.rows)} of {plan.runs} flights"
    if answers and all(answers.values()):
        lines.append(f"The campaign ended after {flown} by its own rule, sure of each answer.")
    elif len(findings.rows) < plan.runs:
        lines.append(f"Not finished: the numbers are those of {flown}.")
    if findings.method == "any-time":
        lines.append(
            "The intervals of success rates hold whenever the campaign ends (a mixture of "
            "likelihood ratios); others and p-values presume a number of flights fixed before."
        )
    lines.append(_success_sentences(findings))
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
    return *lines, *findings.compiled.notes


def _success_sentences(findings: Findings) -> str:
    """Definition of success, one sentence for all groups with the same requirements."""
    plan, groups_of = findings.plan, defaultdict[str, list[str]](list)
    for group in plan.groups:
        ends_stated = [table.status for table in plan.scenario.expected(group.plant, group.gains)]
        ends = dict.fromkeys(filter(None, ends_stated)) or ["completed"]
        bounds = [
            bound_words(bound)
            for bound in findings.values["requirements"]
            if goes_by(group.plant, bound["plant"]) and bound["gains"] in (None, group.gains)
        ]
        how = " or ".join(
            TEXTS["ends"].get(end, f"ends with {end.replace('_', ' ')}") for end in ends
        )
        groups_of[how + (f" with {listed(bounds)}" if bounds else "")].append(group.label)
    if len(groups_of) == 1:
        return f"A flight succeeds if it {next(iter(groups_of))}."
    return " ".join(
        f"A flight of {listed(labels, 'or')} succeeds if it {how}."
        for how, labels in groups_of.items()
    )


def _provenance(findings: Findings, sha256: str) -> Table:
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
            "rows, SHA-256": sha256,
            "flown with": versions or MISSING,
            "time in flights": f"{seconds:.1f} s",
            "source of the campaign": plan.campaign.source or MISSING,
        },
    )


def success_table(findings: Findings) -> Table:
    """Success rate of each group, statuses of its flights, and the ranking metric."""
    groups = findings.values["groups"]
    statuses = {x: x.replace("_", " ") for group in groups for x in group["statuses"]}
    layout = [
        *columns("group n successes success", of="success"),
        *(Column(f"statuses.{x}", statuses[x], digits=".0f", missing="0") for x in statuses),
    ]
    if findings.measure is not None:
        label, key = metric_label(findings.measure), f"metrics.{findings.measure}"
        layout += [
            replace(
                label,
                key=f"{key}.{percentile}",
                name=f"{label.name}, {name}",
                digits=figures,
                ends=(f"{key}.{percentile}_interval.0", f"{key}.{percentile}_interval.1"),
            )
            for name, percentile in (("median", "p50"), ("95 %", "p95"))
        ]
    return Table(layout, groups, "Success", label="group")


def reasons_table(findings: Findings) -> Table:
    """Reasons of failed flights; sentences that differ only in numbers are counted together."""
    records = [
        {
            "group": group["group"],
            **reason,
            "ended": reason.get("status", "completed").replace("_", " "),
        }
        for group in findings.values["groups"]
        for reason in (*group["reasons"], *group["missed"])
    ]
    return Table(REASON_COLUMNS, records, "Why flights fail", label="group")


def worst_table(findings: Findings) -> Table:
    """The worst completed flights of each group, with the most influential parameters."""
    groups = findings.values["groups"]
    records = [{"group": group["group"], **flight} for group in groups for flight in group["worst"]]
    layout = [
        *columns("group run draw"),
        *([metric_label(findings.measure)] if findings.measure else []),
        Column("success", "succeeds"),
        *map(parameter, influential_parameters(findings)),
    ]
    return Table(layout, records, "Worst completed flights", label="group")


def metrics_table(findings: Findings) -> Table:
    """Median of each metric of completed flights, with the 5th and 95th percentile."""
    groups, records = findings.values["groups"], []
    for metric in dict.fromkeys([findings.measure or "", *METRICS]):
        spreads = {group["group"]: group["metrics"].get(metric) for group in groups}
        if any(spreads.values()):
            label = metric_label(metric)
            percentiles = {
                name: {p: spread[p] * label.factor for p in ("p05", "p50", "p95")}
                for name, spread in spreads.items()
                if spread is not None
            }
            records.append({"metric": label.heading, **percentiles})
    names = [group["group"] for group in groups]
    layout = [
        Column("metric", "median [5 %, 95 %]"),
        *(Column(f"{x}.p50", x, digits=figures, ends=(f"{x}.p05", f"{x}.p95")) for x in names),
    ]
    return Table(layout, records, "Metrics")


def influence_table(findings: Findings, name: str) -> Table:
    """Influence of each parameter on success or a metric, strongest first."""
    records = [
        {
            "group": group["group"],
            **rank,
            "parameter": key_words(rank["parameter"]),
            "share": max(rank["share"], 0.0),  # a value below 0 explains less than chance
            "p": min(rank["p_rho"], rank["p_share"]),
        }
        for group in findings.values["groups"]
        for rank in group["sensitivity"].get(name, {"ranks": ()})["ranks"][:INFLUENCES]
    ]
    measure = name if name == SUCCESS else metric_label(name).name
    return Table(INFLUENCE_COLUMNS, records, f"Influence on {measure}", label="group")


def paired_tables(findings: Findings) -> list[Table]:
    """Gain sets compared draw by draw: by the measure, and by success."""
    records = [
        {**pair, "pair": f"{pair['a']} against {pair['b']}, {pair['plant']}"}
        for pair in findings.values["paired"]
    ]
    label = metric_label(findings.measure or "chi.ITAE")
    ends = "median_lo", "median_hi"
    by_measure = [
        *columns("pair n", of="paired"),
        Column("win_rate", f"{label.name} lower with first", "%", percent, ends=("lo", "hi")),
        replace(
            label, key="median", name="median of first minus second", digits=figures, ends=ends
        ),
    ]
    by_success = columns("pair n only_a only_b p_success", of="paired")
    return [
        Table(by_measure, records, "Gains on the same draws"),
        Table(by_success, records, "Success on the same draws"),
    ]
