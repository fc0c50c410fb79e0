"""Reports as self-contained HTML files on runs of a scenario, a comparison or a log."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from flighttune.base.errors import FlightTuneError, RecordingError
from flighttune.base.files.table import toml_text
from flighttune.base.signals import CHANNEL_SYMBOLS
from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import listed, pick, sentence
from flighttune.claims.band import Band
from flighttune.claims.linear_loop import linear_bound
from flighttune.claims.monitor import LogMonitor, Monitor
from flighttune.control.gains_keys import TUNED, TUNED_FED_BACK, TUNED_GENTLE, TUNED_IDENTIFIED
from flighttune.control.tuning.tune import frontier
from flighttune.flight.flown import check_claim
from flighttune.flight.loop.run import Run
from flighttune.flight.models import tuning_problem
from flighttune.flight.scenario.load import gains_notes, scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps import compare
from flighttune.gaps.gap import Gap, explain_flight
from flighttune.gaps.tracking import tracked
from flighttune.gaps.watch import score_so_far
from flighttune.outputs.answers.advice import advice
from flighttune.outputs.answers.answer import Answer, Table, facts_table
from flighttune.outputs.answers.band import width
from flighttune.outputs.answers.compare import comparison_table, pairs_table, verdicts
from flighttune.outputs.answers.finding import PartFinding, unmet
from flighttune.outputs.answers.gap import causes, step_table
from flighttune.outputs.answers.run import (
    claim_notes,
    claimed,
    not_claimed,
    priority_notes,
    run_styles,
)
from flighttune.outputs.answers.tuning import frontier_chart
from flighttune.outputs.answers.verdict import closest, short
from flighttune.outputs.drawing.chart import Chart
from flighttune.outputs.drawing.palette import HUES, LIMIT
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.pages import charts, panels
from flighttune.outputs.pages.frame import Report, Section, write_answer, write_page
from flighttune.outputs.pages.panels import TEXTS, by_plant, flown_in_words, provenance_table

STRONG, _ = (colour for colour, _ in HUES[0])

# Signals of logs, at the top and below.
ABOVE, BELOW = "chi gamma", "phi phi_cmd n_z n_z_cmd V_a V_g"

# Rows of the table on a log.
LOG_FACTS = {
    "phases": "flight modes",
    "sensors": "sensors",
    "checks": "units and signs",
    "missing": "missing signals",
    "gaps": "gaps",
}

# Maximum number of gain sets with a chart of their gap; the table has all.
MAX_GAPS = 3

# Longest aircraft run for which a report flies the ladder: longer runs would take minutes.
LONGEST_LADDER = 6_000

# Tables of runs that a terminal also shows; ``--json`` has all records.
PRINTED = ("convergence", "certificates", "aircraft")


def write_log_page(
    source: compare.Source,
    path: Path,
    monitors: Sequence[Monitor | LogMonitor] = (),
    corridors: Sequence[Band] = (),
) -> Report:
    """Write one self-contained page about the log of a real flight, with its parent folders.

    The errors of its track stand beside the corridors.
    """
    (run,), styles = source.runs, run_styles(source.runs)
    log = run.provenance.log or {}
    stated = {key: log.get(key, ()) for key in LOG_FACTS}
    part = f"{run.duration:.1f} s from {log['from_s']:g} s on, {len(run.signals)} samples"
    facts = {"log": f"{log['file']} ({log['kind']})", "part": part}
    facts |= {
        LOG_FACTS[key]: " ".join(map(sentence, lines)) for key, lines in stated.items() if lines
    }
    summary, alarms, scores, failure = [f"A real flight of {run.duration:.1f} s."], [], [], ""
    unclaimed = list[str]()
    for monitor in monitors:
        score, alarm = score_so_far(monitor.watches, run), None
        said = f"No alarm from {monitor.watches[0].from_s:g} s on."
        if no_claim := monitor.not_about(run):
            said = f"{run.label}: no claim about this flight: {no_claim}."
            unclaimed.append(said)
        elif (alarm := monitor.alarm(run)) is not None:
            said = alarm.sentence
            failure = failure or said
        alarms.append(alarm and alarm._asdict())
        chart = Chart(title=f"Largest score so far: {said}", y="score [1]")
        chart.line(run.t[-len(score) :], score, STRONG)
        chart.level(1.0, LIMIT)
        scores.append(chart)
        summary += [*([] if no_claim else [said]), f"The monitor: {monitor.sentence}."]
    summary = [*unclaimed, *summary, *_tracked(run, corridors)]
    watched = Section(id="monitor", title="Monitor", charts=scores, legend=False)
    sections = _of_logs([(run, styles[run.label])], facts_table("The log", facts))
    page = write_answer(
        path,
        summary=summary,
        parts={section.id: section for section in (watched, *sections)},
        title=str(run.provenance.scenario["title"]),
        legend=list(styles.items()),
        styles=styles,
        provenance=facts_table("Versions", run.provenance.versions),
        commands=f"flighttune report {source.name}",
    )
    notes = [*summary, *(line for lines in stated.values() for line in lines)]
    values = {"bytes": path.stat().st_size, "summary": summary, "log": log, "alarms": alarms}
    open_ones = [PartFinding(found="open", reason=said) for said in unclaimed]
    shown = Answer(values=values, notes=notes, findings=[*unmet(failure), *open_ones])
    return replace(page, shown=shown)


def _tracked(run: Run, corridors: Sequence[Band]) -> list[str]:
    """Sentences on the errors of track where a log is straight, and on each corridor."""
    if not (sizes := tracked(run)):
        return ["The log has no track on a straight part of its flight."] * bool(corridors)
    said = listed([f"its {word} within {size:.2g} m" for word, size in sizes.items()])
    return [
        f"Where the flight is straight, the autopilot sees {said} for 95 % of the time. The true "
        "error is at most as much as that and the error of navigation together.",
        *(width(band) for band in corridors),
    ]


def _of_logs(flights: panels.Drawn, table: Table) -> list[Section]:
    """Sections about flights with at least one log: signals of any of them."""
    there = {name for run, _ in flights for name in run.signals}
    above, below = (
        panels.flown_signals(flights, " ".join(x for x in signals.split() if x in there))
        for signals in (ABOVE, BELOW)
    )
    return [
        Section(note=TEXTS["log"], charts=[*above, *panels.paths(flights)], tables=[table]),
        Section(id="commands", title="Commands, load and speed", charts=below),
    ]


def write_report(source: compare.Source, path: Path) -> Report:
    """Write one self-contained page about the runs of a scenario."""
    runs = _of_one_scenario(source)
    scenario, origin, styles = scenario_of(runs[0]), runs[0].provenance, run_styles(source.runs)
    claim, around = check_claim(scenario, source.runs), claimed(source.runs)
    convergence = panels.convergence_table(source.runs, claim)
    gaps, without_gap = _gaps(scenario, runs)
    first = [f"{short(claim)}.", f"Converged: {_converged(source, convergence)}."]
    lacks = [f"{source.lacks}: the rest is about the others."] if source.lacks else []
    next_step = advice(scenario, source.runs, "SCENARIO")
    failed = [around.failure] if around.failure else []
    page = write_page(
        path,
        page_template("flighttune.outputs.pages", "page.html.jinja"),
        about=(flown_in_words(scenario, runs), _gains_in_words(scenario, runs)),
        summary=tuple(
            dict.fromkeys([*lacks, *around.summary, *first, *failed, *gains_notes(runs)])
        ),
        closest=f"{tightest}." if (tightest := closest(claim)) else "",
        missed=(*claim.missed, *claim.held, *([next_step] if next_step else [])),
        criterion=TEXTS["converges"].format(
            part=100.0 * panels.CONVERGED_PART, least=panels.CONVERGED_AT_LEAST * DEG_PER_RAD
        ),
        sections=_sections(source, [(run, styles[run.label]) for run in runs], convergence, gaps),
        title=scenario.title,
        claim=scenario.verifies,
        refused=first[0] if claim.verdict == "not met" else "",
        legend=[(run.label, styles[run.label]) for run in runs],
        styles=styles,
        without_gap=without_gap,
        missing=source.missing,
        provenance=provenance_table(source.name, scenario, runs),
        scenario_text=toml_text(origin.scenario),
        first_gains=next((run.provenance.gains_name for run in runs if run.provenance.gains), None),
        version=origin.versions.get("flighttune", ""),
    )
    shown = _shown(source, page, around, [*gains_notes(runs), *around.notes])
    return replace(page, shown=replace(shown, lines=(*lacks, *around.summary, *first)))


def _of_one_scenario(source: compare.Source) -> list[Run]:
    """The runs that flew; RecordingError without any, or if they belong to several scenarios."""
    runs = [run for run in source.runs if len(run.signals) > 1]
    if not runs:
        raise RecordingError(f"{source.name}: a run must have flown, got none.")
    for run in runs[1:]:
        first, other = ({**x.provenance.scenario, "gains": None} for x in (runs[0], run))
        if other != first:
            raise RecordingError(
                f"{source.name}: the runs must be of one scenario, got another one for "
                f"{run.label} than for {runs[0].label}; use compare for those."
            )
    return runs


def _converged(source: compare.Source, convergence: Table) -> str:
    """Number of runs that converge, by plant."""
    return by_plant(
        (run.provenance.plant, record["converges"], 1)
        for run, record in zip(source.runs, convergence.records, strict=True)
    )


def _sections(
    source: compare.Source, flights: panels.Drawn, convergence: Table, gaps: Sequence[Gap]
) -> list[Section]:
    """Sections on flights with errors and commands, gaps and certificates."""
    runs = [run for run, _ in flights]
    below = [panels.tracking_table(runs), panels.runs_table(source.runs)]
    return [
        *_of_flights(flights, convergence, below, "Commands after magnitude and rate limits."),
        *([_gap_section(gaps, runs)] if gaps else []),
        _certificate_section(scenario_of(runs[0]), flights),
    ]


def _shown(source: compare.Source, page: Report, around: Answer, notes: Sequence[str]) -> Answer:
    """The answer of a page for a terminal; `around` are the claims about its runs."""
    named = [table for table in page.tables if table.name]
    return Answer(
        values={
            "bytes": page.path.stat().st_size,
            "missing": source.missing,
            **pick(page, "summary sections"),
            "tables": {table.name: table.records for table in named},
            **around.values,
        },
        tables=[replace(table, name="") for table in named if table.name in PRINTED],
        notes=[*notes, *(f"missing: {line}" for line in source.missing)],
        findings=[*unmet(source.lacks, 2), *around.findings],
    )


def write_comparison_page(comparison: compare.Comparison, path: str | Path) -> Report:
    """Write one self-contained page about comparable runs."""
    runs, sources = compare.overlaid(comparison), compare.sources_of(comparison)
    flown, styles = [run for run in runs if not run.provenance.log], run_styles(runs)
    flights, pairs = [(run, styles[run.label]) for run in runs], pairs_table(comparison)
    scenario = (flown or runs)[0].provenance.scenario
    if len(flown) < len(runs):
        sections = _of_logs(flights, pairs)
    else:
        metrics = comparison_table("metrics", comparison.metrics)
        sections = _of_flights(flights, pairs, [metrics])
    return write_answer(
        path,
        summary=[*verdicts(comparison), *comparison.gains_notes],
        parts={section.id: section for section in sections},
        title=f"{scenario.get('title', 'Flight')}: comparison",
        legend=list(styles.items()),
        styles=styles,
        provenance=provenance_table(", ".join(sources), scenario_of(flown[0]), flown)
        if flown
        else facts_table("Versions", runs[0].provenance.versions),
        commands=f"flighttune compare {' '.join(sources)}",
        texts={"scenario.toml": toml_text(scenario)},
    )


def write_gap_page(gap: Gap, tables: Sequence[Table], path: Path) -> Report:
    """Write one self-contained page about a gap whose aircraft flew."""
    origin = gap.aircraft.provenance
    note = [TEXTS["claim_of_aircraft"], *claim_notes([gap.aircraft])]
    return write_answer(
        path,
        title=f"From the law to the aircraft: {gap.scenario.title}; gains {gap.name}",
        about=(flown_in_words(gap.scenario, gap.runs),),
        summary=[*not_claimed([gap.aircraft]), *causes(gap), *gap.scenario.assumptions],
        parts={
            "responses": Section(
                title="Plants from the law to the aircraft: ITAE, flights, and what each step adds",
                note=note,
                charts=charts.gap_charts(gap),
            ),
            "numbers": Section(title="Plants, steps and their measures", tables=tables),
        },
        styles=run_styles(gap.runs),
        provenance=provenance_table(gap.scenario.title, gap.scenario, gap.runs),
        commands=f"flighttune gap scenario.toml --gains {origin.gains_name}",
        texts={"scenario.toml": toml_text(origin.scenario)},
    )


def _gains_in_words(scenario: Scenario, runs: Sequence[Run]) -> str:
    """Sources of the gains of the runs, in one line."""
    identified = "largest R_K on the identified aircraft"
    tuned, tuning = identified, scenario.tuning
    if tuning.lag_s is not None:
        tuned = "fastest decay behind lags of {:g} to {:g} s".format(*tuning.lag_s)
    elif tuning.model == "kinematic":
        tuned = f"largest R_K with I_K ≤ {tuning.I_star:g} on the guidance law"
    origins = {
        "paper": "K*, arXiv 2411.13140",
        TUNED: tuned,
        TUNED_IDENTIFIED: identified,
        TUNED_FED_BACK: "least errors in turbulence on the identified aircraft, fed back",
        TUNED_GENTLE: "least errors under bounds on command rates on the identified aircraft",
    }
    names = dict.fromkeys(run.provenance.gains_name.split(":")[-1] for run in runs)
    sets = (f"{origins[name]} ({name})" if name in origins else name for name in names)
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


def overview(flights: panels.Drawn) -> list[Chart]:
    """The charts at the top: of a route on a map and along it, else of course and path angle."""
    return charts.route_charts(flights) or panels.tracking(flights)


def _of_flights(
    flights: panels.Drawn, at_top: Table, below: Sequence[Table], commands: str = ""
) -> list[Section]:
    """Sections about flights: overview, errors with metrics, commands."""
    runs = [run for run, _ in flights]
    first, areas = priority_notes(runs), claim_notes(runs)
    # For a route, the top shows tubes, bands and the path.
    path = [] if charts.planned_path(flights) else panels.paths(flights)
    on_route = "along" in runs[0].signals
    return [
        Section(
            note=[*first, *(areas if on_route else [])], charts=overview(flights), tables=[at_top]
        ),
        Section(
            id="tracking",
            title="Errors and metrics",
            note=[TEXTS["errors"], *([] if on_route else areas)],
            charts=panels.errors(flights),
            tables=below,
        ),
        Section(
            id="commands",
            title="Commands and path" if path else "Commands",
            note=commands,
            charts=[*panels.commands(flights), *path],
        ),
    ]


def _gap_section(gaps: Sequence[Gap], runs: Sequence[Run]) -> Section:
    shown, more = gaps[:MAX_GAPS], len(gaps) - MAX_GAPS
    note = [TEXTS["gap"], *(cause for gap in shown for cause in causes(gap))]
    note += [f"The tables have {more} more."] if more > 0 else []
    kinds = (charts.itae_chart, charts.steps_chart, charts.bound_chart)
    return Section(
        id="gap",
        title="From the law to the aircraft",
        note=note,
        charts=[kind(gap, x) for gap in shown for x in CHANNEL_SYMBOLS for kind in kinds],
        columns=3,
        tables=[replace(step_table(gaps), name="gap"), panels.paths_table(runs)],
        legend=False,
    )


def _certificate_section(scenario: Scenario, flights: panels.Drawn) -> Section:
    """Certificates of the gains, bounds on flights of the law, and the frontier with the gains."""
    sets = {run.provenance.gains_name: run.provenance.gains for run, _ in flights}
    gains = {name: gain_set for name, gain_set in sets.items() if gain_set is not None}
    bounds = {run.label: bound for run, _ in flights if (bound := linear_bound(run)) is not None}
    curve = frontier(
        tuning_problem(scenario),
        points=9,
        marked=gains,
        starts=0,  # searches from random gains find the same curve in twice the time
    )
    # A gain set has the style of its run on the last plant, which is the strongest.
    marks = {run.provenance.gains_name: style for run, style in flights}
    curves, notes = panels.certificate_panels(flights, bounds), ["bound" if bounds else "no_bound"]
    if "frontier" in set(curve["name"]):
        curves += [frontier_chart(curve, marks, against=key) for key in ("I_K", "E_K")]
    else:
        notes.append("no_curve")
    return Section(
        id="certificate",
        title="Certificate",
        note=[TEXTS[note] for note in notes],
        charts=curves,
        tables=[panels.gains_table(gains, curve), panels.certificates_table(scenario, gains)],
    )
