"""Charts of flights or of a claim, in a notebook or as an SVG file."""

from collections.abc import Iterable

from flighttune.claims.band import Band
from flighttune.errors import InputError
from flighttune.flight.flown import FlownScenario
from flighttune.present.chart import Sheet, dashes
from flighttune.reports.band import band_charts
from flighttune.reports.claim import tube_charts
from flighttune.reports.panels import errors, flown_signals
from flighttune.simulate.run import Run, run_styles
from flighttune.tubes.enclosure import Tube


def plot(value: FlownScenario | Run | Iterable[Run] | Band | Tube) -> Sheet:
    """Draw flights or what is claimed of them.

    Parameters
    ----------
    value : FlownScenario, Run or iterable of Run; Band; Tube
        Flights: both errors, roll and load factor over time, with their limits and claims. A band:
        each signal with the flights that were counted, on a route its map before them. A tube: the
        bounds of both errors.

    Returns
    -------
    Sheet
        Angles in degrees; a notebook shows it, ``save`` writes an SVG file.

    Raises
    ------
    InputError
        If no run has flown.

    Examples
    --------
    >>> ft.plot(ft.fly(ft.load_scenario("paper_as_printed"))).save("flight.svg")
    >>> ft.plot(ft.band("mission_in_wind", epsilon=0.2, confidence=0.8)).save("band.svg")
    """
    if isinstance(value, Band | Tube):
        return Sheet(charts=band_charts(value) if isinstance(value, Band) else tube_charts(value))
    runs = value.runs if isinstance(value, FlownScenario) else value
    runs = (runs,) if isinstance(runs, Run) else tuple(runs)
    styles = run_styles(runs)
    flights = [(run, styles[run.label]) for run in runs if len(run.signals) > 1]
    if not flights:
        raise InputError("`value` must have a run that flew, got none.")
    charts = [*errors(flights), *flown_signals(flights)]
    for chart in charts:
        chart.legend = [(run.label, style.colour, dashes(style)) for run, style in flights]
    return Sheet(charts=charts)
