"""Convergence as the report understands it."""

import numpy as np
import pytest
from made_up import made_up_run

from flighttune.outputs.pages.panels import final_errors


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
    columns = {"chi_err": errors, "gamma_err": errors}

    late = final_errors(made_up_run(columns, np.arange(1001) * 0.01, status=status))

    assert late["converges"] is converges
    assert late["residual"]["chi"] == pytest.approx(last)
    assert late["allowed"]["gamma"] == pytest.approx(max(0.05 * first, np.deg2rad(0.5)))
