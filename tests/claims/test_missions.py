"""A mission in its fence, its room to turn back and its hours: files beside, times, and bounds.

Most files are stated, not flown: what follows from them is known in closed form.
"""

import copy
import json
import math
import re
import shutil

import numpy as np
import pytest
from flown_campaigns import flown_here
from forging import Opened, changed
from scipy import stats
from small_claims import (
    BESIDE_M,
    BOX,
    LEG_M,
    RATES,
    REACH,
    RULE,
    STRAIGHT,
    around_leg,
    hours,
    mission,
    room,
    stated_band,
    stated_hours,
    stated_mission,
    stated_plan,
    stated_room,
    stated_term,
    turning_plan,
)

import flighttune as ft

pytestmark = pytest.mark.slow

WRITTEN = {"mission.npz", "mission-turn-back.npz", "mission.geojson", "mission.kml",
           "mission-per-hour.json"}  # fmt: skip


EDGE_M = 0.05  # nearer to the edge of a fence than this, nothing is inside


@pytest.fixture
def place(tmp_path):
    """A folder with copies of what stands beside the band of a mission."""
    for name in WRITTEN:
        shutil.copy(stated_mission().with_name(name), tmp_path)
    return tmp_path


def fence(folder, *of):
    """A file with a fence around the leg."""
    (folder / "f.geojson").write_text(json.dumps(around_leg(*of)))
    return folder / "f.geojson"


def names(place):
    return {file.name for file in place.iterdir()}


# ---------------------------------------------------------------- the corridor and its fence
@pytest.mark.soak
def test_a_mission_is_counted_with_its_fence_its_room_and_its_hours():
    band, turned, hourly = (ft.load(file) for file in (mission(), room(), hours()))

    for count in (band, turned):
        assert count.about.confidence == pytest.approx(1.0 - 0.1 / 3.0)
    assert hourly.confidence == 0.9
    assert band.confidence == pytest.approx(1.0 - 2 * 0.1 / 3.0)  # the band and its fence
    assert (len(band.about.fences), len(band.scores), len(turned.scores)) == (1, 12, 21)
    assert {x.name for x in mission().parent.glob("mission*")} == WRITTEN
    # Both plans are those written by hand, but for numbers that follow and for seeds.
    for about, plan in ((band.about, stated_plan()), (turned.about, turning_plan())):
        own = {**about.plan["campaign"], "seed": plan["campaign"]["seed"]}
        assert json.dumps(own, sort_keys=True) == json.dumps(plan["campaign"], sort_keys=True)
        turn, by_hand = (x["nominal"].get("turn_back", {}) for x in (about.plan, plan))
        assert {*turn} == {*by_hand}
        for key, value in turn.items():
            if key == "place":
                for at, of in zip(value, by_hand[key], strict=True):
                    assert at == pytest.approx(of)
            else:
                assert value == pytest.approx(by_hand[key])
    # Thirty flights by RTK know their place within centimetres, those counted within metres.
    assert len(band.by_rtk) == 30
    assert np.median(band.by_rtk[:, 0]) < np.median(band.navigation[:, 0]) < 5.0
    assert np.array(hourly.volume.rings[0]) == pytest.approx(np.array(BOX), abs=1e-6)
    assert [len(term) for term in hourly.terms] == [8, 6, 6]
    assert 20.0 > hourly.exposure.window_s > LEG_M / 33.0


def test_flights_outside_the_fence_are_those_that_reach_beyond_it_beside_their_route():
    band = ft.load(stated_band())

    fenced = band.inside(around_leg(BESIDE_M))

    outside = int((REACH > BESIDE_M).sum())
    assert fenced.outside == outside == 5
    assert fenced.epsilon == pytest.approx(stats.beta.ppf(0.9, outside + 1, 12 - outside))
    assert not fenced.supported
    assert f"{12 - outside} of 12 fresh flights are certainly inside" in fenced.sentence
    near = band.with_fence(around_leg(BESIDE_M)).nearness
    assert near[0] == pytest.approx(0.5 * REACH)
    assert near[1] == pytest.approx(REACH - (BESIDE_M - EDGE_M))
    flights, corridor = fenced.nearest
    assert flights["margin_m"] == pytest.approx(BESIDE_M - REACH[-1] - EDGE_M)
    assert (flights["side"], flights["along_m"]) == ("right", pytest.approx(40.5, abs=5.0))
    assert corridor["margin_m"] == pytest.approx(BESIDE_M - REACH[-2] - EDGE_M)
    high = int((0.4 * REACH > 0.7).sum())  # above the route at 60 m
    counts = {(60.0, None): 0, (0.01, None): 12, (60.0, 0.01): 12, (60.0, 0.7): high,
              (60.0, 1.3): 0, (60.0, 1.1): 2, (2.0, 0.7): high}  # fmt: skip
    found = {of: band.inside(around_leg(of[0], top_m=of[1])) for of in counts}
    assert {of: x.outside for of, x in found.items()} == counts
    assert found[60.0, None].supported
    assert found[60.0, None].epsilon == pytest.approx(1.0 - 0.1 ** (1.0 / 12.0))


def test_a_flight_that_was_not_completed_is_outside_of_any_fence(tmp_path):
    extremes = Opened.of(stated_band()).arrays["extremes"]
    extremes[3] = [-np.inf, np.inf]
    band = ft.load(changed(stated_band(), tmp_path / "x.npz", extremes=extremes))

    assert (band.not_completed, band.inside(around_leg(60.0)).outside) == (1, 1)
    assert band.inside(around_leg(60.0)).nearest[0]["margin_m"] == pytest.approx(57.0 - EDGE_M)
    assert not band.too_many_lost
    extremes[4:6] = [-np.inf, np.inf]
    assert ft.load(changed(stated_band(), tmp_path / "x.npz", extremes=extremes)).too_many_lost


def test_a_fence_asked_later_joins_the_band_and_shares_its_confidence(place):
    for beside_m, claims, words in ((60.0, 2, "its fence"), (70.0, 3, "2 fences")):
        odds = ft.mission(place / "mission.npz", fences=[fence(place, beside_m)])

        kept = ft.load(place / "mission.npz")
        assert len(kept.about.fences) == claims - 1
        assert kept.confidence == pytest.approx(1.0 - 0.1 * claims)
        assert words in odds.band.inside(kept.about.fences[-1]).sentence
    again = odds.band.with_fence(kept.about.fences[0])
    assert again.about.fences == kept.about.fences[::-1]
    for option, value in {"seed": 0, "flights": 12, "until_sure": True, "aircraft": "x8",
                          "navigation": "rtk", "changes": {"a": 1}}.items():  # fmt: skip
        with pytest.raises(ft.InputError, match=f"`{option}` must be absent for a band"):
            ft.mission(place / "mission.npz", **{option: value})


def test_a_fence_bounds_the_volume_that_is_asked_for_or_that_its_file_states(place):
    band, file = place / "mission.npz", fence(place, 60.0)
    (place / "rates.toml").write_text(RATES)

    def bounds(**options):
        fences = ft.mission(band, fences=[file], **options).band.about.fences
        return fences[-1].get("fence_of", "operational")

    assert bounds() == bounds(fence_of="operational") == "operational"
    assert bounds(fence_of="geography") == "geography"
    with pytest.raises(ft.InputError, match="`turn_back` for a contingency volume"):
        bounds(fence_of="geography", rates=place / "rates.toml")
    with pytest.raises(ft.InputError, match="`fence_of` must be with a fence, got none"):
        ft.mission(band, fence_of="geography")
    file.write_text(json.dumps(around_leg(60.0) | {"fence_of": "geography"}))
    assert bounds() == "geography"
    assert bounds(fence_of="operational") == "operational"
    file.write_text(json.dumps(around_leg(60.0) | {"fence_of": "all"}))
    with pytest.raises(ft.InputError, match="must be one of operational or geography, got 'all'"):
        bounds()


def test_volumes_reach_beyond_a_fence_by_their_width_without_its(place):
    odds = ft.mission(place / "mission.npz", fences=[fence(place, 20.0)])
    assert odds.beyond == []
    odds = odds.with_room(ft.load(stated_room()))

    widths = {name: x.width for name, x in odds.room.volumes(odds.band).items()}
    sides = {}
    for number, name, beyond in odds.beyond:
        assert number == 1
        sides[name] = max(beyond.by_m, sides.get(name, 0.0))
    assert sides == {
        name: pytest.approx(width - 20.0, rel=0.015) for name, width in widths.items() if width > 20
    }


def test_another_claim_of_a_mission_is_written_where_it_is_asked_for(place):
    ft.mission(place / "mission.npz", epsilon=0.4, out=place / "other.npz")

    assert [ft.load(place / x).about.epsilon for x in ("mission.npz", "other.npz")] == [0.3, 0.4]
    assert ft.mission(place / "mission.npz", confidence=0.8).band.about.confidence == 0.8


def test_navigation_reaches_as_far_as_in_the_flights_that_stay_inside():
    """One of the dozen is outside the band: errors of 0.6 m to 1.7 m beside are below 1.6 m."""
    summary = " ".join(ft.mission(stated_mission()).answer().summary)
    beside = float(re.search(r"errors of navigation alone reach ([\d.]+) m", summary)[1])
    assert beside == 1.6


@pytest.mark.soak
def test_a_count_until_it_is_sure_claims_no_corridor(tmp_path):
    options = {**RULE, "until_sure": True, "changes": STRAIGHT}
    for more in ({}, {"fences": [fence(tmp_path, 60.0)], "turn_back": 30}):
        with pytest.raises(ft.InputError, match="`until_sure` must be about a fence alone"):
            ft.mission("circuit_in_wind", **options, **more)
    with flown_here():
        odds = ft.mission("circuit_in_wind", fences=[fence(tmp_path, 60.0)], **options)

    # The evidence of a yes is half that of q = 0 and half the mean over q up to epsilon: at 0.3
    # and none outside it reaches 2 / 0.1 at the first look of a dozen flights.
    assert odds.band.about.confidence == 0.9
    assert len(odds.band.scores) == 12
    assert not odds.band.claims
    assert "no corridor is claimed" in odds.band.sentence
    assert odds.band.inside(odds.band.about.fences[0]).supported


# ---------------------------------------------------------------- files beside the band
@pytest.mark.soak
def test_a_new_count_leaves_none_of_an_earlier_one_and_all_of_others(place):
    few = {**RULE, "changes": STRAIGHT, "seed": 3, "flights": 7}
    others = "mission-turn-back.npz", "mission.geojson", "mission-per-hour.json"
    kept = {name: (place / name).read_bytes() for name in others}
    with flown_here():
        ft.mission("circuit_in_wind", out=place / "mission.npz", **few)
    assert names(place) == {"mission.npz"}

    for name in others:
        (place / name).write_text("of somebody else")
    with flown_here():
        ft.mission("circuit_in_wind", out=place / "mission.npz", **few)
    assert names(place) == {"mission.npz", *others}
    assert kept


@pytest.mark.parametrize("name", ["mission.npz", "other.npz"])
def test_a_band_that_is_written_over_another_leaves_none_of_it(place, name):
    for file in WRITTEN:
        shutil.copy(place / file, place / file.replace("mission", "other", 1))

    ft.mission(place / "mission.npz", out=place / name)

    beside = {x.replace("mission", "other", 1) for x in WRITTEN}
    assert names(place) == WRITTEN | ({"other.npz"} if name == "other.npz" else beside)
    assert ft.load(place / name).sha256 == ft.load(place / "mission.npz").sha256


@pytest.mark.parametrize("given", ["source", "fence"])
def test_volumes_do_not_replace_what_is_read(place, given):
    volumes = (place / "mission.geojson").read_bytes()
    source, fences = ((place / "mission.geojson"), []) if given == "source" else (
        "circuit_in_wind", [place / "mission.geojson"])  # fmt: skip

    with pytest.raises(ft.InputError, match=r"must not replace .*mission\.geojson"):
        ft.mission(source, fences=fences, turn_back=30, out=place / "mission.npz", **RULE)
    assert (place / "mission.geojson").read_bytes() == volumes


def test_a_page_shows_a_band_with_what_stands_beside_it_and_nothing_of_others(place):
    def shown():
        report = ft.report(place / "mission.npz", place / "page.html")
        text = (place / "page.html").read_text(encoding="utf-8")
        return report, "turn back" in text, "per flight hour" in text

    assert shown()[1:] == (True, True)
    (place / "mission-per-hour.json").write_text("of somebody else")
    assert shown()[1:] == (True, False)
    (place / "mission-turn-back.npz").unlink()
    assert not shown()[1]
    of_another = changed(stated_hours(), place / "mission-per-hour.json",
                         lambda x: x["plan"]["campaign"].update(seed=7))  # fmt: skip
    assert shown()[2]  # another seed is of the same mission
    changed(of_another, place / "mission-per-hour.json",
            lambda x: x["plan"]["nominal"]["route"].update(wind_mps=9.0))  # fmt: skip
    assert not shown()[2]


# ---------------------------------------------------------------- the room to turn back
SPAN_M, GROUND_M = 2.8956, 250.0  # of the Aerosonde in JSBSim, and of the leg, 1000 m high


@pytest.mark.parametrize("times", [1.0, 4.0])
def test_volumes_add_the_room_to_the_corridor_and_their_height_to_the_buffer(times, tmp_path):
    """Numbers of the guideline of the LBA, at 25 m/s with the wind of 2 m/s that is planned."""
    extremes = times * Opened.of(stated_band()).arrays["extremes"]
    band = ft.load(changed(stated_band(), tmp_path / "x.npz", extremes=extremes))
    turned = ft.load(stated_room())
    width, above = times * REACH[-2], times * 0.5 * REACH[-2]  # as in the last that is inside
    across, upwards = 85.0, 43.0  # three of 21 may need more than 84.5 m, and half of it in height

    assert (turned.allowed, *turned.room) == (3, across, upwards)
    geography, contingency, buffer = turned.volumes(band).values()
    middle, least = 1000.0 - GROUND_M, 3.0 * SPAN_M
    assert geography.width == pytest.approx(max(width, 0.5 * least))
    assert geography.low == pytest.approx(middle - above)
    assert geography.high == pytest.approx(max(middle + above, geography.low + least))
    assert (least > 2.0 * above) == (least > 2.0 * width) == (times == 1.0)
    assert contingency.width == pytest.approx(geography.width + across)
    assert contingency.high == pytest.approx(geography.high + upwards)
    assert contingency.low == pytest.approx(geography.low - upwards)
    assert buffer.width == pytest.approx(contingency.width + contingency.high + 0.5 * SPAN_M)
    assert (buffer.low, buffer.high) == (0.0, contingency.high)
    V, g = 27.0, 9.81
    terms = {row["term"]: (row["guideline"], row["counted"]) for row in turned.terms(band)}
    wanted = {
        "S_GPS": (3.0, 1.6), "S_Pos": (3.0, geography.width - 1.6), "S_K": (1.0, None),
        "S_RZ": (V, None), "S_CM": (V**2 / g, across),
        "S_CV": (7.0 + V + V**2 / g, contingency.width),
        "H_baro": (1.0, geography.high - middle), "H_RZ": (0.7 * V, None),
        "H_CM": (0.3 * V**2 / g, upwards),
        "H_CV": (1.0 + 0.7 * V + 0.3 * V**2 / g, contingency.high - middle),
    }  # fmt: skip
    assert {*terms} == {*wanted}
    for term, (guideline, counted) in wanted.items():
        assert terms[term][0] == pytest.approx(guideline)
        assert terms[term][1] == (None if counted is None else pytest.approx(counted))
    said = turned.answer().values["room"]
    assert said == {"from_route_m": across, "height_m": upwards,
                    "by_formula_m": pytest.approx(25.0 + 25.0**2 / g)}  # fmt: skip
    with pytest.raises(ft.InputError, match="volumes must be of a room and the band"):
        turned.volumes(turned)


def moved(tables):
    for at in tables["plan"]["nominal"]["turn_back"]["place"]:
        at["east_m"] += 0.1


def shorter(tables):
    tables["plan"]["nominal"]["turn_back"]["place"].pop()


@pytest.mark.parametrize("change", [moved, shorter])
def test_volumes_are_of_a_room_on_the_route_of_the_band(change, place):
    other = ft.load(changed(stated_room(), place / "mission-turn-back.npz", change))
    with pytest.raises(ft.InputError, match="with the same gains and airspeeds on one route"):
        other.volumes(ft.load(stated_band()))
    report = ft.report(place / "mission.npz", place / "page.html")
    assert "turn back" not in (place / "page.html").read_text(encoding="utf-8")
    assert report


def test_hours_around_the_route_are_of_the_contingency_volume_beside_them(place):
    file = place / "mission-per-hour.json"
    volume = ft.load(stated_room()).volumes(ft.load(stated_band()))["contingency volume"]
    sizes = {"width_m": volume.width, "high_m": volume.high}

    def said(**sizes):
        changed(stated_hours(), file, {"fence": None, "around": sizes})
        return ft.verify(file, count=1).reason

    for key in sizes:
        assert "`around` must be the contingency volume of mission.npz" in said(
            **sizes | {key: sizes[key] + 0.01}
        )
    assert "`volume` must be that of" in said(**sizes)  # which is that of the fence
    (place / "mission.npz").unlink()
    assert "`volume` must be that of" in said(width_m=1.0, high_m=2.0)


def test_a_room_that_is_not_claimed_has_no_volumes(place):
    extremes = Opened.of(stated_room()).arrays["extremes"]
    extremes[:] = [-np.inf, np.inf]
    lost = ft.load(changed(stated_room(), place / "lost.npz", extremes=extremes))

    assert not lost.claims
    assert "No room to turn back is claimed: of" in lost.summary
    with pytest.raises(ft.InputError, match="got no claim of the room"):
        lost.volumes(ft.load(stated_band()))
    left = ft.mission(place / "mission.npz").with_room(lost)
    assert not {"volumes", "kml"} & left.files.keys()
    assert names(place) == {"mission.npz", "mission-turn-back.npz", "mission-per-hour.json",
                            "lost.npz"}  # fmt: skip


@pytest.mark.parametrize(
    ("bank", "words"),
    [("x", "must be a bank in deg"), (0.5, "a bank of 1 to"), ("loop:30", "must be a bank in deg"),
     (89, "a bank of 1 to")],
)  # fmt: skip
def test_a_bank_that_cannot_be_flown_is_refused(bank, words):
    with pytest.raises(ft.InputError, match=words):
        ft.mission("circuit_in_wind", turn_back=bank, changes=STRAIGHT, **RULE)


# ---------------------------------------------------------------- exits per flight hour
def test_hours_are_flown_again_and_what_was_changed_is_named(tmp_path):
    with flown_here():
        assert ft.verify(hours(), count=2).valid
        said = ft.verify(hours(), count=2).verification.notes
    assert [x.split(":")[0] for x in said[:3]] == ["Healthy flight", "Engine",
                                                   "Aileron stuck, cut after 0.5 s"]  # fmt: skip
    assert all("2 of" in x for x in said[:3])
    assert "rates are the applicant's" in " ".join(said)


def time_of(term, name, change):
    def edit(tables):
        tables["terms"][term][name][3] = change(tables["terms"][term])

    return edit


def wide(tables):
    tables["volume"]["rings"] = [[[-5e3, -5e3], [5e3, -5e3], [5e3, 5e3], [-5e3, 5e3]]]


# What only flying again shows, and what the file itself shows.
FLOWN_AGAIN = [
    (time_of(0, "end_s", lambda t: t["end_s"][3] + 0.02), "flight 3 of healthy flight must be as"),
    (time_of(1, "end_s", lambda t: t["end_s"][3] - 0.02), "flight 3 of engine must be as|times"),
    (time_of(2, "left_s", lambda t: -1.0 if t["left_s"][3] >= 0 else 0.5),
     "flight 3 of aileron stuck, cut after 0.5 s must be as"),
]  # fmt: skip
FORGED = [
    (time_of(0, "left_s", lambda t: t["end_s"][3] + 1.0), "times of leaving and of ending"),
    (time_of(2, "ended_at_s", lambda t: -0.5), "times of leaving and of ending"),
    (time_of(0, "ended_at_s", lambda t: 1.0), "`ended_at_s` must .* got 1 s of flight 3"),
    (wide, "`volume` must be that of the fence"),
    (lambda x: x.update(fence=None), "`fence` or `around` must say"),
    (lambda x: x["terms"][0]["left_s"].pop(), "three times of each flight"),
    (lambda x: [x["terms"][0][k].pop() for k in ("left_s", "end_s", "ended_at_s")],
     "`terms` must be the flights that `rates` states"),
    (lambda x: x["terms"].pop(), "`terms` must be"),
    (lambda x: x["terms"][2].update(ended_s=1.0), "`terms` must be"),
    (lambda x: x["terms"][1].update(fault=1), "`terms` must be"),
    (lambda x: x.update(later=[copy.deepcopy(x["terms"][0])]), "`later` must be"),
    (lambda x: x.update(later=[stated_term(5, 1, 1.0)]), "`later` must be"),
    (lambda x: x.update(later=[stated_term(6, 0, 1.0), stated_term(6, 1, 2.0)]), "`later` must be"),
    (lambda x: x["rates"]["fault"][0].update(per_hour=2.0), "`per_hour`"),
    (lambda x: x["rates"]["fault"][0].update(kind="wing"), "`kind` must be one of"),
    (lambda x: x["rates"]["ending"].update(monitor="m.npz"), "`alarms` must be given with"),
    (lambda x: x.update(alarms={"models": [], "middle": [], "half": []}), "`alarms` must be given"),
    (lambda x: x.update(confidence=1.5), "confidence"),
    (lambda x: x["plan"]["aircraft"].update(aerosonde="0" * 64), "files of the aircraft|aircraft"),
    (lambda x: x["plan"]["campaign"].pop("seed"), "`plan`"),
    (lambda x: x.update(format="flighttune flight hours 1"), "make the file again"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("maker", "change", "words"),
    [(stated_hours, *row) for row in FORGED]
    + [pytest.param(hours, *row, marks=pytest.mark.soak) for row in FLOWN_AGAIN],
)
def test_hours_of_which_anything_was_changed_are_refused_in_one_line(
    maker, change, words, tmp_path
):
    file = changed(maker(), tmp_path / "x-per-hour.json", change)

    with flown_here():
        try:
            verified = ft.verify(file, count=99)
            said = verified.reason
            assert not verified.valid
        except ft.InputError as refused:
            said = str(refused)
    assert re.search(words, said), said
    assert "\n" not in said


# ---------------------------------------------------------------- the bound per flight hour
def claim(path, healthy=0, faulty=(0, 0), target=None, *, n=300, later=(), end_s=100.0,
          rates_of=(0.5, 1.0), **fault):  # fmt: skip
    """The claim of a file with 300 flights of 100 s in each term, of which so many leave."""

    def change(tables):
        rates = tables["rates"]
        rates["flights"] = n
        rates.pop("target_per_hour", None)
        if target is not None:
            rates["target_per_hour"] = target
        for i, rate in enumerate(rates_of):
            rates["fault"][i].update(per_hour=rate, flights=n, **(fault if i else {}))
        ended = rates["fault"][1].get("ended_s")
        tables["plan"]["nominal"]["flight"]["duration_s"] = 1.2 * end_s
        each = [(None, None, healthy), (0, None, faulty[0]), (1, ended, faulty[1])]
        tables["terms"] = [stated_term(n, *x, end_s) for x in each]
        tables["later"] = [stated_term(n, 1, at, left, end_s) for left, at in later]

    return ft.load(changed(stated_hours(), path, change))


@pytest.mark.parametrize(
    ("healthy", "faulty", "target", "counts"),
    [(0, (0, 0), None, 5), (2, (4, 0), None, 5), (2, (0, 40), 0.9, 7), (300, (300, 300), 0.5, 7)],
)
def test_the_bound_is_that_of_its_counts(healthy, faulty, target, counts, tmp_path):
    """Clopper and Pearson's bounds share 0.1: three counts of healthy flights, one of each fault,
    and with a target one more of each; three of 300 flights may be shorter than 100 s."""

    def upper(k):
        return 1.0 if k == 300 else stats.beta.ppf(1.0 - 0.1 / counts, k + 1, 300 - k)

    hourly = claim(tmp_path / "x.json", healthy, faulty, target)
    bound = hourly.bound

    mean_h = (1.0 - upper(3)) * (1.0 - math.exp(-1.5 * 100.0 / 3600.0)) / 1.5
    window, cap, odd = 100.0 / 3600.0, 120.0 / 3600.0, upper(0)
    assert bound.healthy == pytest.approx(upper(healthy) / mean_h)
    assert bound.faults == pytest.approx([
        rate * (window * upper(k) + odd * cap) / mean_h
        for rate, k in zip((0.5, 1.0), faulty, strict=True)
    ])  # fmt: skip
    pairs = window * (cap - 0.5 * window) + 0.5 * odd * cap**2
    assert bound.several == pytest.approx(1.5**2 * pairs / mean_h)
    assert bound.total == pytest.approx(bound.healthy + sum(bound.faults) + bound.several)
    assert (bound.each, bound.hours) == pytest.approx((1.0 - 0.1 / counts, mean_h))
    said = hourly.answer()
    first = said.summary[0]
    assert first.startswith("At most" if target is None else "No: at most")
    most = float(re.search(r"at most ([\d.e+]+) flights per flight hour", first, re.I)[1])
    assert bound.total <= most < 1.01 * bound.total
    rows = said.tables[0].records
    assert [row["outside"] for row in rows[:3]] == [healthy, *faulty]
    assert [row["share"] for row in rows[:3]] == pytest.approx([upper(k) for k in
                                                               (healthy, *faulty)])  # fmt: skip
    terms = [bound.healthy, *bound.faults]
    place = int(np.argmax(bound.faults))
    assert hourly.largest == (place if max(terms[1:]) > terms[0] else None)
    assert bool(said.failure) == (target is not None)


@pytest.mark.soak
@pytest.mark.parametrize(
    ("target", "later", "latest", "words"),
    [
        (None, [], None, "At most"),
        ("above", [], None, "Yes: at most"),
        ("equal", [], None, "Yes: at most"),
        ("below", [], None, "N"),
        ("above", [(0, 1.0), (3, 2.0), (0, 3.0)], 3.0, "Yes"),
        # the first failure ends the sequence, whatever comes after it
        ("above", [(0, 1.0), (290, 2.0), (0, 3.0)], 1.0, "Yes"),
        ("above", [(290, 1.0), (0, 2.0)], None, "Yes"),
        ("above", [(0, 60.0)], 60.0, "Yes"),
    ],
)
def test_the_target_is_met_by_the_total_and_the_latest_time_by_the_last_that_meets_it(
    target, later, latest, words, tmp_path
):
    rare = {"n": 3000, "end_s": 9000.0, "rates_of": (0.005, 0.01), "ended_s": 0.5}
    plain = claim(tmp_path / "x.json", target=0.9, **rare).bound.total if target else None
    at = plain and {"above": 1.5, "equal": 1.0, "below": 0.999}[target] * plain

    hourly = claim(tmp_path / "x.json", target=at, later=[(10 * k, t) for k, t in later], **rare)

    assert hourly.met == (None if at is None else target != "below")
    assert hourly.latest == (None if latest is None else ("aileron_stuck", latest))
    said = hourly.answer()
    assert said.summary[0].startswith(words)
    assert said.values["per_hour"]["latest"] == (
        None if latest is None else {"fault": "aileron_stuck", "ended_s": latest}
    )
    line = " ".join(said.summary)
    assert (f"within {latest} s".replace(".0 s", " s") in line) == (latest is not None)
    assert ("does not hold even if" in line) == (bool(later) and latest is None)
    assert len(said.tables) == 1 + bool(later)


@pytest.mark.parametrize(
    ("alarms", "early", "shortest_s"),
    [(False, 3, 90.0), (False, 4, 5.0), (True, 15, 90.0), (True, 16, 5.0)],
)
def test_a_few_flights_that_end_early_do_not_shorten_the_exposure(
    alarms, early, shortest_s, tmp_path
):
    """One of a hundred, and five where alarms end flights."""

    def change(tables):
        claim(tmp_path / "y.json", end_s=90.0)
        tables.update(Opened.of(tmp_path / "y.json").tables)
        for term in tables["terms"]:
            term["end_s"][:early] = [5.0] * early
        if alarms:
            tables["rates"]["ending"]["monitor"] = "m.npz"
            tables["alarms"] = {"models": [], "middle": [], "half": []}

    hourly = ft.load(changed(stated_hours(), tmp_path / "x.json", change))

    assert hourly.exposure.shortest_s == shortest_s
    assert (hourly.exposure.window_s, hourly.exposure.cap_s) == (90.0, 108.0)


def test_each_ending_and_kind_of_fault_is_told_as_declared(tmp_path):
    """Of the tables of the file of rates each ending and each kind has its words."""
    endings = {
        "cut": ({"fall_per_height": 1.5}, "1.5 m away per metre of height"),
        "parachute": ({"opens_s": 1.5, "sink_mps": 4.0}, "after 1.5 s and sinks by 4 m/s"),
        "turn_back": ({}, "turn back"), "circle": ({}, "circle"), "glide": ({}, "glide"),
    }  # fmt: skip
    for kind, (keys, words) in endings.items():

        def change(tables, kind=kind, keys=keys):
            tables["rates"]["ending"] = {"kind": kind, **keys}
            tables["terms"][2]["ended_at_s"] = [0.0] * 6

        hourly = ft.load(changed(stated_hours(), tmp_path / "x.json", change))
        said = " ".join([*hourly.answer().notes, *hourly.answer().summary, *hourly.about])
        assert words in said.replace("turn_back", "turn back"), kind
        assert (
            hourly.table.name_of(1, 0.5) == f"aileron stuck, {kind.replace('_', ' ')} after 0.5 s"
        )


# ---------------------------------------------------------------- declared rates
FAULT = '[[fault]]\nkind = "engine"\nper_hour = 1e-3\nsource = "a log"\n'
STUCK = FAULT.replace("engine", "aileron_stuck")
BAD_RATES = [
    (FAULT.replace("engine", "wing"), r"`kind` must be one of engine, aileron_stuck"),
    (FAULT.replace("engine", "aileron_floating"), "hinge moments.*; declare aileron_stuck, got"),
    (FAULT.replace("per_hour", "rate"), "`rate`"),
    (FAULT.replace("1e-3", "1.5"), "`per_hour` must be less than or equal to 1, got 1.5"),
    (FAULT.replace('source = "a log"\n', ""), "`source`"),
    (FAULT + FAULT, "each kind once, got engine again"),
    (FAULT + "factor = [2.0, 4.0]\n", "`factor` must be absent for the fault engine"),
    (FAULT + "detected_s = 3.0\nended_s = 2.0\n", "`ended_s` must be at least `detected_s`"),
    (FAULT + "detected_s = 3.0\n", "`ended_s` must be given beside `detected_s`"),
    (FAULT.replace("engine", "receiver_jump"), "`jump_m` must be given for the fault"),
    (FAULT.replace("engine", "receiver_lost"), "`drift_mps` must be given for the fault"),
    (FAULT.replace("engine", "actuator_slow"), "`factor` must be given for the fault"),
    (FAULT.replace("engine", "airspeed_wrong"), "`bias_mps` must be given for the fault"),
    (FAULT + 'ending = "circle"\n', "`ending` must be absent without `ended_s` and without"),
    (FAULT + 'ended_s = 2.0\nending = "land"\n', "'cut', 'parachute', 'turn_back'"),
    (FAULT + "[ending]\nafter_alarm_s = 2.0\n", "`after_alarm_s` must be absent without a"),
    (FAULT + "[ending]\nsink_mps = 5.0\n", "`sink_mps` must be absent without a parachute"),
    (FAULT + 'ended_s = 2.0\nending = "parachute"\n[ending]\nsink_mps = 5.0\n',
     "`opens_s` of .ending. must be given for a parachute"),
    (FAULT + '[ending]\nkind = "parachute"\nsink_mps = 5.0\nopens_s = 1.0\nfall_per_height = 1.0\n',
     "`fall_per_height` must be absent with a parachute"),
    (STUCK + "stuck_deg = [0.0, 40.0]\n", "`stuck_deg` of aileron_stuck must lie in the travel"),
    (STUCK + "stuck_deg = [-40.0, 0.0]\n", "`stuck_deg` of aileron_stuck must lie in the travel"),
    (FAULT + '[ending]\nkind = "glide"\n', "`speed_priority` must be true"),
    (FAULT + 'ended_s = 1.0\nending = "glide"\n', "`speed_priority` must be true"),
    (FAULT + '[ending]\nmonitor = "none.npz"\n', "none.npz"),
]  # fmt: skip


@pytest.mark.parametrize(("rates", "words"), BAD_RATES)
def test_rates_that_cannot_be_flown_are_refused_in_one_line_before_any_flight(
    rates, words, tmp_path
):
    (tmp_path / "rates.toml").write_text(rates)
    with pytest.raises(ft.InputError, match=words) as refused:
        ft.mission("circuit_in_wind", changes=STRAIGHT, turn_back=30, out=tmp_path / "m.npz",
                   rates=tmp_path / "rates.toml", **RULE)  # fmt: skip
    assert "\n" not in str(refused.value)
    assert "rates.toml" in str(refused.value) or "none.npz" in str(refused.value)
    assert [x.name for x in tmp_path.iterdir()] == ["rates.toml"]


@pytest.mark.parametrize(
    ("source", "options", "fault", "words"),
    [
        ("circuit_in_wind", {}, "", "must be with a fence, or with `turn_back`"),
        ("circuit_in_wind_x8", {"turn_back": 30}, "rudder_stuck", "it has no rudder"),
        ("circuit_in_wind", {"turn_back": 30, "navigation": "exact"}, "receiver_jump",
         "receiver_jump with exact navigation"),
    ],
)  # fmt: skip
def test_rates_are_of_what_is_flown(source, options, fault, words, tmp_path):
    text = FAULT.replace("engine", fault or "engine")
    text += "jump_m = [1.0, 2.0]\n" if fault == "receiver_jump" else ""
    (tmp_path / "rates.toml").write_text(text)
    with pytest.raises(ft.InputError, match=words):
        ft.mission(source, changes=STRAIGHT, rates=tmp_path / "rates.toml", **options, **RULE)


# ---------------------------------------------------------------- stopped, and going on
class Stops(ft.CampaignObserver):
    """Stops after so many flights, and keeps what is said."""

    def __init__(self, after=10**9):
        self.after, self.said, self.flown = after, [], 0

    def see(self, progress):
        self.flown = progress.flown
        self.stopped = progress.flown >= self.after

    def hear(self, sentence):
        self.said.append(sentence)


LONG = {**RULE, "changes": STRAIGHT, "flights": 260, "workers": 1}


@pytest.fixture(scope="module")
def stopped(tmp_path_factory):
    """The file of a count that was stopped after 250 flights; 30 taught it, and flew by RTK."""
    out = tmp_path_factory.mktemp("stopped") / "m.npz"
    with pytest.raises(ft.FlightTuneError) as stop:
        ft.mission("circuit_in_wind", out=out, observer=Stops(60 + 252), **LONG)
    (kept,) = stop.value.kept
    assert [str(x) for x in out.parent.iterdir()] == [kept]
    return out.with_name("m-unfinished.npz")


@pytest.mark.soak
@pytest.mark.parametrize(
    ("other", "words"),
    [
        (None, "250 flights are counted already."),
        ("seed", "belong to another count: it is counted from the beginning."),
        ("damaged", "must be a band file"),
        ("open", "must be a file of this user alone"),
    ],
)
def test_a_stopped_count_goes_on_with_its_own_flights_alone(stopped, other, words, tmp_path):
    out, kept = tmp_path / "m.npz", tmp_path / stopped.name
    shutil.copy(stopped, kept)
    if other == "damaged":
        kept.write_bytes(b"damaged")
    if other == "open":
        kept.chmod(0o666)  # anybody may have changed it
    if other is not None:
        seen, seed = Stops(70), {"seed": 9} if other == "seed" else {}
        with pytest.raises(ft.FlightTuneError):
            ft.mission("circuit_in_wind", out=out, observer=seen, **LONG, **seed)
        assert words in seen.said[0]
        return
    seen = Stops()
    ft.mission("circuit_in_wind", out=out, observer=seen, **LONG)

    assert words in seen.said[0]
    assert seen.flown < 250  # what was counted is not flown anew, but some of it by JSBSim
    assert not kept.exists()
    ft.mission("circuit_in_wind", out=tmp_path / "whole.npz", **LONG)
    assert out.read_bytes() == (tmp_path / "whole.npz").read_bytes()


@pytest.mark.soak
def test_flights_glide_on_where_a_law_holds_the_airspeed(tmp_path):
    text = RATES.replace('kind = "cut"\nfall_per_height = 0.1\n', 'kind = "glide"\n')
    (tmp_path / "rates.toml").write_text(text.replace("flights = 8", "flights = 2"))
    with flown_here():
        odds = ft.mission("circuit_in_wind", changes=STRAIGHT | {"controller.speed_priority": True},
                          flights=9, fences=[fence(tmp_path, 2e3, (-3e3, 3e3))], rates=tmp_path /
                          "rates.toml", out=tmp_path / "m.npz", **RULE)  # fmt: skip
        verified = ft.verify(tmp_path / "m-per-hour.json", count=3)
    assert verified.valid, verified.reason
    assert odds.per_hour.terms[2].ended >= 1


@pytest.mark.soak
def test_a_monitor_on_board_ends_flights_and_is_of_the_aircraft_that_flies(tmp_path):
    few = {**RULE, "learn": 20, "flights": 7, "changes": STRAIGHT}
    on_board = RATES.replace("fall_per", 'monitor = "m.npz"\nfall_per')
    (tmp_path / "rates.toml").write_text(on_board)
    wide = fence(tmp_path, 2e3, (-3e3, 3e3))
    mission = {"changes": STRAIGHT, "fences": [wide], "flights": 9, **RULE}
    with flown_here():
        ft.monitor("circuit_in_wind", out=tmp_path / "m.npz", **few)
        odds = ft.mission("circuit_in_wind", rates=tmp_path / "rates.toml", **mission)
    assert odds.per_hour.alarms is not None
    assert odds.per_hour.table.name_of(1, 0.5).endswith("after 0.5 s or at an alarm")
    assert odds.per_hour.terms[0].count.flights == 8
    with pytest.raises(ft.InputError, match="must be of the aircraft, law and gains"):
        ft.mission("circuit_in_wind", rates=tmp_path / "rates.toml",
                   **{**mission, "changes": {**STRAIGHT, "gains": ["K1"]}})  # fmt: skip
