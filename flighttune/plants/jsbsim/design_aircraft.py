"""A new inner loop for an aircraft: derivatives, gains, flown steps, and the file they go into."""

import re
from dataclasses import dataclass
from pathlib import Path

from flighttune.errors import InputError
from flighttune.plants.base import FlightCondition
from flighttune.plants.jsbsim.aircraft import AircraftConfig
from flighttune.plants.jsbsim.airframe import airframe
from flighttune.plants.jsbsim.design import inner_loop_gains
from flighttune.plants.jsbsim.fdm import Fdm
from flighttune.plants.jsbsim.steps import StepCheck, check_steps
from flighttune.whole_file import whole_file

FDM_RATE_HZ = 200.0
NO_GAIN = 1e-9

DIGITS = 4
"""Significant digits of the gains in the file; these are the ones flown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignedAircraft:
    """What a design came to.

    Attributes
    ----------
    config : AircraftConfig
        The aircraft with its new gains.
    previous : mapping of str to float
        Gains it had before.
    checks : tuple of StepCheck
        Its steps against what was asked for.
    """

    config: AircraftConfig
    previous: dict[str, float]
    checks: tuple[StepCheck, ...]

    @property
    def missed(self) -> tuple[StepCheck, ...]:
        """Steps that are slower, or overshoot more, than asked."""
        return tuple(check for check in self.checks if not check.met)


def design_aircraft(config: AircraftConfig) -> DesignedAircraft:
    """Make gains for the inner loop of an aircraft and fly its steps with them.

    Parameters
    ----------
    config : AircraftConfig
        With a ``[design]`` table. The gains it has do not matter: the same file gives the same
        design.

    Raises
    ------
    InputError
        If there is no such table.
    PlantError
        If the aircraft cannot be built, or its surfaces do not act as the inner loop needs.
    TrimError
        If there is no steady level flight at one of its airspeeds.
    """
    design = config.design
    if design is None:
        raise InputError(f"{config.file}: `design` must be given: what to make the gains for.")
    found = airframe(Fdm(config, FDM_RATE_HZ), FlightCondition(V_a=design.V_a, h=design.h))
    gains = {
        name: float(f"{value:.{DIGITS}g}") if abs(value) > NO_GAIN else 0.0
        for name, value in inner_loop_gains(found, design).items()
    }
    designed = config.model_copy(update={"gains": gains})
    return DesignedAircraft(
        config=designed, previous=dict(config.gains), checks=check_steps(designed)
    )


def write_gains(file: Path, gains: dict[str, float]) -> None:
    """Put `gains` into an ``aircraft.toml``; everything else in it, comments too, stays.

    The file is written under a temporary name until it is whole.

    Raises
    ------
    InputError
        If the file cannot be written, or has no line for one of the gains.
    """
    text = file.read_text(encoding="utf-8")
    for name, value in gains.items():
        line = re.compile(rf'(?m)^("{re.escape(name)}"\s*=\s*)[-+.\deE]+')
        text, count = line.subn(rf"\g<1>{value!r}", text)
        if count != 1:
            raise InputError(f"{file}: [gains] must have one line `{name}`, got {count}.")
    with whole_file(file) as part:
        part.write_text(text, encoding="utf-8")
