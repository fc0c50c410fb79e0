"""Identification of an inner loop at one condition or at several, and the figure that shows it."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, product
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from flighttune.base.answering import Answering
from flighttune.base.answers.answer import Answer, Table
from flighttune.base.answers.chart import DASHED, Chart, Sheet
from flighttune.base.answers.labels import columns
from flighttune.base.answers.palette import HUES, NEUTRAL
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import TrimError
from flighttune.base.files.shipped import is_shipped
from flighttune.base.units import DEG
from flighttune.control.inner_loop import Order
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.identification import file as model_file
from flighttune.vehicles.identification.fit import (
    DT,
    ChannelIdentification,
    Identification,
    identify_plant,
    identify_thrust,
)
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.linearize import linearize, modes
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.trim import level

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


def identification_figure(identification: Identification, title: str) -> Sheet:
    """Bode diagrams, coupling and the held-out manoeuvre of one condition, a column per channel."""
    columns = [
        (*_bode(identification.channels[name], NAMES[i], COUPLINGS[i]), held_out(identification, i))
        for i, name in enumerate(CHANNELS)
    ]
    return Sheet(charts=[*chain(*zip(*columns, strict=True))], title=title)


def _bode(
    channel: ChannelIdentification, name: str, coupling: tuple[str, str]
) -> tuple[Chart, Chart, Chart]:
    """Magnitude and phase of a channel as flown and fitted, and the magnitude of its coupling."""
    response, lag = channel.frequency, channel.candidates[0].lag
    assert response.other is not None  # of two channels
    omega = np.geomspace(response.omega[0], response.omega[-1], 300)
    magnitude, phase, other = (
        Chart(title=title, x="frequency [rad/s]", y=unit, log="x")
        for title, unit in (
            (f"{name}: command to response", "magnitude [dB]"),
            (f"{name}: its phase", "phase [deg]"),
            coupling,
        )
    )
    for chart, quantity in (magnitude, _decibel), (phase, _phase_deg):
        fit = quantity(lag.response(omega))
        chart.line(omega, fit, FIT, width=2.0, name=f"fit, order {lag.order}")
        chart.points(response.omega, quantity(response.own), FLOWN, name="flown")
    magnitude.level(BANDWIDTH, NEUTRAL, dash=DASHED)
    magnitude.points(lag.bandwidth, BANDWIDTH, NEUTRAL, size=4.5)
    label = f"−3 dB at {lag.bandwidth:.1f} rad/s"
    magnitude.text(lag.bandwidth, BANDWIDTH, label, anchor="end", shift=(-8.0, 14.0))
    other.points(response.omega, _decibel(response.other), CROSS, shape="cross", name="flown")
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


def _decibel(response: Response) -> FloatArray:
    return 20.0 * np.log10(np.maximum(np.abs(response), 1e-6))


def _phase_deg(response: Response) -> FloatArray:
    return np.rad2deg(np.unwrap(np.angle(response)))


# Gain of the inner loop that holds the airspeed it was designed for.
DESIGN_SPEED = "V_a-design-mps"

# Share of the variance, in percent, that the lags of a channel should explain.
GOOD_FIT = 90.0

MODE_COLUMNS = columns(
    "name eigenvalue_per_s.0 eigenvalue_per_s.1 natural_frequency_rad_s damping", of="modes"
)
FIT_NOTE = (
    "fit: share of the variance explained in a manoeuvre not used for the fit; cross: largest "
    "response of the other channel, 1/rad (phi) and rad (n_z)"
)


def _of_one_order(identifications: Sequence[Identification]) -> tuple[Identification, ...]:
    """The identifications with lags of one order a channel, the best over all of them."""
    # Models of one structure can be mixed, and one Lyapunov function can cover them all.
    chosen: list[dict[model_file.Channel, ChannelIdentification]] = [{} for _ in identifications]
    for name in identifications[0].channels:
        total: dict[Order, float] = defaultdict(float)
        for point in identifications:
            for fit in point.channels[name].candidates:
                total[fit.lag.order] += fit.bic
        order = min(total, key=total.__getitem__)
        for channels, point in zip(chosen, identifications, strict=True):
            fits = sorted(point.channels[name].candidates, key=lambda fit: fit.lag.order != order)
            channels[name] = replace(point.channels[name], candidates=tuple(fits))
    pairs = zip(identifications, chosen, strict=True)
    return tuple(replace(point, channels=channels) for point, channels in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AircraftIdentification(Answering):
    """Identification of an aircraft, and of its airframe without the inner loop."""

    identified: model_file.IdentifiedAircraft  # content of a model file
    conditions: tuple[Identification, ...]  # the flights, condition by condition
    skipped: tuple[str, ...]  # why a requested condition is missing: one sentence each
    modes: Sequence[Mapping[str, Any]]  # of the airframe alone about the first condition
    folder: Path  # of the aircraft

    @property
    def place(self) -> str:
        """The first condition in words."""
        point = self.identified.conditions[0]
        return f"{self.identified.aircraft} at {point.V_a:g} m/s, {point.gamma / DEG:g} deg"

    def save(self, path: str | Path | None = None) -> dict[str, Path | None]:
        """Write model and figure, by default into the aircraft's folder unless it is shipped."""
        shipped = Path("runs") / "identified" / f"{self.folder.name}.json"
        path = path or (shipped if is_shipped(self.folder) else self.folder / model_file.FILE_NAME)
        figure = identification_figure(self.conditions[0], self.place)
        return model_file.save_with_figure(self.identified, Path(path), figure)

    def answer(self) -> Answer:
        """Lags with their fits, and modes; a failure where a lag explains too little."""
        conditions = model_file.identified_tables(self.identified)["conditions"]
        poor = [
            f"{channel} at {point.V_a:g} m/s, {point.gamma / DEG:g} deg: {fitted.fit_percent:.1f} %"
            for point in self.identified.conditions
            for channel, fitted in point.channels.items()
            if fitted.fit_percent < GOOD_FIT
        ]
        less = f"a lag explains less than {GOOD_FIT:g} % of {'; '.join(poor)}"
        title = f"{self.place}: airframe without the inner loop"
        airframe = Table(MODE_COLUMNS, self.modes, title, name="modes")
        values = {"aircraft": self.identified.aircraft, "channels": conditions[0]["channels"]}
        return Answer(
            values={**values, "conditions": conditions, "skipped": self.skipped},
            tables=[model_file.lags_table(self.identified), airframe],
            notes=[FIT_NOTE, *(f"left out: {reason}" for reason in self.skipped)],
            failure=f"{self.identified.aircraft}: {less}" if poor else "",
        )


def design_speed(config: AircraftConfig) -> float:
    """Airspeed (m/s) the inner loop was designed for; mid-envelope where it does not say."""
    low, high = config.envelope.V_a
    speed = config.gains.gains.get(DESIGN_SPEED, 0.0) if config.gains else 0.0
    return speed if low < speed < high else 0.5 * (low + high)


def identify_aircraft(
    aircraft: str | Path,
    *,
    V_a: Sequence[float] = (),
    gamma: Sequence[float] = (),
    h: float = 1000.0,
    seed: int = 0,
) -> AircraftIdentification:
    """Identify the inner loop of an aircraft at each airspeed (m/s) with each path angle (rad)."""
    plant = JSBSimPlant(aircraft)
    fresh, measured, skipped = partial(JSBSimPlant, aircraft), [], []
    # Conditions without steady flight are left out and listed. The lags of a channel are of one
    # order, the one that suits all conditions together.
    for v, g in product(tuple(V_a) or (design_speed(plant.config),), tuple(gamma) or (None,)):
        try:
            point = level(plant.config, v, h) if g is None else FlightCondition(V_a=v, gamma=g, h=h)
            flights = identify_plant(fresh, point, plant.limits, seed=seed)
            if plant.config.limits.n_x is not None:
                n_x = identify_thrust(fresh, point, seed=seed)
                flights = replace(flights, channels={**flights.channels, "n_x": n_x})
            measured.append(flights)
        except TrimError as error:
            skipped.append(str(error))
    if not measured:
        raise TrimError(skipped[0])
    identifications = _of_one_order(measured)
    A, _ = linearize(plant.config, measured[0].trim)
    return AircraftIdentification(
        identified=model_file.IdentifiedAircraft.model_construct(
            aircraft=plant.config.folder.name,
            conditions=tuple(point.condition for point in identifications),
            seed=seed,
            gains=plant.config.gains.sha256 if plant.config.gains else "",
        ),
        conditions=identifications,
        skipped=tuple(skipped),
        modes=modes(A),
        folder=plant.config.folder,
    )
