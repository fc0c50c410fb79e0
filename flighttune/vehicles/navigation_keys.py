"""``[navigation]`` and ``[sensors]`` of a scenario."""

from typing import Annotated, Any, TypeAlias

from pydantic import Field

from flighttune.base import quantities as q
from flighttune.base.units import DEG
from flighttune.vehicles.plants.navigation import Grade, Navigation, ReceiverFault
from flighttune.vehicles.plants.sensors import Sensors

Distance: TypeAlias = Annotated[q.NotNegative, Field(le=1000.0)]  # m: standard deviation
Assumed: TypeAlias = Annotated[q.Finite, Field(ge=1e-4, le=1000.0)]  # noise that a filter assumes
Share: TypeAlias = Annotated[q.NotNegative, Field(le=1.0)]
Density: TypeAlias = Annotated[q.NotNegative, Field(le=100.0)]  # of noise, per root Hz
Period: TypeAlias = Annotated[q.Finite, Field(ge=0.01, le=10.0)]  # s
Lag: TypeAlias = Annotated[q.NotNegative, Field(le=1e4)]  # s


class ReceiverFaultTable(q.Table):
    """``[navigation.fault]``: a failure of the receiver in flight, lasting to the end."""

    from_s: q.Instant
    course_deg: q.Angle = 0.0  # direction of the error
    jump_m: Annotated[q.NotNegative, Field(le=1e5)] = 0.0  # error of position at once
    drift_mps: q.WindSpeed = 0.0  # growth of the error: dead reckoning without a receiver


class NavigationTable(q.Table):
    """``[navigation]``: how well the autopilot knows its motion, by a grade and its numbers."""

    grade: Grade = "standard"  # gives every number that is left out below
    position_sd_m: Distance | None = None  # slow error of the receiver, per horizontal axis
    position_time_constant_s: q.TimeConstant | None = None  # of the slow error
    position_fast_sd_m: Distance | None = None  # faster error of the receiver
    position_fast_time_constant_s: q.TimeConstant | None = None  # of the faster error
    position_noise_m: Distance | None = None  # of each fix
    velocity_noise_mps: q.WindSpeed | None = None  # of each fix
    velocity_sd_mps: q.WindSpeed | None = None  # slow error of the receiver's velocity
    velocity_time_constant_s: q.TimeConstant | None = None  # of the slow error of velocity
    height_sd_m: Distance | None = None  # slow error of the barometer
    height_time_constant_s: q.TimeConstant | None = None  # of the slow error of height
    height_noise_m: Distance | None = None  # of the barometer
    height_of_q: Share | None = None  # part of the dynamic pressure that the static port sees
    climb_noise_mps: q.WindSpeed | None = None  # of each fix; its slow error is half
    climb_time_constant_s: q.TimeConstant | None = None  # of the slow error of climb
    period_s: Period | None = None  # from one fix to the next
    accelerometer_noise: Density | None = None  # m/s^2 per root Hz
    gyro_noise: Density | None = None  # deg/s per root Hz
    gyro_walk: Density | None = None  # of the bias, deg/s^2 per root Hz
    roll_bias_sd_deg: q.AngularSpread | None = None  # from installation and accelerometer bias
    roll_noise_deg: q.AngularSpread | None = None  # of the filter's roll, time constant 0.05 s
    n_z_bias_sd: Share | None = None  # also of the acceleration along the path, g
    n_z_noise: Share | None = None  # of load factor and acceleration, at each sample
    airspeed_scale_sd: Share | None = None  # scale error, relative to the airspeed at the start
    airspeed_sd_mps: q.WindSpeed | None = None  # slow error of the airspeed
    airspeed_time_constant_s: q.TimeConstant | None = None  # of the slow error of airspeed
    airspeed_noise_mps: q.WindSpeed | None = None  # of the airspeed, time constant 0.1 s
    wind_sd_mps: q.WindSpeed | None = None  # error of the estimated wind, per horizontal axis
    wind_time_constant_s: q.TimeConstant | None = None  # of the error of wind
    wind_lag_s: Lag | None = None  # of the estimate behind the wind
    filter_position_m: Assumed | None = None  # noise of position that the filter assumes
    filter_velocity_mps: Assumed | None = None  # noise of velocity that the filter assumes
    filter_height_m: Assumed | None = None  # noise of height that the filter assumes
    filter_climb_mps: Assumed | None = None  # noise of climb that the filter assumes
    inner_loop: bool | None = None  # whether gyros and accelerometers of the inner loop err too
    fault: ReceiverFaultTable | None = None

    @property
    def own_numbers(self) -> dict[str, Any]:
        """The numbers that replace those of the grade."""
        return self.model_dump(exclude_none=True, exclude={"grade", "fault", "inner_loop"})

    def navigation(self, seed: int) -> Navigation:
        """The errors in SI, drawn from the scenario's `seed`."""
        stated = self.own_numbers
        numbers = {_name(key): value * _unit(key) for key, value in stated.items()}
        drawn = {"seed": seed, "fault": self._fault, "inner_loop": bool(self.inner_loop)}
        return Navigation.of(self.grade, **drawn, **numbers)

    @property
    def _fault(self) -> ReceiverFault | None:
        """The failure of the receiver in SI."""
        if (fault := self.fault) is None:
            return None
        return ReceiverFault(
            start=fault.from_s,
            course=fault.course_deg * DEG,
            jump=fault.jump_m,
            drift=fault.drift_mps,
        )


class SensorsTable(q.Table):
    """``[sensors]``: errors of course, flight-path angle and airspeed, measured minus true."""

    chi_bias_deg: q.Angle = 0.0
    chi_noise_sd_deg: q.AngularSpread = 0.0  # standard deviation, drawn from the seed
    gamma_bias_deg: q.Angle = 0.0
    gamma_noise_sd_deg: q.AngularSpread = 0.0  # standard deviation, drawn from the seed
    V_a_bias_mps: q.Wind = 0.0
    V_a_noise_sd_mps: q.WindSpeed = 0.0  # standard deviation, drawn from the seed
    noise_time_constant_s: q.TimeConstant | None = None  # of all noise; white if left out

    def sensors(self, seed: int) -> Sensors:
        """The errors in rad and m/s, with noise from the scenario's `seed`."""
        bias = self.chi_bias_deg * DEG, self.gamma_bias_deg * DEG, self.V_a_bias_mps
        sd = self.chi_noise_sd_deg * DEG, self.gamma_noise_sd_deg * DEG, self.V_a_noise_sd_mps
        time_constant = self.noise_time_constant_s or 0.0
        return Sensors(bias=bias, noise_sd=sd, time_constant=time_constant, seed=seed)


def _name(key: str) -> str:
    """The attribute of `Navigation` for a key."""
    for unit in ("_m", "_mps", "_s", "_deg"):
        key = key.removesuffix(unit)
    return key


def _unit(key: str) -> float:
    """Factor from the unit of a key to SI."""
    return DEG if key.endswith("_deg") or key.startswith("gyro_") else 1.0
