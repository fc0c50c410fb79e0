"""`flighttune.open`: a page on which gains are moved, for a scenario, mission, recording or log."""

import webbrowser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from flighttune.base.arrays import check_at_least
from flighttune.base.errors import RecordingError
from flighttune.base.files import code
from flighttune.base.files.load import LOG, RECORDING, kind_of, written
from flighttune.base.files.shipped import scenario_files
from flighttune.base.screen import has_screen
from flighttune.campaigns.planning.source import Flights, flights
from flighttune.flight.loop.run import Run, renamed
from flighttune.flight.route import AIRCRAFT
from flighttune.flight.scenario.load import scenario_of
from flighttune.flight.scenario.schema import Scenario
from flighttune.logs.followed import followed
from flighttune.outputs.live.desk import BUDGET, Desk
from flighttune.outputs.live.server import Opened


@code.flies
def open(
    source: Scenario | str | Path = "level_turn",
    *,
    gains: str | None = None,
    aircraft: str | None = None,
    out: str | Path | None = None,
    port: int | None = None,
    budget: int = BUDGET,
    browser: bool = True,
    changes: Mapping[str, Any] | None = None,
) -> Opened:
    """Open a page in the browser on which gains are moved and the flights follow.

    The page is served to this machine alone, at an address with a secret token.

    Parameters
    ----------
    source : Scenario, str or Path
        A scenario or campaign, its file or name; a mission: ``.plan`` of QGroundControl,
        ``.waypoints`` of Mission Planner, KML or GeoJSON; a recording or its folder, whose scenario
        is flown again beside it; or the log of a real flight, whose path an aircraft flies beside
        it; by default ``level_turn``.
    gains : str, optional
        Gain set to begin with, by name or file, by default the first of the scenario.
    aircraft : str, optional
        Aircraft that flies a mission or the path of a log, by default ``aerosonde``.
    out : str or Path, optional
        Folder into which the page saves, by default ``runs/open``. Each save makes a new folder
        inside it; the page writes nowhere else.
    port : int, optional
        Port of the page, by default any free port.
    budget : int
        Maximum number of flights of the page's search for gains that meet the requirements, by
        default 400.
    browser : bool
        Whether to open a browser if there is a screen, by default True.
    changes : mapping of str to value, optional
        Values to set in a scenario that is read from a file, by dotted key.

    Returns
    -------
    Opened
        The page, served until it is closed or Python ends.

    Raises
    ------
    InputError, RecordingError, ScenarioError
        If the source or gain set cannot be read, or the port is taken.

    Examples
    --------
    >>> page = ft.open("level_turn", browser=False)
    >>> page.close()
    """
    check_at_least(1, budget=budget)
    stated, recorded = _stated(source, aircraft, changes)
    page = Opened(Desk(stated, gains, Path(out or "runs/open"), budget, recorded), port or 0)
    if browser and has_screen():
        webbrowser.open(page.url)
    return page


def _stated(
    source: Scenario | str | Path, aircraft: str | None, changes: Mapping[str, Any] | None
) -> tuple[Flights, Sequence[Run]]:
    """The flights that a source states, and its recorded or logged runs."""
    kind = ""
    if not isinstance(source, Scenario) and str(source) not in scenario_files():
        kind = kind_of(source)
    if kind == LOG:
        log = written(source, LOG)
        return flights(followed(log, aircraft or AIRCRAFT), changes=changes), [log]
    if kind != RECORDING:
        return flights(source, aircraft=aircraft, changes=changes), []
    flown = [run for run in written(source, RECORDING).runs if len(run.signals) > 1]
    if not flown:
        raise RecordingError(f"{source}: a run must have flown, got none.")
    first = flown[0].provenance.gains_name
    *_, last = (run for run in flown if run.provenance.gains_name == first)
    scenario = scenario_of(flown[0])
    return flights(scenario, aircraft=aircraft, changes=changes), [renamed(last, "recorded")]
