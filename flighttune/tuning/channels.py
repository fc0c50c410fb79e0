"""A problem taken apart into the channels that do not touch each other."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse.csgraph import connected_components

from flighttune.arrays import FloatArray
from flighttune.control.limits import Limits
from flighttune.control.linear_model import LinearModel
from flighttune.tuning.problem import TuningProblem

Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Channel:
    """Inputs, errors and states that act on each other and on nothing else.

    Attributes
    ----------
    inputs, errors : ndarray of int
        Their places in the whole model.
    problem : TuningProblem
        The problem of these alone.
    """

    inputs: Indices
    errors: Indices
    problem: TuningProblem


def channels(problem: TuningProblem) -> tuple[Channel, ...]:
    """The channels of a problem whose model falls apart; the whole problem where it does not.

    Parameters
    ----------
    problem : TuningProblem

    Returns
    -------
    tuple of Channel
        In the order of their first input. The gains between channels are left out: they are 0.

    Notes
    -----
    R_K of the whole loop is the smallest of the channels', so that the whole problem leaves the
    better channels undetermined. Each channel's own problem does not.
    """
    model = problem.model
    n, m, p = model.shape
    acts = np.zeros((n + m + p, n + m + p))
    acts[:n, :n], acts[:n, n : n + m], acts[n + m :, :n] = model.A, model.B, model.C
    count, part = connected_components(acts != 0.0, directed=False)
    groups = [part[:n], part[n : n + m], part[n + m :]]
    wanted = list(dict.fromkeys(groups[1].tolist()))
    places = [[np.flatnonzero(group == k) for group in groups] for k in wanted]
    if count > len(wanted) or not all(len(states) and len(errors) for states, _, errors in places):
        return (Channel(inputs=np.arange(m), errors=np.arange(p), problem=problem),)
    return tuple(
        Channel(inputs=inputs, errors=errors, problem=_part(problem, states, inputs, errors))
        for states, inputs, errors in places
    )


def assembled(parts: list[tuple[Channel, FloatArray]], shape: tuple[int, int]) -> FloatArray:
    """Stacked gains of the whole, shape (m, 2 p) = `shape`, from those of each channel."""
    K = np.zeros(shape)
    p = shape[1] // 2
    for channel, own in parts:
        columns = np.concatenate([channel.errors, p + channel.errors])
        K[channel.inputs[:, None], columns] = own
    return K


def _part(
    problem: TuningProblem, states: Indices, inputs: Indices, errors: Indices
) -> TuningProblem:
    model = problem.model
    n, _, p = model.shape
    columns = np.concatenate([errors, p + errors])
    K_min, K_max, K_fixed, scaling = (
        np.asarray(value)
        for value in (problem.K_min, problem.K_max, problem.K_fixed, problem.scaling)
    )
    limits = problem.limits and Limits(
        lower=problem.limits.lower[inputs],
        upper=problem.limits.upper[inputs],
        rate_lower=problem.limits.rate_lower[inputs],
        rate_upper=problem.limits.rate_upper[inputs],
    )
    return replace(
        problem,
        model=LinearModel(
            A=model.A[states[:, None], states],
            B=model.B[states[:, None], inputs],
            C=model.C[errors[:, None], states],
            states=tuple(model.states[i] for i in states),
            inputs=tuple(model.inputs[i] for i in inputs),
            errors=tuple(model.errors[i] for i in errors),
        ),
        limits=limits,
        x_0=None if problem.x_0 is None else problem.x_0[errors],
        scaling=scaling[np.concatenate([states, n + errors])],
        K_min=K_min[inputs[:, None], columns],
        K_max=K_max[inputs[:, None], columns],
        K_fixed=K_fixed[inputs[:, None], columns],
    )
