"""The frontier of R_K against I_K of a scenario, with the paper's gains and its own."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flighttune.control.gains import paper_family
from flighttune.errors import InputError
from flighttune.files.whole import write_text
from flighttune.flight.load import as_scenario
from flighttune.flight.models import gain_set, tuning_problem
from flighttune.present.answer import Answer, Answering, Table
from flighttune.present.chart import Sheet
from flighttune.present.names import columns
from flighttune.present.palette import line_styles
from flighttune.scenario.schema import Scenario
from flighttune.tuning.frontier import POINTS, frontier_chart
from flighttune.tuning.frontier import frontier as frontier_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frontier(Answering):
    """The largest R_K for each I_K of a scenario, and where gain sets lie.

    Attributes
    ----------
    scenario : Scenario
    table : DataFrame
        A row each point (``name`` is ``frontier``) and gain set: ``I_K`` and ``E_K`` in s^2,
        ``R_K`` and ``spectral_abscissa`` in 1/s, and the gains.

    Examples
    --------
    >>> files = ft.frontier("paper", points=3).save("runs/paper")
    """

    scenario: Scenario
    table: "pd.DataFrame"

    @property
    def sheet(self) -> Sheet:
        """R_K against I_K, and the same gains against E_K."""
        styles = line_styles([("", name) for name in self.scenario.gain_names])
        by_name = {name: style for (_, name), style in styles.items()}
        charts = [frontier_chart(self.table, by_name, against=key) for key in ("I_K", "E_K")]
        return Sheet(charts=charts, columns=1)

    def save(self, folder: str | Path) -> dict[str, Path]:
        """Write ``frontier.csv`` and ``frontier.svg`` into a folder."""
        csv, figure = (Path(folder) / f"frontier.{ending}" for ending in ("csv", "svg"))
        write_text(csv, self.table.to_csv(index=False, lineterminator="\n"))
        self.sheet.save(figure)
        return {"csv": csv, "figure": figure}

    def answer(self) -> Answer:
        """The points of the frontier, and the gain sets by name."""
        shown = columns("name I_K E_K R_K spectral_abscissa")
        rows = self.table[[column.key for column in shown]].to_dict(orient="records")
        return Answer(
            values={
                "points": [row for row in rows if row["name"] == "frontier"],
                "marked": {row["name"]: row for row in rows if row["name"] != "frontier"},
            },
            tables=[Table(shown, rows, self.scenario.title)],
        )


def frontier(
    source: Scenario | str | Path,
    *,
    points: int = POINTS,
    changes: Mapping[str, Any] | None = None,
) -> Frontier:
    """Find the largest R_K for each I_K, beside the paper's and the scenario's gains.

    25 points take some seconds.

    Parameters
    ----------
    source : Scenario, str or Path
        A scenario, its file, or the name of a shipped one.
    points : int
        Points of the frontier, at least 2; from the smallest I_K on, closest there.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.

    Returns
    -------
    Frontier
        The gain sets alone if no stable gains were found within the limits.

    Raises
    ------
    InputError, ScenarioError
        If the scenario cannot be read, its objective is E_K or decay, or `points` is less than 2.

    Examples
    --------
    >>> sorted(set(ft.frontier("paper", points=3).table["name"]))[-3:]
    ['frontier', 'paper', 'tuned']
    """
    scenario = as_scenario(source, changes)
    objective = scenario.tuning.objective
    if objective in ("E_K", "decay"):
        raise InputError(
            "`objective` of [tuning] must be R_K or cost for a frontier, which is the largest R_K "
            f"for each I_K, got {objective}; `tune` finds those gains."
        )
    law, flight = scenario.laws[0], scenario.flight
    names = [name for name in scenario.gain_names if scenario.law_of(name)[0].by_gains]
    sets = {**paper_family(), **{name: gain_set(scenario, name) for name in names}}
    marked = {
        name: law.gains_from(gains, V_a=flight.V_a_mps, g=flight.g_mps2)
        for name, gains in sets.items()
        if gains is not None
    }
    table = frontier_table(tuning_problem(scenario), points=points, marked=marked)
    return Frontier(scenario=scenario, table=table)
