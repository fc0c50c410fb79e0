"""The Aerosonde's XML against its published coefficients, put into the equations of motion here."""

import math
import re

import numpy as np
import pytest
from places import SHIPPED_AIRCRAFT
from published_aerosonde import MASS, accelerations, evaluated, measured

from flighttune.aircraft.aircraft import load_aircraft

from .conftest import fdm_of

DEG = math.pi / 180.0
ONE_PER_MILLE = 1e-3


@pytest.mark.parametrize(
    ("alpha_deg", "beta_deg", "rates", "surfaces"),
    [
        (3.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
        (-8.0, 0.0, (0.0, 0.7, 0.0), (0.0, 0.2, 0.0)),
        (6.0, 4.0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)),
        (2.0, 0.0, (1.2, 0.3, -0.6), (-0.2, -0.1, 0.15)),
        (10.0, -5.0, (-0.5, 0.4, 0.8), (0.3, -0.3, -0.2)),
    ],
)
def test_accelerations_agree_with_the_published_coefficients(alpha_deg, beta_deg, rates, surfaces):
    state = 27.0, alpha_deg * DEG, beta_deg * DEG, rates, surfaces, 0.5

    force, angular = measured(evaluated(fdm_of("aerosonde"), *state))

    expected, expected_angular = accelerations(*state)
    assert force == pytest.approx(list(MASS * expected), rel=ONE_PER_MILLE, abs=0.1)
    assert angular == pytest.approx(list(expected_angular), rel=ONE_PER_MILLE, abs=0.01)


def test_lift_peaks_at_the_ends_of_the_envelope():
    xml = (SHIPPED_AIRCRAFT / "aerosonde" / "aerosonde.xml").read_text()
    table = re.search(r"<tableData>(.*?)</tableData>", xml, re.DOTALL)
    assert table is not None
    alpha, C_L = np.fromstring(table[1], sep=" ").reshape(-1, 2).T
    envelope = load_aircraft("aerosonde").envelope

    assert envelope.alpha[1] == pytest.approx(alpha[np.argmax(C_L)] * DEG)
    assert alpha[np.argmin(C_L)] * DEG <= envelope.alpha[0]
