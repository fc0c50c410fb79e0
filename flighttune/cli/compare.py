"""The command that holds runs against each other."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flighttune.cli.show import COULD_NOT_RUN, NO, JsonOption, fail, print_json, print_table, say
from flighttune.errors import InputError

if TYPE_CHECKING:
    from flighttune.comparison import Comparison, Pair, Violation

DEGREES = 180.0 / math.pi
BETTER = {"a": "A", "b": "B", "same": "same", "": ""}


def compare(
    first: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help="A run folder, a Parquet file, a recording or SCENARIO@GAINS, which is flown. "
            "Behind an @ a gain set, a plant or a run chooses among the runs of a folder.",
        ),
    ],
    others: Annotated[list[str], typer.Argument(metavar="B...", help="What to hold against A.")],
    tolerance: Annotated[
        Path | None,
        typer.Option(help="TOML file with the changes allowed; exit status 1 if one is exceeded."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Recording (.rrd) of all runs, one over the other.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Metrics of runs side by side, which is better, and how far apart they flew.

    Exit status 2 if manoeuvre, units or aircraft are not the same.
    """
    from flighttune.comparison import compare as compare_sources
    from flighttune.comparison import load_tolerances, violations

    if out is not None and out.suffix != ".rrd":
        raise InputError(f"{out}: --out must end in .rrd.")
    allowed = None if tolerance is None else load_tolerances(tolerance)
    found = compare_sources(first, *others)
    broken = violations(found, allowed) if allowed else []
    if out is not None and found.comparable:
        from flighttune.comparison.overlay import write_overlay

        write_overlay(found, out)
    if as_json:
        print_json(_json(found, broken, out if found.comparable else None))
    elif found.comparable:
        _print(found, broken, out)
    if not found.comparable:
        fail(found.reason, COULD_NOT_RUN)
    if allowed and found.unpaired:
        fail(
            f"{tolerance}: every run must have a partner to be checked, got none for "
            f"{', '.join(found.unpaired)}.",
            COULD_NOT_RUN,
        )
    if broken:
        more = f" ({len(broken) - 1} more)" if len(broken) > 1 else ""
        fail(f"{tolerance}: {broken[0].sentence}{more}", NO)


def _json(found: "Comparison", broken: list["Violation"], out: Path | None) -> dict[str, Any]:
    return {
        "comparable": found.comparable,
        "reason": found.reason,
        "metrics": found.metrics.to_dict(orient="records"),
        "max_distance_m": found.max_distance,
        "pairs": [
            {
                "run_a": pair.a.label,
                "run_b": pair.b.label,
                "source_a": pair.source_a,
                "source_b": pair.source_b,
                "status_a": pair.status[0],
                "status_b": pair.status[1],
                "compared_s": pair.a.duration,
                "max_distance_m": pair.max_distance,
                "max_distance_at_s": pair.t_max_distance,
                "differs": {key: list(values) for key, values in pair.differs.items()},
            }
            for pair in found.pairs
        ],
        "unpaired": list(found.unpaired),
        "missing": list(found.missing),
        "violations": [
            {
                "run_a": one.run_a,
                "run_b": one.run_b,
                "channel": one.channel,
                "name": one.name,
                "a": one.a,
                "b": one.b,
                "allowed": one.allowed,
            }
            for one in broken
        ],
        "recording": None if out is None else str(out),
    }


def _print(found: "Comparison", broken: list["Violation"], out: Path | None) -> None:
    for number, pair in enumerate(found.pairs):
        rows = found.metrics.loc[found.metrics["pair"] == number]
        _print_pair(pair, rows.to_dict(orient="records"))
    for one in found.missing:
        say(f"missing: {one}")
    for one in found.unpaired:
        say(f"no partner: {one}")
    for one in broken:
        say(f"out of tolerance: {one.sentence}")
    if out is not None:
        say(f"recording: {out}   (open it with: flighttune view {out})")


def _print_pair(pair: "Pair", rows: list[dict[Any, Any]]) -> None:
    say(f"A: {pair.source_a}: {pair.a.label}: {pair.status[0]}")
    say(f"B: {pair.source_b}: {pair.b.label}: {pair.status[1]}")
    for key, (one, other) in pair.differs.items():
        say(f"not the same: {key}: {one} and {other}")
    if pair.durations[0] != pair.durations[1]:
        say(f"flown for {pair.durations[0]:g} and {pair.durations[1]:g} s, compared over the less")
    cells = []
    for row in rows:
        name, unit, factor = _shown(row["name"], row["unit"])
        values = (_cell(float(row[key]) * factor) for key in ("a", "b", "diff"))
        cells.append((row["channel"], name, unit, *values, BETTER[row["better"]]))
    print_table(
        f"paths are {pair.max_distance:.3f} m apart at most, at {pair.t_max_distance:.2f} s",
        ("channel", "metric", "unit", "A", "B", "B - A", "better"),
        cells,
    )


def _shown(name: str, unit: str) -> tuple[str, str, float]:
    """Name and unit of a metric in the table and the factor to it: angles are in deg."""
    return (name.removesuffix("_rad"), "deg", DEGREES) if unit == "rad" else (name, unit, 1.0)


def _cell(value: float) -> str:
    return "never" if math.isnan(value) else f"{value:.4f}"
