"""An autopilot's own parameters, found by flights and counted beside those that are flown now."""

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray, Floats
from flighttune.base.errors import InputError
from flighttune.base.files.whole import write_text
from flighttune.base.units import DEG_PER_RAD
from flighttune.base.words import listed
from flighttune.campaigns.engine.fliers import Fliers
from flighttune.campaigns.engine.kept import KeptRows
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.source import Flights
from flighttune.campaigns.statistics.count import flights_needed, supported_epsilon
from flighttune.campaigns.statistics.findings import findings_of
from flighttune.campaigns.statistics.intervals import rate_interval
from flighttune.claims import counted_flights, counting
from flighttune.control.controller import LawSetup
from flighttune.control.laws.autopilot import Autopilot, guidance
from flighttune.control.limits import Limits
from flighttune.control.margins import Margins
from flighttune.flight import conditions
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.logs.log import Columns
from flighttune.logs.parameter_file import changed_text, new_text, number_text
from flighttune.logs.parameters import Flown
from flighttune.studies.beside import (
    CONFIDENCE,
    CUT,
    EPSILON,
    KEPT,
    MEASURED,
    YOURS,
    accuracy_of,
    airspeed_words,
    check_one_airspeed,
    guidance_margins,
    guided,
    inner_loop_of,
    kept_error,
    kept_signals,
    lags_alone,
    logged_signals,
    tracking_of,
    within_flights,
)

TUNED = "tuned"

# The cost of a flight is the sum of root mean squares of these signals, each times its weight. The
# course costs nothing, but a swing about the track may not pay for the others.
WEIGHTS = {
    "cross track": (1.0, "m"),
    "height": (1.0, "m"),
    "airspeed": (1.0, "m/s"),
    "course": (0.0, "deg"),
}


class Constraint(NamedTuple):
    """What may hold a search, and of which quantity."""

    kind: str
    of: str

    def __str__(self) -> str:
        return f"the {self.kind} of {self.of}"


# Errors that are bounded by those of the start, with their units: means of root mean squares over
# the flights, and largest errors that 95 % of flights keep to, as few large ones change no mean.
MEAN, LARGEST = "mean error", "largest error"
BOUNDED = {Constraint(MEAN, of): unit for of, (_, unit) in WEIGHTS.items()}
BOUNDED |= {Constraint(LARGEST, of): unit for of, unit, _ in MEASURED.values()}

# Commands whose rates are bounded, by their columns, and the largest ratio of the root mean square
# of a rate to that of the start.
RATES, FASTER = {"roll": "phi_cmd", "load factor": "n_z_cmd"}, 2.0

# Largest ratio of each error to that of the start on the fresh draws. With errors of navigation,
# which no parameter removes, height would otherwise pay for the cross track. Counts of 93 draws
# repeat the ratio of a largest error within a standard deviation of 1 to 7 %: about three are
# allowed.
WORSE = {MEAN: 1.05, LARGEST: 1.2}
GROWTH = np.array([WORSE[error.kind] for error in BOUNDED]) - 1.0

# Share of this growth that a candidate may take on the draws of the search, as fresh draws show
# more of it or less, and its price as a share of the cost of the start: without one the search
# stays at the bound.
SEARCHED_GROWTH, PRICE = 0.8, 0.1

# Least margins of both loops.
GAIN_MARGIN_DB, PHASE_MARGIN_DEG = 6.0, 35.0

# A bound held the search if the result is within this share of it.
ACTIVE = 0.05

# Flights by default, draws of each candidate, candidates of a generation, and first step as a share
# of the range of a parameter.
BUDGET, DRAWS, POPULATION, STEP = 600, 6, 8, 0.15

# Candidates that fly on other draws than those of the search, and these draws: the best of many on
# few draws owes some of its lead to them.
FINALISTS, FINAL_DRAWS = 4, 12

# Significant digits of a parameter.
DIGITS = 3

# Weights of what is worse than any cost: a broken bound, a lost aircraft, a missed requirement, and
# rates or errors beyond their bound.
BROKEN, LOST, MISSED, BEYOND = 1e9, 1e6, 1e3, 1e1

# Beginnings of the parameters of TECS.
OF_TECS = "TECS_", "FW_T_"

# A range without an upper end is searched to so many times its default.
OPEN = 4.0


class Range(NamedTuple):
    """A searched parameter, by a number from 0 to 1: logarithmic, or square root from zero on."""

    name: str
    low: float
    high: float

    def at(self, x: float) -> float:
        """The value at a place from 0 to 1, in `DIGITS` digits, within the range."""
        grows = self.low > 0.0
        value = self.low * (self.high / self.low) ** x if grows else self.high * x * x
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)

    def place(self, value: float) -> float:
        """The place of a value, 0 to 1."""
        value = min(max(value, self.low), self.high)
        if self.low > 0.0:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return math.sqrt(value / self.high)


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """Parameters with their margins and, if they were flown, what their flights cost."""

    law: Autopilot
    margins: Sequence[Margins]  # of both loops; none if unstable
    way_back: float  # share of the roll that the way back to the track needs
    lost: int = 0
    missed: int = 0  # flights that miss a requirement
    cost: float = math.inf  # mean over the completed flights
    errors: FloatArray = field(default_factory=lambda: np.full(len(BOUNDED), np.nan))
    rates: FloatArray = field(default_factory=lambda: np.full(len(RATES), np.nan))
    each: Mapping[int, FloatArray] = field(default_factory=dict)  # errors of completed draws

    @cached_property
    def held(self) -> dict[Constraint, float]:
        """Each bound that needs no flight, with the value over the bound: beyond 1 it is broken."""
        if not self.margins:
            return {Constraint("stability", "the loop"): math.inf}
        used = {}
        for name, cut in zip(CUT, self.margins, strict=True):
            gain = 20.0 * math.log10(min(cut.gain_increase, 1.0 / max(cut.gain_decrease, 1e-9)))
            phase = math.degrees(cut.phase_margin)
            used[Constraint("gain margin", name)] = GAIN_MARGIN_DB / max(gain, 1e-9)
            used[Constraint("phase margin", name)] = PHASE_MARGIN_DEG / max(phase, 1e-9)
        return used | {Constraint("roll", "the way back to the track"): self.way_back}

    @property
    def allowed(self) -> bool:
        """Whether all bounds that need no flight are kept."""
        return max(self.held.values()) <= 1.0


def numbers(run: Run, scenario: Scenario | None) -> list[float]:
    """Root mean squares of the errors of a run, as `WEIGHTS`, and of the rates of its commands."""
    signals, V = run.signals, scenario.flight.V_a_mps if scenario else math.nan
    course, airspeed = DEG_PER_RAD * signals["chi_err"], signals["V_a"] - V
    errors = signals["cross_track"], signals["height_err"], airspeed, course
    rates = (np.diff(signals[column]) / np.diff(run.t) for column in RATES.values())
    return [math.sqrt(float(np.nanmean(np.square(x)))) for x in (*errors, *rates)]


class Search:
    """Flies candidates of one guidance on draws of a plan, and keeps all of them."""

    def __init__(self, plan: Plan, start: Autopilot, kept: KeptRows, draws: int) -> None:
        self.plan, self.kept, self.draws, self.flights = plan, kept, draws, 0
        self.scenario, self.model = plan.scenario, inner_loop_of(plan.scenario)
        self.V_g = self.scenario.flight.V_a_mps + _wind(plan, draws)
        limits = conditions.limits_on(self.scenario, self.scenario.aircraft)
        self.roll_limit = float(min(limits.upper[0], -limits.lower[0]))
        self.candidates: list[Candidate] = []
        self.start = self.fly([start])[0]

    def candidate(self, law: Autopilot) -> Candidate:
        """A candidate that has not flown, with its margins."""
        flight, dt = self.scenario.flight, 1.0 / self.scenario.controller.rate_hz
        made = law.make(LawSetup(dt=dt, limits=Limits.none(2), g=flight.g_mps2))
        made.roll_limit = min(made.roll_limit, self.roll_limit)
        margins = guidance_margins(self.scenario, self.model, law)
        on_route = self.scenario.route is not None
        return Candidate(law=law, margins=margins, way_back=on_route * made.way_back(self.V_g))

    def fly(self, laws: Sequence[Autopilot]) -> list[Candidate]:
        """Candidates with their flights; those beyond a bound do not fly, but for the start."""
        made = [self.candidate(law) for law in laws]
        flying = {f"c{n}": x for n, x in enumerate(made) if x.allowed or not self.candidates}
        rows = fly(self.plan, {n: x.law for n, x in flying.items()}, self.draws, self.kept)
        self.flights += len(rows)
        for n, candidate in enumerate(made):
            own = rows[rows["gains"] == f"c{n}"]
            made[n] = candidate if own.empty else with_flights(candidate, own)
        self.candidates += made
        return made

    def value(self, candidate: Candidate, shift: Floats = 0.0) -> float:
        """What the search minimises: bounds, then lost aircraft, requirements, rates and cost.

        `shift` is added to the growth of the errors.
        """
        if not candidate.allowed and candidate is not self.start:
            return BROKEN * (1.0 + sum(max(x - 1.0, 0.0) for x in candidate.held.values()))
        beyond = max([1.0, *self.used(candidate, shift).values()]) - 1.0
        cost = candidate.cost / self.start.cost if candidate.cost < math.inf else 0.0
        return (
            LOST * candidate.lost
            + MISSED * candidate.missed
            + BEYOND * beyond
            + (beyond > 0.0)  # costs are near 1: what is beyond a bound is worse than the start
            + cost
            + PRICE * float(np.nanmax(self.growth(candidate) + shift, initial=0.0))
        )

    def used(self, candidate: Candidate, shift: Floats = 0.0) -> dict[Constraint, float]:
        """Each bound that needs flights, with the value over the bound; none without a number."""
        rates = candidate.rates / self.start.rates / FASTER
        grown = (self.growth(candidate) + shift) / SEARCHED_GROWTH
        commands = (Constraint("rate", f"the commanded {x}") for x in RATES)
        used = dict(zip(commands, rates, strict=True)) | dict(zip(BOUNDED, grown, strict=True))
        return {name: float(x) for name, x in used.items() if not math.isnan(x)}

    # A model of lags keeps its airspeed exactly: a ratio of zeros is no number, and bounds nothing.
    @np.errstate(invalid="ignore")
    def growth(self, candidate: Candidate) -> FloatArray:
        """Growth of errors over those of the start and in the middle draw, over `GROWTH`."""
        both = sorted(candidate.each.keys() & self.start.each.keys())
        new, old = (
            np.array([x.each[draw] for draw in both]).reshape(-1, len(BOUNDED))
            for x in (candidate, self.start)
        )
        middle = np.median(new / old, axis=0) if both else np.nan
        return (np.fmax(bounded(new) / bounded(old), middle) - 1.0) / GROWTH

    def descend(self, ranges: Sequence[Range], budget: int) -> None:
        """Descend from the start within the ranges, up to `budget` flights."""
        warnings.filterwarnings("ignore", "Could not import matplotlib")  # of cma
        import cma

        # Covariance matrix adaptation (N. Hansen, arXiv 1604.00772) on places from 0 to 1.
        start = self.start.law
        begin = [x.place(start.parameters[x.name]) for x in ranges]
        settings = {"popsize": POPULATION, "seed": 1, "bounds": [0.0, 1.0], "verbose": -9}
        strategy = cma.CMAEvolutionStrategy(begin, STEP, settings)
        while not strategy.stop() and self.flights + POPULATION * self.draws <= budget:
            asked = strategy.ask()
            values = ({r.name: r.at(x) for r, x in zip(ranges, y, strict=True)} for y in asked)
            laws = [replace(start, parameters={**start.parameters, **x}) for x in values]
            strategy.tell(asked, [self.value(x) for x in self.fly(laws)])

    @property
    def best(self) -> Candidate:
        """The best candidate within the bounds; the start if none is better."""
        inside = [x for x in self.candidates if x.allowed]
        return min([self.start, *inside], key=self.value)

    def choose(self, final: "Search") -> Candidate:
        """The best of the start and a few candidates on the draws of another search."""
        left = [x for x in self.candidates if x.allowed and x is not self.start]
        shift: FloatArray = np.zeros(len(BOUNDED))
        while left and len(final.candidates) <= FINALISTS:
            chosen = min(left, key=partial(self.value, shift=shift))
            left = [x for x in left if x.law.parameters != chosen.law.parameters]
            (flown,) = final.fly([chosen.law])
            # Errors of similar candidates grow by similar amounts more on these draws.
            shift = np.nan_to_num(final.growth(flown) - self.growth(chosen))
        return final.best


def fly(plan: Plan, laws: Mapping[str, Autopilot], draws: int, kept: KeptRows) -> pd.DataFrame:
    """Rows of guidances on the first draws of a plan; ``gains`` has their names."""
    if not laws:
        return pd.DataFrame({"gains": []})
    both = guided(plan, laws)
    names = dict(zip(laws, both.groups, strict=False))
    both = replace(both, groups=both.groups[:-1])
    both = both.with_runs(draws * len(both.groups))
    probes = {"kept": numbers, KEPT: kept_signals}
    rows = kept.flown(both, probes, doing="searching")
    frame = findings_of(pd.DataFrame(rows), both).rows
    frame["gains"] = frame["gains"].map({group.gains: name for name, group in names.items()})
    return frame


def with_flights(candidate: Candidate, rows: pd.DataFrame) -> Candidate:
    """A candidate with what its flights cost."""
    done = rows[rows["status"] == "completed"]
    lost = len(rows) - len(done)
    missed = int((~done["success"].astype(bool)).sum())
    if done.empty:
        return replace(candidate, lost=lost)
    errors = errors_of(done)
    rates = np.array([kept[len(WEIGHTS) :] for kept in done["kept"]], dtype=float)
    return replace(
        candidate,
        lost=lost,
        missed=missed,
        cost=float(costs(errors).mean()),
        errors=bounded(errors),
        rates=rates.mean(axis=0),
        each=dict(zip(done["draw"].tolist(), errors, strict=True)),
    )


def errors_of(rows: pd.DataFrame) -> FloatArray:
    """Root mean squares and largest errors of completed flights, shape (n, 9), as `BOUNDED`."""
    kept = np.array([x[: len(WEIGHTS)] for x in rows["kept"]], dtype=float)
    factors = [factor for *_, factor in MEASURED.values()]
    largest = rows[[*MEASURED]].to_numpy(dtype=float) * factors
    return np.hstack([kept.reshape(-1, len(WEIGHTS)), largest])


def bounded(errors: FloatArray) -> FloatArray:
    """Errors as `BOUNDED` over flights with errors of shape (n, 9); NaN without flights."""
    if not len(errors):
        return np.full(len(BOUNDED), np.nan)
    means, largest = np.split(errors, [len(WEIGHTS)], axis=1)
    return np.hstack([means.mean(axis=0), kept_error(largest)])


def costs(errors: FloatArray) -> FloatArray:
    """Cost of flights with errors of shape (n, 9), as `BOUNDED`."""
    weights = np.array([weight for weight, _ in WEIGHTS.values()])
    return np.asarray(errors[:, : len(weights)] @ weights)


def _wind(plan: Plan, draws: int) -> float:
    """Largest speed of the steady wind in the first draws of a plan, m/s."""
    stated = plan.scenario.wind.speed_mps if plan.scenario.wind else 0.0
    drawn = plan.with_runs(draws).parameters(0, draws)
    return float(drawn["wind.speed_mps"].max()) if "wind.speed_mps" in drawn else float(stated or 0)


def ranges_of(now: Flown, place: str) -> tuple[list[Range], list[str]]:
    """The searched parameters with their published ranges, and notes on those left out."""
    table = guidance()[now.law.period]
    published = {
        name: (default, low, high) for name, default, _, _, low, high in table["parameters"]
    }
    source = {row["name"]: row["from"] for row in now.rows}
    of_tecs = [name for name in table["searched"] if name.startswith(OF_TECS)] * now.older_tecs
    searched = [name for name in table["searched"] if name not in of_tecs]
    stated = {name for name in searched if source[name] == place}
    ranges = []
    for name in searched:
        default, low, high = published[name]
        if name in stated:
            ranges.append(Range(name, low, high if high < math.inf else OPEN * default))
    absent = [name for name in searched if name not in stated]
    if not ranges:
        raise InputError(
            f"{place}: must state one of {', '.join(searched)}, which are searched, got none that "
            "this version flies."
        )
    said = f"Not searched, as the file does not state them for this version: {listed(absent)}."
    older = f"Not searched, as the TECS of this version is not the emulated one: {listed(of_tecs)}."
    return ranges, [said] * bool(absent) + [older] * bool(of_tecs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Retuned(Answering):
    """A user's parameters and those that a search found, on the same fresh draws.

    Attributes
    ----------
    now : Flown
        The guidance with the user's parameters.
    file : Path
        The file or log with them.
    plan : Plan
        The fresh draws.
    rows : DataFrame
        A row for each flight of the count; ``gains`` is ``yours`` or ``tuned``.
    start, best : Candidate
        Both with the flights of the count.
    flights, candidates, finalists : int
        Numbers of all flights, of candidates of which some never flew, and of those that flew on
        other draws than those of the search.
    held_by : tuple of Constraint
        The bounds that hold the result, or that refused what costs less.
    against : tuple of str
        Why the result is not written; empty if it is better.
    notes : tuple of str
        Sentences on parameters that were not searched, on the aircraft, and on the log.
    tracking : list of dict
        Signals of the log between minimum and maximum of the flights with the user's parameters,
        as 95th percentiles of their sizes; empty without a log.
    """

    now: Flown
    file: Path
    plan: Plan
    rows: pd.DataFrame
    start: Candidate
    best: Candidate
    flights: int
    candidates: int
    finalists: int
    held_by: tuple[Constraint, ...]
    against: tuple[str, ...]
    notes: tuple[str, ...]
    tracking: list[dict[str, Any]]

    @property
    def changes(self) -> dict[str, float]:
        """Changed parameters with their new values, by name."""
        old = self.start.law.parameters
        return {x: v for x, v in self.best.law.parameters.items() if v != old[x]}

    @property
    def searched(self) -> dict[str, str]:
        """The parameters that a search may change, with their roles."""
        table = guidance()[self.now.law.period]
        return {x: role for x, _, role, *_ in table["parameters"] if x in table["searched"]}

    @property
    def accuracy(self) -> list[dict[str, Any]]:
        """Bounds on errors of a new flight with both, and draws in which the result is better."""
        return accuracy_of(self.rows, self.plan.draws, TUNED)

    @property
    def better(self) -> bool:
        """Whether the result may be written."""
        return not self.against

    @property
    def lost_at_most(self) -> dict[str, float]:
        """Shares of all flights that at most are lost with both, each at `CONFIDENCE`."""
        n, both = self.plan.draws, {YOURS: self.start, TUNED: self.best}
        return {name: supported_epsilon(x.lost, n, CONFIDENCE) for name, x in both.items()}

    @property
    def sure_from(self) -> int:
        """Smallest number of draws of the count in which the better one surely is better."""
        n = self.plan.draws
        return next((k for k in range(n + 1) if surely_more(k, n)), n + 1)

    def save_parameters(self, path: str | Path) -> Path:
        """Write the user's file with the changed values alone changed, and a comment.

        Of a log: a new file of the changed parameters. InputError if the result is not better.
        """
        if self.against:
            raise InputError(f"{path}: must be better to be written: {listed(self.against)}.")
        if self.of_log:
            px4 = self.now.law.period != "NAVL1_PERIOD"
            text = new_text(self.changes, self.comment, px4=px4)
        else:
            text = changed_text(self.file, self.changes, self.comment)
        return write_text(Path(path), text)

    @property
    def of_log(self) -> bool:
        """Whether the parameters are those of a log."""
        return self.file.suffix.lower() in (".ulg", ".bin", ".tlog", ".log")

    @property
    def larger(self) -> list[str]:
        """Errors of the `accuracy` that grow by more than 5 %, in words."""
        return [
            f"{row['of']} {row[YOURS]:.3g} | {row[TUNED]:.3g} {row['unit']}"
            for row in self.accuracy
            if row[TUNED] > WORSE[MEAN] * row[YOURS]
        ]

    @property
    def comment(self) -> list[str]:
        """What was flown, in lines of the file that is written."""
        old = self.start.law.parameters
        changed = (
            f"{x} {number_text(old[x])} to {number_text(v)}" for x, v in self.changes.items()
        )
        errors = (
            f"{row['of']} {row[YOURS]:.3g} to {row[TUNED]:.3g} {row['unit']}"
            for row in self.accuracy[:3]
        )
        return [
            f"Changed by flighttune: {', '.join(changed)}.",
            "Flown on an emulation of guidance and height above the inner loop of this program, "
            "not on the firmware.",
            airspeed_words(self.plan, self.now)[0],
            f"{self.plan.campaign.title}; {self.plan.draws} fresh draws: "
            f"lost {self.start.lost} with the old, {self.best.lost} with the new; "
            f"{', '.join(errors)}.",
            *lags_alone(self.plan),
            *self.plan.scenario.assumptions,
        ]


class Counts(NamedTuple):
    """Numbers of flights of a search, a log beside which those of the count stand, and a file."""

    budget: int = BUDGET
    fresh: int | None = None  # draws of the count
    log: str | None = None  # LOG@START:END for a part of it, s
    columns: Columns = ()  # of the signals in the log
    kept: Path | None = None  # file for the flights while they are flown


def retune(
    stated: Flights, file: Path, now: Flown, version: str | None, counts: Counts, fliers: Fliers
) -> Retuned:
    """Search the parameters of a file on the first aircraft of a source, and count the result."""
    plan = counting.drawn(stated)
    if plan.scenario.route is None:
        raise InputError(f"{stated.place}: must be a route, to search parameters, got none.")
    check_one_airspeed(str(stated.place), plan.scenario)
    with_others = counted_flights.distribution_of(plan.campaign, plan.groups[0].plant)
    counted_flights.check_random(stated.place, with_others, plan.campaign.central)
    logged, differ = [], []
    if counts.log:
        logged, differ = logged_signals(counts.log, counts.columns, now, version)
    with WorkerPool(fliers) as pool:
        found = _retuned(plan, now, file, counts, pool)
    tracking = tracking_of(logged, found.rows)
    notes = (*found.notes, *differ, *within_flights(tracking))
    return replace(found, tracking=tracking, notes=notes)


def _retuned(plan: Plan, now: Flown, file: Path, counts: Counts, pool: WorkerPool) -> Retuned:
    ranges, notes = ranges_of(now, file.name)
    fresh = counts.fresh or flights_needed(EPSILON, CONFIDENCE, 1)
    finals = (1 + FINALISTS) * FINAL_DRAWS
    budget, least = counts.budget, 2 * fresh + finals + (1 + POPULATION) * DRAWS
    if budget < least:
        raise InputError(
            f"`budget` must be at least {least} flights, {2 * fresh} of them for the count on "
            f"fresh draws, got {budget}."
        )
    drawn = {row["name"]: row["value"] for row in now.rows}
    full = replace(
        now.law, parameters={**{x.name: drawn[x.name] for x in ranges}, **now.law.parameters}
    )
    searched, chosen = (
        replace(plan, campaign=plan.campaign.model_copy(update={"seed": plan.campaign.seed + n}))
        for n in (1, 2)
    )
    decides = {"plan": plan.as_dict(), "start": dict(full.parameters)}
    kept = KeptRows(counts.kept, decides, pool)
    pool.progress.budget = budget - len(kept)
    search = Search(searched, full, kept, DRAWS)
    search.descend(ranges, budget - 2 * fresh - finals)
    final = Search(chosen, full, kept, FINAL_DRAWS)
    best = search.choose(final)
    laws = {YOURS: full, TUNED: best.law}
    rows = fly(plan, laws, fresh, kept)
    kept.remove()
    start, result = (
        with_flights(search.candidate(law), rows[rows["gains"] == name])
        for name, law in laws.items()
    )
    return Retuned(
        now=now,
        file=file,
        plan=plan.with_runs(fresh),
        rows=rows,
        start=start,
        best=result,
        flights=search.flights + final.flights + len(rows),
        candidates=len(search.candidates),
        finalists=len(final.candidates) - 1,
        held_by=(*_held_by(search, final, ranges),),
        against=(*_against(start, result, rows),),
        notes=(*lags_alone(plan), *notes, *now.notes, *_beyond(now)),
        tracking=[],
    )


def _beyond(now: Flown) -> list[str]:
    """A sentence on parameters beyond their published ranges, which no candidate leaves."""
    return [f"Beyond their published ranges: {listed(now.beyond)}."] * bool(now.beyond)


def _held_by(search: Search, final: Search, ranges: Sequence[Range]) -> list[Constraint]:
    """The bounds within `ACTIVE` of the result, or those that refuse whatever costs less."""
    best = final.best
    if best is final.start:
        # The finalists tell more than the search, if there are any.
        of = final if len(final.candidates) > 1 else search
        cheaper = [x for x in of.candidates if x.cost < of.start.cost]
        refused = min(cheaper, key=lambda x: x.cost, default=None)
        used = {} if refused is None else refused.held | of.used(refused)
        return [name for name, share in used.items() if share > 1.0]
    held = [x for x, share in (best.held | final.used(best)).items() if share >= 1.0 - ACTIVE]
    places = {x: x.place(best.law.parameters[x.name]) for x in ranges}
    low, high = ACTIVE / 5.0, 1.0 - ACTIVE / 5.0
    return held + [Constraint("range", x.name) for x, at in places.items() if not low < at < high]


def _against(start: Candidate, best: Candidate, rows: pd.DataFrame) -> list[str]:
    """Reasons not to write the result, lost aircraft first; none if it is better."""
    if best.law.parameters == start.law.parameters:
        return ["no candidate was better than your parameters"]
    n = len(rows) // 2
    said = []
    if best.lost > start.lost:
        said.append(f"it loses {best.lost} of {n} aircraft, yours {start.lost}")
    said += [f"{name} is beyond its bound" for name, used in best.held.items() if used > 1.0]
    if best.missed > start.missed:
        said.append(f"{best.missed} of {n} flights miss a requirement, {start.missed} with yours")
    ratios = best.rates / start.rates
    said += [
        f"the commanded {name} moves {ratio:.2g} times as fast as with yours, beyond {FASTER:g}"
        for name, ratio in zip(RATES, ratios, strict=True)
        if ratio > FASTER
    ]
    errors = of_draws(rows)
    old, new = (bounded(errors[name]) for name in (YOURS, TUNED))
    for i, (error, unit) in enumerate(BOUNDED.items()):
        _, surely = larger(errors[TUNED][:, i], errors[YOURS][:, i])
        # A few draws decide a largest error: how many draws enlarge theirs says nothing of it.
        if (surely or error.kind == LARGEST) and new[i] > (1.0 + GROWTH[i]) * old[i]:
            said.append(
                f"{error} grows from {old[i]:.3g} to {new[i]:.3g} {unit}, by more than "
                f"{100.0 * GROWTH[i]:.0f} %"
            )
    wins, surely = larger(costs(errors[YOURS]), costs(errors[TUNED]))
    if not (best.cost < start.cost and surely):
        said.append(
            f"it costs {best.cost:.3g} a flight, yours {start.cost:.3g}, and less in {wins} of "
            f"{len(errors[YOURS])} draws: that is not surely better"
        )
    return said


def of_draws(rows: pd.DataFrame) -> dict[str, FloatArray]:
    """Errors of both, each of shape (n, 9), in the draws that both completed."""
    done = rows[rows["status"] == "completed"].set_index("draw")
    of_each = {name: done[done["gains"] == name] for name in (YOURS, TUNED)}
    both = of_each[YOURS].index.intersection(of_each[TUNED].index)
    return {name: errors_of(of_law.loc[both]) for name, of_law in of_each.items()}


def larger(a: FloatArray, b: FloatArray) -> tuple[int, bool]:
    """In how many draws `a` is the larger, and whether it surely is in more than half of them."""
    wins = int((a > b).sum())
    return wins, surely_more(wins, len(a))


def surely_more(wins: int, draws: int) -> bool:
    """Whether so many wins surely are more than half of all draws."""
    low, _ = rate_interval(wins, draws, CONFIDENCE, method="clopper-pearson")
    return float(low) > 0.5
