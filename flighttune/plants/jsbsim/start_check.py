"""Check of a start: inside envelope and command limits, above the ground."""

from collections.abc import Iterator

from flighttune.aircraft.aircraft import AircraftConfig
from flighttune.plants.base import FlightCondition
from flighttune.units import DEG


def start_faults(
    config: AircraftConfig, condition: FlightCondition, ground: float
) -> Iterator[tuple[str, str]]:
    """Attributes of a condition outside the aircraft's envelope or limits, with the reason.

    `ground` (m): height of the ground above sea level. A reason has no full stop.
    """
    if not condition.h > ground:
        yield "h", f"must be above the ground at {ground:g} m, got {condition.h:g} m"
    watched = (
        ("V_a", condition.V_a, config.envelope.V_a, 1.0, " m/s"),
        ("phi", condition.phi, config.limits.phi, DEG, " deg"),
        ("n_z", condition.n_z_start, config.limits.n_z, 1.0, ""),
    )
    for name, value, (low, high), unit, symbol in watched:
        if not low <= value <= high:
            yield (
                name,
                f"must lie in {low / unit:g} to {high / unit:g}{symbol} ({config.file}), "
                f"got {value / unit:g}{symbol}",
            )
