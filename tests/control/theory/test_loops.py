"""One table of loops, and what must hold of each whatever its law, lags or channels are."""

import itertools
import json
import math
import warnings
from dataclasses import replace
from fractions import Fraction
from functools import cache
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from printed import L_D, MARKED, MODEL, TABLE_2, lagged
from scipy.linalg import block_diag, expm, solve_continuous_lyapunov
from worst_reach import ReachableSet, largest_reach, worst_disturbance

import flighttune as ft

OPTIONS = {
    "solver": "CLARABEL",
    "tol_gap_abs": 1e-9,
    "tol_gap_rel": 1e-9,
    "tol_feas": 1e-9,
    "equilibrate_enable": False,
}


def rate(Q):
    """R_K of a Q."""
    return 1.0 / np.linalg.eigvalsh(Q)[-1]


def radius(A, Q):
    """I_K of a Q."""
    values = np.linalg.eigvalsh(Q)
    return values[-1] ** 2 / (values[0] * np.linalg.svd(A, compute_uv=False)[-1])


def largest_rate(A):
    """The Q with the smallest lambda_max under ``A' Q + Q A + I <= 0``."""
    whole = solve_continuous_lyapunov(A.T, -np.eye(len(A)))
    L, top = np.linalg.cholesky(whole), np.linalg.eigvalsh(whole)[-1]
    eye = np.eye(len(A))
    answers = []
    mixed = np.linalg.cholesky(L @ L.T / top + 1e-3 * eye)
    for T in (eye, np.linalg.inv(mixed).T, np.linalg.inv(L).T):  # congruences: the same problem
        S, highest = cp.Variable(A.shape, symmetric=True), cp.Variable()
        F, M = L.T @ A @ T, L.T @ T  # of T' (A' Q + Q A + I) T with Q = L S L'
        decay = F.T @ S @ M + M.T @ S @ F + T.T @ T
        ceiling = L @ S @ L.T / top << highest * eye
        answers.append(_solved(highest, [decay << 0, ceiling], A, L, S))
    return max((Q for Q in answers if Q is not None), key=rate)


def _solved(objective, constraints, A, L, S):
    """The multiple of Q that just satisfies the inequality; None where there is none."""
    with warnings.catch_warnings():
        # The multiple that is returned is feasible however far the solver came.
        warnings.filterwarnings("ignore", message="Solution may be inaccurate")
        try:
            cp.Problem(cp.Minimize(objective), constraints).solve(**OPTIONS)
        except cp.SolverError:
            return None
    if S.value is None:
        return None
    Q = L @ S.value @ L.T
    slack = -np.linalg.eigvalsh(A.T @ Q + Q @ A)[-1]
    return Q / slack if slack > 0.0 and np.linalg.eigvalsh(Q)[0] > 0.0 else None


ROUNDING, SOLVER = 1e-9, 1e-6
REFERENCE = json.loads(
    (Path(__file__).parents[2] / "reference" / "margins" / "margins.json").read_text("utf-8")
)["cases"]
"""Margins of python-control with SLICOT; made by make.py in the same folder."""


def stored(case):
    A, B, C, K = (np.array(case[key]) for key in ("A", "B", "C", "K"))
    p = len(C)
    names = {kind: tuple(f"{kind[0]}{i}" for i in range(p)) for kind in ("inputs", "errors")}
    model = ft.loop.LinearModel(A=A, B=B, C=C, states=tuple(map(str, range(len(A)))), **names)
    return model, ft.PIGains(K_P=K[:, :p], K_I=K[:, p:], **names)


def three():
    """The paper's law with the airspeed."""
    rates = ft.PIGains.from_lists(np.diag([1.2, 1.2, 2.0]), 0.5 * np.eye(3), law="exact")
    model = ft.loop.kinematic_model(V_a=25.0, gamma=0.1, g=9.81, airspeed=True)
    return model, ft.loop.command_gains(rates, V_a=25.0)


LOOPS = {
    **{name: (MODEL, gains) for name, gains in MARKED.items()},
    "lagged": (lagged(), ft.PAPER_GAINS),
    "airspeed": three(),
    "a turn": (
        ft.loop.kinematic_model(V_a=40.0, gamma=-0.2, phi=0.5, n_z=1.1, g=9.81),
        MARKED["K2"],
    ),
    **{f"of {name}": stored(case) for name, case in REFERENCE.items() if "paper" not in name},
}  # fmt: skip


@cache
def certified(name):
    return ft.certify(*LOOPS[name], L_d=L_D)


@cache
def valid(name):
    return ft.verify(certified(name).certificate).valid


@pytest.mark.parametrize("name", LOOPS)
def test_a_certificate_of_any_loop_says_what_its_eigenvalues_say(name, tmp_path):
    model, gains = LOOPS[name]
    made, A = certified(name), ft.loop.closed_loop(model, gains)
    n, p, found = len(A), len(model.errors), made.indicators
    slowest = -np.linalg.eigvals(A).real.max()
    Q = solve_continuous_lyapunov(A.T, -np.eye(n))
    values = np.linalg.eigvalsh(Q)

    assert made.status == "certified"
    assert found.R_K == pytest.approx(1.0 / values[-1], rel=SOLVER)
    smallest = np.linalg.svd(A, compute_uv=False)[-1]
    assert found.I_K == pytest.approx(values[-1] ** 2 / (values[0] * smallest), rel=SOLVER)
    assert found.spectral_abscissa == pytest.approx(-slowest)
    assert made.certificate.claim.rate == pytest.approx(found.R_K, rel=SOLVER)
    assert made.certificate.claim.rate <= found.R_K <= 2.0 * slowest * (1.0 + ROUNDING)
    assert made.values["growth"] == pytest.approx(np.sqrt(np.linalg.cond(Q)), rel=1e-4)
    (exact,) = made.certificate.exact_rates
    assert 0.99 * slowest <= exact.rate < slowest
    flow = A.T @ exact.Q + exact.Q @ A + 2.0 * exact.rate * exact.Q
    assert np.linalg.eigvalsh(flow)[-1] < 0.0 < np.linalg.eigvalsh(exact.Q)[0]
    (row,) = made.values["exact_rates"]
    assert (row["loop"], row["decay"]) == ("continuous", exact.rate)
    assert row["true_rate"] == pytest.approx(slowest)
    assert row["growth"] == pytest.approx(exact.growth(model))
    # E' E: the disturbance enters where the law does
    W, a = made.certificate.W, made.certificate.multiplier
    assert np.linalg.eigvalsh(A @ W + W @ A.T + a * W)[0] < 0.0
    radius = made.certificate.claim.radius
    assert radius == pytest.approx(math.sqrt(np.linalg.eigvalsh(W)[-1]), rel=SOLVER)
    assert p == len(gains.errors)


FORGERIES = (
    *("rate", "radius", "L_d", "multiplier", "gains"),
    *("exact rate", "exact Q", "sign", "asymmetric"),
)


@pytest.mark.parametrize(
    ("name", "forgery"),
    [*itertools.product(("paper", "K6", "lagged", "airspeed", "of coupled_of_6"), FORGERIES)],
)
def test_a_claim_of_any_loop_is_as_strong_as_it_can_be_and_not_to_be_forged(name, forgery):
    whole = certified(name).certificate
    claim, (exact,) = whole.claim, whole.exact_rates
    off = exact.Q.copy()
    off[0, 1] = np.nextafter(off[0, 1], 9.0)
    forged = {
        "rate": {"claim": replace(claim, rate=(1.0 + 1e-6) * claim.rate)},
        "radius": {"claim": replace(claim, radius=(1.0 - 1e-6) * claim.radius)},
        "L_d": {"claim": replace(claim, L_d=1.001 * claim.L_d)},
        "multiplier": {"multiplier": -whole.multiplier},
        "gains": {"gains": replace(whole.gains, K_I=1.01 * whole.gains.K_I)},
        "exact rate": {"exact_rates": (replace(exact, rate=1.02 * exact.rate),)},
        "exact Q": {"exact_rates": (replace(exact, Q=exact.Q + 0.6 * np.eye(len(off))),)},
        "sign": {"exact_rates": (replace(exact, Q=-exact.Q),)},
        "asymmetric": {"exact_rates": (replace(exact, Q=off),)},
    }[forgery]

    refused = ft.verify(replace(whole, **forged))

    assert valid(name)
    assert not refused.valid


@pytest.mark.parametrize("name", REFERENCE)
def test_margins_are_those_of_python_control_with_slicot(name):
    expected = REFERENCE[name]
    model, gains = stored(expected)
    (table,) = (x for x in ft.certify(model, gains).answer().tables if x.name == "margins")
    *channels, together = table.records

    for channel, numbers in zip(channels, expected["channels"], strict=True):
        said = (
            *(channel[key] for key in ("gain_increase", "gain_decrease", "delay_margin_s")),
            math.radians(channel["phase_margin_deg"]),
        )
        keys = "gain_increase", "gain_decrease", "delay_margin", "phase_margin"
        stated = [math.inf if numbers[key] is None else numbers[key] for key in keys]
        assert said == pytest.approx(stated, rel=ROUNDING)
    d = expected["disk_margin"]
    if len(channels) < 3:
        assert together["disk_margin"] == pytest.approx(d, rel=ROUNDING)
        # Seiler, Packard and Gahinet: where the disk meets the real axis and the unit circle
        assert together["gain_decrease"] == pytest.approx((2.0 - d) / (2.0 + d))
        assert together["gain_increase"] == pytest.approx((2.0 + d) / (2.0 - d))
        phase = math.degrees(2.0 * math.atan(d / 2.0))
        assert together["phase_margin_deg"] == pytest.approx(phase)
    else:  # of three inputs only a bound is computed, on the safe side
        assert 0.99 * d < together["disk_margin"] < d


@pytest.mark.parametrize("name", ["paper", "K1", "K6", "airspeed", "a turn"])
def test_a_lag_and_a_delay_at_their_margins_put_a_pair_on_the_imaginary_axis(name):
    model, gains = LOOPS[name]
    (table,) = (x for x in certified(name).answer().tables if x.name == "margins")
    together = table.records[-1]
    n, m, p = model.shape

    def abscissa(lag):
        A = np.block([[model.A, model.B], [np.zeros((m, n)), -np.eye(m) / lag]])
        behind = replace(
            model, A=A, B=np.vstack([np.zeros((n, m)), np.eye(m) / lag]),
            C=np.hstack([model.C, np.zeros((p, m))]), states=(*model.states, *model.inputs),
        )  # fmt: skip
        return np.linalg.eigvals(ft.loop.closed_loop(behind, gains)).real.max()

    assert abscissa(together["lag_margin_s"]) == pytest.approx(0.0, abs=1e-7)
    # The loop cut at the commands, of (x', e): an eigenvalue is -1 behind the delay, at some w.
    A = np.block([[model.A, np.zeros((n, p))], [model.C, np.zeros((p, p))]])
    B, K = np.vstack([model.B, np.zeros((p, m))]), np.hstack([gains.K_P @ model.C, gains.K_I])
    omega = np.geomspace(0.05, 50.0, 20_001)
    L = -K @ np.linalg.solve(1j * omega[:, None, None] * np.eye(n + p) - A, B)
    delayed = L * np.exp(-1j * omega * together["delay_margin_s"])[:, None, None]
    assert np.abs(np.linalg.eigvals(delayed) + 1.0).min() < 1e-3
    earlier = L * np.exp(-1j * omega * 0.9 * together["delay_margin_s"])[:, None, None]
    assert np.abs(np.linalg.eigvals(earlier) + 1.0).min() > 0.01


def test_an_unstable_loop_has_no_margins_and_no_certificate():
    refused = ft.certify(MODEL, ft.PIGains(K_P=-np.eye(2), K_I=np.eye(2)))

    assert "left half plane" in refused.reason
    assert [x.records for x in refused.answer().tables if x.name == "margins"] in ([], [[]])


@pytest.mark.parametrize("name", TABLE_2)
def test_every_row_of_table_2_is_reproduced_to_the_last_printed_digit(name):
    _, R_K, I_K = TABLE_2[name]
    found = certified(name).indicators

    assert (found.R_K, found.I_K) == pytest.approx((R_K, I_K), abs=1e-3)
    assert found.R_K == pytest.approx(R_K, abs=1e-4)


@pytest.mark.parametrize("k", [1e-3, 7.0])
@pytest.mark.parametrize("name", ["paper", "lagged", "of coupled_of_10"])
def test_a_loop_k_times_faster_in_every_rate_has_its_figures_scaled(name, k):
    """A_K by k: Q by 1/k, so R_K by k, sigma_min by k and I_K by 1/k^2."""
    A = ft.loop.closed_loop(*LOOPS[name])
    one, scaled = ft.loop.indicators(A), ft.loop.indicators(k * A)

    assert scaled.R_K == pytest.approx(k * one.R_K, rel=ROUNDING)
    assert scaled.I_K == pytest.approx(one.I_K / k**2, rel=ROUNDING)
    assert scaled.Q == pytest.approx(one.Q / k, rel=1e-7, abs=1e-7 / k)


@pytest.mark.parametrize("name", ["paper", "K4", "a turn", "airspeed"])
def test_channels_in_another_order_have_the_same_figures(name):
    model, gains = LOOPS[name]
    order = np.arange(len(model.errors))[::-1]
    swapped = ft.certify(
        replace(
            model, A=model.A[np.ix_(order, order)], B=model.B[np.ix_(order, order)],
            states=model.states[::-1], inputs=model.inputs[::-1], errors=model.errors[::-1],
        ),
        replace(
            gains, K_P=gains.K_P[np.ix_(order, order)], K_I=gains.K_I[np.ix_(order, order)],
            inputs=gains.inputs[::-1], errors=gains.errors[::-1],
        ),
        L_d=L_D,
    )  # fmt: skip
    first, second = (made.certificate for made in (certified(name), swapped))

    assert second.claim.rate == pytest.approx(first.claim.rate, rel=1e-7)
    assert second.claim.radius == pytest.approx(first.claim.radius, rel=1e-4)
    assert swapped.indicators.E_K == pytest.approx(certified(name).indicators.E_K, rel=1e-7)


# ------------------------------------------------ the largest error of a disturbance, E_K
E_K = {
    "K1": 0.3931, "K2": 0.6557, "K3": 0.9594, "paper": 1.6714, "K4": 2.5392, "K5": 3.6170,
    "K6": 4.9985,
}  # fmt: skip
"""Gauss quadrature of the impulse response by another program."""


@pytest.mark.parametrize("name", E_K)
def test_the_largest_error_of_the_papers_gains(name):
    assert certified(name).indicators.E_K == pytest.approx(E_K[name], abs=5e-5)


def oscillator_error(p, q):
    """Integral of the size of the impulse response of ``e'' + p e' + q e = d'``, on paper."""
    damping = p / (2.0 * math.sqrt(q))
    if damping >= 1.0:
        return 1.0 / q
    ratio = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    return (1.0 + ratio) / (1.0 - ratio) / q


OSCILLATORS = [(0.8, 1.5), (0.02, 1.5), (5.0, 1.5), (2.0, 1.0), (200.0, 1.5), (0.3, 4e4), (2e-3, 1)]


@pytest.mark.parametrize(("p", "q"), OSCILLATORS)
def test_the_largest_error_of_a_channel_is_known_on_paper(p, q):
    alone = np.array([[-p, -q], [1.0, 0.0]])
    twice = np.kron(alone, np.diag([1.0, 0.0])) + np.kron(
        [[-3.0, -5.0], [1.0, 0.0]], [[0, 0], [0, 1]]
    )
    both = oscillator_error(p, q), oscillator_error(3.0, 5.0)

    assert ft.loop.indicators(twice, errors=2).E_K == pytest.approx(max(both), rel=ROUNDING)
    assert ft.loop.indicators(alone).E_K == pytest.approx(both[0], rel=ROUNDING)


def test_lags_behind_a_model_have_no_disturbance_of_their_own():
    """With a lag of 1e-5 s the figure is that of the loop without it, whatever the lag's unit."""
    loop = ft.loop.closed_loop(lagged(1e5, 1e5), ft.PAPER_GAINS)

    assert ft.loop.indicators(loop, errors=2).E_K == pytest.approx(E_K["paper"], rel=1e-3)
    assert math.isnan(ft.loop.indicators(loop).E_K)
    with pytest.raises(ft.InputError, match="`A_K`"):
        ft.loop.indicators(loop, errors=8)


@pytest.mark.parametrize("name", ["paper", "K6", "of coupled_of_6"])
def test_no_disturbance_leaves_the_radius_or_makes_an_error_above_e_k(name):
    """Piecewise constant ones, flown exactly; drawn anew every second."""
    model, gains = LOOPS[name]
    A, made = ft.loop.closed_loop(model, gains), certified(name)
    p, n, rng = len(model.errors), len(A), np.random.default_rng(0)
    enters = np.vstack([np.eye(n)[:p]]).T
    v = rng.normal(size=(300, p))
    v *= L_D / np.linalg.norm(v, axis=1)[:, None]
    across = expm(np.block([[A, enters], [np.zeros((p, n + p))]]))
    states = [np.zeros(n)]
    for held in v:
        states.append(across[:n, :n] @ states[-1] + across[:n, n:] @ held)
    if np.array_equal(model.C, np.eye(p, model.shape[0])):
        assert np.linalg.norm(states, axis=1).max() <= made.certificate.claim.radius
        assert np.abs(np.array(states)[:, -p:]).max() <= L_D * made.indicators.E_K


@pytest.mark.soak
def test_the_worst_disturbance_reaches_the_radius_within_a_few_percent():
    name = "paper"
    A, enters = ft.loop.closed_loop(*LOOPS[name]), np.eye(4, 2)
    reachable = ReachableSet.of(A, enters, L_d=L_D)
    exact, direction = largest_reach(reachable)
    duration = 12.0 / -np.linalg.eigvals(A).real.max()
    v, t, s = worst_disturbance(reachable, direction, duration), np.linspace(0, duration, 4001), 0.0
    across = expm(np.block([[A, enters], [np.zeros((2, 6))]]) * t[1])
    s = np.zeros(4)
    for now in t[:-1]:
        s = across[:4, :4] @ s + across[:4, 4:] @ v(now + 0.5 * t[1])

    assert 0.99 * exact < np.linalg.norm(s) < 1.0001 * exact
    assert exact < certified(name).certificate.claim.radius < 1.2 * exact


# ------------------------------------------------ Lyapunov's equation, which every figure needs
def stable_loop(seed, n, decades, *, normal=False):
    """A random stable matrix whose real eigenvalues span `decades` decades below -1e-4."""
    rng = np.random.default_rng(seed)
    rates = -(10.0 ** rng.uniform(-4.0, -4.0 + decades, n))
    basis = rng.standard_normal((n, n))
    if normal:
        basis = np.linalg.qr(basis)[0]
    return basis @ np.diag(rates) @ np.linalg.inv(basis)


def rational_solution(A):
    """Q of ``A' Q + Q A + I = 0`` by elimination over the n^2 entries in fractions."""
    n = len(A)
    exact = [[Fraction(float(a)) for a in row] for row in A]
    table = [[Fraction(0)] * (n * n) + [Fraction(-(r // n == r % n))] for r in range(n * n)]
    for i, j, k in itertools.product(range(n), repeat=3):
        table[i * n + j][k * n + j] += exact[k][i]
        table[i * n + j][i * n + k] += exact[k][j]
    for c in range(n * n):
        pivot = next(r for r in range(c, n * n) if table[r][c])
        table[c], table[pivot] = table[pivot], table[c]
        for r in range(n * n):
            if r != c and table[r][c]:
                factor = table[r][c] / table[c][c]
                table[r] = [a - factor * b for a, b in zip(table[r], table[c], strict=True)]
    return np.array([float(table[r][-1] / table[r][r]) for r in range(n * n)]).reshape(n, n)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("normal", [True, False])
def test_stiff_loops_agree_with_exact_rational_arithmetic(seed, normal):
    A = stable_loop(seed, n=3, decades=7.0, normal=normal)

    extremes = np.linalg.eigvalsh(ft.loop.indicators(A).Q)[[0, -1]]

    assert extremes == pytest.approx(np.linalg.eigvalsh(rational_solution(A))[[0, -1]], rel=SOLVER)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 13), decades=st.floats(0.0, 4.0))
def test_any_number_of_states_agrees_with_bartels_and_stewart(seed, n, decades):
    A = stable_loop(seed, n, decades, normal=True)
    found, expected = ft.loop.indicators(A), solve_continuous_lyapunov(A.T, -np.eye(n))

    assert np.array_equal(found.Q, found.Q.T)
    assert found.Q == pytest.approx(expected, abs=SOLVER * np.linalg.norm(found.Q, 2))
    stack = ft.loop.indicators_batch(np.stack([A, 2.0 * A, -A]))
    assert stack.R_K == pytest.approx([found.R_K, 2.0 * found.R_K, 0.0], rel=ROUNDING)
    assert stack.stable.tolist() == [True, True, False]


decays = st.floats(-3.0, 2.0).map(lambda power: 10.0**power)
poles = st.tuples(decays, st.none() | st.floats(-2.0, 2.0).map(lambda power: 10.0**power))


@st.composite
def stable_loops(draw):
    """1 to 6 states, rates over five decades, mixed by a matrix of condition up to 30."""
    blocks, room = [], draw(st.integers(1, 6))
    while room:
        decay, frequency = draw(poles)
        if frequency is None or room == 1:
            blocks.append([[-decay]])
        else:
            blocks.append([[-decay, frequency], [-frequency, -decay]])
        room -= len(blocks[-1])
    D = block_diag(*blocks)
    n = len(D)
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    left, right = (np.linalg.qr(rng.normal(size=(n, n)))[0] for _ in range(2))
    T = left * np.geomspace(1.0, 10.0 ** draw(st.floats(0.0, 1.5)), n) @ right
    return T @ D @ np.linalg.inv(T)


@pytest.mark.soak
@settings(max_examples=10, suppress_health_check=list(HealthCheck))
@given(stable_loops())
def test_solver_and_closed_form_agree_on_stiff_and_nearly_unstable_loops(A):
    assert rate(largest_rate(A)) == pytest.approx(ft.loop.indicators(A).R_K, rel=SOLVER)
