"""A verdict is the worst of all that stands beside it, in text, JSON, exit status and colour."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from made_up_missions import counted_mission

from flighttune.claims.mission import MissionOdds
from flighttune.outputs.answers import answer, early, finding
from flighttune.outputs.pages.claim import write_claim_page
from flighttune.routes import maps, volumes

GEOGRAPHY, CONTINGENCY, BUFFER = volumes.NAMES

GREEN = 'class="verdict yes"'

ROUNDED_M = 2.0
"""A volume is drawn up to 0.4 m wider, its path has points 1 m apart, and metres are rounded."""

findings = st.builds(
    finding.PartFinding,
    found=st.sampled_from([*finding.KINDS]),
    sentence=st.sampled_from(["the fence is kept.", "the volume is wide.", ""]),
    reason=st.sampled_from(["", "it is so"]),
)


@given(st.lists(findings, min_size=1, max_size=5))
def test_no_answer_says_yes_while_a_part_of_it_is_not_met(parts):
    said = answer.Answer(findings=parts, lines=["More."])
    kinds = {part.found for part in parts}

    assert bool(said.status) == bool(kinds & {"open", "not met"})
    assert said.status == (1 if "not met" in kinds else 2 if "open" in kinds else 0)
    assert (said.found == "met") == (kinds == {"met"})
    top = [line for line in said.summary if line.startswith(("Yes: ", "Yes, but ", "No: ", "Not "))]
    assert len(top) <= 1
    if said.summary[0].startswith("Yes: "):
        assert kinds == {"met"}
    assert {x["sentence"] for x in json.loads(said.json()).get("findings", [])} <= {
        part.sentence for part in parts
    }


@pytest.fixture(scope="module")
def counted(tmp_path_factory):
    """The mission, its file, and corners of its route: south, west, north and east, m."""
    _, band, room = counted_mission()
    file = tmp_path_factory.mktemp("findings") / "m.npz"
    band.save(file)
    path = band.flights.route.reference.path
    on = path.s <= path.length
    ends = [f(x[on]) for f in (np.min, np.max) for x in (path.north, path.east)]
    return MissionOdds(band=band, files={"band": file}, file=file).with_room(room), ends


def fence(corners, **stated):
    ring = maps.on_earth(np.array([*corners, corners[0]]), (0.0, 0.0))[:, ::-1].tolist()
    area = {"type": "Polygon", "coordinates": [ring]}
    return {"type": "Feature", "properties": {}, "geometry": area, **stated}


def rectangle(ends, room, **stated):
    """A fence with so much room beside the route in the south, west, north and east, m."""
    (south, west, north, east), (s, w, n, e) = ends, room
    low, left, high, right = south - s, west - w, north + n, east + e
    return fence([(low, left), (low, right), (high, right), (high, left)], **stated)


def drawn(odds):
    """The volumes as their file has them, in longitude and latitude, and their heights."""
    where, ground = odds.band.flights.route.where, odds.band.flights.central.flight.ground_m
    shapes = json.loads(volumes.VolumesMap(where, ground, odds.room.volumes(odds.band)).geojson())
    return {
        x["properties"]["name"]: (shapely.geometry.shape(x["geometry"]), x["properties"])
        for x in shapes["features"]
    }


sides = st.floats(10.0, 2000.0)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(
    room=st.tuples(sides, sides, sides, sides),
    ceiling=st.none() | st.floats(3.0, 60.0),
    fence_of=st.sampled_from(["operational", "geography"]),
)
def test_no_mission_says_yes_while_a_drawn_volume_leaves_its_fence(
    counted, room, ceiling, fence_of
):
    """Held against the areas of the written map by another library."""
    odds, ends = counted
    tables = rectangle(ends, room, fence_of=fence_of)
    if ceiling is not None:
        tables["properties"] = {"max_up_m": ceiling}
    odds = replace(odds, band=odds.band.with_fence(tables))
    said, area = odds.answer(), shapely.geometry.shape(tables["geometry"])

    out = {
        name: not area.contains(shape)
        or (ceiling is not None and name != BUFFER and stated["max_up_m"] > ceiling)
        for name, (shape, stated) in drawn(odds).items()
    }

    bounded = {GEOGRAPHY} if fence_of == "geography" else {GEOGRAPHY, CONTINGENCY}
    missed = any(out[name] for name in bounded)
    if any(out.values()):
        assert said.found != "met"
        assert not said.summary[0].startswith("Yes: ")
    if missed:
        assert said.status == 1
        assert said.summary[0].startswith("No: ")
    widest = max(volume.width for volume in odds.room.volumes(odds.band).values())
    if not any(out.values()) and min(room) > 1.01 * widest + ROUNDED_M:
        assert said.found == "met"
        assert said.status == 0


@pytest.mark.parametrize("by", [3.0, 40.0, 170.0])
def test_a_mission_says_how_far_its_contingency_volume_is_beyond_the_fence(counted, by):
    odds, ends = counted
    width = odds.room.volumes(odds.band)[CONTINGENCY].width
    tables = rectangle(ends, (1600.0, 1600.0, 1600.0, width - by))
    odds = replace(odds, band=odds.band.with_fence(tables))

    said = odds.answer()

    (metres,) = re.findall(r"contingency volume reaches ([\d.]+) m beyond", said.summary[0])
    assert float(metres) == pytest.approx(by, abs=ROUNDED_M)
    (part,) = [x for x in said.values["turn_back"]["beyond_fence"] if x["volume"] == CONTINGENCY]
    assert part["by_m"] == pytest.approx(by, abs=ROUNDED_M)
    assert "`--fence-of geography`" in said.failure


@pytest.mark.parametrize(
    ("east", "before", "green"),
    [
        (1600.0, None, True),
        (300.0, None, False),  # the ground risk buffer is outside
        (200.0, None, False),  # and the contingency volume
        (1600.0, 200.0, False),  # outside a fence that is drawn too
        (3.0, None, False),  # and the flights
    ],
)
def test_no_page_of_a_mission_is_green_while_a_drawn_area_leaves_the_red_line(
    counted, tmp_path, east, before, green
):
    odds, ends = counted
    band = odds.band
    for room in filter(None, (before, east)):
        band = band.with_fence(rectangle(ends, (1600.0, 1600.0, 1600.0, room)))
    page = tmp_path / "m.html"
    odds = replace(odds, band=band)

    write_claim_page(band, str(odds.file), page, odds)

    assert (GREEN in page.read_text()) == green
    assert (odds.answer().found == "met") == green


def test_a_corridor_beyond_the_fence_is_a_reserve_though_all_flights_stay_inside(counted):
    """The corridor is as wide to both sides, and flights go to one side alone."""
    odds, ends = counted
    alone = replace(odds, room=None, files={})
    half = alone.band.corridor().high[:, 0].max()
    tables = rectangle(ends, (1600.0, 1600.0, half - 0.5, 1600.0))

    said = replace(alone, band=alone.band.with_fence(tables)).answer()

    assert said.found != "met"
    assert "beyond" in said.summary[0] or said.status == 1


signals = st.sampled_from(["alpha", "V_a", "n_z", "theta"])


@st.composite
def ended(draw):
    """A flight that ended early, with the reasons that plants give."""
    kind, t = draw(st.sampled_from(["left", "ground", "nothing"])), draw(st.floats(0.1, 99.0))
    if kind == "left":
        signal, low = draw(signals), draw(st.integers(-20, 10))
        high = low + draw(st.integers(1, 30))
        got = draw(st.sampled_from([low - 0.5, high + 0.5]))
        words = f"t = {t:.3f} s: {signal} must stay inside {low} to {high} deg, got {got:.2f} deg."
        return {"status": "left_envelope", "reason": words, "signal": signal, "run": 0}
    if kind == "ground":
        words = f"t = {t:.3f} s: hit the ground at V_a = 21.0 m/s."
        return {"status": "ground_contact", "reason": words, "signal": "ground", "run": 0}
    return {"status": "diverged", "reason": "", "signal": "diverged", "run": 0}


@given(st.lists(ended(), min_size=1, max_size=9))
def test_flights_that_end_early_name_a_signal_its_range_and_a_remedy(rows):
    assume(len({row["signal"] for row in rows}) == 1)

    said = early.in_words({"": (rows, 9)})

    assert said.startswith(f"{len(rows)} of 9 flights ended early. ")
    assert rows[0]["signal"] in said
    assert re.search(r": (fly|turn) ", said)
    assert not re.search(r"\b(inf|nan)\b|∞", said)
