"""A flown run keeps the signals it was flown with."""

import pickle

import numpy as np
import pandas as pd
import pytest
from made_up import made_up_run

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


# Two signals over 2 s.
T = np.array([0.0, 1.0, 2.0])


def signals(chi_err, V, t=T):
    return pd.DataFrame({"V": V, "chi_err": chi_err}, index=pd.Index(t, name="t"))


@pytest.mark.parametrize(
    ("gains", "name", "scenario", "kind"),
    [
        (ft.PAPER_GAINS, "paper", {}, "paper"),
        (ft.loop.rate_gains(ft.PAPER_GAINS, V_a=25.0), "paper", {}, "exact"),
        (ft.PAPER_GAINS, "mine:paper", {"law": [{"name": "mine", "kind": "exact"}]}, "paper"),
        (None, "mine:paper", {}, "python"),
    ],
)
def test_the_law_of_a_run_is_the_one_of_its_gains(gains, name, scenario, kind):
    made = made_up_run({"chi": [0.0]}, [0.0], gains=gains, gains_name=name, scenario=scenario)

    assert made.provenance.law.kind == kind
