"""The page of a claim file, and plots of claims and flights."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

from flighttune.base.answering import function_for
from flighttune.base.errors import InputError
from flighttune.base.words import got
from flighttune.claims.counted import SignalBounds
from flighttune.claims.mission import MissionOdds
from flighttune.claims.monitor import LogMonitor
from flighttune.claims.per_hour import PerHour
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.verify import AnyClaim, stale_notes
from flighttune.control.certificates.bound import RateBound
from flighttune.control.certificates.certificate import Certificate
from flighttune.flight.flown import FlownScenario
from flighttune.flight.loop.run import Run
from flighttune.outputs.answers.answer import Answer, Table, facts_table
from flighttune.outputs.answers.finding import Found
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing.chart import Chart, Sheet, dashes
from flighttune.outputs.pages.frame import Report, Section, write_answer
from flighttune.outputs.pages.panels import errors, flown_signals
from flighttune.outputs.pages.sheet import font, sha256

# The parts of the page of a claim, and its charts, by class as module:function.
PAGES = {
    "Band": "flighttune.outputs.pages.counted:band",
    "Certificate": "flighttune.outputs.pages.claim:certificate",
    "Counted": "flighttune.outputs.pages.counted:counted",
    "LogMonitor": "flighttune.outputs.pages.claim:log_monitor",
    "PerHour": "flighttune.outputs.pages.claim:per_hour",
    "RateBound": "flighttune.outputs.pages.claim:bound",
    "SignalBounds": "flighttune.outputs.pages.counted:bounds",
    "Tube": "flighttune.outputs.pages.tube:tube",
    "TurnBack": "flighttune.outputs.pages.counted:turned_back",
}
CHARTS = {
    "Band": "flighttune.outputs.pages.counted:mission_charts",
    "SignalBounds": "flighttune.outputs.pages.counted:band_charts",
    "Tube": "flighttune.outputs.pages.tube:tube_charts",
    "object": "flighttune.outputs.pages.claim:run_charts",
}


class Asked(NamedTuple):
    """Context of the page of a claim."""

    source: str  # file of the claim
    mission: MissionOdds | None = None  # of a band along a route; None: as kept in files


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """The parts of the page of a claim, and its source files."""

    title: str
    sentences: Sequence[str]  # at the top
    found: Found | None = None  # what the worst part of it found, which colours the first sentence
    notes: Sequence[str]
    tables: Sequence[Table]
    charts: Sequence[Chart] = ()
    heading: str = ""  # of the charts, instead of "Flights"
    below: Sequence[Table] = ()  # tables below the charts
    conditions: Sequence[Table] = ()  # tables that are printed with the map as one A4 page
    changed: Sequence[str] = ()  # notes for the charts
    shown: Answer | None = None  # for a terminal, if the page has more than the claim
    facts: Mapping[str, str] = field(default_factory=dict)  # rows of its provenance
    texts: Mapping[str, str] = field(default_factory=dict)  # source files


def certificate(claim: Certificate, _: Asked) -> Parts:
    """The page of a certificate."""
    return _stated(claim, "Certificate")


def bound(claim: RateBound, _: Asked) -> Parts:
    """The page of a bound on R_K."""
    return _stated(claim, "Bound on R_K")


def per_hour(claim: PerHour, _: Asked) -> Parts:
    """The page of the exits per flight hour."""
    parts, said = _stated(claim, "Exits per flight hour"), claim.answer()
    return replace(parts, sentences=said.summary, found=said.found)


def log_monitor(claim: LogMonitor, _: Asked) -> Parts:
    """The page of a monitor learned from logs."""
    return _stated(claim, "Monitor of logs")


def _stated(claim: AnyClaim, title: str) -> Parts:
    answer = claim.answer()
    notes = [*stale_notes(claim), *answer.notes]
    return Parts(title=title, sentences=[claim.sentence], notes=notes, tables=answer.tables)


def write_claim_page(
    claim: AnyClaim, source: str, path: str | Path, mission: MissionOdds | None = None
) -> Report:
    """Write one self-contained page about the claim in the file `source`.

    That of a band along a route prints as one A4 page, with what its `mission`, or the files
    beside it, counted besides.
    """
    parts: Parts = function_for(claim, PAGES)(claim, Asked(source, mission))
    drawn = [table for table in parts.tables if table.name == "dispersions"]
    others = [table for table in parts.tables if table.name != "dispersions"]
    page = write_answer(
        path,
        title=parts.title,
        summary=parts.sentences,
        found=parts.found,
        parts={
            "responses": Section(
                title=parts.heading, note=parts.changed, charts=parts.charts, tables=parts.below
            ),
            "conditions": Section(tables=parts.conditions),
            "flown": Section(tables=drawn),
            "claim": Section(note=parts.notes, tables=others),
        },
        provenance=facts_table(
            "Provenance", {"file": source, "its SHA-256": sha256(Path(source)), **parts.facts}
        ),
        commands=f"flighttune verify {source}",
        texts=parts.texts,
        font=font() if parts.conditions else "",
    )
    return replace(page, shown=parts.shown or claim.answer())


def plot(value: FlownScenario | Run | Iterable[Run] | SignalBounds | Tube) -> Sheet:
    """Draw flights or claims about them.

    Parameters
    ----------
    value : FlownScenario, Run or iterable of Run; Band or Residual; Tube
        Flights: both errors, roll and load factor over time, with their limits and claims. A band:
        each signal with the counted flights, and first a map if it has a route. A tube: the bounds
        of both errors.

    Returns
    -------
    Sheet
        Angles in degrees; a notebook shows it, ``save`` writes an SVG file.

    Raises
    ------
    InputError
        If no run has flown.

    Examples
    --------
    >>> ft.plot(ft.fly(ft.load_scenario("paper_as_printed"))).save("flight.svg")
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> ft.plot(band).save("band.svg")
    """
    return Sheet(charts=function_for(value, CHARTS)(value))


def run_charts(value: FlownScenario | Run | Iterable[Run]) -> list[Chart]:
    """Both errors, roll and load factor of runs."""
    runs = value.runs if isinstance(value, FlownScenario) else value
    runs = (runs,) if isinstance(runs, Run) else tuple(runs)
    if wrong := [run for run in runs if not isinstance(run, Run)]:
        raise InputError(f"`value` must be runs, got {got(wrong[0])}.")
    styles = run_styles(runs)
    if not (flights := [(run, styles[run.label]) for run in runs if len(run.signals) > 1]):
        raise InputError("`value` must have a run that flew, got none.")
    charts = [*errors(flights), *flown_signals(flights)]
    for chart in charts:
        chart.legend = [(run.label, style.colour, dashes(style)) for run, style in flights]
    return charts
