"""The flights of a campaign as they are on disk, finished or not."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.dataset import open_dataset
from flighttune.campaign.statistics.intervals import CONFIDENCE, Estimate, Method, percentile, share
from flighttune.planning.plan import Group, Plan
from flighttune.planning.schema import MEASURES

# Columns that may be null, which then are empty.
TEXTS = ("reason", "missed")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Flights:
    """Rows of a campaign with the plan that made them."""

    url: str  # folder of the campaign, as it was named by the caller
    plan: Plan
    rows: pd.DataFrame  # a row for each run that was flown, in order of run
    versions: Mapping[str, str]  # of the libraries that shaped the rows
    method: Method = "wilson"  # interval of shares
    confidence: float = CONFIDENCE  # 1; of all intervals

    @property
    def measures(self) -> tuple[str, ...]:
        """Measures that at least one flight has."""
        recorded = [name for name in MEASURES if name in self.rows]
        return tuple(name for name in recorded if self.rows[name].notna().to_numpy().any())

    def clusters(self, rows: pd.DataFrame) -> npt.NDArray[np.intp]:
        """Design cycle of each row; cycles are independent of each other."""
        return rows["draw"].to_numpy() // self.plan.cycle

    def share(self, flags: npt.NDArray[np.bool_], clusters: npt.ArrayLike) -> Estimate:
        """Share of flights of which something is true."""
        return share(flags, clusters, method=self.method, confidence=self.confidence)

    def percentile(self, values: FloatArray, q: float, clusters: npt.ArrayLike) -> Estimate:
        """Quantile of a measure, without NaN."""
        return percentile(values, q, clusters, confidence=self.confidence)

    def groups(self) -> Iterator[tuple[Group, pd.DataFrame]]:
        """Rows of every group that has some, in the order of the plan."""
        plant, gains = (self.rows[name].to_numpy(dtype=object) for name in ("plant", "gains"))
        for group in self.plan.groups:
            rows = self.rows.loc[(plant == group.plant) & (gains == group.gains)]
            if len(rows):
                yield group, rows


def load_flights(url: str | Path) -> Flights:
    """Read the rows that a campaign has written so far."""
    dataset = open_dataset(url)
    rows = dataset.rows().to_pandas()
    return flights_of(rows, dataset.plan, url=str(dataset.folder), versions=dataset.versions)


def flights_of(
    rows: pd.DataFrame, plan: Plan, *, url: str = "", versions: Mapping[str, str] | None = None
) -> Flights:
    """Put rows, in order of run, and their plan together."""
    rows = rows.reset_index(drop=True)
    texts = {name: rows[name].fillna("").astype(str) for name in TEXTS}
    numbers = {
        name: rows[name].to_numpy(dtype=float, na_value=np.nan) for name in MEASURES if name in rows
    }
    success = rows["success"].to_numpy(dtype=bool, na_value=False)
    rows = rows.assign(**texts, **numbers, success=success)
    return Flights(url=url, plan=plan, rows=rows, versions=versions or {})


def is_number(column: pd.Series) -> bool:
    """Whether the values of a parameter have an order that correlation can use."""
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)
