"""Files beside the band of a mission: those of an earlier count go, and those of others stay."""

import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic
from made_up import made_up_scenario
from made_up_band import count_of, plan_of_paper, scores_of
from made_up_missions import AREA, made_up_flights, mission

import flighttune as ft
from flighttune.claims import hourly_flights, leaving
from flighttune.claims import mission as missions
from flighttune.claims.band import RecordedSignals
from flighttune.routes import maps

FEW = {"epsilon": 0.3, "confidence": 0.9, "flights": 12, "workers": 1}
FEW |= {"changes": {"gains": ["paper"], "law": ["paper"]}}  # which need no search
WRITTEN = {"m.npz", "m-turn-back.npz", "m.geojson", "m.kml", "m-per-hour.json"}
RATES = """
flights = 8
[[fault]]
kind = "engine"
per_hour = 1e-3
source = "a log"
flights = 6
"""

# m: the start and its areas are on a plane
PLANE = 3.0


@pytest.fixture(autouse=True)
def flights(monkeypatch):
    """Flights of the mission, of turning back, and with faults are made up."""
    made_up_flights(monkeypatch)

    def flown(_flights, _pool, runs, _doing):
        return [leaving.Left(leaving.NEVER, 20.0, leaving.NEVER, 0.0) for _ in runs]

    monkeypatch.setattr(hourly_flights.TermFlights, "flown", flown)


@pytest.fixture(scope="module")
def counted(tmp_path_factory):
    """A folder with a mission, and all that is counted of it."""
    folder = tmp_path_factory.mktemp("counted")
    (folder / "rates.toml").write_text(RATES)
    mission(folder / "m.plan")
    return folder


@pytest.fixture
def place(counted, tmp_path):
    """A folder of its own with these files."""
    if not (counted / "m.npz").exists():
        rates, out = counted / "rates.toml", counted / "m.npz"
        ft.mission(counted / "m.plan", turn_back=30, rates=rates, out=out, **FEW)
    shutil.copytree(counted, tmp_path, dirs_exist_ok=True)
    return tmp_path


def names(folder):
    return {file.name for file in folder.iterdir()} - {"m.plan", "rates.toml"}


def test_all_that_is_counted_stands_beside_the_band(place):
    assert names(place) == WRITTEN
    hourly = ft.load(place / "m-per-hour.json")

    (ring,) = hourly.volume.rings
    lines = [Geodesic.WGS84.Inverse(47.4, 8.5, *corner) for corner in AREA]
    corners = [line["s12"] * np.exp(1j * np.deg2rad(line["azi1"])) for line in lines]
    assert np.abs(np.subtract.outer(corners, np.array(ring) @ [1.0, 1j])).min(axis=1).max() < PLANE
    assert (hourly.volume.outside, hourly.volume.low, hourly.volume.high) == ((False,), None, None)
    # three claims share 0.1; that of each hour has its own
    assert ft.load(place / "m.npz").about.confidence == pytest.approx(1.0 - 0.1 / 3.0)
    assert hourly.confidence == FEW["confidence"]


def test_a_new_count_leaves_none_of_an_earlier_one(place):
    ft.mission(place / "m.plan", out=place / "m.npz", seed=3, **FEW)

    assert names(place) == {"m.npz"}


def test_a_new_count_leaves_files_of_others(place):
    others = "m-turn-back.npz", "m.geojson", "m-per-hour.json"
    for name in others:
        (place / name).write_text("of somebody else")
    ft.mission(place / "m.plan", out=place / "m.npz", seed=3, **FEW)

    # whose volume it is follows from the room beside it
    assert names(place) == {"m.npz", "m.kml", *others}
    assert all((place / name).read_text() == "of somebody else" for name in others)


def test_volumes_of_somebody_else_stay_beside_a_new_count(place):
    (place / "m.kml").write_text("of somebody else")
    ft.mission(place / "m.plan", out=place / "m.npz", seed=3, **FEW)

    assert names(place) == {"m.npz", "m.kml"}


def test_a_band_that_is_written_over_none_leaves_volumes_beside_it(place):
    (place / "m.npz").unlink()
    ft.mission(place / "m.plan", out=place / "m.npz", seed=3, **FEW)

    assert names(place) == WRITTEN - {"m-per-hour.json"}


@pytest.mark.parametrize("name", ["m.npz", "other.npz"])
def test_a_band_that_is_written_over_another_leaves_none_of_it(place, name):
    """Beside its own file all stays."""
    other = (place / name).with_stem("other")
    for file in WRITTEN:
        shutil.copy(place / file, place / file.replace("m", "other", 1))

    ft.mission(place / "m.npz", out=place / name, workers=1)

    left = {other.name} if name == other.name else {x.replace("m", "other", 1) for x in WRITTEN}
    assert names(place) == WRITTEN | left
    assert ft.load(place / name).sha256 == ft.load(place / "m.npz").sha256


def test_of_a_room_that_is_not_claimed_no_volumes_are_left(place):
    odds = ft.mission(place / "m.npz", turn_back=30, workers=1)
    assert {odds.files[key].name for key in ("room", "volumes", "kml")} <= WRITTEN
    extremes = odds.room.extremes.copy()
    extremes[:] = np.float32([-np.inf, np.inf])

    left = odds.with_room(replace(odds.room, extremes=extremes))

    assert not {"volumes", "kml"} & left.files.keys()
    assert names(place) == WRITTEN - {"m.geojson", "m.kml"}
    assert not ft.load(place / "m-turn-back.npz").claims


BESIDE = {
    "band": "m.npz", "room": "m-turn-back.npz", "volumes": "m.geojson", "kml": "m.kml",
    "per_hour": "m-per-hour.json",
}  # fmt: skip


def test_a_band_is_shown_with_what_stands_beside_it(place):
    band, file = ft.load(place / "m.npz"), place / "m.npz"

    kept = missions.kept_mission(band, file)

    assert {key: path.name for key, path in kept.files.items()} == BESIDE
    assert kept.room.sha256 == ft.load(place / "m-turn-back.npz").sha256
    assert kept.per_hour.volume == ft.load(place / "m-per-hour.json").volume
    (place / "m.kml").unlink()
    (place / "m-per-hour.json").write_text("of somebody else")
    left = missions.kept_mission(band, file)
    assert left.files.keys() == BESIDE.keys() - {"kml", "per_hour"}
    assert left.per_hour is None
    (place / "m-turn-back.npz").unlink()
    alone = missions.kept_mission(band, file)
    assert (alone.room, {*alone.files}) == (None, {"band"})
    shutil.copy(file, place / "m-turn-back.npz")  # a band, and no room
    assert missions.kept_mission(band, file).room is None


@pytest.mark.slow
def test_what_stands_beside_a_band_and_is_of_another_route_is_not_shown(place):
    """Another seed is of the same mission."""
    mission(place / "far.plan", corner=(47.405, 8.507))
    for name in ("far", "m"):
        ft.mission(place / f"{name}.plan", out=place / "of.npz", seed=3, **FEW)
        for file in ("-turn-back.npz", "-per-hour.json"):
            shutil.copy(place / f"m{file}", place / f"of{file}")

        kept = missions.kept_mission(ft.load(place / "of.npz"), place / "of.npz")

        assert (kept.per_hour is None) == (name == "far")
        assert ("per_hour" in kept.files) == (name == "m")
        if name == "far":
            assert kept.room is None
            assert {*kept.files} == {"band"}


def test_a_claim_of_flights_that_were_counted_may_be_another(place):
    about = ft.mission(place / "m.npz", epsilon=0.4, workers=1).band.about
    assert (about.epsilon, about.confidence) == (0.4, pytest.approx(1.0 - 0.1 / 3.0))
    about = ft.mission(place / "m.npz", confidence=0.8, workers=1).band.about
    assert (about.epsilon, about.confidence) == (FEW["epsilon"], 0.8)
    ft.mission(place / "m.npz", epsilon=0.4, out=place / "other.npz", workers=1)
    epsilons = [ft.load(place / name).about.epsilon for name in ("m.npz", "other.npz")]
    assert epsilons == [FEW["epsilon"], 0.4]
    with pytest.raises(ft.InputError, match="`seed` must be absent for a band"):
        ft.mission(place / "m.npz", seed=0)


def test_a_fence_that_is_asked_later_is_kept_in_the_file_of_the_band(place):
    larger = [[lat + 0.01 * (lat > 47.4), lon] for lat, lon in AREA]
    mission(place / "larger.plan", larger)

    ft.mission(place / "m.npz", fences=[place / "larger.plan"], workers=1)

    fences = ft.load(place / "m.npz").about.fences
    assert [str(47.43) in str(fence) for fence in fences] == [False, True]


def test_a_band_over_time_is_no_mission(tmp_path):
    measured = RecordedSignals(units={"chi_err": "rad"})
    plan = plan_of_paper(made_up_scenario())
    count_of(ft.Band, plan, measured, 1.0, scores_of(1.0)).save(tmp_path / "band.npz")

    with pytest.raises(ft.InputError, match="along a route"):
        ft.mission(tmp_path / "band.npz")


@pytest.mark.parametrize("given", ["source", "fence"])
def test_volumes_do_not_replace_what_is_read(place, given):
    volumes = (place / "m.geojson").read_bytes()
    source, fences = (
        (place / "m.geojson", [])
        if given == "source"
        else (place / "m.plan", [place / "m.geojson"])
    )

    with pytest.raises(ft.InputError, match=r"volumes beside it must not replace .*m\.geojson"):
        ft.mission(source, fences=fences, turn_back=30, out=place / "m.npz", **FEW)

    assert (place / "m.geojson").read_bytes() == volumes
    assert names(place) == WRITTEN


@pytest.mark.parametrize(
    ("change", "one"),
    [
        ({"campaign": {"seed": 7, "runs": 5}, "runs": 90}, True),
        ({"campaign": {"seed": 1, "runs": 6}}, False),
        ({"gains": {"paper": 2}}, False),
        ({"aircraft": {"aerosonde": "1"}}, False),
        ({"nominal": {"route": {"wind_mps": 9.0}}}, False),
    ],
)
def test_plans_are_of_one_mission_where_only_seed_and_number_of_flights_differ(change, one):
    plan = {
        "gains": {"paper": 1}, "aircraft": {"aerosonde": "0"}, "runs": 40,
        "nominal": {"route": {"wind_mps": 8.0}}, "campaign": {"seed": 1, "runs": 5},
    }  # fmt: skip
    assert missions._of_one_mission(plan, {**plan, **change}) is one


@pytest.mark.parametrize(("lowest_m", "faults"), [((0.0, 3.0), []), ((0.5, -0.5), ["corridor"]),
                                                  ((-0.01, 1.0), ["path"])])  # fmt: skip
def test_a_path_or_a_corridor_below_the_ground_is_a_fault(monkeypatch, lowest_m, faults):
    seen = iter(lowest_m)
    monkeypatch.setattr(maps, "clearance", lambda *_: {"over_ground_m": next(seen)})
    monkeypatch.setattr(maps, "clearance_words", lambda subject, _: f"{subject} is there")
    band = SimpleNamespace(
        claims=True, about=SimpleNamespace(predicted_from=None), corridor=lambda: None
    )

    found = missions.over_ground(SimpleNamespace(where=None), "heights.tif", band)

    assert [x for said in found.faults for x in ("path", "corridor") if x in said] == faults
    assert len(found.changed) == 2 - len(faults)


def test_band_fence_and_room_share_the_confidence_and_a_fence_alone_has_all_of_it(place):
    shared = [ft.load(place / name).about.confidence for name in ("m.npz", "m-turn-back.npz")]
    alone = ft.mission(place / "m.plan", until_sure=True, **FEW).band

    assert shared == pytest.approx([1.0 - 0.1 / 3.0] * 2)
    assert alone.about.confidence == 0.9
