"""Charts of a linear loop: Bode and Nyquist with margins marked, and eigenvalues."""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from flighttune.certificates.make import Certification
from flighttune.control.gains import PIGains
from flighttune.control.linear_model import LinearModel, closed_loop
from flighttune.control.margins import Margins, channel_responses, loop_margins
from flighttune.present.chart import DASHED, DOTTED, Chart, Sheet
from flighttune.present.names import SYMBOLS
from flighttune.present.palette import HUES, LIMIT, NEUTRAL
from flighttune.tuning.envelope import rate_chart, rate_curve
from flighttune.units import DEG

# Colours of the loops cut at roll and at load factor, if no gains are compared.
COLOURS = (HUES[0][0][0], HUES[1][0][0])

POINTS = 1200

# Frequencies shown below the slowest and above the fastest eigenvalue.
DECADES = 1.5

# Part of the plane that a Nyquist diagram shows.
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
    """Bode and Nyquist diagrams and the eigenvalues of the loop of gains on a linear model.

    The loop is cut at each input with the other closed. Gain and phase margin are marked, and the
    disk that no response enters; `margins` is empty where the loop is not stable.
    """
    eigenvalues = np.asarray(np.linalg.eigvals(closed_loop(model, gains)), dtype=complex)
    speeds = np.abs(eigenvalues)
    low, high = math.log10(speeds[speeds > 0.0].min()), math.log10(speeds.max())
    omega = np.logspace(low - DECADES, high + DECADES, POINTS)
    responses = channel_responses(model, gains, omega)
    magnitude = _bode("Loop cut at one input, the other closed: magnitude", "magnitude [dB]")
    phase = _bode("Its phase", "phase [deg]")
    nyquist = _nyquist(margins)
    magnitude.level(0.0, NEUTRAL, dash="")
    phase.level(-180.0, NEUTRAL, dash="")
    for i, channel in enumerate(model.inputs):
        name, colour, response = SYMBOLS.get(channel, channel), COLOURS[i % 2], responses[:, i]
        # the angle at low frequency lies between -360 and 0: a loop with integral action lags
        angle = np.unwrap(np.angle(response))
        angle -= 2.0 * math.pi * math.ceil(angle[0] / (2.0 * math.pi))
        decibel = 20.0 * np.log10(np.abs(response))
        magnitude.line(omega, decibel, colour, name=name)
        phase.line(omega, angle / DEG, colour, name=name)
        nyquist.line(response.real, response.imag, colour, name=name)
        nyquist.line(response.real, -response.imag, colour, dash=DOTTED, width=1.0)
        if not margins:
            continue
        disk = margins[i]
        if math.isfinite(disk.phase_margin):
            on_circle = np.exp(1j * (disk.phase_margin - math.pi))
            k = int(np.argmin(np.abs(response - on_circle)))
            margin = f"phase margin {disk.phase_margin / DEG:.1f}°"
            tip = f"{name}: {margin} at {omega[k]:.2f} rad/s"
            level = 360.0 * round((angle[k] / DEG + 180.0) / 360.0) - 180.0
            phase.line([omega[k], omega[k]], [level, angle[k] / DEG], colour, width=3.0)
            phase.points(omega[k], angle[k] / DEG, colour, tips=[tip])
            phase.legend.append((margin, colour, "dot"))
            nyquist.points(on_circle.real, on_circle.imag, colour, tips=[tip])
        for gain in (disk.gain_increase, disk.gain_decrease):
            if not (math.isfinite(gain) and gain > 0.0):
                continue
            k = int(np.argmin(np.abs(response + 1.0 / gain)))
            margin = f"gain margin {20.0 * math.log10(gain):+.1f} dB"
            tip = f"{name}: {margin} at {omega[k]:.2f} rad/s"
            magnitude.line([omega[k], omega[k]], [decibel[k], 0.0], colour, width=3.0)
            magnitude.points(omega[k], decibel[k], colour, tips=[tip])
            magnitude.legend.append((margin, colour, "dot"))
            nyquist.points(-1.0 / gain, 0.0, colour, tips=[tip], filled=False)
    return [magnitude, phase, nyquist, _eigenvalues(eigenvalues)]


def _bode(title: str, unit: str) -> Chart:
    return Chart(title=title, x="frequency [rad/s]", y=unit, log="x")


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
        # the disk meets the real axis at minus the gains that all loops survive at once
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
