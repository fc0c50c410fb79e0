"""The largest envelope over which gains have a common Q, where it is known on paper."""

from types import SimpleNamespace

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.linear_model import Envelope
from flighttune.control.tuning import envelope as tuned_over

G = 9.81


def by_the_circle_criterion(_, over, g):
    """A loop of K_P = K_I = 1 at all speeds has a common Q: `sqrt(V_2) - sqrt(V_1) < sqrt(g)`.

    In level flight the course answers as ``b (K_P s + K_I) / s^2`` with ``b = g / V``.
    """
    low, high = np.sqrt(over.V_a)
    return SimpleNamespace(R=np.sqrt(g) - (high - low))


@pytest.mark.parametrize("counted", [True, pytest.param(False, marks=pytest.mark.slow)])
def test_the_speeds_of_a_common_Q_are_those_of_the_circle_criterion(monkeypatch, counted):
    """25 m/s plus and minus x with ``sqrt(25 + x) - sqrt(25 - x) = sqrt(g)``."""
    if counted:
        monkeypatch.setattr(tuned_over, "envelope_rate", by_the_circle_criterion)
    gains = ft.PIGains(K_P=np.eye(2), K_I=np.diag([1.0, 0.1]))
    level = {"gamma": (0.0, 0.0), "phi": (0.0, 0.0), "n_z": (1.0, 1.0)}

    factor = tuned_over.largest_factor(
        gains, Envelope(V_a=(20.0, 30.0), **level), Envelope.at(V_a=25.0, gamma=0.0), g=G
    )

    largest = np.sqrt(25.0**2 - (25.0 - 0.5 * G) ** 2) / 5.0
    assert (1.0 - tuned_over.FACTOR_TOLERANCE) * largest < factor <= largest
