"""Draw docs/result.png, what came out in two panels: python docs/figures/result.py.

It flies a campaign of 4000 flights, about a minute.
"""

import tempfile
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from flighttune.campaign.dataset import open_dataset
from flighttune.campaign.engine.engine import run_campaign
from flighttune.campaign.planning.load import load_campaign
from flighttune.campaign.planning.plan import plan_campaign
from flighttune.campaign.statistics.intervals import rate_interval
from flighttune.flight.fly import fly
from flighttune.paper.style import RC
from flighttune.present.palette import HUES, INK, NEUTRAL
from flighttune.scenario import load_scenario
from flighttune.shipped import campaign_files
from flighttune.simulate.run import Run
from flighttune.units import DEG_PER_RAD

FILE = Path(__file__).parents[1] / "result.png"
BLUE, RUST, GREEN = (strong[0] for strong, _ in HUES[:3])
CAMPAIGN = "aerosonde_dispersed"
GAINS = {
    "paper": ("the paper's gains K*", BLUE),
    "tuned_identified": ("tuned on the identified aircraft", GREEN),
    "exact:tuned_identified": ("the same, with the exact law", RUST),
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


def _errors(axes: Axes, runs: dict[str, Run]) -> None:
    lines = (
        ("kinematic / paper", "the paper's gains K* on the kinematic law", NEUTRAL),
        ("jsbsim:aerosonde / paper", "K* on the aircraft", BLUE),
        ("jsbsim:aerosonde / tuned_identified", "tuned here, on the aircraft", GREEN),
    )
    for label, words, colour in lines:
        run = runs[label]
        error = run.signals["chi_err"].to_numpy() * DEG_PER_RAD
        style = "--" if colour == NEUTRAL else "-"
        axes.plot(run.t, error, color=colour, lw=2.0, ls=style, label=words)
    axes.legend(loc="lower right")
    axes.set_title("A turn by 60° while the climb flattens by 30°")
    axes.set_xlabel("t [s]")
    axes.set_ylabel("course error [deg]")
    axes.set_xlim(0.0, 20.0)


def _shares(axes: Axes, found: dict[str, tuple[float, float, float]]) -> None:
    for place, (name, (words, colour)) in enumerate(reversed(GAINS.items())):
        share, low, high = (100.0 * value for value in found[name])
        axes.barh(place, share, 0.5, color=colour)
        axes.errorbar(share, place, xerr=[[share - low], [high - share]], color=INK, capsize=3)
        inside = share > 50.0
        axes.text(
            share - 2.0 if inside else high + 2.0,
            place,
            f"{share:.1f} %",
            color="white" if inside else INK,
            ha="right" if inside else "left",
            va="center",
            weight="bold",
        )
        axes.text(0.0, place + 0.32, words, color=INK)
    axes.set_title("Share of 1000 dispersed flights that hold")
    axes.set_xlabel("flights that meet the requirements [%], with 95 % interval")
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(-0.4, 2.7)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.grid(False)


def figure(runs: dict[str, Run], found: dict[str, tuple[float, float, float]]) -> Figure:
    """The two panels."""
    with rc_context(RC):
        drawn = Figure(figsize=(9.4, 3.1), layout="constrained")
        left, right = drawn.subplots(1, 2)
        _errors(left, runs)
        _shares(right, found)
    return drawn


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        figure(flown(), shares(Path(scratch))).savefig(FILE, dpi=110)
