"""The report of a campaign as one HTML file that needs nothing else."""

from collections import Counter
from pathlib import Path

import numpy as np

from flighttune.campaign.dataset import dataset_hash
from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.files.shipped import scenario_files
from flighttune.files.table import toml_text
from flighttune.planning.plan import draws_in_words
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.names import key_words
from flighttune.present.tables import MISSING, Table, facts_table
from flighttune.reports.campaign import panels, tables
from flighttune.reports.tables import by_plant

# Effects of the seed of a flight.
CONFIDENCE = {"clopper-pearson": "Clopper and Pearson's", "wilson": "Wilson's"}


def write_campaign_report(findings: Findings, path: str | Path) -> Report:
    """Write one self-contained page about a campaign."""
    flights, campaign = findings.flights, findings.flights.plan.campaign
    styles = panels.styles_of(findings)
    shipped = campaign.scenario.removesuffix(".toml") in scenario_files()
    return write_page(
        Path(path),
        page_template("flighttune.reports.campaign", "page.html.jinja"),
        summary=summary(findings),
        sections=_sections(findings),
        title=campaign.title,
        claim=campaign.verifies,
        legend=list(styles.items()),
        styles=styles,
        notes=notes(findings),
        provenance=_provenance(findings),
        url=flights.url,
        example_run=int(flights.rows["run"].to_numpy()[0]),
        runs=flights.plan.runs,
        own_scenario="" if shipped else Path(campaign.scenario).name,
        campaign_text=toml_text(flights.plan.as_dict()["campaign"]),
        scenario_text=toml_text(flights.plan.scenario.as_dict()),
        version=flights.versions.get("flighttune", ""),
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
    flights, plan = findings.flights, findings.flights.plan
    lines = [*plan.scenario.gains_notes()]
    if len(flights.rows) < plan.runs:
        lines.append(
            f"Not finished: the numbers are those of {len(flights.rows)} of {plan.runs} flights."
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
    flights = findings.flights
    influences = [
        tables.influence_table(groups, name) for name in (findings.measure, SUCCESS) if name
    ]
    return [
        Section(charts=panels.rates(findings)),
        Section(
            id="rates",
            title="How often",
            note=f"Of all flights of a group, with {CONFIDENCE[flights.method]} interval of "
            f"{100.0 * flights.confidence:g} % confidence in brackets.",
            tables=[
                tables.success_table(findings, groups),
                tables.reasons_table(groups),
            ],
            legend=False,
        ),
        Section(
            id="worst",
            title="Worst flights",
            note="With the most influential parameters. To fly one again: flighttune refly "
            f"{flights.url} --run RUN",
            tables=[tables.worst_table(findings, groups)],
            legend=False,
        ),
        Section(
            id="measures",
            title="Metrics",
            note="Curves count all flights: where some were not completed they end below 100 %. "
            "The table is of completed flights that have a value; --json has the confidence "
            "interval of each percentile.",
            charts=panels.distributions(findings),
            tables=[tables.metrics_table(findings, groups)],
        ),
        Section(
            id="matters",
            title="What matters",
            note="A rank correlation has a direction; the rank variance is the share that a "
            "parameter explains alone, over ten classes of its values, whatever the shape. "
            "Red crosses ended early.",
            charts=[*panels.split_panels(findings), *panels.scatter_panels(findings)],
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
            charts=panels.convergence(findings),
        ),
    ]


def _provenance(findings: Findings) -> Table:
    flights, plan = findings.flights, findings.flights.plan
    versions = ", ".join(f"{name} {value}" for name, value in flights.versions.items())
    seconds = float(np.sum(flights.rows["wall_s"].to_numpy()))
    return facts_table(
        "Provenance",
        {
            "campaign": flights.url,
            "flights": f"{len(flights.rows)} of {plan.runs}, on {plan.draws} draws",
            "design": f"{plan.campaign.design.replace('_', ' ')}, seed {plan.campaign.seed}",
            "plan, SHA-256": plan.sha256,
            "rows, SHA-256": dataset_hash(flights.url) if flights.url else MISSING,
            "flown with": versions or MISSING,
            "time in flights": f"{seconds:.1f} s",
            "source of the campaign": plan.campaign.source or MISSING,
        },
    )
