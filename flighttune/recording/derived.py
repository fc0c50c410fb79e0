"""Signals that a recording draws and no plant has: heights, distances, parts of the gap, bounds."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from flighttune.arrays import FloatArray
from flighttune.guarantee.flight_check import FlightCheck
from flighttune.guarantee.mismatch import CHANNELS, trim_of
from flighttune.plants.point_mass import turn_rates
from flighttune.simulate.run import Run

if TYPE_CHECKING:
    from flighttune.recording.entities import DrawnRun

# Components of the mismatch, in the order of the ladder: actual lift, inner-loop lag, remainder.
PARTS = ("lift", "lag", "rest")

UNITS = {
    **{f"{part}_{channel}": "rad/s" for part in PARTS for channel in CHANNELS},
    **{f"step_{channel}": "rad" for channel in CHANNELS},
    "distance": "m",
    "log_s": "1",
    "log_s_bound": "1",
}
SHORTEST_BOUND = 1.5  # s; a bound that lasts less is not drawn: shreds of it say nothing
SMALLEST = 1e-4  # norms of s below this (rad and rad/s) are drawn as this: they go down for ever
FLOWN = ("phi", "n_z", "phi_cmd", "n_z_cmd", "V_a", "gamma")


def positions(signals: pd.DataFrame) -> FloatArray:
    """North, east and down of every sample, shape (n, 3), m."""
    return signals[["north", "east", "down"]].to_numpy(dtype=float)


def with_derived(drawn: "Sequence[DrawnRun]") -> "list[DrawnRun]":
    """The runs with the signals of `UNITS` that they have; and height and speed over ground.

    A run is compared with that of the same gains on the plant before it: `step_chi` and
    `step_gamma` are its course and path angle minus theirs. `distance` is that from the path on the
    first plant. `log_s` is the norm of s in decades, with what its claim guarantees.
    """
    before: dict[str, list[Run]] = {}
    extended = []
    for drawn_run in drawn:
        run = drawn_run.run
        lower = before.setdefault(run.provenance.gains_name, [])
        columns = {**_over_ground(run), **_parts(run), **_compared(run, lower)}
        columns |= _claimed(run, drawn_run.claim)
        lower.append(run)
        shown = replace(run, signals=run.signals.assign(**columns)) if columns else run
        extended.append(replace(drawn_run, run=shown))
    return extended


def _over_ground(run: Run) -> dict[str, FloatArray]:
    """Height and speed over ground of a plant that gives neither, from its path."""
    signals, derived = run.signals, {}
    flight = run.provenance.scenario.get("flight") or {}
    if "h" not in signals and "h_m" in flight:
        derived["h"] = float(flight["h_m"]) - signals["down"].to_numpy()
    if "V_g" not in signals and len(signals) > 1:
        level = positions(signals)[:, :2]
        derived["V_g"] = np.linalg.norm(np.gradient(level, run.t, axis=0), axis=1)
    return derived


def _parts(run: Run) -> dict[str, FloatArray]:
    """Rates that each part of an aircraft adds to those of the law under the same commands.

    Lift: rates of the exact point mass minus those of the law, both under the commands. Lag: rates
    of the point mass under roll and load factor as flown minus those under the commands. Rest:
    rates of the flight minus the former.
    """
    trim, signals = trim_of(run), run.signals
    if run.provenance.aircraft is None or trim is None or not set(FLOWN) <= set(signals):
        return {}
    phi, n_z, phi_cmd, n_z_cmd, V_a, gamma = (signals[name].to_numpy() for name in FLOWN)
    chi_rate = np.gradient(np.unwrap(signals["chi"].to_numpy()), run.t)
    flown = chi_rate, np.gradient(signals["gamma"].to_numpy(), run.t)
    exact = turn_rates(V_a, gamma, phi_cmd, n_z_cmd, turn="exact", g=trim.g)
    behind = turn_rates(V_a, gamma, phi, n_z, turn="exact", g=trim.g)
    kinematic = turn_rates(trim.V_a, gamma, phi_cmd, n_z_cmd, turn="paper", g=trim.g)
    modelled = {"kinematic": kinematic, "point_mass": exact}[run.provenance.law.plant]
    steps = modelled, exact, behind, flown
    return {
        f"{part}_{channel}": steps[k + 1][i] - steps[k][i]
        for k, part in enumerate(PARTS)
        for i, channel in enumerate(CHANNELS)
    }


def _claimed(run: Run, claim: FlightCheck | None) -> dict[str, FloatArray]:
    """The guarantee of a law, with bounds of the errors where they are within those flown."""
    if claim is None:
        return {}
    lines = {"log_s": claim.size, "log_s_bound": claim.bound}
    columns = {name: np.log10(np.maximum(line, SMALLEST)) for name, line in lines.items()}
    for i, channel in enumerate(CHANNELS):
        if f"{channel}_err_low" in run.signals:
            continue  # the bounds of its tube
        bound, error = claim.error_bounds.high[:, i], run.signals[f"{channel}_err"]
        shown = bound <= error.abs().max()
        stretch = np.cumsum(np.diff(shown, prepend=shown[0]))
        lasting = np.bincount(stretch)[stretch] * (claim.t[1] - claim.t[0])
        bound = np.where(shown & (lasting >= SHORTEST_BOUND), bound, np.nan)
        columns |= {f"{channel}_err_low": -bound, f"{channel}_err_high": bound}
    # A claim is about the time between two samples: there is none at the last one.
    return {name: np.append(line, np.nan) for name, line in columns.items()}


def _compared(run: Run, lower: Sequence[Run]) -> dict[str, FloatArray]:
    if not lower:
        return {}
    differences = {}
    for channel in CHANNELS:
        values = np.unwrap(run.signals[channel].to_numpy())
        differences[f"step_{channel}"] = values - _at(lower[-1], run.t, channel)
    path = np.column_stack([_at(lower[0], run.t, name) for name in ("north", "east", "down")])
    differences["distance"] = np.linalg.norm(positions(run.signals) - path, axis=1)
    return differences


def _at(run: Run, t: FloatArray, name: str) -> FloatArray:
    """A signal at other times, NaN after the end of the flight."""
    values = run.signals[name].to_numpy(dtype=float)
    values = np.unwrap(values) if name in CHANNELS else values
    return np.interp(t, run.t, values, right=np.nan)
