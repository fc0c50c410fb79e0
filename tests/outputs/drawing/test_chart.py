"""Charts: where values stand, what a page reads back from them, and names that meet nothing."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from flighttune.outputs.drawing.chart import Chart, Sheet, ticks

BLUE, RUST = "#1F78B4", "#B15928"
TENTH = 0.051
"""Coordinates are written in tenths of a pixel."""

SVG = "{http://www.w3.org/2000/svg}"


def drawn(chart):
    """The chart as a tree; HTML needs no namespace, XML does."""
    return ElementTree.fromstring(chart.svg().replace("<svg ", f'<svg xmlns="{SVG[1:-1]}" ', 1))


def points(path):
    return np.array(
        [[float(x) for x in pair.split(",")] for pair in re.findall(r"[-\d.]+,[-\d.]+", path)]
    )


def test_values_come_back_from_pixels_as_a_page_reads_them():
    x, y = np.linspace(0.0, 20.0, 50), np.geomspace(1e-3, 10.0, 50)
    chart = Chart(title="decay", y="norm", log="y")
    chart.line(x, y, BLUE, run="kinematic / paper")

    root = drawn(chart)
    x0, x1, y0, y1, width, height = (float(v) for v in root.get("data-axes").split())
    (path,) = (one for one in root.iter(f"{SVG}path") if one.get("data-name"))
    px, py = points(path.get("d")).T

    assert path.get("data-name") == path.get("data-run") == "kinematic / paper"
    assert x0 + px / width * (x1 - x0) == pytest.approx(x, abs=TENTH / width * (x1 - x0))
    back = y0 * (y1 / y0) ** (1.0 - py / height)
    assert np.log(back) == pytest.approx(np.log(y), abs=TENTH / height * np.log(y1 / y0))


def test_a_line_and_a_band_have_gaps_where_there_is_no_value():
    x = np.arange(6.0)
    low = np.array([0.0, 0.0, np.nan, 0.0, 0.0, 0.0])
    high = np.array([1.0, 1.0, 1.0, 1.0, np.nan, 1.0])
    chart = Chart(title="bound")
    chart.line(x, low, BLUE)
    chart.band(x, low, high, RUST)

    line, band = (
        one.get("d")
        for one in drawn(chart).iter(f"{SVG}path")
        if one.get("class") in (None, "band")
    )

    assert line.count("M") == 2
    assert band.count("M") == band.count("Z") == 3


@pytest.mark.parametrize(
    ("ends", "labels"),
    [
        ((0.0, 20.0), ["0", "5", "10", "15", "20"]),
        ((-9.0, 9.0), ["−5", "0", "5"]),
        ((-0.07, 0.04), ["−0.06", "−0.04", "−0.02", "0.00", "0.02", "0.04"]),
        ((0.8, 1.3), ["0.8", "0.9", "1.0", "1.1", "1.2", "1.3"]),
    ],
)
def test_labels_are_round_and_have_their_decimals(ends, labels):
    assert [label for _, label in ticks(ends, 5.0)] == labels


@pytest.mark.parametrize("log", [False, True])
@pytest.mark.parametrize("decade", [-8, -3, 0, 3, 8])
@pytest.mark.parametrize("ratio", [1.001, 1.07, 3.0, 40.0, 1e5])
def test_every_axis_has_at_least_two_labels_inside_its_ends(decade, ratio, log):
    low = 1.37 * 10.0**decade

    found = ticks((low, ratio * low), 3.0, log)

    values = [value for value, _ in found]
    assert 2 <= len(found) <= 12
    assert all(low * (1 - 1e-9) <= value <= ratio * low * (1 + 1e-9) for value in values)
    assert len({label for _, label in found}) == len(found) or ratio < 1.01


def test_names_of_points_cover_neither_points_nor_each_other():
    rng = np.random.default_rng(1)
    where = [(float(x), float(y), f"gains_{i}") for i, (x, y) in enumerate(rng.random((8, 2)))]
    where += [(0.5, 0.5, "paper"), (0.501, 0.501, "tuned")]
    chart = Chart(title="frontier", x_range=(0.0, 1.0), y_range=(0.0, 1.0))
    chart.label_points(where)

    named = [one for one in drawn(chart).iter(f"{SVG}text") if one.get("class") == "named"]
    boxes = [
        (float(one.get("x")), float(one.get("y")) - 10.0, 5.5 * len(one.text)) for one in named
    ]

    assert [one.text for one in named] == [name for _, _, name in where]
    for i, (x, y, wide) in enumerate(boxes):
        assert 0.0 <= x
        for u, v, other in boxes[:i]:
            assert x + wide <= u or u + other <= x or y + 11.0 <= v or v + 11.0 <= y


def test_words_are_text_and_not_markup():
    chart = Chart(title="<b>", y="<i>")
    chart.line([0.0, 1.0], [0.0, 1.0], BLUE, name="<script>")
    chart.points([0.0], [0.0], RUST, tips=["<u> & co"])
    chart.text(0.0, 0.0, "<s>")

    for text in (chart.svg(), Sheet(charts=[chart], columns=1, title="<title>").svg()):
        assert not set(re.findall(r"<(\w+)", text)) & {"b", "i", "script", "u", "s"}
        assert "&lt;u&gt; &amp; co" in text


def test_a_sheet_is_an_svg_file_of_its_own_with_titles_and_names():
    charts = []
    for name in ("Course", "Path angle", "Mismatch"):
        charts.append(Chart(title=name))
        charts[-1].line([0.0, 1.0], [0.0, 1.0], BLUE, name="error")

    root = ElementTree.fromstring(Sheet(charts=charts, title="Gap\x1b").svg())

    texts = [one.text for one in root.iter(f"{SVG}text")]
    assert root.tag == f"{SVG}svg"
    assert {"Gap ", "Course", "Path angle", "Mismatch"} <= set(texts)
    assert texts.count("error") == 3
    assert "prefers-color-scheme: dark" in root.find(f"{SVG}style").text


def test_rounding_errors_about_zero_are_no_scale():
    chart = Chart(title="a level flight")
    chart.line([0.0, 1.0], [0.0, -1.3e-15], BLUE)
    assert chart.y_ends() == pytest.approx((-0.5, 0.5))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_step_with_one_round_value_between_the_ends_gives_way_to_the_next_smaller_one(sign):
    # of steps of 50, next to (88 - 4) / 2, there is 50 alone
    values = [value for value, _ in ticks((4.0 * sign, 88.0 * sign), 2.0)]

    assert sorted(sign * value for value in values) == [20.0, 40.0, 60.0, 80.0]
