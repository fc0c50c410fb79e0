"""No flight leaves a tube: laws, plants, gains, limits and references as Hypothesis finds them."""

import ast
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from enclosed import (
    DELAYS,
    EXACT,
    EXACT_LAW,
    FED_BACK,
    KINEMATIC,
    LAGS,
    POINT,
    QUICK,
    all_stay,
    changed,
    flown,
    manoeuvre,
)
from forging import changed as forged
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from small_claims import PROVEN, proven

import flighttune as ft

DEG = np.pi / 180.0
D = 0.002


@st.composite
def problems(draw, reach_deg=40.0):
    """A tube's scenario and gains: the paper's law, also behind lags, or the exact law."""
    exact = draw(st.booleans())
    plant = draw(st.sampled_from([KINEMATIC, POINT, LAGS, LAGS | DELAYS]))
    reach = 6.0 if exact else reach_deg
    own, cross = (0.5, 1.6) if exact else (0.5, 3.0), 0.2
    K_P, K_I = (
        [[draw(st.floats(*own)) if i == j else draw(st.floats(-cross, cross)) for i in (0, 1)]
         for j in (0, 1)]
        for _ in "PI"
    )  # fmt: skip
    more = {}
    if exact:
        fed = st.floats(0.0, 0.6)
        feedback = draw(st.sampled_from([(0.0, 0.0), (draw(fed), draw(fed))]))
        more = {"inputs": EXACT.inputs, "feedback": feedback}
    scenario = manoeuvre(
        plant, exact=exact, duration_s=0.3,
        chi_deg=draw(st.floats(-reach, reach)),
        gamma_deg=draw(st.floats(-10.0, 15.0) if exact else st.floats(-30.0, 40.0)),
        gamma_ref_deg=draw(st.floats(-10.0, 15.0)),
        roll_deg=draw(st.floats(10.0, 60.0)), roll_dps=draw(st.floats(5.0, 200.0)),
        n_z=draw(st.floats(1.3, 3.0)), n_z_per_s=draw(st.floats(0.3, 20.0)),
        rate_hz=draw(st.sampled_from([20.0, 50.0, 100.0])),
        anti_windup=draw(st.sampled_from(["conditional", "none"])),
        feed_forward=draw(st.booleans()), ramp_dps=draw(st.floats(0.5, 8.0)),
    )  # fmt: skip
    return scenario, ft.PIGains(K_P=K_P, K_I=K_I, **more)


def check(case, seed):
    rng = np.random.default_rng(seed)
    start, disturbance = rng.choice([0.0, 0.2, 1.0]) * DEG, rng.choice([0.0, 0.002, 0.02])
    found = ft.tube(*case, start=start, disturbance=disturbance or None)
    assert found.reason == "" or "wrong" not in found.reason
    assert all_stay(found, disturbance, rng)


@pytest.mark.soak
@settings(max_examples=4)
@given(case=problems(), seed=st.integers(0, 999))
def test_no_flight_leaves_the_tube(case, seed):
    check(case, seed)


@pytest.mark.soak
@settings(max_examples=25)
@given(case=problems(120.0), seed=st.integers(0, 10**6))
def test_no_flight_leaves_any_of_many_tubes(case, seed):
    check(case, seed)


# Each kind of loop, with how far flights start beside, and how far they are pushed.
LOOPS = {
    "law": (manoeuvre(chi_deg=15.0, gamma_deg=15.0, ramp_dps=1.0), ft.PAPER_GAINS, 0.0, 0.02),
    "starts": (manoeuvre(chi_deg=12.0, feed_forward=False, anti_windup="none", ramp_dps=1.0),
               ft.PAPER_GAINS, 0.005, 0.0),
    "lags": (manoeuvre(LAGS | DELAYS, chi_deg=8.0, ramp_dps=1.0), ft.PAPER_GAINS, 0.002, 0.01),
    "point mass": (manoeuvre(POINT, chi_deg=8.0, gamma_deg=20.0, ramp_dps=1.0),
                   ft.PAPER_GAINS, 0.0, 0.02),
    "exact": (manoeuvre(POINT, exact=True, chi_deg=5.0, gamma_deg=3.0, ramp_dps=1.0),
              EXACT, 0.002, 0.01),
    "fed back": (manoeuvre(LAGS, exact=True, chi_deg=2.0, gamma_deg=2.0, duration_s=0.3,
                           ramp_dps=1.0), FED_BACK, 0.002, 0.005),
}  # fmt: skip


@pytest.mark.parametrize("loop", LOOPS)
def test_flights_of_each_kind_of_loop_stay_and_come_near_its_bounds(loop):
    """Pushed to either side all the time, they use a part of the width."""
    scenario, gains, start, disturbance = LOOPS[loop]
    found = ft.tube(scenario, gains, start=start, disturbance=disturbance or None)

    assert found.status == "bounded"
    assert all_stay(found, disturbance, np.random.default_rng(1), flights=12)
    ends = [
        flown(found, (side * start, side * start), disturbance, 9.0, Always(side)).iloc[-1]
        for side in (-1.0, 1.0)
    ]
    for i, name in enumerate(("chi_err", "gamma_err")):
        reached = abs(ends[0][name] - ends[1][name])
        assert reached > 0.4 * np.ptp(found.bounds.pairs[-1, i])


class Always:
    """Draws one side alone."""

    def __init__(self, side):
        self.side = side

    def choice(self, _, count):
        return np.full(count, self.side)


@pytest.mark.parametrize("loop", ["law", "lags", "fed back"])
def test_a_mirrored_manoeuvre_has_a_mirrored_tube(loop):
    scenario, gains, start, disturbance = LOOPS[loop]
    chi_deg = scenario.as_dict()["flight"]["chi_deg"]
    mirrored, M = changed(scenario, flight={"chi_deg": -chi_deg}), np.diag([-1.0, 1.0])
    coupled = replace(gains, K_P=M @ gains.K_P @ M, K_I=M @ gains.K_I @ M)
    around = {"start": start, "disturbance": disturbance or None}

    one = ft.tube(scenario, gains, **around).bounds
    other = ft.tube(mirrored, coupled, **around).bounds

    sign = np.array([-1.0, 1.0, -1.0, 1.0])
    ends = np.sort(sign[:, None] * other.pairs, axis=-1)
    assert ends == pytest.approx(one.pairs, abs=2e-2 * np.ptp(one.pairs[:, :2], axis=-1).max())


@pytest.mark.slow
@pytest.mark.parametrize("loop", ["law", "exact"])
def test_more_disturbance_and_more_starts_make_a_tube_wider(loop):
    scenario, gains, start, disturbance = LOOPS[loop]

    widths = [
        ft.tube(scenario, gains, start=a * start, disturbance=b * disturbance).bounds.half_widths
        for a, b in ((0.5, 0.5), (0.5, 1.0), (1.0, 1.0))
    ]

    for less, more in pairwise(widths):
        assert (more[:, :2] >= less[:, :2] * (1.0 - 1e-6)).all()
    assert (widths[2][-1, :2] > 1.5 * widths[0][-1, :2]).all()


# deg: without a disturbance, a tube from one start is as wide as what is not followed exactly
NARROW_DEG = 0.03
PLANNED = {
    "chi_deg": [{"shape": "ramp", "start_s": 0.2, "duration_s": 9.0, "roll_in_s": 0.3,
                 "rate_dps": 3.0}],
    "gamma_deg": [{"shape": "ramp", "start_s": 0.2, "duration_s": 9.0, "roll_in_s": 0.3,
                   "rate_dps": -4.0}],
}  # fmt: skip
BRIEF = {"chi_deg": 1.0, "gamma_deg": 2.0, "rate_hz": 25.0, "duration_s": 0.8, "ramp_dps": 1.0}


@pytest.mark.soak
@pytest.mark.parametrize(
    ("scenario", "gains"),
    [
        *((changed(manoeuvre(plant, **{**BRIEF, "feed_forward": planned}), reference=PLANNED),
           ft.PAPER_GAINS) for plant in (LAGS, KINEMATIC) for planned in (True, False)),
        (manoeuvre(POINT, exact=True, **{**BRIEF, "chi_deg": 6.0}, anti_windup="none",
                   roll_dps=10.0), EXACT),
        (manoeuvre(LAGS, exact=True, **{**BRIEF, "chi_deg": 0.5}, anti_windup="none",
                   roll_dps=10.0), FED_BACK),
        (manoeuvre(**{**BRIEF, "chi_deg": 60.0}, roll_deg=20.0, n_z_per_s=50.0, roll_dps=400.0),
         ft.PAPER_GAINS),
        (manoeuvre(**{**BRIEF, "gamma_deg": 60.0, "gamma_ref_deg": 60.0}, n_z_per_s=0.3),
         ft.PAPER_GAINS),
    ],
)  # fmt: skip
def test_the_tube_of_one_flight_is_that_flight(scenario, gains):
    found = ft.tube(scenario, gains)

    assert found.status == "bounded"
    assert found.bounds.contain(flown(found))
    assert np.rad2deg(np.ptp(found.bounds.pairs[:, :2], axis=2)).max() < NARROW_DEG


def test_a_disturbed_sample_holds_the_flights_that_scipy_integrates():
    """Level flight at a constant roll and load factor, pushed by a constant rate for a sample."""
    push, h = 0.2, 0.2
    level = manoeuvre(chi_deg=0.0, gamma_deg=40.0, gamma_ref_deg=40.0, rate_hz=1.0 / h,
                      duration_s=2 * h, feed_forward=False, n_z=3.0)  # fmt: skip
    found = ft.tube(level, ft.PAPER_GAINS, disturbance=push)
    signals = flown(found)
    n_z, phi, rate = signals["n_z_cmd"].iloc[0], signals["phi_cmd"].iloc[0], 9.81 / 25.0

    ends = [
        solve_ivp(
            lambda _, x, off=off: rate * (n_z * np.cos(phi) - np.cos(x)) + off,
            (0.0, h), [40.0 * DEG], rtol=1e-12, atol=1e-12,
        ).y[0, -1]
        for off in (-push, push)
    ]  # fmt: skip
    low, high = found.bounds.pairs[1, 1]  # of the reference minus the path angle
    assert low < 40.0 * DEG - max(ends)
    assert high > 40.0 * DEG - min(ends)
    # A rate that may change at once adds a quarter of its range in a sample to either side, and
    # the enclosure of so long a sample less than half as much again.
    assert 2.0 * push * h * 1.5 < high - low < 2.0 * push * h * 2.2


# ---------------------------------------------------------------- why a set is not bounded
def lost(plant=KINEMATIC, gains=ft.PAPER_GAINS, start=0.0, disturbance=None, **how):
    """The reason of the tube of a manoeuvre."""
    with_law = {"exact": True} if gains is not ft.PAPER_GAINS else {}
    how = {"ramp_dps": 1.0, **with_law, **how}
    return lambda _: ft.tube(manoeuvre(plant, **how), gains, start=start, disturbance=disturbance)


def of_file(name, **change):
    """The reason of a file whose arrays were changed."""
    return lambda path: ft.verify(
        forged(
            proven(name), path, **{key: of(proven_array(name, key)) for key, of in change.items()}
        )
    )


def proven_array(name, key):
    with np.load(proven(name)) as arrays:
        return arrays[key]


BRAKES = {"law": [{**EXACT_LAW, "braking": 0.01, "brakes_turns": True}]}
STEEP_ROLL = ft.PIGains(K_P=np.diag([2.0, 1.0]), K_I=0.1 * np.eye(2), inputs=EXACT.inputs)
ALIKE = 1.0 + 1e-15 * np.random.default_rng(1).normal(size=(8, 8))
REASONS = {
    "the set of the hand-over has no inverse":
        of_file("settled", ever_W=lambda _: ALIKE, ever_size=lambda _: np.full(8, 1e9)),
    "that no limit holds a command is not proven":
        of_file("settled", ever_size=lambda x: 30.0 * x),
    "the course error can pass half a turn": lost(chi_deg=179.9, start=0.01),
    "the flight-path angle cannot be kept inside 85 deg":
        lost(POINT, gamma_deg=84.0, gamma_ref_deg=84.0, n_z=3.0, disturbance=0.2),
    "roll cannot be kept inside 89.4 deg": lost(disturbance=3.0),
    "the vertical lift wanted can be at its floor": lost(gains=EXACT, gamma_deg=70.0),
    "the lift wanted can be more than the largest load factor":
        lost(gains=EXACT, chi_deg=60.0, n_z=1.3),
    "the roll wanted can be next to 90 deg":
        lost(gains=STEEP_ROLL, chi_deg=170.0, gamma_deg=18.3, n_z=50.0, start=0.002),
    "the course error can be so large that the law brakes":
        lost(gains=STEEP_ROLL, chi_deg=20.0, gamma_deg=0.0, **BRAKES),
    "the path-angle error can be so large that the law brakes":
        lost(gains=EXACT, chi_deg=0.0, gamma_deg=10.0, **BRAKES),
}  # fmt: skip
# What no manoeuvre comes to: choices that split without end, and a step that is too long for a lag,
# though each is chosen by the lag.
GUARDS = "pieces are split too often in one sample", "a lag moves too far in a sample"


@pytest.mark.parametrize("reason", REASONS)
def test_a_set_that_is_lost_says_why_and_from_when_on(reason, tmp_path):
    found = REASONS[reason](tmp_path / "forged.npz")

    assert reason in found.reason
    if isinstance(found, ft.Tube):
        assert (found.status, " from t = " in found.reason) == ("unbounded", True)
        assert len(found.bounds.t) < len(found.problem.t)
        assert found.reason in found.answer().failure
        assert found.reason in found.sentence
        assert all_stay(found, 0.0, np.random.default_rng(0), flights=2)
        with pytest.raises(ft.InputError, match="must be bounded"):
            found.save(tmp_path / "lost.npz")


def test_each_reason_why_a_set_is_lost_has_a_manoeuvre_that_gives_it():
    said = {
        max((part.value for part in ast.walk(call.args[0]) if isinstance(part, ast.Constant)),
            key=len).strip()
        for file in (Path(ft.__file__).parent / "claims/tubes").glob("*.py")
        for call in ast.walk(ast.parse(file.read_text("utf-8")))
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "Unbounded" and call.args
    }  # fmt: skip

    assert len(said) >= 10
    known = *REASONS, *(f"{x} to be enclosed" for x in GUARDS)
    assert [x for x in said if not any(x in reason for reason in known)] == []


@pytest.mark.soak
@pytest.mark.parametrize(
    ("tables", "gains", "disturbance", "said"),
    [
        pytest.param({"plant": POINT, "gamma_deg": 70.0, "gamma_ref_deg": 70.0, "n_z": 3.0,
                      "ramp_dps": 1.0, "duration_s": 0.8}, ft.PAPER_GAINS, 0.5, True,
                     marks=pytest.mark.slow),
        # a sample of a second is longer than the time in which a width may double
        ({"rate_hz": 1.0, "duration_s": 4.0}, QUICK, 1.0, False),
    ],
)  # fmt: skip
def test_from_when_on_a_lost_set_doubles_is_said_where_samples_are_close(
    tables, gains, disturbance, said
):
    found = ft.tube(manoeuvre(**tables), gains, disturbance=disturbance)

    assert found.status == "unbounded"
    assert ("the width doubles within 0.2 s" in found.reason) == said


# ---------------------------------------------------------------- after the end of the scenario
SETTLING = manoeuvre(chi_deg=0.3, gamma_deg=15.2, gamma_ref_deg=15.0, duration_s=12.0, rate_hz=1.0)
NAMES = ("chi_err", "gamma_err", "phi_cmd", "n_z_cmd")


@pytest.fixture(scope="module")
def settled():
    return ft.tube(SETTLING, QUICK, disturbance=D)


@pytest.mark.parametrize("held_s", [200.0, 1.0, 3.0, 7.0])
def test_flights_ten_times_as_long_stay_inside_for_ever(settled, held_s):
    signals = flown(Longer(settled), (0, 0), D, held_s, np.random.default_rng(3))

    after = signals[signals.index > 12.0]
    assert len(after) > 100
    for name, (low, high) in zip(NAMES, settled.hand_over.bounds, strict=True):
        assert after[name].between(low, high).all()
    assert not after[["phi_limited", "n_z_limited"]].to_numpy().any()


class Longer:
    """A tube's problem, of flights that last ten times as long."""

    def __init__(self, tube):
        self.gains = tube.problem.gains
        self.scenario = changed(tube.problem.scenario, flight={"duration_s": 120.0})

    @property
    def problem(self):
        return self


@pytest.mark.slow
def test_bounds_for_ever_are_those_of_the_tube_of_a_longer_flight(settled):
    longer = ft.tube(changed(SETTLING, flight={"duration_s": 36.0}), QUICK, disturbance=D)

    after = longer.bounds.pairs[longer.bounds.t > 12.0, :2]
    widths = after[..., 1].max(axis=0) - after[..., 0].min(axis=0)
    ever = np.ptp(settled.hand_over.bounds[:2], axis=1)
    assert (0.99 * widths < ever).all()
    assert (ever < 1.25 * widths).all()
    said = settled.half_widths
    assert [said[x]["ever"] for x in ("chi", "gamma")] == pytest.approx(0.5 * ever / DEG)
    assert 1.0 <= settled.handed_over < 12.0


@pytest.mark.parametrize("moves", ["reference", "gains"])
def test_nothing_is_claimed_for_ever_of_what_still_moves(moves):
    """A ramp at the end, and a loop that never settles."""
    ramp = [{"shape": "ramp", "start_s": 2.0, "rate_dps": 0.1, "duration_s": 9.0}]
    scenario = changed(SETTLING, flight={"duration_s": 4.0})
    if moves == "reference":
        scenario = changed(scenario, reference={"gamma_deg": ramp})
    wild = ft.PIGains(K_P=60.0 * np.eye(2), K_I=np.eye(2))

    found = ft.tube(scenario, QUICK if moves == "reference" else wild, disturbance=D)

    assert (found.hand_over, found.handed_over) == (None, None)


# ---------------------------------------------------------------- files that are kept
def test_each_kind_of_loop_has_a_file_that_is_proven_again():
    assert {x.stem for x in PROVEN.glob("*.npz")} >= {"law", "lags", "exact", "fed_back", "settled"}


@pytest.mark.parametrize("name", sorted(x.stem for x in PROVEN.glob("*.npz")))
def test_a_tube_of_an_earlier_day_is_still_proven(name):
    """Its bounds were written with a margin of 1e-9 rad over those that were proven."""
    verified = ft.verify(proven(name))

    assert verified.valid, verified.reason
    assert [x.margin for x in verified.checks] == pytest.approx([1e-9] * 4, rel=1e-3)


@pytest.mark.parametrize("name", sorted(x.stem for x in PROVEN.glob("*.npz")))
def test_a_tube_is_found_again_as_it_was_on_an_earlier_day(name):
    """As wide at each sample: to prove less is no fault, but is not to happen unnoticed."""
    kept = ft.load(proven(name))
    of = kept.problem

    found = ft.tube(of.scenario, of.gains, start=of.start, disturbance=of.disturbance or None)

    wider = kept.bounds.pairs - found.bounds.pairs
    assert wider == pytest.approx(np.broadcast_to([-1e-9, 1e-9], wider.shape), rel=1e-3)
    assert (found.can_limit == kept.can_limit).all()
    assert found.handed_over == kept.handed_over
    if kept.hand_over is not None:
        ever = kept.hand_over.bounds - found.hand_over.bounds
        assert ever == pytest.approx(np.broadcast_to([-1e-9, 1e-9], ever.shape), rel=1e-3)
