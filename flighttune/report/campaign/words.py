"""How groups, estimates and demands are written for a reader."""

from flighttune.campaign.planning.plan import Group
from flighttune.campaign.statistics.findings import SUCCESS, Findings
from flighttune.campaign.statistics.intervals import Estimate
from flighttune.present.names import metric_label
from flighttune.present.numbers import interval, percent
from flighttune.present.palette import LineStyle, line_styles
from flighttune.scenario.tables import ExpectTable


def styles_of(found: Findings) -> dict[str, LineStyle]:
    """Line style of every group by its label, as in the report of its scenario."""
    plan = found.flights.plan
    pairs = [(plant.label, name) for plant in plan.scenario.plant for name in plan.gain_sets]
    styles = line_styles(pairs)
    return {Group(*pair).label: style for pair, style in styles.items()}


def percent_with_interval(one: Estimate) -> str:
    """``97.3 % (96.1 to 98.1 %)``."""
    return f"{percent(one.value)} % ({percent(one.lo)} to {percent(one.hi)} %)"


def with_interval(one: Estimate, factor: float = 1.0) -> str:
    """``4.63 [4.25, 4.89]``, multiplied by a factor; an unbounded side is infinite."""
    one = one.scaled(factor)
    return interval(one.value, one.lo, one.hi)


def metric_name(metric: str) -> str:
    """Name of a metric by its column, or the word success itself."""
    return metric if metric == SUCCESS else metric_label(metric).name


def status_words(status: str) -> str:
    """A status as it is read."""
    return status.replace("_", " ")


def probability(p: float) -> str:
    """``p = 0.013``, or that it is below what matters."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


def demands(tables: list[ExpectTable]) -> str:
    """What a flight must do to succeed, in a sentence."""
    if not tables:
        return "A flight succeeds if it is completed."
    clauses = []
    for table in tables:
        of = ", ".join(str(one) for one in (table.plant, table.gains) if one)
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
