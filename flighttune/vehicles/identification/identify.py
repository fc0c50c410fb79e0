"""Identification of an inner loop at one or several conditions, and its figure."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

from flighttune.base.answering import Drawn
from flighttune.base.errors import TrimError
from flighttune.base.files.shipped import is_shipped
from flighttune.base.units import DEG
from flighttune.control.inner_loop import Order
from flighttune.vehicles.aircraft.aircraft import AircraftConfig
from flighttune.vehicles.identification import file as model_file
from flighttune.vehicles.identification.fit import (
    ChannelIdentification,
    Identification,
    identify_plant,
    identify_thrust,
)
from flighttune.vehicles.plants.base import FlightCondition
from flighttune.vehicles.plants.jsbsim.linearize import linearize, modes
from flighttune.vehicles.plants.jsbsim.plant import JSBSimPlant
from flighttune.vehicles.plants.jsbsim.trim import level

# Required explained share of the variance by the lags of a channel, percent.
GOOD_FIT = 90.0

# Inner-loop gain that stores the design airspeed.
DESIGN_SPEED = "V_a-design-mps"


def _of_one_order(identifications: Sequence[Identification]) -> tuple[Identification, ...]:
    """The identifications with one order of lag per channel, the best over all conditions."""
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
class AircraftIdentification(Drawn):
    """Identification of an aircraft, and of its airframe without inner loop."""

    identified: model_file.IdentifiedAircraft  # content of a model file
    conditions: tuple[Identification, ...]  # the flights, condition by condition
    skipped: tuple[str, ...]  # reasons for missing conditions, one sentence each
    modes: Sequence[Mapping[str, Any]]  # modes of the airframe alone about the first condition
    folder: Path  # folder of the aircraft

    @property
    def place(self) -> str:
        """The first condition in words."""
        point = self.identified.conditions[0]
        return f"{self.identified.aircraft} at {point.V_a:g} m/s, {point.gamma / DEG:g} deg"

    def save(self, path: str | Path | None = None) -> dict[str, Path | None]:
        """Write model and figure, by default into the aircraft's folder unless it is shipped."""
        shipped = Path("runs") / "identified" / f"{self.folder.name}.json"
        path = path or (shipped if is_shipped(self.folder) else self.folder / model_file.FILE_NAME)
        return model_file.save_with_figure(self.identified, Path(path), self)


def design_speed(config: AircraftConfig) -> float:
    """Design airspeed (m/s) of the inner loop; mid-envelope if unknown."""
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
    # Conditions without steady flight are left out and listed. The lags of a channel have one
    # order, which fits all conditions best together.
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
