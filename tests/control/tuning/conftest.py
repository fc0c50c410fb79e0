"""The optimisation model of arXiv 2411.13140 with the numbers of its section 4."""

from dataclasses import replace

import numpy as np
import pytest
from printed import MODEL

import flighttune as ft

DECOUPLED = np.array([[np.nan, 0.0, np.nan, 0.0], [0.0, np.nan, 0.0, np.nan]])
"""Gains of which each command has those of its own channel."""


def relaxed(problem, *factors):
    """The problem with its limits of phi, n_z and their rates times these factors."""
    by = np.array(factors * (4 // len(factors)))
    limits = problem.limits
    wider = ft.loop.Limits(
        lower=by[:2] * limits.lower,
        upper=by[:2] * limits.upper,
        rate_lower=by[2:] * limits.rate_lower,
        rate_upper=by[2:] * limits.rate_upper,
    )
    return replace(problem, limits=wider)


@pytest.fixture(scope="session")
def model():
    return MODEL


@pytest.fixture(scope="session")
def printed(model):
    """With every input limit of the paper, and I* = 5 (which it never prints)."""
    limits = ft.loop.Limits(
        lower=np.array([-np.pi / 4.0, -2.1]),
        upper=np.array([np.pi / 4.0, 2.1]),
        rate_lower=np.array([-np.pi / 6.0, -1.0]),
        rate_upper=np.array([np.pi / 6.0, 1.0]),
    )
    x_0 = np.array([-np.pi / 3.0, -np.pi / 6.0])
    return ft.loop.TuningProblem(model=model, I_star=5.0, limits=limits, x_0=x_0)
