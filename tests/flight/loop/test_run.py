"""A flown run keeps the signals it was flown with."""

import pickle

import numpy as np
import pytest

import flighttune as ft


@pytest.fixture(scope="module")
def run():
    return ft.fly(ft.load_scenario("paper_as_printed")).runs[0]


@pytest.mark.parametrize(
    "change",
    [
        lambda signals: signals.__setitem__("mine", 1.0),
        lambda signals: signals.loc.__setitem__((0.0, "chi"), 1.0),
        lambda signals: signals.iloc.__setitem__((0, 0), 1.0),
        lambda signals: signals.pop("chi"),
    ],
)
def test_signals_take_no_new_column_and_lose_none(run, change):
    columns, values = list(run.signals.columns), run.signals.to_numpy().copy()

    with pytest.raises((TypeError, ValueError), match=r"must stay as they were|read-only"):
        change(run.signals)

    assert list(run.signals.columns) == columns
    assert np.array_equal(run.signals.to_numpy(), values)


def test_a_run_sent_to_another_process_is_as_closed(run):
    again = pickle.loads(pickle.dumps(run))

    assert np.array_equal(again.signals.to_numpy(), run.signals.to_numpy())
    with pytest.raises(TypeError, match="`signals`"):
        again.signals["mine"] = 1.0
