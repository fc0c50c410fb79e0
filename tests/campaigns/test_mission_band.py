"""One command for a mission: its corridor, and the probability that it leaves its own fence."""

import re
from dataclasses import replace

import numpy as np
import pytest
from commands import answer, flighttune
from made_up_missions import AREA, made_up_flights, mission
from plans import item, plan_file, waypoint
from scipy.stats import binom

import flighttune as ft

# the fewest flights that can support a claim of the band and its fence: 0.7^9 <= 0.1 / 2
FEW = ("--epsilon", 0.3, "--confidence", 0.9, "--flights", 9)

# Gains of flights that are made up: others are tuned at each airspeed.
PAPER = {"gains": ["paper"], "law": ["paper"]}
AT_ONCE = (*FEW, "--set", 'gains=["paper"]', "--set", 'law=["paper"]')


@pytest.mark.slow
def test_a_mission_planned_across_its_fence_leaves_it_before_a_flight(tmp_path):
    """The fence ends 226 m to the east of the start; the leg to item 4 goes to 452 m."""
    near = [[47.39, 8.49], [47.39, 8.503], [47.42, 8.503], [47.42, 8.49]]
    file = mission(tmp_path / "m.plan", near)
    out, failure = flighttune("mission", file, *AT_ONCE, "--out", tmp_path / "m.npz", status=1)
    said = " ".join(out.split())

    assert said.startswith("No: the planned path leaves the fence on the leg to item 4")
    assert "is up to 225.5 m outside" in said
    assert "the route or the fence must be moved by 226 m" in said
    assert "the planned path leaves the fence" in failure
    assert not (tmp_path / "m.npz").exists()
    with pytest.raises(ft.FlightTuneError, match="leg to item 4"):
        ft.mission(file)


@pytest.mark.slow
def test_a_circle_across_a_zone_is_kept_inside_by_a_smaller_one(tmp_path):
    """Circles of 250 m about 47.41 N, 8.5 E, and a zone that begins 220 m to their east."""
    zone = [[47.405, 8.50292], [47.405, 8.51], [47.42, 8.51], [47.42, 8.50292]]
    fence = {"version": 2, "circles": [], "polygons": [{"inclusion": False, "polygon": zone}]}
    circle = item(18, 2, 0, 250, 1, 47.41, 8.5, 60)
    items = waypoint(47.39, 8.5, 60), circle, waypoint(47.41, 8.48, 60)
    file = plan_file(tmp_path / "m.plan", *items, geoFence=fence)
    said = answer("mission", file, "--plan", status=1)

    assert "on the loiter at item 2" in said["summary"][0]
    assert "is up to 29.6 m outside" in said["summary"][0]
    assert "`--set route.waypoint[1].radius_m=214`" in said["summary"][0]
    kept = answer("mission", file, "--plan", "--set", "route.waypoint[1].radius_m=214")
    assert kept["fence"]["nearest"][0]["margin_m"] == pytest.approx(220 - 214, abs=1.0)


@pytest.mark.slow
def test_what_is_not_flyable_or_not_fenced_is_refused_before_a_flight(tmp_path):
    file = mission(tmp_path / "m.plan")
    far = mission(tmp_path / "f.plan", [[lat + 1.0, lon] for lat, lon in AREA])
    delay = item(93, 30, -1, -1, -1, 0, 0, 0, frame=2)
    places = waypoint(47.4, 8.5, 60), delay, waypoint(47.3, 8.5, 60)
    delayed = plan_file(tmp_path / "d.plan", *places)
    for source, options, words in (
        (file, ("--set", "route.turnaround_m=0", "--set", "route.wind_mps=60"), "must be"),
        (file, ("--aircraft", "c172p"), "item 2 (DO_CHANGE_SPEED 178, to 26 m/s, but"),
        (file, ("--like", "nowhere"), "nowhere"),
        (far, (), "the start must be inside"),
        ("circuit_in_wind", ("--aircraft", "aerosonde"), "it is no mission"),
        ("circuit_in_wind", ("--like", "aerosonde"), "it is no mission"),
        (delayed, (), "`--set route.skip=true`"),
        # With it the mission is read, and refused for its fence alone.
        (delayed, ("--set", "route.skip=true", "--fence", far), "the start must be inside"),
    ):
        assert words in flighttune("mission", source, *AT_ONCE, *options, status=2)[1]
    assert "counted with `flighttune mission`" in flighttune("band", file, status=2)[1]


def test_a_no_comes_as_soon_as_more_flights_are_outside_than_may_be(monkeypatch):
    """One in four does not complete, and of 628 flights two may be outside."""
    counted = made_up_flights(monkeypatch, lost_every=4)
    short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 600.0)], **PAPER}
    odds = ft.mission("circuit_in_wind", changes=short, workers=1)
    said = odds.answer()

    assert len(counted) == 24
    assert odds.way == ""  # it is not known which flights ended, and why
    assert said.summary[0].startswith("No: of 24 flights 6 did not complete")
    assert "at most 2 of 628 may" in said.summary[0]
    assert "the count ended after 24 of 628 flights" in said.failure


@pytest.mark.parametrize(
    ("lost_every", "flights", "lost"),
    # P(Bin(628, 0.01) <= 2) is below 0.05; the first, the 301st and the 601st may be lost or not
    [
        pytest.param(None, 628, 0, marks=pytest.mark.counts),
        *((300, 628, None), (400, 628, 2), (50, 192, None)),
    ],
)
@pytest.mark.soak
def test_the_third_largest_of_all_flights_decides_the_corridor(
    tmp_path, monkeypatch, lost_every, flights, lost
):
    counted, out = made_up_flights(monkeypatch, lost_every), tmp_path / "m.npz"
    short = {"route.waypoint": [{"north_m": n, "east_m": 0.0} for n in (0.0, 600.0)], **PAPER}
    odds = ft.mission("circuit_in_wind", changes=short, workers=1, out=out)
    band, said = ft.load(out), odds.answer()

    assert len(counted) == len(band.scores) == flights
    assert said.summary[0].startswith("No: " if lost is None else "Yes: ")
    assert band.sentence == odds.band.sentence
    if lost is not None:
        assert (band.scale, band.outside) == (np.sort(band.scores)[-3], 2)
        assert (band.not_completed, band.confidence) == (lost, pytest.approx(0.95))
        assert "confidence of 0.95 for all that is said here: 2 of" in said.summary[1]
        longer = replace(band, about=replace(band.about, early=flights))
        longer.save(out)
        with pytest.raises(ft.InputError, match="`early` must be below"):
            ft.load(out)


@pytest.mark.slow
def test_a_count_of_0_4_0_goes_on_after_its_first_step(tmp_path, monkeypatch):
    """Of 78 flights one leaves a fence that is asked later: the other 48 of 126 are flown."""
    made_up_flights(monkeypatch, None)
    file, out = mission(tmp_path / "m.plan"), tmp_path / "m.npz"
    band = ft.mission(file, epsilon=0.05, flights=126, workers=1, changes=PAPER).band
    first = {name: getattr(band, name)[:78] for name in ("extremes", "wind", "navigation")}
    band = replace(band, about=replace(band.about, early=78), **first)
    early = band.inside(band.about.fences[0])
    assert (early.outside, early.supported) == (0, True)
    assert early.epsilon == pytest.approx(1.0 - 0.025 ** (1 / 78), rel=1e-6)
    assert early.sentence.startswith("a new flight leaves the fence with probability at most 0.046")
    extremes = band.extremes.copy()
    extremes[3, 0, 0] = [-5000.0, 5000.0]
    left = replace(band, extremes=extremes)
    left.save(out)
    whether = ft.mission(out).answer().summary[0]
    assert whether.startswith("Not known: 78 of 126 flights were flown; `flighttune band FILE")

    more = ft.band(out, flights=126, workers=1)
    fenced = more.inside(more.about.fences[0])
    assert (len(more.scores), fenced.outside, fenced.supported) == (126, 1, True)
    none_first = binom.pmf(0, 78, fenced.epsilon) * binom.sf(1, 48, fenced.epsilon)
    assert none_first + binom.cdf(1, 126, fenced.epsilon) == pytest.approx(0.025, rel=1e-6)
    assert more.answer().summary[0].startswith("Yes: ")
    assert more.confidence == pytest.approx(0.95)

    twice = ft.band(out, flights=252, workers=1)
    assert ft.load(out).readings == twice.readings == (126, 252)


@pytest.mark.counts
@pytest.mark.parametrize(
    ("lost_every", "flights", "said"),
    [
        # 0.95^-n / 2 and a share of it exceed 2 / 0.05 from 82 on; it is looked at every 12 flights
        (None, 84, "Yes: the mission can be flown and stays inside its fence."),
        (3, 24, "No: a new flight is not certainly inside the fence with probability above 0.05"),
        (20, 208, "Not known: "),
    ],
)
def test_a_fence_is_answered_as_soon_as_it_is_sure(
    tmp_path, monkeypatch, lost_every, flights, said
):
    made_up_flights(monkeypatch, lost_every)
    file, out = mission(tmp_path / "m.plan"), tmp_path / "m.npz"
    odds = ft.mission(file, epsilon=0.05, until_sure=True, out=out, workers=1)
    answer, band = odds.answer(), ft.load(out)

    assert (len(band.scores), band.confidence) == (flights, pytest.approx(0.95))
    assert answer.summary[0].startswith(said)
    assert answer.summary[2] == "No corridor is claimed."
    assert band.answer().values["fence"] == answer.values["fence"]
    sentence = answer.values["fence"]["sentence"]
    assert ("confidence 0.95 at any number of flights" in sentence) == (flights < 208)
    assert bool(answer.failure) == (lost_every is not None)
    if flights == 84:  # one flight fewer of the same was not sure, of 208 planned
        first = {x: getattr(band, x)[:72] for x in ("extremes", "wind", "navigation")}
        replace(band, **first).save(out)
        with pytest.raises(ft.InputError, match=r"`plan\.runs` .* 102, .*no answer"):
            ft.load(out)
        with pytest.raises(ft.InputError, match=r"`until_sure` .* a band"):
            ft.mission(band, until_sure=True)


@pytest.mark.slow
@pytest.mark.parametrize(("more", "got"), [({}, "no fence"), ({"turn_back": 30}, "`turn_back`")])
def test_what_is_not_about_a_fence_alone_is_not_counted_until_it_is_sure(tmp_path, more, got):
    source = mission(tmp_path / "m.plan") if more else "circuit_in_wind"
    with pytest.raises(ft.InputError, match=f"`until_sure` must be about a fence alone, got {got}"):
        ft.mission(source, until_sure=True, **more)


@pytest.mark.soak
def test_an_airspeed_at_which_lost_flights_complete_is_said_and_flies(tmp_path):
    """At 16.5 m/s the aircraft stalls in turbulence."""
    few = ["--epsilon", 0.3, "--confidence", 0.9, "--flights", 7]
    few += ["--set", "route.waypoint=[{north_m=0.0, east_m=0.0}, {north_m=300.0, east_m=0.0}]"]
    said, page = {}, tmp_path / "page.html"
    for V, status in ((16.5, 1), (18.2, 0)):
        files = ["--out", tmp_path / f"{V}.npz", *(["--page", page] if status else [])]
        at = ["--set", f"flight.V_a_mps={V}", *few, *files]
        said[V] = answer("mission", "circuit_in_wind", *at, status=status)

    place = re.search(r"It was on the leg to waypoint 2, (\d+) m along\.", said[16.5]["summary"][1])
    assert place is not None
    assert 0 < int(place[1]) < 300  # m: on the leg
    hint = "With `--set flight.V_a_mps=18.2` it completes."
    assert said[16.5]["summary"][1].endswith(hint)
    assert re.sub("`(.+)`", r"<code>\1</code>", hint) in page.read_text()
    assert said[18.2]["summary"][0].startswith("Yes")
