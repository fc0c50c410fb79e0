"""Convergence as the report understands it."""

import numpy as np
import pandas as pd
import pytest

from flighttune.control.gains import PAPER_GAINS
from flighttune.report.facts import final_errors
from flighttune.simulate.run import Provenance, Run

DT = 0.01


def made_up(errors, status):
    t = np.arange(len(errors)) * DT
    signals = pd.DataFrame(
        {"chi_err": errors[:, 0], "gamma_err": errors[:, 1]}, index=pd.Index(t, name="t")
    )
    made = Provenance(
        scenario={}, plant="kinematic", gains_name="paper", gains=PAPER_GAINS, seed=0, versions={},
        wall_s=0.0,
    )  # fmt: skip
    return Run(signals=signals, status=status, reason="", provenance=made)


@pytest.mark.parametrize(
    ("first", "last", "status", "converged"),
    [
        (1.0, 0.04, "completed", True),
        (1.0, 0.06, "completed", False),
        (0.01, 0.008, "completed", True),
        (1.0, 0.04, "left_envelope", False),
    ],
)
def test_a_run_converged_if_the_last_quarter_is_within_5_percent_or_half_a_degree(
    first, last, status, converged
):
    errors = np.full((1001, 2), first)
    errors[700:] = last

    found = final_errors(made_up(errors, status))

    assert found.converged is converged
    assert found.residual == pytest.approx((last, last))
    assert found.allowed == pytest.approx([max(0.05 * first, np.deg2rad(0.5))] * 2)
