"""After the time of the scenario: the set that flights stay in for ever."""

import re

import mpmath
import numpy as np
import pytest
from made_up_tubes import (
    BRAKING_LATE,
    arrays_of,
    claim_of,
    disturbed_flight,
    rewritten,
    tube,
    tube_scenario,
)
from scipy.linalg import hilbert

import flighttune as ft
from flighttune.claims.tubes import interval, proof
from flighttune.claims.tubes import tube as tubes
from flighttune.claims.tubes.problem import QUANTITIES
from flighttune.flight.loop.disturbance import Sinusoid

pytestmark = pytest.mark.slow

D = 0.002

# A loop that settles within three samples, a second apart
QUICK = ft.PIGains(K_P=3.0 * np.eye(2), K_I=1.5 * np.eye(2))
SAMPLES = 13

# Times the duration of the scenario, of flights that must stay inside
LONGER = 10

# Times the width of the tube of a longer flight, of bounds for ever
WIDER = 1.25


@pytest.fixture(scope="module")
def scenario():
    return tube_scenario(chi_err_deg=0.3, gamma_deg=15.2, duration_s=SAMPLES - 1.0, rate_hz=1.0)


def lasting(scenario, times):
    tables = scenario.as_dict()
    tables["flight"]["duration_s"] *= times
    return ft.scenario_from(tables)


@pytest.fixture(scope="module")
def found(scenario):
    return tube(scenario, QUICK, disturbance=D)


@pytest.fixture(scope="module")
def path(found, tmp_path_factory):
    path = tmp_path_factory.mktemp("tube") / "tube.npz"
    found.save(path)
    return path


def test_bounds_for_ever_are_of_the_samples_after_the_end_and_of_the_second_round():
    after_end, passed = np.zeros((2, 4, 2)), np.zeros((4, 4, 2))
    passed[:2] = [-9.0, 9.0]  # the first round begins in a box that no flight fills
    after_end[1, 0], passed[2, 1], passed[3, 2] = [-1.0, 2.0], [-3.0, 4.0], [-5.0, 6.0]

    bounds = proof.for_ever(after_end, passed)

    assert bounds.tolist() == [[-1.0, 2.0], [-3.0, 4.0], [-5.0, 6.0], [0.0, 0.0]]


@pytest.mark.parametrize("by", [(0.0, 0.0), (1e-9, 0.0), (0.0, -1e-9), (1e-9, -1e-9)])
def test_a_range_is_inside_a_set_if_both_its_ends_are(by):
    centre, size = np.array([0.1, 7.0]), np.array([0.3, 1.1])
    ranges = np.stack([centre - 0.9 * size, centre + 0.9 * size], axis=1)
    ranges[1] = [7.0 - 1.1 + by[0], 7.0 + 1.1 + by[1]]

    assert proof.inside(ranges, centre, size) == all(by)


def test_corners_of_a_set_are_in_its_piece_though_its_rows_are_nearly_alike():
    """To 60 digits a corner is a sum of generators, each taken once at most, and of the rest."""
    n, rng = 6, np.random.default_rng(2)
    W, centre, size = hilbert(n), rng.normal(size=n), rng.uniform(0.1, 1.0, n)

    piece = proof.parallelotope(W, centre, size)

    generators, rest = piece.values[0, :, 1 : 1 + n], piece.err[0]
    assert np.abs(generators) == pytest.approx(np.abs(np.linalg.inv(W)) * size, rel=1e-4)
    with mpmath.workdps(60):
        for signs in rng.choice([-1.0, 1.0], (16, n)):
            values = zip(centre, signs, size, strict=True)
            corner = [mpmath.mpf(c) + sign * mpmath.mpf(s) for c, sign, s in values]
            z = mpmath.lu_solve(mpmath.matrix(W.tolist()), mpmath.matrix(corner))
            off = z - mpmath.matrix(piece.values[0, :, 0].tolist())
            of = mpmath.matrix(generators.tolist())
            shares = mpmath.matrix([max(-1, min(1, x)) for x in mpmath.lu_solve(of, off)])
            assert all(abs(x) <= most for x, most in zip(off - of * shares, rest, strict=True))
    with pytest.raises(interval.Unbounded, match="no inverse"):
        proof.parallelotope(hilbert(14), np.zeros(14), np.ones(14))


def test_a_law_that_feeds_back_settles_too_and_stays_for_ever(scenario):
    fed_back = {"inputs": ("chi_dot", "gamma_dot"), "feedback": (0.2, 0.2)}
    gains = ft.PIGains(K_P=0.9 * np.eye(2), K_I=0.2 * np.eye(2), **fed_back)
    exact = ft.scenario_from(scenario.as_dict() | {"law": [BRAKING_LATE]})
    ever = tube(exact, gains, disturbance=D).hand_over

    longer = tubes.stated_problem(lasting(exact, LONGER), gains, disturbance=D)
    signals, _ = disturbed_flight(longer, disturbance=lambda t: (D, -D))

    after = signals[signals.index > exact.flight.duration_s]
    for name, (low, high) in zip(QUANTITIES, ever.bounds, strict=True):
        assert after[name].between(low, high).all()


@pytest.mark.parametrize("omega", [0.7, 0.0, 1.5, 6.0])
def test_flights_ten_times_as_long_stay_inside(scenario, found, omega):
    longer = tubes.stated_problem(lasting(scenario, LONGER), QUICK, disturbance=D)
    swing = Sinusoid(chi_amplitude=D, chi_omega=omega, gamma_amplitude=-D, gamma_omega=omega)

    signals, _ = disturbed_flight(longer, disturbance=swing)

    after = signals[signals.index > scenario.flight.duration_s]
    for name, (low, high) in zip(QUANTITIES, found.hand_over.bounds, strict=True):
        assert after[name].between(low, high).all()
    assert not after[["phi_limited", "n_z_limited"]].to_numpy().any()


def test_bounds_for_ever_are_those_of_the_tube_of_a_longer_flight(scenario, found):
    problem = tubes.stated_problem(lasting(scenario, 3.0), QUICK, disturbance=D)
    longer = tubes.tube_of(problem, for_ever=False)

    after = longer.bounds.pairs[longer.bounds.t > scenario.flight.duration_s, :2]
    widths = after[..., 1].max(axis=0) - after[..., 0].min(axis=0)
    assert (np.ptp(found.hand_over.bounds[:2], axis=1) < WIDER * widths).all()


def test_it_is_in_the_file_and_proven_again(found, path):
    again = ft.load(path)

    assert again.handed_over == found.handed_over
    assert again.verify().valid


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("ever_W", lambda W: 0.9 * W, "sample .*: the set that is kept"),
        ("ever_size", lambda size: 0.5 * size, "sample .*: the set that is kept"),
        ("ever_size", lambda size: 300.0 * size, "after .* samples from sample "),
        # four times as long in one direction: flights leave it in another
        ("ever_size", lambda size: np.r_[4.0 * size[:1], size[1:]], "after .* proven to be kept"),
        ("ever_bounds", lambda bounds: 0.9 * bounds, "after .*chi_err >= .* is not proven"),
    ],
)
def test_a_set_that_is_not_kept_or_not_reached_is_refused(path, tmp_path, name, change, said):
    changed = {name: change(arrays_of(path)[name])}

    verdict = ft.verify(rewritten(path, changed, tmp_path / "changed.npz"))

    assert not verdict.valid
    assert re.search(said, verdict.reason)


# The bounds of the last sample end with the margin of the interval after it, which those for ever
# do not have: flights must have been in the set by then.
@pytest.mark.parametrize("sample", [0, SAMPLES])
def test_a_hand_over_before_the_last_change_or_after_the_last_sample_is_refused(
    path, tmp_path, sample
):
    _, samples = claim_of(path)["hand_over"]
    rewritten(path, {}, tmp_path / "changed.npz", hand_over=[sample, samples])

    with pytest.raises(ft.InputError, match=f"`hand_over`.*{SAMPLES}.*sample {sample}"):
        ft.verify(tmp_path / "changed.npz")


def test_nothing_is_claimed_for_ever_of_a_reference_that_still_moves(scenario):
    tables = lasting(scenario, 1.0 / 3.0).as_dict()
    tables["reference"]["gamma_deg"] = [
        {"shape": "ramp", "start_s": 2.0, "rate_dps": 0.1, "duration_s": 9.0}
    ]

    assert tube(ft.scenario_from(tables), QUICK, disturbance=D).hand_over is None
