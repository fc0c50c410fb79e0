"""Statistics of a campaign: results of each group, and influences of the parameters."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
import pandas as pd
import scipy

from flighttune.base.arrays import FloatArray
from flighttune.base.endings import endings, reasons
from flighttune.base.errors import InputError
from flighttune.base.units import DEG
from flighttune.base.words import listed, pick
from flighttune.campaigns.dataset import compiled_of, open_dataset
from flighttune.campaigns.flying.compiled import CompiledFlights
from flighttune.campaigns.planning.plan import Group, Plan
from flighttune.campaigns.planning.schema import INDEPENDENT, MEASURES
from flighttune.campaigns.statistics.count import sure
from flighttune.campaigns.statistics.intervals import (
    CONFIDENCE,
    Estimate,
    Method,
    paired,
    percentile,
    scores,
    share,
)
from flighttune.flight.flown import bound_checks, bounded_loop
from flighttune.flight.requirement_keys import in_rad

# Columns in which null becomes an empty text.
TEXTS = ("reason", "missed")

SUCCESS = "success"

PERCENTILES = {"p05": 0.05, "p50": 0.5, "p95": 0.95}

# Smallest number of flights on a convergence curve, and the maximum number of its points.
FIRST_PREFIX, POINTS = 10, 25

# Maximum number of classes of the most influential parameter with a success rate.
SPLIT_INTO = 5

# Number of worst flights in the list of a group.
WORST = 5

# Answers about the share of successful flights, by label of group; empty if not sure.
Answers: TypeAlias = dict[str, Literal["yes", "no", ""]]

# A statistic and its p-value, both NaN if it is undefined.
Test: TypeAlias = tuple[float, float]

# Sentences for an answer about the share of successful flights.
ANSWERS = {
    "yes": "At least {share} of the flights of {groups} succeed.",
    "no": "Fewer than {share} of the flights of {groups} succeed.",
    "": "It is not sure whether at least {share} of the flights of {groups} succeed.",
}

# Number of equal classes of a number with many values.
CLASSES = 10

# Minimum average of flights per class, which the rank test needs.
MIN_IN_CLASS = 5


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """Rows of a campaign, finished or not, with their plan and statistics."""

    url: str  # folder of the campaign, as the caller named it
    plan: Plan
    rows: pd.DataFrame  # a row for each flown run, in order of run
    versions: Mapping[str, str]  # versions of the libraries that affected the rows
    method: Method = "wilson"  # method for intervals of shares
    confidence: float = CONFIDENCE  # 1: confidence of all intervals
    compiled: CompiledFlights = field(default_factory=CompiledFlights)

    def by(self, method: Method | None, confidence: float = CONFIDENCE) -> "Findings":
        """The same with all intervals by one method, by default the campaign's method."""
        rows, design = self.rows, self.plan.campaign.design
        until_sure = self.plan.campaign.until_sure is not None
        method = method or ("any-time" if until_sure else "wilson")
        if until_sure and method != "any-time":
            got = f"got {method}: the campaign ends once it is sure"
            raise InputError(f"{self.url}: `interval` must be any-time, {got}.")
        if method == "any-time":
            if design != "random" or self.plan.cycle > 1:
                raise InputError(f"`interval` any-time must be with {INDEPENDENT}, got {design}.")
            # A stop leaves rows after unfinished runs, and the outcome of a run affects when it
            # finishes.
            rows = rows[rows["run"].to_numpy() == np.arange(len(rows))]
            if rows.empty:
                raise InputError(f"{self.url}: `interval` any-time must be with run 0, got none.")
        return replace(self, rows=rows, method=method, confidence=confidence)

    @cached_property
    def measures(self) -> tuple[str, ...]:
        """Measures with a value for at least one flight."""
        recorded = [name for name in MEASURES if name in self.rows]
        return tuple(name for name in recorded if self.rows[name].notna().to_numpy().any())

    @property
    def measure(self) -> str | None:
        """The measure that orders and compares flights; None if no flight has a measure."""
        worst_by = self.plan.campaign.keep.worst_by
        return worst_by if worst_by in self.measures else next(iter(self.measures), None)

    def clusters(self, rows: pd.DataFrame) -> npt.NDArray[np.intp]:
        """Design cycle of each row; cycles are independent of each other."""
        return rows["draw"].to_numpy() // self.plan.cycle

    def successes(self, rows: pd.DataFrame) -> Estimate:
        """Share of successful flights."""
        # Points of a Latin hypercube or Sobol sequence count as independent, so their intervals are
        # wider than necessary.
        flags, method = rows[SUCCESS].to_numpy(dtype=bool), self.method
        return share(flags, self.clusters(rows), method=method, confidence=self.confidence)

    def percentile(self, rows: pd.DataFrame, measure: str, q: float) -> Estimate:
        """Quantile of a measure over the flights that have it."""
        values = rows[measure].to_numpy(dtype=float)
        return percentile(values, q, self.clusters(rows), confidence=self.confidence)

    def groups(self) -> Iterator[tuple[Group, pd.DataFrame]]:
        """Rows of every group with rows, in the order of the plan."""
        plant, gains = (self.rows[name].to_numpy(dtype=object) for name in ("plant", "gains"))
        for group in self.plan.groups:
            rows = self.rows.loc[(plant == group.plant) & (gains == group.gains)]
            if len(rows):
                yield group, rows

    @cached_property
    def values(self) -> dict[str, Any]:
        """The values of ``--json``: shares between 0 and 1, units as in the columns."""
        plan, measure, confidence = self.plan, self.measure, self.confidence
        sure = answers(self.rows, plan, confidence)
        return {
            "dataset": self.url,
            "title": plan.campaign.title,
            "runs": len(self.rows),
            "planned": plan.runs,
            "design": plan.campaign.design,
            "interval": self.method,
            "confidence": confidence,
            "worst_by": measure,
            "requirements": self._requirements(),
            "groups": [self._summary(*group) for group in self.groups()],
            "paired": paired(self.rows, measure, confidence=confidence) if measure else [],
            **({"sure": sure} if sure else {}),
        }

    def _summary(self, group: Group, rows: pd.DataFrame) -> dict[str, Any]:
        """Counts, rates and metrics of the flights of a group, and influences on them."""
        completed, drawn = _completed(rows), rows[[*self.plan.keys]]
        rate = self.successes(rows)
        failed = completed.loc[~completed[SUCCESS].to_numpy(dtype=bool), ["run", "missed"]]
        # A flight that misses two requirements counts for both.
        failed = failed.assign(missed=failed["missed"].str.split("; "))
        failed = failed.explode("missed")
        ranks = {
            name: influences(drawn, values_of(rows, name), confidence=self.confidence)
            for name in (SUCCESS, self.measure)
            if name
        }
        return {
            "group": group.label,
            **pick(group, "gains plant"),
            "n": len(rows),
            "success": rate.value,
            **pick(rate, "lo hi"),
            "successes": int(rows[SUCCESS].sum()),
            "statuses": rows["status"].value_counts().to_dict(),
            "reasons": endings(rows.loc[rows["reason"] != ""].to_dict("records")),
            "missed": reasons(failed["missed"].tolist(), failed["run"].tolist()),
            "metrics": {
                name: self._spread(completed, name)
                for name in self.measures
                if completed[name].notna().any()
            },
            "worst": self._worst(completed, self.measure) if self.measure else [],
            "sensitivity": {name: {"ranks": own} for name, own in ranks.items()},
        }

    def _spread(self, completed: pd.DataFrame, measure: str) -> dict[str, Any]:
        """Mean and percentiles of a measure over the completed flights that have it."""
        rows = completed.loc[completed[measure].notna().to_numpy()]
        mean = float(np.mean(rows[measure].to_numpy(dtype=float)))
        spread: dict[str, Any] = {"mean": mean, "n": len(rows)}
        for name, q in PERCENTILES.items():
            estimate = self.percentile(rows, measure, q)
            spread |= {name: estimate.value, f"{name}_interval": [estimate.lo, estimate.hi]}
        return spread

    def _worst(self, completed: pd.DataFrame, measure: str) -> list[dict[str, Any]]:
        """The worst completed flights, with all drawn values."""
        measured = completed.dropna(subset=measure)
        worst = measured.sort_values([measure, "run"], ascending=[False, True]).head(WORST)
        return [
            {key: flight[key] for key in ("run", "draw", measure, SUCCESS)}
            | {"parameters": {key: flight[key] for key in self.plan.keys}}
            for flight in worst.to_dict("records")
        ]

    def _requirements(self) -> list[dict[str, Any]]:
        """Bounds of success in the units of the columns, ordered by misses, then by distance."""
        completed, stated = _completed(self.rows), []
        groups = list(zip(completed["plant"], completed["gains"], strict=True))
        for table in self.plan.scenario.expect:
            rows = completed.loc[[table.meant(*group) for group in groups]]
            flown = {group.gains: self.plan.entry(group) for group in self.plan.groups}
            loops = {name: bounded_loop([table], flown[name]) for name in rows["gains"].unique()}
            for check in bound_checks([table], {}):
                measure = f"{check.subject}.{in_rad(check.measure)}"
                bound = check.bound * (DEG if check.measure.endswith("_deg") else 1.0)
                if check.subject == "loop":  # a measure of the undispersed loop has no column
                    key = in_rad(check.measure)
                    of_gains = {name: loop["loop"].get(key) for name, loop in loops.items() if loop}
                    values = rows["gains"].map(of_gains).to_numpy(dtype=float)
                else:
                    values = rows[measure].to_numpy(dtype=float)
                beyond = values - bound if check.sense == "at_most" else bound - values
                beyond = np.where(np.isnan(values), np.inf, beyond) / (abs(bound) or 1.0)
                # an order statistic: infinite values need no mean
                near = (
                    float(np.quantile(beyond, 0.95, method="inverted_cdf"))
                    if len(rows)
                    else -np.inf
                )
                row = {**pick(table, "plant gains"), "measure": measure, "sense": check.sense}
                row |= {"bound": bound, "n": len(rows), "missed": int((beyond > 0.0).sum())}
                stated.append({**row, "near": near})
        ordered = sorted(stated, key=lambda row: (-row["missed"], -row["near"]))
        return [
            row | {"near": row["near"] if np.isfinite(row["near"]) else None} for row in ordered
        ]

    @cached_property
    def splits(self) -> list[dict[str, Any]]:
        """Success rate over classes of the most influential parameter, for groups with any."""
        splits = []
        for (group, rows), values in zip(self.groups(), self.values["groups"], strict=True):
            ranks = values["sensitivity"][SUCCESS]["ranks"]
            apart = [rank["parameter"] for rank in ranks if rank["apart"]]
            splits += [self._split(group, rows, key) for key in apart[:1]]
        return splits

    def _split(self, group: Group, rows: pd.DataFrame, parameter: str) -> dict[str, Any]:
        """Success rate over the classes of a parameter."""
        rows = rows.loc[rows[parameter].notna().to_numpy()]
        numeric = is_number(rows[parameter])
        classes = [members for _, members in rows.groupby(classes_of(rows[parameter], SPLIT_INTO))]
        values = [members[parameter].to_numpy() for members in classes]
        return {
            "group": group.label,
            "parameter": parameter,
            "labels": _ranges(values) if numeric else [str(of_class[0]) for of_class in values],
            # median of the parameter in each class; for categories, the position of the class
            "centres": [
                float(np.median(of_class.astype(float))) if numeric else float(place)
                for place, of_class in enumerate(values)
            ],
            "success": [self.successes(members) for members in classes],
        }

    @cached_property
    def convergence(self) -> list[dict[str, Any]]:
        """Estimates from the first n flights of each group: `success`, and `p95` of the measure."""
        measure, curves = self.measure, []
        if measure is None:
            return []
        for group, rows in self.groups():
            # from 10, or a quarter of the flights if that is less, evenly spaced in the logarithm
            first = max(1, min(FIRST_PREFIX, len(rows) // 4))
            counts = np.unique(np.geomspace(first, len(rows), POINTS).round().astype(int))
            places = np.flatnonzero((rows["status"] == "completed") & rows[measure].notna())
            measured, ends = rows.iloc[places], np.searchsorted(places, counts)
            curve: dict[str, Any] = {"group": group.label, "n": counts.tolist()}
            curve["success"] = [self.successes(rows.head(n)) for n in counts]
            curve["p95"] = [
                self.percentile(measured.head(n), measure, PERCENTILES["p95"]) for n in ends
            ]
            curves.append(curve)
        return curves


def load_findings(url: str | Path) -> Findings:
    """Read the existing rows of a campaign."""
    dataset = open_dataset(url)
    rows = dataset.rows()
    found = findings_of(
        rows.to_pandas(), dataset.plan, url=str(dataset.folder), versions=dataset.versions
    )
    return replace(found, compiled=compiled_of(rows))


def findings_of(
    rows: pd.DataFrame, plan: Plan, *, url: str = "", versions: Mapping[str, str] | None = None
) -> Findings:
    """Findings from rows, in order of run, and their plan."""
    rows = rows.reset_index(drop=True)
    texts = {name: rows[name].fillna("").astype(str) for name in TEXTS}
    numbers = {
        name: rows[name].to_numpy(dtype=float, na_value=np.nan) for name in MEASURES if name in rows
    }
    success = rows[SUCCESS].to_numpy(dtype=bool, na_value=False)
    rows = rows.assign(**texts, **numbers, success=success)
    return Findings(url=url, plan=plan, rows=rows, versions=versions or {})


def answers(rows: pd.DataFrame, plan: Plan, confidence: float = CONFIDENCE) -> Answers:
    """Whether the required share succeeds in each group, empty if it is not sure.

    `rows` have plant, gains and success of the first runs. Empty without a required share.
    """
    if (wanted := plan.campaign.until_sure) is None:
        return {}
    counts = rows.groupby(["plant", "gains"], sort=False)[SUCCESS].agg(["size", "sum"]).astype(int)
    return {
        Group(plant, gains).label: sure(n - met, n, 1.0 - wanted, confidence)
        for (plant, gains), n, met in counts.itertuples()
    }


def answer_words(answers: Mapping[str, str], wanted: float | None) -> str:
    """The answers about a share, one sentence for all groups with the same answer."""
    return " ".join(
        text.format(share=f"{100.0 * (wanted or 0.0):.10g} %", groups=listed(groups))
        for kind, text in ANSWERS.items()
        if (groups := [group for group, answer in answers.items() if answer == kind])
    )


def _completed(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.loc[(rows["status"] == "completed").to_numpy()]


def values_of(rows: pd.DataFrame, name: str) -> FloatArray:
    """Success as 0 and 1, or a measure; NaN if the flight was not completed."""
    if name == SUCCESS:
        return rows[SUCCESS].to_numpy(dtype=float)
    values = scores(rows, name)
    return np.where(np.isinf(values), np.nan, values)


def _ranges(values: list[np.ndarray]) -> list[str]:
    """Ranges of adjacent classes without gaps."""
    if all(of_class.min() == of_class.max() for of_class in values):
        return [f"{of_class[0]:.4g}" for of_class in values]
    edges = [values[0].min(), *(0.5 * (a.max() + b.min()) for a, b in pairwise(values))]
    edges.append(values[-1].max())
    return [f"{low:.4g} to {high:.4g}" for low, high in pairwise(edges)]


def is_number(column: pd.Series) -> bool:
    """Whether the values of a parameter are ordered, as a correlation requires."""
    return pd.api.types.is_numeric_dtype(column) and not pd.api.types.is_bool_dtype(column)


def influences(
    parameters: pd.DataFrame, measure: npt.ArrayLike, *, confidence: float = CONFIDENCE
) -> list[dict[str, Any]]:
    """Influence of every parameter on a measure, strongest first.

    A record has the `parameter`; the number `n` of flights; Spearman's rank correlation `rho` from
    `lo` to `hi`, NaN if the parameter is not a number; `partial`, the same with the ranks of all
    other parameters fixed, NaN if they are collinear; the explained `share` of the variance of the
    measure's ranks, 0 by chance; `p_rho` and `p_share`, corrected probabilities of such values
    without any influence; and whether it is `apart`: at least one of the two is significant.
    Flights without a value of the measure or a parameter are left out, and so are constant
    parameters; infinite values count by their rank. Fewer than 10 flights give no records.

    The interval of `rho` follows [1]_. `share` is epsilon squared of the Kruskal-Wallis test [2]_
    over the values of the parameter, or over ten classes of equal size if it has more than ten. The
    part explained by chance is subtracted: ``(H - k + 1) / (n - k)`` for k classes. P-values are
    corrected together by Holm's method [3]_.

    .. [1] D. G. Bonett, T. A. Wright, "Sample size requirements for estimating Pearson, Kendall and
       Spearman correlations", Psychometrika 65 (2000) 23-28.
    .. [2] W. H. Kruskal, W. A. Wallis, "Use of ranks in one-criterion variance analysis", J. Am.
       Stat. Assoc. 47 (1952) 583-621.
    .. [3] S. Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6
       (1979) 65-70.
    """
    from scipy.stats import rankdata

    values = np.asarray(measure, dtype=float)
    kept = ~np.isnan(values) & parameters.notna().all(axis=1).to_numpy()
    ranks = rankdata(values[kept])
    table, n = parameters[kept], len(ranks)
    table = table.loc[:, table.nunique() > 1]
    # too few flights for ranks
    if n < 10 or ranks.min() == ranks.max() or table.empty:
        return []
    columns = [column for _, column in table.items()]
    rho, p_rho = np.array([_spearman(column, ranks) for column in columns]).T
    share, p_share = np.array([_share(column, ranks) for column in columns]).T
    p_rho, p_share = holm([*p_rho, *p_share]).reshape(2, -1)
    lo, hi = _interval(rho, n, confidence)
    tested = pd.DataFrame(
        {
            "parameter": table.columns,
            "n": n,
            "rho": rho,
            "lo": lo,
            "hi": hi,
            "partial": _partial(table, ranks),
            "share": share,
            "p_rho": p_rho,
            "p_share": p_share,
            "apart": np.minimum(p_rho, p_share) < 1.0 - confidence,
        }
    )
    return sorted(tested.to_dict("records"), key=strength, reverse=True)


def strength(influence: Mapping[str, Any]) -> float:
    """The larger of `share` and the square of `rho`, to nine digits; it orders influences."""
    strengths = [influence["share"], influence["rho"] ** 2]
    # Two parameters that are drawn together have equal shares up to rounding, and keep the order of
    # the campaign.
    return round(max((each for each in strengths if math.isfinite(each)), default=0.0), 9)


def holm(p: npt.ArrayLike) -> FloatArray:
    """P-values corrected together; NaN values are ignored and become 1."""
    values = np.asarray(p, dtype=float)
    tests = np.flatnonzero(~np.isnan(values))
    order = tests[np.argsort(values[tests], kind="stable")]
    factors = np.arange(len(order), 0, -1)
    corrected = np.ones(len(values))
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(values[order] * factors))
    return corrected


def classes_of(column: pd.Series, most: int = CLASSES) -> npt.NDArray[np.intp]:
    """Class of each flight by its value of a parameter, from 0 on, in rising order of numbers."""
    from scipy.stats import rankdata

    codes, distinct = pd.factorize(column, sort=True)
    few = len(distinct) <= most and MIN_IN_CLASS * len(distinct) <= len(column)
    if few or not is_number(column):
        return np.asarray(codes)
    count = max(2, min(most, len(column) // MIN_IN_CLASS))
    return pd.factorize(np.floor((rankdata(column) - 0.5) / len(column) * count), sort=True)[0]


def _spearman(column: pd.Series, ranks: FloatArray) -> Test:
    from scipy.stats import spearmanr

    if not is_number(column):
        return math.nan, math.nan
    correlation: Any = spearmanr(column, ranks)
    return float(correlation.statistic), float(correlation.pvalue)


def _share(column: pd.Series, ranks: FloatArray) -> Test:
    """Epsilon squared less the part explained by chance, and the p-value of Kruskal-Wallis."""
    from scipy.stats import kruskal

    codes = classes_of(column)
    n, k = len(ranks), int(codes.max()) + 1
    if not 1 < k < n:
        return math.nan, math.nan
    H, p = kruskal(*(ranks[codes == label] for label in range(k)))
    return (float(H) - k + 1) / (n - k), float(p)


def _partial(table: pd.DataFrame, ranks: FloatArray) -> FloatArray:
    """Partial rank correlation of every number; k categories are k - 1 indicator columns."""
    numeric = np.array([is_number(column) for _, column in table.items()])
    # numbers come first, in their order, then the indicators
    columns = pd.get_dummies(table, columns=table.columns[~numeric], drop_first=True, dtype=float)
    columns = columns.rank()
    correlations = np.corrcoef(columns.to_numpy().T, ranks)
    partials = np.full(len(numeric), np.nan)
    # collinear ranks have no partial correlations
    if len(ranks) > columns.shape[1] + 2 and np.linalg.cond(correlations) < 1e10:
        inverse = np.linalg.inv(correlations)
        scale = np.sqrt(np.diag(inverse))
        partials[numeric] = (-inverse[-1] / (scale[-1] * scale))[: numeric.sum()]
    return partials


def _interval(rho: FloatArray, n: int, confidence: float) -> tuple[FloatArray, FloatArray]:
    """Intervals of rank correlations, by the normal distribution of their area tangents."""
    half = scipy.special.ndtri(0.5 + 0.5 * confidence) * np.sqrt((1.0 + 0.5 * rho**2) / (n - 3))
    with np.errstate(divide="ignore"):
        middle = np.arctanh(rho)  # infinite if |rho| = 1, which then is both ends
    return np.tanh(middle - half), np.tanh(middle + half)
