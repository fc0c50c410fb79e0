"""The page that compares a user's guidance with the gains of a scenario."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from flighttune.campaigns.flying.rows import fly_group
from flighttune.campaigns.statistics.intervals import scores
from flighttune.flight.fly import library_versions
from flighttune.flight.loop.run import renamed
from flighttune.outputs.answers.answer import facts_table
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing.chart import Chart
from flighttune.outputs.drawing.palette import LineStyle
from flighttune.outputs.pages import panels
from flighttune.outputs.pages.frame import Report, Section, write_answer
from flighttune.outputs.pages.page import overview
from flighttune.studies.beside import MEASURED, OURS, YOURS, Beside

# Measures whose shares of flights are drawn, the most important first.
DRAWN = 3


def write_beside_page(beside: Beside, path: str | Path, command: str) -> Report:
    """Write the answer as one self-contained page; `command` repeats it."""
    answer, ours, n = beside.answer(), beside.plan.groups[-1].gains, beside.plan.draws
    early = answer.found is not None
    # tables of margins, if any, start at the fifth table
    (*notes, unused), (*found, parameters) = answer.notes, answer.tables
    draw, flights = typical_flights(beside)
    styles = {run.provenance.gains_name: style for run, style in flights}
    return write_answer(
        path,
        title=f"{beside.plan.scenario.title}: {beside.now.name} beside {ours}",
        summary=answer.summary,
        found=answer.found,
        parts={
            "responses": Section(
                title=f"One flight with both, draw {draw}",
                note="Its error with your guidance is the median of all draws.",
                charts=overview(flights) if flights else (),
            ),
            "accuracy": Section(
                title="Flights that ended early" if early else "Errors of all flights",
                note=notes,
                charts=error_charts(beside, styles) if n > 1 and not early else (),
                tables=found[:4],
                columns=3,
                legend=False,
            ),
            "commands": Section(
                title=f"Commands of draw {draw}", charts=panels.commands(flights) if flights else ()
            ),
            "margins": Section(tables=found[4:]),
            "flown": Section(title="Parameters of your guidance", note=unused, tables=[parameters]),
        },
        legend=[(run.label, style) for run, style in flights],
        provenance=facts_table("Provenance", library_versions()),
        commands=command,
    )


def typical_flights(beside: Beside) -> tuple[int, panels.Drawn]:
    """The draw with the user's median error, and its flights with both, flown again."""
    plan, yours = beside.plan, beside.rows[beside.rows["gains"] == YOURS]
    errors = scores(yours, _measures(beside)[0])
    middle = int(np.argsort(errors, kind="stable")[(len(errors) - 1) // 2])
    draw = int(yours["draw"].iloc[middle])
    runs = []
    for group, name in zip(plan.groups, (YOURS, OURS), strict=True):
        runs.append(renamed(fly_group(plan, plan.scenario_of(draw), group), name))
    styles = run_styles(runs)
    return draw, [(run, styles[run.label]) for run in runs if len(run.signals) > 1]


def error_charts(beside: Beside, styles: dict[str, LineStyle]) -> list[Chart]:
    """Share of the flights whose largest error stays below each value, with both."""
    charts = []
    for measure in _measures(beside)[:DRAWN]:
        words, unit, factor = MEASURED[measure]
        chart = Chart(
            title=f"Largest error of {words}", x=f"{words} [{unit}]", y="flights below it [%]"
        )
        for name, style in styles.items():
            of_law = beside.rows[beside.rows["gains"] == name]
            values = np.sort(scores(of_law, measure)) * factor
            share = 100.0 * np.arange(len(values) + 1) / len(values)
            ends = np.isfinite(values)
            x, y = np.repeat(values[ends], 2), np.repeat(share, 2)[1:-1][: 2 * ends.sum()]
            chart.line(x, y, style.colour, name=name)
        charts.append(chart)
    return charts


def _measures(beside: Beside) -> Sequence[str]:
    """The measures that these flights have."""
    return [measure for measure in MEASURED if beside.rows[measure].notna().any()]
