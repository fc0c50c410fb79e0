"""``[disturbance]`` of a scenario."""

from itertools import pairwise
from typing import Literal

from pydantic import model_validator

from flighttune.base import quantities as q
from flighttune.flight.loop.disturbance import Sinusoid


class DisturbanceTable(q.Table):
    """``[disturbance]``: the paper's sinusoid on the rates of the kinematic law."""

    chi_amplitude: q.OscillationRate = 0.0  # rad/s, as that of gamma
    chi_omega_rad_s: q.Oscillation = 0.0
    gamma_amplitude: q.OscillationRate = 0.0
    gamma_omega_rad_s: q.Oscillation = 0.0
    # square: switches between the amplitudes where the sinusoid changes its sign
    wave: Literal["square"] | None = None
    chi_phase_deg: q.Angle | None = None
    gamma_phase_deg: q.Angle | None = None
    as_wind: bool = False  # true: JSBSim plants fly in the oscillating wind that is equivalent
    # air: chi and gamma of JSBSim plants are those of the path through the air
    path: Literal["ground", "air"] = "ground"
    # Rising times at which a constant amplitude changes its sign
    chi_switch_s: list[q.Instant] | None = None
    # Rising times at which a constant amplitude changes its sign
    gamma_switch_s: list[q.Instant] | None = None

    @model_validator(mode="after")
    def _switches_alone(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma"):
            name = f"{channel}_switch_s"
            if (times := getattr(self, name)) is None:
                continue
            keys = "wave", "as_wind", f"{channel}_omega_rad_s", f"{channel}_phase_deg"
            self.must_lack(f"with {name}: the amplitude is constant", *keys)
            for before, after in pairwise([0.0, *times]):
                if not after > before:
                    raise ValueError(
                        f"`{name}` must be positive and rise, got {after:g} s after {before:g} s"
                    )
        return self

    @model_validator(mode="after")
    def _wind_swings(self) -> "DisturbanceTable":
        for channel in ("chi", "gamma") if self.as_wind else ():
            still = not getattr(self, f"{channel}_omega_rad_s")
            if still and getattr(self, f"{channel}_amplitude"):
                raise ValueError(
                    f"`{channel}_omega_rad_s` must be positive with as_wind: a constant rate takes "
                    "a wind that grows without end"
                )
        if self.as_wind:
            phases = "chi_phase_deg", "gamma_phase_deg"
            self.must_lack("with as_wind: the wind is that of a sine", "wave", *phases)
        if self.path == "air" and not self.as_wind:
            raise ValueError('`path` must be "ground" without as_wind, got "air"')
        return self

    def sinusoid(self) -> Sinusoid:
        """The disturbance as a function of time."""
        return Sinusoid.of_table(self.model_dump())

    def last_switches(self) -> list[tuple[str, float]]:
        """Key and last time (s) of each list of switching times."""
        times = {key: getattr(self, key) for key in ("chi_switch_s", "gamma_switch_s")}
        return [(f"[disturbance] `{key}`", each[-1]) for key, each in times.items() if each]
