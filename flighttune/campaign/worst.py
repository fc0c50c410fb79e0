"""The worst flight of a stated set, searched for, and the probability of a rare miss."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
from scipy.special import chdtri, ndtr

from flighttune.arrays import FloatArray
from flighttune.campaign.bang_bang import search_bang_bang
from flighttune.campaign.dataset import Span
from flighttune.campaign.engine.pool import WorkerPool
from flighttune.campaign.flying.refly import scenario_of_run
from flighttune.campaign.flying.rows import Drawn, Probes
from flighttune.campaign.planning.draws import LARGEST_POINT, SEED, SMALLEST_POINT, correlated
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.campaign.planning.schema import MEASURES
from flighttune.campaign.stated_set import planned
from flighttune.errors import InputError
from flighttune.guarantee.bounds import ERRORS, Bounds
from flighttune.scenario.load import scenario_from
from flighttune.scenario.schema import Scenario
from flighttune.scenario.tables import in_rad
from flighttune.simulate.run import Run
from flighttune.units import DEG

MARGIN = "margin"
"""Metric: largest excess over a requirement relative to its bound; 0 just meets it."""

TUBE = "tube"
"""Metric: share of a tube that the errors use; beyond 1 they leave it."""

REGION = 0.999
"""Share of the stated distribution inside the region searched."""

POPULATION = 32
"""Flights of a generation: enough to keep workers busy."""

SEEDS_EVERY = 6
"""Every this many generations the worst draw so far is flown with other seeds."""

SPREAD = 0.5
"""First step of a search about the worst draw so far, in standard deviations."""

FAILED = 1e3
"""Value of a flight that was not flown to its end, beyond all others."""

LEVEL = 0.1
"""Share of the flights of a level of subset simulation from which the next level starts."""

STRIDE = 0.6
"""Step of the chains of subset simulation, in standard deviations; 1 is an independent draw."""


Seeds = npt.NDArray[np.int64]

Evaluate = Callable[[FloatArray, Seeds], FloatArray]
"""Values of the metric for n draws, larger is worse. The arguments are normal scores before
correlation, shape (n, d), and seeds, shape (n,)."""


class _StoppedError(Exception):
    """The observer stopped the flights."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstSettings:
    """Scope and budget of a search."""

    budget: int = 2000  # maximum number of flights
    # A column of the rows, such as chi.ITAE, or margin. By default the margin where there are
    # requirements with bounds, else chi.ITAE; with a tube it is always tube.
    metric: str | None = None
    tube: Bounds | None = None  # the search maximises the share of this tube that a flight uses
    gains: str | None = None  # by default tuned_identified, or else the first
    plant: str | None = None  # by default the first
    completed: bool = False  # consider only completed flights; otherwise lost ones are the worst
    start_deg: float = 0.0  # deg; range of the starts of a scenario
    disturbance: float = 0.0  # rad/s; largest disturbance of the two rates of a scenario
    seed: int = 1  # seed of the search

    def __post_init__(self) -> None:
        if self.budget < POPULATION:
            raise InputError(f"`budget` must be at least {POPULATION} flights, got {self.budget}.")
        if self.tube is not None and self.metric is not None:
            raise InputError("`metric` must not be given with a tube: it is the distance from it.")
        if self.metric not in (None, MARGIN, *MEASURES):
            raise InputError(
                f"`metric` must be {MARGIN} or one of {', '.join(MEASURES)}, got {self.metric!r}."
            )
        for name in ("start_deg", "disturbance"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"`{name}` must not be negative, got {value}.")


@dataclass(frozen=True, slots=True, kw_only=True)
class WorstFlight:
    """The worst flight of a search."""

    metric: str
    value: float  # of the metric; infinite where the flight ended early
    first: float  # worst value of the first generation, which are draws from the distribution
    flights: int  # number of flights of the search
    group: Group
    family: str | None  # of the disturbance: bang_bang or square_wave; None without a disturbance
    # dispersed keys and seed; for a bang-bang disturbance also its amplitudes and switching times
    drawn: Mapping[str, Any]
    # from the median, in standard normal space; None for a bang-bang disturbance
    distance: float | None
    radius: float | None  # of the region searched, in that space
    status: str
    missed: str  # requirements that the flight does not meet
    # (2,); largest distance from the middle of the tube over the largest half width
    reach: FloatArray | None
    scenario: Scenario  # this flight alone, which ``flighttune fly`` flies


@dataclass(frozen=True, slots=True, kw_only=True)
class RareMiss:
    """Probability of a miss by subset simulation."""

    metric: str
    threshold: float  # a flight misses from this value on
    probability: float  # 1
    low: float  # 95 % interval as a log-normal one; an estimate of 0 has only an upper end
    high: float
    variation: float  # coefficient of variation of the estimate
    levels: tuple[float, ...]  # values that the levels began at, the threshold last
    flights: int  # number of flights of the search


def find_worst(source: str, settings: WorstSettings, pool: WorkerPool) -> WorstFlight | None:
    """Search the stated set of a campaign or scenario for its worst flight.

    Parameters
    ----------
    source : str
        Folder of a campaign, a campaign file, a scenario file, or the name of a shipped one.
    settings : WorstSettings
    pool : WorkerPool
        Workers that fly; the observer of the pool may stop the search.

    Returns
    -------
    WorstFlight or None
        None if the observer stopped the search.

    Raises
    ------
    InputError, ScenarioError
        If source, gains, plant or metric do not exist, nothing is dispersed, or cma is missing.

    Notes
    -----
    Evolution strategy with covariance matrix adaptation [1]_ on the normal scores of the dispersed
    keys; the first generation is drawn from their distribution. The region is the ball that holds
    the share `REGION` of that distribution; a point outside is moved to its surface. The seed of
    turbulence and noise is that of the worst flight so far; every `SEEDS_EVERY` generations that
    flight is flown with other seeds. With a disturbance, up to half of the budget is first spent on
    bang-bang disturbances, see `search_bang_bang`.

    References
    ----------
    .. [1] N. Hansen, "The CMA evolution strategy: a tutorial", arXiv 1604.00772.
    """
    search = _Search(source, settings, pool)
    try:
        if settings.disturbance:
            search.fly_bang_bang()
        left = settings.budget - search.flights
        z, _, first = search_worst(
            search.values, len(search.plan.keys), budget=left, seed=settings.seed
        )
    except _StoppedError:
        return None
    (plan, drawn), row = search.made_by, search.worst
    switched = plan.keys != search.plan.keys
    waves = "square_wave" if settings.disturbance else None
    scenario = scenario_of_run(plan, row["run"], drawn)
    return WorstFlight(
        metric=search.metric,
        value=math.inf if row["value"] >= FAILED else row["value"],
        first=math.inf if first >= FAILED else first,
        flights=search.flights,
        group=plan.groups[0],
        family="bang_bang" if switched else waves,
        drawn=drawn,
        distance=None if switched else float(np.linalg.norm(z)),
        radius=None if switched else region_radius(len(plan.keys)),
        status=row["status"],
        missed=row["missed"],
        reach=search.reach if settings.tube else None,
        scenario=scenario.model_copy(
            update={"title": f"the worst flight found of: {plan.campaign.title}"}
        ),
    )


def rare_miss(
    source: str, settings: WorstSettings, pool: WorkerPool, *, threshold: float = 0.0
) -> RareMiss | None:
    """Probability that a flight of a campaign reaches a threshold, by subset simulation.

    A fifth of the budget is flown at each level. The threshold is a value of the metric: 0 for the
    margin. The result is None if the observer stopped the simulation.
    """
    search = _Search(source, settings, pool)
    try:
        miss = subset_simulation(
            search.values,
            len(search.plan.keys),
            threshold=threshold,
            budget=settings.budget,
            seed=settings.seed,
        )
    except _StoppedError:
        return None
    return replace(miss, metric=search.metric)


def region_radius(dimension: int) -> float:
    """Radius of the ball that holds `REGION` of a standard normal distribution."""
    return math.sqrt(float(chdtri(dimension, 1.0 - REGION)))


def search_worst(
    values: Evaluate, dimension: int, *, budget: int, seed: int
) -> tuple[FloatArray, int, float]:
    """Search the region of a standard normal distribution for the largest value.

    The results are the worst point, its seed and the largest value of the first generation.
    `budget` is the maximum number of points.
    """
    import cma

    rng, radius = np.random.default_rng(seed), region_radius(dimension)

    def inside(z: FloatArray) -> FloatArray:
        length = np.linalg.norm(z, axis=1, keepdims=True)
        return z * np.minimum(1.0, radius / np.maximum(length, 1e-12))

    z = inside(rng.standard_normal((POPULATION, dimension)))
    seeds = rng.integers(0, 2**31, POPULATION)
    objective = values(z, seeds)
    at = int(np.argmax(objective))
    best, chance, worst, spent = z[at], int(seeds[at]), float(objective[at]), POPULATION
    first, strategy, generation = worst, None, 0
    while spent + POPULATION <= budget:
        generation += 1
        if generation % SEEDS_EVERY == 0:
            # The worst point so far is flown with other seeds: turbulence may have been kind to it.
            z = asked = np.tile(best, (POPULATION, 1))
            seeds = rng.integers(0, 2**31, POPULATION)
        else:
            if strategy is None or strategy.stop():
                settings = {"popsize": POPULATION, "seed": seed + generation, "verbose": -9}
                strategy = cma.CMAEvolutionStrategy(best, SPREAD, settings)
            asked = np.array(strategy.ask())
            z, seeds = inside(asked), np.full(POPULATION, chance)
        objective = values(z, seeds)
        spent += POPULATION
        if generation % SEEDS_EVERY and strategy is not None:
            # A point outside the region scores as its projection, minus a penalty that grows with
            # distance: the strategy learns to stay inside. Signs are reversed, as it minimises.
            over = np.linalg.norm(asked - z, axis=1)
            strategy.tell(list(asked), (-objective + (1e-3 + np.std(objective)) * over**2).tolist())
        at = int(np.argmax(objective))
        if objective[at] > worst:
            best, worst = z[at], float(objective[at])
            if seeds[at] != chance:
                # With another seed the objective is another function: the strategy starts anew.
                chance, strategy = int(seeds[at]), None
    return best, chance, first


def subset_simulation(
    values: Evaluate, dimension: int, *, threshold: float, budget: int, seed: int
) -> RareMiss:
    r"""Probability that `values` of a standard normal distribution reach a threshold.

    Parameters
    ----------
    values : callable
    dimension : int
    threshold : float
    budget : int
        Maximum number of points, a fifth of them per level.
    seed : int

    Returns
    -------
    RareMiss
        If the budget ends before the threshold is reached, the probability is 0 and the upper end
        of its interval is that of the last level.

    Notes
    -----
    S.-K. Au and J. L. Beck, "Estimation of small failure probabilities in high dimensions by subset
    simulation", Prob. Eng. Mech. 16 (2001) 263-277; its Eqs. (27) to (30) for the coefficient of
    variation. The chains move by ``z' = sqrt(1 - s^2) z + s w``, w standard normal, which leaves
    the normal distribution as it is (S. L. Cotter et al., Stat. Sci. 28 (2013) 424-446); every
    second move also draws a new seed.
    """
    rng = np.random.default_rng(seed)
    size = max(budget // 5, 20)
    heads = max(round(LEVEL * size), 2)
    length = size // heads
    size = heads * length  # whole chains
    z, seeds = rng.standard_normal((size, dimension)), rng.integers(0, 2**31, size)
    objective = values(z, seeds)
    spent, probability, squares, levels = size, 1.0, 0.0, []
    chains = np.arange(size)[:, None]  # at first each flight is a chain of its own
    while True:
        order = np.argsort(-objective)
        # No level lies beyond the threshold: the last one counts the misses themselves.
        begins = min(float(objective[order[heads - 1]]), threshold)
        reached = objective >= begins
        share = float(reached.mean())
        levels.append(begins)
        probability *= share
        squares += _variation(reached[chains]) ** 2
        if begins >= threshold or spent + size - heads > budget:
            break
        z_now, seeds_now, now = z[order[:heads]], seeds[order[:heads]], objective[order[:heads]]
        steps = [(z_now, seeds_now, now)]
        for _ in range(length - 1):
            moved = math.sqrt(1.0 - STRIDE**2) * z_now
            moved = moved + STRIDE * rng.standard_normal(z_now.shape)
            other = np.where(rng.random(heads) < 0.5, rng.integers(0, 2**31, heads), seeds_now)
            there = values(moved, other)
            spent += heads
            stays = there < begins
            z_now = np.where(stays[:, None], z_now, moved)
            seeds_now, now = np.where(stays, seeds_now, other), np.where(stays, now, there)
            steps.append((z_now, seeds_now, now))
        z, seeds, objective = (np.concatenate(parts) for parts in zip(*steps, strict=True))
        # Points are stored step by step: those of one chain are `heads` apart.
        chains = np.arange(size).reshape(length, heads).T
    variation = math.sqrt(squares)
    factor = math.exp(1.96 * math.sqrt(math.log1p(squares)))
    estimate = probability if begins >= threshold else 0.0
    return RareMiss(
        metric="",
        threshold=threshold,
        probability=estimate,
        low=estimate / factor,
        high=probability * factor,
        variation=variation,
        levels=tuple(levels),
        flights=spent,
    )


def _variation(reached: npt.NDArray[np.bool_]) -> float:
    """Coefficient of variation of the share of `reached`, shape (chains, length)."""
    count, length = reached.shape
    share = reached.mean()
    if share in (0.0, 1.0):
        return 0.0
    spread = reached - share
    variance = share * (1.0 - share)
    correlation = sum(
        2.0 * (1.0 - k / length) * float((spread[:, k:] * spread[:, :-k]).mean()) / variance
        for k in range(1, length)
    )
    return math.sqrt(max(variance * (1.0 + correlation), 0.0) / (count * length)) / float(share)


class _Search:
    """Flies draws of a campaign with the workers and keeps the worst row."""

    def __init__(self, source: str, settings: WorstSettings, pool: WorkerPool) -> None:
        plan = planned(
            source,
            plant=settings.plant,
            start_deg=settings.start_deg,
            disturbance=settings.disturbance,
        )
        group = plan.chosen_group(settings.plant, settings.gains)
        if not plan.keys:
            raise InputError(
                f"{source}: `disperse` must have a key to search; of a scenario give --start-deg "
                "or --disturbance."
            )
        self.plan = plan.of_group(group)
        self.metric = TUBE if settings.tube else settings.metric or _metric_of(plan, group)
        self._failed = -FAILED if settings.completed else FAILED
        self._probes: Probes = {TUBE: partial(_use_of, settings.tube)} if settings.tube else {}
        self._settings, self._pool, self.flights = settings, pool, 0
        self.worst: dict[str, Any] = {"value": -math.inf}
        self.made_by: tuple[Plan, Drawn] = self.plan, {}  # plan and draw of the worst row
        self.reach = np.zeros(2)

    def values(self, z: FloatArray, seeds: Seeds) -> FloatArray:
        """Fly draws and return the metric of each."""
        campaign = self.plan.campaign
        u = np.clip(ndtr(z), SMALLEST_POINT, LARGEST_POINT)
        u = correlated(u, list(campaign.keys), campaign.correlation)
        columns = {
            table.key: table.at(u[:, i]).tolist() for i, table in enumerate(campaign.disperse)
        }
        columns[SEED] = seeds.tolist()
        drawn = [
            dict(zip(columns, values, strict=True))
            for values in zip(*columns.values(), strict=True)
        ]
        return self._fly(self.plan.with_runs(len(drawn)), drawn)

    def fly_bang_bang(self) -> None:
        """Search bang-bang disturbances with up to half of the budget."""
        # In a tube one channel at a time: otherwise only the one nearer to its bound is searched.
        searches = ((0,), (1,)) if self._probes else ((0, 1),)
        scenario = self.plan.scenario
        for pushed in searches:
            channel = pushed[0] if self._probes else None
            search_bang_bang(
                lambda flights, of=channel: self._fly(*self._switched(flights), of),
                self._errors,
                round(scenario.flight.duration_s * scenario.controller.rate_hz),
                budget=self._settings.budget // (2 * len(searches)),
                pushed=pushed,
            )

    def _switched(self, flights: Sequence[FloatArray]) -> tuple[Plan, list[Drawn]]:
        """The plan and draws of flights given as arrays of signs, see `search_bang_bang`."""
        campaign, rate = self.plan.campaign, self.plan.scenario.controller.rate_hz
        starts = [table for table in campaign.disperse if table.key.startswith("flight.")]
        tables = self.plan.scenario.as_dict()
        tables.pop("disturbance")
        nominal = scenario_from(tables)
        draws: list[Drawn] = []
        for signs in flights:
            drawn: dict[str, Any] = {
                table.key: self._settings.start_deg * float(sign)
                for table, sign in zip(starts, signs[0], strict=False)
            }
            for channel, channel_signs in zip(("chi", "gamma"), signs[1:].T, strict=True):
                switches = (np.flatnonzero(np.diff(channel_signs)) + 1) / rate
                drawn[f"disturbance.{channel}_amplitude"] = self._settings.disturbance * float(
                    channel_signs[0]
                )
                drawn[f"disturbance.{channel}_switch_s"] = switches.tolist()
            draws.append({**drawn, SEED: nominal.seed})
        changed = {"nominal": nominal, "central": nominal, "disperse": starts}
        campaign = campaign.model_copy(update=changed)
        return replace(self.plan, campaign=campaign, runs=len(draws)), draws

    def _errors(self, flights: Sequence[FloatArray]) -> list[FloatArray | None]:
        """Errors of each flight; None for one that ends early."""
        plan, draws = self._switched(flights)
        errors: list[FloatArray | None] = [None] * len(draws)

        def keep(rows: pa.Table) -> None:
            for row in rows.to_pylist():
                if row["errors"] is not None:
                    errors[row["run"]] = np.reshape(row["errors"], (-1, 2))

        self._fly_rows(plan, draws, keep, {"errors": _errors_of})
        return errors

    def _fly(self, plan: Plan, draws: Sequence[Drawn], channel: int | None = None) -> FloatArray:
        """Fly draws and return the metric of each, or its reach in one `channel` of the tube."""
        values = np.full(len(draws), FAILED)

        def keep(rows: pa.Table) -> None:
            for row in rows.to_pylist():
                value = value_of(row, self.metric, plan.scenario)
                value = self._failed if value >= FAILED else value
                reach = (row.get(TUBE) or [])[1:]
                values[row["run"]] = value if channel is None or not reach else reach[channel]
                self.reach = np.maximum(self.reach, reach or 0.0)
                if value > self.worst["value"]:
                    self.worst, self.made_by = {**row, "value": value}, (plan, draws[row["run"]])

        self._fly_rows(plan, draws, keep, self._probes)
        return values

    def _fly_rows(
        self,
        plan: Plan,
        draws: Sequence[Drawn],
        keep: Callable[[pa.Table], None],
        probes: Probes,
    ) -> None:
        span = Span(0, len(draws))
        if not self._pool.fly_rows(
            plan, [span], keep, doing="searching", probes=probes, draws=draws
        ):
            raise _StoppedError
        self.flights += len(draws)


def _errors_of(run: Run, _: Scenario) -> list[float]:
    """Errors of a flight, sample by sample."""
    return run.signals[list(ERRORS)].to_numpy().ravel().tolist()


def _use_of(tube: Bounds, run: Run, _: Scenario) -> list[float]:
    """Share of a tube that a flight uses, and its reach in both channels."""
    return [tube.share(run), *tube.reach(run).tolist()]


def value_of(row: Mapping[str, Any], metric: str, scenario: Scenario) -> float:
    """Value of a metric (a column, ``margin`` or ``tube``) in a row; larger is worse.

    It is `FAILED` for a flight without a value.
    """
    if row["status"] != "completed":
        return FAILED
    if metric != MARGIN:
        value = row[TUBE][0] if metric == TUBE else row[metric]
        return FAILED if value is None else float(value)
    beyond = [
        sense * (_in_unit_of(name, row[f"{subject}.{in_rad(name)}"]) - bound) / (abs(bound) or 1.0)
        for table in scenario.expect
        if table.meant(row["plant"], row["gains"])
        for bounds, sense in ((table.at_most, 1.0), (table.at_least, -1.0))
        for subject, limits in bounds.items()
        for name, bound in limits.items()
    ]
    return max(beyond, default=FAILED)


def _in_unit_of(name: str, value: float | None) -> float:
    if value is None:
        return FAILED
    return value / DEG if name.endswith("_deg") else value


def _metric_of(plan: Plan, group: Group) -> str:
    """The margin where the group has requirements with bounds, else ITAE of the course."""
    bounded = any(
        table.at_most or table.at_least
        for table in plan.scenario.expect
        if table.meant(group.plant, group.gains)
    )
    return MARGIN if bounded else "chi.ITAE"
