"""``[[expect]]``: what a scenario's flights must come to."""

from typing import Annotated, Literal, TypeAlias

from pydantic import Field, model_validator

from flighttune.metrics import METRICS
from flighttune.scenario.table import Finite, Table
from flighttune.simulate.run import RunStatus

Subject: TypeAlias = Literal["chi", "gamma", "flight"]
Bounds: TypeAlias = dict[Subject, dict[str, Finite]]

CHANNEL_MEASURES = (*METRICS, "peak_rad")
FLIGHT_MEASURES = ("V_a_dev_mps", "n_z_min", "n_z_max", "alpha_max_rad")


class ExpectTable(Table):
    """What runs must come to: of one plant, of one gain set, of both, or of all.

    Bounds are grouped by ``chi``, ``gamma`` (measures of the channel, and ``peak_rad``, the largest
    error) and ``flight``; a measure in rad may be given in deg under that ending.
    """

    plant: Annotated[str, Field(min_length=1)] | None = None
    gains: Annotated[str, Field(min_length=1)] | None = None
    status: RunStatus | None = None
    at_most: Bounds = Field(default_factory=dict)
    at_least: Bounds = Field(default_factory=dict)

    @model_validator(mode="after")
    def _measures_exist(self) -> "ExpectTable":
        if not (self.status or self.at_most or self.at_least):
            raise ValueError("`status`, `at_most` or `at_least` must be given in [[expect]]")
        for bounds in (self.at_most, self.at_least):
            for subject, limits in bounds.items():
                known = FLIGHT_MEASURES if subject == "flight" else CHANNEL_MEASURES
                for name in limits:
                    if in_rad(name) not in known:
                        raise ValueError(
                            f"`{subject}.{name}` must be one of {', '.join(known)} "
                            "(or _deg in place of _rad)"
                        )
        return self

    def meant(self, plant: str, gains: str) -> bool:
        """Whether a run of this plant and these gains is meant."""
        return self.plant in (None, plant) and self.gains in (None, gains)


def in_rad(measure: str) -> str:
    """Name of a measure with ``_deg`` replaced by ``_rad``."""
    return f"{measure.removesuffix('_deg')}_rad" if measure.endswith("_deg") else measure
