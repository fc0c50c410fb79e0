"""One command for a mission: its corridor, and the probability that it leaves its own fence."""

import pytest
from commands import answer, flighttune
from plans import item, plan_file, waypoint

import flighttune as ft

# the fewest flights that can support a claim of the band and its fence: 0.7^9 <= 0.1 / 2
FEW = ("--epsilon", 0.3, "--confidence", 0.9, "--flights", 9)

AT_ONCE = (*FEW, "--set", 'gains=["paper"]', "--set", 'law=["paper"]')


AREA = [[47.39, 8.49], [47.39, 8.53], [47.42, 8.53], [47.42, 8.49]]


def mission(path, area=AREA):
    """Take-off at 47.4 N, 445 m to the north and 450 m to the east, in an area."""
    fence = {"version": 2, "circles": [], "polygons": [{"inclusion": True, "polygon": area}]}
    return plan_file(
        path,
        item(22, 15, 0, 0, None, 47.4, 8.5, 60),
        item(178, 0, 26, -1, 0, 0, 0, 0, frame=2),
        waypoint(47.404, 8.5, 70),
        waypoint(47.404, 8.506, 70),
        geoFence=fence,
        rallyPoints={"points": [[47.401, 8.505, 70]], "version": 2},
    )


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


@pytest.mark.slow
@pytest.mark.parametrize(("more", "got"), [({}, "no fence"), ({"turn_back": 30}, "`turn_back`")])
def test_what_is_not_about_a_fence_alone_is_not_counted_until_it_is_sure(tmp_path, more, got):
    source = mission(tmp_path / "m.plan") if more else "circuit_in_wind"
    with pytest.raises(ft.InputError, match=f"`until_sure` must be about a fence alone, got {got}"):
        ft.mission(source, until_sure=True, **more)
