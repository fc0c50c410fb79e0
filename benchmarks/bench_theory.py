"""What R_K, I_K and E_K cost: the batch against SciPy, python-control and cvxpy, on one core.

Times are processor times of one thread, so that other load on the machine counts little.
Run it with ``python benchmarks/bench_theory.py``; ``--json`` prints one object, ``--figure FILE``
draws the cost as SVG against the number of states.
"""

import json
import os
import time
import warnings
from collections.abc import Callable
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"

import control
import cvxpy as cp
import numpy as np
import running
from scipy.linalg import solve_continuous_lyapunov

from flighttune.control.gains import PAPER_GAINS
from flighttune.control.linear_model import closed_loops, kinematic_model
from flighttune.control.theory.indicators import indicators_batch
from flighttune.control.theory.reachable import largest_errors
from flighttune.outputs.drawing.chart import Chart, Sheet
from flighttune.outputs.drawing.palette import HUES

MILLION = 1000 if running.QUICK else 1_000_000
STATES = range(2, 4 if running.QUICK else 13)
BATCH = 100 if running.QUICK else 20_000
ERRORS = 100 if running.QUICK else 100_000
REPEATS = 1 if running.QUICK else 5

Indicators = tuple[float, float, float]


def gain_sets(count: int) -> np.ndarray:
    """Closed loops of random gains about the paper's, shape (count, 4, 4)."""
    model = kinematic_model(V_a=25.0, gamma=np.pi / 12.0, g=9.81)
    K = PAPER_GAINS.K + 0.4 * np.random.default_rng(0).standard_normal((count, 2, 4))
    return closed_loops(model, K)


def one_by_one(solve: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], list]:
    """A loop over a solver of ``A' Q + Q A + I = 0`` that gives the same three numbers."""

    def loop(A_K: np.ndarray) -> list[Indicators]:
        rows = []
        for A in A_K:
            abscissa = np.linalg.eigvals(A).real.max()
            if abscissa >= 0.0:
                rows.append((0.0, np.inf, abscissa))
                continue
            spectrum = np.linalg.eigvalsh(solve(A))
            sigma = np.linalg.svd(A, compute_uv=False)[-1]
            rows.append((1.0 / spectrum[-1], spectrum[-1] ** 2 / (spectrum[0] * sigma), abscissa))
        return rows

    return loop


def by_scipy(A: np.ndarray) -> np.ndarray:
    """SciPy's Bartels and Stewart."""
    return solve_continuous_lyapunov(A.T, -np.eye(len(A)))


def by_python_control(A: np.ndarray) -> np.ndarray:
    """python-control's `lyap`, which calls SLICOT where slycot is installed."""
    return control.lyap(A.T, np.eye(len(A)))


def by_cvxpy(A: np.ndarray) -> np.ndarray:
    """The paper's EVP as a cvxpy user writes it, a problem each loop, by Clarabel."""
    n = len(A)
    Q, top = cp.Variable((n, n), symmetric=True), cp.Variable()
    flow = A.T @ Q + Q @ A + np.eye(n)
    problem = cp.Problem(cp.Minimize(top), [top * np.eye(n) - Q >> 0, -(flow + flow.T) / 2 >> 0])
    problem.solve(solver="CLARABEL")
    assert Q.value is not None
    return Q.value


def seconds_each(*runs: tuple[Callable[[np.ndarray], object], np.ndarray]) -> list[float]:
    """Processor time a loop of each run: the shortest of some taken in turn."""
    took = np.full((REPEATS, len(runs)), np.inf)
    for repeat in range(REPEATS):
        for i, (run, A_K) in enumerate(runs):
            run(A_K[:2])
            began = time.process_time()
            run(A_K)
            took[repeat, i] = (time.process_time() - began) / len(A_K)
    return took.min(axis=0).tolist()


def against_peers() -> dict[str, dict[str, float]]:
    """Time a loop and ratio to the batch, for each peer, and how far R_K is from the batch's."""
    peers = {
        "SciPy loop": (by_scipy, min(BATCH, 2000)),
        "python-control lyap loop": (by_python_control, min(BATCH, 2000)),
        "cvxpy + Clarabel, a problem a loop": (by_cvxpy, 30),
    }
    table = {}
    for name, (solve, count) in peers.items():
        A_K = gain_sets(count)
        rates = np.array([row[0] for row in one_by_one(solve)(A_K)])
        own = indicators_batch(A_K).R_K
        peer, batch = seconds_each((one_by_one(solve), A_K), (indicators_batch, gain_sets(BATCH)))
        table[name] = {
            "us": 1e6 * peer,
            "batch_us": 1e6 * batch,
            "ratio": peer / batch,
            "R_K_distance": float(np.max(np.abs(rates - own) / np.maximum(own, 1e-12))),
        }
    return table


def against_states() -> dict[int, dict[str, float]]:
    """Microseconds a loop of the batch and of the SciPy loop, for 2 to 12 states."""
    table = {}
    for n in STATES:
        rng = np.random.default_rng(n)
        A = rng.standard_normal((1000, n, n)) - 3.0 * np.sqrt(n) * np.eye(n)
        batch, peer = seconds_each((indicators_batch, A), (one_by_one(by_scipy), A[:200]))
        table[n] = {"batch": 1e6 * batch, "SciPy loop": 1e6 * peer}
    return table


def a_million() -> float:
    """Processor seconds for R_K, I_K and abscissa of a million gain sets, closed loops included."""
    began = time.process_time()
    indicators_batch(gain_sets(MILLION))
    return time.process_time() - began


def largest_error_cost() -> dict[str, float]:
    """Microseconds a gain set of E_K and of I_K, for `ERRORS` gain sets, and their ratio."""
    A_K = gain_sets(ERRORS)
    began = time.process_time()
    largest_errors(A_K, errors=2)
    E_K = (time.process_time() - began) / len(A_K)
    (I_K,) = seconds_each((indicators_batch, A_K))
    return {"E_K_us": 1e6 * E_K, "I_K_us": 1e6 * I_K, "ratio": E_K / I_K}


def draw(table: dict[int, dict[str, float]], path: Path) -> None:
    """Draw the cost against the number of states."""
    chart = Chart(
        title="R_K and I_K on one core",
        x="states of the closed loop",
        y="time a loop [µs]",
        log="y",
        x_room=0.05,
    )
    for name, ((colour, _), _) in zip(("SciPy loop", "batch"), HUES, strict=False):
        times = [row[name] for row in table.values()]
        chart.line(list(table), times, colour, name=name)
        chart.points(list(table), times, colour)
    Sheet(charts=[chart], columns=1).save(path)


def main() -> int:
    """Measure, and print a table or JSON."""
    parser = running.options(__doc__)
    parser.add_argument("--figure", type=Path)
    asked = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    warnings.simplefilter("ignore")
    found = {
        "peers": against_peers(),
        "million_s": a_million(),
        "states_us": against_states(),
        "E_K": largest_error_cost(),
    }
    if asked.figure:
        draw(found["states_us"], asked.figure)
    if asked.json:
        print(json.dumps(found))
        return 0
    print(f"{'one core, 4 states':38}{'us a loop':>11}{'batch':>8}{'ratio':>8}{'R_K off by':>12}")
    for name, row in found["peers"].items():
        print(
            f"{name:38}{row['us']:11.1f}{row['batch_us']:8.2f}{row['ratio']:8.1f}"
            f"{row['R_K_distance']:12.1e}"
        )
    print(f"one million gain sets: {found['million_s']:.2f} s (asked: under 10 s)")
    E_K = found["E_K"]
    print(
        f"E_K of {ERRORS} gain sets: {E_K['E_K_us']:.1f} us each, {E_K['ratio']:.1f} times I_K "
        "(asked: at most 20)"
    )
    print(f"{'states':>8}{'batch, us':>12}{'SciPy loop, us':>16}{'ratio':>8}")
    for n, row in found["states_us"].items():
        ratio = row["SciPy loop"] / row["batch"]
        print(f"{n:8}{row['batch']:12.2f}{row['SciPy loop']:16.1f}{ratio:8.1f}")
    return 0


if __name__ == "__main__":
    running.end(main)
