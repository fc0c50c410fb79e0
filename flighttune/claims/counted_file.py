"""Files of counts: read, and checked against their plans."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from flighttune.base.errors import InputError, naming
from flighttune.base.files import array, load
from flighttune.base.files.table import abridged, json_object, value_of
from flighttune.base.signals import SIGNAL_UNITS
from flighttune.campaigns.flying.compiled import COMPILED, CompiledFlights
from flighttune.claims.about import About
from flighttune.claims.counted import BandFlights, Counted
from flighttune.claims.counted_flights import check_one_path, flights_of, plan_in
from flighttune.claims.ending import Ending
from flighttune.claims.known import NUMBERS
from flighttune.claims.shape import MAX_NUMBERS
from flighttune.flight.records.refly import other_libraries

ARRAYS = {"band": array.TEXT, "extremes": array.SINGLE, "wind": array.FLOAT}
ARRAYS |= {
    "navigation": array.FLOAT,
    "by_rtk": array.FLOAT,
    "endings": array.TEXT,
    COMPILED: array.TEXT,
    "versions": array.TEXT,  # of the libraries, in an unfinished count
}


def load_counted(path: str | Path) -> Counted:
    """Read a count; compute its scores and scale, and its windows and flights from its plan."""
    counted = read_counted(path, _flights)
    about, ending, flights = counted.about, counted.ending, len(counted.scores)
    if not (ending.corridor or about.fences):
        raise InputError(f"{path}: `fences` must have the one that was counted until it was sure.")
    if not (ending.complete(flights) or counted.decided):
        raise InputError(
            f"{path}: `plan.runs` must be the flights learned from and counted, "
            f"{about.learned + flights}, where no answer was certain before, got "
            f"{about.learned + ending.flights}."
        )
    if about.fences:
        draws = counted.draws.tolist()  # a continued count has more flights than planned
        check_one_path(plan_in(about.plan).with_runs(draws[-1] + 1), draws)
    return counted


def _flights(about: About) -> BandFlights:
    """The flights of a count, which follow from its plan."""
    plan = plan_in(about.plan)
    first = plan.runs - about.learned
    if not 1 <= first <= MAX_NUMBERS:
        raise InputError(f"`plan.runs` must be 1 to {MAX_NUMBERS} more than `learned`.")
    measured = about.kind.measures.of(about, plan.scenario, plan.groups[0].plant)
    return flights_of(plan, measured, first)


def read_counted(
    path: str | Path, flights_of: Callable[[About], BandFlights], *, unfinished: bool = False
) -> Counted:
    """Read a count, with its flights from its plan by `flights_of`.

    One that is `unfinished` must be of the libraries and the machine here.
    """
    load.sealed_bytes(Path(path), "band file", "count it again with flighttune band")
    with naming(path):
        arrays = array.read_arrays(Path(path), "band", ARRAYS, ("extremes",))
        then = json_object(str(arrays.pop("versions", "{}")), "`versions`")
        if unfinished and (other := other_libraries(then)):
            raise InputError(f"was flown with other libraries: {other}")
        about = value_of(json_object(str(arrays.pop("band")), "`band`"), About)
        endings = _endings_of(str(arrays.pop("endings", "{}")))
        compiled = arrays.pop(COMPILED, None)
        compiled = CompiledFlights.stated(None if compiled is None else str(compiled))
        flights = flights_of(about)
        _check(about, flights, arrays)
        ending, n = Ending.of(about), len(arrays["extremes"])
        if about.early >= ending.flights:
            raise InputError(f"`early` must be below the {ending.flights} flights planned.")
        if n > ending.flights and n not in ending.numbers:
            raise InputError(
                "`extremes` must be of as many flights as were planned, or of 2, 4, 8 ... times as "
                f"many, got {n} for {ending.flights}."
            )
        counted = about.kind(
            about=about, flights=flights, endings=endings, compiled=compiled, **arrays
        )
        if not {x["run"] for x in endings} <= {*counted.draws[np.isinf(counted.scores)].tolist()}:
            raise InputError("`endings` must be of draws counted that did not complete.")
    return counted


def _endings_of(text: str) -> list[dict[str, Any]]:
    """Ends of flights, by draw."""
    said, rows = json_object(text, "`endings`"), []
    for run, sentence in said.items():
        if not (run.isdecimal() and isinstance(sentence, str)):
            raise InputError("`endings` must have a sentence for each draw.")
        status, _, reason = sentence.partition(": ")
        rows.append({"run": int(run), "status": status, "reason": reason})
    return rows


def _check(about: About, of: BandFlights, arrays: dict[str, Any]) -> None:
    """Refuse an impossible shape, and arrays whose windows differ from the plan."""
    array.check_shapes("band", arrays, {"extremes": None, "wind": None})
    flights = len(arrays["extremes"])
    each = len(of.edges) - 1, len(about.signals)  # windows and signals
    by_wind = about.predicted_from
    learned = {"half": about.half, "coefficients": about.coefficients}
    shapes = {"half": each, "coefficients": (10 if by_wind else 1, *each)}
    shapes |= {"extremes": (flights, *each, 2), "wind": (flights, 2 if by_wind else 0)}
    if "navigation" in arrays:  # not in files of 0.4.0
        shapes["navigation"] = flights, NUMBERS * of.navigated
    if "by_rtk" in arrays:
        shapes["by_rtk"] = len(arrays["by_rtk"]), 2
    array.check_shapes("band", learned | arrays, shapes)
    if "by_rtk" in arrays and not about.kind.beside_rtk:
        raise InputError("`by_rtk` must be of a band.")
    if not (about.half > 0.0).all():
        raise InputError("`half` must be positive.")
    for name, unit in about.signals.items():
        if unit != SIGNAL_UNITS.get(name, unit):
            raise InputError(
                f"`signals`: {name} must be in {SIGNAL_UNITS[name]}, got {abridged(unit)}."
            )
    if of.measured.models != about.models:
        raise InputError("`models` must be those of the `signals` of a monitor.")
    low, high = np.moveaxis(arrays["extremes"], -1, 0)
    if not (low <= high).all():  # also catches NaN
        raise InputError("`extremes` must be lowest and highest values.")
