"""A flown run keeps the signals it was flown with."""

import pickle

import numpy as np
import pandas as pd
import pytest
from made_up import made_up_run

import flighttune as ft
from flighttune.flight.loop import run as runs


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
LOW, HIGH = np.array([[-1.0, 0.0], [-1.0, 2.0], [-3.0, 2.0]]), np.array([[1, 0], [3, 4], [5, 6.0]])
BOUNDS = runs.Bounds(T, LOW, HIGH, ("chi_err", "V"))


def signals(chi_err, V, t=T):
    return pd.DataFrame({"V": V, "chi_err": chi_err}, index=pd.Index(t, name="t"))


def test_bounds_say_how_far_a_flight_goes_in_them():
    """Middles are 0, 1, 1 and 0, 3, 4; half widths 1, 2, 4 and 0, 1, 2."""
    flown = signals([0.5, -1.0, 4.0], [0.0, 2.5, 5.0])

    assert BOUNDS.half_widths.tolist() == [[1, 0], [2, 1], [4, 2]]
    assert BOUNDS.pairs[1].tolist() == [[-1, 3], [2, 4]]
    assert BOUNDS.distances(flown).tolist() == [[0.5, 0.0], [2.0, 0.5], [3.0, 1.0]]
    # half a second in, all is half-way
    between = signals([0.0, 0.0], [1.5, 1.5], [0.5, 0.5])
    assert BOUNDS.distances(between).tolist() == [[0.5, 0.0]] * 2
    assert BOUNDS.reach(flown).tolist() == [0.75, 0.5]
    assert BOUNDS.ratios(flown) == {"chi": 4.0 / 3.0, "V": 2.0}
    assert BOUNDS.share(flown) == 0.75
    assert BOUNDS.contain(flown)


@pytest.mark.parametrize(
    ("chi_err", "V", "inside", "share"),
    [
        ([0.0, 3.0, 5.0], [0.0, 4.0, 2.0], True, 1.0),  # on the bounds
        ([0.0, 4.0, 1.0], [0.0, 3.0, 4.0], False, 1.5),
        ([0.0, 1.0, 1.0], [0.0, 1.0, 4.0], False, 2.0),
        ([0.0, 1.0, 1.0], [2e-9, 3.0, 4.0], False, 2.0),  # a point counts as 1e-9 wide
    ],
)
def test_a_flight_outside_uses_more_than_its_bounds(chi_err, V, inside, share):
    flown = signals(chi_err, V)

    assert BOUNDS.contain(flown) is inside
    assert BOUNDS.share(flown) == share


def test_bounds_last_as_long_as_a_flight_and_claim_nothing_after_their_end():
    long = BOUNDS.lasting(np.arange(5.0))
    short = BOUNDS.of(["V"]).lasting(T[:2])

    assert long.low[:3].tolist() == BOUNDS.low.tolist()
    assert np.isnan([long.low[3:], long.high[3:]]).all()
    assert long.contain(signals([0.0, 0.0, 0.0, 99.0, -99.0], [0, 3, 3, 9, 9], np.arange(5.0)))
    assert (short.low.tolist(), short.high.tolist()) == ([[0.0], [2.0]], [[0.0], [4.0]])
    assert short.names == ("V",)
    assert not short.contain(signals([0.0, 0.0], [0.0, 4.1], T[:2]))


def test_a_claim_about_a_run_is_said_in_words():
    def claim(**more):
        return runs.RunClaim(
            kind="proven", title="tube", sentence="", bounds=BOUNDS, units={}, **more
        )

    inside, outside = signals([0.0, 0, 0], [0.0, 3, 3]), signals([0.0, 4, 0], [0.0, 3, 3])
    alarm = runs.Alarm(at_s=1.234, why="path")
    assert (claim().said(inside), claim().said(outside)) == (
        "inside the tube.", "outside the tube.",
    )  # fmt: skip
    assert claim(no_claim="a log", alarm=alarm).said(inside) == (
        "no claim about this flight: a log"
    )
    assert claim(alarm=alarm).said(inside) == (
        "Alarm at 1.23 s: the path differs from that of healthy flights."
    )
    (found,) = runs.claims_around([claim()], "V")
    assert found[1].tolist() == [[0, 2, 2], [0, 4, 6]]
    assert [*runs.claims_around([claim()], "phi")] == []


def test_a_run_is_shown_by_its_label_its_end_and_its_samples(run):
    assert repr(run) == f"Run kinematic / paper: completed, {len(run.t)} samples"
    assert "kinematic / paper" in run._repr_html_()


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
