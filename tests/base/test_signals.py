"""The table of signals names only signals, and what it says to be drawn is drawn."""

import tomllib
from importlib import resources

import pytest

from flighttune.base import signals
from flighttune.outputs.recording.plots import TABS

TEXTS = tomllib.loads(
    (resources.files("flighttune") / "outputs/recording/texts.toml").read_text(encoding="utf-8")
)
TABS_OF_GROUPS = [group for tab in TEXTS["tabs"].values() for group in tab.get("groups", ())]


@pytest.mark.parametrize("key", ["thin", "reference", "measured"])
def test_another_signal_of_a_plot_has_a_row_and_the_same_unit(key):
    named = {name: other for name, row in signals.SIGNALS.items() if (other := getattr(row, key))}

    assert len(named) >= 3
    for name, other in named.items():
        assert signals.SIGNALS[other].unit == signals.SIGNALS[name].unit, name


def test_a_subject_has_the_signals_of_its_error_and_command_and_can_be_named():
    for name, subject in signals.SUBJECTS.items():
        assert subject.error in signals.SIGNALS, name
        assert not subject.command or f"{subject.command}_cmd" in signals.SIGNALS, name
        assert subject.symbol, name
        assert subject.word, name


def test_each_group_is_drawn_once_in_a_tab_with_a_title_for_each_signal():
    groups = {row.group for row in signals.ALL_SIGNALS.values()} - {""}

    assert sorted(TABS_OF_GROUPS) == sorted(groups)
    drawn = [plot for plots in TABS.values() for plot in plots]
    assert [plot.signal for plot in drawn if not plot.title] == []
    assert {plot.signal for plot in drawn} == {
        n for n, row in signals.ALL_SIGNALS.items() if row.short
    }


def test_a_derived_signal_is_in_no_file():
    derived = {name for name, row in signals.ALL_SIGNALS.items() if row.derived}

    assert len(derived) > 5
    assert not derived & signals.SIGNALS.keys()
