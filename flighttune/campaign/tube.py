"""The tube of a scenario; that of an aircraft in the residual signals counted of its flights."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from flighttune.campaign.band import residual
from flighttune.campaign.engine.progress import CampaignObserver
from flighttune.claims.band import Residual
from flighttune.control.gains import PIGains
from flighttune.flight.load import as_scenario
from flighttune.scenario.schema import Scenario
from flighttune.tubes.enclosure import Tube
from flighttune.tubes.tube import enclosed, stated_problem
from flighttune.units import DEG


def tube(
    scenario: Scenario | str | Path,
    gains: PIGains | str | None = None,
    boxes: Residual | None = None,
    *,
    plant: str | None = None,
    start: float = 0.0,
    disturbance: float | None = None,
    changes: Mapping[str, Any] | None = None,
    progress: Callable[[float], None] | None = None,
    observer: CampaignObserver | None = None,
) -> Tube:
    """Enclose all flights of a scenario with one gain set, limits included.

    This takes seconds for the law (11 s of one core for ``paper``) and minutes for an aircraft or a
    box of starts; memory and time grow with the pieces that limits split the set into.

    Parameters
    ----------
    scenario : Scenario, str or Path
        A scenario with a reference over time; also a file, or the name of a shipped one.
    gains : PIGains or str, optional
        Gains of the paper's or of the exact law, or a gain set by name or file, by default the
        first of the scenario.
    boxes : Residual, optional
        What the model of an aircraft misses, ``ft.residual(...)``: flights of its identified model
        with these residuals are then enclosed. By default, for a `plant` that is an aircraft, those
        of the scenario's flights from starts within `start` are counted.
    plant : str, optional
        Label of the plant, by default the first that is not an aircraft, with boxes the first
        aircraft.
    start : float, rad
        Half-width of the start range in course and path angle.
    disturbance : float, rad/s, optional
        Bound on the disturbance of each rate, of any shape; by default that of the scenario.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.
    progress : callable, optional
        Called with the share of time that is enclosed, 0 to 1.
    observer : CampaignObserver, optional
        Receives the progress of flights that are counted; may stop them.

    Returns
    -------
    Tube
        Bounded, or unbounded with the reason. A flight that leaves it makes it unbounded too.

    Raises
    ------
    InputError
        If no tube knows the air or the plant, or the boxes are of other flights.
    InfeasibleError
        If tuning finds no such gains, or no tube knows the law.

    Examples
    --------
    >>> tube = ft.tube("paper", "paper", changes={"flight.duration_s": 2.0})
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
