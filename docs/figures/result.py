"""Draw docs/result.svg and print the numbers below it in README: python docs/figures/result.py.

It searches gains with 900 flights and counts them on 200 fresh ones, some minutes.
"""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

import flighttune as ft
from flighttune.campaign.dataset import open_dataset
from flighttune.campaign.statistics.intervals import rate_interval
from flighttune.present.chart import DASHED, Chart, Sheet
from flighttune.present.palette import HUES, INK
from flighttune.units import DEG_PER_RAD

FILE = Path(__file__).parents[1] / "result.svg"
TURN, CROWD = (Path(__file__).parent / "result" / name for name in ("turn.toml", "crowd.toml"))
BLUE, _, GREEN = (strong[0] for strong, _ in HUES[:3])
BEFORE = "tuned_identified"
BOUND_DEG = 33.0
"""The reference of 30 deg and the overshoot that turn.toml allows."""


def search(gains: Path) -> None:
    """Write the gains that `meet` finds for the crowd, as the command does."""
    words = [str(TURN), "--campaign", str(CROWD), "--budget", "900", "--out", str(gains), "-q"]
    subprocess.run(["flighttune", "meet", *words], check=True)


def responses(gains: Path) -> Chart:
    """Course over time of both gain sets, on the nominal aircraft in turbulence."""
    chart = Chart(
        title="The same turn by 30° in light turbulence", y="course [deg]", x_range=(0.0, 15.0)
    )
    chart.line([0.0, 15.0], [BOUND_DEG] * 2, INK, dash=DASHED, width=1.0, name="allowed: 33°")
    for run, colour in zip(
        ft.fly(str(TURN), gains=[BEFORE, str(gains)]).runs, (BLUE, GREEN), strict=True
    ):
        words = "tuned on the model" if colour == BLUE else "found by flying"
        chart.line(
            run.t, run.signals["chi"].to_numpy() * DEG_PER_RAD, colour, width=2.0, name=words
        )
    return chart


def shares(gains: Path, folder: Path) -> Chart:
    """Share of 200 dispersed flights that meet all requirements, with its 95 % interval."""
    text = CROWD.read_text(encoding="utf-8")
    text = text.replace('"turn.toml"', f'"{TURN}"').replace("runs     = 200", "runs     = 400")
    text = text.replace(f'["{BEFORE}"]', f'["{BEFORE}", "{gains}"]')
    file = folder / "both.toml"
    file.write_text(text, encoding="utf-8")
    ft.run_campaign(str(file), folder / "out")
    rows = open_dataset(folder / "out").rows().to_pandas()
    chart = Chart(
        title="Share of 200 aircraft that differ on which all requirements are met",
        x="",
        y="flights [%], with 95 % interval",
        y_range=(0.0, 112.0),
        x_ticks=[(0, "tuned on\nthe model"), (1, "found by\nflying")],
    )
    groups = [rows[rows["gains"] == BEFORE], rows[rows["gains"] != BEFORE]]
    percent = [100.0 * float(group["success"].mean()) for group in groups]
    chart.bars([0.0, 0.0], percent, [BLUE, GREEN])
    for place, group in enumerate(groups):
        low, high = rate_interval(np.array([group["success"].sum()]), np.array([len(group)]))
        chart.line([place, place], [100.0 * low[0], 100.0 * high[0]], INK, width=2.0)
        loop = group.iloc[0]
        print(
            f"{loop['gains']}: {percent[place]:.1f} "
            f"[{100.0 * low[0]:.1f}, {100.0 * high[0]:.1f}] % "
            f"of {len(group)}, R_K {loop['R_K']:.2g} 1/s, E_K {loop['E_K']:.3g} s^2"
        )
        chart.text(
            place, 100.0 * high[0], f"{percent[place]:.0f} %", anchor="middle", shift=(0.0, -5.0)
        )
    return chart


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        found = Path(scratch) / "found.json"
        search(found)
        Sheet(charts=[responses(found), shares(found, Path(scratch))]).save(FILE)
