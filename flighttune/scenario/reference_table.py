"""``[reference]``: what the outer loop is asked to follow."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field

from flighttune.scenario.table import Finite, Inclination, NotNegative, Positive, Table
from flighttune.simulate.reference import Doublet, Ramp, Reference, Segment, Step
from flighttune.units import DEG


class StepTable(Table):
    """A jump of a reference."""

    shape: Literal["step"]
    start_s: NotNegative = 0.0
    change_deg: Finite

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return Step(start=self.start_s, change=self.change_deg * DEG)


class RampTable(Table):
    """A steady change of a reference, kept afterwards."""

    shape: Literal["ramp"]
    start_s: NotNegative = 0.0
    duration_s: Positive
    rate_dps: Finite

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return Ramp(start=self.start_s, duration=self.duration_s, rate=self.rate_dps * DEG)


class DoubletTable(Table):
    """A pulse up and its opposite, each `width_s` long."""

    shape: Literal["doublet"]
    start_s: NotNegative = 0.0
    width_s: Positive
    amplitude_deg: Finite

    def segment(self) -> Segment:
        """The segment in s and rad."""
        return Doublet(start=self.start_s, width=self.width_s, amplitude=self.amplitude_deg * DEG)


SegmentTable: TypeAlias = Annotated[
    StepTable | RampTable | DoubletTable, Field(discriminator="shape")
]


class ReferenceTable(Table):
    """``[reference]``: a constant a channel, or segments that add to the value of ``[flight]``."""

    chi_deg: Finite | list[SegmentTable]
    gamma_deg: Inclination | list[SegmentTable]

    def check_starts(self, duration_s: float) -> None:
        """Refuse segments that would begin when a flight of `duration_s` is over.

        Raises
        ------
        ValueError
            If there is one; the message names table and key.
        """
        for key, segments in (("chi_deg", self.chi_deg), ("gamma_deg", self.gamma_deg)):
            for segment in segments if isinstance(segments, list) else ():
                if segment.start_s >= duration_s:
                    raise ValueError(
                        f"[reference.{key}] `start_s` must lie before the end of the flight "
                        f"(`duration_s` of [flight], {duration_s:g} s), got {segment.start_s:g} s"
                    )

    def reference(self, *, chi_deg: float, gamma_deg: float) -> Reference:
        """The reference in s and rad, for a flight that starts at `chi_deg` and `gamma_deg`."""
        chi, chi_segments = _channel(self.chi_deg, chi_deg)
        gamma, gamma_segments = _channel(self.gamma_deg, gamma_deg)
        return Reference(
            chi=chi, gamma=gamma, chi_segments=chi_segments, gamma_segments=gamma_segments
        )


def _channel(
    value: float | list[StepTable | RampTable | DoubletTable], start_deg: float
) -> tuple[float, tuple[Segment, ...]]:
    if isinstance(value, list):
        return start_deg * DEG, tuple(table.segment() for table in value)
    return value * DEG, ()
