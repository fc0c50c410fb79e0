"""Draw docs/first_mission.svg: python docs/figures/first_mission.py BEFORE AFTER.

BEFORE and AFTER are the bands of both plans of docs/first_mission.md; that of the first is counted
in a wider fence (`flighttune mission mission.plan --fence wider.plan`), then in its own, which is
drawn.
"""

import sys
from dataclasses import replace
from pathlib import Path

from flighttune.claims.band import Band
from flighttune.claims.counted_file import load_counted
from flighttune.outputs.drawing.chart import Chart, Sheet
from flighttune.outputs.pages.counted import mission_charts

FILE = Path(__file__).parents[1] / "first_mission.svg"
TITLES = "No: the plan as drawn leaves its fence", "Yes: with the circle moved 151 m west"


def fenced_map(file: str, title: str) -> Chart:
    """The map of the page of a band, under a title of its own."""
    band = load_counted(file)
    assert isinstance(band, Band)
    band = replace(band, about=replace(band.about, fences=band.about.fences[-1:]))
    chart = mission_charts(band)[0]
    chart.title = title
    return chart


if __name__ == "__main__":
    Sheet(charts=[*map(fenced_map, sys.argv[1:], TITLES)]).save(FILE)
