"""What a mission is told of its corridor and its fence: yes or no, odds, and the room there is."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_up import made_up_scenario
from made_up_band import count_of, plan_of_paper
from scipy.stats import binomtest

import flighttune as ft
from flighttune.claims import mission
from flighttune.outputs.answers import mission as answers
from flighttune.outputs.answers.answer import Answer
from flighttune.outputs.answers.band import answer, findings, lines
from flighttune.outputs.answers.finding import PartFinding, headlines
from flighttune.routes import maps

HALF, MIDDLE = (5.0, 2.0), (-1.234, 0.567)
"""m: a flight at the edge of the band is 6.234 m to the left and 2.567 m above."""

SCORES = np.concatenate([np.linspace(0.25, 1.0, 24), [2.0, 2.0, 3.0, 4.0, np.inf]])
"""Half-widths of 29 flights: five leave the band, one of which does not complete."""

ROUNDED_M = 0.11
"""Distances have one digit, and a fence has a margin of 5 cm."""


@pytest.fixture(scope="module")
def straight():
    waypoints = [{"north_m": north, "east_m": 0.0} for north in (0.0, 800.0)]
    flights = ft.flights("circuit", changes={"route.waypoint": waypoints})
    plan = flights.plan(plant="kinematic", gains="paper").with_runs(39)
    measured = ft.Band.measures.chosen(plan, None)
    return count_of(ft.Band, plan, measured, HALF, SCORES, MIDDLE, epsilon=0.3, confidence=0.9)


def fenced(band, east):
    """The band with a fence so far to both sides of its route, m."""
    corners = [(-200.0, -east), (-200.0, east), (1000.0, east), (1000.0, -east), (-200.0, -east)]
    ring = maps.on_earth(np.array(corners), (0.0, 0.0))[:, ::-1].tolist()
    area = {"type": "Polygon", "coordinates": [ring]}
    fence = {"type": "Feature", "properties": {}, "geometry": area}
    return replace(band, about=replace(band.about, fences=(fence,)))


def summary(band, *room):
    return [*headlines(findings(band)), *lines(band, *room)]


def bound(outside, confidence):
    return binomtest(outside, 29, alternative="less").proportion_ci(confidence, "exact").high


@pytest.mark.parametrize(
    ("east", "outside", "where", "room", "band_is"),
    [
        (30.0, 1, "come nearest to it on the leg to waypoint 2, 800 m along", 8.77, "inside"),
        (21.6, 1, "come nearest to it on the leg to waypoint 2, 800 m along", 0.37, "inside"),
        (12.0, 3, "The flight furthest out is", 9.23, "inside"),
        (6.6, 5, "The flight furthest out is", 14.63, "inside"),
        (3.9, 20, "They come furthest out on the leg to waypoint 2, 800 m al", 17.33, "not inside"),
    ],
)
def test_a_fence_is_kept_or_lacks_room_for_the_flight_furthest_to_the_left(
    straight, east, outside, where, room, band_is
):
    """It is 1.234 m + 4 half-widths, 21.234 m, to the left."""
    band = fenced(straight, east)

    whether, odds, wide, holds = summary(band)
    said = answer(band)

    kept = east > 6.0
    assert whether.startswith(
        "Yes: the mission can be flown and stays inside its fence."
        if kept
        else f"No: {outside} of 29 flights are not certainly inside the fence; at most 5 of 29 "
    )
    assert where in odds
    (metres,) = re.findall(r"(?:: |is )([\d.]+) m(?:\.| outside|, which)", odds)
    assert float(metres) == pytest.approx(room, abs=ROUNDED_M)
    if kept:  # the band and its fence share the confidence
        assert f"{outside} of 29 flights did" in odds
        (odds_at_most,) = re.findall(r"a probability of at most ([\d.]+), at a", odds)
        assert float(odds_at_most) == pytest.approx(bound(outside, 0.9), abs=1e-4)
        assert "at a confidence of 0.8 for all" in odds
    assert wide == (
        "The corridor is at most 6.24 m wide to either side of the path, and 2.57 m high above and "
        "below it."
    )
    assert holds.startswith("It holds for kinematic under the exact law at 25 m/s in calm air")
    assert f"The band itself is {band_is} the fence." in said.notes
    assert "The fence has no floor and no ceiling." in said.notes
    assert band.sentence in said.notes
    assert bool(said.verdict) == kept
    assert bool(said.failure) == (not kept)
    if not kept:
        assert said.failure.endswith("; 0.3 was asked for")
    assert "Of the flights 1 did not complete" in said.notes[-1]


def test_a_count_that_may_go_on_is_not_known_unless_too_many_are_outside(straight):
    """In so few flights, all within the band, none is outside 30 m, eleven are outside 3.9 m."""
    first = {"extremes": straight.extremes[:20], "wind": straight.wind[:20]}

    wide, narrow = (replace(fenced(straight, east), **first) for east in (30.0, 3.9))

    whether, odds, *_ = summary(wide)
    assert whether == (
        "Not known: 20 of 29 flights were flown; `flighttune band FILE --flights 29` flies the "
        "others."
    )
    assert odds.startswith("The completed flights come nearest to it on the leg to waypoint 2,")
    assert summary(narrow)[0].startswith("No: 11 of 20 flights are not certainly inside the fence")


@pytest.mark.parametrize(
    ("east", "said"),
    [
        (4.0, "No: a new flight is not certainly inside the fence with probability above 0.3"),
        (6.05, "Not known: `flighttune band FILE --flights 58` may be enough."),
        (30.0, "Yes: the mission can be flown and stays inside its fence."),
    ],
)
def test_a_count_that_ends_with_its_answer_says_no_if_that_is_sure(straight, east, said):
    """At 6.05 m seven of 29 flights are outside, too few for a no at 0.3 and too many for a yes."""
    band = fenced(straight, east)

    whether, _, wide, _ = summary(replace(band, about=replace(band.about, until_sure=True)))

    assert whether.startswith(said)
    assert wide == "No corridor is claimed."


def test_a_room_to_turn_back_shares_the_confidence_and_has_its_words(straight):
    room = SimpleNamespace(confidence=0.95)

    _, odds, wide, _ = summary(straight, room, "It has room.")

    assert "at a confidence of 0.85 for all that is said here" in odds
    assert wide.endswith(" above and below it. It has room.")
    flown = np.array([[1.0, 4.0], [3.0, 2.0]])
    assert summary(replace(straight, by_rtk=flown))[2].endswith(
        "below it. Flown by RTK, 2 flights kept to 3 m and 4 m."
    )


@pytest.mark.parametrize("missed", ["", "exits are too many"])
@pytest.mark.parametrize(("east", "left"), [(30.0, False), (3.9, True)])
def test_a_mission_fails_if_its_fence_or_its_target_per_hour_is_missed(
    straight, east, left, missed
):
    band, said = fenced(straight, east), ["The shares.", "Engines matter."]
    of_hours = [PartFinding(found="not met" if missed else "met", sentence="0.1/h.", reason=missed)]
    hourly = SimpleNamespace(
        answer=lambda: Answer(findings=of_hours, lines=said),
        table=SimpleNamespace(target_per_hour=1.0),
    )
    _, odds, wide, holds = summary(band)

    counted = mission.MissionOdds(band=band, files={}, per_hour=hourly).answer()

    assert bool(counted.failure) == (left or bool(missed))
    assert counted.failure == (missed or answer(band).failure)
    assert counted.summary[0].startswith("No: " if left or missed else "Yes: ")
    (shares, matters), n = said, len(counted.summary) - 5
    assert counted.summary[n:] == [matters, shares, odds, wide, holds]
    # a terminal has the lead and what a flight is for, and of an answer that is no its odds
    assert (odds in counted.aside) == (not left)
    assert {shares, wide} <= {*counted.aside}


def test_a_path_below_the_ground_is_a_no_beside_an_odds_that_holds(straight, monkeypatch):
    faults = ["the planned path is below the ground."]
    seen = mission.OverGround({"terrain": 1.0}, changed=["It is low."], faults=faults, notes=["n"])
    monkeypatch.setattr(answers, "over_ground", lambda *_: seen)

    band = fenced(straight, 30.0)
    _, odds, wide, holds = summary(band)
    said = mission.MissionOdds(band=band, files={}, way="It is so.").answer()

    first, kept, *others = said.summary
    assert first == f"No: {faults[0]}"
    assert kept.startswith("The mission can be flown")
    assert others == [f"{odds} It is so.", wide, holds]
    assert said.verdict == first
    assert said.failure == "the path or its corridor is below the ground"
    assert answer(band).verdict in said.notes
    lost = mission.MissionOdds(band=fenced(straight, 3.9), files={}).answer()
    assert lost.summary[0] == first


def test_a_corridor_without_a_fence_has_odds_and_none_is_claimed_for_too_many_lost(straight):
    yes, odds, *_ = summary(straight)
    lost = straight.extremes.copy()
    lost[:5] = -np.inf, np.inf
    no, ended, wide, _ = summary(replace(straight, extremes=lost))

    assert yes == "Yes: the mission can be flown. It has no fence to stay inside."
    assert odds == (
        "A new flight leaves its corridor with a probability of at most 0.3, at a confidence of "
        "0.9 for all that is said here: 5 of 29 flights did."
    )
    assert no.startswith("No: of 29 flights 6 did not complete")
    assert no.endswith("; at most 5 of 29 may.")
    assert ended.startswith("They ended so:")
    assert wide == "No corridor is claimed."


def test_widths_are_in_the_units_shown_and_none_are_claimed_for_too_many_lost(straight):
    flights = plan_of_paper(made_up_scenario()).with_runs(39)
    errors = count_of(
        ft.Band, flights, ft.Band.measures.chosen(flights, None), np.radians([2.0, 0.5]), SCORES,
        epsilon=0.3, confidence=0.9,
    )  # fmt: skip

    (beside, above), (chi, gamma) = (x.answer().tables[0].records for x in (straight, errors))
    assert [beside["largest"], above["largest"]] == pytest.approx(HALF, rel=1e-6)
    assert [beside["low"], beside["high"]] == pytest.approx([-6.234, 3.766], rel=1e-6)
    assert [above["low"], above["high"]] == pytest.approx([-1.433, 2.567], rel=1e-6)
    assert [beside["unit"], above["unit"]] == ["m", "m"]
    assert [chi["largest"], gamma["largest"]] == pytest.approx([2.0, 0.5], rel=1e-6)
    assert [x["unit"] for x in (chi, gamma)] == ["deg", "deg"]
    assert [x["signal"] for x in (chi, gamma)] == ["chi_err", "gamma_err"]
    values = errors.answer().values
    assert (values["status"], values["flights"]) == ("claimed", 29)
    assert values["nearest_draw"] == errors.draws[23]  # at the edge of the band
    lost = replace(errors, extremes=np.full_like(errors.extremes, np.inf)).answer()
    assert lost.tables[0].records == []
    assert lost.values["status"] == "nothing_claimed"
    assert lost.values["nearest_draw"] is None
    assert lost.verdict == ""
    assert lost.failure
