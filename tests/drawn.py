"""Charts read back from a page or an SVG file: their marks in the units of their axes."""

import re
from itertools import combinations
from xml.etree import ElementTree

import numpy as np

CHART = re.compile(r'<svg [^>]*?class="chart" .*?</svg></svg>', re.DOTALL)
PIXEL = 0.051, 0.0051
"""Half of the last digit of a place, to the right and down, pixels."""
LETTER, LINE = 5.5, 10.0
"""Width of a letter and height of a line of text, pixels, or a little less."""
SUPERSCRIPT = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


class Drawn:
    """A chart: its titles, axes, and marks in the order of drawing."""

    def __init__(self, text):
        self.tree = ElementTree.fromstring(text.replace("&nbsp;", "\u00a0"))
        self.title = self.tree.get("aria-label")
        self.x, self.y = self.tree.get("data-x"), self.tree.get("data-y")
        *ends, self.width, self.height = map(float, self.tree.get("data-axes").split())
        self.x_ends, self.y_ends = ends[:2], ends[2:]
        self.log, self.fixed = self.tree.get("data-log"), self.tree.get("data-fixed")
        self.equal = self.tree.get("data-equal") is not None
        self.plot = self.tree.find("svg")
        marks = [one for one in self.plot.iter() if one.get("class") not in ("grid", "axis")]
        self.paths = [one for one in marks if one.tag == "path" and one.get("d")]
        self.dots = [one for one in marks if one.tag == "g" and one.get("opacity")]

    def back(self, x, y):
        """Values at places in pixels of the plot."""
        found = []
        for place, size, ends, name in (
            (np.asarray(x, float), self.width, self.x_ends, "x"),
            (self.height - np.asarray(y, float), self.height, self.y_ends, "y"),
        ):
            low, high = np.log(ends) if name in self.log else ends
            value = low + place / size * (high - low)
            found.append(np.exp(value) if name in self.log else value)
        return found

    def off(self, values, axis):
        """How far values may be off by the digits of their places."""
        ends, size = (self.x_ends, self.width) if axis == "x" else (self.y_ends, self.height)
        span = 1e-5 * np.abs(ends).max() + PIXEL[axis == "y"] / size * abs(ends[1] - ends[0])
        return span if axis not in self.log else np.abs(values) * np.log(ends[1] / ends[0]) / 500.0

    def curve(self, path):
        """Values of a path; pieces are joined by NaN."""
        pieces = []
        for piece in re.findall(r"M([^MZ]*)", path.get("d")):
            if "H" in piece:
                (x, y), end = piece.split("H")[0].split(","), piece.split("H")[1]
                pieces.append([[float(x), float(y)], [float(end), float(y)]])
            elif "V" in piece:
                (x, y), end = piece.split("V")[0].split(","), piece.split("V")[1]
                pieces.append([[float(x), float(y)], [float(x), float(end)]])
            else:
                pieces.append([[float(v) for v in p.split(",")] for p in re.split("[ L]", piece)])
        return self.back(*np.vstack([row for p in pieces for row in (p, [[np.nan] * 2])][:-1]).T)

    def lines(self, run=None, part=None):
        """Lines that are no bands, of a run or a part of the legend: x and y of each."""
        return [
            self.curve(one)
            for one in self.paths
            if one.get("class") != "band" and not re.search("[lh]", one.get("d"))
            if (run is None or one.get("data-run") == run)
            and (part is None or one.get("data-part") == part)
        ]

    def bands(self):
        """Filled bands: x, the lower and the upper edge."""
        found = []
        for one in self.paths:
            if one.get("class") == "band":
                x, y = self.curve(one)
                whole = np.split(np.arange(len(x)), np.flatnonzero(np.isnan(x)))
                pieces = [part[~np.isnan(x[part])] for part in whole]
                low = np.concatenate([part[: len(part) // 2] for part in pieces])
                high = np.concatenate([part[len(part) // 2 :][::-1] for part in pieces])
                found.append((x[low], y[low], y[high]))
        return found

    def points(self):
        """Points of each group: x, y and their tips."""
        found = []
        for group in self.dots:
            places, tips = [], []
            for one in group:
                if one.tag == "circle":
                    places.append([float(one.get("cx")), float(one.get("cy"))])
                elif m := re.match(r"M([-\d.]+),([-\d.]+)([lh])([\d.]+)", one.get("d", "")):
                    half = float(m[4]) / 2.0
                    down = half if m[3] == "l" else 0.0
                    places.append([float(m[1]) + half, float(m[2]) + down])
                tips.append(one.findtext("title") or "")
            x, y = self.back(*np.array(places).reshape(-1, 2).T)
            found.append((x, y, tips))
        return found

    def bars(self):
        """Bars: their middle, lower and upper end."""
        keys = ("x", "y", "width", "height")
        rows = [[float(one.get(key)) for key in keys] for one in self.plot.iter("rect")]
        x, top, wide, tall = np.array(rows).reshape(-1, 4).T
        middle, high = self.back(x + wide / 2.0, top)
        return middle, self.back(x, top + tall)[1], high

    def texts(self):
        """Texts in the plot."""
        return ["".join(one.itertext()) for one in self.plot.iter("text")]

    def ticks(self):
        """Labels and the values at their places, of the x and the y axis."""
        found = {"x": [], "y": []}
        for one in self.tree.findall("text[@class='tick']"):
            across, down = (float(one.get(key)) for key in ("x", "y"))
            axis = "y" if one.get("text-anchor") == "end" else "x"
            left, top = (float(self.plot.get(key)) for key in ("x", "y"))
            x, y = self.back(across - left, down - 4.0 - top)
            found[axis].append((one.text, float(x if axis == "x" else y)))
        return found


def drawn(text):
    """Charts of a page or an SVG file, in their order."""
    text = text.replace(' xmlns="http://www.w3.org/2000/svg"', "")
    return [Drawn(found) for found in CHART.findall(text)]


def number(label):
    """The number of a label of an axis."""
    label = label.replace("−", "-")
    if found := re.fullmatch(r"(?:(\d)·)?10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", label):
        return float(found[1] or 1) * 10.0 ** int(found[2].translate(SUPERSCRIPT))
    return float(label)


def box_of(text):
    x, y = float(text.get("x")), float(text.get("y"))
    return x, y - LINE, x + LETTER * len("".join(text.itertext())), y


def apart(boxes):
    """Whether no two boxes share a place."""
    return all(
        a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
        for a, b in combinations(boxes, 2)
    )


def faults(chart):  # noqa: C901
    """What is wrong with a chart by itself: labels, grid, places and room."""
    found = []
    grid = chart.plot.find("path[@class='grid']").get("d")
    lines = {
        "x": [float(x) for x in re.findall(r"M([-\d.]+),0V", grid)],
        "y": [float(y) for y in re.findall(r"M0,([-\d.]+)H", grid)],
    }
    for axis, labels in chart.ticks().items():
        if axis in chart.fixed:
            continue
        ends = sorted(chart.x_ends if axis == "x" else chart.y_ends)
        if not 2 <= len(labels) <= 20:
            found.append(f"{axis}: {len(labels)} labels")
        if len(lines[axis]) != len(labels):
            found.append(f"{axis}: {len(lines[axis])} lines of the grid")
        for (label, value), line in zip(labels, lines[axis], strict=False):
            near = chart.off(abs(value), axis) * 12.0
            if abs(number(label) - value) > near:
                found.append(f"{axis}: {label} stands at {value:g}")
            at = float(chart.back(line, 0.0)[0] if axis == "x" else chart.back(0.0, line)[1])
            if abs(number(label) - at) > near:
                found.append(f"{axis}: the line of {label} is at {at:g}")
            if not ends[0] - near <= number(label) <= ends[1] + near:
                found.append(f"{axis}: {label} is outside")
        steps = np.diff([number(label) for label, _ in labels])
        if axis not in chart.log and np.ptp(np.abs(steps)) > 1e-6 * np.abs(steps).max():
            found.append(f"{axis}: uneven steps")
    places = " ".join(
        x for one in chart.tree.iter() for x in (one.get("d"), one.get("points")) if x
    )
    if re.search("nan|inf", places):
        found.append("no numbers")
    if chart.equal:
        scales = [
            abs(b - a) / n
            for (a, b), n in ((chart.x_ends, chart.width), (chart.y_ends, chart.height))
        ]
        if abs(scales[0] / scales[1] - 1.0) > 1e-3:
            found.append("its scales differ")
    return found
