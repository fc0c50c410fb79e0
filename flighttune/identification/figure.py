"""A figure of an identified inner loop: Bode of fit against flight, and the manoeuvre held out."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.arrays import FloatArray
from flighttune.control.inner_loop import InnerLag
from flighttune.identification.experiment import DT
from flighttune.identification.file import Channel
from flighttune.identification.fit import Identification
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.palette import HUES, NEUTRAL
from flighttune.units import DEG

Response: TypeAlias = npt.NDArray[np.complex128]

CHANNELS: tuple[Channel, Channel] = ("phi", "n_z")
NAMES = "Roll", "Load factor"
FLOWN, FIT, CROSS = HUES[0][0][0], HUES[1][0][0], HUES[3][0][0]
LABELS = ("φ [deg]", "n_z [1]")
CROSS_TITLES = ("Coupling: roll command to n_z", "Coupling: load-factor command to roll")
UNITS = DEG, 1.0

# Magnitude at the bandwidth, dB.
BANDWIDTH = -3.01


def identification_figure(identification: Identification, title: str) -> Sheet:
    """Bode diagrams, coupling and the held-out manoeuvre of one condition, a column per channel."""
    kinds = (_magnitude, _phase, _coupling, held_out)
    return Sheet(charts=[kind(identification, i) for kind in kinds for i in range(2)], title=title)


def _magnitude(identification: Identification, i: int) -> Chart:
    chart = _bode(f"{NAMES[i]}: command to response", "magnitude [dB]")
    lag = _fit(chart, identification, i, _decibel)
    chart.level(BANDWIDTH, NEUTRAL, dash=DASHED)
    chart.points(lag.bandwidth, BANDWIDTH, NEUTRAL, size=4.5)
    name = f"−3 dB at {lag.bandwidth:.1f} rad/s"
    chart.text(lag.bandwidth, BANDWIDTH, name, anchor="end", shift=(-8.0, 14.0))
    return chart


def _phase(identification: Identification, i: int) -> Chart:
    chart = _bode(f"{NAMES[i]}: its phase", "phase [deg]")
    _fit(chart, identification, i, _phase_deg)
    return chart


def _coupling(identification: Identification, i: int) -> Chart:
    response = identification.channels[CHANNELS[i]].frequency
    assert response.other is not None  # of two channels
    chart = _bode(CROSS_TITLES[i], ("magnitude [dB of 1/rad]", "magnitude [dB of rad]")[i])
    chart.points(response.omega, _decibel(response.other), CROSS, shape="cross", name="flown")
    return chart


def held_out(identification: Identification, i: int) -> Chart:
    """The manoeuvre not used for the fit, of roll (0) or load factor (1)."""
    channel = identification.channels[CHANNELS[i]]
    title = f"Not used for the fit: {channel.table.fit_percent:.1f} % of the variance explained"
    chart = Chart(title=title, y=LABELS[i])
    lines = ("commanded", NEUTRAL, DASHED, 1.0), ("flown", FLOWN, "", 2.4), ("fit", FIT, "", 1.3)
    for name, colour, dash, width in lines:
        values = getattr(channel, name) / UNITS[i]
        t = DT * np.arange(len(values))
        chart.line(t, values, colour, dash=dash, width=width, name=name)
    return chart


def _fit(
    chart: Chart, identification: Identification, i: int, quantity: Callable[[Response], FloatArray]
) -> InnerLag:
    channel = identification.channels[CHANNELS[i]]
    response, lag = channel.frequency, channel.candidates[0].lag
    omega = np.geomspace(response.omega[0], response.omega[-1], 300)
    chart.line(omega, quantity(lag.response(omega)), FIT, width=2.0, name=f"fit, order {lag.order}")
    chart.points(response.omega, quantity(response.own), FLOWN, name="flown")
    return lag


def _bode(title: str, unit: str) -> Chart:
    return Chart(title=title, x="frequency [rad/s]", y=unit, log="x")


def _decibel(response: Response) -> FloatArray:
    return 20.0 * np.log10(np.maximum(np.abs(response), 1e-6))


def _phase_deg(response: Response) -> FloatArray:
    return np.rad2deg(np.unwrap(np.angle(response)))
