"""Gains of the least E_K and of the fastest decay under a bound on the sensitivity."""

from functools import cache

import numpy as np
import pytest
from made_up import made_up_scenario

import flighttune as ft


# relative: the oracle's integral is a sum over 0.01 s, its search a simplex
@cache
def tuned(objective, aircraft="aerosonde", V_a=25.0, **tuning):
    """Gains of an aircraft's identified loop by the paper's law."""
    tuning |= {"model": "identified", "objective": objective, "identified": aircraft}
    return ft.tune(made_up_scenario(flight={"V_a_mps": V_a}, tuning=tuning))


def channel(model, i):
    """State space of one channel, from its command to its error."""
    states = [j for j, name in enumerate(model.states) if name.startswith(CHANNELS[i])]
    return model.A[np.ix_(states, states)], model.B[states, i], model.C[i, states]


CHANNELS = ("chi", "phi"), ("gamma", "n_z")
OMEGA = np.geomspace(1e-2, 1e3, 4000)


def sensitivity(parts, gains):
    """Largest ``|1 / (1 - K G)|``, by the definition at many frequencies."""
    (A, B, C), (K_P, K_I) = parts, gains
    s = 1j * OMEGA
    G = np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B[:, None])[:, :, 0] @ C
    return np.abs(1.0 / (1.0 - (K_P + K_I / s) * G)).max()


@pytest.mark.soak
@pytest.mark.parametrize(
    ("objective", "flown"),
    [
        ("E_K", ()),
        ("decay", ("a4", 200.0)),
        pytest.param("decay", ("c172p", 50.0), marks=pytest.mark.counts),
    ],
)
def test_the_sensitivity_of_each_channel_is_the_largest_allowed_or_less(objective, flown):
    result = tuned(objective, *flown)
    K = result.gains.K

    peaks = [sensitivity(channel(result.problem.model, i), K[i, [i, 2 + i]]) for i in (0, 1)]
    assert max(peaks) <= 1.4 * (1.0 + 1e-5)
    assert max(peaks) >= 1.399 if objective == "E_K" else max(peaks) > 1.2


def test_an_identified_model_takes_the_objectives_that_are_its_own():
    """A plant with its lags is enough: `model` need not be stated."""
    plants = [{"kind": "point_mass_lag", "identified": "aerosonde"}]
    scenario = made_up_scenario(plant=plants, tuning={"objective": "E_K"})

    assert scenario.tuning.model == "identified"
    assert ft.loop.tuning_problem(scenario).objective == "E_K"


@pytest.mark.slow
def test_a_sensitivity_that_no_gains_have_is_refused():
    result = tuned("E_K", sensitivity_max=1.0 + 1e-9)

    assert result.status == "failed"
    assert "with a sensitivity of at most 1" in result.reason


@pytest.mark.soak
def test_a_larger_sensitivity_makes_errors_smaller_and_stays_below_the_wide_bound():
    results = tuned("E_K", sensitivity_max=1.2), tuned("E_K"), tuned("E_K", sensitivity_max=1.6)

    errors = [result.E_K for result in results]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 1.5 * errors[-1]
