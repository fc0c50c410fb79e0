"""The tables and keys of a campaign file."""

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import Field, field_validator, model_validator

from flighttune.campaign.planning.disperse_table import CorrelationTable, DisperseTable
from flighttune.scenario.expect_table import (
    CHANNEL_MEASURES,
    FLIGHT_MEASURES,
    ExpectTable,
)
from flighttune.scenario.plant_table import PlantTable
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.table import NotNegative, Positive, Seed, Table

Design: TypeAlias = Literal["random", "latin_hypercube", "sobol", "saltelli", "grid"]
Runs: TypeAlias = Annotated[int, Field(ge=1, le=10**9)]
Count: TypeAlias = Annotated[int, Field(ge=0)]

MEASURES = (
    *(f"{channel}.{name}" for channel in ("chi", "gamma") for name in CHANNEL_MEASURES),
    *(f"flight.{name}" for name in FLIGHT_MEASURES),
)
"""What a run is measured by, as the columns of rows are named."""


class CertificateTable(Table):
    """``[certificate]``: the claim that is looked at in every run.

    The errors, once inside the certified ultimate set of a disturbance whose rate keeps below
    ``L_d_rad_s2``, stay there. By default that rate is measured on the undispersed flight of the
    same plant and gains, from ``from_s`` (half the duration where it is not given) on.
    """

    from_s: NotNegative | None = None
    L_d_rad_s2: Positive | None = None


class KeepTable(Table):
    """``[keep]``: of which runs the whole time history is kept."""

    failures: Count = 20
    worst: Count = 5
    worst_by: str = "chi.ITAE"
    sample: Count = 5

    @field_validator("worst_by")
    @classmethod
    def _a_measure(cls, value: str) -> str:
        if value not in MEASURES:
            raise ValueError(f"must be one of {', '.join(MEASURES)}")
        return value


class CampaignTable(Table):
    """What a campaign file says, with the defaults filled in."""

    title: Annotated[str, Field(min_length=1)]
    verifies: str = ""
    source: str = ""
    scenario: Annotated[str, Field(min_length=1)]
    seed: Seed = 0
    runs: Runs | None = None
    design: Design = "random"
    time_limit_s: Positive = 60.0
    gains: Annotated[list[str | GainsTable], Field(min_length=1)] | None = None
    plant: Annotated[list[PlantTable], Field(min_length=1)] | None = None
    overrides: dict[str, Any] = Field(default_factory=dict)
    disperse: list[DisperseTable] = Field(default_factory=list)
    correlation: list[CorrelationTable] = Field(default_factory=list)
    success: list[ExpectTable] = Field(default_factory=list)
    certificate: CertificateTable | None = None
    keep: KeepTable = KeepTable()

    @model_validator(mode="after")
    def _hangs_together(self) -> "CampaignTable":
        grids = [table.key for table in self.disperse if table.distribution == "grid"]
        if self.design == "grid" and not grids:
            raise ValueError(
                "`design` must not be 'grid' where no [[disperse]] has the distribution grid"
            )
        if self.design == "saltelli" and (grids or self.correlation):
            what = f"grid of `{grids[0]}`" if grids else "[[correlation]]"
            raise ValueError(f"`design` must not be 'saltelli' where there is a {what}")
        if self.design == "saltelli" and not self.disperse:
            raise ValueError("[[disperse]] must be given with `design` 'saltelli'")
        if self.runs is None and self.design != "grid":
            raise ValueError("`runs` must be given: only `design` 'grid' can do without")
        return self

    @property
    def keys(self) -> tuple[str, ...]:
        """The dispersed keys in order of the file."""
        return tuple(table.key for table in self.disperse)


class Campaign(CampaignTable):
    """A campaign whose file, scenario and aircraft have been checked against each other.

    ``nominal`` is the scenario with the gains, plants, overrides and expectations of the campaign
    put in, undispersed; ``central`` the same at the median of everything dispersed. `load_campaign`
    makes it.
    """

    nominal: Scenario
    central: Scenario

    @classmethod
    def of(cls, table: CampaignTable, *, nominal: Scenario, central: Scenario) -> "Campaign":
        """The campaign of a file's tables and its scenarios."""
        values: dict[str, Any] = {name: getattr(table, name) for name in CampaignTable.model_fields}
        return cls(**values, nominal=nominal, central=central)

    def as_dict(self) -> dict[str, Any]:
        """The keys of the file as plain values, defaults filled in."""
        return self.model_dump(mode="python", exclude={"nominal", "central"}, exclude_none=True)
