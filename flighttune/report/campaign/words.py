"""Names of groups, metrics and requirements for a reader."""

from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.present.names import metric_label
from flighttune.present.palette import LineStyle, line_styles
from flighttune.scenario.tables import ExpectTable


def styles_of(findings: Findings) -> dict[str, LineStyle]:
    """Line style of every group by its label, as in the report of its scenario."""
    plan = findings.flights.plan
    pairs = [(plant.label, name) for plant in plan.scenario.plant for name in plan.gain_sets]
    styles = line_styles(pairs)
    return {Group(*pair).label: style for pair, style in styles.items()}


def metric_name(metric: str) -> str:
    """Name of a metric by its column, or the word success itself."""
    return metric if metric == SUCCESS else metric_label(metric).name


def status_words(status: str) -> str:
    """A status as it is read."""
    return status.replace("_", " ")


def probability(p: float) -> str:
    """A p-value as text; a very small one as an upper bound."""
    return f"{p:.2g}" if p >= 1e-4 else "< 0.0001"


def demands(tables: list[ExpectTable]) -> str:
    """Requirements for a successful flight, in a sentence."""
    if not tables:
        return "A flight succeeds if it is completed."
    clauses = []
    for table in tables:
        of = ", ".join(str(name) for name in (table.plant, table.gains) if name)
        wanted = [f"ends as {table.status}"] if table.status else []
        for word, bounds in (("at most", table.at_most), ("at least", table.at_least)):
            wanted += [
                f"{subject}.{name} {word} {value:g}"
                for subject, limits in bounds.items()
                for name, value in limits.items()
            ]
        clauses.append((f"{of}: " if of else "") + ", ".join(wanted))
    demanded = "; ".join(clauses)
    return f"A flight succeeds if it is completed (unless stated otherwise) with {demanded}."
