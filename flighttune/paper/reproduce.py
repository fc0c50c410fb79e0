"""The paper reproduced in a folder: figures, tables, texts, page and errata."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from flighttune.paper.claims import CLAIMS, VERDICTS, Finding, judge, text_of
from flighttune.paper.errata import HEAD, errata
from flighttune.paper.items import Item, chosen
from flighttune.paper.items.base import Made
from flighttune.paper.study import Study
from flighttune.present.frame import page_template, page_text
from flighttune.whole_file import write_text

TITLE = (
    "Robust Convergency Indicator using MIMO-PI Controller in the presence of disturbances, "
    "computed again"
)

# Verdicts in the order in which the page lists its claims.
READ_FIRST = ("not reproduced", "partly", "reproduced", "not checkable")

# Called with what is being made and the part of it that is done, 0 to 1.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reproduction:
    """Files and results of `reproduce`."""

    items: list[tuple[Item, Made, list[Path]]]  # with their files: figures, tables and text
    findings: list[Finding]  # every claim with its verdict
    page: Path
    errata: Path


def reproduce(
    names: Sequence[str] = (),
    out: str | Path = "runs/reproduce",
    *,
    study: Study | None = None,
    progress: Progress | None = None,
) -> Reproduction:
    """Make items of the paper, all by default, and judge every claim."""
    chosen_items, tell = chosen(names), progress or (lambda *_: None)
    study, folder = Study() if study is None else study, Path(out)
    items = []
    for k, item in enumerate(chosen_items):
        tell("items", k / len(chosen_items))
        made = item.make(study)
        items.append((item, made, _written(item, made, folder)))
    tell("items", 1.0)
    findings = []
    for k, name in enumerate(CLAIMS):
        tell("claims", k / len(CLAIMS))
        findings.append(judge(name, study))
    tell("claims", 1.0)
    parts = errata(study)
    text = [HEAD.rstrip(), *(f"## {part.title}\n\n{part.markdown()}" for part in parts)]
    page = page_text(
        page_template("flighttune.paper", "page.html.jinja"),
        title=TITLE,
        items=items,
        findings=sorted(findings, key=lambda finding: READ_FIRST.index(finding.verdict)),
        verdicts=VERDICTS,
        errata=parts,
        text=text_of,
    )
    return Reproduction(
        items=items,
        findings=findings,
        page=write_text(folder / "index.html", page),
        errata=write_text(folder / "errata.md", "\n\n".join(text) + "\n"),
    )


def _written(item: Item, made: Made, folder: Path) -> list[Path]:
    """Write figures, tables and text of an item."""
    files = []
    for name, figure in made.figures.items():
        files.append(folder / f"{name}.svg")
        figure.save(files[-1])
    for name, table in made.tables.items():
        text = table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
        files.append(write_text(folder / f"{name}.csv", text))
    files.append(write_text(folder / f"{item.name}.md", item.text(made)))
    return files
