"""The page of a tube: the bounds proven for both errors, and which flights they are about."""

from pathlib import Path

from flighttune.files.table import toml_text
from flighttune.present.chart import Chart
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.palette import HUES, NEUTRAL
from flighttune.present.tables import facts_table
from flighttune.reports.panels import ERRORS
from flighttune.tubes.enclosure import Tube
from flighttune.units import DEG_PER_RAD

(STRONG, _), _ = HUES[0]


def write_tube_page(tube: Tube, source: str, path: str | Path) -> Report:
    """Write one self-contained page about the tube in the file `source`."""
    answer, problem = tube.answer(), tube.problem
    facts = {
        "tube": source,
        "law": problem.law.name,
        "settings": f"{tube.settings.symbols} symbols, {tube.settings.most} pieces at most",
    }
    return write_page(
        Path(path),
        page_template("flighttune.reports", "commands.html.jinja"),
        summary=(f"{tube.sentence[:1].upper()}{tube.sentence[1:]}.",),
        sections=[
            Section(note=" ".join(answer.notes), charts=_charts(tube), legend=False),
            Section(id="numbers", title="Numbers", tables=answer.tables, legend=False),
        ],
        title=f"Tube: {problem.scenario.title}",
        provenance=facts_table("Provenance", facts),
        commands=f"flighttune verify {source}",
        scenario_text=toml_text(problem.scenario.as_dict()),
    )


def _charts(tube: Tube) -> list[Chart]:
    """Both errors: the bounds of every flight."""
    charts, bounds = [], tube.bounds
    for i, (_, title, unit) in enumerate(ERRORS):
        chart = Chart(title=title, y=unit, x_range=(0.0, float(bounds.t[-1])), linked=True)
        chart.level(0.0, NEUTRAL, dash="")
        low, high = bounds.low[:, i] * DEG_PER_RAD, bounds.high[:, i] * DEG_PER_RAD
        chart.band(bounds.t, low, high, STRONG, name="tube")
        for edge in (low, high):
            chart.line(bounds.t, edge, STRONG, width=1.2)
        charts.append(chart)
    return charts
