"""Claims of section 5.2 on the model, on K* and on its indicators."""

from collections.abc import Iterator

import numpy as np

from flighttune.paper import parameters as printed
from flighttune.paper.claims.abstract import AS_GOOD
from flighttune.paper.claims.base import Check, Claim, at_most, printed_number
from flighttune.paper.commands import worst_use
from flighttune.paper.parameters import STAR
from flighttune.paper.study import Study
from flighttune.plants.kinematic import turn_rates

SMALL_STEP = 1e-6
DERIVATIVE = 1e-8
"""Step of the differences, and the distance from them at which a Jacobian counts as right."""


def _error_rates(z: np.ndarray) -> np.ndarray:
    """f_e at z = (e_chi, e_gamma, phi, n_z)."""
    gamma = printed.GAMMA_C - z[1]
    return -np.array(turn_rates(printed.V_A, gamma, z[2], z[3], g=printed.G))


def linearises(study: Study) -> Iterator[Check]:
    """The printed Jacobians are those of the law, and the printed equilibrium is one."""
    steady = np.array([0.0, 0.0, 0.0, np.cos(printed.GAMMA_C)])
    differences = np.column_stack(
        [
            (_error_rates(steady + step) - _error_rates(steady - step)) / (2.0 * SMALL_STEP)
            for step in SMALL_STEP * np.eye(4)
        ]
    )
    off = float(np.max(np.abs(differences - np.hstack([study.model.A, study.model.B]))))
    yield at_most("largest distance of the Jacobians from differences", off, DERIVATIVE)
    n_z = np.cos(printed.GAMMA_C) / printed.G
    rate = float(np.linalg.norm(_error_rates(np.array([0.0, 0.0, 0.0, n_z]))))
    yield at_most("rate of the error at n_z = cos(γ_c)/g [rad/s]", rate, DERIVATIVE)


def printed_indicators(study: Study) -> Iterator[Check]:
    """R_K* and I_K* follow from the printed gains."""
    found = study.indicators[STAR]
    digits = printed.LAST_DIGITS[0]
    yield printed_number("R_K* [1/s]", found.R_K, printed.R_K_PRINTED, digits)
    yield printed_number("I_K* [s²]", found.I_K, printed.I_K_PRINTED, digits)


def meets_constraints(study: Study) -> Iterator[Check]:
    """K* is a point of the optimisation model: every command and rate at t_0 in its range."""
    yield at_most("largest command or rate at t_0 over its limit [1]", worst_use(study.star), 1.0)


def solves_problem(study: Study) -> Iterator[Check]:
    """K* has the highest R_K of all gains that meet the constraints."""
    result = study.constrained
    feasible = result.status == "optimal"
    yield Check(
        f"smallest I_K within the input constraints [s²], I* = {printed.I_STAR:g}",
        f"≤ {printed.I_STAR:g}",
        result.I_K,
        feasible,
    )
    best, own = study.optimum.R_K, study.indicators[STAR].R_K
    yield Check(
        "R_K* against the best without input constraints [1/s]",
        f"{best:.5g}",
        own,
        own >= (1.0 - AS_GOOD) * best,
    )


CLAIMS = (
    Claim(
        id="jacobians",
        text="the Jacobians at the equilibrium point n_z = cos(γ_c)/g",
        where="section 5.2, below the error model",
        checks=linearises,
    ),
    Claim(
        id="star-indicators",
        text="R_K* = 0.4427, I_K* = 4.9244",
        where="section 5.2, below K*",
        checks=printed_indicators,
    ),
    Claim(
        id="star-feasible",
        text="K* was computed under the input limits",
        where="section 4.4, optimisation model; section 5.2, K*",
        checks=meets_constraints,
    ),
    Claim(
        id="star-optimal",
        text="the optimal K* solves the optimisation model",
        where="section 5.2, above K*; conclusions",
        checks=solves_problem,
    ),
)
