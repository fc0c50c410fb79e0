"""The loop that a tube encloses has the numbers of the scenario, of either law."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from made_up import made_up_scenario
from made_up_tubes import tube, tube_scenario

import flighttune as ft
from flighttune.claims.tubes import tube as tubes
from flighttune.claims.tubes.proof import settled_from

FLIGHT = {
    "V_a_mps": 23.0, "g_mps2": 9.7, "chi_deg": -8.0, "gamma_deg": 3.0, "phi_deg": 6.0, "n_z": 1.1,
    "duration_s": 2.0,
}  # fmt: skip


LEG = [{"north_m": north, "east_m": 0.0} for north in (0.0, 600.0)]


def loop_of(law="paper", plant="kinematic", **tables):
    gains = {"name": "own", "K_P": [[1.5, 0.0], [0.0, 1.2]], "K_I": [[0.5, 0.0], [0.0, 0.4]]}
    if law == "exact":
        gains["law"] = "exact"
    scenario = made_up_scenario(
        flight=FLIGHT, reference={"chi_deg": 2.0, "gamma_deg": 5.0}, gains=[gains],
        law=[{"name": law, "kind": law}], plant=[{"kind": plant}],
        controller={"rate_hz": 40.0, **tables.pop("controller", {})}, **tables,
    )  # fmt: skip
    return tubes.stated_problem(scenario).loop


@pytest.mark.parametrize(
    ("law", "plant", "exact"),
    [("paper", "kinematic", False), ("paper", "point_mass", True), ("exact", "point_mass", True)],
)
def test_the_loop_of_a_tube_has_the_numbers_of_the_flight(law, plant, exact):
    loop = loop_of(law, plant)

    assert (loop.dt, loop.V_a, loop.g) == (1.0 / 40.0, 23.0, 9.7)
    chi, gamma, phi, n_z = loop.start
    for found, stated in ((chi, -8.0), (gamma, 3.0), (phi, 6.0)):
        assert np.mean(found) == pytest.approx(math.radians(stated), abs=1e-9)
    assert n_z == pytest.approx(1.1)
    assert loop.exact == exact
    assert loop.lags == ()
    assert (loop.law.inverts is not None) == (law == "exact")
    assert not loop.law.feed_forward
    assert loop.law.conditional
    assert loop.reference[0, :2] == pytest.approx(np.radians([2.0, 5.0]))
    assert len(loop.reference) == 1 + 2 * 40  # the first and the last


@pytest.mark.parametrize(("ahead", "lift"), [(False, 0.0), (True, math.cos(math.radians(5.0)))])
def test_a_feed_forward_adds_the_lift_of_the_reference_path(ahead, lift):
    loop = loop_of(controller={"feed_forward": ahead, "anti_windup": "none"})

    assert loop.law.feed_forward == ahead
    assert not loop.law.conditional
    assert loop.reference[:, -1] == pytest.approx(np.full(len(loop.reference), lift))


@pytest.mark.parametrize(
    ("of", "place", "by"),
    [
        ("reference", 1, 0.1),  # the path angle alone
        ("reference", 5, 0.1),  # its rate alone
        ("boxes", (1, 0), -0.1),
        ("boxes", (0, 1), 0.1),
        (None, 0, 0.0),
    ],
)
def test_a_loop_has_settled_after_its_last_change_or_wider_box(of, place, by):
    loop = loop_of(disturbance={"chi_amplitude": 0.2, "gamma_amplitude": 0.1})
    changed = {"reference": loop.reference.copy(), "boxes": loop.boxes.copy()}
    changed["boxes"][3] *= 0.5  # within the last
    for row in changed[of][:8] if of else ():
        row[place] += by
    moving, turning = loop.reference.copy(), loop.reference.copy()
    moving[-1, 0] += 0.1
    turning[:, 5] = 0.1

    assert settled_from(replace(loop, **changed)) == (8 if of else 0)
    for reference in (moving, turning):
        assert settled_from(replace(loop, reference=reference)) == len(reference)


@pytest.mark.parametrize(("chi", "gamma"), [(0.2, -0.1), (-0.1, 0.2)])
def test_disturbances_reach_either_side_and_are_no_smaller_than_those_of_the_scenario(chi, gamma):
    turn = tube_scenario(duration_s=0.1).as_dict()
    turn["disturbance"] = {"chi_amplitude": chi, "gamma_amplitude": gamma}
    turn = ft.scenario_from(turn)

    low, high = tubes.stated_problem(turn, ft.PAPER_GAINS).disturbances
    assert high == pytest.approx(np.tile(np.abs([chi, gamma]), (6, 1)))
    assert low == pytest.approx(-high)
    low, high = tubes.stated_problem(turn, ft.PAPER_GAINS, disturbance=0.25).disturbances
    assert (low.tolist(), high.tolist()) == ([[-0.25, -0.25]] * 6, [[0.25, 0.25]] * 6)
    with pytest.raises(ft.InputError, match=r"`disturbance` must be at least .* 0.2 rad/s"):
        tubes.stated_problem(turn, ft.PAPER_GAINS, disturbance=0.15)


def test_starts_are_within_an_eighth_of_a_turn():
    with pytest.raises(ft.InputError, match=r"`start` must lie in 0..45 deg, got 45 deg"):
        tubes.stated_problem(tube_scenario(), ft.PAPER_GAINS, start=math.pi / 4)
    with pytest.raises(ft.InputError, match=r"`start` must lie in 0..45 deg"):
        tubes.stated_problem(tube_scenario(), ft.PAPER_GAINS, start=-0.01)


@pytest.mark.parametrize(
    ("start", "places"), [(0.0, {(0, 0)}), (0.05, {(0, 0), *product((-1, 1), repeat=2)})]
)
def test_flights_from_the_middle_and_all_corners_of_the_starts_must_be_inside(start, places):
    enclosure = tube(tube_scenario(duration_s=0.1), ft.PAPER_GAINS, start=start, for_ever=False)
    middle = enclosure.bounds.pairs[0].mean(axis=1)

    def leaving(bounds):
        flown = tubes.flights_against(replace(enclosure, bounds=bounds))
        assert (flown.flights, flown.drawn, flown.outside_boxes) == (len(places), 0, 0)
        return flown.leave

    assert leaving(enclosure.bounds) == 0
    for chi, gamma in places:
        low, high = enclosure.bounds.low.copy(), enclosure.bounds.high.copy()
        # Without this corner of the starts
        for i, side in enumerate((-chi, -gamma)):  # an error is the reference minus the angle
            if side:
                (high if side > 0 else low)[0, i] = middle[i] + 0.5 * side * start
        if (chi, gamma) == (0, 0):
            low[0, 0] = middle[0] + 1e-4 + start
        assert leaving(replace(enclosure.bounds, low=low, high=high)) >= 1


def test_a_route_has_no_tube():
    tables = tube_scenario().as_dict() | {"route": {"waypoint": LEG}}
    del tables["reference"]

    with pytest.raises(ft.InputError, match="`route` must be absent for a tube"):
        tubes.stated_problem(ft.scenario_from(tables), ft.PAPER_GAINS)


@pytest.mark.parametrize(
    ("chi", "gamma", "words"),
    [
        (0.02, -0.02, "any disturbance of at most 0.02 rad/s, in"),
        (0.02, 0.005, "any disturbance of at most 0.02 rad/s of χ and 0.005 rad/s of γ, in"),
        (0.0, 0.005, "any disturbance of at most 0 rad/s of χ and 0.005 rad/s of γ, in"),
        (0.0, 0.0, "from its start, in"),
    ],
)
def test_a_claim_is_of_the_disturbances_of_each_rate_that_its_sets_contain(chi, gamma, words):
    turn = tube_scenario(chi_err_deg=15.0, gamma_deg=15.0, duration_s=0.1).as_dict()
    turn["disturbance"] = {"chi_amplitude": chi, "gamma_amplitude": gamma}

    found = tube(ft.scenario_from(turn), ft.PAPER_GAINS, for_ever=False)

    assert words in found.sentence
