"""Reading takes a time in proportion to the size of a file, whatever is wrong in it."""

import pytest
from fuzzing import limited, marked
from readers import read_fence, read_parameters, read_route

import flighttune as ft

# Processor time that one of these files may take, s: each takes below half of it, and minutes where
# all of it is searched for each part of it.
MOST_S = 4.0
ROOM = 1 << 30

RING = "[[8,47],[9,47],[9,48],[8,47]]"
POINT = '{"type":"Point"}'
CIRCLE = '{"circle":{"center":[47,8],"radius":100}}'
ITEM = '{"type":"SimpleItem","command":16,"frame":3,"params":[0,0,0,0,47,8,1]}'


def shape(kind, inside, stated=""):
    return f'{{"type":"Feature","geometry":{{"type":"{kind}",{inside}}}{stated}}}'


def keys(count):
    return ",".join(f'"k{i}":0' for i in range(count))


FILES = {
    "KML inside itself": (
        "x.kml",
        read_route,
        lambda: f"<kml>{'<LineString>' * 40_000}{'</LineString>' * 40_000}</kml>",
    ),
    "KML of depth": ("x.kml", read_route, lambda: f"{'<a>' * 300_000}{'</a>' * 300_000}"),
    "KML of shapes": (
        "x.kml",
        read_route,
        lambda: f"<kml>{'<LineString><coordinates/></LineString>' * 12_000}</kml>",
    ),
    "a key twice": ("x.geojson", read_route, lambda: f'{{{keys(100_000)},"k99999":0}}'),
    "many collections": (
        "x.geojson",
        read_route,
        lambda: (
            shape("GeometryCollection", f'"geometries":[{",".join([POINT] * 15_000)}]')[:-1]
            + f",{keys(15_000)}}}"
        ),
    ),
    "collections inside each other": (
        "x.geojson",
        read_route,
        lambda: (
            f'{{"type":"Feature","geometry":{"".join(["{" + OPENS] * 200)}'
            f"{','.join([POINT] * 100_000)}{']}' * 200}}}"
        ),
    ),
    "a ring of corners": (
        "x.geojson",
        read_fence,
        lambda: shape("Polygon", f'"coordinates":[[{",".join(["[8,47],[9,47]"] * 20_000)}]]'),
    ),
    "many rings": (
        "x.geojson",
        read_fence,
        lambda: shape("Polygon", f'"coordinates":[{",".join([RING] * 10_000)}]'),
    ),
    "circles of a fence": (
        "x.plan",
        read_fence,
        lambda: f'{{"geoFence":{{"circles":[{",".join([CIRCLE] * 20_000)}]}}}}',
    ),
    "items of a plan": (
        "x.plan",
        read_route,
        lambda: (
            '{"mission":{"plannedHomePosition":[47,8,1],"items":'
            f"[{','.join([ITEM] * 12_000)}]}}}}"
        ),
    ),
    "lines of items": ("x.waypoints", read_route, lambda: "QGC WPL 110\n" + "1 0\n" * 300_000),
    "corners in lines": ("x.fen", read_fence, lambda: "47 8\n" * 300_000),
    "parameters": (
        "x.param",
        read_parameters,
        lambda: "\n".join(f"P{i},1" for i in range(200_000)),
    ),
    "wrong keys": (
        "x.toml",
        ft.load_scenario,
        lambda: "\n".join(f"k{i} = 1" for i in range(20_000)),
    ),
    "wrong values": ("x.toml", ft.load_scenario, lambda: f"gains = [{'1,' * 20_000}]"),
    "wrong tables": ("x.toml", ft.load_scenario, lambda: "[[expect]]\nplant = 1\n" * 8_000),
    "too many values": ("x.toml", ft.load_scenario, lambda: f"gains = [{'1,' * 400_000}]"),
    "wrong keys of a campaign": (
        "x.toml",
        ft.load_campaign,
        lambda: "\n".join(f"k{i} = 1" for i in range(20_000)),
    ),
}
LARGE = {"parameters", "too many values", "a ring of corners", "items of a plan"}
OPENS = '"type":"GeometryCollection","geometries":['


@pytest.mark.parametrize("name", marked(FILES, pytest.mark.soak, but={*FILES} - LARGE))
@pytest.mark.slow
def test_a_large_file_of_mistakes_is_refused_in_a_time_like_its_size(tmp_path, name):
    file, read, text = FILES[name]
    (tmp_path / file).write_text(text())

    with limited(MOST_S, ROOM), pytest.raises(ft.InputError) as refusal:
        read(tmp_path / file)
    assert len(str(refusal.value).splitlines()) == 1


def test_values_that_are_all_wrong_are_counted_and_not_listed():
    """A list of what each lacks would take 3 kB a value."""
    with pytest.raises(ft.InputError) as refusal:
        ft.scenario_from({"title": "x", "gains": [1] * 5_000})

    assert str(refusal.value).endswith("it must be a Scenario, got 10002 wrong values.")
