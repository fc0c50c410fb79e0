"""Identified aircraft as JSON files: units in the keys, written whole or not at all."""

import json
import math
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from flighttune.aircraft.aircraft import GAINS_FILE, load_aircraft
from flighttune.control.inner_loop import InnerLag
from flighttune.errors import ScenarioError
from flighttune.identify.model import (
    IdentifiedAircraft,
    IdentifiedChannel,
    IdentifiedCondition,
    design_model,
)
from flighttune.mistakes import abridged, first_mistake, shown
from flighttune.quantities import (
    Airspeed,
    Bandwidth,
    Damping,
    Delay,
    Finite,
    Height,
    Inclination,
    TimeConstant,
)
from flighttune.shipped import aircraft_folder
from flighttune.table_file import json_tables, stamp
from flighttune.units import DEG, G_0
from flighttune.whole_file import write_text

# Readers refuse what they do not know.
FORMAT = "flighttune identified aircraft 1"

FILE_NAME = "identified.json"

# Significant digits written: more than a flight gives, fewer than two machines differ in.
DIGITS = 6

# Share by which a number may differ from the one that the rounded lags give.
ROUNDING = 1e-4

UNITS = {
    "cross": "largest answer of the other channel to this command: 1/rad (phi), rad (n_z)",
    "model": "states, inputs and errors in rad, n_z in 1, time in s; g 9.80665 m/s^2",
}


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", strict=True)


class _Lag(_Table):
    order: Literal[1, 2, 3]
    natural_frequency_rad_s: Bandwidth
    damping: Damping | None
    lag_s: TimeConstant | None
    delay_s: Delay

    def value(self) -> InnerLag:
        """The lag; what its order does not have keeps the default."""
        return InnerLag(
            order=self.order,
            natural_frequency=self.natural_frequency_rad_s,
            damping=self.damping or 1.0,
            lag=self.lag_s or 1.0,
            delay=self.delay_s,
        )


class _Channel(_Lag):
    fit_percent: Finite
    residual: Finite
    cross: Finite
    simpler: _Lag

    def channel(self) -> IdentifiedChannel:
        """The channel as a value."""
        return IdentifiedChannel(
            lag=self.value(),
            fit_percent=self.fit_percent,
            residual=self.residual,
            cross=self.cross,
            simpler=self.simpler.value(),
        )


class _Channels(_Table):
    phi: _Channel
    n_z: _Channel


class _Condition(_Table):
    V_a_mps: Airspeed
    gamma_deg: Inclination
    h_m: Height
    channels: _Channels

    def condition(self) -> IdentifiedCondition:
        """The condition as a value."""
        return IdentifiedCondition(
            V_a=self.V_a_mps,
            gamma=self.gamma_deg * DEG,
            h=self.h_m,
            phi=self.channels.phi.channel(),
            n_z=self.channels.n_z.channel(),
        )


class _File(_Table):
    format: Literal["flighttune identified aircraft 1"]
    aircraft: str
    seed: int
    gains_sha256: str = ""
    conditions: Annotated[list[_Condition], Field(min_length=1)]


def identified_tables(aircraft: IdentifiedAircraft) -> dict[str, Any]:
    """An identified aircraft as the object of its file."""
    return {
        "format": FORMAT,
        "aircraft": aircraft.aircraft,
        "seed": aircraft.seed,
        **({"gains_sha256": aircraft.gains} if aircraft.gains else {}),
        "units": UNITS,
        "conditions": [_condition_table(condition) for condition in aircraft.conditions],
    }


def save_identified(aircraft: IdentifiedAircraft, path: str | Path) -> None:
    """Write an identified aircraft as JSON, under a temporary name until it is whole.

    Parameters
    ----------
    aircraft : IdentifiedAircraft
    path : str or Path
        Its folder is made if missing.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    text = json.dumps(identified_tables(aircraft), indent=2, allow_nan=False) + "\n"
    write_text(Path(path), text)


def load_identified(source: str | Path) -> IdentifiedAircraft:
    """Read an identified aircraft.

    Parameters
    ----------
    source : str or Path
        A JSON file as `save_identified` writes it, the folder of an aircraft that holds one named
        ``identified.json``, or the name of a shipped aircraft.

    Raises
    ------
    InputError
        If there is no such aircraft.
    ScenarioError
        If the file cannot be read or does not hold an identified aircraft; the message names file
        and key.
    """
    path = Path(source)
    if path.name == str(source) and path.suffix != ".json":
        path = aircraft_folder(str(source))
    if path.is_dir():
        path = path / FILE_NAME
    if not path.exists():
        raise ScenarioError(f"{path}: must be there; `flighttune identify` writes one.")
    aircraft = _read(path, stamp(path))
    _check_gains(aircraft, path)
    return aircraft


@lru_cache(maxsize=32)  # every flight behind a reference of shape feasible asks for its lags
def _read(path: Path, _stamp: tuple[int, ...]) -> IdentifiedAircraft:
    """The identified aircraft of a file, read anew when it was written to."""
    tables = json_tables(path)
    try:
        file = _File.model_validate(tables)
    except ValidationError as error:
        raise ScenarioError(f"{path}: {first_mistake(error)}") from error
    aircraft = IdentifiedAircraft(
        aircraft=file.aircraft,
        conditions=tuple(condition.condition() for condition in file.conditions),
        seed=file.seed,
        gains=file.gains_sha256,
    )
    for fault in _contradictions(tables, identified_tables(aircraft)):
        raise ScenarioError(f"{path}: {fault}.")
    return aircraft


def _check_gains(aircraft: IdentifiedAircraft, path: Path) -> None:
    """Refuse a model that was measured with other gains than those of the aircraft beside it."""
    if not (aircraft.gains and (path.parent / "aircraft.toml").is_file()):
        return
    gains = load_aircraft(path.parent).gains
    if gains is None or gains.sha256 != aircraft.gains:
        raise ScenarioError(
            f"{path}: must be identified with the gains in {GAINS_FILE}, got others; "
            "`flighttune identify` measures it anew."
        )


def _contradictions(stated: Any, derived: Any, key: str = "") -> Iterator[str]:
    """Entries of a file that contradict its lags: its matrices are for other programs."""
    if isinstance(stated, dict) and isinstance(derived, dict):
        for name, value in stated.items():
            inside = f"{key}.{name}".removeprefix(".")
            if name in derived:
                yield from _contradictions(value, derived[name], inside)
            else:
                yield f"`{shown(inside)}` is not a known key; known are {', '.join(derived)}"
    elif isinstance(stated, list) and isinstance(derived, list) and len(stated) == len(derived):
        for i, (entry, other) in enumerate(zip(stated, derived, strict=True)):
            yield from _contradictions(entry, other, f"{key}[{i}]")
    elif not _same(stated, derived):
        got = abridged(stated)
        yield f"`{key}` must be {abridged(derived)}, as the lags of the file make it, got {got}"


def _same(stated: Any, derived: Any) -> bool:
    if isinstance(stated, float | int) and isinstance(derived, float):
        return math.isclose(stated, derived, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return stated == derived


def lag_table(lag: InnerLag) -> dict[str, Any]:
    """A lag as plain values; None for a parameter that its order does not have."""
    return {**_parameters(lag), "bandwidth_rad_s": lag.bandwidth}


def _parameters(lag: InnerLag) -> dict[str, Any]:
    return {
        "order": lag.order,
        "natural_frequency_rad_s": lag.natural_frequency,
        "damping": lag.damping if lag.order > 1 else None,
        "lag_s": lag.lag if lag.order > 2 else None,
        "delay_s": lag.delay,
    }


def _condition_table(condition: IdentifiedCondition) -> dict[str, Any]:
    model = design_model(condition, g=G_0).model
    rounded = {
        "gamma_deg": condition.gamma / DEG,
        "channels": {name: _channel_table(getattr(condition, name)) for name in ("phi", "n_z")},
        "model": {
            "states": model.states,
            "inputs": [f"{name}_cmd" for name in model.inputs],
            "errors": model.errors,
            **{name: getattr(model, name).tolist() for name in ("A", "B", "C")},
        },
    }
    return {"V_a_mps": condition.V_a, "h_m": condition.h, **_rounded(rounded)}


def _channel_table(channel: IdentifiedChannel) -> dict[str, Any]:
    numbers = {name: getattr(channel, name) for name in ("fit_percent", "residual", "cross")}
    return {**lag_table(channel.lag), **numbers, "simpler": _parameters(channel.simpler)}


def _rounded(value: Any) -> Any:
    """Nested values with every number rounded to `DIGITS`."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
