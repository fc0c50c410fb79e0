"""A search of gains by what it returns: its candidates, its requirements and its best ones."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import flighttune as ft

pytestmark = pytest.mark.slow

LAW = {"kind": "kinematic"}
LAG = {"kind": "point_mass_lag", "roll_lag_rad_s": 4.0, "n_z_lag_rad_s": 4.0}
SPEEDS = '{ key = "flight.V_a_mps", distribution = "uniform", lower = 20.0, upper = 30.0 }'


def turn(*expect, gains=("paper", "K1"), plant=(LAW,), **tables):
    """Two seconds of a turn with requirements."""
    return ft.scenario_from(
        {
            "title": "a turn",
            "gains": [*gains],
            "flight": {"V_a_mps": 25.0, "chi_deg": 10.0, "duration_s": 2.0},
            "reference": {"chi_deg": 0.0, "gamma_deg": 0.0},
            "plant": [*plant],
            "expect": [*expect],
        }
        | tables
    )


LOOSE = {"at_most": {"chi": {"ITAE": 2.0}}}
TIGHT = {"at_most": {"chi": {"ITAE": 0.05}, "gamma": {"ITAE": 0.01}}}
MARGINS = {"at_least": {"loop": {"gain_margin_dB": 1.0, "phase_margin_deg": 5.0}}}


@cache
def met():
    return ft.meet(turn(LOOSE, MARGINS), budget=60, start="paper", workers=1)


@cache
def missed():
    return ft.meet(turn(TIGHT, MARGINS), budget=40, start="paper", workers=1)


@pytest.mark.parametrize("searched", [met, missed])
def test_requirements_are_those_that_fly_measures_with_the_gains(searched):
    found = searched()
    own = {"name": "own", "K_P": found.gains.K_P.tolist(), "K_I": found.gains.K_I.tolist()}
    flown = ft.fly(turn(gains=[own]))

    for row in found.requirements:
        channel, _, measure = row["measure"].partition(".")
        if row["why"]:
            assert math.isnan(row["value"])
            continue
        if channel != "loop":
            value = flown.metrics.at[(flown.runs[0].label, channel), measure]
            assert row["value"] == pytest.approx(value)
        sign = 1.0 if row["sense"] == "at most" else -1.0
        assert row["margin"] == pytest.approx(sign * (row["bound"] - row["value"]) / row["bound"])
    assert (found.status == "met") == all(row["margin"] >= 0.0 for row in found.requirements)


@pytest.mark.parametrize("searched", [met, missed])
def test_the_gains_are_the_best_of_all_candidates(searched):
    found = searched()
    (best,) = (trial for trial in found.trials if trial.gains is found.gains)

    assert found.candidates == found.flights == len(found.trials)
    assert best.met == (found.status == "met")
    assert len({trial.gains.K.tobytes() for trial in found.trials}) == len(found.trials)
    for trial in found.trials:
        assert trial.met == (trial.worst.max() <= 0.0)
        assert trial.worst_draw == 0
        assert best.met or best.worst[0] <= trial.worst[0]
        assert trial.excess.shape == (1, len(found.requirements))
    near = [t for t in found.trials if t.worst[0] <= best.worst[0] and t.met]
    assert best.metric <= min((t.metric for t in near), default=math.inf)


def test_the_values_of_the_start_are_those_of_its_flight():
    found = missed()
    flown = ft.fly(turn(gains=["paper"]))
    for row in found.requirements[:2]:
        channel, _, measure = row["measure"].partition(".")
        assert row["start"] == pytest.approx(
            flown.metrics.at[(flown.runs[0].label, channel), measure]
        )
    assert (found.start, found.start_met) == ("paper", False)
    assert found.start_gains.K.tolist() == ft.PAPER_GAINS.K.tolist()
    assert [row["measure"] for row in found.trade_offs] == ["chi.ITAE", "gamma.ITAE"]
    for i, row in enumerate(found.trade_offs):
        seen = [trial.checks[0][i].value for trial in found.trials]
        assert row["alone"] == np.nanmin(seen) <= row["value"]
        assert row["beside"] is None  # none meets the other bound


def test_what_is_worse_than_at_the_start_is_told_with_both_values():
    """Lower measures of the loop by over 1 %, and larger mean errors of the last quarter."""
    found = missed()
    sets = [{"name": "own", **found.gains.as_lists()}, "paper"]
    flown = ft.fly(turn(gains=sets))
    R_K = [flown.indicators[name].R_K for name in ("own", "paper")]
    errors = {
        f"{channel}.end_error_rad": [
            abs(flown.metrics_of(x)[channel]["MS_rad"]) for x in flown.runs
        ]
        for channel in ("chi", "gamma")
    }
    worse = {row["measure"]: [row["value"], row["start"]] for row in found.worse}

    assert worse["loop.R_K"] == pytest.approx(R_K)
    assert 0.99 * R_K[1] > R_K[0]
    assert {x: y for x, y in worse.items() if "error" in x} == {
        x: pytest.approx(y) for x, y in errors.items() if y[0] > 1.01 * y[1]
    }
    assert all(value < 0.99 * start for name, (value, start) in worse.items() if "loop" in name)
    assert found.tuned_for == {"aircraft": [], "V_a_mps": [25.0]}


def test_the_worst_draw_is_told_by_the_requirements_on_which_draws_differ():
    trial = met().trials[0]

    def of(*excess):
        return replace(trial, excess=np.array(excess))

    differing = of([-0.5, -0.3, 0.2], [-0.5, -0.1, 0.2], [-0.5, -0.2, 0.2])
    assert differing.worst.tolist() == [0.2, 0.2, 0.2]
    assert (differing.worst_draw, differing.met) == (1, False)
    assert of([-0.5, 0.2], [-0.5, 0.2]).worst_draw == 0
    assert of([-0.5, 0.0], [-0.1, -0.2]).met
    assert not of([-0.5, 1e-9], [-0.1, -0.2]).met


def test_a_start_is_the_nearest_of_the_gains_that_the_scenario_flies():
    found = ft.meet(turn(TIGHT), budget=3, workers=1)
    both = {name: ft.fly(turn(gains=[name])).metrics for name in ("paper", "K1")}
    worst = {
        name: max(rows.xs(channel, level=1)["ITAE"].iloc[0] / bound
                  for channel, bound in (("chi", 0.05), ("gamma", 0.01)))
        for name, rows in both.items()
    }  # fmt: skip

    assert found.start_of_scenario
    assert found.start == min(worst, key=worst.get)
    assert {found.start, *found.other_starts} >= {"paper", "K1"}


@pytest.mark.parametrize(
    ("stated", "asked"),
    [
        ({}, {"gain_margin_dB": 6.0, "phase_margin_deg": 35.0}),
        ({"phase_margin_deg": 20.0}, {"gain_margin_dB": 6.0, "phase_margin_deg": 20.0}),
        ({"phase_margin_rad": 0.5}, {"gain_margin_dB": 6.0, "phase_margin_rad": 0.5}),
        ({"gain_margin_dB": 3.0, "phase_margin_deg": 20.0},
         {"gain_margin_dB": 3.0, "phase_margin_deg": 20.0}),
    ],
)  # fmt: skip
def test_margins_are_required_where_the_scenario_states_none(stated, asked):
    expect = [LOOSE, {"at_least": {"loop": stated}}] if stated else [LOOSE]

    found = ft.meet(turn(*expect), budget=2, start="paper", workers=1)

    rows = [row for row in found.requirements if row["measure"].startswith("loop.")]
    assert {row["measure"].partition(".")[2]: row["bound"] for row in rows} == asked


def test_only_plants_with_requirements_are_flown():
    lag = {**LOOSE, "plant": "point_mass_lag"}

    one = ft.meet(turn(lag, plant=[LAW, LAG]), budget=1, start="paper", workers=1)
    both = ft.meet(turn(LOOSE, plant=[LAW, LAG]), budget=2, start="paper", workers=1)

    assert (one.flights, both.flights) == (1, 2)
    assert {row["run"].partition(":")[0] for row in both.requirements} >= {
        "kinematic", "point_mass_lag"
    }  # fmt: skip
    with pytest.raises(ft.InputError, match="`budget` must be at least 2 flights"):
        ft.meet(turn(LOOSE, plant=[LAW, LAG]), budget=1, start="paper", workers=1)


def test_unstable_gains_are_not_flown_and_no_start():
    wild = {"name": "wild", "K_P": (-np.eye(2)).tolist(), "K_I": (-np.eye(2)).tolist()}

    found = ft.meet(turn(LOOSE, gains=["paper", wild]), budget=4, workers=1)

    assert found.start == "paper"
    unstable = [trial for trial in found.trials if trial.worst[0] > 1999.0]
    assert len(found.trials) - len(unstable) == found.candidates == found.flights


@pytest.mark.parametrize("metric", ["ITAE", "chi.MO_deg", "chi.MO_rad"])
def test_a_metric_is_that_of_the_flights(metric):
    found = ft.meet(turn(LOOSE, MARGINS), budget=2, start="paper", metric=metric, workers=1)
    flown = ft.fly(turn(gains=["paper"])).metrics
    of = {name: flown.xs(name, level=1).iloc[0] for name in ("chi", "gamma")}
    expected = {
        "ITAE": of["chi"]["ITAE"] + of["gamma"]["ITAE"],
        "chi.MO_rad": of["chi"]["MO_rad"],
        "chi.MO_deg": math.degrees(of["chi"]["MO_rad"]),
    }

    assert found.metric["name"] == metric
    assert found.metric["start"] == pytest.approx(expected[metric])


def test_draws_that_are_counted_are_fresh_and_at_least_200(tmp_path):
    file = tmp_path / "c.toml"
    file.write_text(f'title = "x"\nscenario = "paper"\nruns = 8\ndisperse = [{SPEEDS}]\n')

    with pytest.raises(ft.InputError, match=r"at least \d+ flights, 32 for .* (200|400) for"):
        ft.meet(turn(LOOSE), campaign=file, budget=100, start="paper", workers=1)
