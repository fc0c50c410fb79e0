"""The table of signals names only signals, and what it says to be drawn is drawn."""

import tomllib

import pytest
from places import ROOT

TABLES = tomllib.loads((ROOT / "flighttune/base/signals.toml").read_text(encoding="utf-8"))
SIGNALS, SUBJECTS = TABLES["signals"], TABLES["subjects"]
TEXTS = tomllib.loads(
    (ROOT / "flighttune/outputs/recording/texts.toml").read_text(encoding="utf-8")
)


@pytest.mark.parametrize("key", ["thin", "reference", "measured"])
def test_another_signal_of_a_plot_has_a_row_and_the_same_unit(key):
    named = {name: row[key] for name, row in SIGNALS.items() if row.get(key)}
    assert len(named) >= 3
    for name, other in named.items():
        assert SIGNALS[other]["unit"] == SIGNALS[name]["unit"], name


def test_a_subject_has_the_signals_of_its_error_and_command_and_can_be_named():
    for name, subject in SUBJECTS.items():
        assert not SIGNALS[subject["error"]].get("derived"), name
        assert not subject.get("command") or f"{subject['command']}_cmd" in SIGNALS, name
        named = SIGNALS.get(name, {}) | subject
        assert named["symbol"], name
        assert named["word"], name


def test_each_group_of_signals_is_drawn_once_in_a_tab():
    groups = {row.get("group", "") for row in SIGNALS.values()} - {""}
    drawn = [group for tab in TEXTS["tabs"].values() for group in tab.get("groups", ())]

    assert sorted(drawn) == sorted(groups)
