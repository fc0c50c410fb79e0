"""A user's present guidance compared with the gains of a scenario, on the same draws."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Unpack, overload

import numpy as np
import pandas as pd

from flighttune.base.answering import Answering
from flighttune.base.arrays import FloatArray
from flighttune.base.errors import InputError, keeping
from flighttune.base.files import code
from flighttune.base.units import DEG_PER_RAD, RadiansPerSecond
from flighttune.base.words import listed
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.kept import KeptRows
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.flying.rows import Row
from flighttune.campaigns.planning.knowing import Knowledge
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.schema import Campaign
from flighttune.campaigns.planning.source import Flights, campaign_on
from flighttune.campaigns.planning.source import flights as flights_of_source
from flighttune.campaigns.statistics.count import allowed_outside, flights_needed
from flighttune.campaigns.statistics.findings import findings_of
from flighttune.campaigns.statistics.intervals import paired, rate_interval, scores
from flighttune.claims import counted_flights, counting
from flighttune.control.controller import LawSetup
from flighttune.control.gains import NO_FEEDBACK, PIGains, rate_gains
from flighttune.control.law import made_law
from flighttune.control.laws.autopilot import Autopilot
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel, inner_feedback
from flighttune.control.margins import Loop, Margins, cut_margins
from flighttune.flight import conditions, models
from flighttune.flight.load import LAGS_ALONE, SPEED
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.load import scenario_from
from flighttune.flight.scenario.schema import Scenario
from flighttune.gaps.compare import Comparison, Runs, compare_runs
from flighttune.logs.log import Columns, load_part
from flighttune.logs.parameters import Flown, flown_now
from flighttune.routes.follow import RouteReference
from flighttune.routes.items import SETS_AIRSPEED
from flighttune.routes.mission import ROUTE_FILES
from flighttune.studies.log_aircraft import aircraft_of

# Epsilon and confidence of the bounds on errors.
EPSILON, CONFIDENCE = 0.05, 0.95

# Number of flights with the largest of each error that JSBSim repeats: the bounds follow from them.
LARGEST_AGAIN = 3

# Cuts of the loops.
CUT = "roll", "lift"

YOURS, OURS = "yours", "ours"

# Measures in the user's terms, with their unit and its factor.
MEASURED = {
    "flight.cross_track_m": ("cross track", "m", 1.0),
    "flight.height_err_m": ("height", "m", 1.0),
    "flight.V_a_dev_mps": ("airspeed", "m/s", 1.0),
    "chi.peak_rad": ("course", "deg", DEG_PER_RAD),
    "gamma.peak_rad": ("path angle", "deg", DEG_PER_RAD),
}

# Share of the time for a quantile of a signal, and the signals of a log that are compared with the
# flights, with unit and factor.
SHARE = 0.95
LOGGED = {
    "cross_track": ("cross track", "m", 1.0),
    "height_err": ("height", "m", 1.0),
    "phi_cmd": ("commanded roll", "deg", DEG_PER_RAD),
}

# Change of airspeed by gusts, as a share: nearer to an end of its range an aircraft would leave it.
GUSTS = 0.2

# Relative difference of an airspeed from the autopilot's own from which on it is said first.
FAR = 0.15

# Relative difference that counts as none: a log has parameters with single precision.
SINGLE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Beside(Answering):
    """A user's guidance and the gains of a scenario on the same draws.

    Attributes
    ----------
    now : Flown
        The user's guidance.
    plan : Plan
        The flights: each draw first with the guidance, then with the gains.
    rows : DataFrame
        A row for each flight, as in a campaign; ``gains`` is ``yours`` or ``ours``.
    tracking : list of mapping
        Tracking errors of the log and of the flights with the guidance; empty without a log.
    notes : tuple of str
        Sentences about the log and assumptions.
    """

    now: Flown
    plan: Plan
    rows: pd.DataFrame
    tracking: list[dict[str, Any]]
    notes: tuple[str, ...] = ()

    @property
    def accuracy(self) -> list[dict[str, Any]]:
        """Bounds on errors of a new flight, and number of draws in which ours are smaller."""
        return accuracy_of(self.rows, self.plan.draws, OURS)

    @property
    def margins(self) -> dict[str, Sequence[Margins]]:
        """Margins of both loops behind the identified inner loop; empty without its model."""
        with suppress(InputError):
            return loops(self.plan, self.now)
        return {}


def accuracy_of(rows: pd.DataFrame, n: int, ours: str) -> list[dict[str, Any]]:
    """Bounds on errors of a new flight by gain set, and number of n draws in which `ours` wins."""
    answer = []
    for measure, (words, unit, factor) in MEASURED.items():
        if rows[measure].isna().all():
            continue
        row: dict[str, Any] = {"of": words}
        for name, of_law in rows.groupby("gains"):
            row[str(name)] = float(kept_error(scores(of_law, measure))) * factor
        (pair,) = paired(rows, measure)
        better = pair["wins_a" if pair["a"] == ours else "wins_b"]
        lo, hi = rate_interval(better, n, CONFIDENCE, method="clopper-pearson")
        row |= {"unit": unit, "better": better, "share": better / n}
        answer.append(row | {"lo": float(lo), "hi": float(hi), "flights": n})
    return answer


def kept_error(errors: FloatArray) -> FloatArray:
    """Bound on an error of a new flight by n flights, or the largest if they are too few.

    `errors` have the shape (n, ...).
    """
    place = max(allowed_outside(len(errors), EPSILON, CONFIDENCE), 0)
    return np.asarray(np.sort(errors, axis=0)[-1 - place])


def loops(plan: Plan, now: Flown) -> dict[str, Sequence[Margins]]:
    """Margins of each loop cut at roll and at lift, behind the identified inner loop."""
    scenario, ours = plan.scenario, our_rate_gains(plan)
    model = inner_loop_of(scenario)
    # On a route the loops over the distances are closed too: the period sets the user's loop, and
    # the look-ahead sets ours.
    reference = conditions.reference_of(scenario)
    per_T = 1.0 / reference.look_ahead if isinstance(reference, RouteReference) else 0.0
    rows = np.array([ours.K_P, ours.K_I + ours.K_P * per_T, ours.K_I * per_T])
    loop = _guided(model, rows, ours.feedback)
    return {YOURS: guidance_margins(scenario, model, now.law), OURS: cut_margins(loop, CUT)}


def inner_loop_of(scenario: Scenario) -> LinearModel:
    """The identified inner loop of the first aircraft; InputError without one."""
    return models.identified_models(scenario, made_law("exact"))[0].model


def guidance_margins(scenario: Scenario, model: LinearModel, law: Autopilot) -> Sequence[Margins]:
    """Margins of a guidance cut at roll and at lift, behind an inner loop; none if unstable."""
    flight, dt = scenario.flight, 1.0 / scenario.controller.rate_hz
    made = law.make(LawSetup(dt=dt, limits=Limits.none(2), g=flight.g_mps2))
    a, b, c, d = (np.diag(x) for x in made.linear(flight.V_a_mps))
    # Without a route the loops over the distances are open.
    on = float(scenario.route is not None)
    return cut_margins(_guided(model, np.array([a, c + b * on, d * on]), NO_FEEDBACK), CUT)


def our_rate_gains(plan: Plan) -> PIGains:
    """Gains of the plan for the rates of course and path angle."""
    gains, flight = plan.gain_sets[plan.groups[-1].gains], plan.scenario.flight
    assert gains is not None  # of the chosen group
    return rate_gains(gains, V_a=flight.V_a_mps, g=flight.g_mps2)


def _guided(model: LinearModel, rows: FloatArray, feedback: Sequence[float]) -> Loop:
    """The loop of ``u = P e + Q y + R integral of y`` with ``y' = e``; `rows` are P, Q and R."""
    n, m, p = model.shape
    A = np.zeros((n + 2 * p, n + 2 * p))
    A[:n, :n], A[n : n + p, :n], A[n + p :, n : n + p] = model.A, model.C, np.eye(p)
    k, of_state = inner_feedback(model, feedback)
    C = np.hstack([rows[0] @ model.C, rows[1], rows[2]]) * (1.0 + k)[:, None]
    C[:, :n] -= of_state
    # An integral without an input would count as unstable.
    used = np.concatenate([np.ones(n, bool), *(rows[i:].any(axis=(0, 1)) for i in (1, 2))])
    B = np.vstack([model.B, np.zeros((2 * p, m))])
    return A[np.ix_(used, used)], B[used], -C[:, used]


# Probe of a flight with the quantiles of its signals.
KEPT = "kept_signals"


def kept_signals(run: Run, _scenario: Scenario | None) -> list[float]:
    """Quantiles at `SHARE` of the signals of `LOGGED`; NaN for a missing signal."""
    # A log has the errors that its autopilot saw, and so has a flight with navigation errors.
    seen = [f"{name}_seen" if f"{name}_seen" in run.signals else name for name in LOGGED]
    kept = run.signals.reindex(columns=seen).abs().quantile(SHARE)
    return [value * factor for value, (*_, factor) in zip(kept, LOGGED.values(), strict=True)]


@overload
def compare(
    a: str | Path | Runs, *others: str | Path | Runs, columns: Columns = ...
) -> Comparison: ...


@overload
def compare(
    a: Flights | Scenario | Campaign | Plan | str | Path, *, autopilot: str | Path, **options: Any
) -> Beside: ...


@code.flies
def compare(  # type: ignore[misc]  # noqa: PLR0913 - each is a choice, and has a default
    a: Flights | Scenario | Campaign | Plan | Runs | str | Path,
    *others: str | Path | Runs,
    columns: Columns = (),
    autopilot: str | Path | None = None,
    version: str | None = None,
    log: str | None = None,
    flights: int | None = None,
    aircraft: str | None = None,
    assume: Mapping[str, RadiansPerSecond] | None = None,
    like: str | None = None,
    navigation: Knowledge | None = None,
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
    kept: str | Path | None = None,
    **by: Unpack[FlownBy],
) -> Comparison | Beside:
    """Compare runs with the runs of the first source, or gains with the present guidance.

    With `autopilot` the flights of a mission, scenario or campaign are flown by its gains and by
    the guidance of PX4 or ArduPilot with the user's parameters, on the same draws. The guidance
    consists of the published equations of NPFG or L1 and of TECS, above this program's inner loop
    and throttle. It follows the planned path itself, with its arcs.

    Parameters
    ----------
    a : str, path-like, Run, FlownScenario, Source, Flights, Scenario, Campaign or Plan
        Source to compare with. A string may name a run folder, a Parquet file, a recording or
        ``scenario@gains``. With `autopilot`: a source for `flights`, or ``SCENARIO@GAINS``.
    others : str, path-like, Run, FlownScenario or Source
        Further sources. Without any, the first run of `a` is compared with its other runs.
    columns : mapping or sequence
        Columns of the signals in a log, as for `load_log`.
    autopilot : str or Path, optional
        Compare with the guidance of this autopilot: its parameters from QGroundControl (.params) or
        Mission Planner (.param, .parm), or its log (.ulg, .bin, .tlog).
    version : str, optional
        Version of the autopilot, such as 1.15, by default from the file.
    log : str, optional
        Check the guidance by a log that was flown with these parameters; LOG@START:END for a part
        of it in s.
    flights : int, optional
        Number of draws to fly with both, by default 93.
    aircraft, assume : as for `meet`
    seed, changes, workers, scheduler, observer : as for `band`
    like, navigation : as for `mission`
    kept : str or Path, optional
        File for the flights with both while they are flown: after a kill the same call goes on. Its
        name gets eight digits of what decides the flights, so that other calls keep their own.

    Returns
    -------
    Comparison or Beside
        For runs: `comparable` is False, with a reason, if the manoeuvres (start, length, reference)
        or aircraft differ. A kinematic plant may be compared with an aircraft. If one of two runs
        ended early, both are measured over their common time. With an autopilot: the `accuracy` and
        `margins` of both, and the `rows` of all flights.

    Raises
    ------
    InputError
        If there is nothing to compare with, a source cannot be read or flown, or the parameters do
        not belong to an aeroplane.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> comparison = ft.compare(ft.fly(ft.load_scenario("level_turn")))
    >>> [pair.b.label for pair in comparison.pairs]
    ['kinematic / tuned', 'jsbsim:aerosonde / paper', 'jsbsim:aerosonde / tuned']
    """
    fliers, of_flights = Fliers(**by), {"aircraft": aircraft, "like": like, "changes": changes}
    if autopilot is None:
        options = {"version": version, "log": log, "flights": flights, "seed": seed}
        options |= {"navigation": navigation, "kept": kept, "assume": assume}
        for name, value in (of_flights | options).items():
            if value not in (None, False, {}):
                raise InputError(f"`{name}` must be absent without the parameters of an autopilot.")
        if not isinstance(a, str | Path | Runs):
            raise InputError(f"`a` must be runs, got a {type(a).__name__}: `fly` it.")
        return compare_runs([a, *others], columns)
    if others or isinstance(a, Runs):
        raise InputError("`autopilot` must be compared with one source of flights, got runs.")
    now = flown_now(autopilot, version)
    place, _, gains = str(a).partition("@") if isinstance(a, str) else (a, "", "")
    of_flights["aircraft"], lags = aircraft_of(aircraft, columns, assume)
    stated = at_own_airspeed(place, of_flights, now).knowing(navigation)
    plan = counting.drawn(stated, gains=gains or None).with_seed(seed)
    check_one_airspeed(str(stated.place), plan.scenario)
    plan = _with_guidance(plan, now)
    group = plan.groups[0]
    if flights is None:
        flights = flights_needed(EPSILON, CONFIDENCE, 1)
        with_others = counted_flights.distribution_of(plan.campaign, group.plant)
        try:
            counted_flights.check_random(stated.place, with_others, plan.campaign.central)
        except InputError:
            flights = 1  # all flights would be equal
    plan = plan.with_runs(flights * len(plan.groups))
    logged, notes = ([], []) if log is None else logged_signals(log, columns, now, version)
    with WorkerPool(fliers) as pool:
        of_flights = KeptRows(None if kept is None else Path(kept), plan.as_dict(), pool)
        rows = of_flights.flown(plan, {KEPT: kept_signals})
        with keeping(of_flights.file):
            pool.check_compiled(plan, deciding(rows))
        of_flights.remove()
    frame = findings_of(pd.DataFrame(rows), plan).rows
    frame["gains"] = np.where(frame["gains"] == group.gains, YOURS, OURS)
    tracking = tracking_of(logged, frame)
    notes = [*lags, *lags_alone(plan), *notes, *within_flights(tracking)]
    return Beside(now=now, plan=plan, rows=frame, tracking=tracking, notes=tuple(notes))


def at_own_airspeed(source: Any, options: Mapping[str, Any], now: Flown) -> Flights:
    """Flights of a source, of a mission that leaves it open at the autopilot's own airspeed.

    Without room for gusts in the range of the aircraft, or where the mission cannot be flown at
    this airspeed, it is flown as stated.
    """
    stated, changes = flights_of_source(source, **options), options.get("changes") or {}
    scenario, route = stated.scenario, stated.scenario.route
    if now.airspeed is None or scenario.airspeed or route is None or not route.airspeed_assumed:
        return stated
    _, V = now.airspeed
    if not scenario.aircraft or without_room(scenario, V):
        return stated
    with suppress(InputError):
        return flights_of_source(source, **{**options, "changes": changes | {SPEED: V}})
    return stated


def without_room(scenario: Scenario, V: float) -> str:
    """The range of the first aircraft without room for gusts at an airspeed; empty if all have."""
    for low, high in (table.config.envelope.V_a for table in scenario.aircraft):
        if not low / (1.0 - GUSTS) <= V <= high / (1.0 + GUSTS):
            return f"{low:g} to {high:g} m/s"
    return ""


def aircraft_words(plan: Plan) -> str:
    """The aircraft that flies a plan."""
    (table, *_) = plan.scenario.plant
    return f"the lags of {table.identified_model.aircraft}" if table.identified else table.label


def airspeed_words(plan: Plan, now: Flown) -> tuple[str, bool]:
    """A sentence on aircraft and airspeed of the flights, and whether it stands first.

    It does if the airspeed is far from that of the autopilot.
    """
    V, said = plan.scenario.flight.V_a_mps, f"Flown by {aircraft_words(plan)} at "
    if now.airspeed is None:
        return f"{said}{V:g} m/s.", False
    name, own = now.airspeed
    if math.isclose(V, own, rel_tol=SINGLE):
        return f"{said}{V:g} m/s, {name} of your file.", False
    way = f"`--set {SPEED}={own:g}` flies it"
    if of_aircraft := without_room(plan.scenario, own):
        way = f"the range of this aircraft, {of_aircraft}, has no room for gusts there"
    return f"{said}{V:g} m/s; your file has {name} {own:g} m/s: {way}.", abs(V / own - 1.0) > FAR


def deciding(rows: Sequence[Row]) -> set[int]:
    """Runs that decide bounds on errors: those not completed, and the largest of each error."""
    frame = pd.DataFrame(rows).set_index("run")
    runs = {*frame.index[frame["status"] != "completed"]}
    for _, own in frame.groupby("gains"):
        for measure in MEASURED:
            runs |= {*own[measure].astype(float).nlargest(LARGEST_AGAIN).index}
    return {int(run) for run in runs}


def lags_alone(plan: Plan) -> list[str]:
    """A sentence on flights of an identified model; none on those of another plant."""
    flown = {group.plant for group in plan.groups}
    models = (table.identified for table in plan.scenario.plant if table.label in flown)
    return [LAGS_ALONE] if any(models) else []


def check_one_airspeed(place: str, scenario: Scenario) -> None:
    """Refuse changes of airspeed, which are not emulated, and name the remedy."""
    if not scenario.airspeed:
        return
    start = f"{scenario.flight.V_a_mps:g}"
    notes = scenario.route.notes if scenario.route else ()
    said = " ".join(note for note in notes if note.startswith(SETS_AIRSPEED))
    if scenario.route is None:
        cure = "leave `V_mps` of [reference] out"
    elif place.endswith(ROUTE_FILES):
        cure = f"`--set flight.V_a_mps={start}` flies all of it at {start} m/s"
    else:
        cure = f"`--set route.holds_airspeed=false` flies all of it at {start} m/s"
    raise InputError(
        f"{place}: must be flown at one airspeed, as changes of it are not emulated, got "
        f"{scenario.airspeed_words}: {cure}. {said}".strip()
    )


def _with_guidance(plan: Plan, now: Flown) -> Plan:
    """A plan of one group, with the user's guidance before it, on the same draws."""
    return guided(plan, {YOURS: now.law})


def guided(plan: Plan, laws: Mapping[str, Autopilot]) -> Plan:
    """A plan of one group, with guidances before it by name, on the same draws."""
    (group,), scenario = plan.groups, plan.scenario
    tables = [table.model_dump(exclude_none=True) for table in scenario.law_tables]
    for name, law in laws.items():
        tables.append({"name": name, "kind": law.kind, "parameters": dict(law.parameters)})
    changed = scenario_from({**scenario.as_dict(), "law": tables})
    gains, listed = plan.gain_sets[group.gains], group.gains.rpartition(":")[2]
    names = [replace(law, name=x).names_of([listed])[0] for x, law in laws.items()]
    return replace(
        plan,
        campaign=campaign_on(plan.campaign, changed, plan.campaign.title),
        gain_sets={**dict.fromkeys(names, gains), group.gains: gains},
        groups=(*(group._replace(gains=name) for name in names), group),
    )


def logged_signals(
    log: str, columns: Columns, now: Flown, version: str | None
) -> tuple[list[float], list[str]]:
    """Quantiles of the signals of a log, and sentences on differences from the flights."""
    run, place = load_part(str(log), columns), Path(str(log).partition("@")[0])
    kept = kept_signals(run, None)
    if np.isnan(kept).all():
        raise InputError(f"{log}: must have one of the signals {', '.join(LOGGED)}, got none.")
    differ: list[str] = []
    with suppress(InputError):
        flown, yours = flown_now(place, version).law.parameters, now.law.parameters
        differ = [
            x for x in flown if not math.isclose(flown[x], yours.get(x, flown[x]), rel_tol=SINGLE)
        ]
    return kept, [f"The log was flown with other parameters: {', '.join(differ)}."] * bool(differ)


def tracking_of(logged: Sequence[float], rows: pd.DataFrame) -> list[dict[str, Any]]:
    """The log's tracking between minimum and maximum of the flights with the user's guidance.

    Without a log it is empty.
    """
    if not logged:
        return []
    flown = rows[(rows["gains"] == YOURS) & (rows["status"] == "completed")]
    kept = pd.DataFrame(flown[KEPT].tolist(), columns=[*LOGGED])
    words, units, _ = zip(*LOGGED.values(), strict=True)
    table = {"of": words, "log": logged, "low": kept.min(), "high": kept.max(), "unit": units}
    return pd.DataFrame(table).dropna(subset=["log", "low"]).to_dict("records")


def within_flights(tracking: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence on whether the log lies within the range of the flights; none without a log."""
    if not tracking:
        return []
    inside = [x["of"] for x in tracking if x["low"] <= x["log"] <= x["high"]]
    outside = [x["of"] for x in tracking if x["of"] not in inside]
    yours = "the flights with your guidance"
    said = [f"among {yours} in {listed(inside)}"] * bool(inside)
    said += [f"outside of {'them' if inside else yours} in {listed(outside)}"] * bool(outside)
    return [
        f"The log lies {listed(said)}, by the {100.0 * SHARE:g}th percentile of the size of each; "
        "it had another mission and other wind."
    ]
