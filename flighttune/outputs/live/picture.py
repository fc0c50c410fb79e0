"""Charts, numbers and requirements of flights, as pieces of HTML for the page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from flighttune.base.errors import printable
from flighttune.base.words import pick
from flighttune.flight.entry import entry_of
from flighttune.flight.flown import BoundCheck, ClaimCheck, FlownScenario
from flighttune.flight.loop.run import Run
from flighttune.flight.models import loop_measures
from flighttune.outputs.answers.answer import Table
from flighttune.outputs.answers.flown import ROUTE_COLUMNS, RUN_COLUMNS
from flighttune.outputs.answers.labels import columns, in_words
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.answers.verdict import short
from flighttune.outputs.drawing.chart import Chart
from flighttune.outputs.drawing.palette import HUES, PLANTS, LineStyle
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.pages import panels
from flighttune.outputs.pages.charts import draw_edges, draw_ends, planned_path, route_charts
from flighttune.outputs.pages.panels import Drawn
from flighttune.routes.fence import Fence

LOOP = "R_K I_K E_K gain_margin_dB phase_margin_rad delay_margin_s"

# Styles of the ghosts, the start first, and of aircraft that differ.
GHOSTS = tuple(LineStyle(*shade, 1.5, True) for shade in (PLANTS[0], *(hue[1] for hue in HUES[2:])))
CLOUD = LineStyle(*HUES[0][1], 0.5, False)

# Style of recorded runs, and the signals that a path needs.
RECORDED, PLACE = LineStyle(*HUES[1][0], 1.6, False), {"north", "east", "down"}

# Pieces by the id of their element on the page.
PIECES = "about", "verdict", "legend", "charts", "requirements", "numbers"


@dataclass(frozen=True)
class Flown:
    """Flights with the values shown of them, each computed once."""

    flights: FlownScenario

    @cached_property
    def claim(self) -> ClaimCheck:
        """The flights checked against the requirements of the scenario."""
        return self.flights.claim

    @cached_property
    def records(self) -> list[dict[str, Any]]:
        """Ending and measures of each run."""
        return self.flights.records({})

    @cached_property
    def loop(self) -> dict[str, float]:
        """Indicators and margins of the linear loop; empty for a law without gains."""
        run = self.flights.runs[0].provenance
        if run.gains is None:
            return {}
        entry = entry_of(self.flights.scenario, run.gains_name, run.gains)
        return loop_measures(entry, LOOP.split())

    def drawn(self, name: str, style: LineStyle) -> Drawn:
        """The flight of the last plant, an aircraft if there is one, under this name."""
        run = self.flights.runs[-1]
        named = replace(run, provenance=replace(run.provenance, gains_name=name))
        return [(named, style)] if len(run.signals) > 1 else []


def pieces(
    now: Flown,
    ghosts: Mapping[str, Flown],
    cloud: Sequence[Flown],
    runs: Sequence[Run],
    fence: Fence | None,
) -> dict[str, str]:
    """HTML of each piece of the page.

    `ghosts` by name, the start first, `cloud` of aircraft that differ, and `runs` of a recording or
    of the log of a real flight are drawn beside the flights of `now`.
    """
    flown, styles = now.flights, run_styles(now.flights.runs)
    flights = [(run, styles[run.label]) for run in flown.runs if len(run.signals) > 1]
    named = {
        name: x.drawn(name, style) for (name, x), style in zip(ghosts.items(), GHOSTS, strict=False)
    }
    recorded = [(run, RECORDED) for run in runs]
    lines = [*recorded, *(x for drawn in named.values() for x in drawn)]
    crowd_name = f"{len(cloud)} aircraft that differ"
    crowd = [x for one in cloud for x in one.drawn(crowd_name, CLOUD)]
    early = [f"{x.label}: {x.outcome}." for x in flown.runs if x.status != "completed"]
    whole = {
        "about": panels.flown_in_words(flown.scenario, flown.runs),
        "claim": now.claim,
        "said": short(now.claim),
        "loop": [(x.heading, x.text(now.loop)) for x in columns(LOOP)] if now.loop else [],
        "sentences": [*early, *_differing(cloud)],
        "legend": {run.label: style for run, style in (*flights, *lines, *crowd)}.items(),
        "ghosts": {run.label: name for name, drawn in named.items() for run, _ in drawn},
        "charts": _charts([*crowd, *lines], flights, fence) if flights else [],
        "requirements": [_requirement(x) for x in now.claim.bounds],
        "numbers": _tables({"now": now, **ghosts}),
    }
    template = page_template("flighttune.outputs.live", "pieces.html.jinja")
    made = template.make_module({"styles": {}})
    return {name: printable(getattr(made, name)(whole)) for name in PIECES}


def _requirement(check: BoundCheck) -> dict[str, Any]:
    said = {"measure": f"{check.subject}.{check.measure}", "sense": check.sense.replace("_", " ")}
    return in_words({**said, **pick(check, "bound value met run")})


def _differing(cloud: Sequence[Flown]) -> list[str]:
    """Number of aircraft that meet the requirements; without requirements, that fly to the end."""
    if not cloud:
        return []
    tested = cloud[0].claim.verdict != "not tested"
    ends = [
        x.claim.verdict == "met" if tested else x.flights.runs[0].status == "completed"
        for x in cloud
    ]
    what = "meet every requirement" if tested else "fly to the end"
    return [f"{sum(ends)} of {len(ends)} aircraft that differ {what}."]


def _tables(named: Mapping[str, Flown]) -> list[Table]:
    """Tables of the linear loop and of the flights, now and for each ghost."""
    loops = [{"which": name, **x.loop} for name, x in named.items() if x.loop]
    records = [
        {**record, "gains": name}
        for name, x in named.items()
        for record in x.records[0 if name == "now" else -1 :]
    ]
    route = any("along" in run.signals for x in named.values() for run in x.flights.runs)
    shown = [replace(x, name="at") if x.key == "gains" else x for x in RUN_COLUMNS]
    tables = [Table(ROUTE_COLUMNS if route else shown, records, "Flights")]
    return [Table(columns(f"which {LOOP}"), loops, "Linear loop"), *tables] if loops else tables


def _charts(beside: Drawn, flights: Drawn, fence: Fence | None) -> list[Chart]:
    """Responses, commands and paths of flights, with others beside them."""
    every = [*beside, *flights]
    path = planned_path(flights)
    if path is None:
        placed = [x for x in every if PLACE <= {*x[0].signals}]
        return [*panels.tracking(every), *panels.commands(flights), *panels.paths(placed)]
    # The route of the first flight is drawn: ghosts may have another airspeed.
    along = [x for x in beside if "along" in x[0].signals]
    above, height, *errors = route_charts([*flights, *along])
    if fence is not None:
        draw_edges(above, fence)
        draw_ends(height, fence, path)
    return [above, height, *errors, *panels.commands(flights)]
