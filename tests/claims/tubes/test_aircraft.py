"""An aircraft's tube: its conformant model under every disturbance in the boxes."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from commands import flighttune
from counted_turns import ALONE, count
from dispersed import uniform
from flown_campaigns import flown_here
from fuzzing import check_cases, few_or_many, first_or_all
from hypothesis import strategies as st
from made_up import scenario_file
from made_up_band import ROLL, ROLL_CHANGE, WIDE, boxes_of, counted_boxes
from made_up_tubes import (
    FEW_PIECES,
    aircraft_scenario,
    arrays_of,
    claim_of,
    disturbed_flight,
    rewritten,
    tube,
    tube_scenario,
)

import flighttune as ft
from flighttune.claims import verbs
from flighttune.claims.counted_flights import plan_of
from flighttune.claims.shape import LEAST
from flighttune.claims.tubes import tube as tubes
from flighttune.claims.tubes.enclosure import load_tube
from flighttune.gaps.residual import residual_rates


@pytest.mark.soak
@pytest.mark.parametrize("feed_forward", first_or_all([True, False]))
def test_the_aircraft_flies_inside_its_tube_which_is_proven_again(tmp_path, feed_forward):
    scenario = aircraft_scenario(feed_forward=feed_forward, duration_s=0.4)

    found = tube(scenario, ft.PAPER_GAINS, band=counted_boxes(scenario), for_ever=False)

    assert found.status == "bounded"
    flown = tubes.flights_against(found)
    assert (flown.outside_boxes, flown.leave) == (0, 0)
    assert "probability at most 0.05" in found.problem.model
    assert "with probability at most 0.05" in found.answer().notes[-1]
    found.save(tmp_path / "tube.npz")
    assert ft.verify(tmp_path / "tube.npz").valid


@pytest.mark.soak
def test_a_set_that_is_lost_bounds_no_flight(tmp_path):
    """At the ends of its boxes the rates are those of a tight turn."""
    scenario = aircraft_scenario(duration_s=1.5)

    lost = tube(scenario, ft.PAPER_GAINS, band=counted_boxes(scenario, half_width=1.0))

    said = lost.answer()
    assert (lost.status, lost.probability) == ("unbounded", None)
    assert 0 < len(lost.bounds.t) < len(lost.problem.t)
    assert said.failure == lost.reason
    assert any("`flighttune band` bounds such flights" in note for note in said.notes)
    assert not any("leaves the tube with" in note for note in said.notes)
    with pytest.raises(ft.InputError, match="must be bounded"):
        lost.save(tmp_path / "tube.npz")


@pytest.mark.slow
def test_in_wind_the_start_must_be_stated():
    calm = aircraft_scenario(duration_s=0.1)
    windy = ft.scenario_from(calm.as_dict() | {"wind": {"speed_mps": 3.0, "from_deg": 90.0}})
    boxes = counted_boxes(windy, half_width=10.0 * WIDE)

    assert tube(windy, ft.PAPER_GAINS, band=boxes, for_ever=False).status == "bounded"
    with pytest.raises(ft.InputError, match="`wind` must be stated"):
        tube(calm, ft.PAPER_GAINS, band=boxes)


@pytest.mark.slow
def test_boxes_that_are_not_given_are_counted_from_the_starts_of_the_tube(monkeypatch):
    class Counted(Exception):
        pass

    def residual(_, **options):
        raise Counted(options["start_deg"])

    monkeypatch.setattr(verbs, "residual", residual)

    with pytest.raises(Counted) as counted:
        ft.tube(aircraft_scenario(), "paper", plant="jsbsim:aerosonde", start=np.deg2rad(2.0))
    assert counted.value.args == (pytest.approx(2.0),)


@pytest.mark.parametrize("chi_deg", [(2.0, 7.0), (1.0, 6.0)])
def test_starts_are_those_of_the_boxes(chi_deg):
    """The course starts at 4 deg, 2 deg from the nearer end."""
    scenario = aircraft_scenario(duration_s=0.1)
    known = counted_boxes(scenario)
    starts = uniform("flight.chi_deg", *chi_deg), uniform("flight.gamma_deg", -3.0, 3.0)
    wider = counted_boxes(scenario, WIDE, ROLL, *starts)

    with pytest.raises(ft.InputError, match=r"`start`.* 0 deg.*`flight.chi_deg`"):
        tube(scenario, ft.PAPER_GAINS, band=known, start=0.01)
    found = tube(scenario, ft.PAPER_GAINS, band=wider, start=0.03, for_ever=False)
    assert found.status == "bounded"
    with pytest.raises(ft.InputError, match=r"`start`.* 2 deg.*2.292 deg"):
        tube(scenario, ft.PAPER_GAINS, band=wider, start=0.04)


@pytest.mark.parametrize(
    ("start_deg", "of", "words"),
    [
        (1.9, "residual_rates", "the residual rates of a flight .* leave their boxes with "),
        (2.0, "flight", "a flight of .* leaves the tube with "),
        (2.2, "flight", "a flight of .* leaves the tube with "),
    ],
)
def test_only_a_tube_from_all_starts_counted_bounds_flights(start_deg, of, words):
    """The course starts 2 deg to either side, and so does the path angle."""
    scenario = aircraft_scenario(duration_s=0.1)
    starts = uniform("flight.chi_deg", 2.0, 6.0), uniform("flight.gamma_deg", -2.0, 2.0)
    known = counted_boxes(scenario, WIDE, ROLL, *starts)
    problem = SimpleNamespace(
        band=known, scenario=scenario, table=scenario.plant[0], start=np.deg2rad(start_deg)
    )

    counted = ft.Tube.probability.fget(SimpleNamespace(problem=problem, status="bounded"))

    assert (counted.of, counted.at_most) == (of, 0.05)
    assert re.fullmatch(f"{words}probability at most 0.05, confidence 0.99", counted.sentence)


@pytest.fixture(scope="module")
def known():
    """Boxes of the flights of the aircraft's scenario."""
    return counted_boxes(aircraft_scenario())


PLANT = "jsbsim:aerosonde"
TWICE = ft.PIGains(K_P=2.0 * ft.PAPER_GAINS.K_P, K_I=ft.PAPER_GAINS.K_I)
NEAR_I = ft.PIGains(K_P=ft.PAPER_GAINS.K_P, K_I=1.001 * ft.PAPER_GAINS.K_I)
NEAR = ft.PIGains(K_P=1.001 * ft.PAPER_GAINS.K_P, K_I=ft.PAPER_GAINS.K_I)
SCHEDULED = aircraft_scenario().as_dict()
SCHEDULED["controller"]["schedule"] = True


@pytest.mark.parametrize(
    ("scenario", "options", "words"),
    [
        (aircraft_scenario(), {"gains": TWICE}, r"`K_P`.*paper"),
        (aircraft_scenario(), {"gains": NEAR}, r"`K_P`.*paper"),
        (aircraft_scenario(), {"gains": NEAR_I}, r"`K_I`.*paper"),
        (aircraft_scenario(chi_err_deg=5.0), {}, r"`flight.chi_deg`.*4.0.*5.0"),
        (aircraft_scenario(), {"disturbance": 0.1}, "`disturbance` must not be given"),
        (aircraft_scenario(), {"band": None, "plant": PLANT}, "`boxes` must be given"),
        (ft.scenario_from(SCHEDULED), {}, r"schedule` must be False, got True"),
        (tube_scenario(), {}, "of kind jsbsim"),
    ],
)
def test_what_the_boxes_say_nothing_about_is_refused(known, scenario, options, words):
    with pytest.raises(ft.InputError, match=words):
        tube(scenario, **{"gains": ft.PAPER_GAINS, "band": known, **options})


def test_the_path_over_ground_begins_as_stated_though_the_aircraft_points_into_the_wind():
    """The aircraft flies at 25 m/s through air that comes from 60 deg at 3 m/s."""
    wind = {"wind": {"speed_mps": 3.0, "from_deg": 60.0, "down_mps": 0.5}}
    climb = ft.scenario_from(aircraft_scenario(gamma_deg=3.0, duration_s=0.1).as_dict() | wind)

    problem = tubes.stated_problem(climb, ft.PAPER_GAINS, band=counted_boxes(climb))

    assert problem.path_at_start == pytest.approx(np.deg2rad([4.0, 3.0]))
    air = problem.entry.condition
    crosswind = 3.0 * np.sin(np.deg2rad(60.0 - 4.0))
    assert 25.0 * np.cos(air.gamma) * np.sin(air.chi - np.deg2rad(4.0)) == pytest.approx(crosswind)


def test_boxes_are_of_the_aircraft_that_was_counted_with_the_files_it_has(known):
    other = aircraft_scenario().as_dict() | {"plant": [{"kind": "jsbsim", "aircraft": "c172p"}]}
    files = dict.fromkeys(known.flights.aircraft, "0" * 64)
    changed = replace(known, flights=replace(known.flights, aircraft=files))

    words = "`aircraft` must be aerosonde with the files it was flown with, got"
    with pytest.raises(ft.InputError, match=f"{words} c172p"):
        tube(ft.scenario_from(other), ft.PAPER_GAINS, band=known)
    with pytest.raises(ft.InputError, match=f"{words} aerosonde"):
        tube(aircraft_scenario(), ft.PAPER_GAINS, band=changed)


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    """The file of a tube, and that of the band its boxes come from."""
    scenario = aircraft_scenario(duration_s=0.1, feed_forward=True)
    folder = tmp_path_factory.mktemp("proof")
    boxes = counted_boxes(scenario)
    boxes.save(folder / "boxes.npz")
    tube(scenario, ft.PAPER_GAINS, band=boxes, for_ever=False).save(folder / "tube.npz")
    return folder / "tube.npz", folder / "boxes.npz"


UNCHECKED = "that an aircraft keeps the boxes in the file is not checked"


@pytest.mark.slow
def test_without_its_band_a_tube_is_proven_for_the_boxes_in_the_file_alone(proof):
    # Named from its own folder: the number in the path of a temporary one can be any.
    stdout, _ = flighttune("verify", proof[0].name, cwd=proof[0].parent)
    found, _ = flighttune("verify", proof[0], "--json")

    assert UNCHECKED in " ".join(stdout.split())
    assert not re.search("probability|confidence|259|made up.*drawn", stdout)
    found = json.loads(found)
    assert (found["valid"], found["claim"]["aircraft_checked"]) == (True, False)
    assert found["claim"]["counted"] is None
    assert "probability" not in found["claim"]["model"]


@pytest.mark.soak
def test_boxes_whose_flights_are_made_up_are_refused_with_the_tube(proof):
    stdout, stderr = flighttune("verify", proof[0], "--boxes", proof[1], status=1)

    assert "claimed, not proven" in stdout
    assert "flights of the band that are flown again must be equal to the bit" in stderr
    with pytest.raises(ft.InputError, match="`boxes` must be given"):
        ft.verify(ft.load(proof[1]), boxes=proof[1])


@pytest.mark.soak
def test_with_its_band_boxes_are_rebuilt_and_flown_again(tmp_path):
    scenario = aircraft_scenario(duration_s=0.3, feed_forward=True)
    path = scenario_file(tmp_path / "flight.toml", scenario)
    boxes = count(path, kind=ft.residual, flights=ALONE, start_deg=1.0, gains="paper")
    found = tube(scenario, ft.PAPER_GAINS, band=boxes, for_ever=False)
    found.save(tmp_path / "tube.npz")
    narrow = replace(boxes, extremes=np.float32(0.01) * boxes.extremes)

    with flown_here():
        verified = ft.verify(tmp_path / "tube.npz", boxes=boxes)
        of_narrow = tube(scenario, ft.PAPER_GAINS, band=narrow, for_ever=False)
        forged = ft.verify(of_narrow)

    assert verified.valid
    assert verified.checks
    assert verified.claim.problem.aircraft_checked is True
    assert "All 10 flights learned from were flown again" in verified.verification.notes[0]
    assert not forged.valid


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "claim", "name"),
    [(0.1, {}, "boxes"), (1.0, {"band_sha256": "0" * 64}, "band_sha256")],
)
def test_boxes_other_than_those_counted_are_refused(proof, tmp_path, factor, claim, name):
    boxes = {"boxes": factor * arrays_of(proof[0])["boxes"]}
    path = rewritten(proof[0], boxes, tmp_path / "forged.npz", **claim)

    assert load_tube(path).problem.aircraft_checked is False
    with pytest.raises(ft.InputError, match=rf"forged\.npz: `{name}` must"):
        load_tube(path, ft.load(proof[1]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arrays", "claim", "words"),
    [
        ({"boxes": None}, {"band_sha256": None}, "`boxes` must be given"),
        ({}, {"plant": "kinematic"}, r"`boxes`.*kinematic"),
    ],
)
def test_boxes_and_an_aircraft_go_together(proof, tmp_path, arrays, claim, words):
    if "plant" in claim:
        scenario = claim_of(proof[0])["scenario"] | {"plant": [{"kind": claim["plant"]}]}
        claim = {**claim, "scenario": scenario}
    path = rewritten(proof[0], arrays, tmp_path / "forged.npz", **claim)

    with pytest.raises(ft.InputError, match=words):
        load_tube(path)


@pytest.mark.slow
def test_flights_outside_their_boxes_are_against_the_boxes_and_not_against_the_tube(tmp_path):
    scenario = aircraft_scenario(duration_s=0.3, ramp_dps=1.0)
    path = scenario_file(tmp_path / "flight.toml", scenario)
    # The aircraft leaves boxes that are this narrow.
    counted_boxes(scenario, half_width=1e-7).save(tmp_path / "boxes.npz")
    options = "--gains", "paper", "--boxes", tmp_path / "boxes.npz"

    stdout, stderr = flighttune(
        "tube", path, *options, "--out", tmp_path / "tube.npz", "--json", status=1
    )

    found = json.loads(stdout)
    assert (found["inside"], found["flown"]["outside_boxes"]) == (True, 1)
    assert "boxes" in stderr
    assert "tube, so it is wrong" not in stderr
    assert not list(tmp_path.glob("tube.*"))


BESIDE = uniform("flight.chi_deg", 3.0, 5.0), uniform("flight.gamma_deg", -1.0, 1.0)


@pytest.mark.slow
def test_a_flight_is_judged_by_a_tube_as_far_as_the_tube_claims_something_of_it():
    """The boxes are wide, or so narrow that every flight leaves them."""
    scenario = aircraft_scenario(duration_s=0.1)
    wide, narrow = (counted_boxes(scenario, half, ROLL, *BESIDE) for half in (WIDE, 1e-7))
    of_wide, of_narrow = (
        tube(scenario, ft.PAPER_GAINS, band=boxes, start=np.deg2rad(0.5), for_ever=False)
        for boxes in (wide, narrow)
    )
    wrong = replace(of_wide, bounds=replace(of_wide.bounds, high=of_wide.bounds.low))
    lost = replace(of_narrow, bounds=replace(of_narrow.bounds, high=of_narrow.bounds.low))

    flown = [tubes.flights_against(one) for one in (of_wide, wrong, lost)]
    assert [(one.flights, one.drawn) for one in flown] == [(13, 8)] * 3
    assert [(one.outside_boxes, one.leave) for one in flown] == [(0, 0), (0, 13), (13, 0)]
    assert [bool(tubes.boxes_refuted(of_wide, one)) for one in flown] == [False, False, True]

    (run,) = ft.fly(scenario, gains=["paper"]).runs
    for found, claimed, inside in (
        (of_wide, True, True),
        (wrong, True, False),
        (lost, False, False),
    ):
        assert not found.why_not(run)
        claim = found.on(run)
        assert (not claim.no_claim, claim.contains(run.signals)) == (claimed, inside)
    start = {**scenario.as_dict()["flight"], "chi_deg": 4.9}
    far = ft.scenario_from(scenario.as_dict() | {"flight": start})
    (far,) = ft.fly(far, gains=["paper"]).runs
    assert "flight.chi_deg" in of_wide.why_not(far)


@pytest.mark.soak
def test_the_tube_of_starts_beside_ramps_is_of_the_flights_that_its_boxes_were_counted_on():
    scenario = aircraft_scenario(duration_s=1.2, ramp_dps=3.0, feed_forward=True)
    few = {"epsilon": 0.3, "confidence": 0.9, "learn": 20, "flights": 22, "start_deg": 1.0}

    found = tube(
        scenario, ft.PAPER_GAINS, band=ft.residual(scenario, gains="paper", **few),
        start=np.deg2rad(1.0), for_ever=False,
    )  # fmt: skip

    flown = tubes.flights_against(found)
    assert found.probability.of == "flight"
    assert (flown.leave, tubes.boxes_refuted(found, flown)) == (0, "")
    assert flown.drawn_outside_boxes < flown.drawn


FLIGHTS = 4
SAME = 1e-6
"""rad/s: the residual rates of a flight are found again to the error of integration."""

RATE = st.floats(-0.03, 0.03)
LAGS = [
    one.lags for name in ("aerosonde", "a4") for one in ft.loop.load_identified(name).conditions
]


class Disturbed(ft.loop.PointMassPlant):
    """The model under a disturbance that is constant over each sample, shape (samples, 2).

    Its controller sees `beyond` more roll at each sample.
    """

    def __init__(self, lags, rates, beyond, g):
        self._left, self._now = iter(rates.tolist()), (0.0, 0.0)
        self._beyond = iter(beyond.tolist())
        super().__init__(lags, disturbance=lambda _: self._now, g=g)

    def advance(self, *commands):
        self._now = tuple(next(self._left))
        return super().advance(*commands)

    def observe(self):
        chi, gamma, phi, *rest = super().observe()
        return (chi, gamma, phi + next(self._beyond), *rest)


def roll_beyond(samples, rng):
    """Goes to and fro in its box, as fast as its change may."""
    turns = np.repeat(rng.choice([-1.0, 1.0], samples), rng.choice([1, 5, 40]))[:samples]
    beyond = [rng.uniform(-ROLL, ROLL)]
    for turn in turns[1:]:
        beyond.append(float(np.clip(beyond[-1] + turn * ROLL_CHANGE, -ROLL, ROLL)))
    return np.array(beyond)


@st.composite
def conformant(draw):
    """A scenario of an aircraft, and its model with lags as identified and boxes made up."""
    scenario = aircraft_scenario(
        chi_err_deg=draw(st.floats(-40.0, 40.0)),
        gamma_deg=draw(st.floats(-20.0, 30.0)),
        gamma_ref_deg=draw(st.floats(-20.0, 30.0)),
        roll_dps=draw(st.floats(10.0, 60.0)),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        feed_forward=draw(st.booleans()),
        ramp_dps=draw(st.one_of(st.none(), st.floats(-8.0, 8.0))),
    )
    known = counted_boxes(scenario)
    windows = len(known.flights.edges) - 1
    ends = np.array(draw(st.lists(RATE, min_size=4, max_size=4))).reshape(2, 2)
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    alike = draw(st.sampled_from([1, 5, 25]))  # windows in a row with the same box
    scale = np.repeat(rng.random((2, windows, 2)), alike, axis=1)[:, :windows]
    scale = scale * np.sort(ends, axis=0)[:, None]
    rest = np.tile([ROLL, ROLL_CHANGE], (windows, 1))
    low, high = np.hstack([scale.min(axis=0), -rest]), np.hstack([scale.max(axis=0), rest])
    model = replace(known.model, lags=draw(st.sampled_from(LAGS)))
    measured, centre = replace(known.measured, model=model), 0.5 * (low + high)
    flights = replace(known.flights, measured=measured)
    half = np.maximum(0.5 * (high - low), LEAST)
    return scenario, boxes_of(plan_of(known), flights, centre, half)


def check_conformant(case, seed):
    scenario, known = case
    problem = tubes.stated_problem(scenario, ft.PAPER_GAINS, band=known)
    found = tubes.tube_of(problem, attempts=FEW_PIECES, for_ever=False)
    rng, model = np.random.default_rng(seed), known.model
    boxes = known.bounds(problem.t)
    low, high = boxes.low[:-1, :2], boxes.high[:-1, :2]
    for _ in range(FLIGHTS):
        share = rng.random(low.shape) if rng.random() < 0.5 else rng.choice([0.0, 1.0], low.shape)
        rates = low + share * (high - low)
        beyond = roll_beyond(len(problem.t), rng)
        plant = Disturbed(model.lags, rates, beyond, scenario.flight.g_mps2)
        signals, start = disturbed_flight(problem, plant=plant)
        again = residual_rates(
            model,
            problem.controller().dt,
            signals[["chi", "gamma"]].to_numpy(),
            signals[["phi_cmd", "n_z_cmd"]].to_numpy(),
            (start.phi, start.n_z_start),
        )
        assert again == pytest.approx(rates, abs=SAME)
        assert found.bounds.contain(signals)


@pytest.mark.soak
@few_or_many(5, 250)
def test_no_flight_in_the_boxes_leaves_the_tube(count):
    check_cases(check_conformant, conformant(), count)


def test_a_box_begins_at_its_sample_whatever_the_rounding_of_its_time():
    band = counted_boxes(aircraft_scenario(duration_s=0.4))
    edges, wider = band.flights.edges, 1.0 + np.arange(len(band.about.half))
    grown = replace(band, about=replace(band.about, half=band.about.half * wider[:, None]))

    for rounding in (-1e-12, 0.0, 1e-12):
        high = grown.bounds(edges[:-1] + rounding).high
        assert high == pytest.approx(grown.half_widths)
