"""Charts of counts hold the band, its flights inside and outside, and the room to turn back."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_up_band import count_of

import flighttune as ft
from flighttune.claims import counted_flights, mission
from flighttune.claims.turn_back import TurnBack
from flighttune.outputs.answers import mission as answers
from flighttune.outputs.pages import counted

LARGEST = 5.0, 2.0  # m: cross track and height of a flight at the edge of the band
ROOM = 271.2, 3.4  # m
OUTSIDE = 2.0, 2.0, 3.0, 4.0, np.inf
SCORES = np.concatenate([np.linspace(0.25, 1.0, 24), OUTSIDE])
LAT, LON = 47.0, 8.0
SINGLE = 1e-6  # flights are kept in single precision


@pytest.fixture(scope="module")
def counts():
    """A band and a room to turn back of 29 flights along a corner, of which five are outside."""
    places = ((0.0, 0.0), (600.0, 0.0), (600.0, 500.0))
    changes = {"route.waypoint": [{"north_m": n, "east_m": e} for n, e in places]}
    changes |= {"route.lat_deg": LAT, "route.lon_deg": LON}
    flights = ft.flights("circuit", changes=changes).knowing("standard")
    plan = flights.plan(plant="kinematic", gains="paper").with_runs(39)

    def of(kind, plan, away):
        measured = kind.measures.chosen(plan, None)
        few = {"epsilon": 0.3, "confidence": 0.9}
        return count_of(kind, plan.with_runs(39), measured, away, SCORES, **few)

    return of(ft.Band, plan, LARGEST), of(TurnBack, counted_flights.turning_back(plan, 30.0), ROOM)


@pytest.mark.parametrize("k", [0, 1])
def test_a_band_is_drawn_with_its_flights_inside_outside_and_nearest(counts, k):
    band, _ = counts

    chart = counted.band_charts(band)[k]

    (_, low), (_, high), edge_low, edge_high, (xs, inside), (_, outside), (_, nearest) = chart._seen
    assert low == pytest.approx(-LARGEST[k], rel=SINGLE)
    assert high == pytest.approx(LARGEST[k], rel=SINGLE)
    assert edge_low[1] == pytest.approx(-LARGEST[k], rel=SINGLE)
    assert edge_high[1] == pytest.approx(LARGEST[k], rel=SINGLE)
    assert np.nanmax(inside) == pytest.approx(LARGEST[k], rel=SINGLE)
    assert np.nanmin(np.abs(inside)) == pytest.approx(0.25 * LARGEST[k], rel=SINGLE)
    assert np.nanmax(outside) == pytest.approx(4.0 * LARGEST[k], rel=SINGLE)
    assert np.nanmin(np.abs(outside)) == pytest.approx(2.0 * LARGEST[k], rel=SINGLE)
    assert np.abs(nearest) == pytest.approx(LARGEST[k], rel=SINGLE)
    gaps = np.isnan(inside).sum()
    assert gaps == 24  # a line of each flight
    assert (np.nanmin(xs), np.nanmax(xs)) == pytest.approx(band.flights.edges[[0, -1]] / 1e3)
    names = [name for name, *_ in chart.legend]
    assert names[1:3] == ["24 inside", "4 outside"]
    assert names[3] == f"draw {band.draws[23]}, nearest to leaving"
    assert "[m]" in chart.y


def test_of_many_flights_every_nth_inside_is_drawn_and_all_outside(counts, monkeypatch):
    monkeypatch.setattr(counted, "MIN_DRAWN", 8)

    chart = counted.band_charts(counts[0])[0]

    assert [name for name, *_ in chart.legend][1:3] == ["24 inside, 8 drawn", "4 outside"]
    assert np.isnan(chart._seen[4][1]).sum() == 8
    assert np.isnan(chart._seen[5][1]).sum() == 4


def test_a_mission_shows_its_map_and_heights_before_its_signals(counts):
    band, room = counts

    chart, heights, *others = counted.mission_charts(band, room)

    assert [x.title for x in others] == [x.title for x in counted.band_charts(band)]
    planned = heights._seen[-1]
    assert planned[0][-1] == pytest.approx(band.flights.route.where[0].length / 1e3)
    assert "planned" in [name for name, *_ in heights.legend]
    corridor = [y - planned[1][0] for x, y in heights._seen if len(x) > 1][:2]
    assert np.nanmin(corridor) == pytest.approx(-LARGEST[1], rel=SINGLE)
    assert np.nanmax(corridor) == pytest.approx(LARGEST[1], rel=SINGLE)
    widths = [volume.width for volume in room.volumes(band).values()]
    assert widths == sorted(widths)
    assert widths[0] == pytest.approx(LARGEST[0], rel=0.5)
    names = [name for name, *_ in chart.legend]
    assert [*room.volumes(band)] == [name for name in names if name in room.volumes(band)]
    north = max(float(np.nanmax(y)) for _, y in chart._seen)
    assert north >= 600.0 + widths[-1] - 1.0
    alone = [name for name, *_ in counted.mission_charts(band)[0].legend]
    assert not {*room.volumes(band)} & {*alone}


def fence(west, floor, ceiling):
    """GeoJSON of a box around the route, to `west` of its first leg, m."""

    def at(north, east):
        # At 47 deg a degree of longitude is 76.06 km on WGS 84, and one of latitude 111.17 km.
        return [LON + east / 76060.0, LAT + north / 111170.0]

    ring = [at(*x) for x in ((-300, -west), (-300, 900), (900, 900), (900, -west), (-300, -west))]
    ends = {"min_up_m": floor, "max_up_m": ceiling}
    area = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": ends, "geometry": area}
    return {"type": "FeatureCollection", "features": [feature]}


def test_fences_are_told_apart_with_the_place_and_room_of_what_is_nearest_to_them(counts):
    """Completed flights are up to 20 m to the left of the route and 8 m below it."""
    band, _ = counts
    fences = fence(60.0, -90.0, 300.0), fence(200.0, -50.0, 150.0)
    fenced = replace(band, about=replace(band.about, fences=fences))

    chart, heights, *_ = counted.mission_charts(fenced)

    names = [name for name, *_ in chart.legend]
    assert names[-4:] == ["fence 1", "nearest to it: 40 m", "fence 2", "nearest to it: 42 m"]
    (west, _), (east, north), (other, _), _ = chart._seen[-4:]
    assert np.nanmin(west) == pytest.approx(-60.0, abs=0.2)
    assert np.nanmin(other) == pytest.approx(-200.0, abs=0.2)
    assert east == pytest.approx(0.0, abs=0.01)  # on the first leg
    assert 0.0 <= north[0] <= 600.0
    dashes = [dash for name, _, dash in chart.legend if name.startswith("fence")]
    assert len({*dashes}) == 2
    assert [y[0] for _, y in heights._seen[-4:]] == [300.0, -90.0, 150.0, -50.0]
    one = replace(band, about=replace(band.about, fences=fences[:1]))
    assert "fence" in [name for name, *_ in counted.mission_charts(one)[0].legend]


def test_the_room_to_turn_back_is_drawn_around_the_flights_that_stayed_in_it(counts):
    _, room = counts

    chart = counted._room(room)

    (across, up), (far, high), (edge_x, edge_y) = chart._seen
    assert across == pytest.approx(ROOM[0] * SCORES[:24], rel=SINGLE)
    assert up == pytest.approx(ROOM[1] * SCORES[:24], rel=SINGLE)
    assert far == pytest.approx(ROOM[0] * np.array(OUTSIDE[:4]), rel=SINGLE)
    assert high == pytest.approx(ROOM[1] * np.array(OUTSIDE[:4]), rel=SINGLE)
    assert [name for name, *_ in chart.legend] == ["24 inside", "4 outside", "the room"]
    assert edge_x == pytest.approx([0.0, room.room.from_route, room.room.from_route])
    assert edge_y == pytest.approx([room.room.height, room.room.height, 0.0])
    # in whole metres, rounded up
    assert (room.room.from_route, room.room.height) == (272.0, 4.0)


def test_a_mission_with_a_room_spends_the_confidence_of_both(counts):
    band, room = counts

    said = mission.MissionOdds(band=band, files={}).with_room(room).answer()

    assert said.values["confidence"] == pytest.approx(band.confidence + room.confidence - 1.0)
    assert said.values["turn_back"]["terms"] == room.terms(band)
    (terms,) = answers.terms_table(room, band)
    assert terms.title == answers.TERMS
    assert terms in said.tables
    assert said.failure == ""
    alone = mission.MissionOdds(band=band, files={}).answer()
    assert "turn_back" not in alone.values
    lost = replace(room, extremes=np.full_like(room.extremes, np.nan))
    assert not lost.claims
    assert answers.terms_table(lost, band) == []
    failed = mission.MissionOdds(band=band, files={}).with_room(lost).answer()
    assert failed.failure.startswith("room to turn back: ")
    assert room.answer().tables[0].title in [table.title for table in said.tables]
    ended = replace(band, extremes=np.full_like(band.extremes, np.inf))
    of_band = mission.MissionOdds(band=ended, files={}).with_room(lost).answer()
    assert of_band.failure == ended.answer().failure
    files = {"room": "r.npz"}
    named = mission.MissionOdds(band=band, files=files, file=Path("m.npz"), room=room).answer()
    notes = " ".join(named.notes)
    assert "flighttune verify m.npz --run" in notes
    assert "flighttune verify r.npz --run" in notes
    assert " ".join(said.notes).count("flighttune verify FILE --run") == 2
