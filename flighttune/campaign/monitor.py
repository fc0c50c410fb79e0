"""Monitors: what healthy flights teach, and limits whose rate of false alarms is counted."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flighttune.campaign.band import counted_on, drawn
from flighttune.campaign.engine.progress import CampaignObserver
from flighttune.claims.monitor import LogMonitor, Monitor, monitor_of_logs
from flighttune.errors import InputError
from flighttune.files.load import A_LOG, LOG, kind_of, load_one
from flighttune.logs.log import Columns
from flighttune.planning.plan import Plan
from flighttune.planning.schema import Campaign
from flighttune.planning.source import Flights
from flighttune.planning.source import flights as flights_of_source
from flighttune.scenario.schema import Scenario
from flighttune.simulate.run import Run

# Epsilon, confidence and flights to learn from by default.
EPSILON, CONFIDENCE, LEARN = 0.05, 0.95, 100


def monitor(  # noqa: PLR0913 - as `band`
    source: Flights | Scenario | Campaign | Plan | Run | str | Path,
    *logs: Run | str | Path,
    epsilon: float = EPSILON,
    confidence: float = CONFIDENCE,
    flights: int | None = None,
    learn: int = LEARN,
    gains: str | None = None,
    plant: str | None = None,
    air: str | None = None,
    seed: int | None = None,
    start_deg: float = 0.0,
    changes: Mapping[str, Any] | None = None,
    columns: Columns = (),
    out: str | Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    observer: CampaignObserver | None = None,
) -> Monitor | LogMonitor:
    """Count how often a monitor of flights raises a false alarm, or learn one from logs.

    Some healthy flights teach the expected airspeed, elevator, climb, roll and turn from signals
    that an autopilot has, and limits of the differences; the limits are scaled on fresh flights. A
    new flight without a fault raises an alarm with at most a probability, for this aircraft, law,
    air and these speeds. By default 308 flights are flown; two cores fly about four of 45 s in a
    second.

    From logs of real flights it learns by the signals that all of them have. Each log is left out
    once, and scored by what the others teach: n logs allow a probability of a false alarm of
    1/(n + 1), on average over such sets of logs.

    Parameters
    ----------
    source : Flights, Scenario, Campaign, Plan, Run, str or Path
        A campaign, a mission, a scenario in which something is random or `start_deg` is given, or
        the log of a healthy flight (.ulg, .bin, .tlog, .csv), ``@START:END`` for a part in s.
    logs : Run, str or Path
        Further logs of healthy flights of the same aircraft, at least two.
    epsilon : float, 1
        Accepted probability of a false alarm in a flight, by default 0.05.
    confidence : float, 1
        Confidence of the claim, 0 to 1, by default 0.95.
    flights : int, optional
        Flights to count, by default as many as the claim needs with five alarms (208).
    learn : int
        Flights to learn from, one half the weights and the other the limits, by default 100.
    columns : mapping or sequence
        Where logs have their signals, as for `load_log`.
    gains, plant, air, seed, start_deg, changes, out, workers, scheduler, observer : as for `band`

    Returns
    -------
    Monitor or LogMonitor
        A `Monitor` claims nothing if too many flights were not completed. The `alarm` of a
        `LogMonitor` takes a run.

    Raises
    ------
    InputError, ScenarioError
        If `band` raises one, or logs are too few, too short, not different or contradict
        themselves.
    RecordingError
        If a file is no log of a flight.
    StoppedError
        If the observer stopped the flights.

    Notes
    -----
    A residual is a signal, behind a lag of 0.5 s, minus the weighted sum of its terms behind the
    same lag. The score of a flight is the largest residual so far over its limit, so that one
    number is counted for a flight (Wilks, as for `band`). Of a log the first 8 s are not judged.

    Examples
    --------
    >>> few = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "workers": 1}
    >>> monitor = ft.monitor("level_turn", start_deg=2.0, **few)
    >>> [model.name for model in monitor.watch.models]
    ['airspeed', 'elevator', 'trim', 'climb', 'roll', 'turn']
    """
    of_file = isinstance(source, str | Path) and kind_of(source) == LOG
    if isinstance(source, Run) or logs or of_file:
        defaults = {"epsilon": EPSILON, "confidence": CONFIDENCE, "learn": LEARN, "start_deg": 0.0}
        chosen = {"epsilon": epsilon, "confidence": confidence, "learn": learn}
        chosen |= {"start_deg": start_deg, "flights": flights, "gains": gains, "plant": plant}
        chosen |= {"air": air, "seed": seed, "changes": changes or None}
        for name, value in chosen.items():
            if value != defaults.get(name):
                raise InputError(
                    f"`{name}` must be absent with logs, whose number is what the claim rests on."
                )
        made: Monitor | LogMonitor = monitor_of_logs(
            [
                log if isinstance(log, Run) else load_one(str(log), A_LOG, LOG, columns=columns)
                for log in (source, *logs)
            ]
        )
    elif columns:
        raise InputError("`columns` must be absent without a log.")
    else:
        stated = flights_of_source(source, changes=changes).starting(start_deg)
        plan, by = drawn(stated, plant, gains, air, seed), (workers, scheduler, observer)
        claim = {"epsilon": epsilon, "confidence": confidence, "flights": flights, "learn": learn}
        made = counted_on(Monitor, plan, place=stated.place, by=by, **claim)
    if out is not None:
        made.save(out)
    return made
