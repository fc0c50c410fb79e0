"""Pages of gains, from a search that flies candidates or from a tuning."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError
from flighttune.base.files.table import toml_text
from flighttune.base.words import listed
from flighttune.campaigns.planning.plan import plain
from flighttune.control.gains import PIGains
from flighttune.control.gains_keys import TUNED, GainsTable
from flighttune.control.tuning.result import TuningResult
from flighttune.flight.flown import BoundCheck, FlownScenario
from flighttune.flight.fly import fly
from flighttune.flight.gains import certify_scenario
from flighttune.flight.models import gain_set
from flighttune.flight.scenario.schema import Scenario
from flighttune.outputs.answers.answer import Column, Table
from flighttune.outputs.answers.labels import in_words, measure_words, metric_label
from flighttune.outputs.answers.meeting import (
    CERTIFICATE_COLUMNS,
    REQUIREMENT_COLUMNS,
    sentence,
    worse_sentence,
)
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing.chart import DASHED, Chart
from flighttune.outputs.drawing.palette import HUES, INK, LIMIT, NEUTRAL
from flighttune.outputs.pages import panels
from flighttune.outputs.pages.frame import Report, Section, write_answer
from flighttune.outputs.pages.page import overview
from flighttune.outputs.pages.panels import TEXTS, by_plant, provenance_table
from flighttune.studies.meet import stated
from flighttune.studies.meeting import Meeting, Trial
from flighttune.vehicles.plants.base import goes_by

# A tuning is not a search with requirements; its page compares its gains with the paper's.
CHECKED_COLUMNS = [
    Column("start", "with the paper's gains") if column.key == "start" else column
    for column in REQUIREMENT_COLUMNS
]

# Maximum number of charts: pairs of the requirements with the smallest margins
PAIRS = 3

PAPER = "paper"


def write_meet_page(path: Path, meeting: Meeting, command: str) -> Report:
    """Write the page of a search, which `command` repeats; this flies start and result again."""
    rows, trials, counted = meeting.requirements, meeting.trials, meeting.success
    required, trades, gains, *drawn, loop, margins, certificate, ended = meeting.answer().tables
    note = ""
    if counted:
        charts = [share_chart(trials, counted["wanted"])]
        note = (
            f"Of the {counted['share']['n']} fresh draws the one nearest to a bound, number "
            f"{counted['worst_draw']}, with the gains of the start and those found."
        )
    else:
        charts = [chart(trials, rows, i, k) for i, k in nearest_pairs(rows)]
    start = meeting.scenario.listed_as(meeting.start)
    sets = {start: meeting.start_gains, "found": meeting.gains}
    costs = TEXTS["shares" if counted else "candidates"]
    return _write(
        path,
        f"Requirements and gains: {meeting.scenario.title}",
        meeting.scenario,
        sets,
        _flown(meeting.worst or meeting.scenario, sets),
        summary=[
            *filter(None, [sentence(meeting), worse_sentence(meeting)]),
            *meeting.tuned_for.get("assumed", ()),
        ],
        parts={
            "requirements": Section(tables=[replace(required, title="")]),
            "responses": Section(title=f"Flights with {start} and with the gains found", note=note),
            "margins": Section(note=TEXTS["margins"], tables=[margins, gains]),
            "costs": Section(note=costs, charts=charts, tables=[trades], legend=False),
            "flown": Section(
                title="Drawn values, and flights that ended early", tables=[*drawn, ended]
            ),
            "claim": Section(
                title="Certificate and indicators", note=TEXTS["proven"], tables=[certificate, loop]
            ),
        },
        commands=command,
        campaign=toml_text(plain(meeting.campaign)) if meeting.campaign else "",
    )


def write_tune_page(path: Path, scenario: Scenario, result: TuningResult, command: str) -> Report:
    """Write the page of tuned gains, which `command` repeats, beside the paper's gains."""
    if result.gains is None:
        raise InputError(f"{path}: `gains` must be there for a page, got none: {result.reason}")
    law = scenario.laws[0]
    paper = gain_set(scenario, law.names_of([PAPER])[0])
    sets = {PAPER: paper or result.gains, TUNED: result.gains}
    flies, left_out = _without_code(scenario, path)
    flown = _flown(flies, sets)
    before = {_about(check): check.value for check in flown.claim.bounds if PAPER in check.run}
    checks = [check for check in flown.claim.bounds if TUNED in check.run]
    rows = [
        {**stated(check), "run": _about(check)[0], "start": before.get(_about(check))}
        for check in checks
    ]
    met = by_plant((_about(check)[0], check.met, 1) for check in checks)
    limits = f", limited by {listed(result.active)}" if result.active else ""
    tuning, gains, *margins = result.answer().tables
    certified = certify_scenario(scenario, result.gains, law=law).values
    return _write(
        path,
        f"Tuned gains: {scenario.title}",
        scenario,
        sets,
        flown,
        summary=[
            *([f"Requirements met: {met}"] if met else []),
            f"R_K is {result.R_K:.4g} 1/s with an I_K of {result.I_K:.4g} s²{limits}",
            *scenario.assumptions,
        ],
        parts={
            "requirements": Section(tables=[Table(CHECKED_COLUMNS, [*map(in_words, rows)])]),
            "responses": Section(
                title="Flights with the paper's gains and the tuned ones", note=left_out
            ),
            "margins": Section(note=TEXTS["margins"], tables=[*margins, gains]),
            "claim": Section(
                title="Certificate and tuning",
                note=TEXTS["proven"],
                tables=[Table(CERTIFICATE_COLUMNS, [certified]), tuning],
            ),
        },
        commands=command,
    )


def _flown(scenario: Scenario, sets: Mapping[str, PIGains]) -> FlownScenario:
    """Flights of a scenario by gain sets of its first law, with its requirements for all gains."""
    tables = [GainsTable(name=name, **gains.as_lists()) for name, gains in sets.items()]
    expect = [table for table in scenario.expect if table.gains is None or table.gains in sets]
    flown = {"gains": tables, "law": [scenario.law_tables[0]], "expect": expect}
    return fly(scenario.model_copy(update=flown))


def _without_code(scenario: Scenario, path: Path) -> tuple[Scenario, str]:
    """The scenario without plants in Python files, and a note on omitted plants."""
    files = scenario.of_files((scenario.laws[0].name, *(plant.label for plant in scenario.plant)))
    plants = [plant for plant in scenario.plant if not plant.module]
    names, how = listed([table.module or "" for _, table in files]), "`flighttune fly` runs it"
    if not plants or any(key == "law" for key, _ in files):
        raise InputError(f"{path}: flights of a page must run no Python code, got {names}; {how}.")
    expect = [x for x in scenario.expect if any(goes_by(plant.label, x.plant) for plant in plants)]
    kept = scenario.model_copy(update={"plant": plants, "expect": expect}) if files else scenario
    return kept, f"Not flown, as that runs the Python code of {names}: {how}." if files else ""


def _about(check: BoundCheck) -> tuple[str, ...]:
    """The plant and the bounded measure of a requirement, for any gains."""
    return check.run.partition(" / ")[0], check.subject, check.measure, check.sense


def _write(
    path: Path,
    title: str,
    scenario: Scenario,
    sets: Mapping[str, PIGains],
    flown: FlownScenario,
    *,
    summary: Sequence[str],
    parts: Mapping[str, Section],
    commands: str,
    campaign: str = "",
) -> Report:
    """Write the page of flights by gain sets; the command repeats `scenario`."""
    styles = run_styles(flown.runs)
    flights = [(run, styles[run.label]) for run in flown.runs if len(run.signals) > 1]
    charts = [*overview(flights), *panels.commands(flights)] if flights else []
    return write_answer(
        path,
        title=title,
        summary=summary,
        about=(panels.flown_in_words(flown.scenario, flown.runs),),
        parts={**parts, "responses": replace(parts["responses"], charts=charts)},
        legend=[(run.label, style) for run, style in flights],
        styles=styles,
        provenance=provenance_table(scenario.title, scenario, flown.runs),
        commands=f"# with the files below in place of those of the command\n{commands}",
        texts={
            "scenario.toml": toml_text(scenario.as_dict()),
            "campaign.toml": campaign,
            **{f"{name}.json": json.dumps(gains.as_lists()) for name, gains in sets.items()},
        },
    )


def nearest_pairs(rows: Sequence[Mapping[str, Any]]) -> list[tuple[int, int]]:
    """Pairs of the requirements with the smallest margins, those without a value first."""
    margins = np.nan_to_num([row["margin"] for row in rows], nan=-np.inf)
    return list(combinations(np.argsort(margins, kind="stable")[:PAIRS].tolist(), 2))


def chart(trials: Sequence[Trial], rows: Sequence[Mapping[str, Any]], i: int, k: int) -> Chart:
    """All candidates by the values of two requirements, with their bounds."""
    across, up = rows[i], rows[k]
    x, y = (np.array([trial.checks[0][j].value for trial in trials]) for j in (i, k))
    met = [np.delete(trial.excess[0], [i, k]).max(initial=-1.0) <= 0.0 for trial in trials]
    plane = Chart(
        title=f"{measure_words(up['measure'])} against {measure_words(across['measure'])}",
        x=f"{metric_label(across['measure']).heading}, {across['run']}",
        y=f"{metric_label(up['measure']).heading}, {up['run']}",
        x_range=_range(x, across),
        y_range=_range(y, up),
    )
    plane.points(x, y, NEUTRAL, size=2.5, opacity=0.7, filled=met, name="candidate")
    plane.upright(across["bound"], LIMIT, dash=DASHED)
    plane.level(up["bound"], name="bound")
    plane.points(across["start"], up["start"], INK, shape="cross", size=5, name="start")
    plane.points(across["value"], up["value"], HUES[0][0][0], size=5, name="result")
    return plane


def share_chart(trials: Sequence[Trial], share: float) -> Chart:
    """Share of a search's draws on which each candidate meets all, in flown order."""
    chart = Chart(
        title="Flights that meet all requirements",
        x="gain set, in the order of the search",
        y="share of its flights [%]",
    )
    shares = [100.0 * float((trial.worst <= 0.0).mean()) for trial in trials]
    chart.points(
        range(1, len(shares) + 1), shares, NEUTRAL, size=2.5, opacity=0.7, name="candidate"
    )
    chart.level(100.0 * share, name="wanted")
    return chart


def _range(values: FloatArray, row: Mapping[str, Any]) -> tuple[float, float]:
    """Axis from the best value to a little beyond bound, start and result."""
    marked = [row[key] for key in ("bound", "start", "value") if math.isfinite(row[key])]
    finite = values[np.isfinite(values)]
    least, most = min([*marked, *finite]), max([*marked, *finite])
    wide = max(marked) - min(marked) or abs(row["bound"]) or 1.0
    low, high = max(least, min(marked) - wide), min(most, max(marked) + wide)
    room = 0.05 * (high - low) or wide  # no candidate has a value, so only the bound is drawn
    return low - room, high + room
