"""The promises of SECURITY.md: of commands that there are, each with tests that there are."""

import re
from pathlib import Path

from commands import COMMANDS, FORMER

import flighttune as ft

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split(" | ")]
    for line in TEXT.splitlines()
    if line.startswith("| ") and not line.startswith("| promise")
]

# Words in backticks that are no commands: ends of files, and what a row says of one.
WORDS = re.compile(r"\.\w+|SCENARIO@GAINS|my_law\.py")


def named(cell):
    return re.findall(r"`([^`]+)`", cell)


def test_every_promise_has_tests_that_exist():
    missing, file = [], ""
    for promise, _, cell in ROWS:
        tests = named(cell)
        assert tests, promise
        for test in tests:
            place, _, function = test.partition("::")
            file = place or file
            path = ROOT / file
            if not path.is_file() or f"\ndef {function}(" not in path.read_text(encoding="utf-8"):
                missing.append(f"{file}::{function}")
    assert not missing


def test_promises_are_about_todays_verbs():
    for _, about, _ in ROWS:
        for words in named(about):
            if words.startswith("ft."):
                assert hasattr(ft, words.removeprefix("ft."))
            elif not WORDS.fullmatch(words):
                assert words.split()[0] in COMMANDS, words


def test_no_command_of_an_earlier_version_is_named():
    # some are names of Python, which stand behind `ft.`
    gone = [name for name in FORMER if re.search(rf"`(flighttune )?{re.escape(name)}\b", TEXT)]
    assert gone == []


def test_every_row_has_a_promise_in_whole_sentences():
    assert len(ROWS) >= 20
    for promise, *others in ROWS:
        assert len(others) == 2, promise
        assert re.fullmatch(r"[A-Z].*\.", promise), promise
