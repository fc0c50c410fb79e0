"""The answer of the frontier of a scenario."""

from flighttune.flight.gains import Frontier
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.tuning import frontier_chart
from flighttune.outputs.drawing.chart import Sheet
from flighttune.outputs.drawing.palette import line_styles


def answer(frontier: Frontier) -> Answer:
    """The points of the frontier, and the gain sets by name."""
    shown = columns("name I_K E_K R_K spectral_abscissa")
    rows = frontier.table[[column.key for column in shown]].to_dict(orient="records")
    return Answer(
        values={
            "points": [row for row in rows if row["name"] == "frontier"],
            "marked": {row["name"]: row for row in rows if row["name"] != "frontier"},
        },
        tables=[Table(shown, rows, frontier.scenario.title)],
        notes=[*frontier.scenario.assumptions],
    )


def sheet(frontier: Frontier) -> Sheet:
    """R_K against I_K, and the same gains against E_K."""
    styles = line_styles([("", name) for name in frontier.scenario.gain_names])
    by_name = {name: style for (_, name), style in styles.items()}
    charts = [frontier_chart(frontier.table, by_name, against=key) for key in ("I_K", "E_K")]
    return Sheet(charts=charts, columns=1)
