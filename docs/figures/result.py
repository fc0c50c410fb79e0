"""Draw docs/result.svg, what came out in two panels: python docs/figures/result.py.

It flies a campaign of 4000 flights, about a minute.
"""

import tempfile
from pathlib import Path

import numpy as np

from flighttune import load_scenario
from flighttune.campaign.dataset import open_dataset
from flighttune.campaign.engine.engine import run_campaign
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.campaign.statistics.intervals import rate_interval
from flighttune.files.shipped import campaign_files
from flighttune.flight.fly import fly
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.palette import HUES, INK, NEUTRAL
from flighttune.simulate.run import Run
from flighttune.units import DEG_PER_RAD

FILE = Path(__file__).parents[1] / "result.svg"
BLUE, RUST, GREEN = (strong[0] for strong, _ in HUES[:3])
CAMPAIGN = "aerosonde_dispersed"
GAINS = {
    "paper": ("the paper's\ngains K*", BLUE),
    "tuned_identified": ("tuned on the\nidentified aircraft", GREEN),
    "exact:tuned_identified": ("the same, with\nthe exact law", RUST),
}
"""Gain sets of the right panel."""


def flown() -> dict[str, Run]:
    """The runs of the left panel by label."""
    runs = fly(load_scenario("paper_identified")).runs
    return {run.label: run for run in runs}


def shares(folder: Path) -> dict[str, tuple[float, float, float]]:
    """Share of the campaign's draws on which gains succeed, with its 95 % interval, by gain set."""
    text = campaign_files()[CAMPAIGN].read_text(encoding="utf-8")
    changes = {
        'scenario = "paper_identified"': 'scenario = "exact_law"',
        "runs     = 2000": "runs     = 4000",  # each gain set with each of its two laws
    }
    for old, new in changes.items():
        if old not in text:
            raise SystemExit(f"{CAMPAIGN} must have the line {old}")
        text = text.replace(old, new)
    file = folder / "campaign.toml"
    file.write_text(text, encoding="utf-8")
    run_campaign(plan_campaign(load_campaign(file)), folder / "out")
    rows = open_dataset(folder / "out").rows().to_pandas()
    found = {}
    for name, group in rows.groupby("gains"):
        low, high = rate_interval(np.array([group["success"].sum()]), np.array([len(group)]))
        found[str(name)] = float(group["success"].mean()), float(low[0]), float(high[0])
    return found


def errors(runs: dict[str, Run]) -> Chart:
    """Course error over time of the paper's gains and of tuned ones."""
    lines = (
        ("kinematic / paper", "the paper's gains K* on the kinematic law", NEUTRAL),
        ("jsbsim:aerosonde / paper", "K* on the aircraft", BLUE),
        ("jsbsim:aerosonde / tuned_identified", "tuned here, on the aircraft", GREEN),
    )
    chart = Chart(
        title="A turn by 60° while the climb flattens by 30°",
        y="course error [deg]",
        x_range=(0.0, 20.0),
    )
    for label, words, colour in lines:
        run = runs[label]
        error = run.signals["chi_err"].to_numpy() * DEG_PER_RAD
        dash = DASHED if colour == NEUTRAL else ""
        chart.line(run.t, error, colour, dash=dash, width=2.0, name=words)
    return chart


def share_bars(measured: dict[str, tuple[float, float, float]]) -> Chart:
    """Shares of `shares` as bars with their intervals."""
    chart = Chart(
        title="Share of 1000 dispersed flights that meet the requirements",
        x="",
        y="flights [%], with 95 % interval",
        y_range=(0.0, 108.0),
        x_ticks=[(place, words) for place, (words, _) in enumerate(GAINS.values())],
    )
    percent = [[100.0 * value for value in measured[name]] for name in GAINS]
    colours = [colour for _, colour in GAINS.values()]
    chart.bars([0.0] * len(percent), [share for share, _, _ in percent], colours)
    for place, (share, low, high) in enumerate(percent):
        chart.line([place, place], [low, high], INK, width=2.0)
        chart.text(place, high, f"{share:.1f} %", anchor="middle", shift=(0.0, -5.0))
    return chart


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        Sheet(charts=[errors(flown()), share_bars(shares(Path(scratch)))]).save(FILE)
