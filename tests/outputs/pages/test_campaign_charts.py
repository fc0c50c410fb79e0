"""Charts and tables of a campaign hold what its rows say, of each group apart."""

import re

import numpy as np
import pytest
from made_up_campaign import made_up_plan, made_up_rows
from scipy import stats

from flighttune.campaigns.statistics import findings
from flighttune.outputs.drawing.palette import LIMIT
from flighttune.outputs.pages import campaign, campaign_charts
from tests.outputs.drawing import test_chart as reading

TENTH = 0.051
"""Shares are said in tenths of a percent."""

RUNS = 160
"""Two plants with two gain sets fly 40 times each."""

BOUNDS = (
    {"at_most": {"chi": {"ITAE": 4.0}}},
    {"at_most": {"gamma": {"MO_deg": 12.0}}, "gains": "K3", "plant": "kinematic"},
)


@pytest.fixture(scope="module")
def found():
    """Findings of made-up rows, of which some flights were lost."""
    plan = made_up_plan(*BOUNDS, runs=RUNS)
    rows = made_up_rows(plan)
    rows["gamma.MO_rad"] = np.radians(10.0)
    assert (rows["status"] != "completed").any()
    return findings.findings_of(rows, plan)


def test_the_share_of_each_group_stands_below_its_name_between_the_ends_of_its_interval(found):
    shares, _ = campaign_charts.rates(found)

    groups = found.values["groups"]
    texts = [
        one.text
        for one in reading.drawn(shares).iter(f"{reading.SVG}text")
        if one.get("class") == "named"
    ]
    heights = [y[0] for _, y in shares._seen]
    assert len(heights) == 2 * len(groups) == 8
    for k, group in enumerate(groups):
        (ends, (y, _)), (value, (at,)) = shares._seen[2 * k : 2 * k + 2]
        own = found.rows[(found.rows["plant"] + " / " + found.rows["gains"]) == group["group"]]
        assert value == pytest.approx([100.0 * own["success"].mean()])
        assert ends == pytest.approx([100.0 * group["lo"], 100.0 * group["hi"]])
        assert k + 0.5 < y == at < k + 1.0
        name, ends = texts[k].split(": ")
        said = [float(x) for x in re.findall(r"[\d.]+", ends)]
        assert name == group["group"]
        wanted = [100.0 * group[key] for key in ("success", "lo", "hi")]
        assert said == pytest.approx(wanted, abs=TENTH)
    assert shares.y_range == (0.0, 4.0)
    assert shares.downwards


def test_the_measure_that_decides_is_a_step_at_each_completed_flight(found):
    _, steps = campaign_charts.rates(found)

    assert steps.title == "Flights by ITAE of course"
    assert [words for words, *_ in steps.legend] == ["ITAE of course at most 4 rad\u00a0s²"]
    for (x, share), (group, rows) in zip(steps._seen, found.groups(), strict=True):
        done = rows[rows["status"] == "completed"]["chi.ITAE"].to_numpy()
        # between two values of it the curve is the share of all flights at or below
        middle = np.sort(done)[:-1] + 0.5 * np.diff(np.sort(done))
        place = np.searchsorted(x, middle, side="right") - 1
        below = (done[None, :] <= middle[:, None]).sum(axis=1) / len(rows)
        assert share[place] == pytest.approx(100.0 * below), group
        assert share[0] == 0.0
        assert share[-1] == pytest.approx(100.0 * len(done) / len(rows))
    assert share[-1] == 100.0
    assert any(x[1][-1] < 100.0 for x in steps._seen)


def test_a_bound_is_drawn_in_the_unit_of_its_axis_and_says_whose_it_is(found):
    chart = campaign_charts._distribution(found, "gamma.MO_rad")

    ((words, colour, _),) = chart.legend
    assert words == "overshoot of path angle at most 12 deg (kinematic / K3)"
    assert colour == LIMIT
    low, high = chart.x_ends()
    assert low < 10.0 < 12.0 < high < 13.0
    for x, _ in chart._seen:
        assert x == pytest.approx(10.0)
    x_0, x_1, *_, width, _ = reading.plot_axes(chart)
    (bound,) = [x.get("d") for x in reading.elements(chart, "path") if "V" in x.get("d")]
    across = float(re.match(r"M([\d.]+),0V", bound)[1])
    assert x_0 + across / width * (x_1 - x_0) == pytest.approx(12.0, abs=0.01)
    titles = [x.title for x in campaign_charts.distributions(found)]
    assert titles == [
        "Flights by ITAE of course", "Flights by ITAE of path angle",
        "Flights by overshoot of path angle",
    ]  # fmt: skip


def test_each_flight_is_a_dot_over_the_strongest_parameter_and_a_lost_one_a_cross_at_the_top(found):
    first, second = campaign_charts.scatter_panels(found)

    strongest = campaign_charts.influential_parameters(found)
    assert first.x == "initial airspeed [m/s]"
    assert first.title == "ITAE of course over initial airspeed"
    done = found.rows["status"] == "completed"
    worst = found.rows["chi.ITAE"][done].max()
    for chart, key in zip((first, second), strongest, strict=False):
        for k, (_, rows) in enumerate(found.groups()):
            (x, y), (at, top) = chart._seen[2 * k : 2 * k + 2]
            there = (rows["status"] == "completed").to_numpy()
            assert x == pytest.approx(rows[key].to_numpy()[there])
            assert y == pytest.approx(rows["chi.ITAE"].to_numpy()[there])
            assert at == pytest.approx(rows[key].to_numpy()[~there])
            assert (top == worst).all()
    tips = [one.text for one in reading.drawn(first).iter(f"{reading.SVG}title")]
    assert len(tips) == len(found.rows)
    assert all(tip.startswith("run ") for tip in tips)


def test_success_and_influences_are_told_of_each_group(found):
    matters, success = (campaign.influence_table(found, x) for x in ("chi.ITAE", "success"))

    assert matters.title == "Influence on ITAE of χ"
    strongest = [row["parameter"] for row in matters.records]
    groups = [group["group"] for group in found.values["groups"]]
    rows = {(row["group"], row["parameter"]): row for row in matters.records}
    for group in groups:
        own = found.rows[(found.rows["plant"] + " / " + found.rows["gains"]) == group]
        done = own[own["status"] == "completed"]
        rho, p = stats.spearmanr(done["flight.V_a_mps"], done["chi.ITAE"])
        row = rows[group, "initial airspeed"]
        assert row["rho"] == pytest.approx(rho)
        assert row["p"] <= max(p, 1e-12)
        assert all(0.0 <= row["share"] <= 1.0 for row in matters.records)
    assert {row["group"] for row in success.records} <= {*groups}
    assert strongest[0] == "initial airspeed"
    assert campaign.summary(found)[1] == "What matters most: initial airspeed."


def test_percentiles_of_a_metric_are_those_of_completed_flights_in_its_unit(found):
    table = campaign.metrics_table(found)

    rows = {row["metric"]: row for row in table.records}
    for key, heading, factor in (
        ("chi.ITAE", "ITAE of χ [rad\u00a0s²]", 1.0),
        ("gamma.MO_rad", "overshoot of γ [deg]", 180.0 / np.pi),
    ):
        for group, of_group in found.groups():
            done = of_group[of_group["status"] == "completed"][key]
            told = rows[heading][group.label]
            for name, q in (("p05", 0.05), ("p50", 0.5), ("p95", 0.95)):
                assert told[name] == pytest.approx(factor * done.quantile(q))
