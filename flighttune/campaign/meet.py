"""Gains that meet the requirements of scenarios, found by flying them."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import pyarrow as pa

from flighttune.arrays import FloatArray
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.flying.rows import Row
from flighttune.campaign.planning.draws import SEED
from flighttune.campaign.planning.load import campaign_on
from flighttune.campaign.planning.plan import Group, Plan, aircraft_hashes
from flighttune.campaign.planning.schema import MEASURES, CampaignTable
from flighttune.campaign.stated_set import StoppedError, measured_in
from flighttune.campaign.statistics.intervals import share
from flighttune.campaign.statistics.paired import ordered_quantile
from flighttune.control.gains import PIGains
from flighttune.control.law import Law, plain_laws, split_name
from flighttune.control.linear_model import closed_loop
from flighttune.errors import InputError
from flighttune.flight.expectations import BoundCheck, bound_checks, with_loop
from flighttune.flight.outer_loop import gain_set, tuning_problem
from flighttune.plants.label import goes_by
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import TUNED, TUNED_IDENTIFIED, LawTable, in_rad
from flighttune.theory.indicators import indicators_batch
from flighttune.units import DEG

# What is minimised once all requirements are met, if it is no column of the rows: the ITAE of both
# channels, or the largest excess over a requirement
ITAE, MARGIN = "ITAE", "margin"

# Share of the draws of a campaign on which gains must meet all requirements, by default
SUCCESS = 0.95

# Flights of a search by default, without and with a campaign
BUDGET, CAMPAIGN_BUDGET = 400, 6000

# Draws on which each candidate of a search over a campaign is flown, and the least for the count
DRAWS, COUNTED = 32, 200

# Candidates of a generation: enough to keep workers busy, and usual for 4 to 8 gains
POPULATION = 8

# First step of a search in the logarithm of the gains: one candidate in three changes one by 1.3
SPREAD = 0.25

# Relative change of the gains at which a search ends
FINEST = 1e-3

# Excess over a requirement of a flight that was not flown to its end, relative to its bound
LOST = 1e3

# Share of the budget after which requirements that are not all met are taken to conflict
SEARCHED = 0.6

# A requirement is active if it is within this share of the one that is met worst
ACTIVE = 0.02

# Requirements whose trade-offs are searched for
TRADED = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """Gains with every requirement on every draw."""

    gains: PIGains
    excess: FloatArray  # (draws, requirements); relative to the bounds, `LOST` without a value
    checks: tuple[tuple[BoundCheck, ...], ...]  # likewise
    metric: float = math.inf  # sum over the flights of what is minimised

    @property
    def worst(self) -> FloatArray:
        """Largest excess of each draw."""
        return self.excess.max(axis=1)

    @property
    def met(self) -> bool:
        """Whether all requirements are met on all draws."""
        return bool(self.worst.max() <= 0.0)


# What a search minimises
Objective = Callable[[Trial], float]


def plan_to_meet(scenario: Scenario, law: LawTable, table: CampaignTable | None = None) -> Plan:
    """Flights of a scenario by a law, dispersed as the `table` of a campaign says, without gains.

    The requirements are those about all gain sets, and about `TUNED_IDENTIFIED`, in whose place the
    new gains come. InputError where there is none.
    """
    of_tuned = {None, TUNED_IDENTIFIED, *law.law().names_of([TUNED_IDENTIFIED])}
    expect = [
        requirement.model_copy(update={"gains": None, "status": None})
        for requirement in scenario.expect
        if requirement.gains in of_tuned and (requirement.at_most or requirement.at_least)
    ]
    if not expect:
        raise InputError(
            f"{scenario.title}: [[expect]] must bound a measure for all gain sets, or for "
            f"{TUNED_IDENTIFIED}, to be met, got no such bound."
        )
    # The gains of the scenario are not flown: the plan gets numbers.
    changed = {"expect": expect, "gains": ["paper"], "law": [law]}
    table = table or CampaignTable(title=scenario.title, scenario="scenario", runs=1)
    return Plan(
        campaign=campaign_on(table, scenario.model_copy(update=changed), scenario.title),
        gain_sets={},
        groups=(),
        runs=1,
        aircraft=aircraft_hashes(scenario),
    )


class Search:
    """Flies candidates of one law by plans without gains, and keeps all of them.

    The `metric` is `ITAE`, `MARGIN` or a column of the rows, maybe with ``_deg`` in place of
    ``_rad``. With several `draws` of a campaign the share of them on which all requirements are met
    is maximised, and the excess that the share `success` of them keeps is minimised.
    """

    def __init__(
        self,
        plans: Sequence[Plan],
        law: Law,
        pool: WorkerPool,
        *,
        metric: str = ITAE,
        draws: int = 1,
        success: float = 1.0,
    ) -> None:
        if metric not in (ITAE, MARGIN) and in_rad(metric) not in MEASURES:
            raise InputError(
                f"`metric` must be {ITAE}, {MARGIN} or one of {', '.join(MEASURES)} (or _deg in "
                f"place of _rad), got {metric!r}."
            )
        self.flights = self.candidates = 0
        self.trials: dict[PIGains, Trial] = {}
        self._plans, self._law, self._pool, self._metric = plans, law, pool, metric
        self._draws, self._success = draws, success
        self._each = draws * sum(len(_required(plan.scenario)) for plan in plans)
        self._problem = tuning_problem(plans[0].scenario, law)
        self._model = self._problem.model
        with suppress(InputError):  # without an identified aircraft: [tuning]'s
            self._model = plans[0].scenario.identified_models(law)[0].model

    def fly(self, sets: Sequence[PIGains]) -> list[Trial]:
        """Fly candidates in all scenarios; none that is unstable or has been flown before."""
        stable = []
        for gains in dict.fromkeys(sets):
            loop = indicators_batch(closed_loop(self._model, gains))
            if not loop.stable:
                rows = [[{"plant": x} for x in _required(plan.scenario)] for plan in self._plans]
                trial = self._trial(gains, rows)
                # the further right its eigenvalues, the worse
                excess = np.tile(
                    trial.excess + LOST * (1.0 + float(loop.spectral_abscissa)), (self._draws, 1)
                )
                self.trials[gains] = replace(trial, excess=excess)
            elif gains not in self.trials:
                stable.append(gains)
        self.candidates += len(stable)
        flown = [self.rows(plan, stable, self._draws) for plan in self._plans if stable]
        for gains, *rows in zip(stable, *flown, strict=True):
            self.trials[gains] = self._trial(gains, rows)
        return [self.trials[gains] for gains in sets]

    def rows(self, plan: Plan, sets: Sequence[PIGains], draws: int) -> list[list[Row]]:
        """Rows of a plan by candidate, draw by draw."""
        scenario, names = plan.scenario, self._law.names_of([str(i) for i in range(len(sets))])
        plants = _required(scenario)
        groups = tuple(Group(plant, name) for name in names for plant in plants)
        # The requirements are checked by `_trial`: those on the loop once, not in every flight.
        bare = plan.campaign.model_copy(
            update={"nominal": scenario.model_copy(update={"expect": []})}
        )
        flown = dict(zip(names, sets, strict=True))
        plan = replace(plan, campaign=bare, gain_sets=flown, groups=groups)
        n, each = len(groups), len(plants)
        if draws > 1:
            drawn, runs = None, [range(draws * n)]
        else:
            # Each candidate has a draw of its own: workers share draws out, not groups.
            drawn = [{SEED: scenario.seed}] * len(sets)
            runs = [range(i * (n + each), i * (n + each) + each) for i in range(len(sets))]
        plan, tables = plan.with_runs(runs[-1].stop), list[pa.Table]()
        self.flights += sum(map(len, runs))
        if not self._pool.fly_rows(plan, runs, tables.append, doing="searching", draws=drawn):
            raise StoppedError
        rows = pa.concat_tables(tables).sort_by("run").to_pylist()
        return [[row for row in rows if row["gains"] == name] for name in names]

    def _trial(self, gains: PIGains, rows: Sequence[Sequence[Row]]) -> Trial:
        """The checks of rows of each plan; rows without a status are those of gains not flown."""
        (name,) = self._law.names_of(["0"])
        checks: dict[int, list[BoundCheck]] = {}
        metric = 0.0
        for plan, of_plan in zip(self._plans, rows, strict=True):
            loop = with_loop({}, plan.scenario.expect, plan.scenario, name, gains)
            where = f"{plan.scenario.title}: " if len(self._plans) > 1 else ""
            for row in of_plan:
                flown = row.get("status") == "completed"
                tables = plan.scenario.expected(row["plant"], name)
                measured = {**(measured_in(row) if flown else {}), **loop}
                checks.setdefault(row.get("draw", 0) if self._draws > 1 else 0, []).extend(
                    replace(check, flown=flown or check.subject == "loop")
                    for check in bound_checks(tables, measured, where + row["plant"])
                )
                metric += _metric(row, self._metric) if flown else math.inf
        by_draw = tuple(map(tuple, checks.values()))
        excess = [[check.margin if check.flown else LOST for check in of] for of in by_draw]
        finite = np.nan_to_num(np.array(excess), nan=LOST, posinf=LOST)
        return Trial(gains=gains, excess=finite, checks=by_draw, metric=metric)

    def value(self, trial: Trial) -> float:
        """Draws on which a requirement is missed, then by how much; then the metric, below 0."""
        missed = int((trial.worst > 0.0).sum())
        if not missed and self._metric != MARGIN and self._draws == 1:
            return 0.5 * _squeezed(trial.metric) - 0.5
        return missed + 0.5 + 0.5 * _squeezed(float(ordered_quantile(trial.worst, self._success)))

    def best(self, objective: Objective | None = None) -> Trial:
        """The best candidate so far."""
        return min(self.trials.values(), key=objective or self.value)

    def descend(self, trial: Trial, budget: float, objective: Objective | None = None) -> None:
        """Search from a candidate with at most `budget` flights; its gains that are 0 stay so.

        Covariance matrix adaptation (N. Hansen, arXiv 1604.00772) on the logarithms of the gains.
        """
        warnings.filterwarnings("ignore", "Could not import matplotlib")  # of cma
        import cma

        start, objective, largest = trial.gains, objective or self.value, self._problem.K_max
        free, end = start.K != 0.0, self.flights + budget
        assert largest is not None
        top = np.log(largest[free])
        settings = {
            "popsize": POPULATION,
            "seed": self._problem.seed + 1,  # 0 is the time of day
            "tolx": FINEST,
            "bounds": [None, top.tolist()],
            "verbose": -9,
        }
        first = np.minimum(np.log(np.abs(start.K[free])), top)
        strategy = cma.CMAEvolutionStrategy(first, SPREAD, settings)
        while not strategy.stop() and self.flights + POPULATION * self._each <= end:
            asked = strategy.ask()
            trials = self.fly([_with_sizes(start, np.exp(x)) for x in asked])
            strategy.tell(asked, [objective(of_gains) for of_gains in trials])

    def conflicting(self, trial: Trial) -> list[int]:
        """Requirements of one draw that are missed or hold the others off, met worst first."""
        excess = trial.excess[0]
        least = min(excess.max() - ACTIVE, 0.0) if excess.max() > 0.0 else -ACTIVE
        return [int(i) for i in np.argsort(-excess, kind="stable") if excess[i] >= least]

    def trade_offs(self, nearest: Trial, budget: float) -> dict[int, tuple[float, float | None]]:
        """How far each conflicting requirement can come alone, and while the others are met."""
        conflicting = self.conflicting(nearest)[:TRADED]
        ends = {}
        for i in conflicting:

            def alone(trial: Trial, i: int = i) -> float:
                return float(trial.excess[0, i])

            def beside(trial: Trial, i: int = i) -> float:
                missed = np.delete(trial.excess[0], i).max(initial=-LOST)
                return LOST + missed if missed > 0.0 else alone(trial, i)

            for objective in (alone, beside):
                self.descend(self.best(objective), budget / (2 * len(conflicting)), objective)
            with_others = self.best(beside)
            ends[i] = (
                self.best(alone).checks[0][i].value,
                with_others.checks[0][i].value if beside(with_others) < LOST else None,
            )
        return ends


def stated(check: BoundCheck) -> dict[str, Any]:
    """A requirement with its value, as tables and ``--json`` have it."""
    return {
        "run": check.run,
        "measure": f"{check.subject}.{check.measure}",
        "sense": check.sense.replace("_", " "),
        "bound": check.bound,
        "value": check.value if check.flown else math.nan,
        "margin": -check.margin if check.flown else math.nan,
    }


def starting_gains(scenario: Scenario, law: Law) -> dict[str, PIGains]:
    """Gains tuned for a law, and those of a scenario, by name; without what does not exist."""
    sets: dict[str, PIGains] = {}
    listed = [split_name(name)[1] for name in scenario.gain_names]
    for name in dict.fromkeys([TUNED_IDENTIFIED, TUNED, *listed]):
        with suppress(InputError):  # e.g. no aircraft is identified
            gains = gain_set(scenario, law.names_of([name])[0])
            if gains is not None:
                sets[name] = gains
    return sets


def meet(
    scenarios: Sequence[Scenario],
    pool: WorkerPool,
    *,
    start: Mapping[str, PIGains] | None = None,
    budget: int | None = None,
    metric: str = ITAE,
    table: CampaignTable | None = None,
    success: float = SUCCESS,
) -> tuple[dict[str, Any], PIGains, list[Trial]]:
    """Find gains that meet the ``[[expect]]`` of scenarios, by flying candidates.

    Parameters
    ----------
    scenarios : sequence of Scenario
        The law tuned is the first one of the first scenario.
    pool : WorkerPool
        The answer does not depend on the number of workers.
    start : mapping of str to PIGains, optional
        Gains to start from, by name; by default those tuned for the law and those of the scenario.
    budget : int, optional
        Maximum number of flights, by default `BUDGET`, with a campaign `CAMPAIGN_BUDGET`; the count
        on fresh draws comes on top.
    metric : str
        What is minimised once all requirements are met, see `Search`; not with a campaign.
    table : CampaignTable, optional
        Campaign on the first scenario, which is then the only one. Gains are searched for that
        meet the requirements on as many draws as possible, and counted on the draws of the
        campaign, none of which the search has seen.
    success : float, 1
        Share of the draws on which gains must meet all requirements.

    Returns
    -------
    values : dict
        The answer: its ``status`` is ``met`` or ``missed``. ``requirements`` have value, bound, and
        margin relative to the bound; those that are ``active`` hold the others off. On a campaign
        they have the share of draws on which each is met. ``trade_offs`` say how far each of the
        requirements that conflict can come alone, and with the others met (None if they cannot be).
    gains : PIGains
        The best ones, even if they miss a requirement.
    trials : list of Trial
        All candidates.

    Raises
    ------
    InputError
        If nothing is required, the law has no gains, or an argument is out of its range.
    StoppedError
        If the observer of the pool stopped the flights.
    """
    law_table = scenarios[0].law_tables[0]
    law = law_table.law()
    if not law.by_gains:
        raise InputError(
            f"`law` must be {' or '.join(plain_laws())} for its gains to be tuned, got {law.name}."
        )
    if not 0.0 < success <= 1.0:
        raise InputError(f"`success` must be above 0 and at most 1, got {success:g}.")
    if table is not None and metric != ITAE:
        raise InputError(
            f"`metric` must be absent with a campaign, whose share of flights that succeed is "
            f"maximised, got {metric}."
        )
    seen = table and table.model_copy(update={"design": "random", "seed": table.seed + 1})
    plans = [plan_to_meet(scenario, law_table, seen) for scenario in scenarios]
    starts = start or starting_gains(scenarios[0], law)
    if not starts:
        raise InputError("`start` must be given: no gains could be tuned to start from.")
    draws = 1 if table is None else whole_cycles(plans[0], DRAWS)
    search = Search(plans, law, pool, metric=metric, draws=draws, success=success)
    budget = budget or (BUDGET if table is None else CAMPAIGN_BUDGET)
    trials = dict(zip(starts, search.fly([*starts.values()]), strict=True))
    first, *others = sorted(trials, key=lambda name: search.value(trials[name]))
    until = budget if table is not None else SEARCHED * budget
    search.descend(trials[first], until - search.flights)
    for name in others:
        if not search.best().met:
            search.descend(trials[name], until - search.flights)
    traded: dict[int, tuple[float, float | None]] = {}
    if table is None and not search.best().met:
        traded = search.trade_offs(search.best(), budget - search.flights)
    if search.best().met:
        search.descend(search.best(), budget - search.flights)
    best, counted, start_flown = search.best(), None, trials[first]
    met, nearest = best.met, best
    if table is not None:
        plan = plan_to_meet(scenarios[0], law_table, table)
        groups = len(scenarios[0].gain_names) * len(scenarios[0].plant)
        fresh = whole_cycles(plan, max(COUNTED, (table.runs or 0) // groups))
        count = Search([plan], law, pool, draws=fresh)
        nearest, start_flown = count.fly([best.gains, start_flown.gains])
        cycles = np.arange(fresh) // plan.cycle
        counted = [asdict(share(x.worst <= 0.0, cycles)) for x in (nearest, start_flown)]
        met = counted[0]["value"] >= success
        search.flights += count.flights
    values = {
        "status": "met" if met else "missed",
        "start": first,
        "flights": search.flights,
        "candidates": search.candidates,
        "metric": {"name": metric, "value": nearest.metric, "start": start_flown.metric},
        "requirements": [*_requirements(nearest, start_flown, search.conflicting(nearest))],
        "trade_offs": [
            {**stated(best.checks[0][i]), "alone": alone, "beside": beside}
            for i, (alone, beside) in traded.items()
            if not met
        ],
        "success": counted and {"share": counted[0], "of_start": counted[1], "wanted": success},
    }
    return values, best.gains, [*search.trials.values()]


def _requirements(trial: Trial, start: Trial, active: Sequence[int]) -> Iterator[dict[str, Any]]:
    """The requirements with their values on the first draw, and the share of draws they are met."""
    for i, check in enumerate(trial.checks[0]):
        yield {
            **stated(check),
            "active": i in active,
            "start": start.checks[0][i].value,
            "share": float((trial.excess[:, i] <= 0.0).mean()),
            "share_start": float((start.excess[:, i] <= 0.0).mean()),
        }


def whole_cycles(plan: Plan, draws: int) -> int:
    """At least so many draws, in whole cycles of the design."""
    return -(-draws // plan.cycle) * plan.cycle


def _required(scenario: Scenario) -> list[str]:
    """Labels of the plants with requirements; in wind aircraft first: others replay their wind."""
    plants = sorted(scenario.plant, key=lambda x: scenario.windy and x.aircraft is None)
    labels = (plant.label for plant in plants)
    return [label for label in labels if any(goes_by(label, x.plant) for x in scenario.expect)]


def _metric(row: Row, metric: str) -> float:
    if metric == ITAE:
        return row["chi.ITAE"] + row["gamma.ITAE"]
    if metric == MARGIN:
        return math.nan
    value = row[in_rad(metric)]
    if value is None:
        return math.inf
    return value if in_rad(metric) == metric else value / DEG


def _with_sizes(gains: PIGains, sizes: FloatArray) -> PIGains:
    """Gains of other sizes: their signs and zeros stay."""
    K, p = gains.K.copy(), len(gains.errors)
    K[K != 0.0] = np.sign(K[K != 0.0]) * sizes
    return replace(gains, K_P=K[:, :p], K_I=K[:, p:])


def _squeezed(x: float) -> float:
    """A number between -1 and 1 that grows with `x`."""
    return x / (1.0 + abs(x)) if math.isfinite(x) else math.copysign(1.0, x)
