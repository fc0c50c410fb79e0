"""Write docs/gallery.md and its pictures by flying what it shows: python docs/figures/gallery.py.

It takes some minutes. A name draws its picture alone: python docs/figures/gallery.py circuit.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import flighttune as ft
from flighttune.base.units import DEG_PER_RAD
from flighttune.campaigns.dataset import open_dataset
from flighttune.campaigns.statistics.intervals import rate_interval
from flighttune.outputs.drawing.chart import DASHED, Chart, Sheet
from flighttune.outputs.drawing.palette import HUES, INK, line_styles

DOCS = Path(__file__).parents[1]
PICTURES = DOCS / "gallery"
SCENARIOS = (
    "paper",
    "paper_identified",
    "exact_law",
    "level_turn",
    "mission",
    "gust_in_turn",
    "turbulent_climb",
    "climb_beyond_power",
    "heavy_and_aft",
    "circuit",
    "survey",
)
CAMPAIGNS = {"first_campaign": 40, "aerosonde_dispersed": 400}
"""Flights that are counted for the picture of each."""
POINTS = 160
HEIGHT = 230.0
HEAD = """# Gallery

What can be flown? Each picture is what the command above it flies, and each sentence is the claim
that its scenario or campaign states; `flighttune list` names all.
`python docs/figures/gallery.py` makes the page and its pictures.
"""


def names(run: ft.Run) -> tuple[str, str]:
    """Plant and gains in the label of a run."""
    plant, _, gains = run.label.partition(" / ")
    return plant, gains


def over_time(flown: ft.FlownScenario) -> list[Chart]:
    """Course and path angle of all runs with their references, over time."""
    styles = line_styles(names(run) for run in flown.runs)
    charts = []
    for signal, title in (("chi", "course [deg]"), ("gamma", "path angle [deg]")):
        chart = Chart(title=title, y="", height=HEIGHT)
        first = max(flown.runs, key=lambda run: len(run.t))
        asked = first.signals[f"{signal}_ref"].to_numpy() * DEG_PER_RAD
        chart.line(first.t, asked, INK, dash=DASHED, width=1.0, most=POINTS, name="reference")
        for run in flown.runs:
            degrees = run.signals[signal].to_numpy() * DEG_PER_RAD
            style = styles[names(run)]
            chart.line(run.t, degrees, style.colour, width=1.8, most=POINTS, name=run.label)
        charts.append(chart)
    return charts


def on_a_route(flown: ft.FlownScenario) -> list[Chart]:
    """The flight of the last plant from above, and its distances from the route."""
    run = flown.runs[-1]
    colour = HUES[0][0][0]
    above = Chart(title="from above", x="east [m]", y="north [m]", equal=True, height=HEIGHT)
    above.line(run.signals["east"], run.signals["north"], colour, most=4 * POINTS, name=run.label)
    beside = Chart(title="distance from the route [m]", height=HEIGHT)
    beside.line(run.t, run.signals["cross_track"], colour, most=POINTS, name="to the side")
    beside.line(run.t, run.signals["height_err"], HUES[1][0][0], most=POINTS, name="in height")
    return [above, beside]


def shares(name: str, runs: int) -> list[Chart]:
    """Share of the flights of each gain set and plant that succeed, with its 95 % interval."""
    with tempfile.TemporaryDirectory() as folder:
        ft.run_campaign(name, Path(folder) / "out", runs=runs)
        rows = open_dataset(Path(folder) / "out").rows().to_pandas()
    groups = list(rows.groupby(["gains", "plant"], sort=False))
    chart = Chart(
        title=f"flights that succeed [%] of {len(groups[0][1])} of each, with 95 % interval",
        x="",
        y_range=(0.0, 112.0),
        x_ticks=[
            (place, f"{gains}\n{plant.removeprefix('jsbsim:')}")
            for place, ((gains, plant), _) in enumerate(groups)
        ],
        height=HEIGHT,
    )
    percent = [100.0 * float(group["success"].mean()) for _, group in groups]
    gains = list(rows["gains"].unique())
    hues = [HUES[gains.index(name)][0][0] for (name, _), _ in groups]
    chart.bars([0.0] * len(groups), percent, hues)
    for place, (_, group) in enumerate(groups):
        low, high = rate_interval(np.array([group["success"].sum()]), np.array([len(group)]))
        chart.line([place, place], [100.0 * low[0], 100.0 * high[0]], INK, width=2.0)
    return [chart]


def draw(name: str) -> None:
    """Fly a scenario or campaign and write its picture."""
    if name in CAMPAIGNS:
        charts = shares(name, CAMPAIGNS[name])
    else:
        scenario = ft.load_scenario(name)
        flown = ft.fly(scenario)
        charts = (on_a_route if scenario.route else over_time)(flown)
    Sheet(charts=charts).save(PICTURES / f"{name}.svg")


def page() -> str:
    """The page as Markdown."""
    lines = [HEAD]
    known: list[tuple[str, ft.Scenario | ft.Campaign, str]]
    known = [*((name, ft.load_scenario(name), f"flighttune fly {name}") for name in SCENARIOS)]
    for name, runs in CAMPAIGNS.items():
        command = f"flighttune campaign {name}"
        command += "" if ft.load_campaign(name).runs == runs else f" --runs {runs}"
        known.append((name, ft.load_campaign(name), command))
    for name, source, command in known:
        claim = source.verifies[0].upper() + source.verifies[1:]
        lines += [f"## `{command}`\n", f"{claim}.\n"]
        lines += [f"![Flights of {name}](gallery/{name}.svg)\n"]
    return "\n".join(lines)


if __name__ == "__main__":
    PICTURES.mkdir(exist_ok=True)
    for picture in sys.argv[1:] or (*SCENARIOS, *CAMPAIGNS):
        draw(picture)
    (DOCS / "gallery.md").write_text(page(), encoding="utf-8")
