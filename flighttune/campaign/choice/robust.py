"""Gains of the frontier, chosen by flying them on the draws of a campaign."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import pandas as pd
import pyarrow as pa

from flighttune.arrays import check_at_least, check_between
from flighttune.campaign.choice.race import Race, Tried, race
from flighttune.campaign.dataset import Span
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.campaign.planning.schema import MEASURES, Campaign, CertificateTable
from flighttune.campaign.statistics.intervals import (
    Estimate,
    effective_size,
    not_above,
    quantile_interval,
    share,
)
from flighttune.campaign.statistics.paired import ordered_quantile, scores
from flighttune.control.gains import PIGains
from flighttune.control.law import plain_laws, split_name
from flighttune.errors import InputError
from flighttune.flight.outer_loop import tuning_problem
from flighttune.plants.label import goes_by
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import in_rad
from flighttune.tuning.frontier import frontier
from flighttune.tuning.result import assessment
from flighttune.units import DEG

Status: TypeAlias = Literal[
    "chosen", "infeasible", "too_many_lost", "too_few_succeed", "interrupted"
]

CANDIDATES = 12
PERCENTILE = 95.0
METRICS = ("chi.ITAE",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """Gains with their indicators on the model that the scenario's [tuning] names."""

    name: str
    gains: PIGains
    R_K: float  # 1/s
    I_K: float  # s^2


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateResult:
    """Score and success of a gain set, with intervals of 95 %."""

    candidate: Candidate
    percentile: Estimate  # percentile of the score; infinite where flights were lost
    success: Estimate  # share of the draws on which the set succeeds on every plant
    # 1; share of resamples won. Of a dropped candidate: probability of being as good as the leader
    # when it was dropped. NaN for a baseline.
    p_best: float
    dropped: bool  # before the last draws
    # percentile less that of the chosen set, median over the resamples; NaN if dropped
    behind: Estimate

    @property
    def draws(self) -> int:
        """Number of draws on which it was flown."""
        return self.success.n


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustChoice:
    """Gains that were chosen by flying them."""

    status: Status  # infeasible: no frontier; too_many_lost: no finite percentile
    reason: str  # a sentence unless the status is chosen
    best: CandidateResult | None = None  # the best candidate, also where it is not good enough
    p_best: float = float("nan")  # 1; probability that it is the best on draws like these
    loss: float = float("nan")  # mean over the resamples of its percentile less that of the winner
    candidates: tuple[CandidateResult, ...] = ()  # the whole frontier, I_K rising
    baselines: tuple[CandidateResult, ...] = ()  # the campaign's own gain sets
    metrics: tuple[str, ...] = METRICS  # columns that the score adds up
    percentile: float = PERCENTILE  # %
    draws: int = 0  # draws of the candidates that remained to the end
    flights: int = 0  # flights of all candidates and baselines


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustSettings:
    """Settings of the choice of gains."""

    # Columns of the rows, or with _deg in place of _rad. Their sum is the score to minimise; a
    # flight that was not completed, or has no value, is worse than any other.
    metrics: tuple[str, ...] = METRICS
    percentile: float = PERCENTILE  # %, percentile of the score to minimise
    least_success: float = 0.0  # 1; minimum success rate of the chosen gains
    candidates: int = CANDIDATES  # points of the frontier
    draws: int | None = None  # None for all draws of the campaign
    # labels of the plants to fly, empty for all; the worst plant scores a draw
    plants: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.metrics:
            if in_rad(name) not in MEASURES:
                raise InputError(
                    f"`metric` must be one of {', '.join(MEASURES)} (or _deg in place of _rad), "
                    f"got {name!r}."
                )
        if not self.metrics:
            raise InputError("`metric` must be given, got nothing.")
        check_between(0.0, 100.0, percentile=self.percentile)
        if not 0.0 <= self.least_success <= 1.0:
            raise InputError(f"`min_success` must be 0 to 1, got {self.least_success:g}.")
        check_at_least(1, draws=self.draws)


def tune_robust(campaign: Campaign, settings: RobustSettings, pool: WorkerPool) -> RobustChoice:
    """Choose gains of the frontier by flying them on the draws of a campaign.

    The campaign's own gain sets are flown as baselines. The choice does not depend on the number
    of workers.
    """
    laws = campaign.nominal.laws
    if len(laws) > 1 or not all(law.by_gains for law in laws):
        raise InputError(
            f"`law` must be {' or '.join(plain_laws())}, one of them alone, for a campaign to "
            f"choose gains, got {', '.join(law.name for law in laws)}."
        )
    if settings.plants:
        campaign = on_plants(campaign, settings.plants)
    candidates = frontier_candidates(campaign.nominal, settings.candidates)
    if not candidates:
        return RobustChoice(
            status="infeasible",
            reason="no stable gains lie within the limits of the scenario's tuning; "
            "`flighttune tune` says what they would have to be",
        )
    planned = plan_campaign(campaign)
    baselines = own_candidates(campaign.nominal, planned.gain_sets)
    gain_sets = {candidate.name: candidate.gains for candidate in (*candidates, *baselines)}
    draws = planned.draws if settings.draws is None else settings.draws
    early_ends: Counter[str] = Counter()

    def fly(names: Sequence[str], first: int, end: int) -> Tried | None:
        plan = plan_campaign(with_gains(campaign, {name: gain_sets[name] for name in names}))
        each = len(plan.groups)
        plan, span = plan.with_runs(each * draws), Span(each * first, each * end)
        doing = f"flying {len(names)} gain sets on draws {first} to {end}"
        tables: list[pa.Table] = []
        if not pool.fly_rows(plan, [span], tables.append, doing=doing):
            return None
        rows = pa.concat_tables(tables).sort_by("run").to_pandas()
        rows["gains"] = [split_name(name)[1] for name in rows["gains"]]
        early = rows.loc[(rows["status"] != "completed").to_numpy(), ["status", "reason"]]
        early_ends.update(": ".join(ending) for ending in early.to_numpy().tolist())
        return scored(rows, names, settings.metrics)

    run = race(
        [candidate.name for candidate in candidates],
        fly,
        draws=draws,
        q=settings.percentile / 100.0,
        least_success=settings.least_success,
        baselines=[baseline.name for baseline in baselines],
        cycle=planned.cycle,
        seed=campaign.seed,
    )
    if run is None:
        return RobustChoice(status="interrupted", reason="it was stopped before the first draws")
    results = {
        candidate.name: _result(candidate, run, settings, planned.cycle)
        for candidate in (*candidates, *baselines)
    }
    best = results[run.best]
    status, reason = _status(run, best, settings, early_ends)
    return RobustChoice(
        status=status,
        reason=reason,
        best=best,
        p_best=run.p_best,
        loss=run.loss,
        candidates=tuple(results[candidate.name] for candidate in candidates),
        baselines=tuple(results[baseline.name] for baseline in baselines),
        metrics=settings.metrics,
        percentile=settings.percentile,
        draws=best.draws,
        flights=pool.flown,
    )


def frontier_candidates(scenario: Scenario, count: int) -> tuple[Candidate, ...]:
    """Gains of the largest R_K for rising I_K, each once; empty if none is stable."""
    problem = tuning_problem(scenario)
    inputs, errors = problem.model.inputs, problem.model.errors
    candidates: list[Candidate] = []
    for row in frontier(problem, points=count).to_dict("records"):
        K_P, K_I = (
            np.array(
                [[row[f"{kind}[{channel},{error}]"] for error in errors] for channel in inputs]
            )
            for kind in ("K_P", "K_I")
        )
        gains = PIGains(K_P=K_P, K_I=K_I, inputs=inputs)
        if all(gains != candidate.gains for candidate in candidates):
            name = f"frontier-{len(candidates) + 1}"
            candidates.append(Candidate(name=name, gains=gains, R_K=row["R_K"], I_K=row["I_K"]))
    return tuple(candidates)


def own_candidates(
    scenario: Scenario, gain_sets: Mapping[str, PIGains | None]
) -> tuple[Candidate, ...]:
    """The gain sets of a campaign, to be compared with; without those that tuning did not find.

    Named as ``gains`` lists them, whatever the law.
    """
    problem = tuning_problem(scenario)
    candidates = []
    for name, gains in gain_sets.items():
        if gains is not None:
            assessed = assessment(problem, gains.K)
            own = split_name(name)[1]
            candidates.append(Candidate(name=own, gains=gains, R_K=assessed.R_K, I_K=assessed.I_K))
    return tuple(candidates)


def with_gains(campaign: Campaign, gains: Mapping[str, PIGains]) -> Campaign:
    """The same draws for other gain sets; requirements on sets that are not among them go."""
    tables = [GainsTable(name=name, **gain_set.as_lists()) for name, gain_set in gains.items()]
    names = [name for law in campaign.nominal.laws for name in law.names_of(list(gains))]

    def changed(scenario: Scenario) -> Scenario:
        expect = [
            requirement for requirement in scenario.expect if requirement.gains in (None, *names)
        ]
        return scenario.model_copy(update={"gains": tables, "expect": expect})

    return campaign.model_copy(
        update={
            "gains": tables,
            "success": [
                requirement
                for requirement in campaign.success
                if requirement.gains in (None, *names)
            ],
            # with a bound given no flight is needed to measure one; nobody reads this claim
            "certificate": CertificateTable(L_d_rad_s2=1.0),
            "nominal": changed(campaign.nominal),
            "central": changed(campaign.central),
        }
    )


def on_plants(campaign: Campaign, plants: Sequence[str]) -> Campaign:
    """The same campaign on some of its plants."""
    labels = [plant.label for plant in campaign.nominal.plant]
    for wanted in plants:
        if wanted not in labels:
            raise InputError(f"`plant` must be one of {', '.join(labels)}, got {wanted!r}.")

    def changed(scenario: Scenario) -> Scenario:
        kept = [plant for plant in scenario.plant if plant.label in plants]
        expect = [x for x in scenario.expect if any(goes_by(plant, x.plant) for plant in plants)]
        return scenario.model_copy(update={"plant": kept, "expect": expect})

    nominal, central = changed(campaign.nominal), changed(campaign.central)
    return campaign.model_copy(update={"plant": None, "nominal": nominal, "central": central})


def scored(rows: pd.DataFrame, names: Sequence[str], metrics: Sequence[str]) -> Tried:
    """Scores and success of gain sets on every draw, both of the worst plant.

    Both have shape (names, draws); a score is infinite where a flight was not completed or has no
    value. Every draw must have been flown by all of `names`.
    """
    score = sum(
        scores(rows, in_rad(name)) / (DEG if name.endswith("_deg") else 1.0) for name in metrics
    )
    draws = rows["draw"].to_numpy()
    place = draws - draws.min()
    who = np.array([list(names).index(name) for name in rows["gains"].tolist()])
    worst = np.full((len(names), int(place.max()) + 1), -np.inf)
    np.maximum.at(worst, (who, place), score)
    all_good = np.ones(worst.shape, dtype=bool)
    np.logical_and.at(all_good, (who, place), rows["success"].to_numpy(dtype=bool, na_value=False))
    return worst, all_good


def _status(
    run: Race, best: CandidateResult, settings: RobustSettings, early_ends: Counter[str]
) -> tuple[Status, str]:
    """Status of the choice, and the reason where nothing is chosen."""
    if not run.finished:
        return "interrupted", "it was stopped before all draws had been flown"
    if not np.isfinite(best.percentile.value):
        ends = "all were completed, but have no value of the metric"
        for end, _ in early_ends.most_common(1):
            ends = f"{early_ends.total()} flights were not completed, as {end}"
        return "too_many_lost", (
            f"flights must be completed on {settings.percentile:g} % of the draws for that "
            f"percentile, got fewer with every candidate; {ends}"
        )
    if best.success.value < settings.least_success:
        count = len(run.wins) + len(run.dropped)
        return "too_few_succeed", (
            f"the gains must succeed on {settings.least_success:.1%} of the draws, the best of "
            f"{count} candidates does on {best.success.value:.1%}"
        )
    return "chosen", ""


def _result(
    candidate: Candidate, run: Race, settings: RobustSettings, cycle: int
) -> CandidateResult:
    """The results of a candidate or baseline, with intervals."""
    values, q = run.scores[candidate.name], settings.percentile / 100.0
    n, clusters = len(values), np.arange(len(values)) // cycle
    value = float(ordered_quantile(values, q))
    lo, hi = quantile_interval(
        values, q, effective=effective_size(not_above(values, value), clusters)
    )
    dropped = candidate.name in run.dropped
    above = run.differences.get(candidate.name, np.array([np.nan]))
    median, low, high = (float(ordered_quantile(above, p)) for p in (0.5, 0.025, 0.975))
    return CandidateResult(
        candidate=candidate,
        percentile=Estimate(value=value, lo=lo, hi=hi, n=n),
        success=share(run.success[candidate.name], clusters),
        p_best=run.dropped[candidate.name] if dropped else run.wins.get(candidate.name, np.nan),
        dropped=dropped,
        behind=Estimate(value=median, lo=low, hi=high, n=n),
    )
