"""Charts: where values stand, what a page reads back from them, and names that meet nothing."""

import re
from itertools import combinations
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flighttune.outputs.drawing.chart import DASHED, DOTTED, Chart, Sheet, evenly, key, peaks, ticks
from flighttune.outputs.drawing.palette import LineStyle

BLUE, RUST = "#1F78B4", "#B15928"
SOLID = LineStyle(RUST, "rust", 2.0, dashed=False)
TENTH = 0.051
"""Coordinates are written in tenths of a pixel."""

SIX_DIGITS = 1e-4
"""Ends of axes are written in six digits, of which their difference loses up to two."""

SVG = "{http://www.w3.org/2000/svg}"


def drawn(chart):
    """The chart as a tree; HTML needs no namespace, XML does."""
    return ElementTree.fromstring(chart.svg().replace("<svg ", f'<svg xmlns="{SVG[1:-1]}" ', 1))


def plot_axes(chart):
    """Ends of both axes, and width and height of the plot in pixels, as a page reads them."""
    return [float(value) for value in drawn(chart).get("data-axes").split()]


LETTER, LINE = 5.5, 11.0
"""Width of a letter and height of a line of text, pixels, or a little less."""


def box_of(text):
    x, y = float(text.get("x")), float(text.get("y"))
    return x, y - LINE, x + LETTER * len(text.text), y


def apart(boxes):
    """Whether no two boxes share a place."""
    return all(
        a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        for a, b in combinations(boxes, 2)
    )


def points(path):
    return np.array(
        [[float(x) for x in pair.split(",")] for pair in re.findall(r"[-\d.]+,[-\d.]+", path)]
    )


def test_values_come_back_from_pixels_as_a_page_reads_them():
    x, y = np.linspace(0.0, 20.0, 50), np.geomspace(1e-3, 10.0, 50)
    chart = Chart(title="decay", y="norm", log="y")
    chart.line(x, y, BLUE, run="kinematic / paper")

    x0, x1, y0, y1, width, height = plot_axes(chart)
    (path,) = (one for one in drawn(chart).iter(f"{SVG}path") if one.get("data-name"))
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
    boxes = [box_of(one) for one in named]

    assert [one.text for one in named] == [name for _, _, name in where]
    assert min(left for left, *_ in boxes) >= 0.0
    assert apart(boxes)


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


@pytest.mark.parametrize(
    ("ends", "count", "labels"),
    [
        ((1.0, 1000.0), 5.0, ["1", "10", "100", "1000"]),
        ((1.0, 100.0), 5.0, ["1", "2", "5", "10", "20", "50", "100"]),
        ((1e-8, 1e8), 3.0, ["10⁻⁸", "10⁻⁴", "1", "10⁴", "10⁸"]),
        ((1e-3, 9e-3), 3.0, ["10⁻³", "2·10⁻³", "5·10⁻³"]),
        ((0.9e-2, 6e4), 12.0, ["0.01", "0.1", "1", "10", "100", "1000", "10⁴"]),
        ((30.0, 70.0), 3.0, ["30", "40", "50", "60", "70"]),  # one of 1, 2 and 5 is too few
    ],
)
def test_labels_of_a_logarithmic_axis_are_decades_with_2_and_5_if_there_are_few(
    ends, count, labels
):
    assert [label for _, label in ticks(ends, count, log=True)] == labels


@pytest.mark.parametrize(
    ("log", "values", "ends"),
    [
        ("", [0.0, 10.0], (-0.5, 10.5)),
        ("", [np.nan, 4.0, -np.inf, 4.0], (2.0, 6.0)),
        ("", [0.2, 0.2], (-0.3, 0.7)),
        ("", [], (0.0, 1.0)),
        ("y", [-3.0, 0.0], (0.1, 1.0)),
        ("y", [-3.0, 1.0, 100.0], (10.0**-0.1, 10.0**2.1)),
        ("y", [2.0, 2.2], (2.0 / 1.05, 2.2 * 1.05)),
    ],
)
def test_an_axis_has_a_twentieth_of_room_around_its_data(log, values, ends):
    chart = Chart(title="", log=log)
    chart.line(np.arange(len(values)), values, BLUE)

    assert chart.y_ends() == pytest.approx(ends)


def test_an_x_axis_has_the_room_that_its_chart_states():
    charts = [Chart(title="", x_room=room) for room in (0.0, 0.1)]
    for chart in charts:
        chart.line([2.0, 4.0], [0.0, 1.0], BLUE)

    assert [chart.x_ends() for chart in charts] == [(2.0, 4.0), pytest.approx((1.8, 4.2))]


@pytest.mark.parametrize("extent", [(100.0, 1.0), (1.0, 100.0)])
def test_equal_scales_have_room_for_both_extents_about_their_middles(extent):
    chart = Chart(title="", equal=True)
    chart.line([0.0, extent[0]], [0.0, extent[1]], BLUE)

    low_x, high_x, low_y, high_y, width, height = plot_axes(chart)

    assert (high_x - low_x) / width == pytest.approx((high_y - low_y) / height, rel=SIX_DIGITS)
    assert (low_x + high_x, low_y + high_y) == pytest.approx(extent, rel=SIX_DIGITS)
    assert high_x > extent[0]
    assert high_y > extent[1]
    # the longer one fills most of its axis
    assert max(extent[0] / (high_x - low_x), extent[1] / (high_y - low_y)) > 0.85


UNIT = {"x_range": (0.0, 10.0), "y_range": (0.0, 5.0)}


def pixels(x, y, numbers=1):
    """Place of values of `UNIT` in a plot of 392 x 192 pixels, as sums of written `numbers`."""
    return pytest.approx((39.2 * x, 192.0 - 38.4 * y), abs=numbers * TENTH)


def elements(chart, tag):
    """Marks of a chart by tag, without the axis and the grid."""
    (plot,) = (one for one in drawn(chart).iter(f"{SVG}svg") if one.get("class") == "plot")
    return [one for one in plot.iter(f"{SVG}{tag}") if one.get("class") not in ("axis", "grid")]


def test_bars_stand_at_their_places_between_their_ends():
    chart = Chart(title="", **UNIT)
    chart.bars([0.0, 4.0], [3.0, 1.0], [BLUE, RUST], x=[2.0, 5.0])

    ends = (2, 0, 3), (5, 1, 4)
    for bar, (place, low, high) in zip(elements(chart, "rect"), ends, strict=True):
        left, top, wide, tall = (float(bar.get(key)) for key in ("x", "y", "width", "height"))
        assert (left, top) == pixels(place - 0.32, high)
        assert (left + wide, top + tall) == pixels(place + 0.32, low, 2)
    alone = Chart(title="")
    alone.bars([0.0, 0.0], [1.0, 1.0], [BLUE, BLUE])
    assert alone.x_ends() == (-0.5, 1.5)


def test_levels_uprights_and_spans_stand_at_their_values():
    chart = Chart(title="", **UNIT)
    chart.level(2.0, RUST)
    chart.upright(3.0)
    chart.spans([(1.0, 2.0), (4.0, 6.0)], 0.25, BLUE)
    chart.spans([], 0.5, BLUE)

    level, upright, spans = (one.get("d") for one in elements(chart, "path"))
    assert level == "M0,115.2H392.0"
    assert upright == "M117.6,0V192.0"
    assert spans == "M39.2,144.0H78.4M156.8,144.0H235.2"


def test_points_are_drawn_in_their_shapes_and_those_without_a_value_are_not():
    chart = Chart(title="", **UNIT)
    chart.points([1.0, np.nan, 3.0], [1.0, 1.0, 2.0], BLUE, filled=[True, True, False], size=4.0)
    chart.points(5.0, 2.5, RUST, shape="cross", size=5.0, tips=["here"])
    chart.points(5.0, 2.5, RUST, shape="plus", size=6.0)

    first, hollow = elements(chart, "circle")
    assert [float(first.get(x)) for x in ("cx", "cy", "r")] == [39.2, 153.6, 4.0]
    assert (float(hollow.get("cx")), float(hollow.get("cy"))) == pixels(3.0, 2.0)
    assert (first.get("fill"), hollow.get("fill")) == (None, "var(--paper)")
    cross, plus = elements(chart, "path")
    assert cross.get("d") == "M191.0,91.0l10,10M191.0,101.0l10,-10"
    assert plus.get("d") == "M190.0,96.0h12M196.0,90.0v12"
    assert [one.text for one in cross] == ["here"]
    assert {one.get("opacity") for one in elements(chart, "g")} == {"1.0"}


def test_a_chart_that_grows_downwards_begins_at_the_top():
    chart = Chart(title="", downwards=True, **UNIT)
    chart.points(2.0, 1.0, BLUE)

    (dot,) = elements(chart, "circle")
    assert (float(dot.get("cx")), float(dot.get("cy"))) == pixels(2.0, 4.0)


def test_names_of_a_legend_go_on_in_the_next_row_where_a_row_is_full():
    names = [letter * 20 for letter in "abcdef"]
    sheet = Sheet(charts=[Chart(title="a")], columns=1, legend=[(x, BLUE, "") for x in names])

    root = ElementTree.fromstring(sheet.svg())

    boxes = [box_of(x) for x in root.iter(f"{SVG}text") if x.text in names]
    assert len(boxes) == len(names)
    assert apart(boxes)
    assert max(right for _, _, right, _ in boxes) <= float(root.get("viewBox").split()[2])
    rows = [top for _, top, *_ in boxes]
    assert rows == sorted(rows)
    assert 1 < len({*rows}) < len(names)
    # a line of 24 pixels stands before each name, at the middle of its height
    marks = [x for x in root.iter(f"{SVG}g") if x.find(f"{SVG}path[@d='M0,0H24']") is not None]
    assert len(marks) == len(names)
    for mark, (left, top, _, bottom) in zip(marks, boxes, strict=True):
        x, y = (float(z) for z in re.findall(r"[\d.]+", mark.get("transform")))
        assert x + 24.0 < left
        assert y == pytest.approx(0.5 * (top + bottom), abs=0.25 * LINE)


def test_charts_of_a_sheet_leave_room_for_each_other_and_for_their_titles():
    sizes = {"a": 100.0, "b": 150.0, "c": 90.0}
    panels = [Chart(title=title, height=tall) for title, tall in sizes.items()]
    panels[1].line([0.0, 1.0], [0.0, 1.0], BLUE, name="error")

    def placed(**options):
        root = ElementTree.fromstring(Sheet(charts=panels, **options).svg())
        shown = [x for x in root.iter(f"{SVG}svg") if x.get("class") == "chart"]
        places = [[float(x.get(key)) for key in ("x", "y", "width", "height")] for x in shown]
        assert [tall for *_, tall in places] == [*sizes.values()]
        boxes = [(x, y, x + wide, y + tall) for x, y, wide, tall in places]
        _, _, wide, tall = (float(x) for x in root.get("viewBox").split())
        assert max(right for _, _, right, _ in boxes) <= wide
        assert max(bottom for *_, bottom in boxes) <= tall
        return boxes

    first, second, third = placed(title="All")

    # the first two stand side by side, and the third begins the next row
    assert apart([first, second, third])
    assert first[1] == second[1] >= 2 * LINE
    assert (third[0], third[1] >= second[3] + LINE) == (first[0], True)
    # a title and a legend of the sheet move its charts down
    assert placed()[0][1] <= first[1] - LINE
    assert placed(title="All", legend=[("shared", BLUE, "")])[0][1] >= first[1] + LINE


def test_drawn_samples_are_all_or_evenly_spaced():
    assert evenly(3).tolist() == [0, 1, 2]
    assert evenly(10, most=4).tolist() == [0, 3, 6, 9]
    assert peaks(np.arange(7.0), most=7).tolist() == [*range(7)]
    # smallest and largest of each stretch of 5, with a gap of one of them
    values = np.array([3.0, 9, 1, 2, 2, 5, 5, np.nan, 7, 4, 6, 6, 6, 0, 8])
    assert peaks(values, most=6).tolist() == [0, 1, 2, 7, 8, 9, 13, 14]
    # stretches of 3, 4, 3 and 4 samples
    alone = np.where(np.arange(14) == 6, 9.0, 0.0)
    assert 6 in peaks(alone, most=8)


def test_a_band_is_a_closed_line_along_one_edge_and_back_along_the_other():
    chart = Chart(title="", **UNIT)
    chart.band([0.0, 5.0], [1.0, 2.0], [3.0, 4.0], BLUE, run="a run", name="bound")

    (band,) = [one for one in drawn(chart).iter(f"{SVG}path") if one.get("class") == "band"]
    assert band.get("d") == "M0.0,153.60 196.0,115.20 196.0,38.40 0.0,76.80Z"
    assert (band.get("data-run"), band.get("data-part")) == ("a run", "bound")
    assert chart.legend == [("bound", BLUE, "band")]
    chart.area([0.0, 5.0, 5.0], [0.0, 0.0, 5.0], RUST, name="corridor")
    (area,) = [x for x in elements(chart, "path") if x.get("data-part") == "corridor"]
    assert area.get("d") == "M0.0,192.00 196.0,192.00 196.0,0.00Z"


def test_texts_stand_at_their_points_and_names_of_rows_at_the_left_edge():
    chart = Chart(title="", **UNIT)
    chart.text(5.0, 2.5, "here", anchor="middle", shift=(3.0, -7.0))
    chart.name_row(1.0, "row")

    here, row = elements(chart, "text")
    places = [(x.get("x"), x.get("y"), x.get("text-anchor"), x.get("data-at")) for x in (here, row)]
    assert places == [
        ("199.0", "89.0", "middle", "196.0,96.0"), ("2.0", "153.6", "start", "left,153.6"),
    ]  # fmt: skip


@pytest.mark.parametrize(("x", "right"), [(5.0, True), (9.5, False)])
def test_the_name_of_a_point_stands_to_its_right_where_there_is_room(x, right):
    chart = Chart(title="", **UNIT)
    chart.label_points([(x, 2.5, "abcdefghij")])

    (name,) = elements(chart, "text")
    left, *_, end, _ = box_of(name)
    assert left > 39.2 * x if right else end < 39.2 * x
    assert elements(chart, "path") == []


def test_a_name_that_stands_away_from_its_point_has_a_line_to_it():
    chart = Chart(title="", **UNIT)
    chart.label_points([(5.0, 2.5, "abcde")] * 6)

    boxes = [box_of(x) for x in elements(chart, "text")]
    assert len(boxes) == 6
    assert apart(boxes)
    far = [box for box in boxes if not box[1] - 2.0 * LINE < 96.0 < box[3] + 2.0 * LINE]
    lines = [x.get("d") for x in drawn(chart).iter(f"{SVG}path") if "L" in x.get("d")]
    assert len(lines) == len(far) > 0
    assert all(line.startswith("M196.0,96.0L") for line in lines)


def test_labels_stand_at_their_values_outside_of_the_plot():
    chart = Chart(
        title="", x="t [s]", x_ticks=[(5.0, "five\nand half")], y_ticks=[(2.5, "mid")], **UNIT
    )

    texts = {x.text: (float(x.get("x")), float(x.get("y"))) for x in drawn(chart) if x.get("x")}

    (plot,) = (x for x in drawn(chart).iter(f"{SVG}svg") if x.get("class") == "plot")
    left, top = float(plot.get("x")), float(plot.get("y"))
    assert texts["mid"][0] < left
    assert texts["mid"][1] == pytest.approx(top + 96.0, abs=0.5 * LINE)
    below = [texts[name] for name in ("five", "and half", "t [s]")]
    assert [x for x, _ in below] == [left + 196.0] * 3
    heights = [y for _, y in below]
    assert heights == sorted(heights)
    assert heights[0] - LINE > top + 192.0


@pytest.mark.parametrize(
    ("options", "fixed", "log"),
    [
        ({"x_ticks": [(5.0, "five")]}, "x", ""),
        ({"y_ticks": []}, "y", ""),
        ({}, "", ""),
        ({"log": "x", "x_range": (0.1, 10.0)}, "", "x"),
        ({"log": "x"}, "", ""),  # from zero on
        ({"x_range": (1.0, 10.0), "y_range": (1.0, 5.0)}, "", ""),
        ({"log": "y", "x_range": (1.0, 10.0), "y_range": (1.0, 5.0)}, "", "y"),
        ({"log": "x", "x_range": (1.0, 10.0), "y_range": (1.0, 5.0)}, "", "x"),
        ({"log": "xy", "x_range": (1.0, 10.0), "y_range": (1.0, 5.0)}, "", "xy"),
    ],
)
def test_a_page_knows_the_axes_that_are_logarithmic_or_have_labels_of_their_own(
    options, fixed, log
):
    root = drawn(Chart(title="", **(UNIT | options)))

    assert (root.get("data-fixed"), root.get("data-log")) == (fixed, log)


def test_a_line_of_a_run_has_its_colour_its_dashes_and_its_name_under_the_pointer():
    chart = Chart(title="", y="the label [m]", **UNIT)
    for style, run in ((LineStyle(BLUE, "blue", 2.0, dashed=True), "a"), (SOLID, "b")):
        chart.run_line([0.0, 5.0], [0.0, 5.0], style, run)
    chart.run_line([0.0, 5.0], [0.0, 5.0], SOLID, "c", dash=DOTTED, hover=False)

    lines = elements(chart, "path")
    assert [one.get("stroke-dasharray") for one in lines] == [DASHED, None, DOTTED]
    assert [one.get("data-run") for one in lines] == ["a", "b", "c"]
    assert [one.get("data-name") for one in lines] == ["a", "b", None]
    colours = [one.get("stroke") for one in lines]
    assert colours[0] != colours[1] == colours[2]
    turned = [one for one in drawn(chart) if "rotate(-90)" in one.get("transform", "")]
    assert [one.text for one in turned] == ["the label [m]"]


@pytest.mark.parametrize(
    ("dash", "mark"),
    [
        ("band", "rect"), ("dot", "circle"), ("cross", "M8.0,-4.0l8,8M8.0,4.0l8,-8"),
        ("plus", "M8.0,0.0h8M12.0,-4.0v8"), ("", "M0,0H24"), (DASHED, "M0,0H24"),
    ],
)  # fmt: skip
def test_a_legend_shows_what_it_names_as_it_is_drawn(dash, mark):
    one = ElementTree.fromstring(key(BLUE, dash))

    assert (one.get("d") or one.tag) == mark
    assert one.get("stroke-dasharray") == (dash if dash == DASHED else None)


# Zeros, denormals, infinities and NaN among them.
NUMBERS = st.lists(st.floats(), min_size=2, max_size=6)
RANGES = st.none() | st.tuples(st.floats(), st.floats())


@given(x=NUMBERS, y=NUMBERS, log=st.sampled_from(["", "x", "y", "xy"]), ends=RANGES)
def test_an_axis_takes_all_numbers(x, y, log, ends):
    x, y = zip(*zip(x, y, strict=False), strict=True)
    for y_range in (None, ends):
        chart = Chart(title="all", log=log, y_range=y_range)
        chart.line(x, y, BLUE, name="line")
        chart.band(x, y, y[::-1], BLUE)
        chart.area(x, y, BLUE)
        chart.points(x, y, BLUE)
        chart.bars(x, y, [BLUE] * len(x))
        chart.spans([(x[0], y[0])], 0.5, BLUE)
        chart.level(y[0])
        chart.upright(x[0])
        chart.text(x[0], y[0], "text")
        chart.label_points([(x[-1], y[-1], "point")])

        places = re.findall(r' (?:d|x|y|x1|y1|cx|cy|width|height|data-at)="([^"]*)"', chart.svg())
        assert not re.search("nan|inf", " ".join(places))
        x_0, x_1, y_0, y_1, *_ = plot_axes(chart)
        assert x_0 < x_1
        assert y_0 < y_1
        assert np.isfinite([x_0, x_1, y_0, y_1]).all()
