"""The page of a search for gains that meet requirements: what conflicts, and all candidates."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.campaign.meet import Trial
from flighttune.flight.fly import library_versions
from flighttune.present.chart import DASHED, Chart
from flighttune.present.frame import Report, Section, page_template, write_page
from flighttune.present.palette import HUES, INK, LIMIT, NEUTRAL
from flighttune.present.tables import Table, facts_table
from flighttune.scenario.schema import Scenario
from flighttune.table_file import toml_text

# Charts on the page: pairs of the requirements that are met worst
PAIRS = 3


def write_meet_page(
    path: Path,
    scenario: Scenario,
    values: Mapping[str, Any],
    tables: Sequence[Table],
    trials: Sequence[Trial],
    summary: str,
    command: str,
) -> Report:
    """Write a page of the answer of `flighttune.campaign.meet.meet`."""
    rows = values["requirements"]
    worst = sorted(range(len(rows)), key=lambda i: rows[i]["margin"])[:PAIRS]
    pairs = combinations(worst, 2)
    return write_page(
        path,
        page_template("flighttune.report", "commands.html.jinja"),
        summary=(summary,),
        sections=[
            Section(
                id="candidates",
                title="Candidates",
                note="Every dot is a gain set that was flown; both requirements are met to the "
                "left of and below their bounds, or above where a bound is a least value.",
                charts=[chart(trials, rows, i, k) for i, k in pairs],
                tables=tables,
                legend=False,
                folded=False,
            )
        ],
        title=f"Requirements and gains: {scenario.title}",
        styles={},
        provenance=facts_table(
            "Provenance",
            {
                "scenario, SHA-256": scenario.sha256,
                "flown with": ", ".join(f"{x} {y}" for x, y in library_versions().items()),
            },
        ),
        commands=command,
        scenario_text=toml_text(scenario.as_dict()),
    )


def chart(trials: Sequence[Trial], rows: Sequence[Mapping[str, Any]], i: int, k: int) -> Chart:
    """All candidates by the values of two requirements, with the bounds of these."""
    across, up = rows[i], rows[k]
    x, y = (np.array([trial.checks[0][j].value for trial in trials]) for j in (i, k))
    others = [np.delete(trial.excess[0], [i, k]).max(initial=-1.0) <= 0.0 for trial in trials]
    made = Chart(
        title=f"{up['measure']} against {across['measure']}",
        x=f"{across['measure']}, {across['run']}",
        y=f"{up['measure']}, {up['run']}",
    )
    made.points(x, y, NEUTRAL, size=2.5, opacity=0.7, filled=others, name="candidate")
    made.upright(across["bound"], LIMIT, dash=DASHED)
    made.level(up["bound"], name="bound")
    made.points(across["start"], up["start"], INK, shape="cross", size=5, name="start")
    made.points(across["value"], up["value"], HUES[0][0][0], size=5, name="result")
    return made
