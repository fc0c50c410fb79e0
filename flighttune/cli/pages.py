"""Commands that publish: pages, the paper's figures, exports."""

from pathlib import Path

from flighttune.cli.options import Verb, check_ending
from flighttune.outputs.answers.answer import Answer


def report(write_report: Verb, out: Path | None) -> Answer:
    """Write one page about runs, a campaign or a claim: headline, figures, tables, the way to it.

    The page is one file and needs no network.
    """
    check_ending(out, ".html", ".htm")
    return write_report(out).answer()


def reproduce(reproduce_items: Verb, names: list[str] | None, out: Path | None) -> Answer:
    """Reproduce the figures and tables of arXiv 2411.13140 and judge its claims."""
    return reproduce_items(names=names or (), out=out or "runs/reproduce").answer()


def export(export_flight: Verb, out: Path) -> Answer:
    """Write one flight of SCENARIO for JSBSim alone, or its outer loop in C.

    JSBSim flies the folder at once: exit status 1 if its flight is not that of `fly`.
    """
    return export_flight(out=out).answer()
