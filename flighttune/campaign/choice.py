"""Gains of the frontier, chosen by flying them on the draws of a campaign."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from flighttune.arrays import FloatArray, check_at_least, check_between
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.planning.plan import on_plants, plan_campaign
from flighttune.campaign.planning.schema import MEASURES, Campaign
from flighttune.campaign.stated_set import rows_of
from flighttune.campaign.statistics.intervals import (
    effective_size,
    not_above,
    quantile_interval,
    share,
)
from flighttune.campaign.statistics.paired import difference, ordered_quantile, scores
from flighttune.control.gains import PIGains
from flighttune.control.law import plain_laws, split_name
from flighttune.errors import InputError
from flighttune.flight.outer_loop import tuning_problem
from flighttune.scenario.schema import GainsTable, Scenario
from flighttune.scenario.tables import ExpectTable, in_rad
from flighttune.tuning.frontier import frontier
from flighttune.tuning.problem import TuningProblem
from flighttune.tuning.result import assessment
from flighttune.units import DEG

# Values of the chosen candidate that stand at the top of the answer.
OF_BEST = (
    *("name", "K_P", "K_I", "R_K", "I_K"),
    *("value", "interval", "success", "success_interval", "p_best"),
)

RESAMPLES = 1000


def tune_robust(
    campaign: Campaign,
    pool: WorkerPool,
    *,
    metrics: Sequence[str] = ("chi.ITAE",),
    percentile: float = 95.0,
    least_success: float = 0.0,
    candidates: int = 12,
    draws: int | None = None,
    plants: Sequence[str] = (),
) -> tuple[dict[str, Any], PIGains | None]:
    """Choose gains of the frontier by flying them on the draws of a campaign.

    Parameters
    ----------
    campaign : Campaign
        Its own gain sets are flown as baselines.
    pool : WorkerPool
        The choice does not depend on the number of workers.
    metrics : sequence of str
        Columns of the rows, or with ``_deg`` in place of ``_rad``. Their sum is the score to
        minimise; a flight that was not completed, or has no value, is worse than any other.
    percentile : float, %
        Percentile of the score to minimise.
    least_success : float, 1
        Minimum success rate: among candidates below it, the one with the higher rate wins.
    candidates : int
        Points of the frontier.
    draws : int, optional
        Number of draws; by default all of the campaign.
    plants : sequence of str
        Labels of the plants to fly, empty for all; the worst plant scores a draw.

    Returns
    -------
    values : dict
        The answer. Its ``status`` is ``chosen``, ``infeasible`` (there is no frontier),
        ``too_many_lost`` (no percentile is finite) or ``too_few_succeed``; ``candidates`` are the
        whole frontier, I_K rising, and ``beside`` the baselines; ``loss`` is the mean over the
        resamples of the percentile of the best less that of the winner.
    gains : PIGains or None
        The best candidate, even if it is not good enough.

    Raises
    ------
    InputError
        If an argument is out of its range, or the campaign has several laws or one without gains.
    StoppedError
        If the observer of the pool stopped the flights.
    """
    for name in metrics or ("nothing",):
        if in_rad(name) not in MEASURES:
            raise InputError(
                f"`metric` must be one of {', '.join(MEASURES)} (or _deg in place of _rad), "
                f"got {name!r}."
            )
    check_between(0.0, 100.0, percentile=percentile)
    if not 0.0 <= least_success <= 1.0:
        raise InputError(f"`min_success` must be 0 to 1, got {least_success:g}.")
    check_at_least(1, draws=draws)
    campaign = _on_plants(campaign, plants)
    problem = tuning_problem(campaign.nominal)
    frontier_sets = frontier_gains(problem, candidates)
    answer: dict[str, Any] = {
        "status": "infeasible",
        "reason": "no stable gains lie within the limits of the scenario's tuning; "
        "`flighttune tune` says what they would have to be",
        **dict.fromkeys((*OF_BEST, "loss")),
        "metrics": metrics,
        "percentile": percentile,
        **dict.fromkeys(("draws", "flights"), 0),
        **dict.fromkeys(("candidates", "beside"), ()),
    }
    if not frontier_sets:
        return answer, None
    planned = plan_campaign(campaign)
    own = {name: gains for name, gains in planned.gain_sets.items() if gains is not None}
    sets = frontier_sets | {split_name(name)[1]: gains for name, gains in own.items()}
    plan = plan_campaign(with_gains(campaign, sets))
    draws = planned.draws if draws is None else draws
    doing = f"flying {len(sets)} gain sets on {draws} draws"
    rows = rows_of(pool, plan.with_runs(len(plan.groups) * draws), doing).to_pandas()
    rows["gains"] = [split_name(name)[1] for name in rows["gains"]]
    q = percentile / 100.0
    values, good = scored(rows, list(sets), metrics)
    compared = resampled(
        values,
        good,
        len(frontier_sets),
        q=q,
        least=least_success,
        cycle=planned.cycle,
        seed=campaign.seed,
    )
    wins = [*compared.wins.tolist(), *[np.nan] * (len(sets) - len(frontier_sets))]
    results = []
    for i, (name, gains) in enumerate(sets.items()):
        measured = assessment(problem, gains.K)
        own_values = {"name": name, **gains.as_lists(), "R_K": measured.R_K, "I_K": measured.I_K}
        score = _result(values[i], good[i], wins[i], compared.behind[i], q, planned.cycle)
        results.append(own_values | score)
    best = results[compared.best]
    status, reason = "chosen", ""
    if not np.isfinite(best["value"]):
        early = rows.loc[rows["status"] != "completed", ["status", "reason"]]
        ends = Counter(": ".join(ending) for ending in early.to_numpy().tolist())
        most = f", most of them {ends.most_common(1)[0][0]}" if ends else ""
        status = "too_many_lost"
        reason = (
            f"flights must be completed on {percentile:g} % of the draws for that percentile, got "
            f"fewer with every candidate: {len(early)} of {len(rows)} flights were not completed"
            f"{most}"
        )
    elif best["success"] < least_success:
        status = "too_few_succeed"
        reason = (
            f"the gains must succeed on {least_success:.1%} of the draws, the best of "
            f"{len(frontier_sets)} candidates succeeds on {best['success']:.1%}"
        )
    return answer | {
        **{key: best[key] for key in OF_BEST},
        "status": status,
        "reason": reason,
        "loss": compared.loss,
        "draws": draws,
        "flights": len(rows),
        "candidates": results[: len(frontier_sets)],
        "beside": results[len(frontier_sets) :],
    }, sets[best["name"]]


def _on_plants(campaign: Campaign, plants: Sequence[str]) -> Campaign:
    """The campaign with some of its plants; refuses one whose gains cannot be chosen."""
    laws = campaign.nominal.laws
    if len(laws) > 1 or not all(law.by_gains for law in laws):
        raise InputError(
            f"`law` must be {' or '.join(plain_laws())}, one of them alone, for a campaign to "
            f"choose gains, got {', '.join(law.name for law in laws)}."
        )
    labels = [plant.label for plant in campaign.nominal.plant]
    for plant in plants:
        if plant not in labels:
            raise InputError(f"`plant` must be one of {', '.join(labels)}, got {plant!r}.")
    if not plants:
        return campaign
    nominal, central = (
        on_plants(scenario, plants) for scenario in (campaign.nominal, campaign.central)
    )
    return campaign.model_copy(update={"plant": None, "nominal": nominal, "central": central})


class Resampled(NamedTuple):
    """Gain sets compared by resampling the draws, the same draws for all."""

    best: int  # lowest percentile among the candidates that succeed often enough, if any does
    wins: FloatArray  # (candidates,), 1; share of resamples that each wins
    loss: float  # mean over the resamples of the percentile of the best less that of the winner
    behind: FloatArray  # (sets, resamples); percentile of each set less that of the best


def resampled(
    values: FloatArray,
    good: npt.NDArray[np.bool_],
    candidates: int,
    *,
    q: float,
    least: float = 0.0,
    cycle: int = 1,
    seed: int = 0,
) -> Resampled:
    """Compare gain sets by a quantile of their scores, by a paired bootstrap of the draws.

    `values` and `good` have the shape (sets, draws); the first sets are the candidates, the others
    cannot be chosen. `least` is the minimum success rate: among candidates below it, the one with
    the higher rate wins. Draws are resampled with replacement, whole cycles at a time.
    """

    def ranked(at: npt.NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
        lack = np.maximum(0.0, least - good[:, at].mean(axis=-1))
        return lack, ordered_quantile(values[:, at], q)

    def winners(lack: FloatArray, size: FloatArray) -> npt.NDArray[np.intp]:
        """Index of the smallest lack, then of the smallest size, then the first."""
        # the last key of `lexsort` is its primary one
        return np.lexsort((size[:candidates], lack[:candidates]), axis=0)[0]

    n = values.shape[1]
    cycles, length = max(1, n // cycle), min(cycle, n)
    best = int(winners(*ranked(np.arange(n))))
    # a random stream apart from that of the draws
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,)))
    numbers = (rng.integers(cycles, size=(cycles, 1)) for _ in range(RESAMPLES))
    parts = [ranked((picked * length + np.arange(length)).ravel()) for picked in numbers]
    lack, size = (np.column_stack(each) for each in zip(*parts, strict=True))
    first_of_all, behind = winners(lack, size), difference(size, size[best])
    lost = -np.take_along_axis(behind, first_of_all[None], axis=0)[0]
    return Resampled(
        best=best,
        wins=np.bincount(first_of_all, minlength=candidates) / RESAMPLES,
        loss=float(np.mean(np.maximum(lost, 0.0))),
        behind=behind,
    )


def frontier_gains(problem: TuningProblem, count: int) -> dict[str, PIGains]:
    """Gains of the frontier, I_K rising, without duplicates; empty if none is stable."""
    sets: dict[str, PIGains] = {}
    for row in frontier(problem, points=count).to_dict("records"):
        gains = problem.gains(np.vectorize(row.get)(problem.gain_names))
        if all(gains != other for other in sets.values()):
            sets[f"frontier-{len(sets) + 1}"] = gains
    return sets


def with_gains(campaign: Campaign, gains: Mapping[str, PIGains]) -> Campaign:
    """The campaign with other gain sets, the same draws, and no requirements on the old sets."""
    tables = [GainsTable(name=name, **gain_set.as_lists()) for name, gain_set in gains.items()]
    names = [name for law in campaign.nominal.laws for name in law.names_of(list(gains))]

    def kept(expect: Sequence[ExpectTable]) -> list[ExpectTable]:
        return [requirement for requirement in expect if requirement.gains in (None, *names)]

    def changed(scenario: Scenario) -> Scenario:
        return scenario.model_copy(update={"gains": tables, "expect": kept(scenario.expect)})

    return campaign.model_copy(
        update={
            "gains": tables,
            "success": kept(campaign.success),
            "nominal": changed(campaign.nominal),
            "central": changed(campaign.central),
        }
    )


def scored(
    rows: pd.DataFrame, names: Sequence[str], metrics: Sequence[str]
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Score and success of each gain set on every draw, both those of the worst plant.

    Both have shape (names, draws); a score is infinite where a flight was not completed or has no
    value. Every draw must have been flown by all of `names`.
    """
    score = sum(
        scores(rows, in_rad(name)) / (DEG if name.endswith("_deg") else 1.0) for name in metrics
    )
    by_draw = rows.assign(score=score).groupby(["gains", "draw"])
    worst, all_good = (
        of_draw.unstack().loc[list(names)].to_numpy()
        for of_draw in (by_draw["score"].max(), by_draw["success"].all())
    )
    return worst, all_good


def _result(
    values: FloatArray,
    good: npt.NDArray[np.bool_],
    p_best: float,
    behind: FloatArray,
    q: float,
    cycle: int,
) -> dict[str, Any]:
    """Score and success of a gain set, with intervals of 95 %; `p_best` is NaN for a baseline.

    ``behind`` is the percentile less that of the chosen set, the median over the resamples.
    """
    clusters = np.arange(len(values)) // cycle
    value = float(ordered_quantile(values, q))
    effective = effective_size(not_above(values, value), clusters)
    success = share(good, clusters)
    median, low, high = (float(ordered_quantile(behind, p)) for p in (0.5, 0.025, 0.975))
    return {
        "draws": len(values),
        "value": value,
        "interval": quantile_interval(values, q, effective=effective),
        "success": success.value,
        "success_interval": (success.lo, success.hi),
        "p_best": p_best,
        "behind": median,
        "behind_interval": (low, high),
    }
