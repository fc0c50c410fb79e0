"""The text page of a recording: what was asked for and what came of it, in readable tables."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from flighttune.control.gains import PIGains
from flighttune.recording.cast import cast, look_of
from flighttune.recording.geometry import enlargement, flown
from flighttune.recording.mesh import SPAN
from flighttune.simulate.run import Run

SYMBOLS = {"phi": "φ", "n_z": "n_z", "chi": "χ", "gamma": "γ"}

TRACKING = {
    "ITAE": ("ITAE [rad s²]", 1.0),
    "PT_s": ("PT [s]", 1.0),
    "MO_rad": ("MO [deg]", 180.0 / math.pi),
    "MS_rad": ("MS [deg]", 180.0 / math.pi),
    "ST_rad": ("ST [deg]", 180.0 / math.pi),
    "rise_s": ("rise [s]", 1.0),
    "settling_s": ("settling [s]", 1.0),
    "effort_rms": ("effort rms", 1.0),
    "saturation_s": ("at limits [s]", 1.0),
}
"""Columns of the metrics shown first, their headings and the factor to the unit in it."""


def scenario_page(
    runs: Sequence[Run],
    *,
    scenario: Mapping[str, Any],
    indicators: Mapping[str, tuple[float, float] | None] | None = None,
    metrics: pd.DataFrame | None = None,
    flight: pd.DataFrame | None = None,
) -> str:
    """Render the page that a recording shows beside its plots.

    Parameters
    ----------
    runs : sequence of Run
        All runs of the scenario, also those that never flew.
    scenario : mapping
        The scenario as written in TOML.
    indicators : mapping of str to (float, float) or None, optional
        R_K and I_K by name of the gain set; None where the loop is not stable.
    metrics : DataFrame, optional
        Index (run label, channel), columns as `flighttune.metrics.METRICS`; angles in rad.
    flight : DataFrame, optional
        Index run label, one column a measure of the whole aircraft, SI and rad.

    Returns
    -------
    str
        Markdown.
    """
    parts = [f"# {scenario.get('title', 'Flight')}", *_about(scenario)]
    parts += ["## Runs", _runs(runs)]
    parts += ["## Gains", _gains(runs, indicators or {})]
    if metrics is not None and len(metrics):
        parts += ["## Tracking", _tracking(metrics)]
    if flight is not None and len(flight):
        parts += ["## Aircraft", _flight(flight)]
    parts += ["## Scenario", _scenario(scenario), "## How to read it", *_reading(runs)]
    return "\n\n".join(parts) + "\n"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table; text in the first column, numbers to the right in the others."""
    lines = [headings, ["---", *["---:"] * (len(headings) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def number(value: float, *, digits: int = 4) -> str:
    """Significant digits of `value`, without exponent where it can be read without."""
    if math.isnan(value):
        return "–"
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.{digits - 1}g}"
    before = math.floor(math.log10(abs(value))) + 1 if value else 1
    return f"{value:.{min(digits, max(0, digits - before))}f}"


def _about(scenario: Mapping[str, Any]) -> list[str]:
    shown = {"verifies": "Verifies", "source": "Source"}
    return [f"**{word}:** {scenario[key]}" for key, word in shown.items() if scenario.get(key)]


def _runs(runs: Sequence[Run]) -> str:
    rows = []
    for run, look in zip(runs, look_of(runs), strict=True):
        status = run.status.replace("_", " ") + (f": {run.reason}" if run.reason else "")
        colour = look.name if len(run.signals) > 1 else "not drawn"
        rows.append([run.label, colour, f"{run.duration:.2f}", status])
    return table(["run", "colour", "flown [s]", "outcome"], rows)


def _gains(runs: Sequence[Run], indicators: Mapping[str, tuple[float, float] | None]) -> str:
    sets = {run.provenance.gains_name: run.provenance.gains for run in runs}
    rows = []
    for name, gains in sets.items():
        pair = indicators.get(name)
        shown = [number(value, digits=5) for value in pair] if pair else ["–", "–"]
        rows.append([name, *shown, *_matrices(gains)])
    return table(["gains", "R_K [1/s]", "I_K [s²]", "K_P", "K_I"], rows)


def _matrices(gains: PIGains | None) -> list[str]:
    if gains is None:
        return ["none found", "none found"]
    return [
        "; ".join("  ".join(f"{value:.4f}" for value in row) for row in matrix)
        for matrix in (gains.K_P, gains.K_I)
    ]


def _tracking(metrics: pd.DataFrame) -> str:
    shown = {key: how for key, how in TRACKING.items() if key in metrics}
    factors = [factor for _, factor in shown.values()]
    rows = [
        [
            f"{label}, {SYMBOLS.get(channel, channel)}",
            *(number(value * factor) for value, factor in zip(values, factors, strict=True)),
        ]
        for (label, channel), values in zip(
            metrics.index, metrics[list(shown)].to_numpy(dtype=float).tolist(), strict=True
        )
    ]
    return table(["run, channel", *(heading for heading, _ in shown.values())], rows)


def _flight(flight: pd.DataFrame) -> str:
    headings, factors = [], []
    for name in map(str, flight.columns):
        symbol, _, unit = name.rpartition("_")
        angle = unit == "rad"
        factors.append(180.0 / math.pi if angle else 1.0)
        units = {"rad": "deg", "mps": "m/s", "s": "s", "m": "m"}
        headings.append(f"{symbol} [{units[unit]}]" if unit in units else name)
    rows = [
        [str(label), *(number(v * f) for v, f in zip(row, factors, strict=True))]
        for label, row in zip(flight.index, flight.to_numpy(dtype=float).tolist(), strict=True)
    ]
    return table(["run", *headings], rows)


def _scenario(scenario: Mapping[str, Any]) -> str:
    about = {"title", "verifies", "source"}
    rows = [
        [name, str(value) if not isinstance(value, Mapping) else _keys(value)]
        for name, value in scenario.items()
        if name not in about and value not in (None, {}, [])
    ]
    return "\n".join(f"- **{name}**: {value}" for name, value in rows)


def _keys(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{key} = {value}" for key, value in values.items() if value is not None)


def _reading(runs: Sequence[Run]) -> list[str]:
    members = cast(runs)
    notes = [
        "Plots show angles in degrees; files keep radians. Positions are local north, east and "
        "down from the start, in m. Errors are reference minus actual.",
        "A colour belongs to one pair of plant and gains, in 3D and in every plot: the hue tells "
        "the gains, the strong shade the last plant, the light shade the one before.",
    ]
    if members:
        factor = enlargement(flown(members))
        notes.append(
            f"Aircraft are drawn {factor:g} times their size: the span of {SPAN} m is shown as "
            f"{factor * SPAN:g} m."
        )
    return notes
