"""The command that compares runs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Argument, Option

from flighttune.cli.options import check_ending
from flighttune.cli.show import COULD_NOT_RUN, NO, emit, fail, pick
from flighttune.present.answer import Answer

if TYPE_CHECKING:
    from flighttune.comparison import Comparison, Violation


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
    comparison = compare_sources(first, *others)
    broken = violations(comparison, allowed) if allowed else []
    if out is not None and comparison.comparable:
        if out.suffix.lower() == ".html":
            from flighttune.report.compare_page import write_comparison_page

            write_comparison_page(comparison, out)
        else:
            from flighttune.comparison.overlay import write_overlay

            write_overlay(comparison, out)
    emit(_answer(comparison, broken, out))
    if not comparison.comparable:
        fail(comparison.reason, COULD_NOT_RUN)
    if allowed and comparison.unpaired:
        fail(
            f"{tolerance}: every run must have a partner to be checked, got none for "
            f"{', '.join(comparison.unpaired)}.",
            COULD_NOT_RUN,
        )
    if broken:
        more = f" ({len(broken) - 1} more)" if len(broken) > 1 else ""
        fail(f"{tolerance}: {broken[0].sentence}{more}", NO)


def _answer(comparison: "Comparison", broken: list["Violation"], out: Path | None) -> Answer:
    from flighttune.comparison.compare import comparison_table, pairs_table

    is_page = out is not None and out.suffix.lower() == ".html"
    written = out if comparison.comparable else None
    differs = {
        f"not the same: {key}: {first} and {second}"
        for pair in comparison.pairs
        for key, (first, second) in pair.differs.items()
    }
    return Answer(
        values={
            **pick(comparison, "comparable reason"),
            "metrics": comparison.metrics.to_dict(orient="records"),
            "max_distance_m": comparison.max_distance,
            **pick(comparison, "unpaired missing"),
            "violations": broken,
        },
        tables=[
            pairs_table(comparison),
            comparison_table("metrics", comparison.metrics),
        ],
        notes=[
            *sorted(differs),
            *(f"missing: {line}" for line in comparison.missing),
            *(f"no partner: {line}" for line in comparison.unpaired),
            *(f"out of tolerance: {violation.sentence}" for violation in broken),
        ],
        files={"recording": None if is_page else written, "page": written if is_page else None},
    )
