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
    """Gains with their indicators.

    Attributes
    ----------
    name : str
    gains : PIGains
    R_K : float, 1/s
    I_K : float, s^2
        On the model that the scenario's [tuning] names.
    """

    name: str
    gains: PIGains
    R_K: float
    I_K: float


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateResult:
    """Score and success of a gain set, with intervals.

    Attributes
    ----------
    candidate : Candidate
    percentile : Estimate
        Of the score over its draws, with the 95 % interval; infinite where flights were lost.
    success : Estimate, 1
        Part of the draws on which it succeeds on every plant, with the 95 % interval.
    p_best : float, 1
        Part of the resamples in which it is the best candidate; for a dropped candidate the part in
        which it was as good as the leader at that time; NaN for a set that cannot be chosen.
    dropped : bool
        Whether it was dropped before the last draws.
    behind : Estimate
        How far its percentile lies above that of the chosen one: median and 95 % interval over the
        resamples; NaN if it was dropped.
    """

    candidate: Candidate
    percentile: Estimate
    success: Estimate
    p_best: float
    dropped: bool
    behind: Estimate

    @property
    def draws(self) -> int:
        """Number of draws on which it was flown."""
        return self.success.n


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustChoice:
    """Gains that were chosen by flying them.

    Attributes
    ----------
    status : str
        ``chosen``; ``infeasible`` where there is no frontier; ``too_many_lost`` where so many
        flights of every candidate were lost that no percentile is finite; ``too_few_succeed`` where
        no candidate succeeds as often as it must; ``interrupted``.
    reason : str
        A sentence where `status` is not ``chosen``.
    best : CandidateResult or None
        The best candidate, also where it is not good enough.
    p_best : float, 1
        Probability that it is the best candidate on draws like these; NaN without a best one.
    loss : float
        What its percentile lies above that of the best, mean over the resamples.
    candidates : tuple of CandidateResult
        All of the frontier, I_K rising.
    baselines : tuple of CandidateResult
        The campaign's own gain sets, for comparison.
    metrics : tuple of str
        What is added up to the score.
    percentile : float, %
    draws, flights : int
        Draws of those at the end, and flights of all.
    """

    status: Status
    reason: str
    best: CandidateResult | None = None
    p_best: float = float("nan")
    loss: float = float("nan")
    candidates: tuple[CandidateResult, ...] = ()
    baselines: tuple[CandidateResult, ...] = ()
    metrics: tuple[str, ...] = METRICS
    percentile: float = PERCENTILE
    draws: int = 0
    flights: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class RobustSettings:
    """How gains are chosen.

    Attributes
    ----------
    metrics : tuple of str
        Columns of the rows, or with ``_deg`` in place of ``_rad``; their sum is the score, less of
        which is better. A flight that was not completed, or has no value, is worse than any other.
    percentile : float, %
        Of the score that is to be as low as can be.
    least_success : float, 1
        Part of the draws on which the chosen gains must succeed.
    candidates : int
        Points of the frontier.
    draws : int or None
        Draws of those at the end; None for those of the campaign.
    plants : tuple of str
        Labels of the plants to fly; empty for all. A draw's score is that of its worst plant.
    """

    metrics: tuple[str, ...] = METRICS
    percentile: float = PERCENTILE
    least_success: float = 0.0
    candidates: int = CANDIDATES
    draws: int | None = None
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

    Parameters
    ----------
    campaign : Campaign
        Its scenario gives the frontier, its draws and plants the flights; its own gain sets are
        flown as baselines.
    settings : RobustSettings
    pool : WorkerPool
        Flies; its observer may stop it. The choice does not depend on the number of workers.

    Returns
    -------
    RobustChoice

    Raises
    ------
    InputError
        If the campaign has no such plant.
    CampaignError
        If the cluster is gone.
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
    """Gains of the largest R_K for rising I_K, each once.

    Parameters
    ----------
    scenario : Scenario
        Its tuning problem gives the frontier.
    count : int
        Points of the frontier.

    Returns
    -------
    tuple of Candidate
        Named ``frontier-1`` and so on, I_K rising; empty where no stable gains lie within the
        limits of the problem.

    Raises
    ------
    InputError
        If `count` is less than 2.
    """
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
    """The same campaign for other gain sets, with the same draws.

    Parameters
    ----------
    campaign : Campaign
    gains : mapping of str to PIGains
        By name. Requirements on gain sets that are not among them are left out.
    """
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
    """The same campaign on some of its plants.

    Raises
    ------
    InputError
        If it has no such plant.
    """
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

    Parameters
    ----------
    rows : DataFrame
        Of a campaign, every draw flown by all of `names`.
    names : sequence of str
        Gain sets.
    metrics : sequence of str
        Added up to the score.

    Returns
    -------
    scores : ndarray, shape (names, draws)
        Infinite where a flight was not completed or has no value.
    success : ndarray of bool, shape (names, draws)
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
    """How the choice ended, and why where nothing is chosen."""
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
