"""Convergence as the report understands it."""

import numpy as np
import pandas as pd
import pytest

from flighttune.control.gains import PAPER_GAINS
from flighttune.report.tables import final_errors
from flighttune.simulate.run import Provenance, Run


@pytest.mark.parametrize(
    ("first", "last", "status", "converges"),
    [
        (1.0, 0.04, "completed", True),
        (1.0, 0.06, "completed", False),
        (0.01, 0.008, "completed", True),
        (1.0, 0.04, "left_envelope", False),
    ],
)
def test_a_run_converges_if_the_last_quarter_is_within_5_percent_or_half_a_degree(
    first, last, status, converges
):
    errors = np.full(1001, first)
    errors[700:] = last
    t = pd.Index(np.arange(1001) * 0.01, name="t")
    made = Provenance(
        scenario={}, plant="kinematic", gains_name="paper", gains=PAPER_GAINS, seed=0, versions={},
        wall_s=0.0,
    )  # fmt: skip
    signals = pd.DataFrame({"chi_err": errors, "gamma_err": errors}, index=t)

    late = final_errors(Run(signals=signals, status=status, reason="", provenance=made))

    assert late["converges"] is converges
    assert late["residual"]["chi"] == pytest.approx(last)
    assert late["allowed"]["gamma"] == pytest.approx(max(0.05 * first, np.deg2rad(0.5)))
