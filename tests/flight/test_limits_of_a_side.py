"""Limits that differ to either side: each holds for its own, and the lesser where both matter."""

import pytest
from made_up import made_up_scenario

import flighttune as ft


@pytest.mark.parametrize(
    ("limits", "same"),
    [
        ({"phi_deg": [-30.0, 45.0]}, {"phi_deg": [-30.0, 30.0]}),
        ({"phi_deg": [-45.0, 30.0]}, {"phi_deg": [-30.0, 30.0]}),
        ({"phi_rate_dps": [-20.0, 90.0]}, {"phi_rate_dps": 20.0}),
        ({"phi_rate_dps": [-90.0, 20.0]}, {"phi_rate_dps": 20.0}),
    ],
)
def test_a_route_turns_to_either_side_by_the_lesser_limit(limits, same):
    both = {"phi_deg": [-40.0, 40.0], "phi_rate_dps": 60.0}
    points = [(0.0, 0.0), (900.0, 0.0), (900.0, 900.0), (2000.0, 900.0)]
    waypoints = [{"north_m": north, "east_m": east} for north, east in points]
    tables = made_up_scenario(flight={"duration_s": 300.0}).as_dict() | {
        "route": {"waypoint": waypoints}
    }
    del tables["reference"]
    lengths = [
        ft.route(ft.scenario_from({**tables, "limits": {**both, **change}})).reference.path.length
        for change in (limits, same, {})
    ]
    assert lengths[0] == lengths[1]
    assert abs(lengths[0] - lengths[2]) > 1.0
