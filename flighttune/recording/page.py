"""The text page of a recording: what was asked for and what came of it, in readable tables."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from flighttune.control.gains import PIGains
from flighttune.palette import hue_tells_gains
from flighttune.recording.airframe import span_of
from flighttune.recording.cast import cast, look_of
from flighttune.recording.certified import certified
from flighttune.recording.geometry import enlargement, flown, ground_grid, widest
from flighttune.recording.motion import WIND_TIMES, metres_per_mps
from flighttune.recording.plots import SEEN_AS
from flighttune.simulate.run import Run

SYMBOLS = {"phi": "φ", "n_z": "n_z", "chi": "χ", "gamma": "γ"}

ABOUT = {"verifies": "Verifies", "source": "Source"}

DEGREES = 180.0 / math.pi

TRACKING = {
    "ITAE": ("ITAE [rad s²]", 1.0, 3),
    "PT_s": ("PT [s]", 1.0, 2),
    "MO_rad": ("MO [deg]", DEGREES, 2),
    "MS_rad": ("MS [deg]", DEGREES, 3),
    "ST_rad": ("ST [deg]", DEGREES, 3),
    "rise_s": ("rise [s]", 1.0, 2),
    "settling_s": ("settling [s]", 1.0, 2),
    "effort_rms": ("effort rms", 1.0, 3),
    "saturation_s": ("at limits [s]", 1.0, 2),
}
"""Columns of the metrics shown, their headings, factor to the unit in it, and decimals."""

CERTIFICATE_NOTE = (
    "s is the error and its rate (rad and rad/s), from the signals: exact increments over each "
    "sample. The guarantee is the decaying exponential of R_K plus the ultimate bound for the "
    "mismatch met in the second half of the flight (L_d bounds its derivative). It is about the "
    "loop that is linear and free of limits: it begins anew where the reference moves and where a "
    "limit lets go, and nothing is claimed while a limit holds a command."
)

UNITS = {"rad": ("deg", DEGREES), "mps": ("m/s", 1.0), "s": ("s", 1.0), "m": ("m", 1.0)}
"""Suffix of a column to the unit shown and the factor to it."""


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
    parts += _certificates(runs)
    parts += ["## Scenario", _scenario(scenario), *_made_with(runs)]
    parts += ["## How to read it", *_reading(runs)]
    return "\n\n".join(parts) + "\n"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Markdown table; text in the first column, numbers to the right in the others."""
    rule = ["---", *["---:"] * (len(headings) - 1)]
    cells = [[" ".join(cell.split()).replace("|", "\\|") for cell in row] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in [headings, rule, *cells])


def number(value: float, decimals: int = 3) -> str:
    """Decimal number, or a dash where there is no value."""
    return f"{value:z.{decimals}f}" if math.isfinite(value) else "–" if math.isnan(value) else "∞"


def _about(scenario: Mapping[str, Any]) -> list[str]:
    return [f"**{word}:** {scenario[key]}" for key, word in ABOUT.items() if scenario.get(key)]


def _pairs(runs: Sequence[Run]) -> list[tuple[str, str]]:
    return [(run.provenance.plant, run.provenance.gains_name) for run in runs]


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
        shown = [number(value, 5) for value in pair] if pair else ["–", "–"]
        rows.append([name, *shown, *_matrices(gains)])
    return table(["gains", "R_K [1/s]", "I_K [s²]", "K_P", "K_I"], rows)


def _matrices(gains: PIGains | None) -> list[str]:
    if gains is None:
        return ["none found", "none found"]
    return [
        "[" + "; ".join(", ".join(f"{value:z.4f}" for value in row) for row in matrix) + "]"
        for matrix in (gains.K_P, gains.K_I)
    ]


def _tracking(metrics: pd.DataFrame) -> str:
    shown = {key: how for key, how in TRACKING.items() if key in metrics}
    rows = [
        [
            f"{label}, {SYMBOLS.get(channel, channel)}",
            *(number(v * how[1], how[2]) for v, how in zip(values, shown.values(), strict=True)),
        ]
        for (label, channel), values in zip(
            metrics.index, metrics[list(shown)].to_numpy(dtype=float).tolist(), strict=True
        )
    ]
    return table(["run, channel", *(how[0] for how in shown.values())], rows)


def _flight(flight: pd.DataFrame) -> str:
    headings, factors = [], []
    for name in map(str, flight.columns):
        symbol, _, suffix = name.rpartition("_")
        unit, factor = UNITS.get(suffix, ("", 1.0))
        headings.append(f"{symbol} [{unit}]" if unit else name)
        factors.append(factor)
    rows = [
        [str(label), *(number(v * f) for v, f in zip(row, factors, strict=True))]
        for label, row in zip(flight.index, flight.to_numpy(dtype=float).tolist(), strict=True)
    ]
    return table(["run", *headings], rows)


def _certificates(runs: Sequence[Run]) -> list[str]:
    rows = []
    for run in runs:
        claim = certified(run)
        if claim is not None:
            broken = "never" if claim.t_broken is None else f"{claim.t_broken:.2f}"
            shares = (np.isfinite(claim.bound).mean(), claim.share_broken)
            rows.append(
                [
                    run.label,
                    number(claim.rate / 2.0, 4),
                    number(claim.L_d, 4),
                    number(claim.radius, 4),
                    *(f"{100.0 * share:.1f}" for share in shares),
                    broken,
                ]
            )
    if not rows:
        return []
    headings = [
        "run",
        "decay [1/s]",
        "L_d [rad/s²]",
        "ultimate bound",
        "claimed [% of time]",
        "broken [% of those]",
        "first broken [s]",
    ]
    return ["## Certificate", table(headings, rows), CERTIFICATE_NOTE]


def _scenario(scenario: Mapping[str, Any]) -> str:
    rest = {key: value for key, value in scenario.items() if key not in ABOUT and key != "title"}
    return "\n".join(f"- **{key}**: {_plain(value)}" for key, value in rest.items() if value)


def _plain(value: Any) -> str:
    """A value of a scenario in one line, without quotes."""
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_plain(v)}" for key, v in value.items() if v is not None)
    if isinstance(value, (list, tuple)):
        if any(isinstance(item, Mapping) for item in value):
            return "; ".join(map(_plain, value))
        return f"[{', '.join(map(_plain, value))}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _made_with(runs: Sequence[Run]) -> list[str]:
    if not runs:
        return []
    first = runs[0].provenance
    versions = ", ".join(f"{name} {number}" for name, number in first.versions.items())
    seconds = sum(run.provenance.wall_s for run in runs)
    return [f"Seed {first.seed}; {versions}; flown in {seconds:.2f} s."]


def _reading(runs: Sequence[Run]) -> list[str]:
    members = cast(runs)
    notes = [
        "Plots show angles in degrees; files keep radians. Positions are local north, east and "
        "down from the start, in m. Errors are reference minus actual.",
        "Every run has a colour of its own, the same in 3D and in every plot; the lanes below "
        "name them.",
    ]
    if hue_tells_gains(_pairs(runs)):
        notes[-1] += (
            " The hue tells the gains; of two plants the first has the light shade, the last the "
            "strong one."
        )
    if any(name in run.signals for run in runs for name in SEEN_AS.values()):
        notes.append(
            "The faint lines behind course, path angle and airspeed are what the sensors showed "
            "the controller. Errors and metrics are of the true values. The guarantee does not "
            "count what sensors add: a flight may rise above it by that alone."
        )
    if members:
        points = flown(members)
        span = widest(members)
        factor, spacing = enlargement(points, span), ground_grid(points)[1]
        notes.append(
            f"Aircraft are drawn {factor:g} times their size: a span of {span:.3g} m is shown as "
            f"{factor * span:.3g} m. Lines on the ground are {spacing:g} m apart, half as much "
            "below the lowest level flown; the paths have their shadows on it."
        )
        length = metres_per_mps(members[0], factor * span_of(members[0].run))
        notes.append(
            f"The arrow of an aircraft is its velocity over ground ({length:.3g} m per m/s), the "
            f"white one the wind, {WIND_TIMES:g} times longer. The grey ring at the tip is the "
            "certified set: while the tip is inside, the errors of course and path angle are as "
            "guaranteed. There is none while nothing is claimed, or no "
            "less than 45 deg. The thick piece of a path is the "
            "last eighth of the flight."
        )
    return notes
