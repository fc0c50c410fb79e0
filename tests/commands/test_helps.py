"""Tables against tables: commands, their verbs, helps, pages, completions and versions."""

import re
import tomllib
from functools import cache

import pytest
from commands import ALIKE, COMMANDS, FORMER, PANELS, flighttune
from places import AIRCRAFT_NAMES, CAMPAIGN_NAMES, ROOT, SCENARIO_NAMES

import flighttune as ft

NO_VERB = {
    "list": "prints names of files",
    "view": "starts another program",
    "campaign": "plans first, and --resume reads the plan of the folder",
}
"""Commands whose row names no verb."""
OTHER_NAME = {
    "campaign": "run_campaign",  # beside plan_campaign
    "list": "an import has no list",
    "new": "a file with comments, for the command line",
    "reproduce": "the paper's figures, which no program needs",
    "verify": "verify",
    "view": "show",
}
"""Commands whose public name in Python is another one, or why there is none."""
ANGLES = {
    *((name, "--start-deg") for name in ("tube", "band", "monitor", "worst")),
    *(("trim", "--gamma"), ("trim", "--phi"), ("identify", "--gamma"), ("new", "--overshoot")),
}


@cache
def help_of(name):
    """The help of a command at a terminal of 80 columns."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        return flighttune(*name.split(), "--help")[0]


@cache
def entries(name):
    """Flags of the options in a help, with their texts."""
    text = help_of(name).partition("Options:")[2].partition("\n\n")[0]
    rows = re.split(r"^  (?=-)", text, flags=re.MULTILINE)[1:]
    return {re.search(r"--[\w-]+", row)[0]: " ".join(row.split()) for row in rows}


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_explains_every_option_ends_with_an_example_and_fits_80_columns(name):
    text = help_of(name)
    flat = " ".join(text.split())

    assert max(map(len, text.splitlines())) <= 80
    assert f"Example: flighttune {COMMANDS[name]['example']}" in flat or "Example: " in flat
    assert text.splitlines()[-1].startswith("  ")
    assert not re.search(r"``|\boptional\b|\bNone\b|\{\}", flat)
    assert len(entries(name)) <= {"meet": 18, "mission": 18}.get(name, 14)
    for flag, said in entries(name).items():
        assert re.search(r"[.\]]$", said.replace("Show this message and exit.", ".")), flag
    for option, own in COMMANDS[name].items():
        if (
            not isinstance(own, dict)
            or own.get("hidden")
            or option in COMMANDS[name].get("absent", ())
        ):
            continue
        flags = own.get("flags", [f"--{option.replace('_', '-')}"])
        if (said := entries(name).get(flags[-1] if len(flags) == 1 else flags[0])) is None:
            assert own.get("metavar", option.upper()).partition("|")[0] in text, option
            continue
        words = own.get("help", own.get("sentence", "")).format(*own.get("ending", ()))
        assert all(word in flat for word in own.get("ending", ())), option
        assert " ".join(words.split())[:20].rstrip(".") in said.replace("- ", "-"), option
        assert own.get("default", "") in said.replace(" ", "") or own["default"] in said, option
    assert {f for f in entries(name) if ", deg" in entries(name)[f]} == {
        flag for command, flag in ANGLES if command == name
    }


def test_the_first_help_has_every_command_under_its_heading_and_the_options_of_all():
    shown = " ".join(help_of("").split())
    for panel, commands in PANELS.items():
        assert f"{panel}:" in shown
        after = shown.partition(f"{panel}:")[2]
        places = [after.index(f" {name} ") for name in commands]
        assert places == sorted(places)
    for flag in ("workers", "scheduler", "run-code", "jsbsim", "json", "quiet", "version", "debug"):
        assert f"--{flag}" in shown


def test_every_command_has_a_row_on_its_page_and_an_example_that_is_one_of_its_own():
    page = (ROOT / "docs/commands.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| (.+?) \| (`.*`) \|$", page, re.MULTILINE))

    assert {panel: re.findall(r"`(\w+)`", rows[panel]) for panel in PANELS} == {
        panel: [*commands] for panel, commands in PANELS.items()
    }
    for name, texts in COMMANDS.items():
        word, *others = texts["example"].split()
        assert word == name
        assert {x for x in others if x.startswith("--")} <= entries(name).keys(), name
    for old, new in FORMER.items():
        assert new.split()[0] in COMMANDS, old


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_a_public_verb_of_python_or_says_why_not(name):
    verb = COMMANDS[name].get("verb", "").rpartition(":")[2]

    if name in OTHER_NAME:
        assert " " in OTHER_NAME[name] or hasattr(ft, OTHER_NAME[name])
    else:
        assert verb == name
        assert name in ft.__all__
    assert bool(verb) or name in NO_VERB


def completed(monkeypatch, typed):
    words = ["flighttune", *typed.split(" ")]
    monkeypatch.setenv("_FLIGHTTUNE_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", " ".join(words))
    monkeypatch.setenv("COMP_CWORD", str(len(words) - 1))
    return {*flighttune()[0].split()}


KNOWN = {
    "scenarios": {*SCENARIO_NAMES},
    "aircraft": {*AIRCRAFT_NAMES},
    "campaigns": {*CAMPAIGN_NAMES},
    "gains": {"paper", *(f"K{i}" for i in range(1, 7)), "tuned"},
    "flights": {*SCENARIO_NAMES, *CAMPAIGN_NAMES},
}
PLACES = [
    (name, option, keys["complete"])
    for name, texts in COMMANDS.items()
    for option, keys in {**ALIKE, **texts}.items()
    if isinstance(keys, dict) and "complete" in keys
    if f"--{option} " in help_of(name)
    or f"{option.upper()}\n" in help_of(name).partition("\n\n")[0]
]


@pytest.mark.parametrize(("name", "option", "kind"), PLACES)
def test_a_shell_completes_what_an_option_takes(here, monkeypatch, name, option, kind):
    flag = f"--{option} " * (f"--{option} " in help_of(name))

    assert completed(monkeypatch, f"{name} {'x ' * bool(flag)}{flag}") >= KNOWN[kind]


@pytest.mark.parametrize(
    ("typed", "wanted"),
    [
        ("fly pa", "paper paper_as_printed paper_identified paper_printed_limits"),
        ("campaign first", "first_campaign"),
        ("ca", "campaign"),
        ("fly paper --gains tuned", "tuned tuned_identified tuned_fed_back tuned_gentle"),
        ("fly mine.toml --gains so", "soft"),
        ("fly turn.toml --gains K1", "K1"),
        ("trim a", "a4 aerosonde"),
    ],
)
def test_a_shell_completes_what_begins_so(here, monkeypatch, typed, wanted):
    (here / "mine.toml").write_text('[[gains]]\nname = "soft"')

    assert completed(monkeypatch, typed) == {*wanted.split()}


def test_the_version_is_that_of_the_project_and_debug_shows_the_traceback():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

    assert flighttune("--version")[0] == f"flighttune {project['version']}\n"
    assert ft.__version__ == project["version"]
    with pytest.raises(ft.ScenarioError, match="nowhere"):
        flighttune("--debug", "fly", "nowhere.toml", status=None)
    assert "Usage" in "".join(flighttune(status=2))
