"""Pages of a route: the map with corridor and wind, distances along it, and calm air in words."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from claimed import SENTENCE, claimed
from made_up import run_file

import flighttune as ft
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.drawing.chart import DASHED
from flighttune.outputs.drawing.palette import LIMIT
from flighttune.outputs.pages.charts import planned_path, route_charts, route_map
from flighttune.outputs.pages.panels import errors
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
    _, height, *_ = route_charts(drawn(flown))
    numbers = [
        float(text.get("x"))
        for text in tree_of(height).iter(f"{SVG}text")
        if text.get("class") == "named"
    ]
    assert len(numbers) > 3
    assert np.diff(numbers).min() > digits


def test_the_corridor_is_to_the_sides_of_the_path_and_says_how_much_wider_it_is(run):
    charts = route_charts(drawn(run))

    # twice as wide 6 m are less than 2 % of the leg, and five times more
    assert "corridor, drawn 2 times as wide" in [name for name, *_ in charts[0].legend]
    east, north = path_with(charts[0], "fill-opacity")
    assert (east.min(), east.max()) == pytest.approx((2.0 * LEFT, 2.0 * RIGHT), abs=PIXEL_M)
    assert (north.min(), north.max()) == pytest.approx((0.0, LENGTH), abs=STEP_M)
    titles = ["Map", "Height over the start", "To the right of the route", "Below the route"]
    assert [chart.title for chart in charts] == titles
    assert charts[2].y_ends()[1] > RIGHT


def test_a_required_envelope_is_drawn_on_both_sides_where_it_is_flown(run):
    expect = [{"at_most": {"cross_track": {"within": [[0, 8], [5, 4]]}}}]
    made = replace(run.provenance, scenario={**run.provenance.scenario, "expect": expect})

    _, _, chart, _ = route_charts(drawn(replace(run, provenance=made)))
    along_km, bound = path_with(chart, "--limit")

    assert ("required envelope", LIMIT, DASHED) in chart.legend
    late = along_km * 1000.0 > run.signals["along"].loc[5.0]
    assert 0 < late.sum() < len(late)
    # One of both sides, within a pixel of the axis from -8 to 8 m.
    assert np.abs(bound) == pytest.approx(np.where(late, 4.0, 8.0), abs=16.0 / 100.0)


def test_the_arrow_points_where_the_air_moves(run):
    tables = {**run.provenance.scenario, "wind": {"speed_mps": 6.0, "from_deg": 270.0}}
    windy = replace(run, provenance=replace(run.provenance, scenario=tables))

    chart, *_ = route_charts(drawn(windy))

    east, north = path_with(chart, "var(--ink)")
    assert east[1] > east[0]
    assert north[1] == pytest.approx(north[0], abs=PIXEL_M)
    assert "wind at the start 6 m/s" in chart.svg()


@pytest.mark.parametrize("winds", ["0 to 6 m/s from anywhere", "5 to 9 m/s from 240 to 280 deg"])
def test_drawn_winds_are_written_below_without_an_arrow(run, winds):
    tables = {**run.provenance.scenario, "wind": {"speed_mps": 6.0, "from_deg": 270.0}}
    path = planned_path(drawn(run))
    assert path is not None

    chart = route_map(ft.scenario_from(tables), path, path.s, None, winds)

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
