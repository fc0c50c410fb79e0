"""Stabilising gains to start an optimiser from."""

import numpy as np

from flighttune.arrays import FloatArray
from flighttune.control.linear_model import LinearModel, closed_loops
from flighttune.theory.indicators import indicators_batch
from flighttune.tuning.problem import SearchSpace, TuningProblem

REGULATORS = 16
VARIANTS = 16
"""Candidates: this many regulators with random weights, each changed at random this often."""


def stabilising_starts(problem: TuningProblem, space: SearchSpace, starts: int) -> FloatArray:
    """Free gains of stable loops, at most `starts` of them, the best R_K first.

    Candidates are linear-quadratic regulators of the velocity form with random weights, projected
    on what the loop may feed back, scaled and disturbed at random, moved inside the bounds, and
    half of them shrunk into the input limits. The result is spread over the better half of the
    stable ones; it may be empty.

    Parameters
    ----------
    space : SearchSpace
        Search space of `problem`.

    Returns
    -------
    ndarray, shape (at most starts, f)
    """
    if not starts:
        return np.empty((0, len(space.k_min)))
    rng = np.random.default_rng(np.random.SeedSequence(problem.seed))
    regulators = _regulators(problem.model, rng)[:, None, :, :]
    shape = (len(regulators), VARIANTS, *space.base.shape)
    size = 10.0 ** rng.uniform(-1.0, 0.3, (*shape[:2], 1, 1))
    disturbed = regulators * size * (1.0 + 0.3 * rng.standard_normal(shape))
    # Relative changes alone would leave gains of zero at zero.
    coupling = 0.2 * np.abs(regulators).max(axis=(-2, -1), keepdims=True) * size
    disturbed += coupling * rng.standard_normal(shape)
    k = disturbed.reshape(-1, *space.base.shape)[:, space.free]
    k = np.clip(k, space.k_min, space.k_max)
    # Half of them only: tight limits may leave a shrunk loop without stability.
    k[::2] *= _shrink(k[::2], space)[:, None]
    k = np.clip(k, space.k_min, space.k_max)
    measured = indicators_batch(closed_loops(problem.model, space.K(k)), scaling=problem.scaling)
    ranking = np.argsort(-measured.R_K, kind="stable")[: int(measured.stable.sum())]
    if not len(ranking):
        return k[:0]
    better_half = ranking[: (len(ranking) + 1) // 2]
    spread = np.linspace(0, len(better_half) - 1, min(starts, len(better_half)))
    return k[better_half[spread.astype(int)]]


def _regulators(model: LinearModel, rng: np.random.Generator) -> FloatArray:
    """Stacked gains of linear-quadratic regulators, shape (`REGULATORS`, m, 2 p)."""
    from scipy.linalg import solve_continuous_are

    n, m, p = model.shape
    A = np.zeros((n + p, n + p))
    A[:n, :n], A[n:, :n] = model.A, model.C
    B = np.vstack([model.B, np.zeros((p, m))])
    Q, R = (10.0 ** rng.uniform(-1.5, 1.5, (REGULATORS, size)) for size in (n + p, m))
    gains = []
    for q, r in zip(Q, R, strict=True):
        try:
            X = solve_continuous_are(A, B, np.diag(q), np.diag(r))
        except np.linalg.LinAlgError:  # a mode on the axis that no input reaches
            X = np.zeros(A.shape)
        gains.append(-(B / r).T @ X)
    K = np.array(gains, dtype=np.float64)
    return np.concatenate([K[..., :n] @ np.linalg.pinv(model.C), K[..., n:]], axis=-1)


def _shrink(k: FloatArray, space: SearchSpace) -> FloatArray:
    """The largest factor up to 1 that keeps each row of k inside the input limits."""
    use, room = k @ space.G.T, space.bound - space.offset
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(use > np.maximum(room, 0.0), np.maximum(room, 0.0) / use, 1.0)
    return ratio.min(axis=1, initial=1.0)
