"""Tuning that is stopped ends with its next step."""

import pytest

import flighttune as ft
from flighttune.base.errors import StoppedError
from flighttune.base.stop import stopped_by

STEPS = 5


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"tuning.I_star": 1e-9}, marks=pytest.mark.soak),  # its diagnosis searches too
        {"tuning.model": "identified", "tuning.lag_s": [0.1, 0.4]},  # the slowest decay
    ],
)
@pytest.mark.slow
def test_tuning_ends_with_the_step_at_which_it_is_stopped(changes):
    steps = 0

    def asked():
        nonlocal steps
        steps += 1
        if steps == STEPS:
            raise StoppedError("stopped.")

    with pytest.raises(StoppedError), stopped_by(asked):
        ft.tune("level_turn", changes=changes)
    assert steps == STEPS
    # A later search is not stopped.
    assert ft.tune("paper", starts=1).status == "optimal"
