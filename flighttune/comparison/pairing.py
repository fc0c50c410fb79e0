"""Which runs are held against each other, and what would make that meaningless."""

from collections.abc import Mapping, Sequence
from typing import Any

from flighttune.comparison.source import Source
from flighttune.simulate.run import Run

MANOEUVRE = ("V_a_mps", "h_m", "chi_deg", "gamma_deg", "phi_deg", "n_z", "duration_s")
"""Keys of ``[flight]`` that belong to the manoeuvre, beside all of ``[reference]``."""

DESCRIPTION = ("title", "verifies", "source", "gains", "plant", "reference")
"""Keys that are words, or are compared elsewhere."""

LEAST_SAMPLES = 2


def paired(a: Sequence[Run], b: Sequence[Run]) -> list[tuple[Run, Run]]:
    """Pair the runs of two sources.

    Parameters
    ----------
    a, b : sequence of Run

    Returns
    -------
    list of (Run, Run)
        One run each: those two. Else those of equal label; where there are none, those of equal
        plant if both sides have a single gain set, or of equal gains if both have a single plant.
        Empty where nothing fits.
    """
    if len(a) == len(b) == 1:
        return [(a[0], b[0])]
    for key, rest in (("label", None), ("plant", "gains_name"), ("gains_name", "plant")):
        if rest and any(len({getattr(r.provenance, rest) for r in side}) > 1 for side in (a, b)):
            continue
        partners = {_key(run, key): run for run in b}
        found = [(run, partners[_key(run, key)]) for run in a if _key(run, key) in partners]
        if found:
            return found
    return []


def _key(run: Run, name: str) -> str:
    return run.label if name == "label" else getattr(run.provenance, name)


def why_not(a: Source, b: Source, pairs: Sequence[tuple[Run, Run]]) -> str:
    """Why two sources cannot be compared, in one sentence; empty where they can.

    Parameters
    ----------
    a, b : Source
    pairs : sequence of (Run, Run)
        What `paired` makes of their runs.
    """
    between = f"{a.name} and {b.name}"
    for one in (a, b):
        for signal, unit in one.units.items():
            return f"{one.name}: `{signal}` must have the unit of the other side, got {unit!r}."
    for one, other in ((a, b), (b, a)):
        several = not one.chosen and len(one.gain_sets) > 1
        if several and set(one.gain_sets) != set(other.gain_sets):
            choices = ", ".join(f"{one.name}@{gains}" for gains in one.gain_sets)
            return f"{between}: {one.name} has several gain sets, name one of {choices}."
    if not pairs:
        labels = " | ".join(", ".join(run.label for run in side.runs) for side in (a, b))
        return f"{between}: a run must have a partner of the same plant or gains, got {labels}."
    for one, other in pairs:
        for source, run in ((a, one), (b, other)):
            if len(run.signals) < LEAST_SAMPLES:
                return f"{source.name}: {run.label} must have flown, got {run.status}: {run.reason}"
        aircraft = [run.provenance.aircraft for run in (one, other)]
        if all(aircraft) and aircraft[0] != aircraft[1]:
            return f"{between}: the aircraft must be the same, got {aircraft[0]} and {aircraft[1]}."
        flown = [manoeuvre(run) for run in (one, other)]
        different = _changes(*flown)
        if different:
            key, (value, got) = next(iter(different.items()))
            return f"{between}: the manoeuvre must be the same, `{key}` is {value} and {got}."
    return ""


def manoeuvre(run: Run) -> dict[str, Any]:
    """What a run was asked to fly: start, length and reference, as in the scenario.

    Gains, plant, limits, controller, weather and gravity of the law are not part of it: they are
    what one compares.
    """
    scenario = run.provenance.scenario
    flight = {key: value for key, value in scenario["flight"].items() if key in MANOEUVRE}
    return _flat({"flight": flight, "reference": scenario["reference"]})


def differences(a: Run, b: Run) -> dict[str, tuple[Any, Any]]:
    """Settings of the scenarios of two runs that are not the same, by dotted key."""

    def settings(run: Run) -> dict[str, Any]:
        scenario = run.provenance.scenario
        return _flat({key: value for key, value in scenario.items() if key not in DESCRIPTION})

    return _changes(settings(a), settings(b))


def _flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tables.items():
        if isinstance(value, Mapping):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def _changes(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, tuple[Any, Any]]:
    return {key: (a.get(key), b.get(key)) for key in sorted({*a, *b}) if a.get(key) != b.get(key)}
