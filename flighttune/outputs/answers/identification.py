"""The answer of the identification of an aircraft, and its figure."""

from itertools import chain
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.arrays import FloatArray
from flighttune.base.units import DEG
from flighttune.outputs.answers.answer import Answer, Table
from flighttune.outputs.answers.finding import unmet
from flighttune.outputs.answers.labels import columns
from flighttune.outputs.answers.tables import lags_table
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, NEUTRAL
from flighttune.vehicles.identification import file as model_file
from flighttune.vehicles.identification.fit import DT, ChannelIdentification, Identification
from flighttune.vehicles.identification.identify import GOOD_FIT, AircraftIdentification

Response: TypeAlias = npt.NDArray[np.complex128]

CHANNELS: tuple[model_file.Channel, model_file.Channel] = ("phi", "n_z")
NAMES = "Roll", "Load factor"
COUPLINGS = (
    ("Coupling: roll command to n_z", "magnitude [dB of 1/rad]"),
    ("Coupling: load-factor command to roll", "magnitude [dB of rad]"),
)
LABELS = ("φ [deg]", "n_z [1]")
UNITS = DEG, 1.0
FLOWN, FIT, CROSS = HUES[0][0][0], HUES[1][0][0], HUES[3][0][0]
# Magnitude at the bandwidth, dB.
BANDWIDTH = -3.01
MODE_COLUMNS = columns(
    "name eigenvalue_per_s.0 eigenvalue_per_s.1 natural_frequency_rad_s damping", of="modes"
)
FIT_NOTE = (
    "fit: share of the variance explained in a manoeuvre not used for the fit; cross: largest "
    "response of the other channel, 1/rad (phi) and rad (n_z)"
)


def answer(identification: AircraftIdentification) -> Answer:
    """Lags with their fits, and modes; a failure if a lag explains too little."""
    conditions = model_file.identified_tables(identification.identified)["conditions"]
    poor = [
        f"{channel} at {point.V_a:g} m/s, {point.gamma / DEG:g} deg: {fitted.fit_percent:.1f} %"
        for point in identification.identified.conditions
        for channel, fitted in point.channels.items()
        if fitted.fit_percent < GOOD_FIT
    ]
    fits = [row["fit_percent"] for x in conditions for row in x["channels"].values()]
    less = f"a lag explains less than {GOOD_FIT:g} % of {'; '.join(poor)}"
    title = f"{identification.place}: airframe without the inner loop"
    airframe = Table(MODE_COLUMNS, identification.modes, title, name="modes")
    values = {"aircraft": identification.identified.aircraft, "channels": conditions[0]["channels"]}
    return Answer(
        lines=[
            f"The identified lags explain at least {min(fits):.1f} % of the variance of every "
            "channel in every flight condition."
        ],
        values={**values, "conditions": conditions, "skipped": identification.skipped},
        tables=[lags_table(identification.identified), airframe],
        notes=[FIT_NOTE, *(f"left out: {reason}" for reason in identification.skipped)],
        findings=unmet(f"{identification.identified.aircraft}: {less}") if poor else [],
    )


def sheet(identification: AircraftIdentification) -> Sheet:
    """Bode diagrams, coupling and validation manoeuvre of the first condition, by channel."""
    flights = identification.conditions[0]
    columns = [
        (*bode(flights.channels[name], NAMES[i], COUPLINGS[i]), held_out(flights, i))
        for i, name in enumerate(CHANNELS)
    ]
    return Sheet(charts=[*chain(*zip(*columns, strict=True))], title=identification.place)


def bode(
    channel: ChannelIdentification, name: str, coupling: tuple[str, str]
) -> tuple[Chart, Chart, Chart]:
    """Measured and fitted magnitude and phase of a channel, and the magnitude of its coupling."""
    response, lag = channel.frequency, channel.candidates[0].lag
    assert response.other is not None  # one magnitude per channel
    omega = np.geomspace(response.omega[0], response.omega[-1], 300)
    magnitude, phase, other = (
        Chart(title=title, x="frequency [rad/s]", y=unit, log="x")
        for title, unit in (
            (f"{name}: command to response", "magnitude [dB]"),
            (f"{name}: its phase", "phase [deg]"),
            coupling,
        )
    )
    for chart, quantity in (magnitude, decibel), (phase, phase_deg):
        fit = quantity(lag.response(omega))
        chart.line(omega, fit, FIT, width=2.0, name=f"fit, order {lag.order}")
        chart.points(response.omega, quantity(response.own), FLOWN, name="flown")
    magnitude.level(BANDWIDTH, NEUTRAL, dash=DASHED)
    magnitude.points(lag.bandwidth, BANDWIDTH, NEUTRAL, size=4.5)
    label = f"−3 dB at {lag.bandwidth:.1f} rad/s"
    magnitude.text(lag.bandwidth, BANDWIDTH, label, anchor="end", shift=(-8.0, 14.0))
    other.points(response.omega, decibel(response.other), CROSS, shape="cross", name="flown")
    return magnitude, phase, other


def held_out(identification: Identification, i: int) -> Chart:
    """The manoeuvre not used for the fit, of roll (0) or load factor (1)."""
    channel = identification.channels[CHANNELS[i]]
    title = f"Not used for the fit: {channel.table.fit_percent:.1f} % of the variance explained"
    chart = Chart(title=title, y=LABELS[i])
    lines = ("commanded", NEUTRAL, DASHED, 1.0), ("flown", FLOWN, "", 2.4), ("fit", FIT, "", 1.3)
    for name, colour, dash, width in lines:
        values = getattr(channel, name) / UNITS[i]
        chart.line(DT * np.arange(len(values)), values, colour, dash=dash, width=width, name=name)
    return chart


def decibel(response: Response) -> FloatArray:
    return 20.0 * np.log10(np.maximum(np.abs(response), 1e-6))


def phase_deg(response: Response) -> FloatArray:
    return np.rad2deg(np.unwrap(np.angle(response)))
