"""The page of a tube."""

from flighttune.base.files.table import toml_text
from flighttune.base.signals import titles
from flighttune.base.units import DEG_PER_RAD
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.verify import stale_notes
from flighttune.outputs.drawing.chart import Chart
from flighttune.outputs.drawing.palette import HUES, NEUTRAL
from flighttune.outputs.pages.claim import Asked, Parts
from flighttune.outputs.pages.panels import ERRORS

STRONG = HUES[0][0][0]


def tube(claim: Tube, _: Asked) -> Parts:
    """The page of a tube, with its scenario and enclosure."""
    problem, settings, answer = claim.problem, claim.settings, claim.answer()
    return Parts(
        title=f"Tube: {problem.scenario.title}",
        sentences=[claim.sentence],
        notes=[*stale_notes(claim), *answer.notes],
        tables=answer.tables,
        charts=tube_charts(claim),
        facts={
            "law": problem.law.name,
            "settings": f"{settings.symbols} symbols, {settings.most} pieces at most",
        },
        texts={"scenario.toml": toml_text(problem.scenario.as_dict())},
    )


def tube_charts(tube: Tube) -> list[Chart]:
    """Both errors: the bounds of every flight."""
    charts, t = [], tube.bounds.t
    for signal in (name for name in ERRORS if name in tube.bounds.names):
        title, label = titles(signal)
        chart = Chart(title=title, y=label, x_range=(0.0, float(t[-1])), linked=True)
        chart.level(0.0, NEUTRAL, dash="")
        low, high = DEG_PER_RAD * tube.bounds.of([signal]).pairs[:, 0].T
        chart.band(t, low, high, STRONG, name="tube")
        for edge in (low, high):
            chart.line(t, edge, STRONG, width=1.2)
        charts.append(chart)
    return charts
