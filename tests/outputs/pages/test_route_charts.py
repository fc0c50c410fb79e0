"""Pages of a route: the map with corridor and wind, distances along it, and calm air in words."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from claimed import SENTENCE, claimed
from made_up import run_file

import flighttune as ft
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing.chart import DASHED, Chart
from flighttune.outputs.drawing.palette import LIMIT
from flighttune.outputs.pages import charts
from flighttune.outputs.pages.panels import errors
from flighttune.routes.fence import Fence
from tests.outputs.drawing.test_chart import SVG, points
from tests.outputs.drawing.test_chart import drawn as tree_of

LEFT, RIGHT, LENGTH = -1.0, 3.0, 500.0
STEP_M = 2.0  # distance between points of a path
PIXEL_M = 0.2  # a tenth of a pixel of the map


@pytest.fixture(scope="module")
def run():
    """A flight of the law along a leg to the north, with a made-up corridor."""
    leg = [{"north_m": 0.0, "east_m": 0.0}, {"north_m": LENGTH, "east_m": 0.0}]
    tables = ft.load_scenario("circuit").as_dict()
    del tables["expect"]
    tables |= {"plant": [{"kind": "kinematic"}], "route": {"waypoint": leg}}
    (flown,) = ft.fly(ft.scenario_from(tables)).runs
    return claimed(flown, cross_track=(LEFT, RIGHT))


def drawn(run):
    return [(run, run_styles([run])[run.label])]


def path_with(chart, look):
    """East and north of a path of a map, read back from its picture as a page does."""
    root = tree_of(chart)
    x0, x1, y0, y1, width, height = (float(number) for number in root.get("data-axes").split())
    d = next(
        one.get("d")
        for one in root.iter(f"{SVG}path")
        if look in ElementTree.tostring(one, "unicode")
    )
    x, y = points(d).T
    return x0 + x / width * (x1 - x0), y1 - y / height * (y1 - y0)


def test_numbers_of_waypoints_that_are_near_do_not_cover_each_other():
    digits = 14.0  # width of two of 11.5 px, px
    rows = [
        (350.0 * i, north) for i in range(6) for north in (1200.0 * (i % 2), 1200.0 * (1 - i % 2))
    ]
    lawn = [{"north_m": north, "east_m": east} for east, north in [(0.0, -600.0), *rows[1:]]]
    tables = ft.load_scenario("circuit").as_dict()
    del tables["expect"]
    tables |= {"plant": [{"kind": "kinematic"}], "route": {"waypoint": lawn}}
    (flown,) = ft.fly(ft.scenario_from(tables)).runs
    _, height, *_ = charts.route_charts(drawn(flown))
    numbers = [
        float(text.get("x"))
        for text in tree_of(height).iter(f"{SVG}text")
        if text.get("class") == "named"
    ]
    assert len(numbers) > 3
    assert np.diff(numbers).min() > digits


def test_the_corridor_is_to_the_sides_of_the_path_and_says_how_much_wider_it_is(run):
    shown = charts.route_charts(drawn(run))

    # twice as wide 6 m are less than 2 % of the leg, and five times more
    assert "corridor, drawn 2 times as wide" in [name for name, *_ in shown[0].legend]
    east, north = path_with(shown[0], "fill-opacity")
    assert (east.min(), east.max()) == pytest.approx((2.0 * LEFT, 2.0 * RIGHT), abs=PIXEL_M)
    assert (north.min(), north.max()) == pytest.approx((0.0, LENGTH), abs=STEP_M)
    titles = ["Map", "Height over the start", "To the right of the route", "Below the route"]
    assert [chart.title for chart in shown] == titles
    assert shown[2].y_ends()[1] > RIGHT


def test_a_required_envelope_is_drawn_on_both_sides_where_it_is_flown(run):
    expect = [{"at_most": {"cross_track": {"within": [[0, 8], [5, 4]]}}}]
    made = replace(run.provenance, scenario={**run.provenance.scenario, "expect": expect})

    _, _, chart, _ = charts.route_charts(drawn(replace(run, provenance=made)))
    along_km, bound = path_with(chart, "--limit")

    assert ("required envelope", LIMIT, DASHED) in chart.legend
    late = along_km * 1000.0 > run.signals["along"].loc[5.0]
    assert 0 < late.sum() < len(late)
    # One of both sides, within a pixel of the axis from -8 to 8 m.
    assert np.abs(bound) == pytest.approx(np.where(late, 4.0, 8.0), abs=16.0 / 100.0)


def test_the_arrow_points_where_the_air_moves(run):
    tables = {**run.provenance.scenario, "wind": {"speed_mps": 6.0, "from_deg": 270.0}}
    windy = replace(run, provenance=replace(run.provenance, scenario=tables))

    chart, *_ = charts.route_charts(drawn(windy))

    east, north = path_with(chart, "var(--ink)")
    assert east[1] > east[0]
    assert north[1] == pytest.approx(north[0], abs=PIXEL_M)
    assert "wind at the start 6 m/s" in chart.svg()


@pytest.mark.parametrize("winds", ["0 to 6 m/s from anywhere", "5 to 9 m/s from 240 to 280 deg"])
def test_drawn_winds_are_written_below_without_an_arrow(run, winds):
    tables = {**run.provenance.scenario, "wind": {"speed_mps": 6.0, "from_deg": 270.0}}
    path = charts.planned_path(drawn(run))
    assert path is not None

    chart = charts.route_map(ft.scenario_from(tables), path, path.s, None, winds)

    assert f"wind {winds}" in chart.svg()
    with pytest.raises(StopIteration):
        path_with(chart, "var(--ink)")


@pytest.mark.slow
def test_a_page_of_a_route_begins_with_its_map_and_the_claim(run, tmp_path):
    source = run_file(tmp_path / "leg.parquet", run)

    page = ft.report(source, tmp_path / "r.html").path.read_text(encoding="utf-8")

    top = page.partition("<details")[0]
    assert "<b>Map</b>" in top
    assert f"inside the counted band.</li><li>Counted band: {SENTENCE}.</li>" in top
    assert "From above" not in page


def test_a_band_of_another_signal_has_a_chart_of_its_own(run):
    *_, chart = errors(drawn(claimed(run, V_a=(24.0, 26.0))))

    assert (chart.title, chart.y) == ("Airspeed", "V_a [m/s]")
    assert chart.y_ends()[0] < 24.0 < 26.0 < chart.y_ends()[1] < 27.0


def test_heights_and_errors_of_a_flight_are_drawn_over_the_way_in_its_corridor(run):
    """A `height_err` is positive below the route."""
    legs = [(0.0, 0.0, 0.0), (LENGTH, 0.0, 60.0), (LENGTH, 900.0, 60.0)]
    points = [{"north_m": n, "east_m": e, "up_m": up} for n, e, up in legs]
    tables = run.provenance.scenario | {"route": {"waypoint": points}}
    here = replace(run, claims=(), provenance=replace(run.provenance, scenario=tables))
    bounded = claimed(here, cross_track=(LEFT, RIGHT), height_err=(-4.0, 2.0))
    signals = bounded.signals

    above, height, across, below = charts.route_charts(drawn(bounded))

    (low_x, low), (_, high), (s_km, planned), (along, flown), *_ = height._seen
    assert (s_km[0], s_km[-1]) == (0.0, pytest.approx(charts.planned_path(drawn(here)).s[-1] / 1e3))
    assert planned[-1] - planned[0] == pytest.approx(60.0)
    at = np.interp(low_x, s_km, planned)
    there = np.isfinite(low)
    assert (low - at)[there] == pytest.approx(-2.0, abs=0.2)
    assert (high - at)[there] == pytest.approx(4.0, abs=0.2)
    assert along[-1] == pytest.approx(signals["along"].iloc[-1] / 1e3)
    assert flown[-1] == pytest.approx(-signals["down"].iloc[-1])
    _, (east, north), (easts, norths), (flown_east, flown_north) = above._seen
    assert (easts.tolist(), norths.tolist()) == ([e for _, e, _ in legs], [n for n, *_ in legs])
    assert (east[-1], north[-1]) == pytest.approx((900.0, LENGTH), abs=STEP_M)
    assert "planned path" in [name for name, *_ in above.legend]
    texts = [one.text for one in tree_of(above).iter(f"{SVG}text") if one.get("class") == "named"]
    assert texts == ["1", "2", "3"]
    last = signals[["east", "north"]].iloc[-1].tolist()
    assert [flown_east[-1], flown_north[-1]] == pytest.approx(last)
    for chart, name, ends in (
        (across, "cross_track", (LEFT, RIGHT)), (below, "height_err", (-4.0, 2.0))
    ):  # fmt: skip
        assert chart._seen[0][1].tolist() == [0.0]
        assert [float(y[0]) for _, y in chart._seen[1:3]] == pytest.approx(ends)
        assert chart._seen[-1][1][-1] == pytest.approx(signals[name].iloc[-1])
        assert chart.x_range == height.x_range
    assert [name for name, *_ in height.legend] == ["corridor", "planned"]


def test_edges_of_a_fence_are_closed_on_the_map_and_its_ends_stand_over_the_heights(run):
    ring = np.array([[0.0, 0.0], [0.0, 90.0], [80.0, 90.0], [80.0, 0.0]])
    fence = Fence(
        rings=(ring,), outside=(False,), sag=np.zeros(4), names=("a", "b", "c", "d"), low=-np.inf,
        high=120.0,
    )  # fmt: skip
    path = charts.planned_path(drawn(run))
    above, height = (Chart(title=title) for title in ("Map", "Height"))

    charts.draw_edges(above, fence)
    charts.draw_ends(height, fence, path)
    charts.draw_ends(height, replace(fence, low=-30.0, high=np.inf), path)

    ((east, north),) = above._seen
    corners = np.column_stack([north, east]).reshape(-1, 3, 2)
    assert np.isnan(corners[:, 2]).all()
    assert np.array_equal(corners[:, 0], ring)
    assert np.array_equal(corners[:, 1], np.roll(ring, -1, axis=0))
    assert above.legend == [("fence", LIMIT, "")]
    assert [y.tolist() for _, y in height._seen] == [[120.0] * 2, [-30.0] * 2]
    assert [x.tolist() for x, _ in height._seen] == [[0.0, path.length / 1e3]] * 2
    assert height.legend == [("ceiling", LIMIT, ""), ("floor", LIMIT, DASHED)]
