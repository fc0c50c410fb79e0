"""Commands that compare and publish: the gap to the aircraft, runs, pages, exports."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from flighttune.cli import options
from flighttune.cli.options import Verb, of
from flighttune.cli.show import progress_bar
from flighttune.errors import InputError
from flighttune.files.shipped import scenario_files
from flighttune.present.answer import Answer


@of(
    "gaps.gap:gap",
    scenario={"metavar": "SCENARIO|LOG", "autocompletion": scenario_files},
    name=None,
    out="Folder to write to [default: runs/NAME-gap; of a log without its part].",
)
def gap(
    explain_gap: Verb, scenario: str, out: Path | None, claim: options.ClaimOption = None
) -> Answer:
    """Fly gains on plants from the paper's law to the aircraft; show what each step adds.

    The commands of a LOG are flown on law and aircraft, and the answer says how much of the
    difference lag, mass, damping and wind explain. Exit status 1 if a flight ends early, or the
    aircraft leaves its tube.
    """
    from flighttune.campaign.claims import within
    from flighttune.gaps.of_log import LogGap
    from flighttune.recording.record import record
    from flighttune.reports.charts import gap_sheet
    from flighttune.reports.report import write_gap_page

    stem = f"{Path(scenario.partition('@')[0]).stem}-gap"
    folder = out or Path("runs") / stem
    if "aircraft" in explain_gap.keywords and claim:
        raise InputError("--claim must be absent for a log.")
    explained = explain_gap()
    if isinstance(explained, LogGap):
        explained.sheet().save(folder / "gap.svg")
        return replace(explained.answer(), files={"figure": folder / "gap.svg"})
    explained = within(explained, claim or ())
    files = record(explained.flown(), folder, name=stem)
    answer = explained.answer(files.signals)
    figure = page = None
    if explained.steps:
        figure, page = folder / "gap.svg", folder / "gap.html"
        gap_sheet(explained).save(figure)
        write_gap_page(explained, answer.tables, page)
    files = {"recording": files.recording, "figure": figure, "page": page}
    return replace(answer, files=files)


@of(
    "campaign.beside:compare",
    a={
        "metavar": "A",
        "help": "A run folder, a Parquet file, a recording, the log of a real flight or "
        "SCENARIO@GAINS, which is flown. Append @ and a gain set, a plant or a run to choose "
        "among the runs of a folder, START:END in s for a part of a log. With --with a mission, "
        "scenario or campaign.",
        "autocompletion": options.to_fly,
    },
    autopilot={"metavar": "FILE"},
    log={"metavar": "LOG"},
    out="Recording (.rrd) or page (.html) to write, with all runs overlaid; with --with a page.",
)
def compare(
    compare_runs: Verb,
    a: str,
    autopilot: Path | None,
    out: Path | None,
    others: Annotated[
        list[str] | None,
        Argument(
            metavar="[B...]",
            help="What to compare A with [default: the first run of A with each other].",
        ),
    ] = None,
) -> Answer:
    """Compare runs, or gains with what an autopilot flies now.

    Of runs: metrics, which is better, and how far apart the paths are; exit status 2 if manoeuvre
    or aircraft differ. --with FILE flies a mission by the parameters of PX4 or ArduPilot beside the
    gains, on the same draws.
    """
    if autopilot:
        options.check_ending(out, ".html")
    compared = compare_runs(*(others or ()))
    is_page = out is not None and out.suffix.lower() == ".html"
    files = {"recording": None if is_page else out, "page": out if is_page else None}
    answer = compared.answer()
    if out is None or answer.failure:
        return replace(answer, files=dict.fromkeys(files))
    if autopilot:
        compared.page(out, f"flighttune compare {a} --with {autopilot}")
    elif is_page:
        from flighttune.reports.page import write_comparison_page

        write_comparison_page(compared, out)
    else:
        from flighttune.recording.record import write_overlay

        write_overlay(compared, out)
    return replace(answer, files=files)


@of("reports.report:report", source={"metavar": "PATH"}, path=None)
def report(
    write_report: Verb,
    out: Annotated[
        Path | None,
        Option(
            "--out",
            "-o",
            help="HTML file to write [default: report.html, in the folder of a campaign].",
        ),
    ] = None,
) -> Answer:
    """Write one page about runs, a campaign or a claim: headline, figures, tables, the way to it.

    The page is one file and needs no network.
    """
    options.check_ending(out, ".html", ".htm")
    return write_report(out).answer()


def reproduce(
    items: Annotated[
        list[str] | None,
        Argument(metavar="[ITEM ...]", help="Figures and tables by name [default: all]."),
    ] = None,
    out: Annotated[Path, Option(help="Folder for figures, tables and page.")] = Path(
        "runs/reproduce"
    ),
) -> Answer:
    """Reproduce the figures and tables of arXiv 2411.13140 and judge its claims."""
    from flighttune.paper.reproduce import reproduce as reproduce_items

    with progress_bar() as progress:
        return reproduce_items(items or (), out, progress=progress).answer()


@of("exports.export:export", out="Folder to write to [default: runs/NAME-export].")
def export(export_flight: Verb) -> Answer:
    """Write one flight of SCENARIO for JSBSim alone, or its outer loop in C.

    JSBSim flies the folder at once: exit status 1 if its flight is not that of `fly`.
    """
    return export_flight().answer()
