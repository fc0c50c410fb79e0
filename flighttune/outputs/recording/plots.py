"""Plots over time: signals that share a plot, and plots that share a tab."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from flighttune.base.arrays import FloatArray
from flighttune.base.signals import ALL_SIGNALS, SIGNALS
from flighttune.base.units import shown_unit
from flighttune.flight.loop.run import Run, claims_around
from flighttune.gaps.residual import CHANNELS, trim_of
from flighttune.vehicles.plants import point_mass

if TYPE_CHECKING:
    from flighttune.outputs.recording.entities import DrawnRun


# Components of the mismatch, in the order of the ladder: actual lift, inner loop and rest.
PARTS = ("lift", "lag", "rest")

FLOWN = ("phi", "n_z", "phi_cmd", "n_z_cmd", "V_a", "gamma")


@dataclass(frozen=True, slots=True)
class Plot:
    """One plot over time: the same signals of every run."""

    signal: str  # one strong line for each run; sets the plot's unit and folder
    title: str
    thin: str = ""  # second signal of each run, drawn thin in the same colour
    common: str = ""  # signal shared by all runs, drawn once in grey
    limit: str = ""  # key of the scenario's [limits] without unit, drawn as two lines
    claims: tuple[str, ...] = ()  # titles of the claims that bound it, in the same colour
    measured: str = ""  # sensor signal, drawn faintly behind it in the same colour
    unit: str | None = None  # unit of a signal of the user's own law; not converted

    @property
    def heading(self) -> str:
        """Title with symbol and unit, for example ``Course chi [deg]``."""
        unit = shown_unit(unit_of(self.signal))[0] if self.unit is None else self.unit
        measured = ["measured faint"] if self.measured else []
        return ", ".join([f"{self.title} [{unit}]", *self.claims, *measured])

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals of a run on this plot, the strong one first."""
        return (self.signal, self.thin) if self.thin else (self.signal,)


WEATHER = "wind", "disturbance"  # groups omitted in calm air
CALMEST = 1e-6  # wind (m/s) and disturbance (rad/s) below this are rounding

ROOM = 0.05  # share of the range by which an axis extends at each end
LABELS = 28.0  # number of labels on an axis as high as a small window's tab
LONGEST = 2.2  # an axis longer than this, relative to the drawn range, gets no second label
SMALLEST_SPAN = 1e-6

# Sentences of a recording, and tabs of plots, in order.
TEXTS = tomllib.loads(Path(__file__).with_name("texts.toml").read_text(encoding="utf-8"))
TABS: dict[str, tuple[Plot, ...]] = {
    tab: tuple(
        Plot(name, row.short, row.thin, row.reference, row.limit)
        for group in texts["groups"]
        for name, row in ALL_SIGNALS.items()
        if row.group == group
    )
    for tab, texts in TEXTS["tabs"].items()
    if "groups" in texts
}


def shown_plots(runs: Sequence[Run]) -> dict[str, tuple[Plot, ...]]:
    """The plots of each tab with a signal of at least one run; no wind in calm air."""
    aircraft = any(run.provenance.aircraft for run in runs)

    def shows(plot: Plot) -> bool:
        having = [run.signals[plot.signal] for run in runs if plot.signal in run.signals]
        row = ALL_SIGNALS.get(plot.signal)
        if row and row.derived and not aircraft:
            return False
        if not (row and row.group in WEATHER):
            return bool(having)
        return any(bool((np.abs(values.to_numpy()) > CALMEST).any()) for values in having)

    units = {name: unit for run in runs for name, unit in run.units.items()}
    law_plots = tuple(Plot(name, name, unit=unit) for name, unit in units.items())
    tabs = {
        tab: tuple(
            _as_flown(plot, runs)
            for plot in (*plots, *(law_plots if tab == "Law" else ()))
            if shows(plot)
        )
        for tab, plots in TABS.items()
    }
    return {tab: plots for tab, plots in tabs.items() if plots}


def _as_flown(plot: Plot, runs: Sequence[Run]) -> Plot:
    """The plot with the measured signal and the claims of a run."""
    recorded = {name for run in runs for name in run.signals}
    measured = SIGNALS[plot.signal].measured if plot.signal in SIGNALS else ""
    claims = {
        f"{claim.title} {'dashed' if claim.kind == 'counted' else 'thin'}": None
        for run in runs
        for claim, _ in claims_around(run.claims, plot.signal)
    }
    return replace(plot, measured=measured if measured in recorded else "", claims=tuple(claims))


def displayed(signals: pd.DataFrame, name: str) -> FloatArray:
    """Values of a signal in the shown unit: degrees for angles, courses without jumps at +-180."""
    values = signals[name].to_numpy(dtype=float)
    if name in ("chi", "chi_ref"):
        values, there = values.copy(), np.isfinite(values)
        values[there] = np.unwrap(values[there])
    elif name == SIGNALS["chi"].measured:
        centre = signals["chi"].to_numpy(dtype=float)
        values = np.unwrap(centre) + (values - centre)
    return values * shown_unit(unit_of(name))[1]


def unit_of(name: str) -> str:
    """SI unit of a signal, recorded or derived."""
    return ALL_SIGNALS[name].unit if name in ALL_SIGNALS else ""


def value_range(plot: Plot, runs: Sequence[Run], *, share: float) -> tuple[float, float] | None:
    """Range of the vertical axis in the shown unit; None without variation."""
    having = [run for run in runs if plot.signal in run.signals]
    names = [*plot.signals, *filter(None, (plot.common, plot.measured))]
    values = [
        displayed(run.signals, name) for run in having for name in names if name in run.signals
    ]
    factor = shown_unit(unit_of(plot.signal))[1]
    for run in having:
        values += [factor * ends.ravel() for _, ends in claims_around(run.claims, plot.signal)]
        bounds = limits_of(run.provenance.scenario, plot.limit) if plot.limit else None
        values += [np.array(bounds)] if bounds else []
    everything = np.concatenate(values) if values else np.zeros(0)
    everything = everything[np.isfinite(everything)]
    low, high = (everything.min(), everything.max()) if len(everything) else (0.0, 0.0)
    if not high - low > SMALLEST_SPAN * max(1.0, abs(low), abs(high)):
        return None
    # The viewer labels multiples of a power of ten: between -9 and 9 only 0. Steps between two
    # labels need at least one more label.
    step = 10.0 ** math.ceil(math.log10((high - low) / max(LABELS * share - 2.0, 2.0)))
    lower, upper = low / step, high / step
    while math.floor(upper) - math.ceil(lower) < 1:
        above, below = math.floor(upper) + 1, math.ceil(lower) - 1
        if above - upper <= lower - below:
            upper = above
        else:
            lower = below
    if (upper - lower) * step <= LONGEST * (high - low):
        low, high = lower * step, upper * step
    room = ROOM * (high - low)
    return float(low - room), float(high + room)


def limits_of(scenario: Mapping[str, Any], name: str) -> tuple[float, float] | None:
    """Lower and upper limit of ``phi`` (deg) or ``n_z`` in a scenario as written in TOML."""
    table = scenario.get("limits") or {}
    bounds = table.get(f"{name}_deg", table.get(name))
    if bounds is None or len(bounds) != 2:
        return None
    return float(bounds[0]), float(bounds[1])


def positions(signals: pd.DataFrame) -> FloatArray:
    """North, east and down of every sample, shape (n, 3), m."""
    return signals[["north", "east", "down"]].to_numpy(dtype=float)


def with_derived(flights: "Sequence[DrawnRun]") -> "list[DrawnRun]":
    """The runs with their derived signals, height and speed over ground."""
    before: dict[str, list[Run]] = {}
    extended = []
    for drawn_run in flights:
        run = drawn_run.run
        lower = before.setdefault(run.provenance.gains_name, [])
        columns = {**_over_ground(run), **_parts(run), **_compared(run, lower)}
        lower.append(run)
        with_columns = replace(run, signals=run.signals.assign(**columns)) if columns else run
        extended.append(drawn_run._replace(run=with_columns))
    return extended


def _over_ground(run: Run) -> dict[str, FloatArray]:
    """Height and speed over ground from the path of a plant that lacks them."""
    signals, derived = run.signals, {}
    flight = run.provenance.scenario.get("flight") or {}
    if "h" not in signals and "h_m" in flight:
        derived["h"] = float(flight["h_m"]) - signals["down"].to_numpy()
    if "V_g" not in signals and len(signals) > 1:
        level = positions(signals)[:, :2]
        derived["V_g"] = np.linalg.norm(np.gradient(level, run.t, axis=0), axis=1)
    return derived


def _parts(run: Run) -> dict[str, FloatArray]:
    """Rates that each part of an aircraft adds to the law's rates under the same commands."""
    trim, signals = trim_of(run), run.signals
    if run.provenance.aircraft is None or trim is None or not set(FLOWN) <= set(signals):
        return {}
    phi, n_z, phi_cmd, n_z_cmd, V_a, gamma = (signals[name].to_numpy() for name in FLOWN)
    chi_rate = np.gradient(np.unwrap(signals["chi"].to_numpy()), run.t)
    actual = chi_rate, np.gradient(signals["gamma"].to_numpy(), run.t)
    exact = point_mass.turn_rates(V_a, gamma, phi_cmd, n_z_cmd, turn="exact", g=trim.g)
    behind = point_mass.turn_rates(V_a, gamma, phi, n_z, turn="exact", g=trim.g)
    kinematic = point_mass.turn_rates(trim.V_a, gamma, phi_cmd, n_z_cmd, turn="paper", g=trim.g)
    modelled = {"kinematic": kinematic, "point_mass": exact}[run.provenance.law.plant]
    # lift: exact minus modelled; inner loop: response minus command; rest: flown minus all these
    steps = modelled, exact, behind, actual
    return {
        f"{part}_{channel}": steps[k + 1][i] - steps[k][i]
        for k, part in enumerate(PARTS)
        for i, channel in enumerate(CHANNELS)
    }


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
