"""What sliders stand for: the flights of the scenario with the same values set by its keys."""

import json
import re
import time
import tomllib
from html import unescape

import numpy as np
import pytest
from drawn import drawn
from made_up import made_up_scenario
from places import ROOT

import flighttune as ft
from tests.outputs.live.test_server import ask

pytestmark = pytest.mark.slow

SCENARIOS = "level_turn", "exact_law"
DEG = 180.0 / np.pi


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Opens the page of a scenario, once each; all end together."""
    opened = {}

    def page(name):
        if name not in opened:
            opened[name] = ft.open(name, out=tmp_path_factory.mktemp("page"), browser=False)
        return opened[name]

    yield page
    for one in opened.values():
        one.close()


def sliders_of(page):
    """Attributes of the sliders of a page by their key, in their order, and choices."""
    _, _, text = ask(page)
    found = {}
    for tag in re.findall(r"<(?:input|select)\b[^>]*>", text.decode()):
        about = {k: unescape(v) for k, v in re.findall(r'([\w-]+)="([^"]*)"', tag)}
        if about.get("type") == "range":
            found[about["name"]] = {k: float(about[k]) for k in ("min", "max", "value")}
    return found


def pictured(page, values):
    """Charts of the answer to a move, and its words."""
    status, _, text = ask(page, "picture", {"values": values, "ghosts": {}})
    assert status == 200, text
    answer = json.loads(text)
    pieces = answer["pieces"]
    return drawn(pieces if isinstance(pieces, str) else "".join(map(str, pieces.values()))), answer


def courses(page, values):
    """Lines of course of a move, by run."""
    charts, _ = pictured(page, values)
    chart = next(x for x in charts if x.title.startswith("Course"))
    return {
        one.get("data-run"): chart.curve(one) for one in chart.paths if one.get("data-run")
    }, chart


def check_flies_as(page, values, scenario, gains):
    lines, chart = courses(page, values)
    (run,) = (x for x in ft.fly(scenario, gains).runs if x.label == next(iter(lines)))
    name = "chi" if "error" not in chart.title else "chi_err"
    x, y = lines[run.label]
    wanted = np.interp(x, run.t, DEG * np.unwrap(run.signals[name].to_numpy()))
    assert y == pytest.approx(wanted, abs=0.02 * max(1.0, np.ptp(wanted)))


@pytest.mark.soak
@pytest.mark.parametrize("name", SCENARIOS)
def test_a_page_begins_with_the_flights_of_its_scenario(pages, name):
    page = pages(name)
    every = sliders_of(page)
    scenario = ft.load_scenario(name)

    check_flies_as(page, {}, scenario, scenario.gain_names[0])
    check_flies_as(
        page, {k: x["value"] for k, x in every.items()}, scenario, scenario.gain_names[0]
    )
    for key, one in every.items():
        assert one["min"] <= one["value"] <= one["max"], key
        if match := re.fullmatch(r"gains\[0\]\.K_[PI]\[(\d)\]\[(\d)\]", key):
            # a gain of a channel goes from zero, one across channels to both sides
            if match[1] == match[2]:
                assert (one["min"], one["max"]) == pytest.approx(
                    (0.0, 3.0 * one["value"]), rel=0.01
                )
            else:
                assert one["min"] == pytest.approx(-one["max"])
        if "feedback" in key:
            assert (one["min"], one["max"]) == (0.0, 0.95)
    gains = [key.startswith("gains") for key in every]
    assert gains == sorted(gains, reverse=True)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("key", "value", "changes"),
    [
        ("flight.V_a_mps", 27.0, {"flight.V_a_mps": 27.0}),
        ("limits.phi_deg[1]", 20.0, {"limits.phi_deg": [-20.0, 20.0]}),
        ("wind.speed_mps", 4.0, {"wind.speed_mps": 4.0, "wind.from_deg": 270.0}),
        ("turbulence.intensity", "light", {"turbulence.intensity": "light"}),
        ("plant.airframe.mass_factor", 1.1, {"plant.airframe.mass_factor": 1.1}),
    ],
)
def test_a_slider_flies_as_the_key_of_the_scenario(pages, key, value, changes):
    wanted = ft.load_scenario("level_turn", changes=changes)

    check_flies_as(pages("level_turn"), {key: value}, wanted, wanted.gain_names[0])


@pytest.mark.soak
def test_a_gain_that_is_moved_flies_as_the_same_gain_of_a_file(pages, tmp_path):
    K_P = ft.PAPER_GAINS.K_P.copy()
    K_P[0, 0] = 1.1
    own = ft.PIGains(K_P=K_P, K_I=ft.PAPER_GAINS.K_I)
    page = pages("level_turn")
    lines, chart = courses(page, {"gains[0].K_P[0][0]": 1.1})
    own.save(tmp_path / "mine.json")
    runs = ft.fly("level_turn", str(tmp_path / "mine.json")).runs
    (label, (x, y)) = next(iter(lines.items()))
    (run,) = (x for x in runs if x.provenance.plant == label.split(" / ")[0])

    wanted = np.interp(x, run.t, DEG * np.unwrap(run.signals["chi"].to_numpy()))
    assert y == pytest.approx(wanted, abs=0.02 * max(1.0, np.ptp(wanted))), chart.title


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"flight.V_a_mps": "25"}, "`V_a_mps` must be a valid number"),
        ({"flight.V_a_mps": 1e9}, "less than or equal to 1000"),
        ({"limits.phi_deg[1]": "30"}, "`phi_deg` must be"),
        ({"turbulence.intensity": "mighty"}, "'light', 'moderate' or 'severe'"),
        ({"plant[0].module": "law.py"}, "must be a slider of the page"),
    ],
)
def test_a_value_that_no_slider_has_is_refused(small, values, words):
    status, _, text = ask(small[2], "picture", {"values": values, "ghosts": {}})

    assert (
        words in unescape(json.loads(text).get("failed", text.decode())) or words in text.decode()
    )
    assert status in (200, 400, 422)


OWN = {
    "name": "mine", "law": "exact", "feedback": [0.5, 0.25],
    "K_P": [[2.0, 0.0], [0.5, -3.0]], "K_I": [[0.0, 0.0], [0.0, 0.0]],
}  # fmt: skip
# Ends of the sliders of these gains: three times the gain, or the largest of its matrix, or 1.
ENDS = {
    "gains[0].K_P[0][0]": (0.0, 6.0, 2.0), "gains[0].K_P[1][1]": (-9.0, 9.0, -3.0),
    "gains[0].K_I[0][0]": (0.0, 3.0, 0.0), "gains[0].K_I[1][1]": (0.0, 3.0, 0.0),
    "gains[0].feedback[0]": (0.0, 0.95, 0.5), "gains[0].feedback[1]": (0.0, 0.95, 0.25),
    "gains[0].K_P[0][1]": (-9.0, 9.0, 0.0), "gains[0].K_P[1][0]": (-1.5, 1.5, 0.5),
    "gains[0].K_I[0][1]": (-3.0, 3.0, 0.0), "gains[0].K_I[1][0]": (-3.0, 3.0, 0.0),
}  # fmt: skip
ROWS = tomllib.loads((ROOT / "flighttune/outputs/live/sliders.toml").read_text("utf-8"))["slider"]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """The page of half a second of the law, which saves into a folder, and that of an aircraft."""
    folder = tmp_path_factory.mktemp("small")
    tables = {
        "flight": {"duration_s": 0.5, "V_a_mps": 30.0}, "reference": {"chi_deg": 5.0},
        "limits": {"phi_deg": [-20.0, 40.0], "phi_rate_dps": 1.0, "n_z": [0.0, 2.0]},
    }  # fmt: skip
    expect = [{"at_most": {"chi": {"MO_deg": 90.0, "ITAE": 1e-9}}}]
    expect += [{"at_most": {"chi": {"settling_s": 0.1}}}]
    law = made_up_scenario(**tables, expect=expect)
    exact = made_up_scenario(**tables, gains=[OWN], law=["exact"])
    plant = [{"kind": "jsbsim", "aircraft": "aerosonde"}]
    craft = made_up_scenario(**tables, plant=plant)
    opened = [
        ft.open(x, out=folder / str(i), browser=False) for i, x in enumerate((law, exact, craft))
    ]
    yield *opened, folder
    for page in opened:
        page.close()


def test_sliders_of_gains_go_to_three_times_the_gain_and_those_across_come_last(small):
    every = sliders_of(small[1])

    gains = {k: (x["min"], x["max"], x["value"]) for k, x in every.items() if k.startswith("gains")}
    assert gains == {k: pytest.approx(x) for k, x in ENDS.items()}
    assert [*every][: len(ENDS)] == [*ENDS]


def test_sliders_of_a_scenario_have_the_ends_of_their_table(small):
    """Those that an aircraft alone has are absent without one."""
    given = {"reference.chi_deg": 5.0, "reference.gamma_deg": 0.0, "flight.V_a_mps": 30.0}
    given |= {"limits.phi_deg[1]": 40.0, "limits.phi_rate_dps": 1.0, "limits.n_z[1]": 2.0}
    for page, of_craft in ((small[0], False), (small[2], True)):
        every = sliders_of(page)
        wanted = {}
        for row in ROWS:
            key = row["key"]
            value = given.get(key, row.get("absent"))
            craft = key.split(".")[0] in ("navigation", "plant", "seed", "turbulence", "wind")
            if value is None or "choices" in row or (craft and not of_craft):
                continue
            scale = value if row.get("relative") else 1.0
            ends = min(scale * row["low"], value), max(scale * row["high"], value)
            wanted[key] = {"min": ends[0], "max": ends[1], "value": value}
        shown = {k: x for k, x in every.items() if not k.startswith("gains") and k != "seed"}
        assert shown == {k: pytest.approx(x) for k, x in wanted.items()}
        _, _, text = ask(page)
        assert (
            b'name="turbulence.intensity"' in text or b"turbulence.intensity" in text
        ) == of_craft


def saved(page, **values):
    """The scenario that a page saves with values of its sliders by their keys."""
    told = json.loads(ask(page, "save", {"values": values})[2])
    return ft.load_scenario(told["command"].split()[-1])


def test_what_a_page_saves_has_the_values_of_its_sliders(small):
    """The other end of a range keeps its ratio, and a first choice leaves a table out."""
    law, _, craft, folder = small
    moved = saved(law, **{"limits.phi_deg[1]": 30.0, "flight.V_a_mps": 28.0})
    assert list(moved.limits.phi_deg) == [-15.0, 30.0]
    assert moved.flight.V_a_mps == 28.0
    before = saved(law)
    assert list(before.limits.phi_deg) == [-20.0, 40.0]
    stormy = saved(craft, **{"turbulence.intensity": "light", "wind.speed_mps": 4.0}).as_dict()
    assert stormy["turbulence"]["intensity"] == "light"
    assert (stormy["wind"]["speed_mps"], stormy["wind"]["from_deg"]) == (4.0, 270.0)
    heavy = saved(craft, **{"plant.airframe.mass_factor": 1.1, "turbulence.intensity": "none"})
    assert heavy.as_dict()["plant"][0]["airframe"]["mass_factor"] == 1.1
    assert "turbulence" not in heavy.as_dict()
    # each save has a folder of its own, numbered on
    assert sorted(int(x.name) for x in (folder / "0").iterdir()) == [1, 2]
    assert sorted(int(x.name) for x in (folder / "2").iterdir()) == [1, 2]


def test_a_picture_has_its_requirements_its_tables_and_its_ghosts(small):
    law = small[0]
    moved = {
        "values": {"flight.V_a_mps": 31.0},
        "ghosts": {"start": {}, "a": {"flight.V_a_mps": 32.0}},
    }
    text = unescape(json.loads(ask(law, "picture", moved)[2])["pieces"])

    now = ft.fly(made_up_scenario(
        flight={"duration_s": 0.5, "V_a_mps": 31.0}, reference={"chi_deg": 5.0},
        limits={"phi_deg": [-20.0, 40.0], "phi_rate_dps": 1.0, "n_z": [0.0, 2.0]},
    )).runs[0]  # fmt: skip
    measures = ft.loop.channel_metrics(now).loc["chi"]
    rows = re.findall(r'<li class="(yes|no)">(.*?)</li>', text, re.DOTALL)
    assert [look for look, _ in rows] == ["yes", "no", "no"]
    assert float(re.search(r"at most 90 deg: (\S+)", rows[0][1])[1]) == pytest.approx(
        np.degrees(measures["MO_rad"]), rel=1e-3
    )
    assert float(re.search(r"at most 1e-09[^:]*: (\S+)", rows[1][1])[1]) == pytest.approx(
        measures["ITAE"], rel=1e-3
    )
    assert "does not settle" in rows[2][1]
    assert text.count('<p class="no">') == 2
    tables = re.findall(r"<table\b.*?</table>", text, re.DOTALL)
    cells = [re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", x, re.DOTALL) for x in tables]
    plain = [[" ".join(re.sub("<[^>]*>", "", x).split()) for x in row] for row in cells]
    loops, flights = plain[:2]
    assert loops[0].startswith("which")
    assert [x for x in loops if x in ("now", "start", "a")] == ["now", "start", "a"]
    assert [x for x in flights if x in ("now", "start", "a")] == ["now", "start", "a"]
    assert flights.count("which") == loops.count("which") == 1
    assert not [x for x in flights if x.startswith(("status", "end"))]
    R_K = ft.loop.indicators(
        ft.loop.closed_loop(
            ft.loop.kinematic_model(V_a=31.0, gamma=0.0, g=9.81), now.provenance.gains
        )
    ).R_K
    place = loops.index("now")
    assert float(loops[place + 1]) == pytest.approx(R_K, rel=2e-2)
    legend = re.findall(r'data-forget="([^"]*)"', text)
    assert legend == ["start", "a"]
    widths = re.findall(r'data-run="kinematic / (start|a|paper)"[^>]*', text)
    assert {*widths} == {"start", "a", "paper"}
    charts = drawn(json.loads(ask(law, "picture", moved)[2])["pieces"])
    course = next(x for x in charts if x.title.startswith("Course"))
    looks = {x.get("data-run"): x.get("stroke-width") for x in course.paths if x.get("data-run")}
    assert looks == {
        "kinematic / paper": "1.87", "kinematic / start": "1.275", "kinematic / a": "1.275",
    }  # fmt: skip
    roll = next(x for x in charts if x.title.startswith("Roll command"))
    assert {x.get("data-run") for x in roll.paths} - {None} == {"kinematic / paper"}


def pieces_of(page, **values):
    return json.loads(ask(page, "picture", {"values": values})[2])["pieces"]


def drawn_beside(page, width, **values):
    """Lines of course of a width that is not that of flights."""
    (course, *_) = drawn(pieces_of(page, **values))
    return [x for x in course.paths if x.get("stroke-width") == width]


def test_aircraft_that_differ_are_drawn_until_a_slider_moves(small):
    craft, cloud = small[2], "0.425"
    assert drawn_beside(craft, cloud) == []
    assert ask(craft, "begin", {"values": {}, "doing": "aircraft", "window": "w"})[0] == 200
    end = time.monotonic() + 300.0
    while not drawn_beside(craft, cloud):
        assert time.monotonic() < end
        time.sleep(0.05)
    assert len(drawn_beside(craft, cloud)) == 20
    assert "20 aircraft that differ" in pieces_of(craft)
    assert drawn_beside(craft, cloud, **{"flight.V_a_mps": 31.0}) == []


def test_a_recording_and_a_log_are_drawn_beside_what_flies(small, tmp_path):
    flown = ft.fly(made_up_scenario(flight={"duration_s": 0.5}, reference={"chi_deg": 5.0}))
    ft.record(flown, tmp_path / "run")
    with ft.open(tmp_path / "run", browser=False) as page:
        (course, *_) = drawn(pieces_of(page))
    lines = {x.get("data-run"): x for x in course.paths if x.get("data-run")}
    assert {*lines} == {"kinematic / paper", "kinematic / recorded"}
    assert len({x.get("d") for x in lines.values()}) == 1
    assert lines["kinematic / recorded"].get("stroke-width") == f"{0.85 * 1.6:g}"
    run = ft.fly(made_up_scenario(flight={"duration_s": 4.0}, reference={"chi_deg": 5.0})).runs[0]
    names = {
        "chi": "chi_rad",
        "gamma": "gamma_rad",
        "phi": "phi_rad",
        "V_a": "V_a_mps",
        "n_z": "n_z",
    }
    names |= {x: f"{x}_m" for x in ("north", "east", "down")}
    log = run.signals[[*names]].rename(columns=names).rename_axis("t_s").assign(V_g_mps=25.0)
    log.reset_index().to_csv(tmp_path / "flight.csv", index=False)
    with ft.open(tmp_path / "flight.csv", aircraft="aerosonde", browser=False) as page:
        text = pieces_of(page)
    charts = drawn(text)
    path = next(x for x in charts if x.title.startswith("From above"))
    logged = path.lines("log / flight")[0]
    across, up = (name.split()[0] for name in (path.x, path.y))
    assert np.nanmax(logged[0]) == pytest.approx(run.signals[across].max(), abs=0.5)
    assert np.nanmax(logged[1]) == pytest.approx(run.signals[up].max(), abs=0.5)
    assert "jsbsim:aerosonde" in text
