"""The search for the worst flight of a stated set."""

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, singledispatch
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias, Unpack

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import chdtri, ndtr

from flighttune.base.answering import Answering
from flighttune.base.arguments import checked_class
from flighttune.base.arrays import FloatArray, check_at_least
from flighttune.base.errors import InputError
from flighttune.base.files import code
from flighttune.base.files.load import CLAIMS, load_one, written
from flighttune.base.files.load import TUBE as TUBE_FILE
from flighttune.base.signals import CHANNEL_SYMBOLS
from flighttune.base.units import DEG_PER_RAD, Degrees, RadiansPerSecond
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.columns import measured_in
from flighttune.campaigns.flying.compiled import CompiledFlights
from flighttune.campaigns.flying.rows import Drawn, Probes, scenario_of_run
from flighttune.campaigns.planning.draws import LARGEST_POINT, SEED, SMALLEST_POINT, correlated
from flighttune.campaigns.planning.plan import Plan, plan_campaign
from flighttune.campaigns.planning.schema import MEASURES, Campaign
from flighttune.campaigns.planning.source import Flights, about, flights
from flighttune.claims import counted_flights, counting
from flighttune.claims.about import About
from flighttune.claims.counted import Counted
from flighttune.claims.monitor import LogMonitor
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.verify import AnyClaim
from flighttune.control.certificates.bound import RateBound
from flighttune.control.certificates.certificate import Certificate
from flighttune.control.gains_keys import GainsTable
from flighttune.flight.flown import bound_checks
from flighttune.flight.fly import fly
from flighttune.flight.loop.measures import SETTLING_BAND, SMALLEST_STEP
from flighttune.flight.loop.run import ERRORS, Bounds, Run
from flighttune.flight.scenario.load import save_scenario, scenario_from, with_gains
from flighttune.flight.scenario.schema import Scenario
from flighttune.vehicles.plants.jsbsim.plant import LARGEST_SEED

# Metric: largest excess over a requirement relative to its bound; 0 just meets it.
MARGIN = "margin"

# Metric: share of a tube that the errors use; above 1 they leave it.
TUBE = "tube"

# Metric: share of a band that a flight uses; above 1 it is outside.
BAND = "band"

# Share of the stated distribution inside the searched region.
REGION = 0.999

# Flights per generation, enough to keep workers busy.
POPULATION = 32

# Number of generations after which the worst draw so far is flown with other seeds.
SEEDS_EVERY = 6

# First step of a search about the worst draw so far, in standard deviations.
SPREAD = 0.5

# Tolerance, as a share of a tube, for a flight from a corner of the starts: starts in files are in
# deg, and the corner is on the edge of the tube.
ROUNDING = 1e-9

# Value of an incomplete flight, above all others.
FAILED = 1e3

Seeds = npt.NDArray[np.int64]
Indices = npt.NDArray[np.intp]

# Number of intervals of a flight for the sensitivity to a bang-bang disturbance, and number of
# target times in a round.
INTERVALS, TARGETS = 45, 25

# Plan of a claim's flights, settings of their `StatedSet`, and the claim if it is a tube.
Searched: TypeAlias = tuple[Plan, dict[str, Any], Tube | None]

# Values of the metric for n draws, larger is worse. The arguments are normal scores before
# correlation, shape (n, d), and seeds, shape (n,).
Objective = Callable[[FloatArray, Seeds], FloatArray]


@checked_class
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorstFlight(Answering):
    """The worst flight that a search found.

    Attributes
    ----------
    scenario : Scenario
        The scenario of this flight, for `fly`.
    metric : str
        The maximised quantity.
    value : float
        Its value; infinite for a flight that ended early.
    first : float
        Worst value of the first generation, drawn from the distribution.
    flights : int
        Number of flights.
    family : "bang_bang", "square_wave" or None
        Disturbance of the flight.
    distance, radius : float or None
        Distance from the median in standard normal space, and radius of the searched region; None
        for a bang-bang disturbance.
    status, missed, plant, gains : str
        Outcome, missed requirements, and labels of the flight.
    drawn : mapping
        Dispersed keys and the seed, or amplitudes and switching times.
    ratio, ratio_of_search : mapping of str to float, or None
        With a tube: its largest half width relative to the largest distance from its middle, by
        channel, for this flight and for all flights of the search; below 1 a flight leaves the
        tube.
    endings : sequence of mapping
        ``run``, ``status`` and ``reason`` of incomplete flights of the search.
    compiled : CompiledFlights
        How many flights of the search were compiled, and how many JSBSim flew, again or alone.
    contradicts : bool
        Whether the flight leaves its proven tube, which is then wrong.

    Examples
    --------
    >>> worst = ft.worst("first_campaign", budget=32, metric="chi.ITAE", plant="kinematic")
    >>> worst.value == worst.first, worst.scenario.plant[0].label
    (True, 'kinematic')
    """

    scenario: Scenario
    metric: str
    value: float
    first: float
    flights: int
    family: str | None
    distance: float | None
    radius: float | None
    status: str
    missed: str
    plant: str
    gains: str
    drawn: Mapping[str, Any]
    ratio: Mapping[str, float] | None = None
    ratio_of_search: Mapping[str, float] | None = None
    contradicts: bool = False
    endings: Sequence[Mapping[str, Any]] = ()
    compiled: CompiledFlights = field(default_factory=CompiledFlights)

    def save(self, path: str | Path) -> None:
        """Write the flight as a scenario (.toml)."""
        save_scenario(self.scenario, Path(path))


@code.flies
def worst(
    source: Flights | Scenario | Campaign | Plan | Tube | Counted | str | Path,
    *,
    claim: Tube | Path | str | None = None,
    budget: int = 2000,
    metric: str | None = None,
    gains: str | None = None,
    plant: str | None = None,
    completed: bool = False,
    start_deg: Degrees = 0.0,
    disturbance: RadiansPerSecond = 0.0,
    seed: int = 1,
    changes: Mapping[str, Any] | None = None,
    run_code: bool = False,  # noqa: ARG001 - of the decorator
    **by: Unpack[FlownBy],
) -> WorstFlight:
    """Search dispersions and disturbances for the worst flight.

    2000 flights take seconds for the law and minutes for an aircraft.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, Tube, Band, str or Path
        A campaign (file, shipped name or folder), whose dispersions are searched, a scenario with
        `start_deg` or `disturbance`, or the file of a tube or band, whose flights are searched for
        the flight nearest to the edge.
    claim : Tube, Path or str, optional
        Tube whose bounds the flight should approach; the answer tells how many times wider the tube
        is.
    budget : int
        Maximum number of flights.
    metric : str, optional
        Metric to maximise: a column of a campaign's rows, or ``margin``, the largest excess over a
        requirement relative to its bound; by default margin if there are requirements, else
        ``chi.ITAE``.
    gains : str, optional
        Gain set by name or file, by default the set tuned for the aircraft, else the first.
    plant : str, optional
        Label of the plant, by default the first.
    completed : bool
        Consider only completed flights.
    start_deg : float, deg
        Half-width of the start range in course and path angle.
    disturbance : float, rad/s
        Largest disturbance of a scenario's two rates, bang-bang or square.
    seed : int
        Seed of the search.
    changes : mapping of str to value, optional
        Values to set in the scenario, by dotted key.
    run_code : bool
        Run Python files that the folder of a campaign or the file of a band names.
    workers : int, optional
        Processes that fly on this machine, by default one per core; the result does not depend on
        them.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    observer : CampaignObserver, optional
        Receives the progress; may stop the search.

    Returns
    -------
    WorstFlight

    Raises
    ------
    InputError, ScenarioError
        If source, gains or plant do not exist, nothing is dispersed, the budget is too small, or
        other flights than a tube's or band's own are requested.
    StoppedError
        If the observer stopped the search.

    Examples
    --------
    >>> ft.worst("first_campaign", budget=32, metric="chi.ITAE", plant="kinematic").flights
    32
    """
    fliers, tube = Fliers(**by), load_one(claim, "tube", TUBE_FILE)
    stated = written(source, *CLAIMS) or source
    place = f"{source}: " if stated is not source else ""
    if isinstance(stated, AnyClaim):
        if metric or gains or start_deg or disturbance or changes or claim:
            raise InputError(
                f"{place}metric, gains, starts, disturbance, changes and claim must be absent for "
                "a tube or band file, which has its own."
            )
        plan, searched_in, tube = _flights_of(stated, place)
    else:
        if tube is not None and metric is not None:
            raise InputError("`metric` must not be given with a tube, whose share is the metric.")
        if metric not in (None, MARGIN, *MEASURES):
            raise InputError(
                f"`metric` must be {MARGIN} or one of {', '.join(MEASURES)}, got {metric!r}."
            )
        searched_for = flights(stated, changes=changes).starting(start_deg).disturbed(disturbance)
        place = f"{searched_for.place}: "
        plan, sizes = searched_for.plan(plant=plant, gains=gains), (disturbance, disturbance)
        searched_in = dict[str, Any](metric=metric, sizes=sizes, start_deg=start_deg)
    bounds = None if tube is None else tube.bounds.of(ERRORS)
    if bounds is not None:
        searched_in |= {"metric": TUBE, "probes": {TUBE: partial(_use_of, bounds)}}
    group = plan.chosen_group(plant, gains if gains in plan.gain_sets else None)
    if not plan.keys:
        raise InputError(
            f"{place}`disperse` must name a key to search; for a "
            "scenario give --start-deg or --disturbance."
        )
    with WorkerPool(fliers) as pool:
        searched = StatedSet(plan.of_group(group), pool, completed=completed, **searched_in)
        flight = searched.find_worst(budget=budget, seed=seed)
        searched.check_compiled()
        of_pool = pool.progress
        flight = replace(flight, endings=of_pool.endings, compiled=of_pool.compiled)
    if tube is None or bounds is None:
        return flight
    of_search = {
        channel: 1.0 / share if share else math.inf  # no flight was completed
        for channel, share in zip(CHANNEL_SYMBOLS, searched.reach.tolist(), strict=True)
    }
    with code.in_jsbsim():
        (run,) = fly(flight.scenario).runs
    # The tube of an aircraft covers only flights whose residual signals stay in their boxes.
    proven = not (tube.why_not(run) or tube.no_claim(run))
    return replace(
        flight,
        ratio=bounds.ratios(run.signals),
        ratio_of_search=of_search,
        contradicts=proven and bounds.share(run.signals) > 1.0 + ROUNDING,
    )


@singledispatch
def _flights_of(claim: Certificate | RateBound, place: str) -> Searched:
    """The flights of a claim, and the settings of the search."""
    del claim
    raise InputError(f"{place}must be of flights, to be searched, got a claim about gains.")


@_flights_of.register
def _of_logs(claim: LogMonitor, place: str) -> Searched:
    del claim
    raise InputError(f"{place}must be of flights, to be searched, got a monitor of logs.")


@_flights_of.register
def _of_count(claim: Counted, place: str) -> Searched:
    if not claim.claims:
        raise InputError(f"{place}the band must have a claim, got none.")
    share_of = partial(_share_of, counting.kept_of(claim), claim.about, claim.scale)
    return counted_flights.plan_of(claim), {"metric": BAND, "probes": {BAND: share_of}}, None


@_flights_of.register
def _of_tube(claim: Tube, place: str) -> Searched:
    if claim.status != "bounded":
        raise InputError(f"{place}the tube must be bounded, got one that is not: {claim.reason}.")
    problem, sizes = claim.problem, (0.0, 0.0)
    if problem.boxes is None:  # with boxes, flights have no disturbance
        chi, gamma = problem.disturbances[1].max(axis=0).tolist()
        sizes = chi, gamma
    if not (problem.start or any(sizes)):
        raise InputError(
            f"{place}the tube must have a range of starts or a disturbance to search, got that of "
            "one flight."
        )
    gains = {"name": "tube", **problem.gains.as_lists(), "law": problem.gains.law}
    table, title = GainsTable.model_validate(gains), problem.scenario.title
    scenario = with_gains(problem.scenario, [f"{problem.law.name}:tube"], title, [table])
    start_deg = problem.start * DEG_PER_RAD
    plan = plan_campaign(about(scenario, "tube", problem.plant, start_deg, sizes))
    return plan, {"sizes": sizes, "start_deg": start_deg}, claim


class StatedSet:
    """The flights of a plan with one group; it flies them and keeps the worst."""

    def __init__(
        self,
        plan: Plan,
        pool: WorkerPool,
        *,
        metric: str | None = None,
        probes: Probes | None = None,
        sizes: tuple[float, float] = (0.0, 0.0),
        start_deg: float = 0.0,
        completed: bool = False,
    ) -> None:
        (group,) = plan.groups
        tables = plan.scenario.expected(group.plant, group.gains)
        bounded = any(table.at_most or table.at_least for table in tables)
        self.plan, self.metric = plan, metric or (MARGIN if bounded else "chi.ITAE")
        self.disturbances = sizes  # bound on both rates, rad/s
        self.flights = 0
        self.worst: dict[str, Any] = {"value": -math.inf}
        self._made_by: tuple[Plan, Drawn] = plan, {}  # plan and draw of the worst row
        # largest distance of all flights from the middle of the tube, relative to its largest half
        # width
        self.reach = np.zeros(2)
        self._start_deg, self._lost = start_deg, -FAILED if completed else FAILED
        self._probes, self.pool = probes or {}, pool

    def find_worst(self, *, budget: int, seed: int) -> WorstFlight:
        """Search for the worst flight by at most `budget` flights.

        Evolution strategy with covariance matrix adaptation (N. Hansen, "The CMA evolution
        strategy: a tutorial", arXiv 1604.00772) on the normal scores of the dispersed keys; the
        first generation is drawn from their distribution. The region is the ball with the share
        `REGION` of this distribution; a point outside is moved to its surface. Turbulence and noise
        use the seed of the worst flight so far; every `SEEDS_EVERY` generations this flight is
        flown with other seeds. With a disturbance, up to half of the budget is first spent on
        bang-bang disturbances.
        """
        check_at_least(POPULATION, budget=budget)
        self.pool.progress.budget = budget
        family, keys = None, self.plan.keys
        if any(self.disturbances):
            family = "square_wave"
            # In a tube one channel at a time; else only the channel nearer to its bound would be
            # searched.
            channels = (0, 1) if TUBE in self._probes else (None,)
            for channel in channels:
                self._fly_bang_bang(budget // 2 // len(channels), channel)
        z, _, first = search_worst(self.values, len(keys), budget=budget - self.flights, seed=seed)
        (plan, drawn), row = self._made_by, self.worst
        place = {"distance": float(np.linalg.norm(z)), "radius": region_radius(len(keys))}
        if plan.keys != keys:
            family, place = "bang_bang", {"distance": None, "radius": None}
        title = f"the worst flight found of: {plan.campaign.title}"
        return WorstFlight(
            scenario=scenario_of_run(plan, row["run"], drawn).model_copy(update={"title": title}),
            metric=self.metric,
            value=row["value"] if row["value"] < FAILED else math.inf,
            first=first if first < FAILED else math.inf,
            flights=self.flights,
            family=family,
            **place,
            **{key: row[key] for key in ("status", "missed", "plant", "gains")},
            drawn=drawn,
        )

    def check_compiled(self) -> None:
        """Repeat the worst flight in JSBSim; DifferenceError if it differs."""
        plan, drawn = self._made_by
        if "run" in self.worst:
            self.pool.check_compiled(plan, [self.worst["run"]], draws=[drawn] * plan.runs)

    def values(self, z: FloatArray, seeds: Seeds) -> FloatArray:
        """Fly draws and return the metric of each; an `Objective`."""
        campaign = self.plan.campaign
        u = np.clip(ndtr(z), SMALLEST_POINT, LARGEST_POINT)
        u = correlated(u, list(campaign.keys), campaign.correlation)
        columns = {table.key: table.at(u[:, i]) for i, table in enumerate(campaign.disperse)}
        draws = pd.DataFrame(columns | {SEED: seeds % (LARGEST_SEED + 1)}).to_dict("records")
        return self._fly(self.plan.with_runs(len(draws)), draws)

    def _fly_bang_bang(self, budget: int, channel: int | None) -> None:
        """Maximise each error, or one channel's error, at some times by a bang-bang disturbance.

        A flight is an array of signs, shape (1 + samples, 2): of the deviations of the start, then
        of the disturbances from each sample to the next. For a linear loop ``d_k = D
        sign(de(T)/dd_k)`` is the worst disturbance for the error at time T. The first derivatives
        are taken about an alternating disturbance, which hardly moves the flight. Limits make the
        loop nonlinear, so the derivatives of later rounds are taken about the worst flight so far.
        """
        scenario, pushed = self.plan.scenario, (0, 1) if channel is None else (channel,)
        samples = round(scenario.flight.duration_s * scenario.controller.rate_hz)
        parts = np.array_split(np.arange(1, samples + 1), min(INTERVALS, samples))
        blocks = [np.array([0]), *parts]
        targets = np.unique(np.linspace(1, samples, TARGETS).round().astype(np.intp))
        signs, worst = np.ones((1 + samples, 2)), -np.inf
        for block in blocks[::2]:
            signs[block] = -1.0
        # A round: the middle, a change of each channel in each block, and both signs of each
        # target.
        cost = 1 + 2 * len(blocks) + 2 * len(targets) * len(pushed)
        while budget >= cost:
            budget -= cost
            others = (_other(signs, *changed) for changed in product(blocks, (0, 1)))
            flown = self._errors(*self._switched([signs, *others]))
            slopes = _slopes(signs, blocks, flown, targets, pushed)
            tried = [
                np.where(slope == 0.0, signs, sense * np.sign(slope))
                for slope, sense in product(slopes, (1.0, -1.0))
            ]
            reached = self._fly(*self._switched(tried), channel)
            if reached.max() <= worst:
                break
            signs, worst = tried[int(reached.argmax())], reached.max()

    def _switched(self, flights: Sequence[FloatArray]) -> tuple[Plan, list[Drawn]]:
        """The plan and draws of flights given as arrays of signs, see `_fly_bang_bang`."""
        campaign, rate = self.plan.campaign, self.plan.scenario.controller.rate_hz
        starts = [table for table in campaign.disperse if table.key.startswith("flight.")]
        tables = self.plan.scenario.as_dict()
        tables.pop("disturbance")
        nominal = scenario_from(tables)
        draws: list[Drawn] = []
        for signs in flights:
            start = zip(starts, signs[0].tolist(), strict=False)
            drawn: dict[str, Any] = {table.key: self._start_deg * sign for table, sign in start}
            disturbed = zip(CHANNEL_SYMBOLS, self.disturbances, signs[1:].T, strict=True)
            for channel, size, column in disturbed:
                switches = (np.flatnonzero(np.diff(column)) + 1) / rate
                drawn[f"disturbance.{channel}_amplitude"] = size * float(column[0])
                drawn[f"disturbance.{channel}_switch_s"] = switches.tolist()
            draws.append({**drawn, SEED: nominal.seed})
        changed = {"nominal": nominal, "central": nominal, "disperse": starts}
        campaign = campaign.model_copy(update=changed)
        return replace(self.plan, campaign=campaign, runs=len(draws)), draws

    def _errors(self, plan: Plan, draws: Sequence[Drawn]) -> list[FloatArray | None]:
        """Fly draws and return the errors of each; None for a flight that ends early."""
        errors = [row.get("errors") for row in self._rows(plan, draws, {"errors": _errors_of})]
        return [None if flat is None else np.reshape(flat, (-1, 2)) for flat in errors]

    def _fly(self, plan: Plan, draws: Sequence[Drawn], channel: int | None = None) -> FloatArray:
        """Fly draws and return the metric of each, or its reach in one `channel` of a tube."""
        rows = self._rows(plan, draws, self._probes)
        values = np.array([value_of(row, self.metric, plan.scenario) for row in rows])
        values[values >= FAILED] = self._lost
        i = int(np.argmax(values))
        if values[i] > self.worst["value"]:
            self.worst, self._made_by = {**rows[i], "value": float(values[i])}, (plan, draws[i])
        if TUBE not in self._probes:
            return values
        reach = np.array([row[TUBE][1:] if TUBE in row else (np.nan, np.nan) for row in rows])
        self.reach = np.fmax(self.reach, np.fmax.reduce(reach))
        other = values if channel is None else reach[:, channel]
        return np.where(np.isnan(other), values, other)

    def _rows(self, plan: Plan, draws: Sequence[Drawn], probes: Probes) -> list[dict[str, Any]]:
        self.flights += len(draws)
        runs = range(plan.runs)
        return self.pool.in_order(plan, runs, doing="searching", probes=probes, draws=draws)


def region_radius(dimension: int) -> float:
    """Radius of the ball with the share `REGION` of a standard normal distribution."""
    return math.sqrt(float(chdtri(dimension, 1.0 - REGION)))


def search_worst(
    values: Objective, dimension: int, *, budget: int, seed: int
) -> tuple[FloatArray, int, float]:
    """The worst of `budget` points of the region, its seed, and the first generation's worst."""
    warnings.filterwarnings("ignore", "Could not import matplotlib")  # of cma
    import cma

    rng, radius = np.random.default_rng(seed), region_radius(dimension)

    def inside(z: FloatArray) -> FloatArray:
        length = np.linalg.norm(z, axis=1, keepdims=True)
        return z * np.minimum(1.0, radius / np.maximum(length, 1e-12))

    z = inside(rng.standard_normal((POPULATION, dimension)))
    seeds = rng.integers(0, 2**31, POPULATION)
    objective = values(z, seeds)
    place = int(np.argmax(objective))
    best, chance, worst = z[place], int(seeds[place]), float(objective[place])
    first, strategy = worst, None
    for generation in range(1, budget // POPULATION):
        if generation % SEEDS_EVERY == 0:
            # The worst point so far is flown with other seeds, since its turbulence may have been
            # mild.
            z = asked = np.tile(best, (POPULATION, 1))
            seeds = rng.integers(0, 2**31, POPULATION)
        else:
            if strategy is None or strategy.stop():
                settings = {"popsize": POPULATION, "seed": seed + generation, "verbose": -9}
                strategy = cma.CMAEvolutionStrategy(best, SPREAD, settings)
            asked = np.array(strategy.ask())
            z, seeds = inside(asked), np.full(POPULATION, chance)
        objective = values(z, seeds)
        if generation % SEEDS_EVERY and strategy is not None:
            # A point outside the region scores as its projection, minus a penalty that grows with
            # distance: the strategy learns to stay inside. Signs are reversed, as it minimises.
            over = np.linalg.norm(asked - z, axis=1)
            strategy.tell(list(asked), (-objective + (1e-3 + np.std(objective)) * over**2).tolist())
        place = int(np.argmax(objective))
        if objective[place] > worst:
            best, worst = z[place], float(objective[place])
            if seeds[place] != chance:
                # Another seed changes the objective function, so the strategy restarts.
                chance, strategy = int(seeds[place]), None
    return best, chance, first


def _other(signs: FloatArray, block: Indices, channel: int) -> FloatArray:
    """The flight with one channel of a block set to its rarer sign."""
    other = signs.copy()
    other[block, channel] = -1.0 if signs[block, channel].sum() >= 0.0 else 1.0
    return other


def _slopes(
    about: FloatArray,
    blocks: Sequence[Indices],
    flown: Sequence[FloatArray | None],
    targets: Indices,
    pushed: Sequence[int],
) -> list[FloatArray]:
    """Derivatives of errors at each target by every sign, shape (1 + samples, 2) each."""
    first, *others = flown
    slope = np.zeros((len(blocks), 2, len(targets), 2))
    for (i, channel), errors in zip(product(range(len(blocks)), (0, 1)), others, strict=True):
        if first is not None and errors is not None:
            changed = (_other(about, blocks[i], channel) - about)[blocks[i], channel].sum()
            slope[i, channel] = (errors - first)[targets] / changed
    rows = np.arange(len(about))
    centres = [block.mean() for block in blocks[1:]]
    slopes = []
    for target, error in product(range(len(targets)), pushed):
        columns = [np.interp(rows, centres, slope[1:, i, target, error]) for i in (0, 1)]
        slopes.append(np.stack(columns, axis=1))
        slopes[-1][0] = slope[0, :, target, error]
    return slopes


def _errors_of(run: Run, _: Scenario) -> list[float]:
    """Errors of a flight, sample by sample."""
    return run.signals[list(ERRORS)].to_numpy().ravel().tolist()


def _use_of(tube: Bounds, run: Run, _: Scenario) -> list[float]:
    """Share of a tube that a flight uses, and its reach in both channels."""
    return [tube.share(run.signals), *tube.reach(run.signals).tolist()]


def _share_of(
    kept: counting.Kept, about: About, scale: float, run: Run, scenario: Scenario
) -> list[float]:
    """Share of a band that a flight uses."""
    return [counting.score(kept, about, run, scenario) / scale]


def value_of(row: Mapping[str, Any], metric: str, scenario: Scenario) -> float:
    """Value of a metric in a row, larger is worse; `FAILED` for a flight without a value.

    A settling time without a change to settle from says nothing about a flight: it is `-FAILED`,
    and not considered in a margin.
    """
    if row["status"] != "completed":
        return FAILED
    if metric != MARGIN:
        value = row[metric][0] if metric in (TUBE, BAND) else row[metric]
        nothing = value is None and _nothing_to_settle(row, *metric.split("."))
        return -FAILED if nothing else FAILED if value is None else float(value)
    checks = [*bound_checks(scenario.expected(row["plant"], row["gains"]), measured_in(row))]
    margins = [
        FAILED if math.isnan(check.margin) else check.margin
        for check in checks
        if not (math.isnan(check.value) and _nothing_to_settle(row, check.subject, check.measure))
    ]
    return max(margins, default=-FAILED if checks else FAILED)


def _nothing_to_settle(row: Mapping[str, Any], subject: str, measure: str = "") -> bool:
    """Whether a measure is a settling time, and no change is commanded of which it is the time."""
    if measure != "settling_s":
        return False
    # Rows have the band of a settling time that is required; else the errors tell.
    band = row.get(f"{subject}.settling_band_rad")
    return (
        row[f"{subject}.peak_rad"] < SMALLEST_STEP
        if band is None
        else band < SETTLING_BAND * SMALLEST_STEP
    )
