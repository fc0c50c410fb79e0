"""Charts, numbers and requirements of flights, as pieces of HTML for the page."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from html import escape
from typing import Any

from flighttune.base.errors import printable
from flighttune.base.words import number, pick
from flighttune.claims.leaving import Volume
from flighttune.flight.entry import entry_of
from flighttune.flight.flown import BoundCheck, ClaimCheck, FlownScenario, check_claim
from flighttune.flight.loop.run import Run, renamed
from flighttune.flight.models import loop_measures
from flighttune.outputs.answers.answer import Table
from flighttune.outputs.answers.finding import PartFinding, worst_of
from flighttune.outputs.answers.flown import ROUTE_COLUMNS, RUN_COLUMNS
from flighttune.outputs.answers.labels import columns, in_words
from flighttune.outputs.answers.run import claimed, run_styles
from flighttune.outputs.answers.verdict import short
from flighttune.outputs.drawing.chart import Chart
from flighttune.outputs.drawing.palette import HUES, PLANTS, LineStyle
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.pages import panels
from flighttune.outputs.pages.charts import draw_edges, draw_ends, planned_path, route_charts
from flighttune.outputs.pages.panels import Drawn
from flighttune.routes.fence import Fence

# Most flights in memory, and most ghosts of a page.
MAX_FLOWN, MAX_GHOSTS = 12, 5

LOOP = "R_K I_K E_K gain_margin_dB phase_margin_rad delay_margin_s"

# Styles of the ghosts, the start first, of aircraft that differ, and of recorded runs.
GHOSTS = tuple(LineStyle(*shade, 1.5, True) for shade in (PLANTS[0], *(hue[1] for hue in HUES[2:])))
CLOUD, RECORDED = LineStyle(*HUES[0][1], 0.5, False), LineStyle(*HUES[1][0], 1.6, False)


def pieces(
    now: FlownScenario,
    ghosts: Mapping[str, FlownScenario],
    cloud: Sequence[Run],
    recorded: Sequence[Run],
    fence: Fence | None,
    counted: Sequence[PartFinding] = (),
) -> str:
    """HTML of the pieces of the page, each in an element with its id.

    `ghosts` by name, the start first, `cloud` of aircraft that differ, and runs of a recording or
    of the log of a real flight are drawn beside the flights of `now`. Of a ghost the last plant is
    drawn, an aircraft if there is one. `counted`: what a count of these flights found.
    """
    styles, crowd = run_styles(now.runs), f"{len(cloud)} aircraft that differ"
    named = {name: renamed(flown.runs[-1], name) for name, flown in ghosts.items()}
    others = _flown(
        *((renamed(run, crowd), CLOUD) for run in cloud),
        *((run, RECORDED) for run in recorded),
        *zip(named.values(), GHOSTS, strict=False),
    )
    flights = _flown(*((run, styles[run.label]) for run in now.runs))
    findings = [*_of_claim(now.claim), *claimed(now.runs).findings, *counted]
    if cloud:
        findings += _of_claim(check_claim(now.scenario, cloud), f"{crowd}: ")
    if fence is not None:
        findings += [*_in_fence(fence, {run.label: [run] for run in now.runs})]
        findings += [*_in_fence(fence, {crowd: cloud})] if cloud else []
    worst = worst_of(findings)
    sentences = [x.sentence or x.reason for x in sorted(findings, key=lambda x: -x.rank)]
    sentences += [f"{run.label}: {run.outcome}" for run in now.runs if run.status != "completed"]
    if now.claim.verdict == "not tested":
        sentences.append("The scenario has no requirement for these gains")
    page = page_template("flighttune.outputs.live", "pieces.html.jinja").render(
        about=panels.flown_in_words(now.scenario, now.runs),
        found=worst and worst.found,
        sentences=[sentence.rstrip(".") for sentence in sentences],
        requirements=[_requirement(check) for check in now.claim.bounds],
        legend={run.label: style for run, style in (*flights, *others)},
        ghosts={run.label: name for name, run in named.items()},
        charts=_charts(flights, others, fence) if flights else [],
        tables=_tables({"now": now, **ghosts}),
        styles={},
    )
    return printable(page)


def without_flights(error: str) -> str:
    """The pieces of a page that shows an error in place of its verdict, and no flight."""
    empty = "".join(
        f'<p id="{x}"></p>' for x in ["about", "legend", "charts", "requirements", "numbers"]
    )
    return printable(f'<div id="verdict"><p class="verdict no">{escape(error)}</p></div>{empty}')


def _flown(*drawn: tuple[Run, LineStyle]) -> Drawn:
    return [(run, style) for run, style in drawn if len(run.signals) > 1]


def _of_claim(claim: ClaimCheck, whose: str = "") -> list[PartFinding]:
    """What flights find of the requirements; nothing if none applies and all are completed."""
    said = f"{whose}{short(claim)}"
    if claim.verdict == "not tested":
        return [PartFinding(found="open", sentence=said)] if claim.total.ended else []
    return [PartFinding(found="met" if claim.verdict == "met" else "not met", sentence=said)]


def _in_fence(fence: Fence, flown: Mapping[str, Sequence[Run]]) -> Iterator[PartFinding]:
    """Whether the drawn flights stay inside a fence, those of each name together."""
    inside = Volume.of(fence)
    for name, runs in flown.items():
        tracks = [run.signals for run in runs if len(run.signals)]
        places = [x[["north", "east", "down"]].to_numpy() * (1.0, 1.0, -1.0) for x in tracks]
        if not places:
            continue
        margin = min(float(inside.margins(place).min()) for place in places)
        said = f"{name} leaves the fence by {-margin:.1f} m"
        if margin >= 0.0:
            said = f"{name} stays inside the fence, nearest {margin:.1f} m"
        yield PartFinding(found="met" if margin >= 0.0 else "not met", sentence=said)


def _requirement(check: BoundCheck) -> dict[str, Any]:
    said = {"measure": f"{check.subject}.{check.measure}", "sense": check.sense.replace("_", " ")}
    words = in_words({**said, **pick(check, "bound value met run")})
    got = number(words["value"])
    if not math.isfinite(check.value):
        settles = check.measure.startswith("settling")
        got = "not flown" if not check.flown else "does not settle" if settles else "no value"
    return {**words, "got": got}


def _tables(named: Mapping[str, FlownScenario]) -> list[Table]:
    """Tables of the linear loop and of the flights, now and of the last plant of each ghost."""
    loops = [{"which": name, **measures_of_loop(flown)} for name, flown in named.items()]
    records = [
        {**record, "gains": name}
        for name, flown in named.items()
        for record in flown.records({})[0 if name == "now" else -1 :]
    ]
    all_completed = {record["status"] for record in records} == {"completed"}
    shown = [
        replace(x, name="which") if x.key == "gains" else x
        for x in (ROUTE_COLUMNS if named["now"].scenario.route else RUN_COLUMNS)
        if x.key != "status" or not all_completed
    ]
    linear = Table(columns(f"which {LOOP}"), loops, "Linear loop")
    return [linear, Table(shown, records, "Flights")]


@lru_cache(MAX_FLOWN)
def measures_of_loop(flown: FlownScenario) -> Mapping[str, float]:
    """Indicators and margins of the linear loop; empty for a law without gains."""
    made_by = flown.runs[0].provenance
    if made_by.gains is None:
        return {}
    return loop_measures(entry_of(flown.scenario, made_by.gains_name, made_by.gains), LOOP.split())


def _charts(flights: Drawn, others: Drawn, fence: Fence | None) -> list[Chart]:
    """Responses, commands and paths of flights, with others beside them."""
    every, path = [*others, *flights], planned_path(flights)
    if path is None:
        return [*panels.tracking(every), *panels.commands(flights), *panels.paths(every)]
    # The route of the first flight is drawn: ghosts may have another airspeed.
    above, height, *errors = route_charts([*flights, *others])
    if fence is not None:
        draw_edges(above, fence)
        draw_ends(height, fence, path)
    return [above, height, *errors, *panels.commands(flights)]
