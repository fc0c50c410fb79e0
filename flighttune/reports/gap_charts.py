"""Charts of a gap: rungs, effects of the steps, the mismatch, the error in its tube and ITAE."""

import numpy as np

from flighttune.errors import InputError
from flighttune.gaps.gap import Gap
from flighttune.metrics import channel_metrics
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.names import CHANNEL_NAMES, CHANNEL_SYMBOLS
from flighttune.present.palette import INK, LIMIT, NEUTRAL
from flighttune.simulate.bounds import claims_around
from flighttune.simulate.run import run_styles
from flighttune.units import DEG_PER_RAD

BAR_NAMES = ("paper's\nlaw", "+ exact\nlift", "+ inner\nloop", "+ six\nd.o.f.", "aircraft")

# Errors of a flight along a route by the channel that corrects them: signal, words and symbol.
ON_ROUTE = {
    "chi": ("cross_track", "distance to the right of the route", "e_y [m]"),
    "gamma": ("height_err", "distance below the route", "e_h [m]"),
}


def colours(gap: Gap) -> tuple[str, ...]:
    """Colour of each rung, lowest first, as in the recording; a step has that of its upper rung."""
    styles = run_styles(gap.runs)
    return tuple(styles[run.label].colour for run in gap.runs)


def gap_charts(gap: Gap) -> list[Chart]:
    """Every chart of a gap; InputError without a ladder, because the aircraft did not fly."""
    if not gap.steps:
        raise InputError(f"`gap` must have a ladder to be drawn, got none: {gap.reason}")
    kinds = (itae_chart, _rungs, steps_chart, _mismatch, bound_chart)
    return [kind(gap, channel) for kind in kinds for channel in CHANNEL_SYMBOLS]


def gap_sheet(gap: Gap) -> Sheet:
    """`gap_charts` as one picture."""
    return Sheet(charts=gap_charts(gap), title=f"{gap.scenario.title}; gains {gap.name}")


def itae_chart(gap: Gap, channel: str) -> Chart:
    """A bar for the paper's law, one for what each step adds, one for the aircraft."""
    title = f"{gap.name}: {CHANNEL_NAMES[channel]}, ITAE from law to aircraft"
    places = [(float(i), name) for i, name in enumerate(BAR_NAMES)]
    chart = Chart(title=title, x="", y="ITAE [rad s²]", x_ticks=places)
    if gap.failed:
        chart.x_range, chart.y_range, chart.x_ticks, chart.y_ticks = (0, 1), (0, 1), (), ()
        why = [f"{plant} {reason}" for plant, reason in gap.failed.items()]
        for i, line in enumerate(["none:", *why]):
            chart.text(0.5, 0.6, line, anchor="middle", shift=(0.0, 14.0 * i))
        return chart
    steps = [float(np.asarray(s.metrics.at[channel, "ITAE"])) for s in gap.steps]
    first, last = (
        float(np.asarray(channel_metrics(run).at[channel, "ITAE"]))
        for run in (gap.runs[0], gap.runs[-1])
    )
    ends = np.cumsum([first, *steps])
    lows = np.array([0.0, *np.minimum(ends[:-1], ends[1:]), 0.0])
    heights = np.array([first, *np.abs(steps), last])
    rung_colours = colours(gap)
    chart.y_range = (min(0.0, 1.1 * float(lows.min())), 1.12 * float((lows + heights).max()) or 1.0)
    chart.bars(lows, lows + heights, [*rung_colours, rung_colours[-1]])
    for i, level in enumerate(ends.tolist()):
        chart.line([i - 0.32, i + 1.32], [level, level], INK, width=0.8)
    labels = [f"{first:.2f}", *(f"{step:+.2f}" for step in steps), f"{last:.2f}"]
    for i, (text, up) in enumerate(zip(labels, (lows + heights).tolist(), strict=True)):
        chart.text(i, up, text.replace("-", "−"), anchor="middle", shift=(0.0, -4.0))
    return chart


def steps_chart(gap: Gap, channel: str) -> Chart:
    """Contribution of each step over time, and their sum."""
    assert gap.whole is not None
    t = gap.runs[0].t
    title = f"{gap.name}: {CHANNEL_NAMES[channel]}, what each step adds"
    chart = _over_time(gap, title, f"Δ{CHANNEL_SYMBOLS[channel]} [deg]")
    for step, colour in zip(gap.steps, colours(gap)[1:], strict=True):
        chart.line(t, getattr(step, channel) * DEG_PER_RAD, colour, name=step.adds)
    whole = getattr(gap.whole, channel) * DEG_PER_RAD
    chart.line(t, whole, INK, dash=DASHED, width=1.1, name="sum")
    return chart


def bound_chart(gap: Gap, channel: str) -> Chart:
    """The error on the aircraft with what is claimed of it, and whether the flight is inside."""
    run, colour = gap.aircraft, colours(gap)[-1]
    signal, words = f"{channel}_err", f"{CHANNEL_NAMES[channel]} error"
    symbol, factor = f"e_{CHANNEL_SYMBOLS[channel]} [deg]", DEG_PER_RAD
    if gap.scenario.route is not None:
        signal, words, symbol = ON_ROUTE[channel]
        factor = 1.0
    chart = _over_time(gap, f"{gap.name}: {words} on the aircraft", symbol)
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
    title = f"{gap.name}: {CHANNEL_NAMES[channel]}"
    chart = _over_time(gap, title, f"{CHANNEL_SYMBOLS[channel]} [deg]")
    for run, colour in zip(gap.runs, colours(gap), strict=True):
        values = run.signals[channel].to_numpy()
        reference = run.signals[f"{channel}_ref"].to_numpy()
        if channel == "chi":
            values, reference = np.unwrap(values), np.unwrap(reference)
        if run is gap.runs[0]:
            chart.line(run.t, reference * DEG_PER_RAD, NEUTRAL, dash=DASHED, name="reference")
        chart.line(run.t, values * DEG_PER_RAD, colour, name=run.provenance.plant)
    return chart


def _mismatch(gap: Gap, channel: str) -> Chart:
    assert gap.mismatch is not None
    title = f"{gap.name}: mismatch, {CHANNEL_NAMES[channel]} rate flown minus that of the law"
    chart = _over_time(gap, title, f"d_{CHANNEL_SYMBOLS[channel]} [deg/s]")
    d = gap.mismatch.d[:, list(CHANNEL_SYMBOLS).index(channel)] * DEG_PER_RAD
    chart.line(gap.mismatch.t, d, colours(gap)[-1], run="mismatch")
    return chart


def _over_time(gap: Gap, title: str, unit: str) -> Chart:
    return Chart(title=title, y=unit, x_range=(0.0, gap.aircraft.duration), linked=True)
