"""Options follow from signatures and keys of commands.toml, not from the words of a help."""

import inspect
import re
from copy import deepcopy
from importlib import import_module
from pathlib import Path
from typing import get_args

import pytest
from commands import flighttune

import flighttune as ft
from flighttune.base.units import DEG
from flighttune.cli import verbs
from flighttune.cli.app import BODIES
from flighttune.cli.options import ALIKE, COMMANDS, Command

TEXTS = {name: texts for panel in COMMANDS.values() for name, texts in panel.items()}

# Words of a help that name another folder, ending, default, unit and other choices.
OTHER = 'Folder (.csv), a number, {"a", "b"}, in rad; by default 7 [default: runs/other/NAME.csv].'


FILES = [None, *(Path(f"some/where{x}") for x in ("", ".csv", ".html", ".json", ".rrd", ".txt"))]


def outcome(option, file):
    """Where an option writes, or why it does not."""
    try:
        return option.file(file, "some/turn.toml")
    except ft.InputError as error:
        return str(error)


def parameters(command):
    """What the options of a command are, without their helps."""
    options = {
        name: (
            *(option.kind, option.value, option.argument.unit, option.ending, option.folder),
            *(option.default, option.flags, option.min, option.max, option.own),
            [outcome(option, file) for file in FILES],
        )
        for name, option in command.options.items()
    }
    signature = {}
    for name, parameter in inspect.signature(command.function()).parameters.items():
        kind, typer = get_args(parameter.annotation)
        known = vars(typer) | {"help": None, "autocompletion": None}
        signature[name] = (kind, parameter.default, known)
    return options, signature


def reworded(texts):
    """Texts with other helps, as far as braces do not stand for endings there."""
    told = deepcopy(texts)
    for option in told.values():
        for key in {"help", "sentence"} & {*option} if isinstance(option, dict) else ():
            words = OTHER.replace("{", "(").replace("}", ")")
            option[key] = f"Other than a {words}" if option[key].startswith("Folder") else words
    return told


@pytest.mark.parametrize("name", TEXTS)
def test_other_words_in_every_help_leave_the_options_as_they_are(name, monkeypatch):
    before = parameters(Command(BODIES[name], TEXTS[name]))
    source = verbs._source

    def with_other_docstrings(module):
        """The text of a module, each entry of its docstrings in other words."""
        entry = r"^(    \w[\w, ]* : )(?!as for)[^\n]*\n(?:        .*\n)+"
        return re.sub(
            entry, rf"\g<1>{OTHER}\n        {OTHER}\n", source(module), flags=re.MULTILINE
        )

    monkeypatch.setattr(verbs, "_source", with_other_docstrings)
    monkeypatch.setattr("flighttune.cli.options.ALIKE", reworded(ALIKE))
    command = Command(BODIES[name], reworded(TEXTS[name]))

    assert parameters(command) == before
    helps = [x.argument.text or x.help for x in command.options.values() if x.name != "quiet"]
    assert name == "list" or any("runs/other" in text for text in helps)


@pytest.mark.parametrize("name", TEXTS)
def test_a_command_has_its_options_without_any_docstring(name, monkeypatch):
    before = parameters(Command(BODIES[name], TEXTS[name]))
    source = verbs._source
    docstring = re.compile(r'^    """.*?"""', re.MULTILINE | re.DOTALL)
    monkeypatch.setattr(verbs, "_source", lambda x: docstring.sub('    """None."""', source(x)))

    assert parameters(Command(BODIES[name], TEXTS[name])) == before


def options_of(name):
    return Command(BODIES[name], TEXTS[name]).options


def test_every_ending_stands_in_its_help_and_every_kind_of_file_is_checked():
    files = [
        (name, option)
        for name in TEXTS
        for option in options_of(name).values()
        if option.ending or option.folder or option.default
    ]

    assert len(files) == 20
    for name, option in files:
        assert option.help.count("{}") == len(option.ending), (name, option.name)
        wrong = Path("some/file.json" if option.folder else "some/file.wrong")
        with pytest.raises(ft.InputError, match=f"some/{wrong.name}: {option.flag} must"):
            option.file(wrong, "")
        right = Path("some/file").with_suffix(option.ending[0] if option.ending else "")
        assert option.file(right, "") == right


@pytest.mark.parametrize(
    ("command", "source", "written"),
    [
        ("fly", "some/turn.toml", "runs/turn"),
        ("worst", "turn", "runs/turn-worst.toml"),
        ("view", "log.ulg@10:20", "runs/log/log.rrd"),
        ("reproduce", "", "runs/reproduce"),
        ("gap", "paper", None),  # the command decides
    ],
)
def test_a_file_has_the_name_of_its_source_by_default(command, source, written):
    assert options_of(command)["out"].file(None, source) == (written and Path(written))


def test_an_option_that_is_not_given_has_the_default_of_its_verb_or_none_of_its_own():
    for (command, name), default in {
        ("worst", "budget"): 2000, ("trim", "h"): 1000.0,
        ("tune", "prove"): None, ("adopt", "rudder"): None,
        ("tune", "envelope"): False, ("tune", "frontier"): False, ("worst", "out"): None,
    }.items():  # fmt: skip
        assert options_of(command)[name].value == default, (command, name)
        assert type(options_of(command)[name].value) is type(default), (command, name)


@pytest.mark.parametrize(
    ("command", "name", "words", "value"),
    [
        ("tune", "lag", ["0.1:0.2", "0.3:0.5"], [(0.1, 0.2), (0.3, 0.5)]),
        ("identify", "assume", ["phi=4", "n_z=2.5"], {"phi": 4.0, "n_z": 2.5}),
        ("fly", "changes", ["flight.V_a_mps=30", "a = b=c"], {"flight.V_a_mps": 30, "a": "b=c"}),
        ("tune", "lag", ["1:2:3"], "--lag must be LOW:HIGH, got '1:2:3'."),
        ("tune", "lag", ["1", "2" * 99], f"--lag must be LOW:HIGH, got '1, {'2' * 77}'."),
        ("identify", "assume", ["phi"], "--assume must be CHANNEL=RAD_S, got 'phi'."),
        ("fly", "changes", ["=3"], "--set: must be KEY=VALUE in one line, got '=3'."),
        ("fly", "changes", ["a="], "--set: must be KEY=VALUE in one line, got 'a='."),
        ("fly", "changes", ["a"], "--set: must be KEY=VALUE in one line, got 'a'."),
        ("fly", "changes", ["a=1\nb=2"], "--set: must be KEY=VALUE in one line, got 'a=1\\nb=2'."),
    ],
)
def test_words_of_an_option_are_read_or_refused_in_eighty_characters(command, name, words, value):
    option = options_of(command)[name]

    if not isinstance(value, str):
        assert option.words(words) == value
        return
    with pytest.raises(ft.InputError, match=f"^{re.escape(value)}$"):
        option.words(words)


def test_an_angle_is_in_degrees_on_the_command_line_alone():
    angles = {
        (name, x.name): x.flag
        for name in TEXTS
        for x in options_of(name).values()
        if x.argument.unit == "rad"
    }

    assert angles == {
        ("tube", "start"): "--start-deg",
        ("trim", "gamma"): "--gamma",
        ("trim", "phi"): "--phi",
        ("identify", "gamma"): "--gamma",
    }
    trim = inspect.signature(Command(BODIES["trim"], TEXTS["trim"]).function()).parameters
    _, phi = get_args(trim["phi"].annotation)
    assert phi.callback(180.0) == pytest.approx(180.0 * DEG, rel=1e-15)
    assert re.search(r", deg(\.| \[)", phi.help)


@pytest.mark.parametrize("place", [x["verb"] for x in TEXTS.values() if "verb" in x])
def test_docstring_and_annotation_of_a_verb_state_the_same_units(place):
    module, _, name = place.partition(":")
    text = inspect.getdoc(getattr(import_module(f"flighttune.{module}"), name)) or ""
    described = {
        name: words
        for names, words in re.findall(r"^(\w[\w, ]*) : (.*)$", text, re.MULTILINE)
        for name in names.split(", ")
        if not words.startswith("as for")
    }
    units = {
        name: re.findall(r"(?<!or )\bfloat, (?!1\b|optional)([^,]+)", words)
        for name, words in described.items()
    }

    arguments = verbs.arguments_of(place)
    assert {x: [arguments[x].unit] * bool(arguments[x].unit) for x in described} == units


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("tune paper --frontier --page x.html", "must be absent with --frontier"),
        ("tune paper --frontier --lag 0.1:0.2", "must be absent with --frontier"),
        ("tune paper --frontier --out x.json", "must be a folder with --frontier"),
        ("tune paper --points 5", "--points must be absent without --frontier"),
        ("mission circuit --plan --flights 5", "`flights` must be absent with --plan"),
        ("mission circuit --plan --page x.html", "`page` must be absent with --plan"),
        ("mission circuit --plan --per-hour x.toml", "`--per-hour` must be absent with --plan"),
        ("design aerosonde", "--out must be given for an aircraft that is shipped"),
    ],
)
def test_options_that_do_not_go_together_are_refused_in_a_line(
    tmp_path, monkeypatch, command, words
):
    monkeypatch.chdir(tmp_path)

    _, error = flighttune(*command.split(), status=2)

    assert words in error
    assert error.count("\n") == 1
    assert not [*tmp_path.iterdir()]
