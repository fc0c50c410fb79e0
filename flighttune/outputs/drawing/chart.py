"""Charts as SVG text: lines, bands, points and bars on linear or logarithmic axes.

Colours are CSS variables of `style`, so that one chart serves a light, a dark and a printed page.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray, true_spans
from flighttune.base.errors import printable
from flighttune.base.files.whole import write_text
from flighttune.outputs.drawing.palette import LIMIT, NEUTRAL, LineStyle, css_colour, css_variables

Range: TypeAlias = tuple[float, float]
Ticks: TypeAlias = Sequence[tuple[float, str]]

# Size of a chart in pixels; a page scales it to its column.
WIDTH, HEIGHT = 460.0, 236.0

LEFT, RIGHT, TOP, BOTTOM = 58.0, 10.0, 8.0, 36.0
HEAD_AND_FOOT = TOP + BOTTOM

# Share of an axis that stays free above and below the data.
ROOM = 0.05

# Largest value of an axis, and the inverse of the smallest of a logarithmic one. A value beyond is
# drawn at the end: a bound that falls for an hour is zero, and one that grows is infinite.
LARGEST = 1e120

# Approximate distance of labels on the x and the y axis, pixels.
GAPS = 64.0, 42.0

# A line with at most this number of samples is not thinned: four minutes at 50 Hz.
MOST = 12_000

# Points of a line in a chart.
MAX_DRAWN = 600

DASHED, DOTTED, LONG = "5 3", "1.5 2.5", "9 4"


Shape: TypeAlias = Literal["dot", "cross", "plus"]

# Name, colour, and dashes of a line, or `band` or a `Shape`.
LegendEntry: TypeAlias = tuple[str, str, str]

# A letter with a letter or digit as its index, such as `n_z` but not `tuned_identified`.
SYMBOL = re.compile(r"\b([^\W\d_])_(cmd|\w,cmd|\w)\b")

# In SVG, text after a subscript stays lowered unless an empty span raises it.
SVG_INDEX = '<tspan dy="3" font-size=".8em">{}</tspan><tspan dy="-3">\u200b</tspan>'


# Attribute of a text that names its neighbour.
NAMED = ' class="named"'

# Attribute of a label on an axis, which a page writes anew when it zooms in.
TICK = ' class="tick"'


@cache
def style() -> str:
    """CSS of charts, with the colours of the light and the dark theme."""
    rules = Path(__file__).with_name("chart.css").read_text(encoding="utf-8")
    return f"{css_variables()}\n{rules}"


@dataclass(slots=True, kw_only=True)
class Chart:
    """One panel, filled by its methods in drawing order."""

    title: str
    x: str = "t [s]"  # label of the axis, with unit
    y: str = ""
    height: float = HEIGHT  # size of the whole chart, pixels
    log: str = ""  # logarithmic axes: x, y or both
    x_range: Range | None = None  # ends of the axis; by default around all data
    y_range: Range | None = None
    x_ticks: Ticks | None = None  # labels of the axis and their positions
    y_ticks: Ticks | None = None
    x_room: float = 0.0  # share of the width left free at both ends
    linked: bool = False  # its cursor follows the x of other linked charts on a page
    equal: bool = False  # equal scales on both axes
    downwards: bool = False  # y grows downwards
    # Legend entries of this chart alone.
    legend: list[LegendEntry] = field(default_factory=list)
    _marks: list["_Mark"] = field(default_factory=list)
    _seen: list[tuple[FloatArray, FloatArray]] = field(default_factory=list)

    def _add(
        self, mark: "_Mark", *seen: tuple[FloatArray, FloatArray], entry: LegendEntry = ("", "", "")
    ) -> None:
        """Add a mark, its extent for the axes, and an entry in the legend."""
        self._marks.append(mark)
        self._seen += seen
        if entry[0]:
            self.legend.append(entry)

    def line(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        colour: str,
        *,
        run: str = "",
        name: str = "",
        dash: str = "",
        width: float = 1.6,
        most: int = MAX_DRAWN,
        hover: bool = True,
    ) -> None:
        """Draw a line through points, broken at NaN, of at most `most` points with every peak."""
        xs, ys = thinned(np.asarray(x, dtype=float), np.asarray(y, dtype=float), most)
        look = _stroke(colour, width, dash) + _owner(run, name, (run or name) if hover else "")
        self._add(_outline(xs, ys, look), (xs, ys), entry=(name, colour, dash))

    def run_line(
        self, x: npt.ArrayLike, y: npt.ArrayLike, style: LineStyle, run: str, **more: Any
    ) -> None:
        """Draw a line of a run in its style; `more` options of `line` override it."""
        look = {"dash": dashes(style), "width": 0.85 * style.width, **more}
        self.line(x, y, style.colour, run=run, **look)

    def band(
        self,
        x: npt.ArrayLike,
        low: npt.ArrayLike,
        high: npt.ArrayLike,
        colour: str,
        *,
        run: str = "",
        name: str = "",
    ) -> None:
        """Fill between two lines, with gaps at NaN."""
        xs, ends = np.asarray(x, dtype=float), np.column_stack([low, high]).astype(float)
        ends[np.isnan(ends).any(axis=1)] = np.nan
        samples = peaks(ends, most=MAX_DRAWN)
        xs, (lows, highs) = xs[samples], ends[samples].T
        look = f' class="band" style="fill:{css_colour(colour)}" fill-opacity="0.16"'
        look += _owner(run, name)

        def drawn(a: "_Axes") -> str:
            outlines = (
                _path(
                    a.sx(np.concatenate([xs[piece], xs[piece][::-1]])),
                    a.sy(np.concatenate([lows[piece], highs[piece][::-1]])),
                )
                + "Z"
                for piece in _pieces(xs, lows)
            )
            return f'<path d="{"".join(outlines)}"{look}/>'

        self._add(drawn, (xs, lows), (xs, highs), entry=(name, colour, "band"))

    def area(self, x: npt.ArrayLike, y: npt.ArrayLike, colour: str, *, name: str = "") -> None:
        """Fill a closed line and draw a thin outline, so that a narrow area is visible."""
        xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
        look = f' style="fill:{css_colour(colour)}" fill-opacity="0.3"{_stroke(colour, 0.6)}'
        look += _owner("", name)
        self._add(_outline(xs, ys, look, "Z"), (xs, ys), entry=(name, colour, "band"))

    def level(
        self, value: float, colour: str = LIMIT, *, dash: str = LONG, run: str = "", name: str = ""
    ) -> None:
        """Draw a horizontal line across the chart, inside the y axis."""
        look = _stroke(colour, 1.2, dash) + _owner(run, name)

        def drawn(a: "_Axes") -> str:
            return (
                "" if math.isnan(value) else f'<path d="M0,{a.sy(value):.1f}H{a.width:.1f}"{look}/>'
            )

        self._add(drawn, (np.array([np.nan]), np.array([value])), entry=(name, colour, dash))

    def upright(self, value: float, colour: str = NEUTRAL, *, dash: str = "") -> None:
        """Draw a vertical line across the chart."""
        look = _stroke(colour, 1.2, dash)
        if not math.isnan(value):
            self._add(lambda a: f'<path d="M{a.sx(value):.1f},0V{a.height:.1f}"{look}/>')

    def points(
        self,
        x: npt.ArrayLike,
        y: npt.ArrayLike,
        colour: str,
        *,
        run: str = "",
        name: str = "",
        shape: Shape = "dot",
        size: float = 3.5,
        filled: bool | Sequence[bool] = True,
        opacity: float = 1.0,
        tips: Sequence[str] = (),
    ) -> None:
        """Draw points; `size` is half the width in pixels, and `tips` appear under the pointer."""
        xs, ys = (np.atleast_1d(np.asarray(values, dtype=float)) for values in (x, y))
        full = [filled] * len(xs) if isinstance(filled, bool) else filled
        look = f' fill="{css_colour(colour)}" opacity="{opacity}"'
        look += _stroke(colour, 1.6) + _owner(run, name)

        def drawn(a: "_Axes") -> str:
            marks = []
            for i, (px, py) in enumerate(zip(a.sx(xs).tolist(), a.sy(ys).tolist(), strict=True)):
                if not math.isfinite(px + py):
                    continue
                tip = f"<title>{escape(tips[i])}</title>" if tips else ""
                if shape == "dot":
                    fill = "" if full[i] else ' fill="var(--paper)"'
                    head, tag = f'<circle cx="{px:.1f}" cy="{py:.1f}" r="{size}"{fill}', "circle"
                else:
                    head, tag = f'<path d="{_cross(px, py, size, shape)}"', "path"
                marks.append(f"{head}>{tip}</{tag}>" if tip else f"{head}/>")
            return f"<g{look}>{''.join(marks)}</g>"

        self._add(drawn, (xs, ys), entry=(name, colour, shape))

    def bars(
        self,
        low: npt.ArrayLike,
        high: npt.ArrayLike,
        colours: Sequence[str],
        *,
        x: npt.ArrayLike | None = None,
    ) -> None:
        """Draw upright bars at 0, 1, 2, ... or `x`, from `low` to `high`, each in its colour."""
        lows, highs = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
        places = np.asarray(np.arange(len(lows)) if x is None else x, dtype=float)

        def drawn(a: "_Axes") -> str:
            sides = a.sx(np.array([places - 0.32, places + 0.32])).T.tolist()
            ends = a.sy(np.sort([lows, highs], axis=0)[::-1]).T.tolist()
            return "".join(
                f'<rect x="{x0:.1f}" y="{y0:.1f}" width="{x1 - x0:.1f}" height="{y1 - y0:.1f}" '
                f'fill="{css_colour(colour)}"/>'
                for (x0, x1), (y0, y1), colour in zip(sides, ends, colours, strict=True)
                if math.isfinite(x0 + y0 + y1)
            )

        self._add(drawn, (places - 0.5, lows), (places + 0.5, highs))

    def spans(self, pairs: Sequence[Range], lane: float, colour: str, *, run: str = "") -> None:
        """Draw a thick line from each start to its end, at the height `lane` (a share)."""
        look = _stroke(colour, 4.0) + _owner(run)

        def drawn(a: "_Axes") -> str:
            up = a.height * (1.0 - lane)
            parts = (
                f"M{a.sx(start):.1f},{up:.1f}H{a.sx(end):.1f}"
                for start, end in pairs
                if math.isfinite(a.sx(start) + a.sx(end))
            )
            return f'<path d="{"".join(parts)}"{look}/>'

        if pairs:
            self._add(drawn)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        *,
        anchor: Literal["start", "middle", "end"] = "start",
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Write text at a point, shifted by `shift` pixels to the right and down."""

        def drawn(a: "_Axes") -> str:
            px, py = float(a.sx(x)), float(a.sy(y))
            if not math.isfinite(px + py):
                return ""
            look = f'{NAMED} data-at="{px:.1f},{py:.1f}"'
            return _label(px + shift[0], py + shift[1], text, look, anchor=anchor)

        self._add(drawn, (np.array([x]), np.array([y])))

    def name_row(self, y: float, name: str) -> None:
        """Write the name of a row at the left edge, at a height of the y axis."""

        def drawn(a: "_Axes") -> str:
            return _label(2.0, py := float(a.sy(y)), name, f'{NAMED} data-at="left,{py:.1f}"')

        self._add(drawn)

    def label_points(self, points: Sequence[tuple[float, float, str]]) -> None:
        """Name points (x, y, name) so that no name covers a point or another name."""

        def drawn(a: "_Axes") -> str:
            dots = [(float(a.sx(x)), float(a.sy(y)), name) for x, y, name in points]
            dots = [dot for dot in dots if math.isfinite(dot[0] + dot[1])]
            occupied = [(x - 6.0, y - 6.0, x + 6.0, y + 6.0) for x, y, _ in dots]
            parts = []
            for x, y, name in dots:
                wide = LETTER * len(name)
                right, left, middle = x + 9.0, x - 9.0 - wide, x - wide / 2.0
                places = [(right, y - 6.0), (left, y - 6.0), (middle, y - 22.0), (middle, y + 9.0)]
                # then at growing distances, with a thin line to the point
                places += [
                    (side, y + up) for up in (-24, 12, -40, 28, -56, 44) for side in (right, left)
                ]
                boxes = [(u, v, u + wide, v + 12.0) for u, v in places]
                box = next((place for place in boxes if _free(place, occupied, a)), None)
                if box is None:  # two names in one place are unreadable
                    continue
                occupied.append(box)
                label = _label(box[0], box[1] + 10.0, name, NAMED)
                if boxes.index(box) > 3:
                    near = box[0] if box[0] > x else box[2]
                    leader = f"M{x:.1f},{y:.1f}L{near:.1f},{box[1] + 6.0:.1f}"
                    label = f'<path class="axis" d="{leader}"/>{label}'
                parts.append(f'<g data-at="{x:.1f},{y:.1f}">{label}</g>')
            return "".join(parts)

        self._add(drawn)

    def y_ends(self) -> Range:
        """Ends of the y axis around the data so far."""
        return self._axes().y

    def x_ends(self) -> Range:
        """Ends of the x axis around the data so far."""
        return self._axes().x

    def svg(self) -> str:
        """The chart as an ``<svg>`` element for a page that has `style`."""
        a = self._axes()
        y_ticks = ticks(a.y, a.height / GAPS[1], a.log_y) if self.y_ticks is None else self.y_ticks
        x_ticks = ticks(a.x, a.width / GAPS[0], a.log_x) if self.x_ticks is None else self.x_ticks
        grid, labels = "", []
        for value, label in y_ticks:
            up = float(a.sy(value))
            grid += f"M0,{up:.1f}H{a.width:.1f}"
            labels.append(_label(LEFT - 6.0, TOP + up + 4.0, label, TICK, anchor="end"))
        for value, label in x_ticks:
            across = float(a.sx(value))
            grid += f"M{across:.1f},0V{a.height:.1f}"
            for row, part in enumerate(label.split("\n")):
                down = TOP + a.height + 15.0 + 12.0 * row
                labels.append(_label(LEFT + across, down, part, TICK, anchor="middle"))
        if self.y:
            turned = f"translate(12 {TOP + a.height / 2.0:.1f}) rotate(-90)"
            text = marked_up(self.y)
            labels.append(f'<text transform="{turned}" text-anchor="middle">{text}</text>')
        labels.append(_label(LEFT + a.width / 2.0, self.height - 4.0, self.x, anchor="middle"))
        ends = " ".join(f"{end:.6g}" for end in (*a.x, *a.y))
        log = "x" * a.log_x + "y" * a.log_y
        data = f'data-axes="{ends} {a.width:g} {a.height:g}" data-log="{log}"'
        link = ' data-linked=""' * self.linked + ' data-equal=""' * self.equal
        # a page that zooms in leaves positions with names of their own as they are
        fixed = "x" * (self.x_ticks is not None) + "y" * (self.y_ticks is not None)
        names = f'data-x="{escape(self.x)}" data-y="{escape(self.y)}"'
        size = f'x="{LEFT:g}" y="{TOP:g}" width="{a.width:g}" height="{a.height:g}"'
        axis = f"M0,0V{a.height:g}H{a.width:g}" if y_ticks else f"M0,{a.height:g}H{a.width:g}"
        return (
            f'<svg class="chart" viewBox="0 0 {WIDTH:g} {self.height:g}" role="img" '
            f'aria-label="{escape(self.title)}" {data}{link} data-fixed="{fixed}" {names}>'
            f"{''.join(labels)}"
            f'<svg class="plot" {size} overflow="hidden"><path class="grid" d="{grid}"/>'
            f'{"".join(mark(a) for mark in self._marks)}<path class="axis" d="{axis}"/></svg></svg>'
        )

    def _axes(self) -> "_Axes":
        width, height = WIDTH - LEFT - RIGHT, self.height - TOP - BOTTOM
        x = self.x_range or _ends([xs for xs, _ in self._seen], self.x_room, "x" in self.log)
        y = self.y_range or _ends([ys for _, ys in self._seen], ROOM, "y" in self.log)
        # an axis that does not begin above zero is linear
        log_x, log_y = "x" in self.log and x[0] > 0.0, "y" in self.log and y[0] > 0.0
        x, y = _apart(x, log_x), _apart(y, log_y)
        if self.equal:
            scale = max((x[1] - x[0]) / width, (y[1] - y[0]) / height)
            x, y = _around(x, 1.04 * scale * width), _around(y, 1.04 * scale * height)
        if self.downwards:
            y = y[1], y[0]
        return _Axes(x=x, y=y, width=width, height=height, log_x=log_x, log_y=log_y)


@dataclass(frozen=True, slots=True, kw_only=True)
class Sheet:
    """Charts side by side as one picture, each under its title and legend."""

    charts: Sequence[Chart]  # row by row
    columns: int = 2
    title: str = ""
    # entries shared by several charts, drawn once at the top
    legend: Sequence[LegendEntry] = ()

    def __repr__(self) -> str:
        return f"Sheet of {len(self.charts)} charts: {', '.join(x.title for x in self.charts)}"

    def save(self, path: str | Path) -> None:
        """Write an SVG file, under a temporary name until it is whole."""
        write_text(Path(path), self.svg())

    def svg(self) -> str:
        """The picture as a self-contained SVG file."""
        width = self.columns * WIDTH
        parts, top = [], 26.0 if self.title else 0.0
        if self.legend:
            names, height = _legend(self.legend, width, top + 12.0)
            parts.append(names)
            top += height + 10.0
        for i in range(0, len(self.charts), self.columns):
            row = self.charts[i : i + self.columns]
            legends = [_legend(chart.legend, WIDTH, 24.0) for chart in row]
            above = 18.0 + max(height for _, height in legends)
            for column, (chart, (names, _)) in enumerate(zip(row, legends, strict=True)):
                left = column * WIDTH
                head = _label(8.0, 13.0, chart.title, ' class="title"') + names
                parts.append(f'<g transform="translate({left:g} {top:.1f})">{head}</g>')
                place = f'x="{left:g}" y="{top + above:.1f}"'
                size = f'width="{WIDTH:g}" height="{chart.height:g}"'
                parts.append(chart.svg().replace("<svg ", f"<svg {place} {size} ", 1))
            top += above + max(chart.height for chart in row) + 8.0
        title = _label(8.0, 17.0, self.title, ' class="title"')
        # with its own colours, because a notebook shows it on a page with others
        rules = style().replace(":root", "svg.sheet")
        return printable(
            f'<svg xmlns="http://www.w3.org/2000/svg" class="chart sheet" '
            f'viewBox="0 0 {width:g} {top:.0f}" width="{width:g}" height="{top:.0f}">'
            f'<style>{rules}</style><rect width="100%" height="100%" fill="var(--paper)"/>'
            f"{title if self.title else ''}{''.join(parts)}</svg>\n"
        )

    def _repr_svg_(self) -> str:
        return self.svg()


def ticks(ends: Range, count: float, log: bool = False) -> list[tuple[float, str]]:
    """Round values along an axis with labels, about `count` and at least two."""
    low, high = sorted(ends)
    if log:
        values = _log_ticks(low, high, count)
        if len(values) > 1:
            return values
    raw = (high - low) / max(2.0, count)
    steps = 10.0 ** math.floor(math.log10(raw)) * np.array([0.5, 1.0, 2.0, 5.0, 10.0])
    nearest = int(np.argmin(np.abs(np.log(steps / raw))))
    step = float(steps[nearest])
    if math.floor(high / step) - math.ceil(low / step) < 1:
        step = float(steps[nearest - 1])
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    return [
        (i * step, f"{i * step + 0.0:.{decimals}f}".replace("-", "−"))
        for i in range(first, last + 1)
    ]


def _log_ticks(low: float, high: float, count: float) -> list[tuple[float, str]]:
    """Decades, with 2 and 5 between them if there are few."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    decades = math.log10(high) - math.log10(low)
    steps = (1, 2, 5) if decades * 3.0 <= 1.5 * count else (1,)
    every = 1 if len(steps) > 1 else max(1, math.ceil(decades / (1.5 * count)))
    values = [m * 10.0**e for e in exponents if e % every == 0 for m in steps]
    return [(value, _power(value)) for value in values if low <= value <= high]


def _power(value: float) -> str:
    if 1e-2 <= value < 1e4:
        return f"{value:g}"
    exponent = math.floor(math.log10(value) + 1e-9)
    superscript = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    digit = round(value / 10.0**exponent)
    return f"10{superscript}" if digit == 1 else f"{digit}·10{superscript}"


class _Axes(NamedTuple):
    """Ends of both axes and the size of the plot, pixels."""

    x: Range
    y: Range
    width: float
    height: float
    log_x: bool = False
    log_y: bool = False

    def sx(self, value: npt.ArrayLike) -> FloatArray:
        """Pixels to the right of the left edge."""
        return _part(value, self.x, self.log_x) * self.width

    def sy(self, value: npt.ArrayLike) -> FloatArray:
        """Pixels down from the upper edge."""
        return (1.0 - _part(value, self.y, self.log_y)) * self.height


_Mark: TypeAlias = Callable[[_Axes], str]


def _part(value: npt.ArrayLike, ends: Range, log: bool) -> FloatArray:
    """Positions of values between the ends, 0 to 1, clipped at ten times the length."""
    values = np.asarray(value, dtype=float)
    low, high = ends
    if log:
        values, low, high = np.log(np.maximum(values, 1e-300)), math.log(low), math.log(high)
    return np.clip((values - low) / (high - low), -10.0, 11.0)


def _ends(values: Sequence[FloatArray], room: float, log: bool) -> Range:
    """Ends of an axis around all values, with some room."""
    flat = np.concatenate([np.ravel(value) for value in values]) if values else np.zeros(0)
    flat = flat[np.isfinite(flat) & ((flat > 0.0) | (not log))]
    if not len(flat):
        return (0.1, 1.0) if log else (0.0, 1.0)
    low, high = _within((float(flat.min()), float(flat.max())), log)
    if log:
        factor = max((high / low) ** room, 1.05)
        return low / factor, high * factor
    return low - room * (high - low), high + room * (high - low)


def _within(ends: Range, log: bool) -> Range:
    """Ends that `LARGEST` allows."""
    least = 1.0 / LARGEST if log else -LARGEST
    low, high = (min(max(least, end), LARGEST) for end in ends)
    return low, high


def _apart(ends: Range, log: bool) -> Range:
    """Ends that an axis can have: finite, in order, and not too near to each other."""
    low, high = _within(ends, log)
    if log:
        return (low, high) if high > low * (1.0 + 1e-9) else (low / 1.05, low * 1.05)
    if high - low <= 1e-9 * max(abs(low), abs(high), 1e-3):
        return low - 0.5 * max(abs(low), 1.0), low + 0.5 * max(abs(low), 1.0)
    return low, high


def _around(ends: Range, size: float) -> Range:
    middle = (ends[0] + ends[1]) / 2.0
    return middle - size / 2.0, middle + size / 2.0


def _outline(x: FloatArray, y: FloatArray, look: str, end: str = "") -> _Mark:
    """A line through points, closed by an `end` of ``Z``."""
    return lambda a: f'<path d="{_path(a.sx(x), a.sy(y))}{end}"{look}/>'


def _pieces(x: FloatArray, y: FloatArray) -> list[slice]:
    """Stretches without NaN."""
    return [slice(*ends) for ends in true_spans(np.isfinite(x) & np.isfinite(y))]


def _path(x: FloatArray, y: FloatArray) -> str:
    parts = []
    for piece in _pieces(x, y):
        points = np.column_stack([x[piece], y[piece]])
        # One format for all points takes two thirds of the time of one per point.
        parts.append("M" + " ".join(["%.1f,%.2f"] * len(points)) % tuple(points.ravel().tolist()))
    return "".join(parts)


def _cross(x: float, y: float, size: float, shape: Shape) -> str:
    if shape == "plus":
        return f"M{x - size:.1f},{y:.1f}h{2 * size:g}M{x:.1f},{y - size:.1f}v{2 * size:g}"
    return (
        f"M{x - size:.1f},{y - size:.1f}l{2 * size:g},{2 * size:g}"
        f"M{x - size:.1f},{y + size:.1f}l{2 * size:g},{-2 * size:g}"
    )


def _label(x: float, y: float, text: str, more: str = "", *, anchor: str = "start") -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    return f"<text {place}{more}>{marked_up(text)}</text>"


def _stroke(colour: str, width: float, dash: str = "") -> str:
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return f' stroke="{css_colour(colour)}" stroke-width="{width:g}"{dashes}'


def _owner(run: str, part: str = "", name: str = "") -> str:
    """Attributes with a mark's run, its entry in the chart's legend, its name under the pointer."""
    named = {"run": run, "part": part, "name": name}
    return "".join(f' data-{key}="{escape(text)}"' for key, text in named.items() if text)


def dashes(style: LineStyle) -> str:
    """Dashes of a run; light shades are dashed to be distinct in print."""
    return DASHED if style.dashed else ""


# Approximate width of a letter, pixels.
LETTER = 6.7


Box: TypeAlias = tuple[float, float, float, float]


def _free(box: Box, occupied: Sequence[Box], a: _Axes) -> bool:
    """Whether a box lies in the plot and overlaps no other box."""
    x0, y0, x1, y1 = box
    inside = x0 >= 0.0 and y0 >= 0.0 and x1 <= a.width and y1 <= a.height
    return inside and not any(
        x0 < u1 and u0 < x1 and y0 < v1 and v0 < y1 for u0, v0, u1, v1 in occupied
    )


def marked_up(text: str, index: str = SVG_INDEX) -> str:
    """`text` as markup, with the index of each `SYMBOL` as a subscript."""
    return SYMBOL.sub(lambda symbol: symbol[1] + index.format(symbol[2]), escape(text))


# Height of a row of names, pixels.
LEGEND_ROW = 15.0

# Pixels before a name in a legend, and total extra width of a name.
SIGN, NEXT_SIGN = 28.0, 42.0


def _legend(legend: Sequence[LegendEntry], width: float, top: float) -> tuple[str, float]:
    """The names in rows of a given width, and the height of the rows."""
    parts, left, height = [], width, 0.0
    for name, colour, dash in legend:
        needed = NEXT_SIGN + LETTER * len(name)
        if left + needed > width - 8.0:
            left, height = 8.0, height + LEGEND_ROW
        up = top + height - LEGEND_ROW
        parts.append(f'<g transform="translate({left:.1f} {up:.1f})">{key(colour, dash)}</g>')
        parts.append(_label(left + SIGN, up + 4.0, name))
        left += needed
    return "".join(parts), height


def key(colour: str, dash: str = "", width: float = 2.0) -> str:
    """The legend symbol of a line, band or point, 24 pixels wide."""
    if dash == "band":
        fill = f'fill="{css_colour(colour)}" fill-opacity="0.3"'
        return f'<rect x="0" y="-5" width="24" height="10" {fill}/>'
    if dash == "dot":
        return f'<circle cx="12" cy="0" r="4" fill="{css_colour(colour)}"/>'
    if dash in ("cross", "plus"):
        return f'<path d="{_cross(12.0, 0.0, 4.0, dash)}"{_stroke(colour, width)}/>'
    return f'<path d="M0,0H24"{_stroke(colour, width, dash)}/>'


def peaks(values: FloatArray, *, most: int = MOST) -> np.ndarray:
    """Samples of a long flight to draw: minimum and maximum of every stretch, in order."""
    if (n := len(values)) <= most:
        return np.arange(n)
    edges = np.linspace(0, n, most // 2 + 1).astype(int)
    width = int(np.diff(edges).max())
    inside = np.minimum(edges[:-1, None] + np.arange(width), (edges[1:] - 1)[:, None])
    samples = [np.array([0, n - 1])]
    for line in values.reshape(n, -1).T:
        stretches = line[inside]
        # In each stretch with a gap, one sample of the gap is kept.
        gap = np.isnan(stretches)
        for extreme, missing in ((np.argmin, np.inf), (np.argmax, -np.inf)):
            filled = np.where(gap, missing, stretches)
            samples.append(inside[np.arange(len(inside)), extreme(filled, axis=1)])
        # Without a missing sample the line would cross a short gap.
        broken = np.flatnonzero(gap.any(axis=1))
        samples.append(inside[broken, gap[broken].argmax(axis=1)])
    return np.unique(np.concatenate(samples))


def thinned(x: FloatArray, y: FloatArray, most: int = MAX_DRAWN) -> tuple[FloatArray, FloatArray]:
    """About `most` points of a line at most, with every peak and every gap."""
    if len(x) <= most:
        return x, y
    samples = peaks(y, most=most)
    return x[samples], y[samples]


def evenly(n: int, *, most: int = MOST) -> np.ndarray:
    """Samples of `n` to draw if peaks do not matter: all, or evenly spaced."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(int))
