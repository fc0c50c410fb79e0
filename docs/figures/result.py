"""Draw docs/result.svg and print the numbers below it in README: python docs/figures/result.py.

It flies the same 200 aircraft under two laws, some minutes.
"""

import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import flighttune as ft
from flighttune.base.units import DEG_PER_RAD
from flighttune.campaigns.dataset import open_dataset
from flighttune.campaigns.statistics.intervals import rate_interval
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK

FILE = Path(__file__).parents[1] / "result.svg"
TURN, CROWD = (Path(__file__).parent / "result" / name for name in ("turn.toml", "crowd.toml"))
COLOURS = HUES[0][0][0], HUES[2][0][0]
LAWS = {"paper": "tuned_identified", "exact": "tuned_fed_back"}
"""Gains of the paper's law tuned on the identified model, and those that are flown by default."""
NAMES = ("the paper's law,\ntuned on the model", "the law flown\nby default")
BOUND_DEG = 33.0
"""The reference of 30 deg and the overshoot that turn.toml allows."""


def written(folder: Path, law: str) -> tuple[Path, Path]:
    """The turn under a law, and its campaign, as files."""
    files = folder / f"{law}.toml", folder / f"{law}_crowd.toml"
    turn = TURN.read_text(encoding="utf-8").replace('law      = "exact"', f'law      = "{law}"')
    crowd = CROWD.read_text(encoding="utf-8").replace('"turn.toml"', f'"{law}.toml"')
    for file, text in zip(files, (turn, crowd), strict=True):
        file.write_text(text.replace(LAWS["exact"], LAWS[law]), encoding="utf-8")
    return files


def responses(turns: Iterable[Path]) -> Chart:
    """Course over time under both laws, on the nominal aircraft in turbulence."""
    chart = Chart(
        title="The same turn by 30° in light turbulence", y="course [deg]", x_range=(0.0, 15.0)
    )
    chart.line([0.0, 15.0], [BOUND_DEG] * 2, INK, dash=DASHED, width=1.0, name="allowed: 33°")
    for turn, colour, name in zip(turns, COLOURS, NAMES, strict=True):
        (run,) = ft.fly(str(turn)).runs
        course = run.signals["chi"].to_numpy() * DEG_PER_RAD
        chart.line(run.t, course, colour, width=2.0, name=name.replace("\n", " "))
    return chart


def shares(crowds: Iterable[Path]) -> Chart:
    """Share of 200 dispersed flights that meet all requirements, with its 95 % interval."""
    chart = Chart(
        title="Share of 200 aircraft that differ on which all requirements are met",
        x="",
        y="flights [%], with 95 % interval",
        y_range=(0.0, 112.0),
        x_ticks=list(enumerate(NAMES)),
    )
    for place, (crowd, colour) in enumerate(zip(crowds, COLOURS, strict=True)):
        out = crowd.with_suffix("")
        ft.run_campaign(str(crowd), out)
        rows = open_dataset(out).rows().to_pandas()
        met, loop = rows["success"].sum(), rows.iloc[0]
        (low,), (high,) = (
            100.0 * end for end in rate_interval(np.array([met]), np.array([len(rows)]))
        )
        percent = 100.0 * met / len(rows)
        chart.bars([0.0], [percent], [colour], x=[place])
        chart.line([place, place], [low, high], INK, width=2.0)
        chart.text(place, high, f"{percent:.0f} %", anchor="middle", shift=(0.0, -5.0))
        print(
            f"{loop['gains']}: {percent:.1f} [{low:.1f}, {high:.1f}] % of {len(rows)}, "
            f"R_K {loop['R_K']:.2g} 1/s, E_K {loop['E_K']:.3g} s^2"
        )
    return chart


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        turns, crowds = zip(*(written(Path(scratch), law) for law in LAWS), strict=True)
        Sheet(charts=[responses(turns), shares(crowds)]).save(FILE)
