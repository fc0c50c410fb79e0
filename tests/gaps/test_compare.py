"""Which runs are compared, what differs in their scenarios, and which of two values is better."""

import math
from dataclasses import replace

import numpy as np
import pytest

import flighttune as ft

SHORT = {"flight.duration_s": 3.0, "expect": []}


@pytest.fixture(scope="module")
def printed():
    return ft.fly("paper_as_printed", changes=SHORT)


def source(flown, *names):
    """The first flight under other names of plant and gains."""
    runs = []
    for name in names:
        plant, gains = name.split("/")
        made_by = replace(flown.runs[0].provenance, plant=plant, gains_name=gains)
        runs.append(replace(flown.runs[0], provenance=made_by))
    return replace(flown, runs=tuple(runs))


@pytest.mark.parametrize(
    ("first", "second", "pairs", "alone"),
    [
        ("k/a", "j/b", ["k/a j/b"], []),
        ("k/a k/b", "k/b j/a", ["k/b k/b"], ["A k/a", "B j/a"]),
        ("k/a j/a", "j/b k/b", ["k/a k/b", "j/a j/b"], []),
        ("k/a k/b", "j/b j/a", ["k/a j/a", "k/b j/b"], []),
        ("k/a k/b", "k/c", None, None),
        ("k/a", "k/a j/b", ["k/a k/a"], ["B j/b"]),
        ("k/a j/b", "k/c j/c", None, None),
        ("k/a j/a", "m/a m/b", None, None),
    ],
)
def test_runs_are_paired_by_plant_and_gains_or_by_the_one_that_both_vary(
    printed, first, second, pairs, alone
):
    found = ft.compare(source(printed, *first.split()), source(printed, *second.split()))

    assert found.comparable is (pairs is not None)
    if pairs is None:
        assert "no run of one" in found.reason
        return

    def label(run):
        return f"{run.provenance.plant}/{run.provenance.gains_name}"

    assert [f"{label(pair.a)} {label(pair.b)}" for pair in found.pairs] == pairs
    said = [(x[0], x.rpartition(": ")[2].replace(" ", "")) for x in found.unpaired]
    assert said == [(x[0], x[2:]) for x in alone]
    assert [*found.metrics["pair"].unique()] == [*range(len(pairs))]


def test_a_source_alone_is_compared_run_by_run_with_its_first(printed):
    several = source(printed, "k/a", "j/a", "k/b")
    still = replace(several.runs[1], signals=several.runs[1].signals.iloc[:1])

    every = ft.compare(several).pairs
    assert [pair.b.label for pair in every] == ["j / a", "k / b"]
    assert {pair.a.label for pair in every} == {"k / a"}
    two = ft.compare(replace(several, runs=(several.runs[0], still, several.runs[2])))
    assert len(two.pairs) == 1
    assert len(two.missing) == 1
    assert "j / a" in two.missing[0]
    with pytest.raises(ft.InputError, match="at least two runs must have flown, got k / a"):
        ft.compare(replace(several, runs=(several.runs[0], still)))


NEITHER, NEVER = {"PT_s", "n_z_min", "n_z_max"}, {"rise_s", "settling_s"}


def test_the_better_value_is_the_lower_one_or_the_nearer_to_zero(printed):
    """Of a time that is never reached any other is better; some values have no better one."""
    (run,) = printed.runs[:1]
    mirrored = {
        name: sign * run.signals[name]
        for name, sign in (("chi_err", -1.3), ("gamma_err", 0.7), ("phi_cmd", 1.5))
    }
    other = replace(run, signals=run.signals.assign(**mirrored))
    slower = ft.fly("paper_as_printed", changes=SHORT | {"flight.duration_s": 12.0}).runs
    seen = set()
    for a, b in ((run, other), (other, run), (run, run), (slower[0], slower[-1])):
        rows = ft.compare(a, b).metrics
        for row in rows.itertuples():
            low, high = row.a, row.b
            if row.name in NEVER:
                low, high = (math.inf if math.isnan(x) else x for x in (low, high))
            if row.name == "MS_rad":
                low, high = abs(low), abs(high)
            expected = "a" if low < high else "b"
            if math.isclose(low, high, rel_tol=1e-12):
                expected = "same"
            if row.name in NEITHER or math.isnan(low) or math.isnan(high):
                expected = ""
            assert row.better == expected, row
            assert row.diff == pytest.approx(row.b - row.a, nan_ok=True)
            seen.add(expected)
    assert seen == {"a", "b", "same", ""}


def test_what_differs_are_settings_and_neither_manoeuvre_nor_words(printed):
    (run,) = printed.runs[:1]
    tables = run.provenance.scenario
    was = tables["controller"]
    controller = was | {"rate_hz": 100.0, "feed_forward": not was["feed_forward"]}
    changed = tables | {"title": "another", "controller": controller}
    other = replace(run, provenance=replace(run.provenance, scenario=changed))

    (pair,) = ft.compare(run, other).pairs

    differs = {"controller.rate_hz", "controller.feed_forward"}
    assert pair.differs.keys() == differs
    for key, (before, after) in pair.differs.items():
        name = key.partition(".")[2]
        assert (before, after) == (was[name], controller[name])


def test_a_distance_is_that_at_equal_times_and_none_without_positions(printed):
    (run,) = printed.runs[:1]
    t = run.t
    moved = run.signals.assign(
        north=run.signals["north"] + np.where(t < 2.0, 3.0 * t, 0.0),
        east=run.signals["east"] - np.where(t < 2.0, 4.0 * t, 0.0),
    )
    other = replace(run, signals=moved.iloc[::5])

    (pair,) = ft.compare(run, other).pairs
    last = t[::5][t[::5] < 2.0 - 1e-9].max()
    assert pair.max_distance == pytest.approx(5.0 * last, abs=1e-6)
    assert pair.t_max_distance == pytest.approx(last)
    # gaps of positions are filled by straight lines, at the ends by the nearest value
    holes = moved.copy()
    holes.loc[(t > 0.99) & (t < 1.01) | (t < 0.05), "east"] = np.nan
    (same,) = ft.compare(run, replace(run, signals=holes)).pairs
    assert same.max_distance == pytest.approx(5.0 * t[t < 2.0 - 1e-9].max(), abs=1e-3)
    (blind,) = ft.compare(run, replace(run, signals=run.signals.drop(columns="north"))).pairs
    assert math.isnan(blind.max_distance)
    assert math.isnan(blind.t_max_distance)
