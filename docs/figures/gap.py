"""Draw docs/gap.svg and write the numbers of docs/gap.md: python docs/figures/gap.py."""

from pathlib import Path

import numpy as np

import flighttune as ft
from flighttune import load_scenario
from flighttune.base.units import DEG_PER_RAD
from flighttune.flight.loop.run import Run
from flighttune.flight.models import gain_set
from flighttune.gaps.gap import Gap
from flighttune.outputs.pages.charts import gap_sheet

FOLDER = Path(__file__).parents[1]
BEGIN, END = "<!-- gap:begin -->\n", "<!-- gap:end -->"
GAINS = "paper"
TURNED = 5.0 / DEG_PER_RAD
COLUMNS = {"ITAE": ("ITAE", "rad s²", 1.0), "ST_rad": ("ST", "deg", DEG_PER_RAD)}


def paper_gap() -> Gap:
    """The gap of the paper's manoeuvre with the paper's gains."""
    scenario = load_scenario("paper")
    gains = gain_set(scenario, GAINS)
    if gains is None:
        raise SystemExit(f"there are no gains named {GAINS}")
    return ft.gap(scenario, gains, name=GAINS)


def rows(gap: Gap) -> list[tuple[str, list[float]]]:
    """Name and numbers of each row of the table."""
    if gap.whole is None:
        raise SystemExit(gap.reason)
    metrics = gap.flown().metrics

    def numbers(table) -> list[float]:
        return [
            float(table.loc[channel, key]) * unit
            for key, (_, _, unit) in COLUMNS.items()
            for channel in ("chi", "gamma")
        ]

    first, last = gap.runs[0], gap.runs[-1]
    found = [(f"`{first.provenance.plant}`", numbers(metrics.loc[first.label]))]
    found += [(f"+ {step.adds}", numbers(step.metrics)) for step in gap.steps]
    return [*found, (f"= `{last.provenance.plant}`", numbers(metrics.loc[last.label]))]


def table(gap: Gap) -> str:
    """The contributions as a Markdown table."""
    heads = ["plant or step"]
    heads += [f"{name} {s} [{unit}]" for name, unit, _ in COLUMNS.values() for s in "χγ"]
    lines = [heads, ["---", *["---:"] * (len(heads) - 1)]]
    for name, values in rows(gap):
        sign = "+" if name.startswith("+") else ""
        lines.append([name, *(f"{value:{sign}.2f}" for value in values)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def reading(gap: Gap) -> str:
    """The sentences with numbers below the table."""
    if gap.mismatch is None:
        raise SystemExit(gap.reason)
    phi, n_z = (gap.lags[name][1] for name in ("phi", "n_z"))
    waits = [f"{first_turn(run):.1f} s on `{run.provenance.plant}`" for run in gap.runs]
    return "\n".join(
        [
            f"The first {TURNED * DEG_PER_RAD:.0f} deg of turn "
            f"take {', '.join(waits)}. The {gap.lag_source} lag accounts for "
            f"{phi:.1f} % of the variance of φ in this flight and for "
            f"{n_z:.1f} % of that of n_z.",
            "",
            f"The mismatch reaches {gap.mismatch.bound:.2f} rad/s, its derivative "
            f"L_d = {gap.mismatch.L_d:.2f} rad/s².",
        ]
    )


def first_turn(run: Run) -> float:
    """Time at which the course has moved by `TURNED` toward the reference, s."""
    moved = (run.signals["chi"].iloc[0] - run.signals["chi"]).to_numpy() >= TURNED
    return float(run.signals.index[int(np.argmax(moved))])


def written(text: str, gap: Gap) -> str:
    """The page with the section between its marks made new."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{table(gap)}\n\n{reading(gap)}\n\n{END}{after}"


if __name__ == "__main__":
    flown = paper_gap()
    gap_sheet(flown).save(FOLDER / "gap.svg")
    page = FOLDER / "gap.md"
    page.write_text(written(page.read_text(encoding="utf-8"), flown), encoding="utf-8")
