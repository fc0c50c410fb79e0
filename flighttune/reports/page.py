"""Reports as self-contained HTML files: on the runs of a scenario, a comparison of runs, a log."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from flighttune.aircraft.aircraft import load_aircraft
from flighttune.arrays import FloatArray
from flighttune.claims.linear_loop import linear_bound
from flighttune.claims.monitor import LogMonitor, Monitor
from flighttune.errors import FlightTuneError, RecordingError
from flighttune.files.table import toml_text
from flighttune.flight.conditions import reference_of, stated_condition
from flighttune.flight.expectations import check_claim
from flighttune.flight.flown import advice
from flighttune.flight.models import tuning_problem
from flighttune.gaps.gap import Gap, explain_flight, step_table
from flighttune.gaps.watch import score_so_far
from flighttune.present.answer import Answer, Table, facts_table
from flighttune.present.chart import Chart
from flighttune.present.frame import Report, Section, page_template, write_answer, write_page
from flighttune.present.names import CHANNEL_SYMBOLS
from flighttune.present.palette import HUES, LIMIT
from flighttune.records.compare import (
    Comparison,
    Source,
    comparison_table,
    load_source,
    overlaid,
    pairs_table,
    sources_of,
)
from flighttune.reports import panels, tables
from flighttune.reports.charts import (
    bound_chart,
    itae_chart,
    planned_path,
    route_charts,
    steps_chart,
)
from flighttune.scenario.load import gains_notes, scenario_of
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import TUNED, TUNED_FED_BACK, TUNED_IDENTIFIED
from flighttune.simulate.run import Run, claim_notes, priority_notes, run_styles
from flighttune.tuning.frontier import frontier, frontier_chart
from flighttune.units import DEG_PER_RAD

STRONG, _ = (colour for colour, _ in HUES[0])

ABOVE = (("chi", "Course", "χ [deg]"), ("gamma", "Path angle", "γ [deg]"))
BELOW = (
    *(("phi", "Roll", "φ [deg]"), ("phi_cmd", "Roll command", "φ_cmd [deg]")),
    *(("n_z", "Load factor", "n_z [1]"), ("n_z_cmd", "Load-factor command", "n_z,cmd [1]")),
    *(("V_a", "Airspeed", "V_a [m/s]"), ("V_g", "Ground speed", "V_g [m/s]")),
)
NOTE = "Gaps of the log are gaps of its lines. Positions count from the start of the part shown."


def log_sections(flights: panels.Drawn, tables: Sequence[Table] = ()) -> list[Section]:
    """Sections about flights of which one at least is a log: signals that any of them has."""

    def charts(signals: Sequence[tuple[str, str, str]]) -> list[panels.Chart]:
        there = {name for run, _ in flights for name in run.signals}
        return [*panels.flown_signals(flights, [row for row in signals if row[0] in there])]

    placed = [(run, style) for run, style in flights if {"north", "east", "down"} <= {*run.signals}]
    paths = panels.paths(placed) if placed else []
    return [
        Section(note=NOTE, charts=[*charts(ABOVE), *paths], tables=tables),
        Section(id="commands", title="Commands, load and speed", charts=charts(BELOW)),
    ]


def log_facts(source: Source) -> Table:
    """Contents and gaps of logs, and what they show about their own units and signs."""
    facts: dict[str, str] = {}
    for run in source.runs:
        log = run.provenance.log or {}
        samples = f"{run.duration:.1f} s from {log['from_s']:g} s on, {len(run.signals)} samples"
        facts |= {"log": f"{log['file']} ({log['kind']})", "part": samples}
        parts = {key: log.get(key, ()) for key in ("phases", "odd", "missing", "gaps", "checks")}
        facts |= {key: "; ".join(lines) for key, lines in parts.items() if lines}
    return facts_table("The log", facts)


def write_log_page(
    source: Source, path: Path, monitors: Sequence[Monitor | LogMonitor] = ()
) -> Report:
    """Write one self-contained page about the log of a real flight; parent folders are made."""
    (run,), styles = source.runs, run_styles(source.runs)
    facts = log_facts(source)
    sections = log_sections([(run, styles[run.label])], [facts])
    summary, alarms, charts, failure = [f"A real flight of {run.duration:.1f} s."], [], [], ""
    for monitor in monitors:
        alarm, score = monitor.alarm(run), score_so_far(monitor.watches, run)
        sentence = f"No alarm from {monitor.watches[0].from_s:g} s on."
        if alarm is not None:
            sentence = alarm.sentence
            failure = failure or sentence
        alarms.append(alarm and alarm._asdict())
        chart = Chart(title=f"Largest score so far: {sentence}", y="score [1]")
        chart.line(run.t[-len(score) :], score, STRONG)
        chart.level(1.0, LIMIT)
        charts.append(chart)
        summary += [sentence, f"The monitor: {monitor.sentence}."]
    if charts:
        sections.insert(0, Section(id="monitor", title="Monitor", charts=charts, legend=False))
    page = write_answer(
        path,
        summary=summary,
        parts={section.id: section for section in sections},
        title=str(run.provenance.scenario["title"]),
        legend=list(styles.items()),
        styles=styles,
        provenance=facts_table("Versions", run.provenance.versions),
        commands=f"flighttune report {source.name}",
    )
    log = run.provenance.log or {}
    shown = Answer(
        values={"bytes": path.stat().st_size, "summary": summary, "log": log, "alarms": alarms},
        notes=[
            *summary,
            *(line for key in ("phases", "odd", "checks") for line in log.get(key, ())),
            *(f"missing: {line}" for line in source.missing),
        ],
        failure=failure,
    )
    return Report(
        path=path, summary=page.summary, sections=page.sections, tables=page.tables, shown=shown
    )


# Gain sets whose gap is drawn; the table has all of them.
MAX_GAPS = 3

FRONTIER_POINTS = 9

# Samples of a reference that is described in words.
ANGLES = 2001

# Longest aircraft run for which the ladder is flown: beyond it a report would take minutes.
LONGEST_LADDER = 6_000

CONVERGES = (
    "A run converges if it was completed and both errors stay within their limits over the last "
    f"quarter of the flight: {100.0 * tables.CONVERGED_PART:.0f} % of the largest error, and at "
    f"least {tables.CONVERGED_AT_LEAST * DEG_PER_RAD:.1f}°. On a route it converges if it arrives."
)
ERRORS = "Errors are reference minus actual, the course error wrapped to ±180°."
GAP = (
    "The same gains under the same limits in the same air, on the paper's law, the exact point "
    "mass, the point mass behind the inner loop and the aircraft. Red: the tube of the aircraft, "
    "where one covers it; flighttune report takes --claim FILE."
)
BOUND = (
    "The proof is about the linear loop. s stacks error rates and errors of flights of the law in "
    "still air. Dashed: its bound, i.e. the decay of the linear loop plus what the disturbance in "
    "the scenario can add (at most the dotted level). It pauses while a command is limited and "
    "restarts when the reference changes slope. "
    "An aircraft has no such bound; its tube bounds its errors."
)
NO_BOUND = (
    "The proof is about the linear loop. No flight here is one of the law in still air with true "
    "values measured, so no bound is drawn."
)
NO_CURVE = (
    "There is no curve of R_K against I_K: no stable gains were found within the limits of the "
    "scenario's tuning."
)


def write_report(source: str | Path | Source, path: str | Path) -> Report:
    """Write one self-contained page about the runs of a scenario; `source` is as for `compare`."""
    source = source if isinstance(source, Source) else load_source(source)
    runs = [run for run in source.runs if len(run.signals) > 1]
    scenario = _scenario(source, runs)
    styles = run_styles(source.runs)
    flights = [(run, styles[run.label]) for run in runs]
    claim = check_claim(scenario, source.runs)
    convergence = tables.convergence_table(source.runs, claim)
    converged = tables.by_plant(
        (run.provenance.plant, record["converges"], 1)
        for run, record in zip(source.runs, convergence.records, strict=True)
    )
    gaps, without_gap = _gaps(scenario, runs)
    certificate = _certificate_section(scenario, flights)
    at_top, below = _areas(runs)
    origin = runs[0].provenance
    return write_page(
        Path(path),
        page_template("flighttune.reports", "page.html.jinja"),
        about=(flown_in_words(scenario, runs), _gains_in_words(scenario, runs)),
        summary=(f"{claim.short}.", f"Converged: {converged}.", *gains_notes(runs)),
        closest=f"{claim.sentence}." if claim.verdict == "met" else "",
        missed=(*claim.missed, *filter(None, [advice(scenario, source.runs, "SCENARIO")])),
        criterion=CONVERGES,
        sections=[
            Section(note=at_top, charts=overview(flights), tables=[convergence]),
            Section(
                id="tracking",
                title="Errors and metrics",
                note=" ".join([ERRORS, *below]),
                charts=panels.errors(flights),
                tables=[tables.tracking_table(runs), tables.runs_table(source.runs)],
            ),
            _commands_section(flights, "Commands after magnitude and rate limits."),
            *([_gap_section(gaps, runs)] if gaps else []),
            certificate,
        ],
        title=scenario.title,
        claim=scenario.verifies,
        legend=[(run.label, style) for run, style in flights],
        styles=styles,
        without_gap=without_gap,
        missing=source.missing,
        provenance=tables.provenance_table(source.name, scenario, runs),
        scenario_text=toml_text(origin.scenario),
        first_gains=next((run.provenance.gains_name for run in runs if run.provenance.gains), None),
        version=origin.versions.get("flighttune", ""),
    )


def write_comparison_page(comparison: Comparison, path: str | Path) -> Report:
    """Write one self-contained page about comparable runs."""
    runs = overlaid(comparison)
    flown = [run for run in runs if not run.provenance.log]
    styles = run_styles(runs)
    flights = [(run, styles[run.label]) for run in runs]
    scenario = (flown or runs)[0].provenance.scenario
    sources = sources_of(comparison)
    at_top, below = _areas(runs)
    if len(flown) < len(runs):
        sections = log_sections(flights, [pairs_table(comparison)])
    else:
        sections = [
            Section(note=at_top, charts=overview(flights), tables=[pairs_table(comparison)]),
            Section(
                id="metrics",
                title="Errors and metrics",
                note=" ".join([ERRORS, *below]),
                charts=panels.errors(flights),
                tables=[comparison_table("metrics", comparison.metrics)],
            ),
            _commands_section(flights),
        ]
    return write_answer(
        path,
        summary=comparison.gains_notes,
        parts={section.id: section for section in sections},
        title=f"{scenario.get('title', 'Flight')}: comparison",
        legend=list(styles.items()),
        styles=styles,
        provenance=tables.provenance_table(", ".join(sources), scenario_of(flown[0]), flown)
        if flown
        else facts_table("Versions", runs[0].provenance.versions),
        commands=f"flighttune compare {' '.join(sources)}",
        texts={"scenario.toml": toml_text(scenario)},
    )


def _scenario(source: Source, runs: Sequence[Run]) -> Scenario:
    """The one scenario of all runs, whatever their gains."""
    if not runs:
        raise RecordingError(f"{source.name}: a run must have flown, got none.")
    first, *scenarios = ({**run.provenance.scenario, "gains": None} for run in runs)
    for run, scenario in zip(runs[1:], scenarios, strict=True):
        if scenario != first:
            raise RecordingError(
                f"{source.name}: the runs must be of one scenario, got another one for "
                f"{run.label} than for {runs[0].label}; use compare for those."
            )
    return scenario_of(runs[0])


def flown_in_words(scenario: Scenario, runs: Sequence[Run]) -> str:
    """Aircraft, airspeed, manoeuvre and weather of a scenario in one line."""
    aircraft = []
    for name in dict.fromkeys(filter(None, (run.provenance.aircraft for run in runs))):
        try:
            aircraft.append(load_aircraft(name).title)
        except FlightTuneError:  # of somebody else's recording
            aircraft.append(name)
    start, subject = stated_condition(scenario), "; ".join(aircraft) or "Guidance law"
    at = f"{subject}: at {scenario.airspeed_words}"
    if scenario.route is not None:
        passed = len(scenario.route.waypoint)
        return f"{at} in {scenario.air}, {passed} waypoints."
    t = np.linspace(0.0, scenario.flight.duration_s, ANGLES)
    chi, gamma = reference_of(scenario).sampled(t)
    course, climb = _moves("course", start.chi, chi), _moves("path angle", start.gamma, gamma)
    if "goes from" in course:
        climb = climb.replace("goes from", "from")  # the page has no room to say it twice
    angles = f"{course} and {climb}"
    return f"{at} in {scenario.air}, {angles}."


def _moves(name: str, start: float, reference: FloatArray) -> str:
    """Words for the reference of an angle, in degrees, from the angle at the start."""
    path = np.round(DEG_PER_RAD * np.append(start, reference), 1) + 0.0
    first, last, low, high = (f"{end:g}°" for end in (path[0], path[-1], path.min(), path.max()))
    if low == high:
        return f"the {name} stays at {first}"
    if {first, last} == {low, high}:
        return f"the {name} goes from {first} to {last}"
    if first == last and first in (low, high):
        return f"the {name} goes from {first} to {high if first == low else low} and back"
    return f"the {name} moves between {low} and {high}"


def _gains_in_words(scenario: Scenario, runs: Sequence[Run]) -> str:
    """Sources of the gains of the runs, in one line."""
    identified = "largest R_K on the identified aircraft"
    on_the_law = f"largest R_K with I_K ≤ {scenario.tuning.I_star:g} on the guidance law"
    origins = {
        "paper": "K*, arXiv 2411.13140",
        TUNED: identified if scenario.tuning.model == "identified" else on_the_law,
        TUNED_IDENTIFIED: identified,
        TUNED_FED_BACK: "least errors in turbulence on the identified aircraft, fed back",
    }
    names = dict.fromkeys(run.provenance.gains_name.split(":")[-1] for run in runs)
    sets = (f"{origins.get(name, 'those of the scenario')} ({name})" for name in names)
    return f"Gains: {', '.join(sets)}."


def _gaps(scenario: Scenario, runs: Sequence[Run]) -> tuple[list[Gap], list[str]]:
    """Gaps of the first aircraft, nominal and off-nominal; reasons for the missing ones."""
    gaps, without = [], []
    aircraft = scenario.aircraft
    plants = {table.label for table in aircraft if table.aircraft == aircraft[0].aircraft}
    for run in runs:
        if run.provenance.plant not in plants:
            continue
        if len(run.signals) > LONGEST_LADDER:
            without.append(
                f"{run.label}: {len(run.signals)} samples are more than {LONGEST_LADDER}; "
                "flighttune gap flies the ladder of a flight of any length."
            )
            continue
        try:
            gaps.append(explain_flight(scenario, run))
        except FlightTuneError as error:
            without.append(f"{run.label}: {error}")
    return gaps, without


def _areas(runs: Sequence[Run]) -> tuple[str, list[str]]:
    """Captions of tubes and bands: at the top on a route, and below the errors."""
    first, words = priority_notes(runs), claim_notes(runs)
    if "along" in runs[0].signals:
        return " ".join([*first, *words]), []
    return " ".join(first), words


def overview(flights: panels.Drawn) -> list[Chart]:
    """The charts at the top: of a route on a map and along it, else of course and path angle."""
    return route_charts(flights) or panels.tracking(flights)


def _commands_section(flights: panels.Drawn, note: str = "") -> Section:
    # The path along a route is drawn at the top.
    path = [] if planned_path(flights) else panels.paths(flights)
    title = "Commands and path" if path else "Commands"
    return Section(id="commands", title=title, note=note, charts=[*panels.commands(flights), *path])


def _gap_section(gaps: Sequence[Gap], runs: Sequence[Run]) -> Section:
    more = len(gaps) - MAX_GAPS
    return Section(
        id="gap",
        title="From the law to the aircraft",
        note=GAP
        + "".join(f" {sentence}" for gap in gaps[:MAX_GAPS] for sentence in gap.causes)
        + (f" The tables have {more} more." if more > 0 else ""),
        charts=[
            kind(gap, channel)
            for gap in gaps[:MAX_GAPS]
            for channel in CHANNEL_SYMBOLS
            for kind in (itae_chart, steps_chart, bound_chart)
        ],
        columns=3,
        tables=[replace(step_table(gaps), name="gap"), tables.paths_table(runs)],
        legend=False,
    )


def _certificate_section(scenario: Scenario, flights: panels.Drawn) -> Section:
    """Certificates of the gains, bounds of flights of the law, and the frontier with the gains."""
    sets = {run.provenance.gains_name: run.provenance.gains for run, _ in flights}
    gains = {name: gain_set for name, gain_set in sets.items() if gain_set is not None}
    bounds = {run.label: bound for run, _ in flights if (bound := linear_bound(run)) is not None}
    curve = frontier(
        tuning_problem(scenario),
        points=FRONTIER_POINTS,
        marked=gains,
        starts=0,  # drawn gains find the same curve in twice the time
    )
    # A gain set has the style of its run on the last plant, the strongest.
    marks = {run.provenance.gains_name: style for run, style in flights}
    charts = panels.certificate_panels(flights, bounds)
    stable = "frontier" in set(curve["name"])
    if stable:
        charts += [frontier_chart(curve, marks, against=key) for key in ("I_K", "E_K")]
    notes = [BOUND if bounds else NO_BOUND, "" if stable else NO_CURVE]
    return Section(
        id="certificate",
        title="Certificate",
        note=" ".join(filter(None, notes)),
        charts=charts,
        tables=[tables.gains_table(gains, curve), tables.certificates_table(scenario, gains)],
    )
