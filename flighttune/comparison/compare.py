"""The comparison: pairs of runs with their metrics, differences and distances."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from flighttune.comparison.pairs import (
    Row,
    differences,
    largest_distance,
    metric_rows,
    paired,
    until,
    why_not,
)
from flighttune.comparison.source import Source, load_source
from flighttune.errors import InputError
from flighttune.flight.fly import FlownScenario
from flighttune.present.names import shown_unit
from flighttune.present.numbers import number
from flighttune.present.tables import Column, Table, html
from flighttune.simulate.run import Run

SHOWN = ("ITAE", "MO_rad", "settling_s", "ST_rad")
"""Metrics shown in a notebook; `Comparison.metrics` has them all."""

MAX_PAIRS = 3
"""Pairs shown in a notebook."""

BETTER = {"a": "A", "b": "B"}
COMPARED = (
    Column("pair", "A | B"),
    Column("channel", "channel"),
    Column("metric", "metric"),
    Column("unit", "unit"),
    Column("a", "A", digits=".4f", missing="never"),
    Column("b", "B", digits=".4f", missing="never"),
    Column("diff", "B − A", digits=".4f", missing="-"),
    Column("better", "better"),
)
COLUMNS = ("pair", "run_a", "run_b", "channel", "name", "unit", "a", "b", "diff", "better")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two runs of one manoeuvre, compared."""

    # `a` and `b`: cut to the time both flew
    a: Run
    b: Run
    # Names of the sources of `a` and `b`
    source_a: str
    source_b: str
    # s: time that each of the two flew; `a` and `b` have no more than the shorter
    durations: tuple[float, float]
    max_distance: float  # m: largest distance of the two at the same time after the start
    t_max_distance: float  # s: when that was
    # Settings of the two scenarios that are not the same, by dotted key
    differs: dict[str, tuple[Any, Any]]
    status: tuple[str, str]  # status at the end of `a` and of `b`


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Comparison:
    """Runs side by side.

    Attributes
    ----------
    reason : str
        Why the sources cannot be compared: another manoeuvre, another aircraft; empty otherwise.
    pairs : tuple of Pair
        Every run of the first source with its partner in each of the others.
    metrics : DataFrame
        A row each pair, channel and metric; columns ``pair`` (its place in `pairs`), ``run_a``,
        ``run_b``, ``channel``, ``name``, ``unit``, ``a``, ``b``, ``diff`` (b minus a), ``better``
        (a, b, same, or empty).
    unpaired : tuple of str
        Runs without a partner, as ``source: label``.
    missing : tuple of str
        Runs that the sources recorded and cannot give.
    """

    reason: str = ""
    pairs: tuple[Pair, ...] = ()
    metrics: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=list(COLUMNS)))
    unpaired: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def comparable(self) -> bool:
        """Whether the flights can be compared."""
        return not self.reason

    @property
    def max_distance(self) -> float:
        """Largest distance of any pair, m; nan without pairs."""
        return max((pair.max_distance for pair in self.pairs), default=float("nan"))

    def _repr_html_(self) -> str:
        if not self.comparable:
            return html("Comparison: not comparable", (), [("reason", self.reason)])
        title = f"Comparison: paths at most {number(self.max_distance)} m apart"
        shown = self.metrics["name"].isin(SHOWN) & (self.metrics["pair"] < MAX_PAIRS)
        table = comparison_table(title, self.metrics.loc[shown])
        rows = table.rows
        if len(self.pairs) > MAX_PAIRS:
            more = f"{len(self.pairs) - MAX_PAIRS} more pairs in `metrics`"
            rows.append([more, *[""] * (len(table.columns) - 1)])
        return html(title, table.head, rows)


def comparison_table(title: str, metrics: pd.DataFrame) -> Table:
    """Metrics of pairs side by side, from rows of `Comparison.metrics`; angles in degrees."""
    records = []
    for row in metrics.to_dict(orient="records"):
        unit, factor = shown_unit(str(row["unit"]))
        records.append(
            {
                "pair": f"{row['run_a']} | {row['run_b']}",
                "channel": row["channel"],
                "metric": row["name"].removesuffix("_rad"),
                "unit": unit,
                **{key: row[key] * factor for key in ("a", "b", "diff")},
                "better": BETTER.get(str(row["better"]), row["better"]),
            }
        )
    return Table(title=title, columns=COMPARED, records=records, grouped=True)


def compare(
    a: str | Path | Run | FlownScenario | Source, *others: str | Path | Run | FlownScenario | Source
) -> Comparison:
    """Hold runs against those of the first source.

    Parameters
    ----------
    a : str, path-like, Run, FlownScenario or Source
        What the others are compared with. A string is what `load_source` takes: a run folder, a
        Parquet file, a recording or ``scenario@gains``.
    others : str, path-like, Run, FlownScenario or Source
        At least one more.

    Returns
    -------
    Comparison
        With `comparable` False and a reason where the manoeuvres (start, length, reference) or
        aircraft differ. A kinematic plant may be compared with an aircraft. Where one of two
        runs ended early, both are measured over the time both flew.

    Raises
    ------
    InputError
        If there is nothing to compare with, or a source cannot be read or flown.
    """
    if not others:
        raise InputError("`others` must hold at least one more source, got none.")
    first, *rest = (_source(runs_of, place) for place, runs_of in enumerate((a, *others)))
    pairs: list[Pair] = []
    unpaired: list[str] = []
    for other in rest:
        matched = paired(first.runs, other.runs)
        reason = why_not(first, other, matched)
        if reason:
            return Comparison(reason=reason)
        pairs += [_pair(first, other, *two) for two in matched]
        unpaired += _left_over(first, other, matched)
    rows: list[Row] = []
    for place, pair in enumerate(pairs):
        names: Row = {"pair": place, "run_a": pair.a.label, "run_b": pair.b.label}
        rows += [{**names, **row} for row in metric_rows(pair.a, pair.b)]
    return Comparison(
        pairs=tuple(pairs),
        metrics=pd.DataFrame(rows, columns=list(COLUMNS)),
        unpaired=tuple(dict.fromkeys(unpaired)),
        missing=tuple(line for source in (first, *rest) for line in source.missing),
    )


def _source(runs_of: str | Path | Run | FlownScenario | Source, place: int) -> Source:
    if isinstance(runs_of, Source):
        return runs_of
    if isinstance(runs_of, Run):
        return Source(name=f"{chr(ord('A') + place)}: {runs_of.label}", runs=(runs_of,))
    if isinstance(runs_of, FlownScenario):
        return Source(name=f"{chr(ord('A') + place)}: {runs_of.scenario.title}", runs=runs_of.runs)
    return load_source(runs_of)


def _pair(first: Source, second: Source, a: Run, b: Run) -> Pair:
    end = min(a.duration, b.duration)
    distance, at = largest_distance(a, b)
    return Pair(
        a=until(a, end),
        b=until(b, end),
        source_a=first.name,
        source_b=second.name,
        durations=(a.duration, b.duration),
        max_distance=distance,
        t_max_distance=at,
        differs=differences(a, b),
        status=(a.status, b.status),
    )


def _left_over(first: Source, second: Source, pairs: Sequence[tuple[Run, Run]]) -> list[str]:
    used = {id(run) for pair in pairs for run in pair}
    return [
        f"{source.name}: {run.label}"
        for source in (first, second)
        for run in source.runs
        if id(run) not in used
    ]
