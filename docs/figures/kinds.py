"""Ask every command about adopted aircraft of each kind, and write the table into docs/hangar.md.

Run it by ``python docs/figures/kinds.py [FOLDER]``. FOLDER keeps the answers: aircraft whose
answers are there are not asked again. All of it takes about an hour of one core.
"""

import json
import math
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

from flighttune.outputs.answers.answer import Column, Table

PAGE = Path(__file__).parents[1] / "hangar.md"
AIRCRAFT = Path(__file__).parents[2] / "aircraft"

KINDS = {
    "jet": ("f16", "T38", "737"),
    "light": ("c182", "J3Cub", "pa28"),
    "small electric": (AIRCRAFT / "aerosonde/aerosonde.xml", AIRCRAFT / "x8/x8.xml"),
    "glider": ("minisgs", "sgs126", "sgs233"),
}
COMMANDS = ("mission", "band", "meet", "export", "gap")

# Before the reason of an error.
FILES = re.compile(r"flighttune: |\S*/\S*: ")

# Few flights are counted: whether a command answers, not what it says.
FEW = ("--flights", "12", "--epsilon", "0.2", "--confidence", "0.8")


def flighttune(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run a command to its end."""
    command = [sys.executable, "-m", "flighttune", *arguments]
    return subprocess.run(command, capture_output=True, text=True)


def answers(model: str | Path, folder: Path) -> dict[str, str]:
    """Adopt an aircraft; for each command, yes or the reason why it has no answer.

    Exit status 0 and 1 are answers.
    """
    flighttune("adopt", model, "--out", folder)
    turn, mine, plan = folder / "turn.toml", folder / "mine", folder / "square.plan"
    V_a = tomllib.loads(turn.read_text(encoding="utf-8"))["flight"]["V_a_mps"]
    plan.write_text(json.dumps(square(60.0 * V_a)), encoding="utf-8")
    flighttune("new", mine, "--aircraft", folder)
    said = {
        "mission": (plan, "--aircraft", folder, *FEW, "--out", folder / "mission.npz"),
        "band": (turn, "--start-deg", "2", "--learn", "10", *FEW, "--out", folder / "band.npz"),
        "meet": (f"{mine}.toml", "--budget", "12", "--out", folder / "met.json"),
        "export": (turn, "--out", folder / "export"),
        "gap": (turn, "--out", folder / "gap"),
    }
    done = {name: flighttune(name, *options, "--json") for name, options in said.items()}
    return {
        name: "yes" if ended.returncode in (0, 1) else ended.stderr.strip().rpartition("\n")[2]
        for name, ended in done.items()
    }


def square(side: float) -> dict[str, Any]:
    """A plan of QGroundControl's with four corners (m apart), 200 m above a home at 800 m."""
    north = math.degrees(side / 6.371e6)
    east = north / math.cos(math.radians(47.0))
    corners = [(47.0 + north, 8.0), (47.0 + north, 8.0 + east), (47.0, 8.0 + east), (47.0, 8.0)]
    items = [
        {"type": "SimpleItem", "command": 16, "frame": 3, "params": [0, 0, 0, None, *corner, 200]}
        for corner in corners
    ]
    mission = {"items": items, "plannedHomePosition": [47.0, 8.0, 800.0], "version": 2}
    return {"fileType": "Plan", "version": 1, "mission": mission | {"vehicleType": 1}}


def asked(kind: str, model: str | Path, folder: Path) -> dict[str, str]:
    """The row of an aircraft, from `folder` or by asking."""
    name = Path(model).stem
    file = folder / f"{name}.json"
    if not file.exists():
        file.write_text(json.dumps(answers(model, folder / name)), encoding="utf-8")
        print(name, file.read_text(encoding="utf-8"), flush=True)
    return {"kind": kind, "aircraft": name, **json.loads(file.read_text(encoding="utf-8"))}


def text(rows: list[dict[str, str]]) -> str:
    """The table, and below it why a command has no answer."""
    reasons = []
    for name in COMMANDS:
        if said := [(row["aircraft"], row[name]) for row in rows if row[name] != "yes"]:
            models = ", ".join(model for model, _ in said)
            reasons.append(f"- `{name}` of {models}, the first: {FILES.sub('', said[0][1])}")
    short = [row | {name: "no" for name in COMMANDS if row[name] != "yes"} for row in rows]
    header = [Column(name, name) for name in ("kind", "aircraft", *COMMANDS)]
    return "\n".join([Table(columns=header, records=short).markdown(), "", *reasons]).rstrip()


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    rows = [asked(kind, model, folder) for kind, models in KINDS.items() for model in models]
    begin, end = "<!-- kinds:begin -->", "<!-- kinds:end -->"
    page = PAGE.read_text(encoding="utf-8")
    filled = re.sub(
        f"{begin}.*{end}", lambda _: f"{begin}\n\n{text(rows)}\n\n{end}", page, flags=re.S
    )
    PAGE.write_text(filled, encoding="utf-8")
