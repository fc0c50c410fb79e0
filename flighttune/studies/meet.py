"""Gains that meet the requirements of scenarios, found by flying them."""

import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, Unpack, overload

import numpy as np
import numpy.typing as npt
from scipy.optimize import linprog

from flighttune.base.arrays import FloatArray, check_at_least
from flighttune.base.errors import InputError, keeping
from flighttune.base.files import code
from flighttune.base.units import DEG, RadiansPerSecond
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.kept import KeptRows
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.columns import measured_in
from flighttune.campaigns.flying.rows import Row
from flighttune.campaigns.planning.draws import SEED, cycle
from flighttune.campaigns.planning.knowing import Knowledge, knowing
from flighttune.campaigns.planning.plan import Group, Plan, aircraft_hashes
from flighttune.campaigns.planning.schema import MEASURES, Campaign, CampaignTable
from flighttune.campaigns.planning.source import Flights, campaign_on, load_campaign
from flighttune.campaigns.statistics.count import LOOK, sure
from flighttune.campaigns.statistics.intervals import CONFIDENCE, share
from flighttune.claims.counted_flights import at_random
from flighttune.control.gains import PAPER_GAINS, PIGains
from flighttune.control.gains_keys import TUNED, TUNED_FOR_AIRCRAFT
from flighttune.control.law import Law, law_kinds
from flighttune.control.law_keys import LawTable
from flighttune.control.linear_model import closed_loop
from flighttune.control.theory.indicators import indicators_batch
from flighttune.flight import load, models
from flighttune.flight.entry import entry_of
from flighttune.flight.flown import BoundCheck, bound_checks, bounded_loop, not_followed
from flighttune.flight.metrics import AIRSPEED, OFF_ROUTE, limits_in_words
from flighttune.flight.requirement_keys import Bound, ExpectTable, in_rad
from flighttune.flight.scenario.schema import Scenario
from flighttune.logs.log import Columns
from flighttune.logs.parameters import flown_now
from flighttune.studies.beside import at_own_airspeed
from flighttune.studies.log_aircraft import aircraft_of
from flighttune.studies.meeting import BY_DEFAULT, Meeting, Status, Trial
from flighttune.studies.retune import Counts, Retuned, retune
from flighttune.vehicles.plant_keys import flown_aircraft
from flighttune.vehicles.plants.base import goes_by

# Metrics beside the columns of the rows. `ITAE`: the sum over both channels, minimised once all
# requirements are met with the margin `WANTED`. `MARGIN`: the largest excess, minimised throughout
ITAE, MARGIN = "ITAE", "margin"

# Smallest margin, relative to its bound, that a requirement must have before the metric counts; a
# start with a larger margin raises it
WANTED = 0.2

# Share of the start's R_K that gains must keep if the start meets everything: otherwise a flight
# without a steady disturbance, or a bound on an overshoot, would remove the integral action
KEPT_RATE = 0.5
KEPT = (
    "R_K must be at least half the R_K of {}, which meets everything; at_least.loop.R_K of "
    "[[expect]] replaces this bound."
)

TRUE_PLACE = (
    "Distances from the route count from the true place. The errors of navigation alone take the "
    "aircraft off it, whatever the gains; `--navigation exact` leaves them out."
)

# Margins of the linear loop that are required unless the scenario states others
MARGINS: dict[str, Bound] = {"gain_margin_dB": 6.0, "phase_margin_deg": 35.0}

# Measures of the loop that are reported if they are lower than with the gains of the start by more
# than the share `NOTED`; smallest error at the end that is reported, rad or m/s
LOOP = "R_K", "gain_margin_dB", "phase_margin_rad", "delay_margin_s"
NOTED, NO_ERROR = 0.01, 0.01 * DEG

# Share of the draws of a campaign on which gains must meet all requirements, by default
SUCCESS = 0.95

# Flights of a search by default, without and with a campaign
BUDGET, CAMPAIGN_BUDGET = 600, 6000

# Status of gains by whether they meet the requirements, and by how sure that is
MET: Mapping[bool, Status] = {False: "missed", True: "met"}
SURELY: Mapping[str, Status] = {"yes": "met", "no": "missed", "": "not sure"}

# Draws on which a search over a campaign flies each candidate, and fewest draws of the count
DRAWS, COUNTED = 32, 200

# Candidates of a generation of the first descent, and its first step in the logarithms of the
# gains. Each restart doubles both, the step up to `MAX_SPREAD`.
POPULATION = 12
SPREAD, MAX_SPREAD = 1.0, 4.0

# Descent by slopes, in the logarithms of the gains. Most moves; first and largest reach of a move,
# and the factor on the reach after a move without gain. Step of the differences, shares of a move
# that are flown, and cost of the length of a move.
MOVES, REACH, MAX_REACH, SHORTER = 8, 0.8, 1.6, 0.25
STEP, SHARES, COST = 0.1, (1.0, 0.5, 0.25), 1e-3

# A descent ends after so many generations in which the objective falls by less than `GAIN`
STALLED, GAIN = 8, 2e-3

# Factors on K_P and K_I of the starts: a bound on overshoot often needs a hundredth of the tuned
# K_I, which a descent from a large K_I does not reach
FACTORS = (1.0, 1.0), (1.0, 1.0 / 30.0), (0.5, 0.5), (0.5, 1.0 / 60.0)

# Gains smaller than this share of the largest are rounding errors of a tuning: set to zero
ROUNDING = 1e-5

# Relative change of the gains at which a descent ends
FINEST = 1e-2

# Excess over a requirement, relative to its bound, of a flight that does not reach its end
LOST = 1e3

# A requirement is active if its margin is within this of the smallest margin
ACTIVE = 0.02


def flights_to_meet(
    scenario: Scenario, law: LawTable, table: CampaignTable | None = None
) -> Campaign:
    """Campaign of a scenario with one law, dispersed as the `table` of a campaign states."""
    tuned = list(TUNED_FOR_AIRCRAFT)
    tuned_names = {None, *tuned, *law.law.names_of(tuned)}
    expect = [
        requirement.model_copy(update={"gains": None, "status": None})
        for requirement in scenario.expect
        if requirement.gains in tuned_names and (requirement.at_most or requirement.at_least)
    ]
    if not expect:
        raise InputError(
            f"{scenario.title}: [[expect]] must bound a measure for all gain sets, or for "
            f"{' or '.join(tuned)}, to be met, got no such bound."
        )
    # The gains of the scenario are not flown, and none are tuned for the median.
    changed = {"expect": expect, "gains": ["paper"], "law": [law]}
    table = table or CampaignTable(title=scenario.title, scenario="scenario", runs=1)
    return campaign_on(table, scenario.model_copy(update=changed), scenario.title)


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What gains shall meet: requirements of scenarios, or those of one on draws of a campaign."""

    scenarios: Sequence[Scenario]
    law_table: LawTable
    dispersed: Campaign | None
    success: float = 1.0  # share of the draws that must meet all
    until_sure: bool = False

    def flights(self, dispersed: Campaign | None) -> list[Campaign]:
        """Campaign of each scenario."""
        return [flights_to_meet(x, self.law_table, dispersed) for x in self.scenarios]

    def search(self, kept: KeptRows, metric: str) -> "Search":
        """A search on draws of another seed than those of the count."""
        if (counted := self.dispersed) is None:
            return Search(self.flights(None), self.law_table.law, kept, metric=metric)
        seen = counted.model_copy(update={"design": "random", "seed": counted.seed + 1})
        drawn = self.flights(seen)
        options = {"draws": whole_cycles(drawn[0], DRAWS), "success": self.success}
        return Search(drawn, self.law_table.law, kept, metric=metric, **options)

    @property
    def fresh(self) -> int:
        """Draws of the count: those of the campaign, and at least `COUNTED`; 0 without one."""
        if self.dispersed is None:
            return 0
        groups = len(self.dispersed.nominal.gain_names) * len(self.dispersed.nominal.plant)
        return whole_cycles(self.dispersed, max(COUNTED, (self.dispersed.runs or 0) // groups))


class Search:
    """Flies candidates of one law in campaigns, and keeps all of them."""

    # The `metric` is `ITAE`, `MARGIN` or a column of the rows, also with ``_deg`` for ``_rad``.
    # With several `draws`, the share of draws on which all requirements are met is maximised, then
    # the excess that the share `success` of the draws does not exceed is minimised.
    def __init__(
        self,
        campaigns: Sequence[Campaign],
        law: Law,
        kept: KeptRows,
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
        self.flights, self.candidates, self.wanted, self.least_R_K = 0, 0, WANTED, 0.0
        self._R_K: dict[PIGains, float] = {}
        self.trials: dict[PIGains, Trial] = {}
        self._rows: dict[PIGains, list[list[Row]]] = {}  # of calls of `fly` with `draws`
        self.campaigns, self.law, self.kept, self.metric = campaigns, law, kept, metric
        self.draws, self._success = draws, success
        scenarios = [campaign.nominal for campaign in campaigns]
        self._required = list(map(_required, scenarios))
        self._aircraft = list(map(aircraft_hashes, scenarios))
        self.each = draws * sum(map(len, self._required))  # flights of a candidate
        self._problem = models.tuning_problem(scenarios[0], law)
        self._model = self._problem.model
        with suppress(InputError):  # without an identified aircraft, the model of [tuning]
            self._model = models.identified_models(scenarios[0], law)[0].model

    def begin(self, starts: Sequence[PIGains], budget: int, counting: int) -> list[Trial]:
        """Fly the gains of the start; the budget must cover them and `counting` flights."""
        least = len(starts) * self.each + counting
        if budget < least:
            sets = f"each of the {len(starts)} gain sets" if len(starts) > 1 else "the gains"
            count = f" and {counting} for the count on fresh draws" if counting else ""
            raise InputError(
                f"`budget` must be at least {least} flights, {self.each} for {sets} of the "
                f"start{count}, got {budget}."
            )
        return self.fly(starts)

    def fly(self, sets: Sequence[PIGains], draws: range | None = None) -> list[Trial]:
        """Fly candidates in all scenarios, except unstable ones and ones flown on these draws."""
        stable = []
        for gains in dict.fromkeys(sets):
            loop = indicators_batch(closed_loop(self._model, gains))
            if not loop.stable:
                trial = self._trial(gains, [[{"plant": x} for x in own] for own in self._required])
                # The excess grows with the spectral abscissa.
                excess = trial.excess + LOST * (1.0 + float(loop.spectral_abscissa))
                self.trials[gains] = replace(trial, excess=np.tile(excess, (self.draws, 1)))
            elif draws or gains not in self.trials:
                stable.append(gains)
        self.candidates += len(stable)
        places = range(len(self.campaigns)) if stable else ()
        flown = [self._flown(place, stable, draws or range(self.draws)) for place in places]
        for gains, *rows in zip(stable, *flown, strict=True):
            if draws is not None:
                before = self._rows.get(gains, [[]] * len(rows))
                rows = self._rows[gains] = [a + b for a, b in zip(before, rows, strict=True)]
            self.trials[gains] = self._trial(gains, rows)
        return [self.trials[gains] for gains in sets]

    def _plan(self, place: int, sets: Sequence[PIGains]) -> Plan:
        """All draws of a campaign, flown with candidates."""
        campaign, names = self.campaigns[place], self.law.names_of([*map(str, range(len(sets)))])
        groups = tuple(Group(plant, name) for name in names for plant in self._required[place])
        # `_trial` checks the requirements on the loop, once and not in every flight.
        expect = [
            table.model_copy(
                update={x: {**getattr(table, x), "loop": {}} for x in ("at_most", "at_least")}
            )
            for table in campaign.nominal.expect
        ]
        bare = campaign.nominal.model_copy(update={"expect": expect})
        return Plan(
            campaign=campaign.model_copy(update={"nominal": bare}),
            gain_sets=dict(zip(names, sets, strict=True)),
            groups=groups,
            runs=self.draws * len(groups),
            aircraft=self._aircraft[place],
        )

    def in_draw(self, draw: int) -> Scenario:
        """The first scenario in a draw of its campaign, with its requirements."""
        scenario = self._plan(0, [PAPER_GAINS]).scenario_of(draw)
        return scenario.model_copy(update={"expect": self.campaigns[0].nominal.expect})

    def _flown(self, place: int, sets: Sequence[PIGains], draws: range) -> list[list[Row]]:
        """Rows of a campaign by candidate, draw by draw."""
        plan = self._plan(place, sets)
        drawn = [{SEED: plan.scenario.seed}] if self.draws == 1 else None
        runs = range(draws.start * len(plan.groups), draws.stop * len(plan.groups))
        self.flights += len(runs)
        rows = self.kept.flown(plan, {}, runs, draws=drawn, doing="searching")
        return [[row for row in rows if row["gains"] == name] for name in plan.gain_sets]

    def check_compiled(self, gains: PIGains) -> None:
        """Repeat the flights of gains in JSBSim where they are compiled, on the first draw.

        DifferenceError names the first that differs. Flights that miss a requirement, or nearly,
        were repeated when they were flown.
        """
        for place in range(len(self.campaigns)):
            plan = self._plan(place, [gains])
            drawn = [{SEED: plan.scenario.seed}]
            self.kept.pool.check_compiled(plan, range(len(plan.groups)), draws=drawn)

    def _trial(self, gains: PIGains, rows: Sequence[Sequence[Row]]) -> Trial:
        """Check the rows of each campaign; rows of gains that were not flown have no status."""
        (name,) = self.law.names_of(["0"])
        # Checks of each draw and their excesses, LOST where the aircraft does not follow
        draws: dict[int, list[tuple[BoundCheck, float]]] = {}
        ends: dict[str, float] = {}
        held: list[str] = []
        metric = 0.0
        for campaign, of_campaign in zip(self.campaigns, rows, strict=True):
            scenario = campaign.nominal
            margins = _default_margins(scenario)
            loop = bounded_loop([*scenario.expect, *margins], entry_of(scenario, name, gains))
            where = f"{scenario.title}: " if len(self.campaigns) > 1 else ""
            for row in of_campaign:
                flown = row.get("status") == "completed"
                expected = scenario.expected(row["plant"], name)
                measured = {**(measured_in(row) if flown else {}), **loop}
                why = not_followed(expected, measured, calm=scenario.calm)
                for check in bound_checks(expected, measured, where + row["plant"]):
                    of_loop, excess = check.subject == "loop", check.margin
                    check = replace(check, flown=flown or of_loop)
                    if why and not of_loop and check.met:
                        check = replace(check, value=math.nan, why=why)
                    if not check.flown or (why and not of_loop):
                        excess = LOST
                    draws.setdefault(row.get("draw", 0), []).append((check, excess))
                for channel, values in measured.items():
                    ends[channel] = max(ends.get(channel, 0.0), values.get("end_error", 0.0))
                held += [f"{where}{row['plant']}: {x}." for x in limits_in_words(measured)]
                metric += _metric(row, self.metric) if flown else math.inf
            for of_draw in draws.values():
                by_default = bound_checks(margins, loop, where + BY_DEFAULT)
                of_draw.extend((check, check.margin) for check in by_default)
        by_draw = (zip(*of_draw, strict=True) for of_draw in draws.values())
        checks, excess = zip(*by_draw, strict=True)
        finite = np.nan_to_num(np.array(excess), nan=LOST, posinf=LOST)
        beside = {"metric": metric, "ends": ends, "held": tuple(held)}
        return Trial(gains=gains, excess=finite, checks=checks, **beside)

    def value(self, trial: Trial) -> float:
        """Objective: draws with a missed requirement, plus the excess; the metric is below -1."""
        missed = int((trial.worst > 0.0).sum())
        excess = float(np.quantile(trial.worst, self._success, method="inverted_cdf"))
        if self.least_R_K and self.R_K(trial.gains) < self.least_R_K:
            missed, excess = missed + 1, max(excess, 1.0 - self.R_K(trial.gains) / self.least_R_K)
        if self.metric != MARGIN and self.draws == 1 and excess <= -self.wanted:
            return 0.5 * _squeezed(trial.metric) - 1.5
        if excess == LOST:  # a requirement has no value: the metric ranks such candidates
            excess += 0.5 * LOST * _squeezed(trial.metric)
        return missed + 0.5 * _squeezed(excess)

    def keep_R_K(self, start: Trial) -> bool:
        """Require half the R_K of a start that meets all requirements, unless R_K is bounded."""
        bounded = any("R_K" in x.at_least.get("loop", ()) for x in self.campaigns[0].nominal.expect)
        if kept := start.met and not bounded:
            self.least_R_K = KEPT_RATE * self.R_K(start.gains)
        return kept

    def R_K(self, gains: PIGains) -> float:
        """R_K of the loop of the first scenario with these gains, 1/s."""
        if gains not in self._R_K:
            (name,) = self.law.names_of(["0"])
            entry = entry_of(self.campaigns[0].nominal, name, gains)
            self._R_K[gains] = models.loop_measures(entry, ["R_K"]).get("R_K", 0.0)
        return self._R_K[gains]

    def best(self) -> Trial:
        """The best candidate so far."""
        return min(self.trials.values(), key=self.value)

    def search(self, starts: Sequence[PIGains], budget: float) -> None:
        """Descend from the starts times `FACTORS`, best first, up to `budget` flights."""
        varied = [_varied(gains, factors) for gains in starts for factors in FACTORS]
        trials = self.fly(varied[: max(0, int((budget - self.flights) // self.each))])
        ranked = [trial.gains for trial in sorted(trials, key=self.value)]
        spread, population, start = SPREAD, POPULATION, self.best().gains
        if self.draws == 1 and self._follow_slopes(self.best(), budget).met:
            start = self.best().gains  # otherwise the slopes may have led into a corner
        for restart in range(2 * len(ranked)):
            if self.flights + population * self.each > budget:
                population = POPULATION  # uses the rest of the budget
            before = self.value(self.best())
            self._descend(start, budget, spread, population)
            best = self.best()
            if best.worst.max() <= -self.wanted and self.value(best) > before - GAIN and restart:
                return
            spread, population = min(2.0 * spread, MAX_SPREAD), 2 * population
            start = ranked[(restart + 1) // 2 % len(ranked)] if restart % 2 else best.gains

    def _follow_slopes(self, best: Trial, end: float) -> Trial:
        """Reduce the largest excess by its slopes, up to `end` flights, as long as that helps."""
        free, reach = self._free(best.gains), REACH
        for _ in range(MOVES):
            if best.worst.max() <= -self.wanted or reach < FINEST:
                break
            x, excess = free.logarithms(best.gains), self._excesses(best)
            if self.flights + (len(x) + len(SHARES)) * self.each > end:
                break
            steps = np.where(x + STEP > free.top, -STEP, STEP)
            beside = self.fly([free.gains(x + step) for step in np.diag(steps)])
            changes = [self._excesses(trial) - excess for trial in beside]
            # A requirement without a value, here or beside, has no slope.
            valued = excess < LOST
            slopes = np.where(np.abs(changes) < 0.5 * LOST, changes, 0.0).T / steps
            move = _least_worst(excess[valued], slopes[valued], -self.wanted, reach, free.top - x)
            ahead = self.fly([free.gains(x + share * move) for share in SHARES])
            nearest = min(beside + ahead, key=self.value)
            if self.value(nearest) >= self.value(best):
                reach *= SHORTER
            else:
                best, reach = nearest, min(2.0 * reach, MAX_REACH)
        return best

    def _excesses(self, trial: Trial) -> FloatArray:
        """Excess over each requirement of one draw, and over the bound on R_K."""
        kept = 1.0 - self.R_K(trial.gains) / self.least_R_K if self.least_R_K else -LOST
        return np.append(trial.excess[0], kept)

    def _free(self, gains: PIGains) -> "Free":
        """The gains that a search changes: all that are not 0."""
        assert self._problem.K_max is not None
        return Free(gains, self._problem.K_max)

    def _descend(self, start: PIGains, end: float, spread: float, population: int) -> None:
        """Descend from gains, up to `end` flights of this search; zero gains stay zero."""
        warnings.filterwarnings("ignore", "Could not import matplotlib")  # of cma
        import cma

        # Covariance matrix adaptation (N. Hansen, arXiv 1604.00772) on the logarithms of the gains.
        free = self._free(start)
        seed = self._problem.seed + 1 + self.flights  # 0 is the time of day
        settings: dict[str, Any] = {"popsize": population, "seed": seed, "tolx": FINEST}
        settings |= {"bounds": [None, free.top.tolist()], "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(free.logarithms(start), spread, settings)
        least, stalled = math.inf, 0
        while not strategy.stop() and stalled < STALLED:
            if self.flights + population * self.each > end:
                return
            asked = strategy.ask()
            values = [self.value(trial) for trial in self.fly([free.gains(x) for x in asked])]
            strategy.tell(asked, values)
            stalled = 0 if min(values) < least - GAIN else stalled + 1
            least = min(least, *values)

    def conflicting(self, trial: Trial) -> list[int]:
        """Requirements of one draw that are missed or active, smallest margin first."""
        excess = trial.excess[0]
        least = min(max(excess.max(), -WANTED) - ACTIVE, 0.0)
        return [int(i) for i in np.argsort(-excess, kind="stable") if excess[i] >= least]

    def trade_offs(self, nearest: Trial) -> Iterator[dict[str, Any]]:
        """Conflicting requirements: best value, and best value with the others met, or None."""
        trials = list(self.trials.values())
        excess = np.array([trial.excess[0] for trial in trials])
        for i in self.conflicting(nearest):
            others = np.delete(excess, i, axis=1).max(axis=1, initial=-LOST) <= 0.0
            # Flights that do not follow all have one excess: their values rank them.
            sign = 1.0 if nearest.checks[0][i].sense == "at_most" else -1.0
            values = np.array([sign * trial.checks[0][i].value for trial in trials])
            ranked = np.lexsort((values, excess[:, i]))
            beside = [trials[k].checks[0][i].value for k in ranked if others[k]]
            yield {
                **stated(nearest.checks[0][i]),
                "alone": trials[ranked[0]].checks[0][i].value,
                "beside": beside[0] if beside else None,
            }


class Free:
    """The gains of a set that are not 0, by their logarithms."""

    def __init__(self, gains: PIGains, largest: FloatArray) -> None:
        self._gains, self._at = gains, gains.K != 0.0
        self._signs = np.sign(gains.K[self._at])
        self.top = np.log(largest[self._at])

    def logarithms(self, gains: PIGains) -> FloatArray:
        """Logarithms of the absolute gains, limited to `top`."""
        return np.minimum(np.log(np.abs(gains.K[self._at])), self.top)

    def gains(self, x: FloatArray) -> PIGains:
        """The gain set with these logarithms."""
        K = self._gains.K
        K[self._at] = self._signs * np.exp(x)
        return _of_matrix(self._gains, K)


def _least_worst(
    excess: FloatArray, slopes: FloatArray, enough: float, reach: float, room: FloatArray
) -> FloatArray:
    """The move that minimises the largest excess down to `enough`, by linear programming."""
    # Variables: moves up, moves down, and the largest excess.
    n = len(room)
    cost = np.append(np.full(2 * n, COST), 1.0)
    rows = np.hstack([slopes, -slopes, -np.ones((len(excess), 1))])
    bounds = [*((0.0, min(reach, x)) for x in room), *((0.0, reach),) * n, (enough, None)]
    found = linprog(cost, A_ub=rows, b_ub=-excess, bounds=bounds)
    return found.x[:n] - found.x[n : 2 * n]


def stated(check: BoundCheck) -> dict[str, Any]:
    """A requirement with its value, for tables and ``--json``."""
    return {
        "run": check.run,
        "measure": f"{check.subject}.{check.measure}",
        "sense": check.sense.replace("_", " "),
        "bound": check.bound,
        "value": check.value if check.flown else math.nan,
        "margin": -check.margin if check.flown else math.nan,
        "why": "" if check.met else check.why,
    }


def starting_gains(scenario: Scenario, law: Law) -> dict[str, PIGains]:
    """Gains tuned for a law and gains of a scenario, by name, without sets that do not exist."""
    sets: dict[str, PIGains | None] = {}
    listed = map(scenario.listed_as, scenario.gain_names)
    for name in dict.fromkeys([*TUNED_FOR_AIRCRAFT, TUNED, *listed]):
        with suppress(InputError):  # e.g. no aircraft is identified
            sets[name] = models.gain_set(scenario, law.names_of([name])[0])
    return {name: gains for name, gains in sets.items() if gains is not None}


@overload
def meet(scenario: Scenario | str | Path, **options: Any) -> Meeting: ...


@overload
def meet(
    scenario: Flights | Scenario | Campaign | str | Path, *, autopilot: str | Path, **options: Any
) -> Retuned: ...


@code.flies
def meet(  # type: ignore[misc]  # noqa: PLR0913 - each is a choice of the user, and has a default
    scenario: Flights | Scenario | Campaign | str | Path,
    *,
    also: Sequence[Scenario | Path | str] = (),
    start: PIGains | str | None = None,
    budget: int | None = None,
    metric: str = ITAE,
    campaign: str | Path | None = None,
    success: float | None = None,
    until_sure: bool = False,
    navigation: Knowledge | None = None,
    autopilot: str | Path | None = None,
    version: str | None = None,
    log: str | None = None,
    flights: int | None = None,
    columns: Columns = (),
    aircraft: str | None = None,
    assume: Mapping[str, RadiansPerSecond] | None = None,
    like: str | None = None,
    changes: Mapping[str, Any] | None = None,
    kept: str | Path | None = None,
    **by: Unpack[FlownBy],
) -> Meeting | Retuned:
    """Find gains that meet the ``[[expect]]`` of a scenario, by flying candidates.

    A search takes seconds on the law, a minute on an aircraft (600 flights), and several minutes
    with a campaign. With `autopilot` the parameters of PX4 or ArduPilot are searched instead, on a
    route in wind: those of guidance and height, within their published ranges and with margins.

    Parameters
    ----------
    scenario : Scenario, str or Path
        A scenario, its file, or the name of a shipped one. The gains are for its first law. With
        `autopilot` also a mission or campaign, as for `compare`.
    also : sequence of Scenario, str or Path
        Other scenarios whose requirements the same gains must meet; none with a campaign.
    start : PIGains or str, optional
        Gains to start from, also by name or file, by default the scenario's and the tuned ones.
    budget : int, optional
        Maximum number of flights, including the count on fresh draws, by default 600, or 6000
        with a campaign.
    metric : str
        Metric to minimise once all requirements are met by 20 % of their bounds: ``ITAE``, the sum
        over both channels, or a column of campaign rows. ``margin`` maximises the margin further.
        The default is ITAE; with a campaign the metric must be absent.
    campaign : str or Path, optional
        Campaign that disperses the scenario: a file, or the name of a shipped one. The search
        maximises the share of draws that meet the requirements. The share is then counted on the
        draws of the campaign, which the search has not flown.
    success : float, 1, optional
        Share of the draws of a campaign on which gains must meet all requirements, by default 0.95.
        The lower end of the interval must reach this share, or the estimate if even a perfect count
        of so many draws has a lower end below it. Absent without a campaign.
    until_sure : bool
        Count independent draws of a campaign, whatever its design, until it is sure whether the
        gains found meet all requirements in the share `success`. The rule is valid at any number of
        draws, at a confidence of 0.95: a clear yes takes 84 draws at 0.95, a clear no 12. The draws
        of the campaign, at least 200, are the maximum; by default all of them are counted.
    navigation : {"exact", "rtk", "standard", "poor"}, optional
        Grade of ``[navigation]``, by default the scenario's, or on a route without one a standard
        receiver and inertial unit.
    autopilot : str or Path, optional
        Search the parameters of this autopilot: a file of QGroundControl (.params) or Mission
        Planner (.param, .parm), or a log (.ulg, .bin, .tlog) with them.
    version : str, optional
        Version of the autopilot, such as 1.15, by default from the file.
    log : str, optional
        Show the tracking of a log that was flown with these parameters beside that of the flights;
        LOG@START:END for a part of it in s.
    flights : int, optional
        Fresh draws on which the parameters of the file and those found are counted, by default 93.
    columns : mapping or sequence
        Columns of the signals in a log, as for `load_log`.
    aircraft : str, optional
        Aircraft that flies a mission, or file of an identified model (.json) or log of an aircraft
        (.ulg, .bin, .tlog, .csv), which flies as its lags, by default aerosonde. The model of a log
        is written to runs/identified.
    assume : mapping of str to float, rad/s
        Bandwidth of a first-order lag of ``phi`` or ``n_z`` if the log of the aircraft cannot
        identify it.
    like : as for `mission`
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.
    kept : str or Path, optional
        File for the flights while they are flown: after a kill the same call goes on. Its name gets
        eight digits of what decides the flights, so that other calls keep their own.
    workers : int, optional
        Processes that fly on this machine, by default one per core; the gains found do not depend
        on them.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    observer : CampaignObserver, optional
        Receives the progress; may stop the search.

    Returns
    -------
    Meeting or Retuned
        The best gains, even if they miss a requirement; the gains of the start if the search finds
        nothing better. With `autopilot`: both sets of parameters on fresh draws, and whether those
        found are better. If the start meets all requirements, R_K is at least half of the start's,
        unless R_K is bounded. ``worse`` lists the measures that are worse than at the start.

    Raises
    ------
    InputError, ScenarioError
        If nothing is required, the law has no gains, or an argument is out of its range.
    StoppedError
        If the observer stopped the search.

    Examples
    --------
    >>> meeting = ft.meet("paper_identified", start="tuned_identified", budget=4)
    >>> meeting.status, meeting.start_met, meeting.gains.K_P.shape
    ('met', True, (2, 2))
    """
    fliers, file = Fliers(**by), None if kept is None else Path(kept)
    check_at_least(1, budget=budget)
    of_flights = {"aircraft": aircraft, "like": like}
    of_file = {"version": version, "log": log, "flights": flights}
    of_file |= {"columns": columns, "assume": assume}
    of_gains = {"also": also, "start": start, "campaign": campaign, "success": success}
    if autopilot is not None:
        _absent(of_gains | {"until_sure": until_sure}, "with the parameters of an autopilot")
        flown, lags = aircraft_of(aircraft, columns, assume)
        now, file_options = flown_now(autopilot, version), {"aircraft": flown, "like": like}
        stated = at_own_airspeed(scenario, {**file_options, "changes": changes}, now)
        if stated.mission and like is None:  # nobody stated those of the default campaign
            stated = stated.with_own_requirements()
        counts = Counts(budget or BUDGET, flights, log, columns, file)
        found = retune(stated.knowing(navigation), Path(autopilot), now, version, counts, fliers)
        return replace(found, notes=(*lags, *found.notes))
    _absent(of_file | of_flights, "without the parameters of an autopilot")
    if not isinstance(scenario, Scenario | str | Path):
        raise InputError(f"`scenario` must be a scenario, got a {type(scenario).__name__}.")
    if campaign is not None and also:
        raise InputError("`also` must be absent with a campaign, which is about one scenario.")
    loaded = knowing(load.as_scenario(scenario, changes), navigation)
    starts, notes = _stated_start(loaded, start)
    dispersed = None if campaign is None else load_campaign(campaign, loaded)
    others = (knowing(load.as_scenario(x), navigation) for x in also)
    _check_campaign(dispersed, success, metric, until_sure)
    first = loaded if dispersed is None else dispersed.nominal
    problem = Problem(
        scenarios=[first, *others],
        law_table=_law_by_gains(first),
        dispersed=dispersed,
        success=SUCCESS if success is None else success,
        until_sure=until_sure,
    )
    budget = budget or (CAMPAIGN_BUDGET if campaign else BUDGET)
    with WorkerPool(fliers) as pool:
        searched = [x.as_dict() for x in problem.scenarios]
        rows = KeptRows(file, {"searched": "gains", "scenarios": searched}, pool)
        pool.progress.budget = budget - len(rows)
        search = problem.search(rows, metric)
        if not (starts := starts or starting_gains(first, search.law)):
            raise InputError("`start` must be given: no gains could be tuned to start from.")
        with keeping(rows.file):
            meeting = _meet(problem, starts, notes, search, budget)
        rows.remove()
        return meeting


def _meet(
    problem: Problem,
    starts: Mapping[str, PIGains],
    notes: Sequence[str],
    search: Search,
    budget: int,
) -> Meeting:
    """Search gains for a problem, and count them on fresh draws of a campaign."""
    scenarios, law = problem.scenarios, problem.law_table.law
    counting = 2 * problem.fresh * len(_required(scenarios[0]))
    trials = dict(zip(starts, search.begin([*starts.values()], budget, counting), strict=True))
    first, of_scenario = _first(scenarios[0], trials, search.value)
    met = first if trials[first].met else min(trials, key=lambda x: search.value(trials[x]))
    search.wanted = max(WANTED, -float(trials[met].worst.max()))
    if search.keep_R_K(trials[met]):
        notes = (*notes, KEPT.format(met))
    # On a campaign, margins beyond `WANTED` have no worth: other measures would pay for them.
    if problem.dispersed is None or trials[met].worst.max() > -WANTED:
        search.search([*starts.values()], budget - counting)
    best, progress = search.best(), search.kept.pool.progress
    if problem.dispersed is None and best.met:
        search.check_compiled(best.gains)
    count = _counted(problem, best, trials[first], search)
    assumed = [*dict.fromkeys(x for scenario in scenarios for x in scenario.assumptions)]
    on_draws = problem.dispersed is not None
    return Meeting(
        status=count.status,
        scenario=scenarios[0],
        campaign=problem.dispersed,
        gains=count.nearest.gains,
        start=first,
        start_gains=trials[first].gains,
        start_of_scenario=of_scenario,
        other_starts=tuple(name for name in trials if name != first),
        start_met=count.start_met,
        flights=search.flights,
        candidates=search.candidates,
        metric={"name": search.metric, "value": count.nearest.metric, "start": count.start.metric},
        requirements=[
            *_requirements(count.nearest, count.start, search.conflicting(count.nearest))
        ],
        worse=[*_worse(scenarios[0], law, count.nearest, count.start)],
        trade_offs=[] if best.met or on_draws else [*search.trade_offs(best)],
        success=count.share,
        worst=count.worst,
        trials=[*search.trials.values()],
        tuned_for={
            "aircraft": flown_aircraft(x for each in scenarios for x in each.plant),
            "V_a_mps": sorted({V for scenario in scenarios for V in scenario.airspeeds}),
            **({"assumed": assumed} if assumed else {}),
        },
        notes=(
            *notes,
            *_off_route(scenarios, count.nearest),
            *(() if on_draws else count.nearest.held),
        ),
        endings=progress.endings,
        compiled=progress.compiled,
    )


class CountedTrials(NamedTuple):
    """Gains and start with their verdicts: on fresh draws of a campaign, else as searched."""

    nearest: Trial
    start: Trial
    status: Status
    start_met: bool
    share: dict[str, Any] | None = None  # as `_count` returns it
    worst: Scenario | None = None  # with the values of the worst draw


def _counted(problem: Problem, best: Trial, start: Trial, search: Search) -> CountedTrials:
    """Count the best gains and the start on fresh draws, if the problem has draws."""
    if (dispersed := problem.dispersed) is None:
        return CountedTrials(best, start, MET[best.met], start.met)
    drawn = problem.flights(at_random(dispersed) if problem.until_sure else dispersed)
    count = Search(drawn, search.law, search.kept, draws=problem.fresh, success=problem.success)
    sets = best.gains, start.gains
    (nearest, of_start), counted = _count(count, sets, problem.success, problem.until_sure)
    status, start_status = counted.pop("statuses")
    search.flights += count.flights
    worst = count.in_draw(nearest.worst_draw)
    return CountedTrials(nearest, of_start, status, start_status == "met", counted, worst)


def _absent(options: Mapping[str, Any], why: str) -> None:
    for name, value in options.items():
        if value not in (None, False, ()):
            raise InputError(f"`{name}` must be absent {why}.")


def _stated_start(
    scenario: Scenario, start: PIGains | str | None
) -> tuple[dict[str, PIGains], tuple[str, ...]]:
    """Gains to start from by name, empty if none are stated; notes about the gains."""
    if start is None:
        return {}, scenario.gains_notes()
    begun = load.chosen_entry(scenario, start)
    return {begun.name: begun.found_gains}, begun.scenario.gains_notes(gains=begun.name)


def _first(
    scenario: Scenario, trials: Mapping[str, Trial], value: Callable[[Trial], float]
) -> tuple[str, bool]:
    """Name of the start for the comparison, and whether the scenario flies it."""
    own = [x for x in map(scenario.listed_as, scenario.gain_names) if x in trials]
    first = min(own or trials, key=lambda name: value(trials[name]))
    return first, bool(own)


def _off_route(scenarios: Sequence[Scenario], trial: Trial) -> tuple[str, ...]:
    """A note where a distance from a route is missed by autopilots that do not know their place."""
    missed = (f"{x.subject}.{x.measure}" for x in trial.checks[trial.worst_draw] if not x.met)
    erring = any(scenario.navigation for scenario in scenarios)
    return (TRUE_PLACE,) if erring and any(name in x for x in missed for name in OFF_ROUTE) else ()


def _law_by_gains(scenario: Scenario) -> LawTable:
    """The first law of a scenario, which must fly by gains."""
    table = scenario.law_tables[0]
    if not table.law.by_gains:
        able = " or ".join(kind for kind, known in law_kinds().items() if known.by_gains)
        raise InputError(f"`law` must be {able} for its gains to be tuned, got {table.law.name}.")
    return table


def _check_campaign(
    dispersed: Campaign | None, success: float | None, metric: str, until_sure: bool
) -> None:
    """Refuse arguments that need a campaign without one, and arguments that exclude one."""
    if until_sure and (dispersed is None or success == 1.0):
        got = "a success of 1" if dispersed else "none"
        raise InputError(f"`until_sure` must be with a campaign and a success below 1, got {got}.")
    if success is not None and dispersed is None:
        raise InputError(
            f"`success` must be absent without a campaign, whose draws it counts, got {success:g}."
        )
    if success is not None and not 0.0 < success <= 1.0:
        raise InputError(f"`success` must be above 0 and at most 1, got {success:g}.")
    if dispersed is not None and metric != ITAE:
        raise InputError(
            "`metric` must be absent with a campaign, whose share of flights that succeed is "
            f"maximised, got {metric}."
        )


def _count(
    count: Search, sets: Sequence[PIGains], wanted: float, until_sure: bool
) -> tuple[list[Trial], dict[str, Any]]:
    """Fly gains and start on all fresh draws, or until sure; return the shares that meet all."""
    trials: list[Trial] = []
    flags: list[npt.NDArray[np.bool_]] = []
    n, answers = 0, [""]
    ends = [*range(0, count.draws, LOOK if until_sure else count.draws), count.draws]
    for begin, n in pairwise(ends):
        trials = count.fly(sets, range(begin, n))
        # The search chose these gains on its own draws; a choice on the fresh draws would make the
        # interval false. Gains with an unstable loop have all draws already, without flights.
        flown = ~trials[0].default
        flags = [trial.excess[:n, flown].max(axis=1) <= 0.0 for trial in trials]
        if until_sure:
            answers = [sure(int(np.sum(~met)), n, 1.0 - wanted, CONFIDENCE) for met in flags]
        if answers[0]:
            break
    if until_sure:  # the draws decided how many there are, so an interval would not be valid
        shares = [{"value": float(met.mean()), "n": n} for met in flags]
        by, statuses = "evidence", [SURELY[answer] for answer in answers]
    else:
        # The lower end of the interval decides, unless even a perfect count has it below `wanted`.
        cycles = np.arange(n) // cycle(count.campaigns[0])
        by = "lo" if share(np.ones(n, dtype=bool), cycles).lo >= wanted else "value"
        shares = [share(met, cycles)._asdict() for met in flags]
        statuses = [MET[part[by] >= wanted] for part in shares]
    by_default = trials[0].default
    return trials, {
        "share": shares[0],
        "of_start": shares[1],
        "by": by,
        "sure": answers[0],
        "statuses": [
            status if (trial.excess[:, by_default] <= 0.0).all() else "missed"
            for status, trial in zip(statuses, trials, strict=True)
        ],
        "wanted": wanted,
        "worst_draw": trials[0].worst_draw,
        "seed": count.campaigns[0].seed,
    }


def _requirements(trial: Trial, start: Trial, active: Sequence[int]) -> Iterator[dict[str, Any]]:
    """The requirements with their values on the worst draw, and the shares that meet each."""
    draw = trial.worst_draw
    before = start.checks[draw % len(start.checks)]  # an unstable start has one draw
    for i, check in enumerate(trial.checks[draw]):
        yield {
            **stated(check),
            "active": i in active,
            "start": before[i].value,
            "share": float((trial.excess[:, i] <= 0.0).mean()),
            "share_start": float((start.excess[:, i] <= 0.0).mean()),
        }


def _worse(scenario: Scenario, law: Law, trial: Trial, start: Trial) -> Iterator[dict[str, Any]]:
    """Margins and errors at the end that are worse than with the gains of the start."""
    name = law.names_of(["0"])[0]
    flown = (entry_of(scenario, name, x.gains) for x in (trial, start))
    now, before = (models.loop_measures(entry, LOOP) for entry in flown)
    for measure in LOOP:
        if now.get(measure, 0.0) < (1.0 - NOTED) * before.get(measure, 0.0):
            lower = now.get(measure, math.nan)
            yield {"measure": f"loop.{measure}", "value": lower, "start": before[measure]}
    for channel, error in trial.ends.items():
        first = start.ends.get(channel, math.inf)
        if error > max(NO_ERROR, (1.0 + NOTED) * first):
            measure = f"{channel}.end_error_{'mps' if channel == AIRSPEED else 'rad'}"
            yield {"measure": measure, "value": error, "start": first}


def whole_cycles(campaign: Campaign, draws: int) -> int:
    """Smallest number of draws from `draws` up that is a whole number of cycles of the design."""
    return -(-draws // cycle(campaign)) * cycle(campaign)


def _required(scenario: Scenario) -> list[str]:
    """Labels of plants with requirements; in wind, aircraft first: others replay their wind."""
    plants = sorted(scenario.plant, key=lambda x: scenario.windy and x.aircraft is None)
    labels = (plant.label for plant in plants)
    return [label for label in labels if any(goes_by(label, x.plant) for x in scenario.expect)]


def _default_margins(scenario: Scenario) -> list[ExpectTable]:
    """`MARGINS` as a requirement, without those that the scenario bounds itself."""
    own = (name for table in scenario.expect for name in table.at_least.get("loop", ()))
    bounded = {*map(in_rad, own)}
    left = {name: bound for name, bound in MARGINS.items() if in_rad(name) not in bounded}
    return [ExpectTable(at_least={"loop": left})] if left else []


def _metric(row: Row, metric: str) -> float:
    if metric == ITAE:
        return row["chi.ITAE"] + row["gamma.ITAE"]
    if metric == MARGIN:
        return math.nan
    value = row[in_rad(metric)]
    if value is None:
        return math.inf
    return value if in_rad(metric) == metric else value / DEG


def _varied(gains: PIGains, factors: tuple[float, float]) -> PIGains:
    """Gains times factors on K_P and on K_I; gains that are rounding errors become zero."""
    K = np.where(np.abs(gains.K) < ROUNDING * np.abs(gains.K).max(), 0.0, gains.K)
    return _of_matrix(gains, K * np.repeat(factors, len(gains.errors)))


def _of_matrix(gains: PIGains, K: FloatArray) -> PIGains:
    """Gains with other numbers, stacked like `PIGains.K`."""
    K_P, K_I = np.hsplit(K, 2)
    return replace(gains, K_P=K_P, K_I=K_I)


def _squeezed(x: float) -> float:
    """A number between -1 and 1 that grows with `x`."""
    return x / (1.0 + abs(x)) if math.isfinite(x) else math.copysign(1.0, x)
