"""Charts of a gap, of a linear loop (Bode, Nyquist, eigenvalues) and of a route."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.signals import CHANNEL_NAMES, CHANNEL_SYMBOLS, SYMBOLS, titles
from flighttune.base.units import DEG, DEG_PER_RAD
from flighttune.control.certificates.make import Certification
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.control.margins import Margins, channel_responses, loop_margins
from flighttune.control.tuning.envelope import rate_curve
from flighttune.flight.conditions import reference_of
from flighttune.flight.loop.run import claimed_along, claims_around
from flighttune.flight.metrics import OFF_ROUTE, channel_metrics
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.gap import Gap
from flighttune.outputs.answers.run import run_styles
from flighttune.outputs.answers.tuning import rate_chart
from flighttune.outputs.drawing.chart import DASHED, DOTTED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK, LIMIT, NEUTRAL
from flighttune.outputs.pages.panels import Drawn, draw_bounds, most_points
from flighttune.outputs.recording.plots import displayed
from flighttune.routes.fence import Fence
from flighttune.routes.follow import RouteReference
from flighttune.routes.path import Path

# The map stands beside three charts along the route, in three rows of the page.
ROW_HEIGHT, MAP_HEIGHT = 150.0, 510.0

# Shortest distance between the numbers of two waypoints, relative to the length of the route.
NUMBERS_APART = 0.05

DISTANCE_AXIS, KM = "along the route [km]", 1000.0

# Distance between points of the corridor's edges, m.
APART = 10.0

# Factors that widen a drawn corridor, and its maximum width as a share of the map.
CORRIDOR_FACTORS, MAX_CORRIDOR_SHARE = (2, 5, 10, 20, 50, 100), 0.02

# Length of the wind arrow as a share of the map.
ARROW = 0.12


def planned_path(flights: Drawn) -> Path | None:
    """The path of the route that runs fly, if they fly one."""
    followed = reference_of(scenario_of(flights[0][0]))
    return followed.path if isinstance(followed, RouteReference) else None


def route_charts(flights: Drawn) -> list[Chart]:
    """Map, height, and distances from the route of flights along it; none without a route."""
    if (path := planned_path(flights)) is None:
        return []
    s, most = path.points(APART), most_points(len(flights))
    # the first band around each signal
    sides, ends = (
        next((ends for run, _ in flights for ends in claimed_along(run, signal, s)), None)
        for signal in OFF_ROUTE
    )
    above = route_map(scenario_of(flights[0][0]), path, s, sides)
    height = heights(path, s, ends, ROW_HEIGHT)
    height.line(path.s / KM, path.up, NEUTRAL, name="planned", width=2.2)
    errors = [along_route(path, *titles(signal), ROW_HEIGHT) for signal in OFF_ROUTE]
    for chart in errors:
        chart.level(0.0, NEUTRAL, dash="")
    for run, style in flights:
        label, signals = run.label, run.signals
        along = signals["along"].to_numpy() / KM
        above.run_line(signals["east"], signals["north"], style, label, most=most)
        height.run_line(along, -signals["down"].to_numpy(), style, label, most=most)
        for chart, signal in zip(errors, OFF_ROUTE, strict=True):
            draw_bounds(chart, run, along, signal, style.colour)
            chart.run_line(along, signals[signal].to_numpy(), style, label, most=most)
    last = -math.inf
    for turn in path.stretches:
        middle = turn.start + 0.5 * turn.length
        # turns have the waypoint's number; numbers must not cover each other
        if turn.kind != "leg" and middle - last > NUMBERS_APART * path.length:
            last = middle
            up, number = float(np.interp(middle, path.s, path.up)), turn.name.split()[-1]
            height.text(middle / KM, up, number, anchor="middle", shift=(0.0, -5.0))
    low, high = height.y_ends()
    height.y_range = low, high + 0.15 * (high - low)  # room for the numbers
    return [above, height, *errors]


def along_route(path: Path, title: str, unit: str, height: float) -> Chart:
    """An empty chart over the distance along the route."""
    ends = 0.0, path.length / KM
    return Chart(title=title, x=DISTANCE_AXIS, y=unit, x_range=ends, height=height)


def heights(path: Path, s: FloatArray, corridor: FloatArray | None, height: float) -> Chart:
    """Height over the start along the route, with a corridor about it at distances `s`."""
    chart = along_route(path, "Height over the start", "h [m]", height)
    if corridor is not None:
        high, low = (path.beside(s, below=end)[:, 2] for end in corridor)
        chart.band(s / KM, low, high, NEUTRAL, name="corridor")
    return chart


def route_map(
    scenario: Scenario, path: Path, s: FloatArray, corridor: FloatArray | None, wind: str = ""
) -> Chart:
    """Map with north up: planned path, waypoints, wind, and a corridor at distances `s`.

    `wind`: winds of the flights, which are then written below instead of the scenario's wind.
    """
    chart = Chart(title="Map", x="east [m]", y="north [m]", equal=True, height=MAP_HEIGHT)
    inside = path.s <= path.length
    east, north = path.east[inside], path.north[inside]
    if corridor is not None:
        sides = np.append(corridor[0], corridor[1, ::-1])
        largest_factor = MAX_CORRIDOR_SHARE * max(np.ptp(east), np.ptp(north)) / np.abs(sides).max()
        wider = max((times for times in CORRIDOR_FACTORS if times <= largest_factor), default=1)
        up, across, _ = path.beside(np.append(s, s[::-1]), wider * sides).T
        name = "corridor" if wider == 1 else f"corridor, drawn {wider} times as wide"
        chart.area(across, up, NEUTRAL, name=name)
    chart.line(east, north, NEUTRAL, name="planned path", width=2.2)
    assert scenario.route is not None
    points = scenario.route.waypoints()
    places = [point.east for point in points], [point.north for point in points]
    chart.points(*places, INK, size=2.0)
    chart.label_points([(p.east, p.north, p.number) for p in points])
    if rally := scenario.route.rally_points():
        north, east = zip(*rally, strict=True)
        chart.points(east, north, INK, size=4.0)
        chart.label_points([(e, n, "rally") for n, e in rally])
    if wind:
        chart.x += f", wind {wind}"
    elif scenario.wind is not None:
        _wind_arrow(chart, np.array(scenario.wind.profile().at(scenario.flight.h_m)[:2]))
    return chart


def draw_rings(
    chart: Chart, lines: Iterable[FloatArray], colour: str, name: str, dash: str, **more: Any
) -> None:
    """Draw lines of north and east on a map as one that is broken between them."""
    north, east = np.vstack([part for x in lines for part in (x, [[np.nan, np.nan]])]).T
    chart.line(east, north, colour, name=name, dash=dash, most=len(north), hover=False, **more)


def draw_edges(chart: Chart, fence: Fence, name: str = "fence", dash: str = "") -> None:
    """Draw the edges of a fence on a map."""
    draw_rings(chart, np.stack([fence.start, fence.end], axis=1), LIMIT, name, dash)


def draw_ends(chart: Chart, fence: Fence, path: Path) -> None:
    """Draw floor and ceiling of a fence over the heights along a route."""
    for height, name, dash in ((fence.high, "ceiling", ""), (fence.low, "floor", DASHED)):
        if np.isfinite(height):
            chart.line([0.0, path.length / KM], [height, height], LIMIT, name=name, dash=dash)


def _wind_arrow(chart: Chart, wind: FloatArray) -> None:
    """The wind at the start as an arrow in the upper left corner, with its speed."""
    if (speed := float(np.hypot(*wind))) == 0.0:
        return
    (left, right), (_, top) = chart.x_ends(), chart.y_ends()
    size = ARROW * (right - left)
    ahead = size * wind[::-1] / speed  # east and north
    aside = 0.2 * ahead[::-1] * [-1.0, 1.0]
    tail = np.array([left, top]) + 0.7 * size * np.array([1.0, -1.0]) - 0.5 * ahead
    head, neck = tail + ahead, tail + 0.7 * ahead
    for line in ([tail, head], [neck + aside, head, neck - aside]):
        across, up = np.transpose(line)
        chart.line(across, up, INK, width=1.8)
    chart.text(
        left + 1.4 * size, top - 0.7 * size, f"wind at the start {speed:.3g} m/s", shift=(0.0, 4.0)
    )


# Colours of the loops cut at roll and at load factor, without a comparison of gains.
COLOURS = (HUES[0][0][0], HUES[1][0][0])

POINTS = 1200

# Factors for the shown frequencies below the slowest and above the fastest eigenvalue.
DECADES = 1.5

# Ranges of a Nyquist diagram.
WINDOW = (-3.0, 1.5), (-2.0, 2.0)

# Height of a chart of the plane, pixels.
SQUARE = 340.0


def loop_sheet(certification: Certification, title: str) -> Sheet:
    """The charts of the loop of gains and, over an envelope, of their certified rate."""
    model, gains = certification.model, certification.gains
    charts = loop_charts(model, gains, loop_margins(model, gains))
    if certification.ranges and certification.g and certification.largest_factor:
        trim, envelope = certification.ranges
        curve = rate_curve(gains, envelope, trim, g=certification.g)
        charts.append(rate_chart({certification.name: curve}, envelope))
    return Sheet(charts=charts, title=title)


def loop_charts(model: LinearModel, gains: PIGains, margins: Sequence[Margins]) -> list[Chart]:
    """Bode and Nyquist diagrams and the eigenvalues of the loop of gains on a linear model."""
    eigenvalues = np.asarray(np.linalg.eigvals(closed_loop(model, gains)), dtype=complex)
    speeds = np.abs(eigenvalues)
    low, high = math.log10(speeds[speeds > 0.0].min()), math.log10(speeds.max())
    omega = np.logspace(low - DECADES, high + DECADES, POINTS)
    # The loop is cut at each input with the other closed. An unstable loop has no `margins`.
    responses = channel_responses(model, gains, omega)
    title = "Loop cut at one input, the other closed: magnitude"
    x = "frequency [rad/s]"
    magnitude = Chart(title=title, x=x, y="magnitude [dB]", log="x")
    phase = Chart(title="Its phase", x=x, y="phase [deg]", log="x")
    nyquist = _nyquist(margins)
    magnitude.level(0.0, NEUTRAL, dash="")
    phase.level(-180.0, NEUTRAL, dash="")
    for i, channel in enumerate(model.inputs):
        name, colour, response = SYMBOLS.get(channel, channel), COLOURS[i % 2], responses[:, i]
        # the angle at low frequency lies between -360 and 0: a loop with integral action lags
        angle = np.unwrap(np.angle(response))
        angle = (angle - 2.0 * math.pi * math.ceil(angle[0] / (2.0 * math.pi))) / DEG
        decibel = 20.0 * np.log10(np.abs(response))
        magnitude.line(omega, decibel, colour, name=name)
        phase.line(omega, angle, colour, name=name)
        nyquist.line(response.real, response.imag, colour, name=name)
        nyquist.line(response.real, -response.imag, colour, dash=DOTTED, width=1.0)
        if not margins:
            continue
        # each margin: its crossing, words, chart, position and level
        disk, marks = margins[i], []
        if math.isfinite(disk.phase_margin):
            at = np.exp(1j * (disk.phase_margin - math.pi))
            k = int(np.argmin(np.abs(response - at)))
            words = f"phase margin {disk.phase_margin / DEG:.1f}°"
            level = 360.0 * round((angle[k] + 180.0) / 360.0) - 180.0
            marks.append((at, k, words, phase, angle[k], level))
        for gain in (disk.gain_increase, disk.gain_decrease):
            if math.isfinite(gain) and gain > 0.0:
                at = complex(-1.0 / gain)
                k = int(np.argmin(np.abs(response - at)))
                words = f"gain margin {20.0 * math.log10(gain):+.1f} dB"
                marks.append((at, k, words, magnitude, decibel[k], 0.0))
        for at, k, words, chart, place, level in marks:
            tip = f"{name}: {words} at {omega[k]:.2f} rad/s"
            chart.line([omega[k], omega[k]], [level, place], colour, width=3.0)
            chart.points(omega[k], place, colour, tips=[tip])
            chart.legend.append((words, colour, "dot"))
            nyquist.points(at.real, at.imag, colour, tips=[tip], filled=chart is phase)
    return [magnitude, phase, nyquist, _eigenvalues(eigenvalues)]


def _nyquist(margins: Sequence[Margins]) -> Chart:
    chart = Chart(
        title="Nyquist; the loop is unstable where a curve moves across −1",
        x="real part",
        y="imaginary part",
        height=SQUARE,
        x_range=WINDOW[0],
        y_range=WINDOW[1],
        equal=True,
    )
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    chart.line(np.cos(turn), np.sin(turn), NEUTRAL, width=1.0)
    chart.points(-1.0, 0.0, LIMIT, shape="cross", size=6)
    if margins and math.isfinite(margins[-1].gain_increase):
        # the disk meets the real axis at minus the gain margins of all loops together
        near, far = margins[-1].gain_decrease, margins[-1].gain_increase
        middle, radius = -(near + far) / 2.0, (far - near) / 2.0
        across, up = middle + radius * np.cos(turn), radius * np.sin(turn)
        name = f"disk margin {margins[-1].disk_margin:.2f}"
        chart.line(across, up, LIMIT, dash=DASHED, width=1.2, name=name)
    return chart


def _eigenvalues(eigenvalues: npt.NDArray[np.complex128]) -> Chart:
    low = float(eigenvalues.real.min())
    chart = Chart(
        title="Eigenvalues of the closed loop",
        x="real part [1/s]",
        y="imaginary part [rad/s]",
        height=SQUARE,
        equal=True,
        x_range=(1.15 * min(low, -1e-3), max(0.15 * abs(low), 1.15 * eigenvalues.real.max())),
    )
    chart.upright(0.0)
    tips = [f"{value:.3f} 1/s" for value in eigenvalues]
    chart.points(eigenvalues.real, eigenvalues.imag, HUES[5][0][0], shape="cross", tips=tips)
    return chart


BAR_NAMES = ("kinematic", "+ actual\nlift", "+ lag of\ninner loop", "+ six\nd.o.f.", "aircraft")


def colours(gap: Gap) -> tuple[str, ...]:
    """Colour of each rung, lowest first, as in the recording; a step has its upper rung's."""
    styles = run_styles(gap.runs)
    return tuple(styles[run.label].colour for run in gap.runs)


def gap_charts(gap: Gap) -> list[Chart]:
    """Every chart of a gap whose aircraft flew."""
    kinds = (itae_chart, _rungs, steps_chart, _mismatch, bound_chart)
    return [kind(gap, channel) for kind in kinds for channel in CHANNEL_SYMBOLS]


def gap_sheet(gap: Gap) -> Sheet:
    """`gap_charts` as one picture."""
    return Sheet(charts=gap_charts(gap), title=f"{gap.scenario.title}; gains {gap.name}")


def itae_chart(gap: Gap, channel: str) -> Chart:
    """Bars for the kinematic plant, the contribution of each step, and the aircraft."""
    title = f"{gap.name}: {CHANNEL_NAMES[channel]}, ITAE from law to aircraft"
    places = [(float(i), name) for i, name in enumerate(BAR_NAMES)]
    chart = Chart(title=title, x="", y="ITAE [rad s²]", x_ticks=places)
    if gap.failed:
        chart.x_range, chart.y_range, chart.x_ticks, chart.y_ticks = (0, 1), (0, 1), (), ()
        why = [f"{plant} {reason}" for plant, reason in gap.failed.items()]
        for i, line in enumerate(["none:", *why]):
            chart.text(0.5, 0.6, line, anchor="middle", shift=(0.0, 14.0 * i))
        return chart
    steps = [float(step.metrics.at[channel, "ITAE"]) for step in gap.steps]
    first, last = (
        float(channel_metrics(run).at[channel, "ITAE"]) for run in (gap.runs[0], gap.runs[-1])
    )
    ends = np.cumsum([first, *steps])
    lows = np.array([0.0, *np.minimum(ends[:-1], ends[1:]), 0.0])
    tops = lows + np.array([first, *np.abs(steps), last])
    rung_colours = colours(gap)
    chart.y_range = (min(0.0, 1.1 * float(lows.min())), 1.12 * float(tops.max()) or 1.0)
    chart.bars(lows, tops, [*rung_colours, rung_colours[-1]])
    for i, level in enumerate(ends.tolist()):
        chart.line([i - 0.32, i + 1.32], [level, level], INK, width=0.8)
    labels = [f"{first:.2f}", *(f"{step:+.2f}" for step in steps), f"{last:.2f}"]
    for i, (text, up) in enumerate(zip(labels, tops.tolist(), strict=True)):
        chart.text(i, up, text.replace("-", "−"), anchor="middle", shift=(0.0, -4.0))
    return chart


def steps_chart(gap: Gap, channel: str) -> Chart:
    """Contribution of each step over time, and their sum."""
    assert gap.whole is not None
    t = gap.runs[0].t
    title = f"{CHANNEL_NAMES[channel]}, what each step adds"
    chart = _over_time(gap, title, f"Δ{CHANNEL_SYMBOLS[channel]} [deg]")
    for step, colour in zip(gap.steps, colours(gap)[1:], strict=True):
        chart.line(t, getattr(step, channel) * DEG_PER_RAD, colour, name=step.adds)
    whole = getattr(gap.whole, channel) * DEG_PER_RAD
    chart.line(t, whole, INK, dash=DASHED, width=1.1, name="sum")
    return chart


def bound_chart(gap: Gap, channel: str) -> Chart:
    """The error on the aircraft with the claims about it, and whether the flight is inside."""
    run, colour = gap.aircraft, colours(gap)[-1]
    signal, factor = f"{channel}_err", DEG_PER_RAD
    distance = ""
    if gap.scenario.route is not None:  # the error of the channel
        signal, factor = OFF_ROUTE[list(CHANNEL_SYMBOLS).index(channel)], 1.0
        distance = "distance "
    title, label = titles(signal)
    words = f"{distance}{title[0].lower()}{title[1:]}"
    chart = _over_time(gap, f"{words} on the aircraft", label)
    chart.line(run.t, run.signals[signal].to_numpy() * factor, colour, name="error", width=1.8)
    for claim, (low, high) in claims_around(run.claims, signal):
        inside = claim.bounds.of([signal]).contain(run.signals)
        name = f"{claim.title}, {'flight inside' if inside else 'left'}"
        colour = NEUTRAL if claim.kind == "counted" else LIMIT
        chart.band(run.t, low * factor, high * factor, colour, name=name)
    if not run.claims:
        chart.title += "; nothing is claimed of it yet"
    return chart


def _rungs(gap: Gap, channel: str) -> Chart:
    chart = _over_time(gap, CHANNEL_NAMES[channel], f"{CHANNEL_SYMBOLS[channel]} [deg]")
    lowest = gap.runs[0]
    reference = displayed(lowest.signals, f"{channel}_ref")
    chart.line(lowest.t, reference, NEUTRAL, dash=DASHED, name="reference")
    for run, colour in zip(gap.runs, colours(gap), strict=True):
        chart.line(run.t, displayed(run.signals, channel), colour, name=run.provenance.plant)
    return chart


def _mismatch(gap: Gap, channel: str) -> Chart:
    assert gap.mismatch is not None
    title = f"mismatch, {CHANNEL_NAMES[channel]} rate flown minus that of the law"
    chart = _over_time(gap, title, f"d_{CHANNEL_SYMBOLS[channel]} [deg/s]")
    d = gap.mismatch.d[:, list(CHANNEL_SYMBOLS).index(channel)] * DEG_PER_RAD
    chart.line(gap.mismatch.t, d, colours(gap)[-1], run="mismatch")
    return chart


def _over_time(gap: Gap, title: str, unit: str) -> Chart:
    """An empty chart over the flight of the aircraft."""
    ends = 0.0, gap.aircraft.duration
    return Chart(title=f"{gap.name}: {title}", y=unit, x_range=ends, linked=True)
