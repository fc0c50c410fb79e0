"""How groups, measures and numbers are written for a reader."""

import math
from dataclasses import dataclass

from flighttune.campaign.flying.columns import unit_of_measure
from flighttune.campaign.planning.plan import Group, Plan
from flighttune.campaign.report.estimates import Estimate
from flighttune.palette import Look, many_looks
from flighttune.scenario.expect_table import ExpectTable
from flighttune.units import DEG

SYMBOLS = {"chi": "χ", "gamma": "γ"}
NAMES = {
    "ITAE": "ITAE",
    "ITAE_mean": "ITAE over time",
    "PT_s": "peak time",
    "MO_rad": "overshoot",
    "MS_rad": "late mean error",
    "ST_rad": "late deviation",
    "rise_s": "rise",
    "settling_s": "settling 5\u00a0%",
    "effort_rms": "effort rms",
    "saturation_s": "held by limits",
    "peak_rad": "largest error",
    "V_a_dev_mps": "airspeed off by",
    "n_z_min": "least n_z",
    "n_z_max": "largest n_z",
    "alpha_max_rad": "largest |α|",
}
UNITS = {"rad": "deg", "rad s^2": "rad\u00a0s²", "rad s": "rad\u00a0s"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """How a measure is shown.

    Attributes
    ----------
    name : str
    unit : str
        As a reader wants it: degrees.
    factor : float
        From the column to that unit.
    """

    name: str
    unit: str
    factor: float

    @property
    def titled(self) -> str:
        """Name with unit."""
        return f"{self.name} [{self.unit}]"


def shown(measure: str) -> Shown:
    """Name, unit and factor of a measure by its column, such as ``chi.MO_rad``."""
    subject, name = measure.split(".")
    unit = unit_of_measure(measure)
    of = f" of {SYMBOLS[subject]}" if subject in SYMBOLS else ""
    return Shown(
        name=NAMES[name] + of,
        unit=UNITS.get(unit, unit),
        factor=1.0 / DEG if unit == "rad" else 1.0,
    )


def label_of(group: Group) -> str:
    """``plant / gains``, as runs are called everywhere."""
    return f"{group.plant} / {group.gains}"


def looks_of(plan: Plan) -> dict[str, Look]:
    """Look of every group by its label, the same as of the flights of its scenario."""
    pairs = [(plant.label, name) for plant in plan.scenario.plant for name in plan.gain_sets]
    found = many_looks(pairs)
    return {
        label_of(Group(plant=plant, gains=gains)): found[plant, gains] for plant, gains in pairs
    }


def percent(share: float) -> str:
    """A share in per cent: one decimal, more near nothing and everything."""
    if not math.isfinite(share):
        return "–"
    value = 100.0 * share
    edge = min(value, 100.0 - value)
    decimals = 0 if edge == 0.0 else 1 if edge >= 0.1 else 2 if edge >= 0.01 else 3
    return f"{value:.{decimals}f}"


def percent_with_interval(one: Estimate) -> str:
    """``97.3 % (96.1 to 98.1 %)``."""
    return f"{percent(one.value)} % ({percent(one.lo)} to {percent(one.hi)} %)"


def figures(value: float) -> str:
    """A number with three figures, an infinite one as a sign, a dash where there is none."""
    if math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def with_interval(one: Estimate, factor: float = 1.0) -> str:
    """``4.63 [4.25, 4.89]``; a side of the interval that is not bounded is infinite."""
    if math.isnan(one.value):
        return "–"
    low, value, high = (factor * number for number in (one.lo, one.value, one.hi))
    return f"{figures(value)} [{figures(low)}, {figures(high)}]"


def probability(p: float) -> str:
    """``p = 0.013``, or that it is below what matters."""
    return f"p = {p:.2g}" if p >= 1e-4 else "p < 0.0001"


def demands(tables: list[ExpectTable]) -> str:
    """What a flight must come to to succeed, in a sentence."""
    if not tables:
        return "A flight succeeds if it is completed."
    said = []
    for table in tables:
        of = ", ".join(str(one) for one in (table.plant, table.gains) if one)
        wanted = [f"ends as {table.status}"] if table.status else []
        for word, bounds in (("at most", table.at_most), ("at least", table.at_least)):
            wanted += [
                f"{subject}.{name} {word} {value:g}"
                for subject, limits in bounds.items()
                for name, value in limits.items()
            ]
        said.append((f"{of}: " if of else "") + ", ".join(wanted))
    return f"A flight succeeds if it is completed (unless said otherwise) with {'; '.join(said)}."
