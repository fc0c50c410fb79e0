"""Names, symbols and units of channels, signals and metrics as a reader sees them."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

from flighttune.present.numbers import number
from flighttune.present.tables import Column
from flighttune.units import DEG_PER_RAD

CHANNEL_SYMBOLS = {"chi": "χ", "gamma": "γ"}
SYMBOLS = {**CHANNEL_SYMBOLS, "phi": "φ", "n_z": "n_z"}
CHANNEL_NAMES = {"chi": "course", "gamma": "path angle"}


@dataclass(frozen=True, slots=True)
class MetricLabel:
    """Label, unit and digits of a metric."""

    name: str
    unit: str  # unit shown: degrees for radians
    decimals: int  # of the value in that unit
    factor: float = 1.0  # from SI to that unit

    @property
    def heading(self) -> str:
        """Name with unit, for a column or an axis."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def text(self, value: float) -> str:
        """A value of the metric (SI) in the unit shown."""
        return number(value * self.factor, f"z.{self.decimals}f")

    def column(self, key: str, **more: Any) -> Column:
        """The column of a table with the metric (SI) at `key` of its records."""
        return Column(key, self.name, self.unit, f"z.{self.decimals}f", self.factor, **more)


METRIC_LABELS = {
    "ITAE": MetricLabel("ITAE", "rad\u00a0s²", 2),
    "ITAE_mean": MetricLabel("ITAE over time", "rad\u00a0s", 3),
    "MO_rad": MetricLabel("overshoot", "deg", 2, DEG_PER_RAD),
    "PT_s": MetricLabel("peak time", "s", 2),
    "rise_s": MetricLabel("rise time", "s", 2),
    "settling_s": MetricLabel("settling time (5\u00a0%)", "s", 2),
    "MS_rad": MetricLabel("mean error, last quarter", "deg", 3, DEG_PER_RAD),
    "ST_rad": MetricLabel("standard deviation, last quarter", "deg", 3, DEG_PER_RAD),
    "effort_rms": MetricLabel("effort rms", "", 3),
    "saturation_s": MetricLabel("time at limits", "s", 2),
    "peak_rad": MetricLabel("peak error", "deg", 2, DEG_PER_RAD),
    "V_a_dev_mps": MetricLabel("airspeed deviation", "m/s", 2),
    "n_z_min": MetricLabel("minimum n_z", "1", 2),
    "n_z_max": MetricLabel("maximum n_z", "1", 2),
    "alpha_max_rad": MetricLabel("maximum |α|", "deg", 1, DEG_PER_RAD),
}
"""Label of each metric of a channel or of the flight, by its key."""


def metric_label(key: str) -> MetricLabel:
    """Label of a metric of one channel by its column, such as ``chi.MO_rad``: overshoot of χ."""
    channel, metric = key.split(".")
    label = METRIC_LABELS[metric]
    if channel not in SYMBOLS:
        return label
    label = replace(label, name=f"{label.name} of {SYMBOLS[channel]}")
    if metric != "effort_rms":
        return label
    # The effort is that of the command: roll for the course, load factor for the path angle.
    unit, factor = ("deg", DEG_PER_RAD) if channel == "chi" else ("1", 1.0)
    return replace(label, unit=unit, factor=factor)


UNIT_OF_SUFFIX = {
    "_rad_s2": "rad/s²",
    "_rad_s": "rad/s",
    "_per_s": "1/s",
    "_mps": "m/s",
    "_hz": "Hz",
    "_deg": "deg",
    "_percent": "%",
    "_s": "s",
    "_m": "m",
}
"""Unit of a value by the end of its key; longer ends first."""

QUANTITIES = {
    column.key: column
    for column in (
        Column("R_K", "R_K", "1/s", ".5g", best="high"),
        Column("I_K", "I_K", "s²", ".5g", best="low"),
        Column("spectral_abscissa", "spectral abscissa", "1/s"),
        Column("rate", "rate", "1/s", ".6g"),
        Column("growth", "largest growth of the norm"),
        Column("radius", "ultimate radius", "rad"),
        Column("L_d", "L_d", "rad/s²"),
        Column("V_a_mps", "V_a", "m/s"),
        Column("gamma_deg", "γ", "deg", "z.4g"),
        Column("alpha_deg", "α", "deg", "z.2f"),
        Column("beta_deg", "β", "deg", "z.2f"),
        Column("natural_frequency_rad_s", "ω", "rad/s"),
        Column("fit_percent", "fit", "%", ".2f"),
        Column("wall_s", "time", "s"),
        Column("n", "flights"),
        Column("successes", "succeed"),
        Column("status", "status", good=("completed", "certified", "found", "optimal", "stable")),
        Column("met", "met", good=("yes",)),
        Column("inside", "flight inside", good=("yes",)),
        Column("exact", "proven exactly", good=("yes",)),
        Column("converges", "converges", good=("yes",)),
    )
}
"""Label of a quantity by the last part of its key, where the key does not say it."""


def columns(keys: str) -> list[Column]:
    """Columns of a table by the keys of its records, separated by spaces."""
    return [_column(key) for key in keys.split()]


def _column(key: str) -> Column:
    rest, _, last = key.rpartition(".")
    channel = rest.rpartition(".")[2]
    if last in METRIC_LABELS:
        label = METRIC_LABELS[last]
        name = f"{label.name} {SYMBOLS[channel]}" if channel in SYMBOLS else label.name
        return replace(label, name=name).column(key)
    if last in QUANTITIES:
        return replace(QUANTITIES[last], key=key)
    for suffix, unit in UNIT_OF_SUFFIX.items():
        if last.endswith(suffix):
            return Column(key, last.removesuffix(suffix).replace("_", " "), unit)
    return Column(key, last.replace("_", " "))


def shown_unit(unit: str) -> tuple[str, float]:
    """Unit that a reader sees for an SI unit, and the factor to it: degrees for radians."""
    if unit in ("rad", "rad/s"):
        return unit.replace("rad", "deg"), DEG_PER_RAD
    return unit, 1.0


def distinct(names: Iterable[str]) -> list[str]:
    """Names in order; one that repeats an earlier one ends in ``_2``, ``_3`` and so on."""
    taken: dict[str, None] = {}
    for stem in names:
        name, again = stem, 2
        while name in taken:
            name, again = f"{stem}_{again}", again + 1
        taken[name] = None
    return list(taken)
