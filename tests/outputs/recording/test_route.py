"""What a recording shows of a route and of bands."""

import re
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from claimed import SENTENCE, claimed

import flighttune as ft
from flighttune.outputs.recording.page import scenario_page
from flighttune.outputs.recording.plots import shown_plots
from flighttune.outputs.recording.record import write_recording

from .test_rrd import Contents, blueprint_values

KEY = "kinematic_paper"

FLOAT32 = 1e-3
"""Positions are float32 in Rerun: 0.03 mm at 500 m, m."""

BESIDE = 2.5
"""Cross-track written into the run, in place of what it flew, m."""

LEG = 500.0
"""Length of the first leg, towards east, m."""

# In m: at most 3 to the left of the route and 5 to its right, 1 too high and 2 too low.
BAND = {"cross_track": (-3.0, 5.0), "height_err": (-1.0, 2.0)}

SCENARIO = {
    "title": "East, then south",
    "gains": ["paper"],
    "flight": {"V_a_mps": 25.0, "h_m": 100.0, "duration_s": 200.0},
    "route": {
        "waypoint": [
            {"north_m": 0.0, "east_m": 0.0},
            {"north_m": 0.0, "east_m": LEG},
            {"north_m": -LEG, "east_m": LEG},
        ]
    },
    "limits": {"phi_deg": [-45.0, 45.0], "phi_rate_dps": 60.0},
    "plant": [{"kind": "kinematic"}],
}


@pytest.fixture(scope="module")
def run():
    (run,) = ft.fly(ft.scenario_from(SCENARIO)).runs
    beside = replace(run, signals=run.signals.assign(cross_track=BESIDE))
    return claimed(beside, **BAND)


def contents_of(run, folder):
    path = folder / "route.rrd"
    write_recording([run], path, page="", title="Route")
    return Contents(path)


@pytest.fixture(scope="module")
def contents(run, tmp_path_factory):
    return contents_of(run, tmp_path_factory.mktemp("route"))


def test_the_corridor_is_the_band_to_the_right_of_the_path_and_below_it(contents):
    walls = contents.static[f"/world/route/corridor/{KEY}/walls"]
    corners = np.array(walls["Mesh3D:vertex_positions"].to_pylist()[0]).reshape(-1, 4, 3)
    (section,) = corners[np.isclose(corners[:, 0, 1], 200.0)]

    # Towards east the left is north. Down is positive.
    upper_left, lower_right = [3.0, 200.0, -1.0], [-5.0, 200.0, 2.0]
    assert section[0] == pytest.approx(upper_left, abs=FLOAT32)
    assert section[2] == pytest.approx(lower_right, abs=FLOAT32)
    assert section[1] == pytest.approx([-5.0, 200.0, -1.0], abs=FLOAT32)
    assert section[3] == pytest.approx([3.0, 200.0, 2.0], abs=FLOAT32)
    last = corners[-1].mean(
        axis=0
    )  # the band is wider to the right, and on a leg south that is west
    assert last == pytest.approx([-LEG, LEG - 1.0, 0.5], abs=FLOAT32 * LEG)


def test_waypoints_are_where_the_scenario_has_them_with_their_numbers(contents):
    marks = contents.static["/world/route/waypoints"]

    assert marks["Points3D:positions"].to_pylist() == [[[0, 0, 0], [0, LEG, 0], [-LEG, LEG, 0]]]
    assert marks["Points3D:labels"].to_pylist() == [["WP1", "WP2", "WP3"]]


def names_of(contents):
    names = ("ViewBlueprint:display_name", "ContainerBlueprint:display_name")
    return {name for place in names for (name,) in blueprint_values(contents, place)}


@pytest.mark.slow
def test_a_route_has_a_map_only_where_its_place_is_known(contents, run, tmp_path):
    place = {**SCENARIO, "route": {**SCENARIO["route"], "lat_deg": 47.0, "lon_deg": 8.0}}
    ring = [[7.99, 46.99], [8.01, 46.99], [8.01, 47.01], [7.99, 46.99]]
    (claim,) = run.claims
    known = replace(run, provenance=replace(run.provenance, scenario=place))
    known = replace(known, claims=(replace(claim, fences=(ring,)),))
    on_map = contents_of(known, tmp_path)
    (points,) = on_map.static["/map/_waypoints"]["GeoPoints:positions"].to_pylist()

    assert names_of(on_map) - names_of(contents) == {"OpenStreetMap"}
    assert not [path for path in contents.static if path.startswith("/map")]
    # At 47 deg a degree of longitude is 76.06 km on WGS 84, and one of latitude 111.17 km.
    assert points[0] == pytest.approx([47.0, 8.0])
    assert points[2] == pytest.approx([47.0 - 0.5 / 111.17, 8.0 + 0.5 / 76.06], abs=1e-5)
    ((fence,),) = on_map.static["/map/_fence"]["GeoLineStrings:line_strings"].to_pylist()
    assert fence == [[lat, lon] for lon, lat in ring]
    ((left, right),) = on_map.static[f"/map/_corridor/{KEY}"][
        "GeoLineStrings:line_strings"
    ].to_pylist()
    # Towards east the left is north.
    assert left[0][0] - 47.0 == pytest.approx(3e-3 / 111.17, abs=1e-8)
    assert 47.0 - right[0][0] == pytest.approx(5e-3 / 111.17, abs=1e-8)


@pytest.mark.slow
def test_a_band_is_dashed_around_any_signal_in_the_unit_of_the_signal(four_runs, tmp_path):
    run = claimed(four_runs[1], chi_err=(-0.2, 0.1), V_a=(24.0, 26.0))
    drawn = contents_of(run, tmp_path)
    course = drawn.values("/plots/chi_err/jsbsim_aerosonde_paper_claim_0")
    speed = drawn.values("/plots/V_a/jsbsim_aerosonde_paper_claim_0")

    assert np.nanmin(course, axis=0) == pytest.approx(np.rad2deg([-0.2, 0.1]))
    assert np.nanmax(speed, axis=0) == pytest.approx([24.0, 26.0])
    assert 0.2 < np.isnan(course).mean() < 0.4
    assert "/plots/gamma_err/jsbsim_aerosonde_paper_claim_0" not in drawn.timed


def test_a_tube_is_named_with_its_air_and_a_band_is_explained_beside_it(four_runs):
    run = claimed(four_runs[1], "proven", "tube in wind", chi_err=(-0.01, 0.01))
    run = claimed(run, chi_err=(-0.2, 0.1))
    page = scenario_page([run], scenario={"title": "Tube"})
    (heading,) = [p.heading for p in shown_plots([run])["Tracking"] if p.signal == "chi_err"]

    assert f"Tube in wind: {SENTENCE}." in page
    assert f"Counted band: {SENTENCE}." in page
    assert heading == "chi error [deg], tube in wind thin, counted band dashed"


def test_the_page_has_the_scenario_as_toml_that_flies_again(four_runs):
    scenario = four_runs[0].provenance.scenario
    (text,) = re.findall(
        r"```toml\n(.*?)```", scenario_page(four_runs, scenario=scenario), re.DOTALL
    )

    assert tomllib.loads(text) == scenario
