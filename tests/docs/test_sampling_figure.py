"""What the controller's rate does: predicted, flown, and drawn."""

import numpy as np
import pytest
from figures.sampling import overshoot, sampled_steps

import flighttune as ft

pytestmark = pytest.mark.slow

GENTLE = ft.PIGains(K_P=np.diag([3.2, 3.1]), K_I=np.diag([1.5, 1.2]))
OF_THE_STEP = 0.07
"""Largest difference between the flown step and the predicted one, over the step."""
OVERSHOOT = 0.05
"""Largest difference between flown and predicted overshoot, over the step."""


@pytest.fixture(scope="module")
def steps():
    return sampled_steps(
        "aerosonde",
        {"paper": ft.PAPER_GAINS, "gentle": GENTLE},
        V_a=25.0,
        rates=(10.0, 40.0, 100.0),
    )


@pytest.mark.parametrize("name", ["paper", "gentle"])
def test_every_rate_is_flown_as_the_sampled_loop_and_half_a_sample_of_delay_predict(steps, name):
    for step in steps[name]:
        assert step.exact == pytest.approx(step.flown, abs=OF_THE_STEP)
        assert overshoot(step.exact) == pytest.approx(overshoot(step.flown), abs=OVERSHOOT)
        assert overshoot(step.delayed) == pytest.approx(overshoot(step.flown), abs=OVERSHOOT)


def test_slower_sampling_overshoots_more_and_is_damped_less(steps):
    slow, _, fast = steps["paper"]

    assert (overshoot(slow.flown) > overshoot(fast.flown) + 0.03).all()
    assert (overshoot(slow.exact) > overshoot(fast.exact) + 0.03).all()
    assert slow.damping < fast.damping
