"""The command that says what the flights of a campaign tell."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from flighttune.cli.show import JsonOption, print_json, print_table, say
from flighttune.errors import InputError

if TYPE_CHECKING:
    from flighttune.campaign.report.findings import Findings

PAGE = "report.html"


def report(
    folder: Annotated[
        str,
        typer.Argument(metavar="DIR", help="Folder or URL of a campaign; it may still be running."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="HTML file to write; by default report.html in a local DIR."
        ),
    ] = None,
    interval: Annotated[
        Literal["wilson", "clopper-pearson"], typer.Option(help="Interval of shares.")
    ] = "wilson",
    confidence: Annotated[float, typer.Option(help="Of all intervals, between 0 and 1.")] = 0.95,
    as_json: JsonOption = False,
) -> None:
    """Say how often each gain set holds in the campaign of DIR, how surely, and what matters.

    The page needs no network and nothing beside it.
    """
    if out is not None and out.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{out}: --out must end in .html.")
    from flighttune.campaign.dataset.dataset import dataset_hash
    from flighttune.campaign.report.as_json import findings_json
    from flighttune.campaign.report.findings import findings
    from flighttune.campaign.report.flown import load_flown
    from flighttune.campaign.report.page import write_page

    found = findings(load_flown(folder), method=interval, confidence=confidence)
    if out is None and Path(folder).is_dir():
        out = Path(folder) / PAGE
    page = None if out is None else write_page(found, out)
    if as_json:
        print_json(
            {
                **findings_json(found),
                "sha256": dataset_hash(folder),
                "page": None if page is None else str(page.path),
            }
        )
        return
    _print(found)
    if page is not None:
        say(f"page: {page.path}   (one file, it opens without a network)")


def _print(found: "Findings") -> None:
    from flighttune.campaign.report.page import notes
    from flighttune.campaign.report.words import label_of, percent, shown, with_interval

    how = None if found.measure is None else shown(found.measure)
    factor = 1.0 if how is None else how.factor
    rows = []
    for one in found.groups:
        spread = one.measures.get(found.measure or "")
        certified = one.certified
        rows.append(
            (
                label_of(one.group),
                str(one.n),
                f"{percent(one.success.value)} [{percent(one.success.lo)}, "
                f"{percent(one.success.hi)}]",
                *(
                    "-" if spread is None else with_interval(spread.percentiles[name], factor)
                    for name in (("p50", "p95") if how else ())
                ),
                "-" if certified is None else percent(certified.of_all.value),
            )
        )
    measured = () if how is None else ("median", "95 %")
    header = ("group", "flights", "succeed [%]", *measured, "set held [%]")
    title = found.flown.plan.campaign.title
    print_table(title if how is None else f"{title}: {how.titled}", header, rows)
    for line in notes(found):
        say(line)
    _say_headline(found)


def _say_headline(found: "Findings") -> None:
    from flighttune.campaign.report.headline import headline

    holds, *others = headline(found)
    for sentence in holds.sentences[len(found.groups) :]:
        say(sentence)
    for answer in others:
        say(f"{answer.question} {answer.short}")
        for sentence in answer.sentences:
            say(f"  {sentence}")
