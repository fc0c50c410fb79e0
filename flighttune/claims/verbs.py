"""Verbs that count flights: bands, residual signals with their tubes, and monitors."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, Unpack

from flighttune.base.errors import InputError
from flighttune.base.files import code
from flighttune.base.files.load import A_LOG, BAND, LOG, kind_of, load_one, written
from flighttune.base.files.whole import keep_on_error, together
from flighttune.base.units import DEG, Degrees, Radians, RadiansPerSecond
from flighttune.campaigns.engine.fliers import Fliers, FlownBy
from flighttune.campaigns.engine.pool import WorkerPool
from flighttune.campaigns.engine.progress import CampaignObserver
from flighttune.campaigns.planning.knowing import Knowledge
from flighttune.campaigns.planning.plan import Plan
from flighttune.campaigns.planning.schema import Campaign
from flighttune.campaigns.planning.source import Flights
from flighttune.campaigns.planning.source import flights as flights_of_source
from flighttune.claims.band import Band
from flighttune.claims.counting import count_more, counted_on, drawn
from flighttune.claims.ending import Fixed
from flighttune.claims.monitor import LogMonitor, Monitor, monitor_of_logs
from flighttune.claims.residual import Residual
from flighttune.claims.tubes.enclosure import Tube
from flighttune.claims.tubes.tube import enclosed, stated_problem
from flighttune.control.gains import PIGains
from flighttune.flight.load import as_scenario
from flighttune.flight.loop.run import Run
from flighttune.flight.scenario.schema import Scenario
from flighttune.logs.log import Columns

# Default epsilon, confidence and number of learning flights, of a band and of a monitor.
EPSILON, CONFIDENCE, LEARN = 0.01, 0.999, 500
MONITOR_EPSILON, MONITOR_CONFIDENCE, MONITOR_LEARN = 0.05, 0.95, 100


@code.flies
def band(  # noqa: PLR0913 - each is a choice of the user, and has a default
    source: Flights | Scenario | Campaign | Plan | str | Path,
    *,
    signals: Iterable[str] | None = None,
    epsilon: float | None = None,
    confidence: float | None = None,
    flights: int | None = None,
    learn: int | None = None,
    predicted_from: Literal["wind"] | None = None,
    gains: str | None = None,
    plant: str | None = None,
    air: str | None = None,
    navigation: Knowledge | None = None,
    seed: int | None = None,
    start_deg: Degrees = 0.0,
    changes: Mapping[str, Any] | None = None,
    out: str | Path | None = None,
    run_code: bool = False,  # noqa: ARG001 - of the decorator
    **by: Unpack[FlownBy],
) -> Band:
    """Bound signals by counting flights: a new one leaves the band with at most a probability.

    The shape is learned from some flights, and its scale is counted on other flights, which follow
    them in the draws. All are random and independent for any design of the campaign. The claim
    holds for all signals at all times, for any law, plant and weather. By default 2140 flights are
    flown; two cores fly 25 of 45 s per second.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, str or Path
        A campaign (file, shipped name or folder), a scenario with something random or with
        `start_deg`, or the file of any count, whose flights are not flown again. A count's file
        accepts only another claim, `flights` and `out`; further flights are added to it.
    signals : iterable of str, optional
        Recorded signals to bound, by default chi_err and gamma_err, on a route cross_track and
        height_err.
    epsilon : float, 1, optional
        Accepted probability of leaving the band, by default 0.01, or the file's.
    confidence : float, 1, optional
        Confidence of the claim, 0 to 1, by default 0.999, or the file's.
    flights : int, optional
        Flights to count in total, by default enough for the claim with five of them outside (1640).
        The count in a file grows to 2, 4, 8 ... times the planned number.
    learn : int, optional
        Flights to learn the shape from, by default 500.
    predicted_from : {"wind"}, optional
        Put the band around a middle predicted from the wind of each flight.
    gains : str, optional
        Gain set by name or file, by default the set tuned for the aircraft, else the first.
    plant : str, optional
        Label of the plant, by default the first aircraft, else the first.
    air : {"calm", "wind", "light", "moderate", "severe"}, optional
        Air of all flights, from the classes in the campaign, by default as it draws them.
    navigation : {"exact", "rtk", "standard", "poor"}, optional
        What autopilots know of their motion: a grade of ``[navigation]``, by default that of the
        source, else along a route a standard receiver and inertial unit.
    seed : int, optional
        Seed of the draws, by default the campaign's.
    start_deg : float, deg
        Half-width of the start range in course and path angle.
    changes : mapping of str to value, optional
        Values to set in the scenario, by dotted key.
    out : str or Path, optional
        File (.npz) to write, as its `save` does.
    run_code : bool
        Run Python files that the folder of a campaign or the file of a count names.
    workers : int, optional
        Processes that fly on this machine; by default one per core.
    scheduler : str, optional
        Address of a dask scheduler, ``tcp://HOST:PORT``, whose workers fly instead.
    observer : CampaignObserver, optional
        Receives the progress; may stop the flights.

    Returns
    -------
    Band
        It claims nothing if too many flights were not completed.

    Raises
    ------
    InputError, ScenarioError
        If source, gains, plant or a signal are not there, the claim needs more flights, nothing is
        random, or it is a mission, which `mission` counts.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> band = ft.band("level_turn", start_deg=2.0, plant="kinematic", **few)
    >>> len(band.scores), band.outside
    (7, 0)
    """
    fliers = Fliers(**by)
    if kept := written(source, BAND):  # a file of any kind of count
        options = {"signals": signals, "learn": learn, "predicted_from": predicted_from}
        options |= {"gains": gains, "plant": plant, "air": air, "seed": seed is not None}
        options |= {"navigation": navigation}
        for name, value in {**options, "start_deg": start_deg, "changes": changes}.items():
            if value:
                raise InputError(f"`{name}` must be absent for a band file, which has its own.")
        own = kept.about.epsilon, kept.about.confidence
        stated = epsilon, confidence
        claim = (x if y is None else y for x, y in zip(own, stated, strict=True))
        with together():
            if flights is not None:
                with WorkerPool(fliers) as pool:
                    kept = count_more(kept, flights, pool)
                # Under any output name, because the file determines its readings.
                keep_on_error(Path(str(source)))
                kept.save(str(source))
                out = out or str(source)
            counted = kept.claiming(*claim)
            if out is not None:
                counted.save(out)
        return counted
    flown = flights_of_source(source, changes=changes).starting(start_deg).knowing(navigation)
    if flown.mission is not None:
        raise InputError(
            f"{flown.mission}: flights of a mission must be counted with `flighttune mission`, in "
            "Python with `ft.mission`."
        )
    drawn_plan = drawn(flown, plant, gains, air).with_seed(seed)
    epsilon = EPSILON if epsilon is None else epsilon
    confidence = CONFIDENCE if confidence is None else confidence
    counted = counted_on(
        Band,
        drawn_plan,
        Fixed.enough(flights, epsilon, confidence),
        place=flown.place,
        learn=LEARN if learn is None else learn,
        signals=signals,
        predicted_from=predicted_from,
        fliers=fliers,
    )
    if out is not None:
        counted.save(out)
    return counted


@code.flies
def residual(
    source: Flights | Scenario | Campaign | Plan | str | Path,
    *,
    epsilon: float = EPSILON,
    confidence: float = CONFIDENCE,
    flights: int | None = None,
    learn: int = LEARN,
    gains: str | None = None,
    plant: str | None = None,
    air: str | None = None,
    navigation: Knowledge | None = None,
    seed: int | None = None,
    start_deg: Degrees = 0.0,
    changes: Mapping[str, Any] | None = None,
    **by: Unpack[FlownBy],
) -> Residual:
    """Bound the residuals of an aircraft's identified model by counting flights: boxes of a tube.

    They are counted like a `band`, from the same draws. Instead of recorded signals they bound the
    rates of course and path angle (rad/s), roll and its change over a sample (rad), actual minus
    model.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, str or Path
        Flights as `flights` takes them, of an aircraft with an identified model.
    epsilon, confidence, flights, learn, gains, plant, air, navigation, seed : optional
    start_deg, changes : optional
        As for `band`.
    workers, scheduler, observer : optional
        As for `band`.

    Returns
    -------
    Residual
        The boxes for `tube`.

    Raises
    ------
    InputError, ScenarioError
        If `band` raises one, or an aircraft has no identified model.
    StoppedError
        If the observer stopped the flights.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 10, "flights": 7}
    >>> len(ft.residual("feasible", start_deg=2.0, **few).scores)
    7
    """
    fliers, stated = Fliers(**by), flights_of_source(source, changes=changes).starting(start_deg)
    stated = stated.knowing(navigation)
    plan = drawn(stated, plant, gains, air).with_seed(seed)
    ending = Fixed.enough(flights, epsilon, confidence)
    return counted_on(Residual, plan, ending, place=stated.place, learn=learn, fliers=fliers)


def tube(
    scenario: Scenario | str | Path,
    gains: PIGains | str | None = None,
    boxes: Residual | None = None,
    *,
    plant: str | None = None,
    start: Radians = 0.0,
    disturbance: RadiansPerSecond | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
    observer: CampaignObserver | None = None,
) -> Tube:
    """Enclose all flights of a scenario with one gain set, limits included.

    This takes seconds for the law (11 s of one core for ``paper``) and minutes for an aircraft or a
    box of starts; memory and time grow with the number of pieces into which limits split the set.

    Parameters
    ----------
    scenario : Scenario, str or Path
        A scenario with a reference over time; also its file, or the name of a shipped scenario.
    gains : PIGains or str, optional
        Gains of the paper's or of the exact law, or a gain set by name or file, by default the
        first of the scenario.
    boxes : Residual, optional
        Residuals of an aircraft's model, ``ft.residual(...)``: flights of its identified model with
        these residuals are then enclosed. By default, for a `plant` that is an aircraft, they are
        counted on the scenario's flights from starts within `start`.
    plant : str, optional
        Label of the plant, by default the first that is not an aircraft, with boxes the first
        aircraft.
    start : float, rad
        Half-width of the start range in course and path angle.
    disturbance : float, rad/s, optional
        Bound on the disturbance of each rate, of any shape; by default the scenario's disturbance.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.
    progress : callable, optional
        Called with the share of time that is enclosed, 0 to 1.
    observer : CampaignObserver, optional
        Receives the progress of counted flights; may stop them.

    Returns
    -------
    Tube
        Bounded, or unbounded with the reason. A flight that leaves it makes it unbounded too.

    Raises
    ------
    InputError
        If tubes do not know the air or the plant, or the boxes belong to other flights.
    InfeasibleError
        If tuning finds no such gains, or tubes do not know the law.

    Examples
    --------
    >>> tube = ft.tube("level_turn", "paper", changes={"flight.duration_s": 2.5})
    >>> tube.status, tube.problem.plant
    ('bounded', 'kinematic')
    """
    if boxes is None and plant is not None and not isinstance(gains, PIGains):
        stated = as_scenario(scenario, changes)
        if stated.plant_table(plant).aircraft is not None:
            boxes = residual(
                scenario,
                gains=gains or stated.gain_names[0],
                plant=plant,
                start_deg=start / DEG,
                changes=changes,
                observer=observer,
            )
    problem = stated_problem(
        scenario, gains, changes, plant=plant, start=start, disturbance=disturbance, band=boxes
    )
    return enclosed(problem, progress)


@code.flies
def monitor(  # noqa: PLR0913 - as `band`
    source: Flights | Scenario | Campaign | Plan | Run | str | Path,
    *logs: Run | str | Path,
    epsilon: float = MONITOR_EPSILON,
    confidence: float = MONITOR_CONFIDENCE,
    flights: int | None = None,
    learn: int = MONITOR_LEARN,
    gains: str | None = None,
    plant: str | None = None,
    air: str | None = None,
    navigation: Knowledge | None = None,
    seed: int | None = None,
    aircraft: str | None = None,
    start_deg: Degrees = 0.0,
    changes: Mapping[str, Any] | None = None,
    columns: Columns = (),
    out: str | Path | None = None,
    run_code: bool = False,  # noqa: ARG001 - of the decorator
    **by: Unpack[FlownBy],
) -> Monitor | LogMonitor:
    """Count how often a monitor of flights raises a false alarm, or learn one from logs.

    Some healthy flights teach the expected airspeed, elevator, climb, roll and turn from signals
    that an autopilot has, and limits of the differences; the limits are scaled on other flights. A
    new flight without a fault raises an alarm with at most a stated probability, for this aircraft,
    law, air and these speeds. By default 308 flights are flown; two cores fly about four of 45 s
    per second.

    From logs of real flights it learns by the signals that all logs have. Each log is left out once
    and scored by the models of the others: n logs allow a probability of a false alarm of 1/(n +
    1), on average over such sets of logs.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, Run, str or Path
        A campaign, a mission, a scenario with something random or with `start_deg`, or the log of a
        healthy flight (.ulg, .bin, .tlog, .csv), ``@START:END`` for a part in s.
    logs : Run, str or Path
        Further logs of healthy flights of the same aircraft, at least two.
    epsilon : float, 1
        Accepted probability of a false alarm in a flight, by default 0.05.
    confidence : float, 1
        Confidence of the claim, 0 to 1, by default 0.95.
    flights : int, optional
        Flights to count, by default enough for the claim with five alarms (208).
    learn : int
        Learning flights, one half for the weights and the other for the limits, by default 100.
    columns : mapping or sequence
        Columns of the signals in logs, as for `load_log`.
    aircraft : as for `mission`
    gains, plant, air, navigation, seed, start_deg, changes, out : as for `band`
    run_code, workers, scheduler, observer : as for `band`

    Returns
    -------
    Monitor or LogMonitor
        A `Monitor` claims nothing if too many flights were not completed. The `alarm` of a
        `LogMonitor` takes a run.

    Raises
    ------
    InputError, ScenarioError
        As in `band`, or if logs are too few, too short, equal or contradict themselves.
    RecordingError
        If a file is not the log of a flight.
    StoppedError
        If the observer stopped the flights.

    Notes
    -----
    A residual is a signal, behind a lag of 0.5 s, minus the weighted sum of its terms behind the
    same lag; for elevator and power also minus its own past. The score of a flight is the running
    maximum of the residual divided by its limit, so that one number is counted for a flight (Wilks,
    as for `band`). The first 8 s of a log are not judged.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "flights": 7, "workers": 1}
    >>> short = {"flight.duration_s": 4.0}
    >>> monitor = ft.monitor("level_turn", start_deg=2.0, changes=short, **few)
    >>> [model.name for model in monitor.watch.models]
    ['airspeed', 'speed change', 'elevator', 'trim', 'climb', 'power', 'roll', 'turn']
    """
    fliers = Fliers(**by)
    of_file = isinstance(source, str | Path) and kind_of(source) == LOG
    if isinstance(source, Run) or logs or of_file:
        defaults = {"epsilon": MONITOR_EPSILON, "confidence": MONITOR_CONFIDENCE}
        defaults["learn"] = MONITOR_LEARN
        chosen = dict[str, Any](epsilon=epsilon, confidence=confidence, learn=learn)
        chosen |= {"start_deg": start_deg or None, "flights": flights, "gains": gains}
        chosen |= {"plant": plant, "air": air, "seed": seed, "changes": changes or None}
        chosen |= {"navigation": navigation, "aircraft": aircraft}
        for name, value in chosen.items():
            if value != defaults.get(name):
                raise InputError(
                    f"`{name}` must be absent with logs, whose number is what the claim rests on."
                )
        runs = [load_one(log, A_LOG, LOG, columns=columns) for log in (source, *logs)]
        made: Monitor | LogMonitor = monitor_of_logs(runs)
    elif columns:
        raise InputError("`columns` must be absent without a log.")
    else:
        stated = flights_of_source(source, aircraft=aircraft, changes=changes)
        stated = stated.starting(start_deg).knowing(navigation)
        plan = drawn(stated, plant, gains, air).with_seed(seed)
        ending = Fixed.enough(flights, epsilon, confidence)
        made = counted_on(Monitor, plan, ending, place=stated.place, learn=learn, fliers=fliers)
    if out is not None:
        made.save(out)
    return made
