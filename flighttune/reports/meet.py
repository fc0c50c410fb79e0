"""The page of a search for gains that meet requirements: what conflicts, and all candidates."""

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.campaign.meeting import Meeting, Trial
from flighttune.campaign.planning.plan import plain
from flighttune.files.table import toml_text
from flighttune.flight.fly import library_versions
from flighttune.present.chart import DASHED, Chart
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.palette import HUES, INK, LIMIT, NEUTRAL
from flighttune.present.tables import facts_table

# Charts on the page: pairs of the requirements that are met worst
PAIRS = 3

NOTE = "Each dot is a gain set that was flown. A hollow one misses another requirement."
SHARE_NOTE = "Each dot is a gain set on the draws of the search; the result is counted on others."


def write_meet_page(
    path: Path,
    meeting: Meeting,
    command: str,
) -> Report:
    """Write a page of a search, which `command` repeats."""
    rows, trials, scenario = meeting.requirements, meeting.trials, meeting.scenario
    margins = np.nan_to_num([row["margin"] for row in rows], nan=-np.inf)
    worst = np.argsort(margins, kind="stable")[:PAIRS].tolist()
    counted = meeting.success
    charts = (
        [share_chart(trials, counted["wanted"])]
        if counted
        else [chart(trials, rows, i, k) for i, k in combinations(worst, 2)]
    )
    return write_page(
        path,
        page_template("flighttune.reports", "commands.html.jinja"),
        summary=tuple(filter(None, (meeting.start_sentence, meeting.sentence))),
        sections=[
            Section(
                id="candidates",
                title="Candidates",
                note=SHARE_NOTE if counted else NOTE if charts else "",
                charts=charts,
                tables=meeting.answer().tables,
                legend=False,
            )
        ],
        title=f"Requirements and gains: {scenario.title}",
        provenance=facts_table(
            "Provenance",
            {
                "scenario, SHA-256": scenario.sha256,
                "flown with": ", ".join(f"{x} {y}" for x, y in library_versions().items()),
            },
        ),
        commands=command,
        scenario_text=toml_text(scenario.as_dict()),
        campaign_text="" if meeting.campaign is None else toml_text(plain(meeting.campaign)),
    )


def chart(trials: Sequence[Trial], rows: Sequence[Mapping[str, Any]], i: int, k: int) -> Chart:
    """All candidates by the values of two requirements, with the bounds of these."""
    across, up = rows[i], rows[k]
    x, y = (np.array([trial.checks[0][j].value for trial in trials]) for j in (i, k))
    met = [np.delete(trial.excess[0], [i, k]).max(initial=-1.0) <= 0.0 for trial in trials]
    plane = Chart(
        title=f"{up['measure']} against {across['measure']}",
        x=f"{across['measure']} ({across['sense']} {across['bound']:g}), {across['run']}",
        y=f"{up['measure']} ({up['sense']} {up['bound']:g})",
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
    """Share of the draws of a search on which each candidate meets all, in the order of flying."""
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
    """From the best value to a little beyond bound, start and result: others are further off."""
    marked = [row[key] for key in ("bound", "start", "value") if math.isfinite(row[key])]
    finite = values[np.isfinite(values)]
    least, most = min([*marked, *finite]), max([*marked, *finite])
    wide = max(marked) - min(marked) or abs(row["bound"]) or 1.0
    low, high = max(least, min(marked) - wide), min(most, max(marked) + wide)
    room = 0.05 * (high - low) or wide  # no candidate has a value: the bound stands alone
    return low - room, high + room
