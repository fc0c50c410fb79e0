"""The command that compares runs."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flighttune.cli.options import check_ending
from flighttune.cli.show import COULD_NOT_RUN, NO, emit, fail, pick, table
from flighttune.present.names import shown_unit
from flighttune.present.numbers import number
from flighttune.present.tables import Table

if TYPE_CHECKING:
    from flighttune.comparison import Comparison, Pair, Violation

BETTER = {"a": "A", "b": "B", "same": "same", "": ""}


def compare(
    first: Annotated[
        str,
        Argument(
            metavar="A",
            help="A run folder, a Parquet file, a recording or SCENARIO@GAINS, which is flown. "
            "Append @ and a gain set, a plant or a run to choose among the runs of a folder.",
        ),
    ],
    others: Annotated[list[str], Argument(metavar="B...", help="What to compare A with.")],
    tolerance: Annotated[
        Path | None,
        Option(help="TOML file of allowed changes; exit status 1 if one is exceeded."),
    ] = None,
    out: Annotated[
        Path | None,
        Option(help="Recording (.rrd) or page (.html) to write, with all runs overlaid."),
    ] = None,
) -> None:
    """Compare runs: metrics, which is better, and how far apart the paths are.

    Exit status 2 if manoeuvre or aircraft differ.
    """
    from flighttune.comparison import compare as compare_sources
    from flighttune.comparison import load_tolerances, violations

    check_ending(out, ".rrd", ".html")
    allowed = None if tolerance is None else load_tolerances(tolerance)
    found = compare_sources(first, *others)
    broken = violations(found, allowed) if allowed else []
    if out is not None and found.comparable:
        if out.suffix.lower() == ".html":
            from flighttune.report.compare_page import write_comparison_page

            write_comparison_page(found, out)
        else:
            from flighttune.comparison.overlay import write_overlay

            write_overlay(found, out)
    out = out if found.comparable else None
    text = _text(found, broken, out) if found.comparable else ()
    emit(_json(found, broken, out), text)
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
    is_page = out is not None and out.suffix.lower() == ".html"
    return {
        **pick(found, "comparable reason"),
        "metrics": found.metrics.to_dict(orient="records"),
        "max_distance_m": found.max_distance,
        "pairs": [
            {
                "run_a": pair.a.label,
                "run_b": pair.b.label,
                **pick(pair, "source_a source_b"),
                "status_a": pair.status[0],
                "status_b": pair.status[1],
                "compared_s": pair.a.duration,
                "max_distance_m": pair.max_distance,
                "max_distance_at_s": pair.t_max_distance,
                "differs": pair.differs,
            }
            for pair in found.pairs
        ],
        **pick(found, "unpaired missing"),
        "violations": broken,
        "recording": None if is_page else out,
        "page": out if is_page else None,
    }


def _text(
    found: "Comparison", broken: list["Violation"], out: Path | None
) -> Iterator[Table | str]:
    for place, pair in enumerate(found.pairs):
        rows = found.metrics.loc[found.metrics["pair"] == place]
        yield from _pair_text(pair, rows.to_dict(orient="records"))
    for one in found.missing:
        yield f"missing: {one}"
    for one in found.unpaired:
        yield f"no partner: {one}"
    for one in broken:
        yield f"out of tolerance: {one.sentence}"
    if out is not None and out.suffix.lower() == ".html":
        yield f"page: {out}   (one file, it opens without a network)"
    elif out is not None:
        yield f"recording: {out}   (open it with: flighttune view {out})"


def _pair_text(pair: "Pair", rows: list[dict[Any, Any]]) -> Iterator[Table | str]:
    yield f"A: {pair.source_a}: {pair.a.label}: {pair.status[0]}"
    yield f"B: {pair.source_b}: {pair.b.label}: {pair.status[1]}"
    for key, (one, other) in pair.differs.items():
        yield f"not the same: {key}: {one} and {other}"
    if pair.durations[0] != pair.durations[1]:
        times = " and ".join(f"{duration:g}" for duration in pair.durations)
        yield f"flown for {times} s, compared over the shorter time"
    cells = []
    for row in rows:
        unit, factor = shown_unit(row["unit"])
        values = (
            number(float(row[key]) * factor, ".4f", missing="never") for key in ("a", "b", "diff")
        )
        name = row["name"].removesuffix("_rad")
        cells.append((row["channel"], name, unit, *values, BETTER[row["better"]]))
    yield table(
        f"paths are {pair.max_distance:.3f} m apart at most, at {pair.t_max_distance:.2f} s",
        ("channel", "metric", "unit", "A", "B", "B - A", "better"),
        cells,
    )
