"""Gains chosen among those of the frontier by what they fly to on the draws of a campaign."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.campaign.choice.candidates import (
    Candidate,
    frontier_candidates,
    on_plants,
    own_candidates,
    with_gains,
)
from flighttune.campaign.choice.choice import Judged, RobustChoice, RobustSettings
from flighttune.campaign.choice.race import Race, Tried, ordered_quantile, race
from flighttune.campaign.engine.cluster import cluster
from flighttune.campaign.engine.crew import Crew
from flighttune.campaign.engine.engine import Onlooker
from flighttune.campaign.intervals import effective_size, quantile_interval, wilson
from flighttune.campaign.planning.make import plan_campaign
from flighttune.campaign.planning.schema import Campaign
from flighttune.campaign.report.paired import scores
from flighttune.scenario.expect_table import in_rad
from flighttune.units import DEG


def tune_robust(
    campaign: Campaign,
    settings: RobustSettings | None = None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    onlooker: Onlooker | None = None,
) -> RobustChoice:
    """Choose gains of the frontier by flying them on the draws of a campaign.

    Parameters
    ----------
    campaign : Campaign
        Its scenario gives the frontier, its draws and plants the flights; its own gain sets are
        flown beside.
    settings : RobustSettings, optional
    workers : int, optional
        Processes on this machine; by default one a core. The choice does not depend on it.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, instead.
    onlooker : Onlooker, optional
        Told how far it is; may stop it.

    Returns
    -------
    RobustChoice

    Raises
    ------
    InputError
        If the campaign has no such plant, or dask.distributed is not installed.
    CampaignError
        If the cluster is gone.
    """
    settings = settings or RobustSettings()
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
    own = own_candidates(campaign.nominal, planned.gain_sets)
    draws = planned.draws if settings.draws is None else settings.draws
    with cluster(workers, scheduler) as hire:
        flown = _Flown(campaign, {one.name: one for one in (*candidates, *own)}, settings, draws,
                       Crew(hire, onlooker))  # fmt: skip
        run = race(
            [one.name for one in candidates],
            flown.fly,
            draws=draws,
            q=settings.percentile / 100.0,
            least_success=settings.least_success,
            beside=[one.name for one in own],
            cycle=planned.cycle,
            seed=campaign.seed,
        )
    return _choice(run, candidates, own, settings, flown, planned.cycle)


@dataclass(slots=True, kw_only=False)
class _Flown:
    """Flies gain sets by name on draws."""

    campaign: Campaign
    gains: Mapping[str, Candidate]
    settings: RobustSettings
    draws: int
    crew: Crew
    ends: Counter[str] = field(default_factory=Counter)

    def fly(self, names: Sequence[str], first: int, end: int) -> Tried | None:
        """Scores and success of some gain sets on draws, both of shape (names, draws)."""
        flown = {name: self.gains[name].gains for name in names}
        plan = plan_campaign(with_gains(self.campaign, flown), runs=1)
        each = len(plan.groups)
        plan = plan.with_runs(each * self.draws)
        table = self.crew.fly(
            plan, each * first, each * end,
            doing=f"flying {len(names)} gain sets on draws {first} to {end}",
        )  # fmt: skip
        if table is None:
            return None
        rows = table.to_pandas()
        early = rows.loc[(rows["status"] != "completed").to_numpy()]
        self.ends.update(
            f"{status}: {reason}"
            for status, reason in zip(early["status"], early["reason"], strict=True)
        )
        return scored(rows, names, self.settings.metrics)

    def lost(self) -> str:
        """How flights most often ended that were not completed, as a sentence."""
        ended = self.ends.most_common(1)
        if not ended:
            return "all were completed, but have no value of the metric"
        return f"{self.ends.total()} flights were not completed, as {ended[0][0]}"


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


def _choice(
    run: Race | None,
    candidates: Sequence[Candidate],
    own: Sequence[Candidate],
    settings: RobustSettings,
    flown: _Flown,
    cycle: int,
) -> RobustChoice:
    if run is None:
        return RobustChoice(status="interrupted", reason="it was stopped before the first draws")
    told = {
        one.name: _judged(one, run, settings.percentile / 100.0, cycle)
        for one in (*candidates, *own)
    }
    best = told[run.best]
    status, reason = "chosen", ""
    if not run.finished:
        status, reason = "interrupted", "it was stopped before all draws had been flown"
    elif not np.isfinite(best.percentile):
        status = "too_many_lost"
        reason = (
            f"flights must be completed on {settings.percentile:g} % of the draws for that "
            f"percentile, got fewer with every candidate; {flown.lost()}"
        )
    elif best.success < settings.least_success:
        status = "too_few_succeed"
        reason = (
            f"the gains must succeed on {settings.least_success:.1%} of the draws, the best of "
            f"{len(candidates)} candidates does on {best.success:.1%}"
        )
    return RobustChoice(
        status=status, reason=reason, best=best, p_best=run.p_best, loss=run.loss,
        candidates=tuple(told[one.name] for one in candidates),
        own=tuple(told[one.name] for one in own), metrics=settings.metrics,
        percentile=settings.percentile, draws=best.draws, flights=flown.crew.flights,
    )  # fmt: skip


def _judged(one: Candidate, run: Race, q: float, cycle: int) -> Judged:
    values, good = run.scores[one.name], run.success[one.name]
    clusters = np.arange(len(values)) // cycle
    value = float(ordered_quantile(values, q))
    lo, hi = quantile_interval(values, q, effective=effective_size(values <= value, clusters))
    success_lo, success_hi = _share(good, clusters)
    behind = run.differences.get(one.name)
    dropped = one.name in run.dropped
    nothing = (np.nan,) * 3
    return Judged(
        candidate=one, draws=len(values), percentile=value, lo=lo, hi=hi,
        success=float(np.mean(good)), success_lo=success_lo, success_hi=success_hi,
        p_best=run.dropped[one.name] if dropped else run.wins.get(one.name, np.nan),
        dropped=dropped,
        **dict(zip(
            ("behind", "behind_lo", "behind_hi"),
            nothing if dropped or behind is None else _middle(behind), strict=True,
        )),
    )  # fmt: skip


def _share(good: npt.NDArray[np.bool_], clusters: npt.NDArray[np.intp]) -> tuple[float, float]:
    size = effective_size(good, clusters)
    lo, hi = wilson(np.mean(good) * size, size)
    return float(lo), float(hi)


def _middle(values: FloatArray) -> tuple[float, float, float]:
    low, middle, high = (float(ordered_quantile(values, q)) for q in (0.025, 0.5, 0.975))
    return middle, low, high
