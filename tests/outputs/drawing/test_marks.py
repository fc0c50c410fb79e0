"""Marks, axes and names of a chart, read back from the SVG that it becomes."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from drawn import Drawn, drawn, number
from made_up import made_up_run

import flighttune as ft

PLOT = 392.0, 192.0
"""Width and height of the plot in a chart of the usual size, pixels."""
EDGE = 58.0, 8.0
"""Its place in the chart."""
NAN = np.nan


@pytest.fixture(scope="module")
def run():
    signals = ("chi_err", "gamma_err", "phi", "n_z")
    return made_up_run({x: [0.0, 1.0] for x in signals}, [0.0, 1.0])


@pytest.fixture(scope="module")
def empty(run):
    """Makes an empty chart of the kind that a plot has."""
    kind = type(ft.plot(run).charts[0])
    return lambda title="t", **more: kind(title=title, **more)


def plain(chart):
    """A chart read back from its SVG."""
    return Drawn(chart.svg())


def places(chart, tag="text"):
    """Attributes of marks in the plot of a chart, as numbers where they are."""
    found = []
    for one in plain(chart).plot.iter(tag):
        given = {k: v for k, v in one.attrib.items() if k != "class"}
        found.append({k: float(v) if re.fullmatch(r"-?[\d.]+", v) else v for k, v in given.items()})
    return found


UNIT = {"x_range": (0.0, 10.0), "y_range": (0.0, 10.0)}
"""An axis of 39.2 pixels a unit, and one of 19.2."""


def test_lines_have_their_points_colour_width_and_gaps(empty):
    chart = empty(**UNIT)
    chart.line([0.0, 1.0, NAN, 5.0], [0.0, 10.0, 1.0, 2.5], "#123456", name="a", dash="5 3")
    chart.line([2.0, 3.0], [NAN, 4.0], "#123456", run="r", width=2.4, hover=False)
    chart.line([2.0], [1e9], "#654321", run="r", name="b")

    first, second, third = plain(chart).paths
    assert first.get("d") == "M0.0,192.00 39.2,0.00M196.0,144.00"
    assert (first.get("stroke"), first.get("stroke-width")) == ("#123456", "1.6")
    assert first.get("stroke-dasharray") == "5 3"
    assert (first.get("data-part"), first.get("data-name"), first.get("data-run")) == (
        "a",
        "a",
        None,
    )
    assert second.get("d") == "M117.6,115.20"
    assert (second.get("stroke-width"), second.get("stroke-dasharray")) == ("2.4", None)
    assert (second.get("data-run"), second.get("data-name")) == ("r", None)
    # what is far outside is drawn ten times as far as the axis is long
    assert third.get("d") == f"M78.4,{-10 * 192.0:.2f}"
    assert third.get("data-name") == "r"
    assert chart.legend == [("a", "#123456", "5 3"), ("b", "#654321", "")]
    far = empty(**UNIT)
    far.line([-1e9, 1e9], [0.0, 0.0], "#123456")
    assert plain(far).paths[0].get("d") == "M-3920.0,192.00 4312.0,192.00"


def test_bands_and_areas_are_closed_and_have_gaps(empty):
    chart = empty(**UNIT)
    chart.band([0, 1, 2, 3, 4], [1, 1, NAN, 2, 2], [5, 6, 6, NAN, 4], "#123456", run="r", name="c")
    chart.area([0, 10, 10], [0, 0, 10], "#123456", name="d")

    band, area = plain(chart).paths
    assert (
        band.get("d") == "M0.0,172.80 39.2,172.80 39.2,76.80 0.0,96.00ZM156.8,153.60 156.8,115.20Z"
    )
    assert (band.get("fill-opacity"), band.get("class")) == ("0.16", "band")
    assert "fill:#123456" in band.get("style")
    assert (band.get("data-run"), band.get("data-part")) == ("r", "c")
    assert area.get("d") == "M0.0,192.00 392.0,192.00 392.0,0.00Z"
    assert (area.get("fill-opacity"), area.get("stroke-width")) == ("0.3", "0.6")
    assert area.get("data-part") == "d"
    assert [entry[2] for entry in chart.legend] == ["band", "band"]


def test_levels_spans_and_bars_cross_or_fill_the_plot(empty):
    chart = empty(**UNIT)
    chart.level(2.5, run="r", name="a limit")
    chart.level(NAN)
    chart.upright(2.5)
    chart.upright(NAN)
    chart.spans([(1.0, 2.0), (NAN, 3.0), (4.0, 5.0)], 0.25, "#123456", run="r")
    chart.spans([], 0.25, "#123456")

    level, upright, spans = plain(chart).paths
    assert level.get("d") == "M0,144.0H392.0"
    assert level.get("stroke-dasharray") == "9 4"
    assert (level.get("stroke-width"), level.get("data-run")) == ("1.2", "r")
    assert upright.get("d") == "M98.0,0V192.0"
    assert (upright.get("stroke-width"), upright.get("stroke-dasharray")) == ("1.2", None)
    assert spans.get("d") == "M39.2,144.0H78.4M156.8,144.0H196.0"
    assert (spans.get("stroke-width"), spans.get("data-run")) == ("4", "r")
    assert chart.legend == [("a limit", chart.legend[0][1], "9 4")]

    bars = empty(x_range=(-1.0, 3.0), y_range=(-4.0, 4.0))
    bars.bars([0.0, 0.0, NAN], [2.0, -3.0, 1.0], ["#123456", "#654321", "#000000"])
    bars.bars([1.0], [2.0], ["#ABCDEF"], x=[2.5])
    assert places(bars, "rect") == [
        pytest.approx({"x": 66.6, "y": 48.0, "width": 62.7, "height": 48.0, "fill": "#123456"}),
        pytest.approx({"x": 164.6, "y": 96.0, "width": 62.7, "height": 72.0, "fill": "#654321"}),
        pytest.approx({"x": 311.6, "y": 48.0, "width": 62.7, "height": 24.0, "fill": "#ABCDEF"}),
    ]
    by_itself = empty()
    by_itself.bars([0.0, 0.0], [2.0, 4.0], ["#123456"] * 2)
    assert by_itself.x_ends() == (-0.5, 1.5)


def test_points_have_their_shape_size_and_tips(empty):
    chart = empty(**UNIT)
    dots = {"filled": [True, False, True], "tips": ["a < b", "", "c"], "opacity": 0.6}
    chart.points([1.0, 2.0, NAN], [5.0, 5.0, 5.0], "#123456", name="n", run="r", **dots)
    chart.points(5.0, 2.5, "#123456", shape="cross", size=5.0, tips=["x"])
    chart.points(5.0, 2.5, "#123456", shape="plus", size=6.0)

    group, cross, plus = plain(chart).dots
    assert [one.get("cx") for one in group] == ["39.2", "78.4"]
    assert [one.get("cy") for one in group] == ["96.0", "96.0"]
    assert [one.get("r") for one in group] == ["3.5", "3.5"]
    assert [one.get("fill") for one in group] == [None, "var(--paper)"]
    assert [one.findtext("title") for one in group] == ["a < b", ""]
    assert (group.get("fill"), group.get("opacity")) == ("#123456", "0.6")
    assert (group.get("data-run"), group.get("data-part"), group.get("stroke-width")) == (
        "r", "n", "1.6",
    )  # fmt: skip
    assert cross[0].get("d") == "M191.0,139.0l10,10M191.0,149.0l10,-10"
    assert (cross[0].findtext("title"), cross.get("opacity")) == ("x", "1.0")
    assert plus[0].get("d") == "M190.0,144.0h12M196.0,138.0v12"
    assert chart.legend == [("n", "#123456", "dot")]


def test_texts_stand_at_their_points_and_rows_at_the_left_edge(empty):
    chart = empty(**UNIT)
    chart.text(5.0, 2.5, "K_P of chi", anchor="end", shift=(-8.0, 14.0))
    chart.text(NAN, 2.5, "nowhere")
    chart.name_row(7.5, "a row")

    assert places(chart) == [
        {"x": 188.0, "y": 158.0, "text-anchor": "end", "data-at": "196.0,144.0"},
        {"x": 2.0, "y": 48.0, "text-anchor": "start", "data-at": "left,48.0"},
    ]
    assert "K<tspan" in chart.svg()
    assert ">P</tspan>" in chart.svg()


# Where names stand beside a point of names of two letters: to the right, to the left, above and
# below; then further off, with a line to the nearer end of the name. Pixels from the point.
WIDE = 6.7 * 2
AROUND = [(9.0, 4.0), (-9.0 - WIDE, 4.0), (-WIDE / 2.0, -12.0), (-WIDE / 2.0, 19.0)]
AROUND += [(9.0, -14.0), (-9.0 - WIDE, -14.0), (9.0, 22.0), (-9.0 - WIDE, 22.0)]
AROUND += [(9.0, -30.0), (-9.0 - WIDE, -30.0), (9.0, 38.0), (-9.0 - WIDE, 38.0)]


def test_names_stand_around_their_points_where_there_is_room(empty):
    chart = empty(**UNIT)
    chart.label_points([(5.0, 5.0, f"{i:02d}") for i in range(12)] + [(NAN, 1.0, "not")])

    assert [(one["x"], one["y"]) for one in places(chart)] == [
        pytest.approx((196.0 + x, 96.0 + y), abs=0.06) for x, y in AROUND
    ]
    leaders = [one["d"] for one in places(chart, "path") if one["d"].startswith("M196.0,96.0L")]
    ends = [tuple(map(float, d.split("L")[1].split(","))) for d in leaders]
    assert ends == [
        pytest.approx((196.0 + (x if x > 0.0 else x + WIDE), 96.0 + y - 4.0), abs=0.06)
        for x, y in AROUND[4:]
    ]


@pytest.mark.parametrize(
    ("at", "place"),
    [((0.0, 5.0), 0), ((10.0, 5.0), 1), ((9.5, 5.0), 1), ((0.1, 0.0), 4), ((10.0, 10.0), 7)],
)
def test_a_name_at_an_edge_stays_in_the_plot(empty, at, place):
    chart = empty(**UNIT)
    chart.label_points([(*at, "ab")])

    (name,) = places(chart)
    x, y = 39.2 * at[0], 192.0 - 19.2 * at[1]
    assert (name["x"] - x, name["y"] - y) == pytest.approx(AROUND[place], abs=0.06)


def test_a_name_without_room_is_left_out_and_covers_no_other_point(empty):
    crowded = empty(**UNIT)
    crowded.label_points([(5.0, 5.0, "ab")] * 20)
    assert len(places(crowded)) < 20
    beside = empty(**UNIT)  # a point stands where the name would, 12 pixels to the right
    beside.label_points([(5.0, 5.0, "ab"), (5.0 + 15.0 / 39.2, 5.0, "")])
    first, *_ = places(beside)
    assert first["x"] == pytest.approx(196.0 - 9.0 - WIDE, abs=0.06)
    near = empty(**UNIT)  # its square of 12 pixels ends just before the name
    near.label_points([(5.0, 5.0, "ab"), (5.0 + (9.0 + WIDE + 6.1) / 39.2, 5.0, "")])
    assert places(near)[0]["x"] == pytest.approx(205.0, abs=0.06)


ENDS = [
    # values, room, logarithmic, and the ends of the axis
    ([0.0, 10.0], "", (-0.5, 10.5)),
    ([NAN, 4.0, -6.0], "", (-6.5, 4.5)),
    ([NAN, NAN], "", (0.0, 1.0)),
    ([NAN, -1.0], "y", (0.1, 1.0)),
    ([1.0, 1e4, -7.0], "y", (10.0**-0.2, 10.0**4.2)),
    ([1.0, 1.5], "y", (1.0 / 1.05, 1.5 * 1.05)),
    ([3.0, 3.0], "", (1.5, 4.5)),
    ([-0.2, -0.2], "", (-0.7, 0.3)),
    ([1.0, 1.0 + 1e-10], "", (0.5, 1.5)),
    ([1.0, 1.0 + 1e-8], "", (1.0 - 5e-10, 1.0 + 1.05e-8)),
    ([0.0, 5e-13], "", (-0.5, 0.5)),
    ([1e130, -1e130], "", (-1.0e120, 1.0e120)),
    ([1e-130, 1e130], "y", (1e-120, 1e120)),
    ([1e-200, 1e-190], "y", (1e-120 / 1.05, 1e-120 * 1.05)),
]


@pytest.mark.parametrize(("values", "log", "ends"), ENDS)
def test_an_axis_has_a_twentieth_of_room_around_all_finite_values(empty, values, log, ends):
    chart = empty(log=log)
    chart.line(range(len(values)), values, "#000000")

    assert chart.y_ends() == pytest.approx(ends, rel=1e-10)
    assert chart.x_ends() == (0.0, len(values) - 1.0)
    read = plain(chart)
    assert read.log == log
    assert read.y_ends == pytest.approx(ends, rel=1e-5, abs=1e-5)


def test_axes_that_are_given_stay_or_are_made_to_hold(empty):
    assert empty(x_range=(2.0, 2.0), log="x").x_ends() == pytest.approx((2.0 / 1.05, 2.1))
    assert empty(x_range=(0.0, 2.0), log="xy", y_range=(1.0, 2.0)).x_ends() == (0.0, 2.0)
    assert plain(empty(x_range=(0.0, 2.0), log="xy", y_range=(1.0, 2.0))).log == "y"
    assert plain(empty(x_range=(1.0, 2.0), log="xy", y_range=(0.0, 2.0))).log == "x"
    assert empty(y_range=(0.0, 8.0), downwards=True).y_ends() == (8.0, 0.0)
    roomy = empty(x_room=0.03)
    roomy.line([0.0, 100.0], [0.0, 0.0], "#000000")
    assert roomy.x_ends() == pytest.approx((-3.0, 103.0))
    for x, y in (((0.0, 10.0), (2.0, 3.0)), ((2.0, 3.0), (0.0, 10.0))):
        equal = empty(equal=True, x_range=x, y_range=y)
        scale = 1.04 * max((x[1] - x[0]) / PLOT[0], (y[1] - y[0]) / PLOT[1])
        for ends, size, given in ((equal.x_ends(), 392.0, x), (equal.y_ends(), 192.0, y)):
            half, middle = scale * size / 2.0, sum(given) / 2.0
            assert ends == pytest.approx((middle - half, middle + half))


def wanted_step(low, high, pixels, gap):
    """The step of 1, 2 or 5 whose labels are nearest to a distance, in ratio; two at least."""
    steps = sorted(m * 10.0**e for m in (1.0, 2.0, 5.0) for e in range(-6, 7))
    raw = (high - low) / max(2.0, pixels / gap)
    nearest = int(np.argmin(np.abs(np.log(np.array(steps) / raw))))
    inside = np.floor(high / steps[nearest]) - np.ceil(low / steps[nearest]) + 1
    return steps[nearest - (inside < 2)]


def test_labels_are_round_even_and_about_64_and_42_pixels_apart(empty):
    rng = np.random.default_rng(5)
    for size in (150.0, 236.0, 510.0):
        for _ in range(40):
            spans, starts = 10.0 ** rng.uniform(-3.0, 4.0, 2), rng.uniform(-2.0, 1.0, 2)
            x, y = ((s * a, s * (a + 1.0)) for s, a in zip(spans, starts, strict=True))
            labels = plain(empty(x_range=x, y_range=y, height=size)).ticks()
            for (low, high), of, pixels, gap in (
                (x, "x", 392.0, 64.0),
                (y, "y", size - 44.0, 42.0),
            ):
                step = wanted_step(low, high, pixels, gap)
                values = [number(label) for label, _ in labels[of]]
                first, last = np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9)
                assert values == pytest.approx(step * np.arange(first, last + 1.0), abs=1e-9)
                decimals = {len(label.partition(".")[2]) for label, _ in labels[of]}
                assert decimals == {max(0, -int(np.floor(np.log10(step) + 1e-9)))}


DECADES = [
    ((1.0, 100.0), "1 2 5 10 20 50 100"),
    ((1.0, 1000.0), "1 2 5 10 20 50 100 200 500 1000"),
    ((1.0, 1e4), "1 10 100 1000 10⁴"),
    ((1e-3, 0.05), "10⁻³ 2·10⁻³ 5·10⁻³ 0.01 0.02 0.05"),
    ((1e4, 1e5), "10⁴ 2·10⁴ 5·10⁴ 10⁵"),
    ((1e-20, 1.0), "10⁻¹⁸ 10⁻¹⁵ 10⁻¹² 10⁻⁹ 10⁻⁶ 10⁻³ 1"),
    ((1e-9, 1.0), "10⁻⁹ 10⁻⁸ 10⁻⁷ 10⁻⁶ 10⁻⁵ 10⁻⁴ 10⁻³ 0.01 0.1 1"),
    ((2.5, 4.0), "2.6 2.8 3.0 3.2 3.4 3.6 3.8 4.0"),
    ((3.0, 19.0), "5 10"),
]


@pytest.mark.parametrize(("ends", "labels"), DECADES)
def test_a_logarithmic_axis_is_labelled_by_its_decades(empty, ends, labels):
    found = plain(empty(log="x", x_range=ends)).ticks()["x"]

    assert [label for label, _ in found] == labels.split()
    assert [value for _, value in found] == pytest.approx(
        [number(label) for label in labels.split()], rel=0.003
    )


def test_a_chart_states_its_axes_and_names(empty):
    ticks = [(1.0, "one\nrow"), (2.0, "two")]
    chart = empty("a & b", x="V_a [m/s]", y="y & z", height=336.0, linked=True, **UNIT)
    read = plain(chart)
    assert read.tree.get("viewBox") == "0 0 460 336"
    assert (read.title, read.x, read.y, read.fixed) == ("a & b", "V_a [m/s]", "y & z", "")
    assert (read.width, read.height) == (392.0, 292.0)
    assert [float(read.plot.get(key)) for key in ("x", "y", "width", "height")] == [
        *EDGE, 392.0, 292.0,
    ]  # fmt: skip
    assert (read.tree.get("data-linked"), read.tree.get("data-equal")) == ("", None)
    assert read.plot.find("path[@class='axis']").get("d") == "M0,0V292H392"
    up, across = [one for one in read.tree.findall("text") if one.get("class") is None]
    assert up.get("transform") == "translate(12 154.0) rotate(-90)"
    assert [across.get(key) for key in ("x", "y", "text-anchor")] == ["254.0", "332.0", "middle"]
    assert plain(empty(equal=True, **UNIT)).tree.get("data-equal") == ""
    assert plain(empty(equal=True, **UNIT)).tree.get("data-linked") is None

    fixed = plain(empty(x_ticks=ticks, y_ticks=(), **UNIT))
    assert fixed.fixed == "xy"
    assert fixed.plot.find("path[@class='axis']").get("d") == "M0,192H392"
    labels = [one for one in fixed.tree.findall("text") if one.get("class") == "tick"]
    assert [(one.text, one.get("x"), one.get("y")) for one in labels] == [
        ("one", "97.2", "215.0"), ("row", "97.2", "227.0"), ("two", "136.4", "215.0"),
    ]  # fmt: skip
    assert fixed.plot.find("path[@class='grid']").get("d") == "M39.2,0V192.0M78.4,0V192.0"
    ups = [
        one for one in read.tree.findall("text[@class='tick']") if one.get("text-anchor") == "end"
    ]
    assert {one.get("x") for one in ups} == {"52.0"}


def test_of_a_long_line_the_extremes_of_each_stretch_and_one_sample_of_a_gap_are_drawn(empty):
    n, most = 1000, 10
    y = np.random.default_rng(2).normal(size=n)
    y[430:470], y[700] = NAN, NAN
    chart = empty(x_range=(0.0, 999.0))
    chart.line(np.arange(n), y, "#000000", most=most)
    exact = empty(x_range=(0.0, 999.0))
    exact.line(np.arange(most), np.arange(most), "#000000", most=most)

    drawn_at = {0, n - 1}
    for k in range(most // 2):
        of = slice(200 * k, 200 * (k + 1))
        drawn_at |= {200 * k + int(np.nanargmin(y[of])), 200 * k + int(np.nanargmax(y[of]))}
    ((x, found),) = plain(chart).lines()
    there = np.isfinite(x)
    assert [*np.rint(x[there]).astype(int)] == sorted(drawn_at)
    assert found[there] == pytest.approx(y[sorted(drawn_at)], abs=0.05)
    assert np.flatnonzero(~there).tolist() == [
        sum(at < gap for at in drawn_at) + i for i, gap in enumerate((430, 700))
    ]
    assert len(plain(exact).lines()[0][0]) == most


def test_a_sheet_has_its_charts_row_by_row_below_their_titles_and_legends(empty, run):
    charts = [empty(title) for title in ("one", "two", "three")]
    charts[1].line([0, 1], [0, 1], "#123456", name="a" * 30, dash="5 3")
    charts[1].points([0], [1], "#123456", name="b" * 30)
    charts[1].points([0], [1], "#123456", shape="cross", name="c")
    charts[1].points([0], [1], "#123456", shape="plus", name="d")
    charts[1].band([0, 1], [0, 0], [1, 1], "#123456", name="e" * 40)
    sheet = replace(ft.plot(run), charts=charts, title="whole", legend=[("all", "#123456", "")])
    text = sheet.svg()
    root = ElementTree.fromstring(re.sub(r' xmlns="[^"]*"', "", text))

    inner = root.findall("svg")
    # 26 for the title, 15 and 10 for its legend; 18 and the legend of a row above its charts
    tops = 26.0 + 15.0 + 10.0 + 18.0 + 45.0, 26.0 + 25.0 + 18.0 + 45.0 + 236.0 + 8.0 + 18.0
    assert [(float(x.get("x")), float(x.get("y"))) for x in inner] == [
        (0.0, tops[0]), (460.0, tops[0]), (0.0, tops[1]),
    ]  # fmt: skip
    assert {(x.get("width"), x.get("height")) for x in inner} == {("460", "236")}
    whole = tops[1] + 236.0 + 8.0
    assert root.get("viewBox") == f"0 0 920 {whole:.0f}"
    assert [root.get("width"), root.get("height")] == ["920", f"{whole:.0f}"]
    heads = [one.get("transform") for one in root.findall("g") if one.find("text") is not None]
    assert heads == [
        "translate(0 51.0)",
        "translate(460 51.0)",
        f"translate(0 {tops[1] - 18.0:.1f})",
    ]
    titles = [one for one in root.iter("text") if one.get("class") == "title"]
    assert {(x.text, x.get("x"), x.get("y")) for x in titles} == {
        ("whole", "8.0", "17.0"), *((x, "8.0", "13.0") for x in ("one", "two", "three")),
    }  # fmt: skip
    head = root.findall("g")[2]
    names = [(float(x.get("x")), float(x.get("y")), x.text[0]) for x in head.findall("text")[1:]]
    second = 8.0 + 42.0 + 6.7 * 30
    # two names of 30 letters do not fit beside each other
    assert names == [
        (36.0, 28.0, "a"), (36.0, 43.0, "b"), (second + 28.0, 43.0, "c"),
        (pytest.approx(second + 42.0 + 6.7 + 28.0), 43.0, "d"), (36.0, 58.0, "e"),
    ]  # fmt: skip
    signs = [one[0] for one in head.findall("g")]
    assert [one.tag for one in signs] == ["path", "circle", "path", "path", "rect"]
    assert signs[0].get("d") == "M0,0H24"
    assert (signs[0].get("stroke-width"), signs[0].get("stroke-dasharray")) == ("2", "5 3")
    assert [signs[1].get(key) for key in ("cx", "cy", "r")] == ["12", "0", "4"]
    assert signs[2].get("d") == "M8.0,-4.0l8,8M8.0,4.0l8,-8"
    assert signs[3].get("d") == "M8.0,0.0h8M12.0,-4.0v8"
    assert signs[4].get("fill-opacity") == "0.3"
    assert [one.get("transform") for one in head.findall("g")][:2] == [
        "translate(8.0 24.0)", "translate(8.0 39.0)",
    ]  # fmt: skip
    assert "svg.sheet {" in text
    assert len(drawn(text)) == 3
    single = replace(sheet, columns=1, title="", legend=())
    read = ElementTree.fromstring(re.sub(r' xmlns="[^"]*"', "", single.svg()))
    assert [float(one.get("y")) for one in read.findall("svg")] == [
        18.0, 18.0 + 244.0 + 63.0, 18.0 + 244.0 + 63.0 + 244.0 + 18.0,
    ]  # fmt: skip
    assert read.get("width") == "460"
