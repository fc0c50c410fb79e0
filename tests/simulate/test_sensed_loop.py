"""The loop behind sensors: what the controller does, what is recorded, one run and many."""

import numpy as np
import pytest

import flighttune as ft
from flighttune.control.mimo_pi import INTEGRAL_SIGNALS
from flighttune.plants.sensors import MEASURED, SENSED
from flighttune.references.segments import Segment
from flighttune.simulate.loop import LOOP_SIGNALS, simulate
from flighttune.units import wrap_angle

DT, DURATION = 0.02, 8.0
START = ft.loop.FlightCondition(V_a=25.0, chi=2.5)
TURN = ft.loop.Reference(chi=2.5, gamma=0.1, chi_segments=(Segment(1.0, (0.0, 4.0), rates=(0.3,)),))
LIMITS = ft.loop.Limits(
    lower=[-0.8, -2.0], upper=[0.8, 2.0], rate_lower=[-0.5, -1.0], rate_upper=[0.5, 1.0]
)
NOISY = ft.loop.Sensors(bias=(0.02, -0.01, 1.0), noise_sd=(0.01, 0.02, 0.5), seed=3)
MICRORADIAN = 1e-6


def flown(sensors, reference=TURN, duration=DURATION, limits=LIMITS, **controller):
    signals, _ = simulate(
        ft.loop.PointMassPlant(turn="paper"),
        ft.loop.MimoPI(ft.PAPER_GAINS, limits, dt=DT, **controller),
        reference,
        condition=START,
        duration=duration,
        sensors=sensors,
    )
    return signals


def test_sensors_without_error_change_no_bit_of_what_was_there():
    perfect, alone = flown(ft.loop.Sensors()), flown(None)

    loop = [*LOOP_SIGNALS[:-2], *INTEGRAL_SIGNALS, *LOOP_SIGNALS[-2:]]
    assert list(alone.columns) == [*ft.loop.PointMassPlant(turn="paper").signals, *loop]
    assert perfect[list(alone.columns)].equals(alone)
    assert [column for column in perfect if column not in alone] == list(MEASURED)


def test_errors_are_the_true_ones_and_what_was_seen_stands_beside_them():
    signals = flown(NOISY)

    errors = NOISY.errors(len(signals), DT)
    for j, name in enumerate(SENSED):
        seen, true = (signals[column].to_numpy() for column in (f"{name}_meas", name))
        assert np.array_equal(seen, true + errors[:, j])
    apart = signals["chi_ref"] - signals["chi"]
    assert signals["chi_err"].tolist() == [wrap_angle(angle) for angle in apart]
    assert np.array_equal(signals["gamma_err"], signals["gamma_ref"] - signals["gamma"])


def test_the_controller_acts_on_what_it_sees():
    first = flown(NOISY, limits=None).iloc[0]

    seen = [first[f"{c}_ref"] - first[f"{c}_meas"] for c in ("chi", "gamma")]
    assert [first["phi_cmd"], first["n_z_cmd"]] == pytest.approx(
        ft.PAPER_GAINS.K_P @ seen, rel=1e-12
    )


def test_integral_action_leaves_the_bias_as_the_true_error():
    sensors = ft.loop.Sensors(bias=(0.05, -0.03, 0.0))

    last = flown(sensors, ft.loop.Reference(chi=2.6, gamma=0.1), duration=60.0).iloc[-1]

    assert [last["chi_err"], last["gamma_err"]] == pytest.approx([0.05, -0.03], abs=MICRORADIAN)


def test_a_schedule_goes_by_the_airspeed_that_was_measured():
    sensors = ft.loop.Sensors(bias=(0.0, 0.0, 5.0))
    fast, true = (
        flown(one, ft.loop.Reference(chi=2.6, gamma=0.1), limits=None, schedule_speed=25.0).iloc[0]
        for one in (sensors, None)
    )

    assert fast["phi_cmd"] == pytest.approx(true["phi_cmd"] * 30.0 / 25.0, rel=1e-12)
