"""The paper reproduced in a folder: figures, tables, texts, page and errata.

Items are described in ``items.toml``. To add one, describe it there, and put the function that
makes it, under its name, into a module of ``items``. The text of the errata is in ``errata.toml``;
`numbers` computes what its braces name.
"""

import math
import tomllib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.answering import Answering
from flighttune.base.errors import InputError
from flighttune.base.files import shipped
from flighttune.base.files.whole import together, write_text
from flighttune.base.words import pick
from flighttune.control.linear_model import closed_loop, disturbance_entry
from flighttune.control.theory.lyapunov import invariant_ellipsoid, paper_balls
from flighttune.outputs.answers.answer import Answer, Column, Table
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.drawing.templates import page_template
from flighttune.outputs.pages.frame import write_page
from flighttune.outputs.paper.items import flights, theory
from flighttune.outputs.paper.items.base import Item, Made
from flighttune.studies.paper import parameters as printed
from flighttune.studies.paper.claims import CLAIMS, VERDICTS, Finding, judge, text_of
from flighttune.studies.paper.flight import initial_commands, largest_share
from flighttune.studies.paper.study import Study

TITLE = (
    "Robust Convergency Indicator using MIMO-PI Controller in the presence of disturbances, "
    "computed again"
)

COLUMNS = Column("where", "where"), Column("printed", "printed"), Column("holds", "what holds")

ERRATA, DESCRIBED = (
    tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))
    for name in ("errata.toml", "items.toml")
)

HEAD = """# Errata of arXiv 2411.13140

“Robust Convergency Indicator using MIMO-PI Controller in the presence of disturbances.” Where print
and computation disagree, both are given. `flighttune reproduce` makes this file anew from the
printed parameters.
"""

# Functions by name: the function with an item's name makes it.
MAKERS = {**vars(theory), **vars(flights)}

# Verdicts in the order in which the page lists its claims.
READ_FIRST = ("not reproduced", "partly", "reproduced", "not checkable")

# Called with the present item and its finished share, 0 to 1.
Progress = Callable[[str, float], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reproduction(Answering):
    """Files and results of `reproduce`."""

    items: list[tuple[Item, Made, list[Path]]]  # with their files: figures, tables and text
    findings: list[Finding]  # every judged claim with its verdict
    page: Path
    errata: Path | None


def answer(made: Reproduction) -> Answer:
    """Items with their files, and every judged claim with its verdict."""
    keys = "id text where verdict expected computed"
    findings = [pick(finding, keys) for finding in made.findings]
    counts = Counter(finding.verdict for finding in made.findings)
    # The page has all claims.
    listed = findings if len(made.items) in (0, len(ITEMS)) else []
    return Answer(
        values={
            "items": [
                {"name": item.name, "files": files, "values": output.values}
                for item, output, files in made.items
            ],
            "claims": findings,
            "errata": made.errata,
        },
        tables=[Table(columns("id verdict text"), listed, "claims of the paper")],
        verdict=f"claims: {', '.join(f'{counts[verdict]} {verdict}' for verdict in VERDICTS)}",
        files={"page": made.page},
    )


def _item(name: str, entry: dict[str, Any]) -> Item:
    """An item with its maker, and the words of the parameters and assumptions that it names."""
    assumptions = [DESCRIBED["assumption"][key].items() for key in entry["assumed"]]
    words = {
        "parameters": [DESCRIBED["parameter"][key] for key in entry["parameters"]],
        "assumed": [{k: text.format(**vars(printed)) for k, text in x} for x in assumptions],
    }
    return Item(name=name, make=MAKERS[name], **entry | words)


# By name, in the order of the paper.
ITEMS = {name: _item(name, entry) for name, entry in DESCRIBED["item"].items()}


def reproduce(
    names: Sequence[str] = (),
    out: str | Path = "runs/reproduce",
    *,
    study: Study | None = None,
    progress: Progress | None = None,
) -> Reproduction:
    """Make items of the paper, all by default, and judge its claims: all, or those that are named.

    Errata are computed with all claims alone.
    """
    for name in names:
        if name not in ITEMS and name not in CLAIMS:
            near = shipped.nearest_name(name, {**ITEMS, **CLAIMS})
            raise InputError(
                f"`ITEM` must be one of {', '.join(ITEMS)}, or the id of a claim, got {name}{near}"
            )
    study, folder = Study() if study is None else study, Path(out)
    chosen, tell = [x for x in ITEMS if x in names or not names], progress or (lambda *_: None)
    named = [x for x in CLAIMS if x in names]
    judged = named or [*CLAIMS]
    outputs, findings = {}, []
    for k, name in enumerate(chosen):
        tell("items", k / len(chosen))
        outputs[name] = ITEMS[name].make(study)
    tell("items", 1.0)
    for k, name in enumerate(judged):
        tell("claims", k / len(judged))
        findings.append(judge(name, study))
    tell("claims", 1.0)
    parts = [] if named else errata(study)
    text = [HEAD.rstrip(), *(f"## {part.title}\n\n{part.markdown()}" for part in parts)]
    with together(folder):
        items = [
            (ITEMS[name], output, _written(ITEMS[name], output, folder))
            for name, output in outputs.items()
        ]
        page = write_page(
            folder / "index.html",
            page_template("flighttune.outputs.paper", "page.html.jinja"),
            title=TITLE,
            items=items,
            findings=sorted(findings, key=lambda finding: READ_FIRST.index(finding.verdict)),
            verdicts=VERDICTS,
            errata=parts,
            text=text_of,
        )
        listed = None if named else write_text(folder / "errata.md", "\n\n".join(text) + "\n")
    return Reproduction(items=items, findings=findings, page=page.path, errata=listed)


def _written(item: Item, output: Made, folder: Path) -> list[Path]:
    """Write figures, tables and text of an item."""
    files = []
    for name, figure in output.figures.items():
        files.append(folder / f"{name}.svg")
        figure.save(files[-1])
    for name, table in output.tables.items():
        text = table.to_csv(index=False, float_format="%.9g", lineterminator="\n")
        files.append(write_text(folder / f"{name}.csv", text))
    files.append(write_text(folder / f"{item.name}.md", item.text(output)))
    return files


def errata(study: Study) -> list[Table]:
    """All errata by part, in the order of ``errata.toml``: place, printed text, correct text."""
    named, tables = numbers(study), []
    for part, entries in ERRATA.items():
        records = [{k: text.format(**named) for k, text in entry.items()} for entry in entries]
        tables.append(Table(title=part, columns=COLUMNS, records=records))
    return tables


def numbers(study: Study) -> dict[str, Any]:
    """Values of all names in braces in ``errata.toml``."""
    star, flight, model = study.indicators[printed.STAR], study.flights[printed.STAR], study.model
    _, rate_limited, anti_windup, unlimited = study.readings.values()
    L_d = printed.disturbance(printed.PRINTED_DISTURBANCE).rate_bound
    n_z_trim = math.cos(printed.GAMMA_C)
    A_K, E = closed_loop(model, study.star), disturbance_entry(model)
    loops, Q = {"star": star, "fast": study.indicators["K1"]}, np.array(star.Q)
    # The bound ``direct`` on an error is from ``V = s' Q s``: ``V' = -|s|^2 + 2 s' Q E d'`` with
    # ``|s|^2 >= V / lambda_max`` and ``s' Q E d' <= sqrt(V) |Q^(1/2) E| L_d`` give
    # ``sqrt(V) <= 2 lambda_max |Q^(1/2) E| L_d`` in the end, and ``e_i^2 <= V (Q^-1)_ii``. I_K
    # without the loose step of Theorem 1 is ``sharper``.
    level = 2.0 / star.R_K * math.sqrt(np.linalg.norm(E.T @ Q @ E, 2)) * L_d
    errors = np.linalg.inv(Q).diagonal()[E.shape[1] :]
    return {
        "printed": printed,
        "study": study,
        **loops,
        "use": initial_commands(study.star),
        "largest_use": largest_share(study.star),
        "peak_time": {channel: flight.peak(channel)[1] for channel in ("chi", "gamma")},
        "rate_limited_error": max(rate_limited.after(name, 18.0) for name in ("chi", "gamma")),
        "anti_windup_overshoot": anti_windup.peak("chi")[0],
        "growth_of_ST": max(study.growth_of_ST(channel) for channel in ("s_chi", "s_gamma")),
        "norm_decay": star.R_K / 2.0,
        "unlimited_end": unlimited.t[-1],
        "n_z_trim": n_z_trim,
        "gamma_rate": printed.G / printed.V_A * (n_z_trim - n_z_trim / printed.G),
        "phi_0_deg": math.degrees(printed.PHI_0),
        "rate_bound": L_d,
        "balls": paper_balls(A_K, model.A, I_K=star.I_K, L_d=L_d),
        "largest_error": L_d * star.E_K,
        "ellipsoid": invariant_ellipsoid(A_K, E, L_d=L_d),
        "sharper": {
            name: loop.I_K / math.sqrt(np.linalg.cond(np.array(loop.Q)))
            for name, loop in loops.items()
        },
        "direct": level * math.sqrt(errors.max()),
    }
