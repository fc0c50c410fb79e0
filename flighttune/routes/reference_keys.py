"""``[reference]`` of a scenario: course, path angle and airspeed over time."""

from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, model_validator

from flighttune.base import quantities as q
from flighttune.base.units import DEG
from flighttune.routes.segments import Reference, Segment
from flighttune.vehicles.flight_keys import FlightTable


class StepTable(q.Table):
    """A jump of a reference."""

    shape: Literal["step"]
    start_s: q.Instant = 0.0  # before the end of the flight, as for every segment
    change_deg: q.Course

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return Segment(self.start_s, (0.0,), jumps=(self.change_deg * DEG,))


class RampTable(q.Table):
    """A steady change of a reference, kept afterwards."""

    shape: Literal["ramp"]
    start_s: q.Instant = 0.0
    duration_s: q.Duration
    rate_dps: q.AngularRate
    roll_in_s: q.Instant = 0.0  # time over which the rate rises, and falls: the ramp is planned

    @model_validator(mode="after")
    def _roll_in_fits(self) -> "RampTable":
        most = min(self.duration_s, 2.0 * self.start_s)
        if self.roll_in_s > most:
            raise ValueError(
                f"`roll_in_s` must be at most {most:g} s, which is `duration_s` or twice `start_s` "
                f"(half of it lies before the ramp), got {self.roll_in_s:g} s"
            )
        return self

    def segment(self) -> Segment:
        """The segment in s and rad."""
        breaks, rate = (0.0, self.duration_s), self.rate_dps * DEG
        return Segment(self.start_s, breaks, rates=(rate,), roll_in=self.roll_in_s)


class DoubletTable(q.Table):
    """A pulse up and its opposite, each `width_s` long."""

    shape: Literal["doublet"]
    start_s: q.Instant = 0.0
    width_s: q.Duration  # of each half
    amplitude_deg: q.Course

    def segment(self) -> Segment:
        """The segment in s and rad."""
        width, amplitude = self.width_s, self.amplitude_deg * DEG
        jumps = (amplitude, -2.0 * amplitude, amplitude)
        return Segment(self.start_s, (0.0, width, 2.0 * width), jumps=jumps)


SegmentTable: TypeAlias = Annotated[
    StepTable | RampTable | DoubletTable, Field(discriminator="shape")
]


class AirspeedStepTable(q.Table):
    """A jump of the airspeed's reference."""

    shape: Literal["step"]
    start_s: q.Instant = 0.0
    change_mps: q.Finite

    def segment(self) -> Segment:
        """The segment in s and m/s."""
        return Segment(self.start_s, (0.0,), jumps=(self.change_mps,))


class AirspeedRampTable(q.Table):
    """A steady change of the airspeed's reference, kept afterwards."""

    shape: Literal["ramp"]
    start_s: q.Instant = 0.0
    duration_s: q.Duration
    rate_mps2: q.Finite

    def segment(self) -> Segment:
        """The segment in s and m/s."""
        return Segment(self.start_s, (0.0, self.duration_s), rates=(self.rate_mps2,))


class AirspeedDoubletTable(q.Table):
    """A pulse up and its opposite, each `width_s` long."""

    shape: Literal["doublet"]
    start_s: q.Instant = 0.0
    width_s: q.Duration
    amplitude_mps: q.Finite

    def segment(self) -> Segment:
        """The segment in s and m/s."""
        width, size = self.width_s, self.amplitude_mps
        return Segment(self.start_s, (0.0, width, 2.0 * width), jumps=(size, -2.0 * size, size))


AirspeedSegment: TypeAlias = Annotated[
    AirspeedStepTable | AirspeedRampTable | AirspeedDoubletTable, Field(discriminator="shape")
]


# Key of the start of the reference, by channel
FROM = {"chi": "chi_from_deg", "gamma": "gamma_from_deg"}


class ReferenceTable(q.Table):
    """``[reference]``: a constant per channel, or segments added to the value of ``[flight]``."""

    chi_deg: q.Course | list[SegmentTable]
    gamma_deg: q.Inclination | list[SegmentTable]
    # Airspeed that the law holds by n_x; if left out, every plant holds the airspeed of [flight]
    V_mps: q.Airspeed | list[AirspeedSegment] | None = None
    # feasible: the fastest change to the constants that the aircraft can fly
    shape: Literal["feasible"] | None = None
    # Share of limits and rates reserved for the feedback; 0.2 if left out
    margin: Annotated[float, Field(ge=0.0, le=0.9)] | None = None
    # Start of the segments or of the feasible change; that of the flight if left out
    chi_from_deg: q.Course | None = None
    # Start of the segments or of the feasible change; that of the flight if left out
    gamma_from_deg: q.Inclination | None = None

    @model_validator(mode="after")
    def _of_one_shape(self) -> "ReferenceTable":
        if self.shape is None and self.margin is not None:
            raise ValueError("`margin` of [reference] must be given with shape feasible only")
        for channel, key in FROM.items():
            if getattr(self, key) is not None and not self._changes(channel):
                raise ValueError(
                    f"`{key}` of [reference] must be absent where `{channel}_deg` is one number "
                    "for the whole flight"
                )
        for key in ("chi_deg", "gamma_deg"):
            if self.shape is not None and isinstance(getattr(self, key), list):
                raise ValueError(f"`{key}` of [reference] must be a number with shape feasible")
        if self.shape is not None and self.V_mps is not None:
            raise ValueError("`V_mps` of [reference] must be absent with shape feasible")
        return self

    def _changes(self, channel: str) -> bool:
        """Whether the reference of a channel changes from a start."""
        return self.shape is not None or isinstance(getattr(self, f"{channel}_deg"), list)

    def begins(self, flight: FlightTable) -> tuple[float, float]:
        """Course and path angle (deg) from which the reference changes."""
        chi, gamma = self.chi_from_deg, self.gamma_from_deg
        return (
            flight.chi_deg if chi is None else chi,
            flight.gamma_deg if gamma is None else gamma,
        )

    def beginning(self, flight: FlightTable) -> "ReferenceTable":
        """The reference of this flight, which flights from other starts then share."""
        begins = zip(FROM.items(), self.begins(flight), strict=True)
        stated = {key: at for (channel, key), at in begins if self._changes(channel)}
        return self.model_copy(update=stated)

    @property
    def segments(self) -> list[tuple[str, SegmentTable | AirspeedSegment]]:
        """Key and table of each segment."""
        values = [(key, getattr(self, key)) for key in ("chi_deg", "gamma_deg", "V_mps")]
        return [(key, x) for key, value in values if isinstance(value, list) for x in value]

    @property
    def ramps_in(self) -> list[tuple[str, RampTable]]:
        """Key and table of each ramp that rolls in."""
        return [(key, x) for key, x in self.segments if isinstance(x, RampTable) and x.roll_in_s]

    @property
    def batched(self) -> bool:
        """Whether the compiled kernel flies it: no search, no plan, no airspeed."""
        return self.shape is None and self.V_mps is None and not self.ramps_in

    def steepest(self, flight: FlightTable) -> tuple[float, float]:
        """Time (s) and value (deg) of the steepest commanded path angle, up or down."""
        if not isinstance(self.gamma_deg, list):
            return 0.0, self.gamma_deg
        duration = flight.duration_s
        inside = {t for table in self.gamma_deg for t in table.segment().times if t < duration}
        ends = np.array(sorted({0.0, duration, *inside}))
        # Between two breaks the sum is straight; it may jump at a break, or just beside it.
        before, between = np.nextafter(ends[1:], 0.0), 0.5 * (ends[1:] + ends[:-1])
        t = np.concatenate([ends, before, between])
        _, gamma = self.reference(flight).sampled(t)
        most = int(np.argmax(np.abs(gamma)))
        return float(t[most]), float(gamma[most]) / DEG

    def airspeeds(self, flight: FlightTable) -> tuple[float, float]:
        """Lowest and highest commanded airspeed of a flight, m/s."""
        reference, duration = self.reference(flight), flight.duration_s
        ends = [t for s in reference.V_segments for t in s.times if t < duration]
        values = reference.airspeed(np.array([0.0, duration, *ends]))
        assert values is not None  # this reference has an airspeed
        return float(values[0].min()), float(values[0].max())

    def reference(self, flight: FlightTable) -> Reference:
        """The reference in s, rad and m/s, from the start of a flight on."""
        stated: tuple[Any, ...] = self.chi_deg, self.gamma_deg, self.V_mps
        starts = *self.begins(flight), flight.V_a_mps
        (chi, on_chi), (gamma, on_gamma), (V, on_V) = (
            (start, tuple(x.segment() for x in own)) if isinstance(own, list) else (own, ())
            for own, start in zip(stated, starts, strict=True)
        )
        return Reference(
            chi=chi * DEG,
            gamma=gamma * DEG,
            chi_segments=on_chi,
            gamma_segments=on_gamma,
            g=flight.g_mps2,
            V=V,
            V_segments=on_V,
        )
