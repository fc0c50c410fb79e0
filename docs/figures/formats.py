"""Write docs/formats.md and the keys of `--json`: python docs/figures/formats.py.

The keys stand in tests/docs/json_keys.md: a test sees that none is lost, the site shows them all.
"""

import io
import json
import os
import re
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import pyarrow.parquet as pq

from flighttune.cli import main

PAGE = Path(__file__).parents[1] / "formats.md"
KEYS = Path(__file__).parents[2] / "tests" / "docs" / "json_keys.md"
HEAD = """# File formats and JSON

What do the files and the output of `--json` hold? A run is a Parquet file with the columns below;
below them the built site has the keys of every JSON file and of `--json` of each command
(`tests/docs/json_keys.md`, made like this page by `python docs/figures/formats.py`).

Keys hold numbers unless their kind stands before them; `[]` stands for the entries of a list, `*`
for names that depend on what was given (gains, plants, runs), `null` for what may be absent. Angles
are in rad, rates in rad/s, all else in SI unless the name ends in a unit; numbers that are not
finite are null. Below `plan.campaign` of a campaign are the [keys](keys.md) of a campaign, below
`plan.nominal` and `plan.central` those of a scenario. Columns of campaigns are on [their
page](campaigns.md#the-dataset).
"""
OF_SCHEMAS = ("plan.campaign", "plan.nominal", "plan.central")
"""Beginnings of places that hold the keys of a scenario or a campaign."""

COMMANDS = (
    "fly paper --out fly",
    "tune paper --out gains.json",
    "certify paper --gains paper --out certificate.json",
    "verify certificate.json",
    "tune paper --frontier --points 3 --out frontier",
    "gap paper --out gap",
    "tube paper --gains paper --set flight.duration_s=12 --out tube.npz",
    "band paper --start-deg 2 --epsilon 0.3 --confidence 0.9 --learn 10 --flights 7 --out band.npz",
    "verify fly",
    "compare fly fly",
    "report fly --out report.html",
    "trim aerosonde --V-a 25",
    "design aerosonde --dry-run",
    "identify aerosonde --V-a 25 --out identified.json",
    "export paper_identified --gains paper --out exported",
    "campaign first_campaign --runs 8 --out campaign",
    "report campaign",
    "verify campaign --run 1",
    "worst first_campaign --budget 40 --out worst.toml",
    "list",
)
"""Each sees what those before it have written. Left out: what takes minutes or does not end."""

FILES = (
    ("Certificate", "certificate.json"),
    ("Identified aircraft", "identified.json"),
    ("Gains", "gains.json"),
    ("Plan of a campaign", "campaign/campaign.json"),
)


def answer(command: str) -> object:
    """What a command prints with ``--json``."""
    said = io.StringIO()
    with (
        redirect_stdout(said),
        redirect_stderr(io.StringIO()),
        mock.patch.object(sys, "argv", ["flighttune", *command.split(), "--json"]),
        mock.patch.dict(os.environ, COLUMNS="80"),
    ):
        try:
            main()
        except SystemExit as exit_:
            if exit_.code not in (0, 1, None):
                raise
    return json.loads(said.getvalue())


def keys(value: object, at: str = "") -> Iterator[tuple[str, str]]:
    """Every key below a value, and the kind of what it holds."""
    if isinstance(value, dict) and value:
        named = all(_is_key(key) for key in value)
        for key, one in value.items():
            yield from keys(one, f"{at}.{key if named else '*'}" if at else key if named else "*")
    elif isinstance(value, list) and value and isinstance(value[0], dict | list):
        for one in value:
            yield from keys(one, f"{at}[]")
    else:
        yield at, _kind(value)


def _is_key(key: str) -> bool:
    return key.isidentifier()


def _kind(value: object) -> str:
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, int | float):
        return "number"
    if isinstance(value, str):
        return "text"
    if isinstance(value, list):
        return f"{_kind(value[0])}s" if value else "list"
    return "null" if value is None else "object"


def table(value: object) -> Iterator[str]:
    """A table of the keys of a value below what holds them, each with all kinds that it had.

    What holds the same names, such as each channel, shares a row.
    """
    below: dict[str, dict[str, list[str]]] = {}
    for path, kind in keys(value):
        if not path.startswith(OF_SCHEMAS):
            above, _, key = path.rpartition(".")
            below.setdefault(above, {}).setdefault(key, []).append(kind)
    rows: dict[tuple[str, ...], tuple[list[str], dict[str, list[str]]]] = {}
    for above, kinds in below.items():
        holders, shared = rows.setdefault(tuple(sorted(kinds)), ([], {}))
        holders.append(f"`{above}`" if above else "(top)")
        for key, found in kinds.items():
            shared.setdefault(key, []).extend(found)
    yield from ("| in | keys |", "|---|---|")
    for holders, shared in rows.values():
        by_kind: dict[str, list[str]] = {"number": []}
        for key, found in shared.items():
            by_kind.setdefault(" or ".join(dict.fromkeys(found)), []).append(f"`{key}`")
        named = (
            ("" if kind == "number" else f"{kind}: ") + ", ".join(keys_of)
            for kind, keys_of in by_kind.items()
            if keys_of
        )
        yield f"| {', '.join(holders)} | {'; '.join(named)} |"


def columns(file: Path) -> Iterator[str]:
    """A table of the columns of a Parquet file, by type and unit."""
    schema = pq.read_schema(file if file.is_file() else sorted(file.glob("*.parquet"))[0])
    alike: dict[str, list[str]] = {}
    for field in schema:
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        alike.setdefault(f"{field.type} | {unit}", []).append(f"`{field.name}`")
    yield from ("| type | unit | columns |", "|---|---|---|")
    for kind, names in alike.items():
        yield f"| {kind} | {', '.join(names)} |"


def pages(commands: Sequence[str] = COMMANDS) -> tuple[str, str]:
    """The page, and the keys of what each command prints, as Markdown."""
    lines = [HEAD]
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        said = {command: answer(command) for command in commands}
        lines += ["## Parquet: signals of a run\n", *columns(Path("fly"))]
        printed = ["## Files of JSON\n"]
        for title, name in FILES:
            printed += [f"### {title}\n", *table(json.loads(Path(name).read_text())), ""]
    printed += ["## What commands print with `--json`\n"]
    for command, value in said.items():
        words = re.split(r" --(?!frontier)", command)[0]
        printed += [f"### flighttune {words}\n", *table(value), ""]
    return "\n".join(lines) + "\n", "\n".join(printed)


if __name__ == "__main__":
    for file, text in zip((PAGE, KEYS), pages(), strict=True):
        file.write_text(text, encoding="utf-8")
