"""The tables and keys of a campaign file."""

import math
from abc import abstractmethod
from typing import Annotated, Any, Literal, Self, TypeAlias, get_args

import numpy as np
import numpy.typing as npt
import scipy  # its parts load on first use: all of them take a sixth of a worker's imports
from pydantic import Field, field_validator, model_validator

from flighttune.base.arrays import FloatArray
from flighttune.base.files.budget import MAX_NAME
from flighttune.base.files.table import abridged, refused_in_a_line
from flighttune.base.quantities import Finite, NotNegative, PathName, Positive, Table
from flighttune.control.gains_keys import GainsTable
from flighttune.flight.metrics import FLIGHT_METRICS
from flighttune.flight.requirement_keys import CHANNEL_MEASURES, ExpectTable
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plant_keys import PlantTable
from flighttune.vehicles.weather_keys import Seed

# Values of a key of a scenario
Value: TypeAlias = bool | int | float | str

Values: TypeAlias = Annotated[list[Value], Field(min_length=1)]

Key: TypeAlias = Annotated[str, Field(min_length=1, max_length=MAX_NAME)]
Design: TypeAlias = Literal["random", "latin_hypercube", "sobol", "grid"]
Count: TypeAlias = Annotated[int, Field(ge=0)]

# Measures of a run, by column name
MEASURES = (
    *(f"{channel}.{name}" for channel in ("chi", "gamma") for name in CHANNEL_MEASURES),
    *(f"flight.{name}" for name in FLIGHT_METRICS),
)

# Kinds of values other than numbers
KINDS = {bool: "boolean", str: "string"}

# Values of one grid key
MAX_POINTS = 10_000

INDEPENDENT = "independent draws, which are those of `design` random without a grid"

# Largest distance from a mean to the truncated range, in standard deviations
MAX_SD = 8.0


class DisperseTable(Table):
    """``[[disperse]]``: one key of the scenario that varies from draw to draw."""

    # Dotted path of a key of the scenario; [0] is a position in a list, plant[LABEL] a plant
    key: Key
    # The drawn value replaces the scenario's, is added to it, or multiplies it
    acts: Literal["sets", "adds", "multiplies"] = "sets"

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        if self.key.endswith("module"):  # no code may run that `Plan.code` does not list
            raise ValueError(f"`key` must not name a file of code, got {self.key}")
        low, high, values = (getattr(self, name, None) for name in ("lower", "upper", "values"))
        if low is not None and high is not None and not low < high:
            raise ValueError(f"`lower` must be below `upper`, got {low:g} and {high:g}")
        kinds = {KINDS.get(type(value), "number") for value in values or ()}
        if len(kinds) > 1:
            raise ValueError(
                f"`values` must be all numbers, all strings or all booleans, got {values}"
            )
        if self.acts != "sets" and kinds - {"number"}:
            raise ValueError(f"`values` must be numbers with `acts` {self.acts!r}, got {values}")
        return self

    @property
    def central(self) -> Value:
        """The median."""
        return float(self.at(np.array([0.5]))[0])

    @abstractmethod
    def at(self, u: FloatArray) -> npt.NDArray[Any]:
        """Values at points `u` of the open unit interval, shape as `u`."""


def truncated_quantiles(u: FloatArray, a: float, b: float) -> FloatArray:
    """Quantiles of the standard normal distribution between `a` and `b`."""
    # SciPy's `truncnorm` to the bit, whose import takes as long as a hundred flights.
    if b <= 0.0 or a > 0.0:  # a tail; of the right one as much as of its mirror image
        more, less = scipy.special.log_ndtr([b, a] if b <= 0.0 else [-a, -b])
        mass = np.real(scipy.special.logsumexp([more, less + np.pi * 1j]))
    else:
        mass = scipy.special.log1p(-scipy.special.ndtr(a) - scipy.special.ndtr(-b))
    left = a < 0.0
    inside = (np.log(u) if left else np.log1p(-u)) + mass
    outside = np.full_like(u, scipy.special.log_ndtr(a if left else -b))
    x = scipy.special.ndtri_exp(scipy.special.logsumexp([outside, inside], axis=0))
    return x if left else -x


class Normal(DisperseTable):
    """Normal distribution, truncated at given bounds; `sd` applies before truncation."""

    distribution: Literal["normal"] = "normal"
    mean: Finite
    sd: Positive
    lower: Finite | None = None  # truncated there if given
    upper: Finite | None = None  # truncated there if given

    @model_validator(mode="after")
    def _something_between_the_bounds(self) -> "Normal":
        low, high = self._bounds
        if low > self.mean + MAX_SD * self.sd or high < self.mean - MAX_SD * self.sd:
            raise ValueError(
                f"`mean` must lie within {MAX_SD:g} `sd` of what `lower` and `upper` leave, "
                f"got {self.mean:g}"
            )
        return self

    @property
    def _bounds(self) -> tuple[float, float]:
        return (
            -math.inf if self.lower is None else self.lower,
            math.inf if self.upper is None else self.upper,
        )

    def at(self, u: FloatArray) -> FloatArray:
        if self.lower is None and self.upper is None:
            return self.mean + self.sd * scipy.special.ndtri(u)
        low, high = self._bounds
        a, b = (low - self.mean) / self.sd, (high - self.mean) / self.sd
        # clipped: in the tail rounding may put a value outside its bound
        return np.clip(self.mean + self.sd * truncated_quantiles(u, a, b), low, high)


class LogNormal(DisperseTable):
    """Log-normal distribution; `sd_log` is the standard deviation of the natural logarithm."""

    distribution: Literal["log_normal"] = "log_normal"
    median: Positive
    sd_log: Positive  # of the natural logarithm: 0.1 is about 10 %

    def at(self, u: FloatArray) -> FloatArray:
        with np.errstate(over="ignore"):  # the key itself refuses a drawn infinity
            return self.median * np.exp(self.sd_log * scipy.special.ndtri(u))


class Uniform(DisperseTable):
    """Uniform distribution from `lower` to `upper`."""

    distribution: Literal["uniform"] = "uniform"
    lower: Finite
    upper: Finite

    def at(self, u: FloatArray) -> FloatArray:
        return self.lower + u * (self.upper - self.lower)


class Choice(DisperseTable):
    """One of some values, in proportion to their weights."""

    distribution: Literal["choice"] = "choice"
    values: Values  # numbers, strings or booleans
    weights: list[NotNegative] | None = None  # equal if left out

    @model_validator(mode="after")
    def _weights_and_values_fit(self) -> "Choice":
        weights = self.weights
        if weights is not None and (len(weights) != len(self.values) or not sum(weights) > 0.0):
            raise ValueError(
                f"`weights` must be as many numbers as `values`, {len(self.values)}, and not all "
                f"zero, got {weights}"
            )
        return self

    @property
    def central(self) -> Value:
        """The most likely value that is not NaN; the first of several."""
        weights = self.weights or [1.0] * len(self.values)
        numbers = [(v, w) for v, w in zip(self.values, weights, strict=True) if v == v]
        return max(numbers, key=lambda pair: pair[1], default=(self.values[0], 0.0))[0]

    def at(self, u: FloatArray) -> npt.NDArray[np.generic]:
        edges = np.cumsum(self.weights or [1.0] * len(self.values))
        return _as_array(self.values)[np.searchsorted(edges, u * edges[-1], side="right")]


class Grid(DisperseTable):
    """Values that are all flown equally often, without chance."""

    distribution: Literal["grid"] = "grid"
    values: Values | None = None  # every value is flown; lower, upper and count may replace them
    lower: Finite | None = None
    upper: Finite | None = None
    count: Annotated[int, Field(ge=2, le=MAX_POINTS)] | None = None

    @model_validator(mode="after")
    def _values_or_range(self) -> "Grid":
        range_keys = {key is not None for key in (self.lower, self.upper, self.count)}
        if range_keys != {self.values is None}:
            raise ValueError(
                "`values` must be given with distribution grid, or `lower`, `upper` and `count` in "
                "their place"
            )
        return self

    @property
    def levels(self) -> list[Value]:
        """The values."""
        if self.values is not None:
            return self.values
        # all three are given; `or` is for the type checker
        return np.linspace(self.lower or 0.0, self.upper or 0.0, self.count or 0).tolist()

    @property
    def central(self) -> Value:
        """The value in the middle."""
        return self.levels[(len(self.levels) - 1) // 2]

    def at(self, u: FloatArray) -> npt.NDArray[np.generic]:
        return _as_array(self.levels)[(u * len(self.levels)).astype(np.intp)]


Dispersion: TypeAlias = Normal | LogNormal | Uniform | Choice | Grid
DISTRIBUTIONS: dict[str, type[Dispersion]] = {
    member.model_fields["distribution"].default: member for member in get_args(Dispersion)
}


class CorrelationTable(Table):
    """``[[correlation]]``: rank correlation of two drawn keys."""

    # Both with the distribution normal, log_normal or uniform
    keys: Annotated[list[Key], Field(min_length=2, max_length=2)]
    # Rank correlation (Spearman's), by a Gaussian copula
    rank: Annotated[float, Field(gt=-1.0, lt=1.0)]


class KeepTable(Table):
    """``[keep]``: runs whose whole time history is saved."""

    failures: Count = 20  # number of first failures
    worst: Count = 5  # number of worst flights by worst_by
    worst_by: str = "chi.ITAE"
    sample: Count = 5  # number of random runs

    @field_validator("worst_by")
    @classmethod
    def _a_measure(cls, value: str) -> str:
        if value not in MEASURES:
            raise ValueError(f"must be one of {', '.join(MEASURES)}")
        return value


class CampaignTable(Table):
    """Content of a campaign file, with the defaults filled in."""

    title: Annotated[str, Field(min_length=1)]
    verifies: str = ""  # for the reader
    source: str = ""  # for the reader
    scenario: PathName  # a shipped name, or a file in the campaign's folder
    seed: Seed = 0  # seed of all random numbers
    # Flights over all draws, gain sets and plants; if left out, one per cell and group of a grid
    runs: Annotated[int, Field(ge=1, le=10**9)] | None = None
    design: Design = "random"
    # End once it is sure for every group whether at least this share of flights succeeds
    until_sure: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    time_limit_s: Positive = 60.0  # wall time after which a run is aborted
    # In place of the scenario's
    gains: Annotated[list[str | GainsTable], Field(min_length=1)] | None = None
    # In place of the scenario's
    plant: Annotated[list[PlantTable], Field(min_length=1)] | None = None
    # Values that replace keys of the scenario; a path into a list is quoted
    overrides: dict[str, Any] = Field(default_factory=dict)
    disperse: list[Annotated[Dispersion, Field(discriminator="distribution")]] = Field(
        default_factory=list
    )
    correlation: list[CorrelationTable] = Field(default_factory=list)
    # Requirements of a run, with the keys of [[expect]]; if left out, the scenario's requirements
    success: list[ExpectTable] = Field(default_factory=list)
    keep: KeepTable = KeepTable()

    @model_validator(mode="after")
    def _design_fits(self) -> "CampaignTable":
        if self.design == "grid" and not self.grids:
            raise ValueError(
                "`design` must not be 'grid' where no [[disperse]] has the distribution grid"
            )
        if self.runs is None and self.design != "grid":
            raise ValueError("`runs` must be given: only `design` 'grid' can do without")
        if self.until_sure is not None and (self.design != "random" or self.grids):
            raise ValueError(f"`until_sure` must be with {INDEPENDENT}, got {self.design}")
        return self

    @model_validator(mode="after")
    def _correlations_fit(self) -> "CampaignTable":
        distributions = {table.key: table.distribution for table in self.disperse}
        for key in (key for table in self.correlation for key in table.keys):
            if distributions.get(key) not in ("normal", "log_normal", "uniform"):
                raise ValueError(
                    "[[correlation]] `keys` must be dispersed with normal, log_normal or uniform, "
                    f"got {abridged(key)} with {distributions.get(key, 'none')}"
                )
        pairs = [frozenset(table.keys) for table in self.correlation]
        if any(len(pair) < 2 for pair in pairs) or len(set(pairs)) < len(pairs):
            raise ValueError("[[correlation]] `keys` must be two keys, and each pair given once")
        return self

    @property
    def keys(self) -> tuple[str, ...]:
        """The dispersed keys in order of the file."""
        return tuple(table.key for table in self.disperse)

    @property
    def grids(self) -> tuple[Grid, ...]:
        """The keys of a grid in order of the file."""
        return tuple(table for table in self.disperse if isinstance(table, Grid))


@refused_in_a_line
class Campaign(CampaignTable):
    """A campaign with its file, scenario and aircraft checked against each other.

    ``nominal`` is the undispersed scenario with the gains, plants, overrides and requirements of
    the campaign. ``central`` is the same at the median of all dispersed keys. `load_campaign` makes
    a campaign.

    Examples
    --------
    >>> ft.load_campaign("first_campaign").keys[:2]
    ('flight.V_a_mps', 'flight.gamma_deg')
    """

    nominal: Scenario
    central: Scenario

    @classmethod
    def of(cls, table: CampaignTable, *, nominal: Scenario, central: Scenario) -> "Campaign":
        """The campaign of a file's tables and its scenarios."""
        return cls(**{**vars(table), "nominal": nominal, "central": central})


def _as_array(values: list[Value]) -> npt.NDArray[np.generic]:
    """Values as an array of booleans, integers, floats or (objects that are) strings."""
    strings = any(isinstance(value, str) for value in values)
    return np.array(values, dtype=object if strings else None)
