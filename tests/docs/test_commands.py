"""Commands in README and docs: the page of all commands is their help, and each runs as printed."""

import re
import shlex
from functools import cache, reduce
from importlib.metadata import version
from pathlib import Path

import pytest
from commands import COMMANDS as KNOWN
from commands import flighttune
from figures.commands import PAGE, page
from packaging.version import Version

ROOT = Path(__file__).parents[2]
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "scenarios").rglob("*.md")),
    *sorted((ROOT / "aircraft").rglob("*.md")),
]
PLACEHOLDER = re.compile(r"\b[A-Z][A-Z]+\b|\.\.\.|\[-")
"""What stands for something else: SCENARIO, [--json], ..."""

COMMAND = re.compile(r"(pip|make|dask|python) |flighttune (list$|(campaign )?[a-z]+ \w)")
NAME = re.compile(r"flighttune campaign \w+$")

NOT_RUN = {
    "changes the environment, or does not end": "pip |make |dask |flighttune (view|open) ",
    "minutes, as make bench is, or figures that are tested one by one": "python (benchmarks|docs)/",
    "docs/test_first_mission_page.py": "python mission.py|flighttune verify runs/mission-band",
    "a cluster: campaign/test_faults.py": "flighttune campaign campaign.toml --scheduler",
    "minutes: campaign/test_band.py, campaign/test_mission_band.py": (
        "flighttune (band|mission (circuit_in_wind|mission.plan --(aircraft|turn-back))) "
        "|flighttune verify mission.npz"
    ),
    "after it: campaign/test_mission_band.py": (
        "flighttune (verify|report|mission) runs/mission-band"
    ),
    "minutes": (
        "flighttune (tube (feasible|turn.toml)|tube paper --gains paper --disturbance|worst paper"
        "|meet paper_identified --(campaign|out)|identify aerosonde --V-a 25 --V-a 20)"
    ),
    "after `tube` or `worst`: tests/tubes, tests/campaign": (
        "flighttune (verify|worst) proof.npz|flighttune fly runs/aerosonde_dispersed-worst.toml"
    ),
    "writes into the package": (
        "flighttune identify (a4|c172p) --out aircraft|flighttune design (a4|aerosonde|c172p)"
    ),
    "an aircraft, a route or a fence of the reader's own": (
        "flighttune (adopt (models/mine.xml|Aircraft/)|(design|identify) mine"
        "|mission (mission.plan --plan|runs/circuit-band.npz --fence))"
    ),
    "a log of the reader's own: tests/logs and tests/gaps": (
        "flighttune (report|gap|compare) (flight.ulg|today.csv)|flighttune compare .* --with"
        "|flighttune (identify|monitor) (monday.|flight.tlog)|flighttune verify m.npz --log"
        "|flighttune (new|fly|certify|export) from_log"
    ),
    "minutes, with parameters of the reader's own: campaigns/test_retune.py": (
        r"flighttune meet \S+ --with"
    ),
    "of the flight of a page's Python": "flighttune report runs/mine",
}
"""Commands that no test runs, by how they begin, and why, or which other test has them."""

RUN_ALL_THE_SAME = ("flighttune design aerosonde --dry-run",)
MADE_BY = {
    "runs/paper": "flighttune fly paper",
    "runs/first_campaign": "flighttune campaign first_campaign",
    "gains.json": "flighttune tune paper --out gains.json",
    "certificate.json": "flighttune certify paper --out certificate.json",
    "mine.json": "flighttune tune mine.toml --out mine.json",
    "monitor.npz": "flighttune monitor mission --set turbulence.intensity=light --start-deg 1 "
    "--epsilon 0.3 --confidence 0.9 --learn 20 --flights 7 --out monitor.npz",
    "runs/circuit-band.npz": "flighttune band circuit --start-deg 2 --plant kinematic "
    "--epsilon 0.3 --confidence 0.9 --learn 10 --flights 7",
}
"""Commands of other pages that make what a page begins with."""


ANSWER_NO = (
    "flighttune fly mine.toml",
    "flighttune fly turn.toml",
    "flighttune fly turn.toml --gains tuned_identified --gains turn_gains.json",
)
"""Commands whose exit status is 1, as their page says."""

FILES = {
    name: text
    for path in PAGES
    for text, name in re.findall(
        r"^```toml\n(# (\w+\.toml)\n.*?)^```",
        path.read_text(encoding="utf-8"),
        re.DOTALL | re.MULTILINE,
    )
}
"""Files that the reader of a page writes, by the name in their first line."""


LONG = re.compile(
    r"flighttune (meet (?!mine\.toml --budget)|monitor|tube|reproduce|worst first_campaign$"
    r"|mission runs/|verify (bound|monitor)\.|(fly|export) .*--claim monitor"
    r"|certify mission --gains|tune paper --(prove|frontier$)|(adopt |trim |fly aircraft/)737"
    r"|trim (aerosonde$|a4|c172p)|report runs/paper$)"
)
"""Commands that take seconds to minutes, and which other pages or tests run on less."""

FEWER = {"--budget 240": "--budget 24", "--runs 30": "--runs 3"}
"""Numbers of flights for which fewer do as well."""


EXAMPLES = [f"flighttune {texts['example']}" for texts in KNOWN.values()]
"""Of the help of each command, which the site appends to the page of all."""


def printed(path):
    """Commands on a page: lines of blocks, examples of the help, and code in a sentence."""
    text = path.read_text(encoding="utf-8").replace(" \\\n", " ")
    prose, *fenced = re.split(r"^```", text, flags=re.MULTILINE)
    blocks = [block for block in fenced[::2] if re.match(r"(sh|text)?\n", block)]
    prose = " ".join([prose, *fenced[1::2]])
    lines = [line.strip() for block in blocks for line in block.splitlines()]
    lines += EXAMPLES if path == PAGE else []
    lines += [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", prose)]
    for line in lines:
        command = line.partition(" #")[0].strip()
        if COMMAND.match(command) and not NAME.match(command):
            yield command


COMMANDS = {
    path.relative_to(ROOT).as_posix(): [c for c in printed(path) if not PLACEHOLDER.search(c)]
    for path in PAGES
}
RUN = {
    name: [
        command
        for command in dict.fromkeys(commands)
        if command in RUN_ALL_THE_SAME or not re.match("|".join(NOT_RUN.values()), command)
    ]
    for name, commands in COMMANDS.items()
    # other tests and the benchmarks fly every scenario and campaign that ships
    if name not in ("docs/gallery.md", "docs/speed.md")
}


@pytest.mark.skipif(
    Version(version("typer")) < Version("0.29"), reason="older versions lay the help out otherwise"
)
def test_the_page_of_commands_is_their_help():
    assert PAGE.read_text(encoding="utf-8") == page(), "run python docs/figures/commands.py"


def test_every_command_on_a_page_is_one():
    for name, commands in COMMANDS.items():
        for command in commands:
            words = command.split()
            if words[0] == "flighttune" and not words[1].startswith("-"):
                assert words[1] in KNOWN, f"{name}: {command}"


def test_what_is_not_run_is_printed_somewhere():
    every = [command for commands in COMMANDS.values() for command in commands]
    for beginning in NOT_RUN.values():
        assert any(re.match(beginning, command) for command in every), beginning


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("commands")


def quick(name):
    """Commands of a page that CI runs; of a tutorial whose commands build on each other, none."""
    commands = [c for c in RUN[name] if not LONG.match(c) and name != "docs/meet.md"]
    return [reduce(lambda c, many: c.replace(many, FEWER[many]), FEWER, c) for c in commands]


CASES = [
    pytest.param(commands, marks=marks, id=name)
    for name in RUN
    for commands, marks in (
        (quick(name), pytest.mark.soak),
        (RUN[name] if RUN[name] != quick(name) else [], pytest.mark.counts),
    )
    if commands
]


@pytest.mark.parametrize("commands", CASES)
def test_every_command_runs_as_it_is_printed(commands, folder):
    for command in commands:
        for file in set(command.split()) & FILES.keys():
            (folder / file).write_text(FILES[file])
        for made, maker in MADE_BY.items():
            if made in command and f"--out {made}" not in command and not (folder / made).exists():
                run(maker, folder)
        run(command, folder)


@cache
def run(command, folder):
    """Run a command where no page has done so yet."""
    if command.startswith("flighttune campaign ") and "--dry-run" not in command:
        command += " --resume"  # a campaign is on several pages
    words = [word.replace("scenarios/", f"{ROOT}/scenarios/") for word in shlex.split(command)[1:]]
    flighttune(*words, cwd=folder, status=int(command in ANSWER_NO))
