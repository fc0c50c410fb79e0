"""Laws and their parameters: what a table names, a law reads, a page tells and an export writes."""

import itertools
import math
import re
import tomllib
from pathlib import Path

import pytest

import flighttune as ft

ROOT = Path(__file__).parents[2]
GUIDANCE = tomllib.loads((ROOT / "flighttune/control/laws/autopilot.toml").read_text("utf-8"))
PAGES = {page.name: page.read_text("utf-8") for page in (ROOT / "docs").rglob("*.md")}


PRINTED = ft.load_scenario("paper_as_printed").as_dict() | {"gains": ["paper"], "expect": []}


def law(period, **parameters):
    own = {"name": "now", "kind": "autopilot", "parameters": {period: 17.0} | parameters}
    (made,) = ft.scenario_from(PRINTED | {"law": [own]}).laws
    return made.make(ft.loop.LawSetup(dt=0.02, limits=ft.loop.Limits.none(2), g=9.81))


def flown(made, climb):
    """Commands beside a track in gusts: every part of the guidance and of TECS has to do."""
    made.start(ft.loop.FlightCondition(V_a=14.0 if climb > 0.0 else 20.0))
    x, h, V = 0.0, 100.0, 20.0
    for k in range(400):
        V_dot = 1.5 * math.sin(0.1 * k)
        V, x, h = V + 0.02 * V_dot, x + 0.02 * V, h + 0.02 * 0.5 * math.sin(0.05 * k)
        right = 15.0 * math.sin(0.02 * k) if k < 100 else (200.0 if k < 200 else 2.0)
        height = (0.5, -0.5, climb)[min(k // 100, 2)]
        motion = {"V_g": V + 10.0, "velocity": (V + 10.0, 0.0, -0.5 * math.sin(0.05 * k))}
        motion |= {"acceleration": V_dot, "theta": 0.03}
        place, wind = (x, 0.0, 0.0), (10.0, 0.0, 0.0)
        here = ft.loop.Measured(0.02, 0.0, V, 0.1, 1.0, h, place, wind, **motion)
        path = (0.0, right, height, 0.006 * (k >= 200), 0.0)
        yield made.step(here, ft.loop.ReferenceSample(0.0, 0.0, path=path), 0.0)


def every(period):
    return [row[0] for row in GUIDANCE[period]["parameters"]]


ROWS = [(period, name) for period in GUIDANCE for name in every(period)]


@pytest.mark.parametrize(("period", "name"), ROWS)
def test_every_parameter_that_is_read_changes_what_is_commanded(period, name):
    row = next(row for row in GUIDANCE[period]["parameters"] if row[0] == name)
    ends = [x for x in row[4:6] if 0.0 < abs(x) < 1e3]
    values = [0.1 * row[1], *(0.2 * x for x in ends), 0.5 * row[1], 2.0 * row[1] + 0.3, *ends]
    values = [0.0] if name.endswith(("LB_PERIOD", "UB_PERIOD")) else values

    def differs(seconds, value, climb):
        both = (law(period, **{period: seconds} | x) for x in ({name: value}, {}))
        return any(a != b for a, b in zip(*(flown(x, climb) for x in both), strict=True))

    assert any(itertools.starmap(differs, itertools.product((17.0, 1, 300), values, (60.0, -60.0))))


@pytest.mark.parametrize("period", GUIDANCE)
def test_every_guidance_is_told_on_a_page_and_searches_parameters_that_it_has(period):
    assert any(GUIDANCE[period]["law"] in page for page in PAGES.values())
    assert {*GUIDANCE[period]["searched"]} <= {*every(period)}
    for row in GUIDANCE[period]["parameters"]:
        assert row[4] <= row[1] <= row[5]
        assert row[0].startswith(tuple(GUIDANCE[period]["group"]))


def kinds():
    with pytest.raises(ft.FlightTuneError) as refused:
        ft.load_scenario("paper", changes={"law": [{"name": "x", "kind": "none"}]})
    return re.findall(r"\b(paper|exact|autopilot|python)\b", str(refused.value))


@pytest.mark.parametrize("kind", sorted({*kinds()}))
def test_every_kind_of_law_is_told_on_a_page_and_is_exported_to_c_or_refused(kind, tmp_path):
    assert any(re.search(rf"\b{kind}\b", page) for page in PAGES.values())
    options = {"autopilot": {"parameters": {"NAVL1_PERIOD": 17.0}}}.get(kind, {})
    if kind == "python":
        return
    entry = {"name": kind, "kind": kind} | options
    changes = {"law": [entry], "expect": [], "gains": ["paper"]}
    scenario = ft.load_scenario("paper_as_printed", changes=changes)
    if kind == "autopilot":
        with pytest.raises(ft.FlightTuneError, match="paper"):
            ft.export(scenario, out=tmp_path / "c")
    else:
        assert ft.certify(scenario).status == "certified"
