"""Charts of the guarantees, and the frontier of the gains."""

import numpy as np

from flighttune.present.chart import DASHED, DOTTED, Chart
from flighttune.present.palette import LIMIT, LineStyle
from flighttune.report.facts import Facts
from flighttune.report.panels import most_points
from flighttune.tuning.frontier import frontier_chart

FLOOR = 1e-4
"""Lower end of the logarithmic axis of ``||s||``."""

TINY = 1e-9


def certificate_panels(facts: Facts) -> list[Chart]:
    """The norm of s against its guaranteed bound, a chart per gain set."""
    charts = []
    for gain_set in facts.gains:
        own = [run for run in facts.runs if run.provenance.gains_name == gain_set.name]
        drawn = [(run, facts.checks[run.label]) for run in own if run.label in facts.checks]
        if not drawn:
            continue
        chart = Chart(
            title=f"{gain_set.name}: ‖s‖, with its guaranteed bound dashed",
            y="‖(e′, e)‖ [rad/s, rad]",
            x_range=(0.0, max(run.duration for run, _ in drawn)),
            log="y",
            linked=True,
        )
        for run, check in drawn:
            style, size = facts.styles[run.label], np.maximum(check.size, TINY)
            chart.run_line(
                check.t, size, style, run.label, dash="", most=most_points(len(facts.runs))
            )
            guaranteed = {"dash": DASHED, "width": 1.2, "most": most_points(len(facts.runs))}
            chart.run_line(check.t, check.bound, style, run.label, **guaranteed)
            if check.settled is not None:
                chart.level(check.settled[0].radius, style.colour, dash=DOTTED, run=run.label)
            if check.t_broken is not None:
                at = float(np.interp(check.t_broken, check.t, check.size))
                chart.points(check.t_broken, at, LIMIT, shape="cross", size=5, run=run.label)
        low, high = chart.y_ends()
        chart.y_range = max(low, FLOOR), high
        charts.append(chart)
    return charts


def frontier_panel(facts: Facts) -> list[Chart]:
    """R_K against I_K with the gains of the runs marked; nothing where no loop is stable."""
    if "frontier" not in set(facts.frontier["name"]):
        return []
    return [frontier_chart(facts.frontier, strongest_styles(facts))]


def strongest_styles(facts: Facts) -> dict[str, LineStyle]:
    """Style of each gain set: that of its run on the last plant, the strongest."""
    return {run.provenance.gains_name: facts.styles[run.label] for run in facts.runs}
