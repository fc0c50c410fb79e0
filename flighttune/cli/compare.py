"""The command that compares runs."""

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli.options import check_ending
from flighttune.cli.show import COULD_NOT_RUN, NO, emit, fail, pick
from flighttune.present.answer import Answer


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
    from flighttune.comparison.compare import comparison_table, pairs_table

    check_ending(out, ".rrd", ".html")
    allowed = None if tolerance is None else load_tolerances(tolerance)
    comparison = compare_sources(first, *others)
    broken = violations(comparison, allowed) if allowed else []
    files: dict[str, Path | None] = {"recording": None, "page": None}
    if out is not None and comparison.comparable:
        if out.suffix.lower() == ".html":
            from flighttune.report.page import write_comparison_page as write
        else:
            from flighttune.comparison.compare import write_overlay as write
        write(comparison, out)
        files["page" if out.suffix.lower() == ".html" else "recording"] = out
    differs = {
        f"not the same: {key}: {first} and {second}"
        for pair in comparison.pairs
        for key, (first, second) in pair.differs.items()
    }
    answer = Answer(
        values={
            **pick(comparison, "comparable reason"),
            "metrics": comparison.metrics.to_dict(orient="records"),
            "max_distance_m": comparison.max_distance,
            **pick(comparison, "unpaired missing"),
            "violations": broken,
        },
        tables=[pairs_table(comparison), comparison_table("metrics", comparison.metrics)],
        notes=[
            *sorted(differs),
            *(f"missing: {line}" for line in comparison.missing),
            *(f"no partner: {line}" for line in comparison.unpaired),
            *(f"out of tolerance: {violation.sentence}" for violation in broken),
        ],
        files=files,
    )
    emit(answer)
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
